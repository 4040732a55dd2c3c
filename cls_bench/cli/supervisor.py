"""Carries out a command that calls a user's controller in a process of its own, and survives it.

The controller may raise, hang, end the interpreter, print or allocate without end, or start other processes: the
command ends with one line and exit code 5 in bounded time and memory, and what was recorded stays.
"""

import contextlib
import os
import pickle
import selectors
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cls_bench import interrupts
from cls_bench.cli.failures import Debug, say
from cls_bench.cli.worker import LENGTH, Job, Limits
from cls_bench.errors import BenchError, ControllerError, ExitCode, Interrupted

MOST_PRINTED = 64_000
"""Letters that the controller may print; the rest is left out."""

_GRACE_S = 3.0
_START_S = 300.0  # to import and compile


class ControllerEndedError(ControllerError):
    """The process with the controller is gone without a result."""


def supervised(
    function: Callable[..., Any], *arguments: Any, limits: Limits, tell: Callable[..., None] = lambda *what: None
) -> Any:
    """``function(tell, *arguments)``, carried out in a process of its own; ``tell`` is called in this one.

    Raises what it raised, as one of this project's errors, and ControllerEndedError if its process ended, hung or
    took too much.
    """
    with _Worker(Job(function, arguments, limits, Debug.on)) as worker, interrupts.held():
        return worker.wait(tell)


