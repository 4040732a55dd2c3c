"""What all attacks share: trials, commands that are watched, and what counts as lost."""

import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

PROJECT = Path(__file__).parents[2]

PASSED, FAILED, REFUSED, DIVERGED, TRIPPED, CONTROLLER, INTERNAL, INTERRUPTED = 0, 1, 2, 3, 4, 5, 70, 130
"""Exit codes as the documentation promises them: written down here once more, not taken from the program."""

MOST_MB = 1000.0
"""Memory that a process may take."""

KEPT_BYTES = 200_000
"""Of what a process prints, so much is kept of its beginning and of its end."""


class LostError(Exception):
    """The trial is lost; the text says why."""


class UntriedError(Exception):
    """This machine cannot do what the trial needs; the text says what."""


@dataclass(frozen=True)
class Trial:
    """One trial: its number, its random numbers, which depend on seed and number alone, and a folder of its own."""

    number: int
    rng: np.random.Generator
    folder: Path
    stage: Path
    """folder of what :attr:`Attack.prepare` made for all trials"""


@dataclass(frozen=True)
class Attack:
    """A kind of attack."""

    name: str
    title: str
    whole: int
    """trials of ``make attack``"""
    quick: Sequence[int]
    """trials in the ordinary tests, by number"""
    trial: Callable[[Trial], str]
    """carries a trial out; returns what was done in a few words, raises LostError or :class:`UntriedError`"""
    prepare: Callable[[Path], None] = lambda stage: None
    time_limit: float = 240.0
    """for a trial, after which it hangs [s]"""


@dataclass
class Outcome:
    """What became of a trial."""

    attack: str
    number: int
    state: str
    """``survived``, ``lost`` or ``untried``"""
    what: str
    seconds: float
    peak_mb: float = 0.0


@dataclass
class Ended:
    """How a process ended."""

    code: int
    """negative: the signal that ended it"""
    out: str
    err: str
    seconds: float
    peak_mb: float
    hung: bool = False
    left_behind: bool = False
    command: str = ""


def entry_point() -> str:
    """Python text that calls what the command ``cls-bench`` calls."""
    scripts = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["scripts"]
    module, _, name = scripts["cls-bench"].partition(":")
    return f"from {module} import {name}; {name}()"


