"""The thesis's advice, tried: the same experiments on rigs that differ in their drive train (thesis 4.5 and chapter 5).

``python -m benchmarks.advice`` prints the table of docs/rigs.md; some two minutes. Breakout and ripple are those of
friction_masking, tracking that of gearbox_imperfections. The least I_fcs is searched for every grip of :data:`GRIPS`:
no hand, an arm that holds its place, a hand that pushes with a force alone. The table has the tight grip's and the
worst.
"""

import math
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor

from cls_bench import experiment
from cls_bench.linear.hand import Hand
from cls_bench.linear.least import least_inertia
from cls_bench.linear.variation import Setup, variation
from cls_bench.rigs import load_rig
from cls_bench.scenario import load_scenario
from cls_bench.stability import onset

RIGS = ("thesis", "one_stage", "direct_drive", "belt", "non_backdrivable")

SQUEEZES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
TIGHT = Hand(1.0)
GRIPS = (Hand(None), *(Hand(squeeze, arm) for arm in (True, False) for squeeze in SQUEEZES))

RANGE = (0.02, 4.0)
"""Of I_fcs that is searched [kg·m²]."""

HEAD = (
    "rig", "breakout off / on [N·m]", "torque ripple off / on [N·m]", "velocity ripple off / on [rad/s]",
    "tracking ripple [mdeg]", "least I tight, simulated (linear) [kg·m²]", "least I worst, simulated (linear) [kg·m²]",
    "worst grip, simulated (linear)",
)  # fmt: skip


def measured(rig: str) -> dict[str, float]:
    """What the two scenarios measure on a rig; NaN where it could not be."""
    found: dict[str, float] = {}
    for name in ("friction_masking", "gearbox_imperfections"):
        scenario = load_scenario(name, rig=rig)
        with tempfile.TemporaryDirectory() as folder:
            result = experiment.run(scenario, out=folder, rerun=False)
        found |= {f"{name}.{r.check.name}": r.value for r in result.checks}
    return found


def least(rig: str, hand: Hand) -> float:
    """Least I_fcs [kg·m²] that is stable in the trial; 0 below the range, inf beyond it."""
    setup = Setup(load_rig(rig).parameters, hand)
    found = onset.find(setup, variation("feel.inertia", *RANGE, of=setup.parameters), follow=False)
    if found.value is not None:
        return found.value
    return 0.0 if found.stable_at is not None else math.inf


def rows() -> Iterator[tuple[str, ...]]:
    """The table."""
    with ProcessPoolExecutor(2) as pool:
        runs = {rig: pool.submit(measured, rig) for rig in RIGS}
        onsets = {rig: [pool.submit(least, rig, hand) for hand in GRIPS] for rig in RIGS}
        for rig in RIGS:
            found, values = runs[rig].result(), [future.result() for future in onsets[rig]]
            worst = max(range(len(GRIPS)), key=values.__getitem__)
            p = load_rig(rig).parameters
            (linear_tight, _), (linear_worst, linear_grip) = least_inertia(p, [TIGHT]), least_inertia(p, GRIPS)

            def pair(name: str, found: dict[str, float] = found) -> str:
                return f"{_shown(found[f'{name}_off'])} / {_shown(found[f'{name}_on'])}"

            yield (
                rig, pair("friction_masking.breakout"), pair("friction_masking.torque_ripple"),
                pair("friction_masking.velocity_ripple"),
                _shown(1e3 * found["gearbox_imperfections.tracking_ripple_on"]),
                f"{_shown(values[GRIPS.index(TIGHT)])} ({_shown(linear_tight)})",
                f"{_shown(values[worst])} ({_shown(linear_worst)})", f"{GRIPS[worst]} ({linear_grip})",
            )  # fmt: skip


def _shown(value: float) -> str:
    if math.isnan(value):
        return "–"
    return "none" if math.isinf(value) else f"< {RANGE[0]:g}" if value == 0.0 else f"{value:.3g}"


if __name__ == "__main__":
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|")
    for row in rows():
        print("| " + " | ".join(row) + " |", flush=True)
