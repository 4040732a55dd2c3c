"""view: recordings in the Rerun viewer."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

import click

from cls_bench.errors import InputError, OutputError

WEB_PORT = 9090


@click.command()
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--serve", is_flag=True, help="Serve it to a browser on this machine instead of opening a window.")
@click.option("--port", type=click.IntRange(1, 65534), default=WEB_PORT, show_default=True,
              help="Port of --serve; the next one carries the data.")  # fmt: skip
def view(recordings: tuple[Path, ...], serve: bool, port: int) -> None:
    """Open recordings (.mcap or .rrd) in the Rerun viewer; several stand side by side.

    A recording without its .rrd is converted first; the .mcap alone is enough.
    """
    view_recordings(recordings, serve=serve, port=port)


def view_recordings(recordings: Sequence[Path], *, serve: bool = False, port: int = WEB_PORT) -> None:
    """Open the recordings in the Rerun viewer until it is closed; InputError if it cannot start."""
    for path in recordings:
        if not path.is_file():
            raise InputError(f"{path}: no such file")
    names = " ".join(map(str, recordings))
    if not serve and sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"there is no display; serve it to a browser: cls-bench view --serve {names}")
    with _rrd(recordings) as shown:
        command = [str(Path(sys.executable).with_name("rerun")), str(shown)]
        if serve:
            data_port = port + 1
            command += ["--serve-web", "--bind", "127.0.0.1", "--web-viewer-port", str(port), "--port", str(data_port)]
            source = quote(f"rerun+http://127.0.0.1:{data_port}/proxy", safe="")
            click.echo(f"until Ctrl-C, open http://127.0.0.1:{port}/?url={source}")
        try:
            code = subprocess.run(command, check=False).returncode
        except OSError as error:
            raise InputError(
                f"the Rerun viewer cannot be started ({error.strerror}); it comes with rerun-sdk"
            ) from None
    if code:
        raise InputError(
            f"the Rerun viewer ended with code {code}; without a graphics driver, serve it to a browser: "
            f"cls-bench view --serve {names}"
        )


@contextmanager
def _rrd(recordings: Sequence[Path]) -> Iterator[Path]:
    """One .rrd that shows all of ``recordings``: the one there is, or one made for the while."""
    if len(recordings) == 1:
        rrd = recordings[0].with_suffix(".rrd")
        if rrd.is_file():
            yield rrd
            return
    from cls_bench.recording import Recording
    from cls_bench.recording.rerun_writer import write_rrd

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{recordings[0].stem}.rrd"
        try:
            write_rrd([Recording(recording.with_suffix(".mcap")) for recording in recordings], path)
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}") from None
        yield path
