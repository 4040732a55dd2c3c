"""view: recordings in the Rerun viewer."""

import os
import shlex
import socket
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

import click

from cls_bench.cli.report import doubts_instead_of_warnings, say_doubts
from cls_bench.errors import InputError, OutputError

if TYPE_CHECKING:
    import subprocess

    from cls_bench.recording import Recording

WEB_PORT = 9090

HERE = "127.0.0.1"


@click.command()
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--serve", is_flag=True, help="Serve it to a browser on this machine instead of opening a window.")
@click.option("--port", type=click.IntRange(1, 65534), default=WEB_PORT, show_default=True,
              help="Port of --serve; the next one carries the data.")  # fmt: skip
@click.option("--layout", metavar="FILE", type=click.Path(path_type=Path),
              help="Write a layout for Lichtblick or Foxglove that fits the recording; open nothing.")  # fmt: skip
def view(recordings: tuple[Path, ...], serve: bool, port: int, layout: Path | None) -> None:
    """Open recordings (.mcap or .rrd) in the Rerun viewer; several stand side by side.

    A recording without its .rrd is converted first; the .mcap alone is enough.
    """
    if layout is not None:
        write_layout(recordings, layout)
        return
    view_recordings(recordings, serve=serve, port=port)


def write_layout(recordings: Sequence[Path], path: Path) -> None:
    """Write a layout for Lichtblick or Foxglove for a recording. Raises InputError and OutputError."""
    import json

    from cls_bench.claims import cannot_write, write_text
    from cls_bench.recording import Recording
    from cls_bench.recording.foxglove_layout import foxglove_layout

    if len(recordings) > 1:
        raise InputError("--layout takes one recording")
    with doubts_instead_of_warnings():
        recording = Recording(recordings[0].with_suffix(".mcap"))
        known = {topic.path for topic in recording.known_topics}
    recorded = [topic for topic in recording.topics.values() if topic.path in known]
    try:
        write_text(path, json.dumps(foxglove_layout(recorded), indent=2, ensure_ascii=False) + "\n")
    except OSError as error:
        raise cannot_write(path, error) from None
    click.echo(path)


def require_display(instead: str) -> None:
    """InputError that says what to do ``instead`` if there is no display for a window."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"there is no display; serve it to a browser: {instead}")


def view_recordings(recordings: Sequence[Path], *, serve: bool = False, port: int = WEB_PORT) -> None:
    """Open the recordings in the Rerun viewer until it is closed; InputError if it cannot start."""
    opened = _opened(recordings)
    again = f"cls-bench view --serve {shlex.join(map(str, recordings))}"
    if not serve:
        require_display(again)
    ports = (port, port + 1) if serve else ()
    for number in ports:
        _check_free(number)
    from cls_bench.recording.rerun_process import viewer

    with _rrd(recordings, opened) as shown:
        arguments = [str(shown)]
        if serve:
            arguments += ["--serve-web", "--bind", HERE, "--web-viewer-port", str(port), "--port", str(port + 1)]
        try:
            with viewer(arguments) as process:
                if serve and _answers(process, ports):
                    source = quote(f"rerun+http://{HERE}:{port + 1}/proxy", safe="")
                    # A page that is part of a notebook sends no analytics either.
                    click.echo(f"until Ctrl-C, open http://{HERE}:{port}/?url={source}&notebook=1")
                code = process.wait()
        except OSError as error:
            raise InputError(
                f"the Rerun viewer cannot be started ({error.strerror}); it comes with rerun-sdk"
            ) from None
    if code:
        raise InputError(
            f"the Rerun viewer ended with code {code}; without a graphics driver, serve it to a browser: "
            f"{again}"
        )


def _check_free(port: int) -> None:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # ports that were just given up are free
        try:
            probe.bind((HERE, port))
        except OSError as error:
            raise InputError(f"port {port} cannot be used ({error.strerror}); choose another with --port") from None


def _answers(process: "subprocess.Popen[bytes]", ports: Sequence[int]) -> bool:
    """Wait until all of ``ports`` answer; False if the viewer has ended."""
    for port in ports:
        while process.poll() is None:
            with socket.socket() as probe:
                if probe.connect_ex((HERE, port)) == 0:
                    break
            time.sleep(0.1)
    return process.poll() is None


RRD_MAGIC = b"RRF"


def _opened(paths: Sequence[Path]) -> "list[Recording]":
    """The recordings to convert: none if one path is shown as it is. InputError for what is no recording with samples.

    Of several, each ``.rrd`` stands for the ``.mcap`` beside it.
    """
    from cls_bench.recording import Recording

    if len(paths) == 1 and paths[0].suffix == ".rrd":
        _check_rrd(paths[0])
        return []
    with doubts_instead_of_warnings():
        opened = [Recording(path.with_suffix(".mcap") if path.suffix == ".rrd" else path) for path in paths]
        for recording in opened:
            recording.require_samples()
    return opened


def _check_rrd(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path}: {'not a regular file' if path.exists() else 'no such file'}")
    try:
        with path.open("rb") as file:
            magic = file.read(len(RRD_MAGIC))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    if magic != RRD_MAGIC:
        raise InputError(f"{path}: not a file of the Rerun viewer")


@contextmanager
def _rrd(paths: Sequence[Path], opened: "Sequence[Recording]") -> Iterator[Path]:
    """One .rrd that shows all of ``paths``: the one there is, or one made of ``opened`` for the while."""
    if len(paths) == 1:
        rrd = paths[0].with_suffix(".rrd")
        if rrd.is_file() and (rrd.stat().st_size or not opened):  # a run that was killed early left nothing in it
            _check_rrd(rrd)
            yield rrd
            return
    from cls_bench.recording.rerun_writer import write_rrd

    with tempfile.TemporaryDirectory() as folder, doubts_instead_of_warnings():
        path = Path(folder) / f"{paths[0].stem}.rrd"
        try:
            write_rrd(opened, path)
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}") from None
        for recording in opened:
            say_doubts(recording.path, recording.doubts)
        yield path
