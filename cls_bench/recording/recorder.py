"""Records a run in MCAP and Rerun side by side, in the background."""

import contextlib
import datetime as dt
import queue
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from cls_bench.claims import cannot_write, remove, remove_empty
from cls_bench.errors import OutputError
from cls_bench.recording.mcap_writer import McapRecorder
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import Block, Topic

QUEUE_BLOCKS = 2
"""Blocks that may wait to be encoded; then :meth:`Recorder.write` waits too, so that memory does not grow."""

VIEW_QUEUE_BLOCKS = 5
"""Blocks that may wait for the .rrd: a while longer, so that it does not hold up the recording of record."""

STALL_S = 15.0
"""The .rrd is given up when it has taken nothing for so long [s]."""

INTERRUPTED = "interrupted"
COMPLETE = "complete"


class _Writer(Protocol):
    @property
    def written_ticks(self) -> int: ...

    def write(self, block: Block) -> None: ...

    def finish(self, status: str, wall_end: str, *, verdict: str, checks: Mapping[str, float | None]) -> None: ...

    def close(self) -> None: ...


class Recorder:
    """Writes ``stem.mcap`` and, if asked, ``stem.rrd``, each in a background thread of its own.

    The compiled simulation releases the interpreter, so encoding costs it nothing while a second core is free. When the
    .mcap cannot be written, the next :meth:`write` or :meth:`flush` raises :class:`OutputError`. The .rrd is a view of
    it: it is given what the .mcap holds, so that it takes no room on a disk that the .mcap needs. When it fails the run
    goes on, and :meth:`finish` raises when the .mcap is complete. What was written until then stays readable.

    As a context manager it finishes the files on leaving, if :meth:`finish` was not called: as ``"complete"``, or as
    ``"interrupted"`` when an exception (Ctrl-C) passes through. ``topics`` and ``poses`` as for :class:`McapRecorder`.
    """

    def __init__(
        self, stem: Path, info: RunInfo, *, rerun: bool = True, topics: Sequence[Topic], poses: bool = True
    ):
        self.mcap_path = stem.with_name(f"{stem.name}.mcap")
        self.rrd_path = stem.with_name(f"{stem.name}.rrd") if rerun else None
        mcap: McapRecorder | None = None
        try:
            with _naming(stem.parent):
                stem.parent.mkdir(parents=True, exist_ok=True)
            with _naming(self.mcap_path):
                mcap = McapRecorder(self.mcap_path, info, topics=topics, poses=poses)
            if self.rrd_path is not None:
                from cls_bench.recording.rerun_writer import RerunRecorder

                with _naming(self.rrd_path):
                    rrd = RerunRecorder(self.rrd_path, info, topics=topics, poses=poses)
        except BaseException:
            if mcap is not None:
                mcap.close()
                remove(self.mcap_path)
            remove_empty(*(path for path in (self.mcap_path, self.rrd_path) if path is not None))
            raise
        self._clock = info.clock
        self._mcap = _Lane(self.mcap_path, mcap, QUEUE_BLOCKS)
        self._views: list[_Lane] = []
        if self.rrd_path is not None:
            self._views.append(_Lane(self.rrd_path, rrd, VIEW_QUEUE_BLOCKS, patience=STALL_S))

    @property
    def written_s(self) -> float:
        """Simulated time [s] up to which the files hold the run, whatever becomes of this process."""
        views = [view.written_ticks for view in self._views if view.error is None]
        return self._clock.time(min([self._mcap.written_ticks, *views]))

    def write(self, block: Block) -> None:
        """Hand over ``block``; waits while others are waiting. Raises :class:`OutputError`."""
        self._mcap.check()
        self._mcap.put(partial(self._take, block))

    def _take(self, block: Block, mcap: _Writer) -> None:
        mcap.write(block)
        for view in self._views:
            view.put(lambda writer: writer.write(block))

    def flush(self) -> None:
        """Wait until the .mcap holds all that was handed over. Raises :class:`OutputError`."""
        done = threading.Event()
        self._mcap.put(lambda writer: done.set())
        while not done.wait(0.2):
            self._mcap.check()  # a writer that failed carries out nothing
        self._mcap.check()

    def finish(self, status: str, verdict: str = "", checks: Mapping[str, float | None] | None = None) -> None:
        """Write what waits, how it ended and the ends of the files, and wait for it. Raises :class:`OutputError`.

        ``verdict`` and ``checks`` as for :meth:`McapRecorder.finish`. Only the first call counts; another one waits, if
        the first was interrupted while waiting.
        """
        end, found = now(), checks or {}
        lanes = [self._mcap, *self._views]
        for lane in lanes:  # the .mcap has handed on all that it was given once it has ended
            lane.end(lambda writer: writer.finish(status, end, verdict=verdict, checks=found))
            lane.join()
        errors = [lane.error for lane in lanes if lane.error is not None]
        if len(errors) > 1 and all(isinstance(error, OutputError) for error in errors):
            raise OutputError("; ".join(map(str, errors)))
        if errors == [self._mcap.error]:
            raise errors[0]
        if errors:
            raise OutputError(f"{errors[0]}; {self.mcap_path.name} is complete")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            if not self._mcap.ended:
                self.finish(COMPLETE)
            return
        with contextlib.suppress(Exception):  # the exception on its way says what matters
            self.finish(INTERRUPTED)


