"""The rows of a sweep on disk while it goes on: a line of JSON each, so that what is done survives whatever comes.

Each line ends with a checksum over itself and the sweep's identity. A line that is damaged, edited, doubled or another
sweep's is dropped and its point evaluated again; it is never taken for a result.
"""

import contextlib
import fcntl
import hashlib
import json
import os
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Self

from cls_bench.errors import InputError, OutputError
from cls_bench.sweep.engine import Point, Row

LONGEST_LINE = 1_000_000
"""Bytes of a line; a row has a few hundred."""


class Journal:
    """Appends rows to a file and knows those that are there already.

    ``identity`` says what is evaluated: a journal of something else is not continued. Without ``resume`` the file must
    not exist yet. One process at a time has a journal. Raises InputError and OutputError.
    """

    def __init__(self, path: Path, identity: str, points: Sequence[Point], *, resume: bool = False):
        self.path = path
        self.rows: dict[int, Row] = {}
        """rows by number of their point"""
        self.dropped = ""
        """what was not taken over, in one line; empty if nothing was"""
        self._identity, self._points = identity, points
        header = json.dumps({"identity": identity, "points": len(points)}).encode() + b"\n"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = path.open("a+b")
            try:
                self._claim(header, resume)
            except BaseException:
                self._file.close()
                raise
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}") from None

    def _claim(self, header: bytes, resume: bool) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f"{self.path} is being written by another sweep; choose another --out") from None
        self._file.seek(0)
        first = self._file.readline(LONGEST_LINE)
        if not first:
            self._file.write(header)
            self._file.flush()
            return
        if not resume:
            count = sum(line.endswith(b"\n") for line in self._lines())
            raise InputError(
                f"{self.path} has {count} of {len(self._points)} points; "
                "continue with --resume, or choose another --out"
            )
        if first != header:
            if not first.startswith(b'{"identity"'):
                raise InputError(f"{self.path}: its first line is none of a sweep's; choose another --out")
            raise InputError(f"{self.path} belongs to another sweep or other sources; choose another --out")
        self._read()
        if self.dropped:
            self._rewrite(header)
        self._file.seek(0, os.SEEK_END)

    def _lines(self) -> Iterable[bytes]:
        while line := self._file.readline(LONGEST_LINE):
            yield line

    def _read(self) -> None:
        """Take over the rows that are sound."""
        dropped: Counter[str] = Counter()
        doubled: set[int] = set()
        for line in self._lines():
            if not line.endswith(b"\n"):
                dropped["cut off"] += 1
                continue
            row = self._row(line)
            if row is None:
                dropped["damaged or of another sweep"] += 1
            elif row.index in self.rows or row.index in doubled:
                same = repr(self.rows.get(row.index)) == repr(row)  # NaN too
                dropped["doubled" if same else "contradicting another"] += 1
                if not same:
                    self.rows.pop(row.index, None)
                    doubled.add(row.index)
            else:
                self.rows[row.index] = row
        if dropped:
            count = sum(dropped.values())
            kinds = ", ".join(f"{number} {kind}" for kind, number in dropped.items())
            self.dropped = (
                f"{self.path}: {count} {'line' if count == 1 else 'lines'} not taken ({kinds}); "
                f"{len(self.rows)} of {len(self._points)} points are known, the others are evaluated"
            )

    def _row(self, line: bytes) -> Row | None:
        """The row in ``line``; None unless it is one of this sweep, whole and unchanged."""
        try:
            number, values, error, checksum = json.loads(line)
        except (ValueError, TypeError, RecursionError):
            return None
        if type(number) is not int or not 0 <= number < len(self._points) or type(error) is not str:
            return None
        if type(values) is not dict or not all(type(v) in (int, float, bool, str, type(None)) for v in values.values()):
            return None
        row = Row(number, self._points[number], values, error)
        return row if checksum == self._checksum(row) and line == self._line(row) else None

    def _checksum(self, row: Row) -> str:
        text = json.dumps([self._identity, row.index, dict(row.point), row.values, row.error], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def _line(self, row: Row) -> bytes:
        entry: list[Any] = [row.index, row.values, row.error, self._checksum(row)]
        return json.dumps(entry).encode() + b"\n"

    def _rewrite(self, header: bytes) -> None:
        """Leave what was taken over in the file and nothing else; whole at any moment."""
        new = self.path.with_name(f"{self.path.name}.new")
        with contextlib.suppress(FileNotFoundError):
            new.unlink()
        file = new.open("x+b")
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.writelines([header, *(self._line(row) for row in self.rows.values())])
        file.flush()
        new.replace(self.path)
        self._file.close()
        self._file = file

    def append(self, row: Row) -> None:
        """Keep a row. Raises OutputError."""
        try:
            self._file.write(self._line(row))
            self._file.flush()
        except OSError as error:
            raise OutputError(f"cannot write {self.path}: {error.strerror}") from None
        self.rows[row.index] = row

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
