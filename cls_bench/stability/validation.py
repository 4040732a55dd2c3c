"""The linear model against the simulation: critical I_fwd over many configurations, friction and backlash off.

``python -m cls_bench.stability.validation`` prints the table of docs/stability.md, of all rigs or of those named.
"""

import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from cls_bench.linear.hand import Hand
from cls_bench.linear.variation import Setup, changed, ideal, variation
from cls_bench.parameters import Parameters, Rates
from cls_bench.rigs import load_rig
from cls_bench.stability import onset
from cls_bench.stability.trial import STILL
from cls_bench.sweep.core import evaluate_points
from cls_bench.sweep.engine import Engine, Point, Row, Value

RIGS = ("thesis", "one_stage", "direct_drive", "belt", "non_backdrivable", "elevator", "rudder")
"""Rigs that come with the bench, but the aileron: its torque cell saturates before its oscillation is fitted."""

SLOWEST: Mapping[str, float] = {"elevator": 4.0, "rudder": 4.0, "aileron": 4.0}
"""Slowest oscillation that is looked at [Hz], where a rig is slower than a trial sees otherwise."""

RATES: Mapping[str, Mapping[str, float]] = {
    "thesis": {},
    "plc 1 kHz, drive 16 kHz": {
        "current_cycle": 62.5e-6, "velocity_cycle": 250e-6, "position_cycle": 500e-6, "bus_cycle": 500e-6,
        "plc_cycle": 1e-3,
    },
}  # fmt: skip
"""Rates, by what distinguishes them from the rig's own."""

INERTIAS = (0.5, 1.0, 2.0, 10.0 / 3.0)
"""I_fcs over what the rig is delivered with: 0.15, 0.3, 0.6, 1.0 kg·m² on the thesis's."""

DELAYS = (0, 1, 3)
"""Field-bus cycles from PLC to drive."""

GAINS: Mapping[str, Mapping[str, float]] = {
    "shipped": {},
    "softer": {"velocity_bandwidth": 0.7, "position_bandwidth": 25.0 / 35.0},
}
"""Gain sets, as factors on those of the rig."""

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
    p = load_rig(rig).parameters
    return ideal(p.model_copy(update={"rates": Rates(**{**p.rates.model_dump(), **RATES[rates]})}))


@dataclass(frozen=True)
class Configuration:
    """Searches the critical I_fwd of a point, simulated and predicted."""

    tolerance: float = TOLERANCE

    def setup(self, point: Point) -> Setup:
        """The bench of a point."""
        p = bench(str(point["rig"]), str(point["rates"]))
        for name, factor in GAINS[str(point["gains"])].items():
            p = changed(p, f"drive.{name}", float(f"{factor * getattr(p.drive, name):.4g}"))
        p = changed(p, "feel.inertia", float(point["inertia"] or 0.0) * p.feel.inertia)
        p = changed(p, "plc.command_latency", int(point["delay"] or 0))
        return Setup(p, Hand(GRIPS[str(point["grip"])]))

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """Critical I_fwd [kg·m²]: ``simulated``, ``predicted``, by Eq. 3.16 (``rule``); ``frequency`` [Hz]."""
        setup = self.setup(point)
        vary = variation("forward_inertia", of=setup.parameters)
        standard = replace(STILL, slowest=SLOWEST.get(str(point["rig"]), STILL.slowest))
        found = onset.find(setup, vary, standard, tolerance=self.tolerance, follow=False)
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
    """Predicted over simulated critical I_fwd, less 1; 0 if neither has an onset in its range, NaN if one has."""
    simulated, predicted = row.values.get("simulated"), row.values.get("predicted")
    if row.error or (simulated is None) != (predicted is None):
        return float("nan")
    if simulated is None or predicted is None:
        return 0.0
    return float(predicted) / float(simulated) - 1.0


def markdown(rows: Sequence[Row]) -> str:
    """The table."""
    lines = [
        "| rig | rates | gains | grip | delay | I_fcs | simulated | linear model | difference | Eq. 3.16 | onset at |",
        "|---|---|---|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        p, v = row.point, row.values
        start = "| " + " | ".join(str(p[name]) for name in ("rig", "rates", "gains", "grip", "delay"))
        start += f" | {float(p['inertia'] or 0.0) * load_rig(str(p['rig'])).parameters.feel.inertia:.3g}"
        if row.error:
            lines.append(f"{start} | {row.error} |||||")
            continue
        found = [v["simulated"], v["predicted"]]
        if None in found:
            shown = ["none" if value is None else f"{value:.4f}" for value in found]
            lines.append(f"{start} | {' | '.join(shown)} ||||")
            continue
        by_rule = "—" if v["rule"] is None else f"{v['rule']:.3f}"
        lines.append(
            f"{start} | {v['simulated']:.4f} | {v['predicted']:.4f} | {difference(row):+.1%} | {by_rule} | "
            f"{v['frequency']:.0f} Hz |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    asked = sys.argv[1:] or RIGS
    for rig in asked:
        print(markdown(compare(points(rig))), flush=True)