class _Lane:
    """A writer in a thread of its own, with a queue of what it is to do.

    A writer that fails is closed, and all that follows is dropped. One with ``patience`` [s] is given up when it takes
    nothing for so long; its thread is left behind.
    """

    def __init__(self, path: Path, writer: _Writer, room: int, patience: float | None = None):
        self.error: Exception | None = None
        self.ended = False
        """whether the last order was given"""
        self._path = path
        self._writer = writer
        self._patience = patience
        self._queue: queue.Queue[Callable[[_Writer], None] | None] = queue.Queue(room)
        self._busy_since: float | None = None
        self._thread = threading.Thread(target=self._run, name=f"recorder of {path.suffix}", daemon=True)
        self._thread.start()

    @property
    def written_ticks(self) -> int:
        """How many ticks of the run the file holds."""
        return self._writer.written_ticks

    def check(self) -> None:
        """Raise what went wrong."""
        if self.error is not None:
            raise self.error

    def put(self, order: Callable[[_Writer], None] | None) -> None:
        """Have the thread carry out ``order``, or end for None; waits while its queue is full."""
        while not self._given_up():
            with contextlib.suppress(queue.Full):
                self._queue.put(order, timeout=self._patience and 0.2)
                return

    def end(self, order: Callable[[_Writer], None]) -> None:
        """Have the thread carry out ``order`` and end; only the first call counts."""
        if not self.ended:
            self.put(order)
            self.put(None)
            self.ended = True

    def join(self) -> None:
        """Wait until the thread has ended, or is given up."""
        while self._thread.is_alive() and not self._given_up():
            self._thread.join(self._patience and 0.2)

    def _given_up(self) -> bool:
        """Whether the writer has been at one order for longer than anyone waits."""
        since = self._busy_since
        if self._patience is None or since is None or time.monotonic() - since < self._patience:
            return False
        self.error = self.error or OutputError(f"cannot write {self._path}: it took nothing for {self._patience:g} s")
        return True

    def _run(self) -> None:
        while (order := self._queue.get()) is not None:
            self._busy_since = time.monotonic()
            if self.error is None:
                try:
                    with _naming(self._path):
                        order(self._writer)
                except Exception as error:  # whatever it is, it belongs into the caller's thread
                    self.error = error
                    self._writer.close()
            self._busy_since = None


def now() -> str:
    """Wall-clock time, ISO 8601, always of the same length."""
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turn the system's error into one line that names the file."""
    try:
        yield
    except OSError as error:
        raise cannot_write(path, error) from error
