"""Records a run in MCAP and Rerun side by side, in the background."""

import contextlib
import datetime as dt
import queue
import threading
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from cls_bench.errors import OutputError
from cls_bench.recording.mcap_writer import McapRecorder
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import Block

QUEUE_BLOCKS = 2
"""Blocks that may wait to be encoded; then :meth:`Recorder.write` waits too, so that memory does not grow."""

INTERRUPTED = "interrupted"
COMPLETE = "complete"


class _Writer(Protocol):
    def write(self, block: Block) -> None: ...

    def finish(self, status: str) -> None: ...

    def close(self) -> None: ...


class Recorder:
    """Writes ``stem.mcap`` and, if asked, ``stem.rrd`` in one background thread.

    The compiled simulation releases the interpreter, so encoding costs it nothing while a second core is free. When a
    file cannot be written, the next :meth:`write` or :meth:`finish` raises :class:`OutputError`; what was written
    until then stays readable.

    As a context manager it finishes the files on leaving, if :meth:`finish` was not called: as ``"complete"``, or as
    ``"interrupted"`` when an exception (Ctrl-C) passes through.
    """

    def __init__(self, stem: Path, info: RunInfo, *, rerun: bool = True):
        self.mcap_path = stem.with_name(f"{stem.name}.mcap")
        self.rrd_path = stem.with_name(f"{stem.name}.rrd") if rerun else None
        self._writers: list[tuple[Path, _Writer]] = []
        self._queue: queue.Queue[Block | str] = queue.Queue(QUEUE_BLOCKS)
        self._error: Exception | None = None
        self._finishing = False
        try:
            with _naming(stem.parent):
                stem.parent.mkdir(parents=True, exist_ok=True)
            with _naming(self.mcap_path):
                self._writers.append((self.mcap_path, McapRecorder(self.mcap_path, info)))
            if self.rrd_path is not None:
                from cls_bench.recording.rerun_writer import RerunRecorder

                with _naming(self.rrd_path):
                    self._writers.append((self.rrd_path, RerunRecorder(self.rrd_path, info)))
        except BaseException:
            for _, writer in self._writers:
                writer.close()
            raise
        self._thread = threading.Thread(target=self._encode, name="recorder", daemon=True)
        self._thread.start()

    def write(self, block: Block) -> None:
        """Hand over ``block``; waits while two others are waiting. Raises :class:`OutputError`."""
        self._raise()
        self._queue.put(block)

    def finish(self, status: str) -> None:
        """Write what waits, ``status`` and the ends of the files, and wait for it. Raises :class:`OutputError`.

        Does nothing the second time, unless the first was interrupted while waiting.
        """
        if not self._finishing:
            self._queue.put(status)
            self._finishing = True
        self._thread.join()
        self._raise()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            if not self._finishing:
                self.finish(COMPLETE)
            return
        with contextlib.suppress(OutputError):  # the exception on its way says what matters
            self.finish(INTERRUPTED)

    def _raise(self) -> None:
        """Raise the thread's error in the caller's thread, once."""
        error, self._error = self._error, None
        if error is not None:
            raise error

    def _encode(self) -> None:
        """The thread: writes blocks until a status comes."""
        while not isinstance(item := self._queue.get(), str):
            self._pass_on(item)
        self._pass_on(item)

    def _pass_on(self, item: Block | str) -> None:
        """Give each writer a block or the status; one that fails is closed and left out, the other carries on."""
        for path, writer in tuple(self._writers):
            try:
                with _naming(path):
                    if isinstance(item, str) and isinstance(writer, McapRecorder):
                        writer.finish(item, wall_end=now())
                    elif isinstance(item, str):
                        writer.finish(item)
                    else:
                        writer.write(item)
            except Exception as error:  # whatever it is, it belongs into the caller's thread
                self._error = self._error or error
                self._writers.remove((path, writer))
                writer.close()


def now() -> str:
    """Wall-clock time, ISO 8601, always of the same length."""
    return dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds")


@contextlib.contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Turn the system's error into one line that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from error
