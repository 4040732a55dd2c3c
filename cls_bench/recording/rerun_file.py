"""An .rrd file that is written by us and not by Rerun."""

import errno
import os
import select
import threading
from contextlib import suppress
from pathlib import Path

import rerun as rr
from rerun.blueprint import Blueprint

from cls_bench.recording.growing_file import GrowingFile

CLOSING_S = 15.0
"""How long Rerun may take to hand over the end of a file [s]."""

_PIECE = 1 << 16

_FRAME_HEAD = 16
"""Kind and length that a frame of an .rrd begins with; zeros there are the end of the stream."""


class RerunFile:
    """A stream of Rerun's whose bytes go into a file by whole batches.

    Rerun's own writer hangs for good, or ends in a panic, where a disk is full. So it is given a pipe, from which a
    thread takes whatever comes; what the file says to it is an :class:`OSError` of ours. All methods but
    :meth:`close` raise it.
    """

    def __init__(self, path: Path, application: str, blueprint: Blueprint):
        self.stream = rr.RecordingStream(application)
        self._file = GrowingFile(path, head=_FRAME_HEAD)
        self._pending = bytearray()
        self._lock = threading.Lock()
        self._read, write = os.pipe()
        os.set_blocking(self._read, False)
        self._thread = threading.Thread(target=self._drain, name="rerun pipe", daemon=True)
        self._thread.start()
        try:
            self.stream.save(f"/dev/fd/{write}", default_blueprint=blueprint)
        except RuntimeError as error:
            self.close()
            raise OSError(errno.EIO, " ".join(str(error).split())) from None
        finally:
            os.close(write)  # Rerun has opened the pipe anew

    def flush(self) -> None:
        """Have the file hold all that was sent, whatever becomes of this process."""
        self.stream.flush()
        self._write()

    def finish(self) -> None:
        """Write the end of the file, and close it."""
        try:
            self.stream.flush()
            self._end_stream()
            self._write()
            self._file.check_place()
        finally:
            self.close()

    def close(self) -> None:
        """Close the file as it is; what was flushed stays readable."""
        with suppress(OSError):
            self._end_stream()
        self._file.close()

    def _end_stream(self) -> None:
        """Have Rerun close its end of the pipe, and collect the last of it."""
        self.stream.disconnect()
        self._thread.join(CLOSING_S)
        if self._thread.is_alive():
            raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))

    def _write(self) -> None:
        with self._lock:
            self._take()
            piece, self._pending = self._pending, bytearray()
        self._file.write(piece)
        self._file.flush()

    def _drain(self) -> None:
        """The thread: empties the pipe until Rerun closes it."""
        poll = select.poll()
        poll.register(self._read, select.POLLIN)
        while self._read >= 0:
            poll.poll()
            with self._lock:
                self._take()

    def _take(self) -> None:
        """Collect what is in the pipe."""
        while self._read >= 0:
            try:
                data = os.read(self._read, _PIECE)
            except BlockingIOError:
                return
            if not data:  # its end
                os.close(self._read)
                self._read = -1
            self._pending += data
