"""The process in which a command runs that calls a user's controller: whatever that does, it does it here.

Started by :mod:`cls_bench.cli.supervisor` with a job on standard input. What is printed here is the user's and goes
through the supervisor. Results travel through a pipe of their own, a pickle each. A thread says twice a second that
all is well, or that the user's code does not come back; then it is struck with an exception, and if that does not help
the supervisor ends the process.
"""

import ctypes
import os
import pickle
import resource
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from cls_bench import controllers, interrupts
from cls_bench.cli import failures, streams
from cls_bench.controllers import TookTooLongError
from cls_bench.errors import one_line

BEAT_S = 0.5

LENGTH = struct.Struct("<Q")

OWN_MB = 200
"""Memory that cls-bench holds itself, loaded and compiled [MB]."""

THREAD_MB = 100
"""Memory that one more thread takes: its stack, its share of the allocator, a model and the samples of a run [MB]."""

DASK_MB = 300
"""Memory that a process takes more as part of a Dask cluster [MB]."""

_PARENT_DIES = 1  # prctl: the signal that comes when the parent dies


class Limits(NamedTuple):
    """What a user's controller may take."""

    seconds: float = 10.0
    """longest time for the import, for making the object, and for one step [s]"""
    megabytes: int = 400
    """memory beyond what cls-bench takes itself, for each of its workers [MB]"""
    threads: int = 0
    """workers that are threads of the process beside its main one"""
    processes: int = 0
    """workers that are processes of their own, started by it"""

    @property
    def process_mb(self) -> int:
        """What the process may take beyond what it took before it began [MB]."""
        cluster = DASK_MB if self.processes else 0  # it is handed down to the worker processes
        return max(self.threads, 1) * self.megabytes + self.threads * THREAD_MB + cluster

    @property
    def tree_mb(self) -> int:
        """What it and all processes that it started may hold together [MB]."""
        return OWN_MB + self.process_mb + self.processes * (OWN_MB + DASK_MB + self.megabytes)


class Job(NamedTuple):
    """What the worker is to do: ``function(tell, *arguments)``; what it tells and returns is sent to the supervisor."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    limits: Limits
    debug: bool


class _Channel:
    """Messages to the supervisor: a kind and a value each."""

    def __init__(self, descriptor: int):
        self._descriptor = descriptor
        self._lock = threading.Lock()
        os.set_inheritable(descriptor, False)
        os.register_at_fork(after_in_child=self._fall_silent)

    def send(self, kind: str, value: Any = None) -> None:
        """Send a message, whole."""
        message = pickle.dumps((kind, value))
        with self._lock:
            data = memoryview(LENGTH.pack(len(message)) + message)
            while data:
                data = data[os.write(self._descriptor, data) :]

    def tell(self, *what: Any) -> None:
        """Pass on what the job tells."""
        self.send("told", what)

    def _fall_silent(self) -> None:
        """In a child that the user's code forked: it may do what it likes, but it is not the run."""
        os.close(self._descriptor)
        self.send = lambda kind, value=None: os._exit(0)  # type: ignore[method-assign]


def main(descriptor: int) -> None:
    """Do the job on standard input; ends the process."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_DIES, signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is the supervisor's
    interrupts.install()
    channel = _Channel(descriptor)
    job: Job = pickle.load(sys.stdin.buffer)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    failures.Debug.on = job.debug
    threading.excepthook = lambda about: failures.say(f"a thread ended: {one_line(about.exc_value)}")
    sys.unraisablehook = lambda about: failures.say(f"ignored: {one_line(about.exc_value)}")
    streams.quiet_warnings()
    signal.signal(signal.SIGUSR1, _strike)
    watch = threading.Thread(target=_watch, args=(channel, job.limits.seconds), daemon=True)
    watch.start()
    try:
        _get_ready(channel, job.limits)
        channel.send("result", job.function(channel.tell, *job.arguments))
    except BaseException as error:
        code, line = failures.told(error)
        channel.send("failed", (code, line, failures.traceback_of(error) if job.debug else ""))
    os._exit(0)


def _get_ready(channel: _Channel, limits: Limits) -> None:
    """Load and compile all that is needed, then limit what may be taken beyond that."""
    from cls_bench import experiment
    from cls_bench.bench import Bench
    from cls_bench.compiled import is_cached
    from cls_bench.parameters import Parameters
    from cls_bench.recording import rerun_writer

    assert experiment and rerun_writer
    if not is_cached():
        channel.tell("compiling")
    Bench(Parameters()).compile()
    status = Path("/proc/self/status")
    if status.is_file():
        used = next(int(line.split()[1]) for line in status.read_text().splitlines() if line.startswith("VmData"))
        limit = used * 1024 + limits.process_mb * 2**20
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        resource.setrlimit(resource.RLIMIT_DATA, (min(limit, hard) if hard >= 0 else limit, hard))
        # What a failed controller still holds must not keep its recording from being finished.
        controllers.on_failure.append(lambda: resource.setrlimit(resource.RLIMIT_DATA, (hard, hard)))
    channel.send("ready")


_struck = ""


def _strike(number: int, frame: Any) -> None:
    """In the main thread: raise in the midst of the user's code."""
    if threading.get_ident() in controllers.inside or any(a.asked != a.answered for a in _asking()):
        raise TookTooLongError(_struck)


def _asking() -> list[Any]:
    kind = getattr(sys.modules.get("cls_bench.control.outer_loop"), "Asking", None)  # it may be being imported
    while kind is not None:
        try:
            return list(kind.alive)
        except RuntimeError:  # another thread just added one
            continue
    return []


def _watch(channel: _Channel, limit: float) -> None:
    """Say that all is well as long as the user's code comes back in time."""
    global _struck  # noqa: PLW0603
    since: dict[Any, tuple[Any, float]] = {}
    next_beat = 0.0
    while True:
        now = time.monotonic()
        stuck = ""
        busy: dict[Any, tuple[Any, float]] = dict(controllers.inside)
        for asking in _asking():
            if asking.asked != asking.answered:
                before = since.get(id(asking))
                busy[id(asking)] = before if before and before[0] == asking.asked else (asking.asked, now)
        since = busy
        if any(now - start > limit for _, start in busy.values()):
            stuck = f"did not come back within {limit:g} s"
        if stuck:
            if not _struck:
                _struck = stuck
                channel.send("stuck", stuck)
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGUSR1)
        elif now >= next_beat:
            _struck = ""
            channel.send("beat")
            next_beat = now + BEAT_S
        time.sleep(min(BEAT_S, limit / 4))
