"""report, compare, gallery, render: what recordings show."""

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click

from cls_bench.cli.options import TIME, FiniteRange
from cls_bench.errors import InputError, Interrupted
from cls_bench.text import printable

_RECORDING = click.Path(path_type=Path)
SPEED = FiniteRange(1e-3, 1e3)
"""Of a video [times real time]."""


@click.command()
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=_RECORDING)
@click.option("--out", type=click.Path(path_type=Path), default=Path("reports"), show_default=True,
              help="Folder for the page and its figures.")  # fmt: skip
def report(recordings: tuple[Path, ...], out: Path) -> None:
    """Write one self-contained HTML page about the recordings (.mcap), with figures also as PNG and SVG."""
    from cls_bench.report.recorded_run import open_runs

    with doubts_instead_of_warnings():
        runs = open_runs(recordings)
        from cls_bench.report.page import write_report

        page = write_report(runs, out)
        for run in runs:
            say_doubts(run.path, run.doubts)
    click.echo(page)


@contextmanager
def doubts_instead_of_warnings() -> Iterator[None]:
    """For code that calls :func:`say_doubts`: what is wrong with a recording is said once, a line each."""
    from cls_bench.recording.mcap_reader import RecordingWarning

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RecordingWarning)
        yield


def say_doubts(path: Path, doubts: Sequence[str]) -> None:
    """Say what is wrong with a recording on standard error."""
    for doubt in doubts:
        click.echo(f"warning: {path}: {doubt}", err=True)


@click.command()
@click.argument("first", metavar="A", type=_RECORDING)
@click.argument("second", metavar="B", type=_RECORDING)
@click.option("--signal", "signals", multiple=True, metavar="/TOPIC.NAME",
              help="Signal to lay over each other; may be given again.  "
                   "[default: column angle, load cell torque, motor torque]")  # fmt: skip
@click.option("--window", nargs=2, type=TIME, metavar="START END", help="Times to compare [s].")
@click.option("--out", type=click.Path(path_type=Path), default=Path("reports"), show_default=True,
              help="Folder for the page.")  # fmt: skip
def compare(first: Path, second: Path, signals: tuple[str, ...], window: tuple[float, float] | None, out: Path) -> None:
    """Compare two recordings (.mcap): metrics, parameters, and signals laid over each other in a page."""
    from cls_bench.analysis.window import split_signal
    from cls_bench.cli.output import number, print_table
    from cls_bench.report.recorded_run import RecordedRun, Span

    for signal in signals:
        split_signal(signal)  # raises InputError
    with doubts_instead_of_warnings():
        a, b = RecordedRun(first), RecordedRun(second)
        from cls_bench.report import comparison, page

        metrics = [
            (d.name, d.unit, number(d.first), number(d.second), number(d.change), _percent(d.relative))
            for d in comparison.differences(a, b)
        ]
        changed = [(key, f"{x}", f"{y}", unit) for key, x, y, unit in comparison.parameter_differences(a, b)]
        left_out: list[str] = []
        span = Span(*window) if window else None
        pictures = list(comparison.overlays(a, b, signals or comparison.signals_of(a), span, left_out))
        for run in (a, b):
            say_doubts(run.path, run.doubts)
    sections = []
    for title, header, rows, none in (
        ("Metrics", ("metric", "unit", "A", "B", "B − A", "change"), metrics, "They measure nothing in common."),
        ("Parameters that differ", ("parameter", "A", "B", "unit"), changed, "All parameters are the same."),
        ("Controllers that differ", ("controller", "A", "B"), comparison.controller_differences(a, b),
         "The same controller ran."),
    ):
        sections.append(page.Section(title, "" if rows else none, (header, *rows) if rows else ()))
        if rows:
            print_table(header, rows)
        else:
            click.echo(none)
    for line in left_out:
        click.echo(f"not drawn: {line}")
    click.echo(page.write_comparison(a, b, pictures, left_out, sections, out))


