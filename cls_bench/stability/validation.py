"""The linear model against the simulation: critical I_fwd over many configurations, friction and backlash off.

``python -m cls_bench.stability.validation`` prints the table of docs/stability.md, of all rigs or of those named.
"""

import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from cls_bench.linear.hand import Hand, forward_inertia
from cls_bench.linear.variation import Setup, changed, ideal, variation
from cls_bench.parameters import Parameters
from cls_bench.stability import onset
from cls_bench.stability.trial import STILL
from cls_bench.sweep.core import evaluate_points
from cls_bench.sweep.engine import Engine, Point, Row, Value

RIGS: Mapping[str, Mapping[str, Any]] = {
    "thesis": {},
    "one_stage": {
        "gearbox": {"stages": 1, "stage1": {"ratio": 10.0, "stiffness": 8.0e3}},
        "motor": {"rotor_inertia": 2.5e-4},
    },
    "direct_drive": {"gearbox": {"stages": 0}, "motor": {"rotor_inertia": 4.0e-3, "torque_constant": 3.0}},
    "belt": {
        "gearbox": {"stages": 1, "stage1": {"kind": "belt", "ratio": 8.0, "teeth": 0, "stiffness": 1.5e4}},
        "motor": {"rotor_inertia": 3.0e-4},
    },
    "three_stages": {"gearbox": {"stages": 3, "stage3": {"ratio": 2.0, "inertia": 6.0e-4, "stiffness": 6.0e4}}},
    "shaft": {"linkage": {"kind": "none"}},
}
"""Rigs by what distinguishes them from the thesis's; each has the nameplate of its data sheets."""

RATES: Mapping[str, Mapping[str, float]] = {
    "thesis": {},
    "plc 1 kHz, drive 16 kHz": {
        "current_cycle": 62.5e-6, "velocity_cycle": 250e-6, "position_cycle": 500e-6, "bus_cycle": 500e-6,
        "plc_cycle": 1e-3,
    },
}  # fmt: skip
"""Rates by what distinguishes them from the thesis's."""

INERTIAS = (0.15, 0.3, 0.6, 1.0)
"""I_fcs [kg·m²] on the thesis's rig; on others in proportion to the bare column."""

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


def points(rig: str = "thesis", rates: str = "thesis") -> list[Point]:
    """All configurations of a rig."""
    return [
        {"rig": rig, "rates": rates, "inertia": inertia, "delay": delay, "gains": gains, "grip": grip}
        for gains, grip, delay, inertia in itertools.product(GAINS, GRIPS, DELAYS, INERTIAS)
    ]


def bench(rig: str, rates: str = "thesis") -> Parameters:
    """A rig as it is delivered, without what is not linear."""
    table: dict[str, Any] = Parameters().model_dump()
    _place(table, {**RIGS[rig], "rates": RATES[rates]})
    p = Parameters.model_validate(table)
    return ideal(p.with_nameplate() if RIGS[rig] else p)


def _place(table: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if isinstance(value, Mapping):
            _place(table[key], value)
        else:
            table[key] = value


@dataclass(frozen=True)
class Configuration:
    """Searches the critical I_fwd of a point, simulated and predicted."""

    tolerance: float = TOLERANCE

    def setup(self, point: Point) -> Setup:
        """The bench of a point."""
        p = bench(str(point["rig"]), str(point["rates"]))
        share = forward_inertia(p, Hand(None)) / forward_inertia(Parameters(), Hand(None))
        for key, value in GAINS[str(point["gains"])].items():
            p = changed(p, key, value)
        p = changed(p, "feel.inertia", share * float(point["inertia"] or 0.0))
        p = changed(p, "plc.command_latency", int(point["delay"] or 0))
        return Setup(p, Hand(GRIPS[str(point["grip"])]))

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """Critical I_fwd [kg·m²]: ``simulated``, ``predicted``, by Eq. 3.16 (``rule``); ``frequency`` [Hz]."""
        setup = self.setup(point)
        vary = variation("forward_inertia", of=setup.parameters)
        found = onset.find(setup, vary, STILL, tolerance=self.tolerance, follow=False)
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
        "| rig | rates | gains | grip | delay | I_fcs | simulated | linear model | difference | Eq. 3.16 | onset at |",
        "|---|---|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        p, v = row.point, row.values
        start = "| " + " | ".join(str(p[name]) for name in ("rig", "rates", "gains", "grip", "delay", "inertia"))
        if row.error or v["simulated"] is None or v["predicted"] is None:
            lines.append(f"{start} | {row.error or 'no onset'} |||||")
            continue
        by_rule = "—" if v["rule"] is None else f"{v['rule']:.3f}"
        lines.append(
            f"{start} | {v['simulated']:.4f} | {v['predicted']:.4f} | {difference(row):+.1%} | {by_rule} | "
            f"{v['frequency']:.0f} Hz |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    asked = sys.argv[1:] or list(RIGS)
    print(markdown(compare([point for rig in asked for point in points(rig)])))