class _Worker:
    def __init__(self, job: Job):
        self._job = job
        reading, writing = os.pipe()
        path = [folder for folder in sys.path if folder and Path(folder).is_absolute()]
        code = f"import sys; sys.path[:] = {path!r}; from cls_bench.cli.worker import main; main({writing})"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, pass_fds=(writing,), start_new_session=True,
        )  # fmt: skip
        os.close(writing)
        self._selector = selectors.DefaultSelector()
        self._channel = os.fdopen(reading, "rb", buffering=0)
        self._received = bytearray()
        self._printed = 0
        for stream in (self._channel, self._process.stdout, self._process.stderr):
            assert stream is not None
            os.set_blocking(stream.fileno(), False)
            self._selector.register(stream.fileno(), selectors.EVENT_READ, stream is self._channel)
        self._open = {self._channel.fileno()}
        self._seen: set[int] = set()
        self._heard = time.monotonic()
        self._silence = _START_S
        self._stuck: tuple[str, float] | None = None
        self._stopping = self._ended_at = 0.0

    def __enter__(self) -> "_Worker":
        stdin = self._process.stdin
        assert stdin is not None
        with contextlib.suppress(BrokenPipeError):
            stdin.write(pickle.dumps(self._job))
            stdin.close()
        return self

    def __exit__(self, *_: object) -> None:
        self._kill()
        self._selector.close()
        self._channel.close()
        for stream in (self._process.stdout, self._process.stderr):
            if stream is not None:
                stream.close()

    def wait(self, tell: Callable[..., None]) -> Any:
        """Pass on what comes until there is a result."""
        while True:
            for key, _ in self._selector.select(0.02):
                data = self._take(key.fd)
                if data is None:
                    continue
                if not data:
                    self._selector.unregister(key.fd)
                    self._open.discard(key.fd)
                elif key.data:
                    self._received += data
                else:
                    self._pass_on(data)
            for kind, value in self._messages():
                self._heard = time.monotonic()
                if kind == "result":
                    return value
                if kind == "failed":
                    self._raise(*value)
                if kind == "told":
                    tell(*value)
                if kind == "stuck":
                    self._stuck = value, self._heard
                if kind == "ready":
                    self._silence = self._job.limits.seconds + _GRACE_S
                if kind == "beat":
                    self._stuck = None
            self._look_after()

    def _look_after(self) -> None:
        """Raise ControllerEndedError unless the worker lives, is heard of, and holds no more than it may."""
        now, limits = time.monotonic(), self._job.limits
        if interrupts.pending():
            if not self._stopping:
                self._stopping = now
                self._process.terminate()
            elif now - self._stopping > _GRACE_S:
                raise Interrupted
        if self._process.poll() is not None and not self._ended_at:
            self._ended_at = now
        if not self._open or (self._ended_at and now - self._ended_at > 1.0):  # nothing more will come
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_GRACE_S)
            if self._stopping:
                raise Interrupted
            raise ControllerEndedError(f"the controller ended its process{_how(self._process.poll())}")
        if self._stuck is not None and now - self._stuck[1] > _GRACE_S:
            raise ControllerEndedError(f"the controller {self._stuck[0]}")
        if now - self._heard > self._silence:
            raise ControllerEndedError(f"the controller did not come back within {limits.seconds:g} s")
        if self._memory() > limits.tree_mb * 2**20:
            raise ControllerEndedError(f"the controller takes more memory than {_allowed(limits)}")

    def _take(self, descriptor: int) -> bytes | None:
        """What can be read now; empty at the end."""
        try:
            return os.read(descriptor, 65536)
        except BlockingIOError:
            return None

    def _messages(self) -> list[tuple[str, Any]]:
        found = []
        while len(self._received) >= LENGTH.size:
            (length,) = LENGTH.unpack_from(self._received)
            if len(self._received) < LENGTH.size + length:
                break
            message = bytes(self._received[LENGTH.size : LENGTH.size + length])
            del self._received[: LENGTH.size + length]
            try:
                kind, value = pickle.loads(message)
            except Exception:  # written by someone else
                raise ControllerEndedError("the controller wrote into cls-bench's own pipe") from None
            found.append((kind, value))
        return found

    def _pass_on(self, data: bytes) -> None:
        """What the controller prints goes to standard error, up to a limit."""
        if self._stopping or self._printed > MOST_PRINTED:
            return
        room = MOST_PRINTED - self._printed
        self._printed += len(data)
        text = data[:room].decode(errors="replace")
        text = "".join(letter if letter.isprintable() or letter in "\n\t" else "\ufffd" for letter in text)
        with contextlib.suppress(Exception):
            sys.stderr.write(text)
            sys.stderr.flush()
        if self._printed > MOST_PRINTED:
            say(f"\nwarning: the controller prints more than {MOST_PRINTED // 1000} kB; the rest is left out")

    def _raise(self, code: int, line: str, traceback: str) -> None:
        if traceback:
            say(traceback)
        if code == ExitCode.INTERRUPTED:
            raise Interrupted(line)
        said = line.removeprefix("error: ")
        if code == ExitCode.CONTROLLER:
            raise ControllerError(said)
        if code == ExitCode.INTERNAL:  # whoever is to blame: a user's code had its hands in this process
            raise ControllerEndedError(f"the controller's process failed: {said.removeprefix('internal error: ')}")
        error = BenchError(said)
        error.exit_code = code
        raise error

    def _memory(self) -> int:
        """Memory of the worker and of all processes that it started [bytes]."""
        self._seen |= set(_descendants(self._process.pid))
        total = 0
        for pid in (self._process.pid, *self._seen):
            with contextlib.suppress(OSError, IndexError, ValueError):
                total += int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")
        return total

    def _kill(self) -> None:
        self._seen |= set(_descendants(self._process.pid))
        with contextlib.suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        for pid in self._seen:
            with contextlib.suppress(OSError):
                os.kill(pid, signal.SIGKILL)
        self._process.wait()


def _descendants(pid: int) -> list[int]:
    found: list[int] = []
    for children in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError, ValueError):
            for child in map(int, children.read_text().split()):
                found += [child, *_descendants(child)]
    return found


def _allowed(limits: Limits) -> str:
    workers = limits.processes or limits.threads
    return f"the {limits.megabytes} MB it may" + (f" in each of {workers} workers" if workers > 1 else "")


def _how(code: int | None) -> str:
    if code is None:  # it closed all it could
        return ""
    if code < 0:
        with contextlib.suppress(ValueError):
            return f" with {signal.Signals(-code).name}"
    return f" with exit code {code}"