def _percent(part: float) -> str:
    import math

    return f"{part:+.1%}" if math.isfinite(part) else ""


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("gallery"), show_default=True,
              help="Folder for the pages.")  # fmt: skip
@click.option("--recordings", type=click.Path(path_type=Path),
              help="Folder that keeps the recordings; without it they are deleted.")  # fmt: skip
@click.pass_context
def gallery(ctx: click.Context, out: Path, recordings: Path | None) -> None:
    """Run all shipped scenarios and build a page of them, with a report of each.

    The exit code is the gravest of the runs'.
    """
    import tempfile
    import time

    began = time.time()
    from cls_bench import experiment
    from cls_bench.cli.output import progress_bar, results_folder
    from cls_bench.report.page import write_gallery
    from cls_bench.report.recorded_run import RecordedRun
    from cls_bench.resources import shipped_scenarios
    from cls_bench.scenario import load_scenario

    with tempfile.TemporaryDirectory() as folder:
        runs, codes = [], []
        for name in shipped_scenarios():
            scenario = load_scenario(name)
            with progress_bar(scenario.duration, quiet=False) as progress:
                try:
                    result = experiment.run(scenario, out=recordings or Path(folder), rerun=False, progress=progress)
                except Interrupted:
                    if recordings is not None:
                        raise
                    raise Interrupted("interrupted; nothing is kept without --recordings") from None
            click.echo(f"{name}: {result.status}")
            runs.append(RecordedRun(result.mcap))
            codes.append(result.exit_code)
        click.echo(write_gallery(runs, results_folder(out, began)))
    ctx.exit(max(codes, default=0))


@click.command()
@click.argument("recording", type=_RECORDING)
@click.option("--at", type=TIME, help="Time of the still [s].  [default: the middle]")
@click.option("--video", is_flag=True, help="An MP4 of the whole run instead of a still.")
@click.option("--from", "start", type=TIME, default=0.0, help="Start of the video [s].")
@click.option("--to", "end", type=TIME, help="End of the video [s].")
@click.option("--speed", type=SPEED, default=1.0, show_default=True,
              help="How many times as fast as the run the video plays.")  # fmt: skip
@click.option("--camera", default="bench", show_default=True, help="bench, side, pilot or drive.")
@click.option("--size", nargs=2, type=click.IntRange(16, 7680), default=(1280, 800), show_default=True,
              metavar="WIDTH HEIGHT", help="Size of the picture [pixels].")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="File to write.  [default: beside the recording]")
def render(
    recording: Path, at: float | None, video: bool, start: float, end: float | None, speed: float, camera: str,
    size: tuple[int, int], out: Path | None,
) -> None:  # fmt: skip
    """Draw the bench from a recording (.mcap): a still, or a video."""
    from cls_bench.recording import Recording
    from cls_bench.report import drawn_model, opengl

    with doubts_instead_of_warnings():
        opened = Recording(recording)
        opened.require_samples()
        cameras = drawn_model.camera_names(drawn_model.model_xml(opened))
        if camera not in cameras:
            valid = printable(", ".join(cameras), 200)
            raise InputError(f'there is no camera "{camera}"; valid: {valid}')
        if video:
            end = opened.duration if end is None else end
            if not start < end:
                raise InputError(f"--from {start:g} --to {end:g}: the video must start before it ends")
            drawn_model.check_time(opened, end)
        else:
            at = opened.duration / 2 if at is None else at
            drawn_model.check_time(opened, at)
        opengl.choose()  # before MuJoCo is imported
        from cls_bench.report import rendering

        path = out or recording.with_suffix(".mp4" if video else ".png")
        if video:
            rendering.save_video(opened, path, start, end or 0.0, speed=speed, size=size, camera=camera)
        else:
            rendering.save_still(opened, at or 0.0, path, size, camera)
        say_doubts(recording, opened.doubts)
    click.echo(path)
