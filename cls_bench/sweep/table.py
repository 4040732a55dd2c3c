"""The results of a sweep as a table: Parquet on disk, a summary for people."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from cls_bench.analysis import metrics
from cls_bench.bench import versions
from cls_bench.claims import replaced
from cls_bench.errors import OutputError
from cls_bench.experiment import EXIT_CODES
from cls_bench.sweep.engine import Row, sources
from cls_bench.sweep.plan import Plan

ERROR = "error"
"""Status of a point that could not be evaluated; the others are those of a run."""


def to_table(plan: Plan, rows: Sequence[Row]) -> pa.Table:
    """The rows as an Arrow table: ``point``, the axes, ``status``, a column for each metric, ``message``.

    Units and the meaning of the columns are in the fields' metadata, the sweep file, the scenario and the versions in
    the table's. The same sweep gives the same bytes on any number of workers.
    """
    columns = {"point": pa.array([row.index for row in rows], pa.int64())}
    fields = [_field("point", pa.int64(), "1", "number of the point, from 0")]
    for axis in plan.sweep.axes:
        cells = [row.point[axis.key] for row in rows]
        columns[axis.key] = _column(cells)
        fields.append(_field(axis.key, columns[axis.key].type, "", "axis"))
    columns["status"] = pa.array([row.values.get("status", ERROR) for row in rows], pa.string())
    meaning = f"{', '.join(EXIT_CODES)}, or {ERROR}"
    fields.append(_field("status", pa.string(), "", meaning))
    for check in plan.checks:
        columns[check.name] = pa.array([row.values.get(check.name) for row in rows], pa.float64())
        fields.append(_field(check.name, pa.float64(), metrics.unit(check), check.metric))
    columns["message"] = pa.array([row.error or row.values.get("message", "") for row in rows], pa.string())
    fields.append(_field("message", pa.string(), "", "what went wrong"))
    about = {
        "title": plan.sweep.title, "sweep": plan.source, "scenario": plan.scenario.source, "sources": sources(),
        "versions": json.dumps(versions()),
    }  # fmt: skip
    return pa.Table.from_pydict(columns, pa.schema(fields, about))


def _field(name: str, kind: pa.DataType, unit: str, meaning: str) -> pa.Field:
    return pa.field(name, kind, metadata={"unit": unit, "meaning": meaning})


def _column(cells: Sequence[Any]) -> pa.Array:
    """A column of the narrowest type that holds all cells; texts if they have nothing in common."""
    if all(type(cell) is type(cells[0]) for cell in cells):
        return pa.array(cells)
    if all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in cells):
        return pa.array([float(cell) for cell in cells], pa.float64())
    return pa.array([cell if isinstance(cell, str) else json.dumps(cell) for cell in cells], pa.string())


def write_table(table: pa.Table, path: Path) -> None:
    """Write Parquet. Raises OutputError."""
    try:
        with replaced(path) as file:
            pq.write_table(table, file, compression="zstd")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None


class Summary(NamedTuple):
    """A metric over all points at which it has a finite value."""

    name: str
    unit: str
    least: float | None
    median: float | None
    greatest: float | None
    least_at: int | None
    """number of the point"""
    greatest_at: int | None
    """number of the point"""
    missing: int
    """points without a value"""

    def to_json(self) -> dict[str, Any]:
        """What ``cls-bench sweep --json`` prints of the metric."""
        return {key: value for key, value in self._asdict().items() if key != "name"}


def summarise(plan: Plan, rows: Sequence[Row]) -> list[Summary]:
    """A summary of each metric."""
    found = []
    for check in plan.checks:
        column = np.array([_number(row.values.get(check.name)) for row in rows])
        known = np.flatnonzero(np.isfinite(column))
        unit, missing = metrics.unit(check), len(rows) - len(known)
        if not len(known):
            found.append(Summary(check.name, unit, None, None, None, None, None, missing))
            continue
        least, greatest = known[np.argmin(column[known])], known[np.argmax(column[known])]
        found.append(
            Summary(
                check.name, unit, float(column[least]), float(np.median(column[known])), float(column[greatest]),
                rows[int(least)].index, rows[int(greatest)].index, missing,
            )
        )  # fmt: skip
    return found


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def statuses(rows: Sequence[Row]) -> dict[str, int]:
    """How many points have each status, most first."""
    return dict(Counter(str(row.values.get("status", ERROR)) for row in rows).most_common())
