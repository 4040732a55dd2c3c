"""The rows of a sweep on disk while it goes on: a line of JSON each, so that what is done survives whatever comes."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cls_bench.errors import InputError, OutputError
from cls_bench.sweep.engine import Point, Row


class Journal:
    """Appends rows to a file and knows those that are there already.

    ``identity`` says what is evaluated: a journal of something else is not continued. Without ``resume`` the file must
    not exist yet. A last line that was cut off is dropped. Raises InputError and OutputError.
    """

    def __init__(self, path: Path, identity: str, points: Sequence[Point], *, resume: bool = False):
        self.path = path
        self.rows: dict[int, Row] = {}
        """rows by number of their point"""
        header = json.dumps({"identity": identity, "points": len(points)}).encode() + b"\n"
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():
                kept = self._read(path.read_bytes(), header, points, resume)
                os.truncate(path, kept)
            self._file = path.open("ab")
            if not self._file.tell():
                self._file.write(header)
                self._file.flush()
        except OSError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}") from None

    def _read(self, content: bytes, header: bytes, points: Sequence[Point], resume: bool) -> int:
        """Take over the rows in ``content``; returns how many bytes of it are whole lines."""
        whole = content[: content.rfind(b"\n") + 1]
        first, *lines = whole.splitlines(keepends=True) or [header]
        if not resume:
            raise InputError(
                f"{self.path} has {len(lines)} of {len(points)} points; continue with --resume, or choose another --out"
            )
        if first != header:
            raise InputError(f"{self.path} belongs to another sweep or other sources; choose another --out")
        for line in lines:
            number, values, error = json.loads(line)
            self.rows[number] = Row(number, points[number], values, error)
        return len(whole)

    def append(self, row: Row) -> None:
        """Keep a row. Raises OutputError."""
        entry: list[Any] = [row.index, row.values, row.error]
        try:
            self._file.write(json.dumps(entry, ensure_ascii=False).encode() + b"\n")
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