class Process:
    """A process that is watched: what it prints, its memory, and what it leaves behind."""

    largest_mb = 0.0
    """peak memory of all processes since this was set to 0"""

    def __init__(
        self, command: Sequence[str], *, cwd: Path | None = None, environment: dict[str, str] | None = None,
        stdout: int | IO[bytes] = subprocess.PIPE, before: Callable[[], None] | None = None, lines: bool = False,
        pass_fds: Collection[int] = (),
    ):  # fmt: skip
        self._start = time.monotonic()
        self.command = " ".join(command[command.index("-c") + 2 :] if "-c" in command else command)
        paths = [str(PROJECT), *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
        self.process = subprocess.Popen(
            command, cwd=cwd, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), **(environment or {})},
            stdin=subprocess.DEVNULL, stdout=stdout, stderr=subprocess.PIPE, start_new_session=True,
            preexec_fn=before,  # noqa: PLW1509  (sets limits and nothing else)
            pass_fds=tuple(pass_fds),
        )  # fmt: skip
        self._kept = {name: bytearray() for name in ("out", "err")}
        self._peak = 0.0
        pipes = [("out", self.process.stdout), ("err", self.process.stderr)]
        self._readers = [
            threading.Thread(target=self._keep, args=(name, pipe), daemon=True)
            for name, pipe in pipes if pipe is not None and not (lines and name == "out")
        ]  # fmt: skip
        for reader in self._readers:
            reader.start()

    def _keep(self, name: str, pipe: IO[bytes]) -> None:
        kept = self._kept[name]
        while part := os.read(pipe.fileno(), 65_536):
            kept += part
            if len(kept) > 2 * KEPT_BYTES:
                kept[KEPT_BYTES:-KEPT_BYTES] = b""

    def send(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            self.process.send_signal(number)

    def wait(self, timeout: float) -> Ended:
        """Wait for its end; kill it if it takes longer or more memory than it may, and whatever it left behind."""
        deadline = time.monotonic() + timeout
        hung = False
        while (code := self._poll()) is None:
            self._peak = max(self._peak, *(memory_mb(pid) for pid in _family(self.process.pid)))
            if time.monotonic() > deadline or self._peak > 2 * MOST_MB:
                hung = self._peak <= 2 * MOST_MB
                os.killpg(self.process.pid, signal.SIGKILL)
                deadline = time.monotonic() + 60.0
            time.sleep(0.02)
        Process.largest_mb = max(Process.largest_mb, self._peak)
        seconds = time.monotonic() - self._start
        ended_by_us = hung or self._peak > 2 * MOST_MB
        left_behind = not ended_by_us and self._outlived()
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        for reader in self._readers:
            reader.join(10.0)
        out, err = (bytes(self._kept[name]).decode(errors="replace") for name in ("out", "err"))
        return Ended(code, out, err, seconds, self._peak, hung, left_behind, self.command)

    def _outlived(self) -> bool:
        """Whether a process of its group is still there after a while: one that ends just now is not left behind."""
        for _ in range(100):
            try:
                os.killpg(self.process.pid, 0)
            except ProcessLookupError:
                return False
            time.sleep(0.05)
        return True

    def _poll(self) -> int | None:
        if self.process.returncode is None:
            pid, status, usage = os.wait4(self.process.pid, os.WNOHANG)
            if pid:
                self.process.returncode = os.waitstatus_to_exitcode(status)
                self._peak = max(self._peak, usage.ru_maxrss / 1024)
        return self.process.returncode


def _family(pid: int) -> list[int]:
    """A process and its children."""
    found = [pid]
    with contextlib.suppress(OSError):
        for task in Path(f"/proc/{pid}/task").iterdir():
            found += map(int, (task / "children").read_text().split())
    return found


def memory_mb(pid: int | str = "self", what: str = "VmHWM") -> float:
    """Memory of a process, its peak unless told otherwise; 0 if it has gone."""
    with contextlib.suppress(OSError):
        found = re.search(rf"{what}:\s*(\d+) kB", Path(f"/proc/{pid}/status").read_text())
        return int(found[1]) / 1024 if found else 0.0
    return 0.0


def forget_peak() -> None:
    """Let the peak memory of this process begin anew."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def command_line(*arguments: str | Path) -> list[str]:
    """``cls-bench`` with arguments, as it is in this checkout."""
    return [sys.executable, "-c", entry_point(), *map(str, arguments)]


def call(*arguments: str | Path, timeout: float = 120.0, wrapper: Sequence[str] = (), **options: Any) -> Ended:
    """Call ``cls-bench`` and watch it; ``wrapper`` is a command that takes it as its arguments."""
    process = Process([*wrapper, *command_line(*arguments)], **options)
    process.command = " ".join(map(str, arguments))
    return process.wait(timeout)


def judge(ended: Ended, codes: Collection[int]) -> None:
    """Lost unless the process ended as it should: in time, with one of ``codes``, one line for an error, no more."""
    says = _said(ended)
    if ended.hung:
        raise LostError(f"hangs: {ended.command}{says}")
    judge_output(ended.code, ended.out, ended.err, codes)
    if ended.peak_mb > MOST_MB:
        raise LostError(f"takes {ended.peak_mb:.0f} MB: {ended.command}")
    if ended.left_behind:
        raise LostError(f"leaves a process behind: {ended.command}")


def judge_output(code: int, out: str, err: str, codes: Collection[int]) -> None:
    """Lost unless exit code and output are what they should be."""
    lines = [line for line in err.splitlines() if line.strip()]
    last = f"; last line: {lines[-1][:200]}" if lines else ""
    for text, place in ((out, "stdout"), (err, "stderr")):
        if "Traceback (most recent call last)" in text or "Exception ignored" in text or "panicked at" in text:
            raise LostError(f"a traceback on {place}, exit code {code}{last}")
    if code not in codes:
        raise LostError(f"exit code {code} instead of {' or '.join(map(str, sorted(codes)))}{last}")
    errors = [line for line in lines if line.startswith("error: ")]
    if code in (REFUSED, INTERNAL) and (len(errors) != 1 or lines[-1] != errors[0]):
        raise LostError(f"{len(errors)} error lines, {len(lines)} lines in all, exit code {code}{last}")
    if code in (PASSED, FAILED) and errors:
        raise LostError(f"an error line although the exit code is {code}{last}")
    if code == INTERRUPTED and not (lines and lines[-1].startswith("interrupted")):
        raise LostError(f"interrupted without a word{last}")
    ours = [line for line in lines if line.startswith(("error: ", "warning: ", "interrupted"))]
    if any(len(line) > 1000 for line in ours):
        raise LostError(f"a line of {max(map(len, ours))} letters on stderr{last}")


def _said(ended: Ended) -> str:
    lines = ended.err.splitlines()
    return f"; last line: {lines[-1][:200]}" if lines else ""


@contextlib.contextmanager
def own_folder(parent: Path, number: int) -> Iterator[Path]:
    """A folder for a trial, which goes with it."""
    folder = parent / f"trial-{number}-{os.getpid()}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def as_json(ended: Ended) -> dict[str, Any]:
    """What ``--json`` printed; Lost if that is no object."""
    try:
        found = json.loads(ended.out)
    except ValueError:
        raise LostError(f"--json printed no JSON, exit code {ended.code}: {ended.out[:100]!r}") from None
    if not isinstance(found, dict):
        raise LostError(f"--json printed {type(found).__name__}")
    return found
