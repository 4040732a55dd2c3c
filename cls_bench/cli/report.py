"""report, compare, gallery, render: what recordings show."""

from pathlib import Path

import click

_RECORDING = click.Path(path_type=Path)


@click.command()
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=_RECORDING)
@click.option("--out", type=click.Path(path_type=Path), default=Path("reports"), show_default=True,
              help="Folder for the page and its figures.")  # fmt: skip
def report(recordings: tuple[Path, ...], out: Path) -> None:
    """Write one self-contained HTML page about the recordings (.mcap), with figures also as PNG and SVG."""
    from cls_bench.report.page import write_report
    from cls_bench.report.recorded_run import open_runs

    click.echo(write_report(open_runs(recordings), out))
