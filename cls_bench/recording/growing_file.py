"""A file that only ever grows by whole pieces."""

import errno
import os
from contextlib import suppress
from pathlib import Path


class GrowingFile:
    """Bytes are collected until :meth:`flush` hands them to the system, all together.

    When the system does not take all of a piece, none of it stays. A device is written to like a file. All methods but
    :meth:`close` raise :class:`OSError`.
    """

    def __init__(self, path: Path):
        self._path = path
        self._pending = bytearray()
        self._length = 0
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)

    def write(self, data: bytes | bytearray) -> None:
        """Collect ``data``."""
        self._pending += data

    def flush(self) -> None:
        """Have the file hold all that was collected, whatever becomes of this process."""
        piece, self._pending = memoryview(self._pending), bytearray()
        done = 0
        try:
            while done < len(piece):
                done += os.write(self._descriptor, piece[done:])
        except OSError:
            with suppress(OSError):
                os.ftruncate(self._descriptor, self._length)
            raise
        self._length += done

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
