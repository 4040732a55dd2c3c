"""The machinery under sweeps, maps and onset searches: points in, a row each out, in parallel and resumable."""

import hashlib
import json
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

from cls_bench.bench import versions
from cls_bench.sweep.engine import Engine, Evaluate, Point, Row, make_engine, sources
from cls_bench.sweep.journal import Journal

Report = Callable[[int, int], None]
"""Told how many points of how many are done."""


def evaluate_points(
    evaluate: Evaluate,
    points: Sequence[Point],
    *,
    journal: Path | None = None,
    identity: str = "",
    resume: bool = False,
    scheduler: str | Engine = "threads",
    report: Report | None = None,
    say: Callable[[str], None] | None = None,
) -> list[Row]:
    """Evaluate every point and return the rows in the order of ``points``.

    ``scheduler`` is an engine or the name of one (:func:`make_engine`); the rows are the same on all. With ``journal``
    each row is kept in that file as soon as it is done; with ``resume`` rows that are there are not evaluated again,
    and ``say`` is told in one line of rows there that were not taken, because they were damaged or not of this sweep.
    ``identity`` names what is evaluated; the points and the sources of the package are part of it anyway. A point
    whose evaluation raises is a row with its error. Ctrl-C passes through, after the points being evaluated.

    Raises InputError and OutputError.
    """
    engine = make_engine(scheduler) if isinstance(scheduler, str) else scheduler
    if journal is None:
        return _run(engine, evaluate, points, {}, lambda row: None, report)
    with Journal(journal, _fingerprint(identity, points), points, resume=resume) as kept:
        if kept.dropped and say is not None:
            say(kept.dropped)
        return _run(engine, evaluate, points, kept.rows, kept.append, report)


def _run(
    engine: Engine,
    evaluate: Evaluate,
    points: Sequence[Point],
    known: dict[int, Row],
    keep: Callable[[Row], None],
    report: Report | None,
) -> list[Row]:
    rows = dict(known)
    report = report or (lambda done, total: None)
    report(len(rows), len(points))
    todo = [(number, point) for number, point in enumerate(points) if number not in rows]
    if todo:
        with closing(engine.run(evaluate, todo)) as done:
            for row in done:
                keep(row)
                rows[row.index] = row
                report(len(rows), len(points))
    return [rows[number] for number in range(len(points))]


def _fingerprint(identity: str, points: Sequence[Point]) -> str:
    text = json.dumps([identity, sources(), versions(), [dict(point) for point in points]])
    return hashlib.sha256(text.encode()).hexdigest()[:16]
