"""A file that only ever grows by whole pieces."""

import errno
import os
import stat
from contextlib import suppress
from pathlib import Path


class GrowingFile:
    """Bytes are collected until :meth:`flush` hands them to the system, all together.

    When the system does not take all of a piece, none of it stays. A device is written to like a file. All methods but
    :meth:`close` raise :class:`OSError`.

    A process may be killed in the midst of a write. The first ``head`` bytes of a piece are written last, all at once:
    until then they are zeros, which suits a format that takes them for its end.
    """

    def __init__(self, path: Path, *, head: int = 0):
        self._path = path
        self._pending = bytearray()
        self._length = 0
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)
        self._head = head if stat.S_ISREG(os.fstat(self._descriptor).st_mode) else 0

    def write(self, data: bytes | bytearray) -> None:
        """Collect ``data``."""
        self._pending += data

    def flush(self) -> None:
        """Have the file hold all that was collected, whatever becomes of this process."""
        piece, self._pending = memoryview(self._pending), bytearray()
        try:
            if self._head:
                os.lseek(self._descriptor, self._length + self._head, os.SEEK_SET)
            self._put(piece[self._head :])
            if self._head:
                os.lseek(self._descriptor, self._length, os.SEEK_SET)
                self._put(piece[: self._head])
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._length)
            raise
        self._length += len(piece)

    def _put(self, piece: memoryview) -> None:
        done = 0
        while done < len(piece):
            done += os.write(self._descriptor, piece[done:])

    def check_place(self) -> None:
        """Raise :class:`FileNotFoundError` unless the file is still where it was made."""
        opened = os.fstat(self._descriptor)
        try:
            found = self._path.stat()
        except FileNotFoundError:
            found = None
        if found is None or not os.path.samestat(found, opened):
            raise FileNotFoundError(errno.ENOENT, "it was removed while the run went on", str(self._path))

    def close(self) -> None:
        """Close the file as it is; what was not flushed is lost."""
        if self._descriptor >= 0:
            with suppress(OSError):
                os.close(self._descriptor)
            self._descriptor = -1
