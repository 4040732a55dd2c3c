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


@click.command()
@click.argument("recording", type=_RECORDING)
@click.option("--at", type=click.FloatRange(0), help="Time of the still [s].  [default: the middle]")
@click.option("--video", is_flag=True, help="An MP4 of the whole run instead of a still.")
@click.option("--from", "start", type=click.FloatRange(0), default=0.0, help="Start of the video [s].")
@click.option("--to", "end", type=click.FloatRange(0), help="End of the video [s].")
@click.option("--speed", type=click.FloatRange(0, min_open=True), default=1.0, show_default=True,
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
    from cls_bench.report import opengl

    opengl.choose()
    from cls_bench.recording import Recording
    from cls_bench.report import rendering

    opened = Recording(recording)
    path = out or recording.with_suffix(".mp4" if video else ".png")
    if video:
        rendering.save_video(opened, path, start, end or opened.duration, speed=speed, size=size, camera=camera)
    else:
        rendering.save_still(opened, opened.duration / 2 if at is None else at, path, size, camera)
    click.echo(path)
