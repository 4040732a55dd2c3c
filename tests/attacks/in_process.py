"""Commands called in the trial's own process, many times faster than each in its own; what they open is seen."""

import contextlib
import os
import shlex
import sys
import tempfile
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.attacks.trials import LostError

NEVER_OPENED = ("/dev/zero", "/dev/random", "/etc/passwd", "/etc/hostname", "/proc/self/environ")
"""Files that a scenario or a recording may name and that no one may open for it."""

_opened: list[tuple[str, bool]] = []
"""path and whether it was opened for writing, of all files that this process opened since the list was emptied"""
_listening: list[bool] = []


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event == "open" and isinstance(arguments[0], (str, bytes, os.PathLike)):
        _, mode, flags = arguments
        writes = (
            any(letter in mode for letter in "wax+")
            if isinstance(mode, str)
            else bool(flags & (os.O_WRONLY | os.O_RDWR))
        )
        _opened.append((os.fsdecode(arguments[0]), writes))


@contextlib.contextmanager
def guarded(folder: Path, *never: Path) -> Iterator[Path]:
    """Lost if a file is opened that must not be, written outside of ``folder``, or left behind in its temporary folder.

    Temporary files go into a folder that is handed out.
    """
    if not _listening:
        sys.addaudithook(_hear)
        _listening.append(True)
    temporary = folder / "deep" / "tmp"
    temporary.mkdir(parents=True, exist_ok=True)
    before, tempfile.tempdir = tempfile.tempdir, str(temporary)
    os.environ["TMPDIR"] = str(temporary)
    _opened.clear()
    try:
        yield temporary
    finally:
        tempfile.tempdir = before
    forbidden = {*NEVER_OPENED, *map(str, never)}
    for path, writes in _opened:
        if path in forbidden or os.path.realpath(path) in forbidden:
            raise LostError(f"opens {path}")
        if writes and not Path(os.path.realpath(path)).is_relative_to(folder.resolve()) and not _is_a_cache(path):
            raise LostError(f"writes {path}")
    left = [path.name for path in temporary.iterdir()]
    if left:
        raise LostError(f"leaves temporary files behind: {left[0]}")
    if [path.name for path in (folder / "deep").iterdir()] != ["tmp"]:
        raise LostError("writes beside its temporary folder")


def _is_a_cache(path: str) -> bool:
    return path == os.devnull or any(
        part in path for part in ("/cls-bench/", "matplotlib", "__pycache__", "fontlist", "/proc/self/")
    )


def call_here(*arguments: str | Path, folder: Path) -> tuple[int, str, str]:
    """Carry out a command line in this process: exit code, standard output and standard error."""
    from cls_bench.cli import main

    kept = os.dup(1), os.dup(2)
    files = [(folder / name).open("w+b") for name in ("stdout", "stderr")]
    sys.stdout.flush(), sys.stderr.flush()
    for number, file in enumerate(files, start=1):
        os.dup2(file.fileno(), number)
    code = 0
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            main([str(argument) for argument in arguments], prog_name="cls-bench")
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1 if end.code else 0
    except BaseException:
        traceback.print_exc()
        code = 1
    finally:
        sys.stdout.flush(), sys.stderr.flush()
        for number, copy in enumerate(kept, start=1):
            os.dup2(copy, number)
            os.close(copy)
        texts = []
        for file in files:
            file.seek(0)
            texts.append(file.read(400_000).decode(errors="replace"))
            file.close()
    return code, texts[0], texts[1]


@contextlib.contextmanager
def fake_viewer(folder: Path) -> Iterator[Path]:
    """A viewer that keeps a copy of what it is to show; its path is handed out."""
    from cls_bench.recording import rerun_process

    shown, program = folder / "shown.rrd", folder / "rerun"
    program.write_text(f'#!/bin/sh\nexec cp "$1" {shlex.quote(str(shown))}\n')
    program.chmod(0o755)
    os.environ["DISPLAY"] = ":99"
    before = rerun_process.program
    rerun_process.program = lambda: program
    try:
        yield shown
    finally:
        rerun_process.program = before
        os.environ.pop("DISPLAY")
