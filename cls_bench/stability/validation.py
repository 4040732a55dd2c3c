"""The linear model against the simulation: critical I_fwd over many configurations, friction and backlash off.

``python -m cls_bench.stability.validation`` prints the table of docs/stability.md.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from cls_bench.linear.hand import Hand
from cls_bench.linear.variation import Setup, changed, ideal, variation
from cls_bench.parameters import Parameters
from cls_bench.stability import onset
from cls_bench.stability.trial import STILL
from cls_bench.sweep.core import evaluate_points
from cls_bench.sweep.engine import Engine, Point, Row, Value

INERTIAS = (0.15, 0.3, 0.6, 1.0)
"""I_fcs [kg·m²]."""

DELAYS = (0, 1, 3)
"""Field-bus cycles from PLC to drive."""

GAINS: Mapping[str, Mapping[str, float]] = {
    "shipped": {},
    "softer": {"drive.velocity_bandwidth": 70.0, "drive.position_bandwidth": 25.0},
}
"""Gain sets."""

GRIPS: Mapping[str, float] = {"rigid": 1.0, "elastic": 0.8}
"""Grips by squeeze: 2 000 N/mm, and 420 N/mm, with which the limb swings against the column near the loop's onset."""

TOLERANCE = 0.005
"""Width of the onset's bracket: the search must not blur the comparison."""


def points() -> list[Point]:
    """All configurations."""
    return [
        {"inertia": inertia, "delay": delay, "gains": gains, "grip": grip}
        for gains, grip, delay, inertia in itertools.product(GAINS, GRIPS, DELAYS, INERTIAS)
    ]


@dataclass(frozen=True)
class Configuration:
    """Searches the critical I_fwd of a point, simulated and predicted."""

    tolerance: float = TOLERANCE

    def setup(self, point: Point) -> Setup:
        """The bench of a point."""
        p = ideal(Parameters())
        for key, value in GAINS[str(point["gains"])].items():
            p = changed(p, key, value)
        p = changed(p, "feel.inertia", float(point["inertia"] or 0.0))
        p = changed(p, "plc.command_latency", int(point["delay"] or 0))
        return Setup(p, Hand(GRIPS[str(point["grip"])]))

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """Critical I_fwd [kg·m²]: ``simulated``, ``predicted``, by Eq. 3.16 (``rule``); ``frequency`` [Hz]."""
        found = onset.find(
            self.setup(point), variation("forward_inertia"), STILL, tolerance=self.tolerance, follow=False
        )
        last = found.last_unstable
        return {
            "simulated": found.value, "predicted": found.predicted, "rule": found.rule,
            "frequency": None if last is None else last.frequency,
        }  # fmt: skip


def compare(chosen: Sequence[Point] | None = None, *, scheduler: str | Engine = "threads") -> list[Row]:
    """A row for each configuration."""
    with threadpool_limits(1):
        return evaluate_points(Configuration(), points() if chosen is None else chosen, scheduler=scheduler)


def difference(row: Row) -> float:
    """Predicted over simulated critical I_fwd, less 1; NaN if one of them is missing."""
    simulated, predicted = row.values["simulated"], row.values["predicted"]
    if simulated is None or predicted is None:
        return float("nan")
    return float(predicted) / float(simulated) - 1.0


def markdown(rows: Sequence[Row]) -> str:
    """The table."""
    lines = [
        "| gains | grip | delay | I_fcs | simulated | linear model | difference | Eq. 3.16 | onset at |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        p, v = row.point, row.values
        if row.error or v["simulated"] is None or v["predicted"] is None:
            lines.append(f"| {p['gains']} | {p['grip']} | {p['delay']} | {p['inertia']} | {row.error or '—'} ||||||")
            continue
        lines.append(
            f"| {p['gains']} | {p['grip']} | {p['delay']} | {p['inertia']} | {v['simulated']:.4f} | "
            f"{v['predicted']:.4f} | {difference(row):+.1%} | {v['rule']:.3f} | {v['frequency']:.0f} Hz |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown(compare()))
