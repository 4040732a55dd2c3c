"""The verification page: the table as Markdown."""

import itertools
from collections.abc import Iterable, Sequence

from cls_bench.verification.row import Row

INTRODUCTION = """\
# Verification

*Written by `cls-bench verify --page docs/verification.md`; do not edit.*

Every claim of the plant beside a result that was not made by it: a closed form, an independent integration, or a
reference of others. The elements are cut out of the very plant that the bench steps: other joints are held, and what
acts on them from other elements is left out. "Deviation" is obtained less expected, in the unit of the row or as a
percentage of the expected value, and has to stay within the limit. `tests/oracles/` runs the same cases, and shows of
many deliberately wrong plants that each makes the right rows fall short.
"""

NOTES = {
    "gear with losses": """\
Modelica Standard Library, Mechanics.Rotational.Examples.LossyGearDemo1 (reference results of the Modelica
Association): inertias of 1 and 1.5 kg·m², ratio 2, mesh efficiency 0.5 both ways. The gear stage of the bench carries
it: its friction over the torque it carries on is 1/η − 1 = 1 when driving and 1 − η = 0.5 when driven back. The
reference is rigid, so mesh and bristles are set as stiff as the finest step carries. With a drag that is 2.5 times as
much when the load drives, the reference is a rigid gear solved from event to event
(`cls_bench/verification/lossy_gear.py`), which without drag gives Modelica's result. Where the torque changes its way,
the bench passes from one drag to the other over as much torque as they differ by; that is part of the rigs below.""",
    "drive and back-drive": """\
The whole gearbox at a steady speed against a viscous brake: power out over power in. Ripple and transmission error are
off, as the efficiency is a mean over the teeth. Then the same with one stage (whose drag is twice as much when the
load drives), three stages, a belt with a planetary stage, and a worm.""",
    "self-locking": """\
A worm with a back-driving efficiency of −0.2 holds any load without creep, and the motor has to push to lower it; with
one of 0.3 it yields.""",
    "backlash": """\
Same library, Backlash: 5 kg·m² released from π/2 against 20 kN·m/rad and 50 N·m·s/rad with a gap of π/4. The law is
homogeneous in the angles, so the gear stage carries it at a twentieth of the angles, within its bounds.""",
    "stiction": """\
LuGre friction. The stick-slip reference knows true sticking only: rest until the spring has the
static friction, then sliding with the Stribeck curve, by `solve_ivp` with an event at standstill.""",
    "motor": """\
The power-invariant DC equivalent of the synchronous machine. At the stall current the data sheet's own figures differ
by 1.6 %: 6.00 N·m at 20.38 A against 1.00 N·m at 3.45 A. The current acts when it flows: the speed of a rotor that is
run up lags the exact one by half a step, which is semi-implicit Euler's own; a torque taken from the step's end or from
the one before would make it −0.5 or 1.5.""",
    "load cell": """\
The column on the cell's spring with the crank held, and the amplifier and converter behind it. For the rod end alone
the column is as good as without inertia. Without a linkage the cell is a shaft.""",
    "limb": "Column and limb alone, coupled by the grip. Rod, column bearing and gravity are left out.",
    "four-bar": """\
Rotor, linkage and column without friction and damping, the crank on a spring: pushed for 0.3 s, then free, for 2 s in
all. Position by Lagrange's equations (`cls_bench/verification/reduced_model.py`), and the energy of all masses and
springs, computed from the recorded angles. Limits: 0.05 % of the swing; 0.05 % of the greatest energy of motion.""",
    "linearisation": """\
A multisine of 1 Hz lines on the motor torque, friction and backlash off, the meshes loaded on one flank. The linear
model (`cls_bench/linear/`) is written down from the book and takes nothing from the simulation. Below the
table's frequencies lie the two worst deviations over all 300 lines. Then the same of rigs with another gearbox or
linkage (`cls_bench/verification/rigs.py`), from 3 Hz on and under a light load: the linear model leaves out the
stiffness that a loaded rod gives to a linkage which does not stand upright.""",
    "whole plant": """\
A second model in minimal coordinates, written down by hand (`cls_bench/verification/reduced_model.py`), integrated by
SciPy with tight tolerance, follows the same torques on motor and column. Limit: 0.1 % of the travel to one side.
Nothing but the two torques guides the column, and friction that ripples with the teeth makes its path unstable: a
deviation grows up to eightyfold from the first second to the second. So the comparison over 2 s, which is to tell laws
apart and not steps, is made at 1.6 µs; see "convergence" for the steps.""",
    "convergence": """\
The same records over 1 s, for steps from 50 µs down, then the bench as it is used: with the controller guiding the
column. There, 50 µs is enough. The order is taken from three runs at 3.1, 1.6 and 0.8 µs: from coarser steps on the
error falls more slowly, and at 50 µs it is less than half of what first order would make of that at 1 µs.""",
    "whole plant of any rig": """\
The reduced model once more, for every kind of stage and linkage (`cls_bench/verification/rigs.py`) and for the rigs
that come with the bench. A soft spring and damper swing the motor over half the travel, against a hand that pulls to
and fro and takes the play out both ways; they make the path stable, so the bench's own step will do, and their torque
shows all that acts. A self-locking worm chatters when it lets a load down; its path follows the step, and is compared
at 0.8 µs. Limits: 0.1 % of the travel to one side; 1 % of the torque.""",
    "whole plant in MuJoCo's elements": """\
The same exercise on the model that viewers open: linkage closed by a constraint, meshes as tendons, friction as
MuJoCo's LuGre element (`cls_bench/verification/twin.py`).""",
    "outer loop": """\
The bench at the edge of stability. `stability_moderate` has to shake equally whatever the step; without friction and
backlash the oscillation has to grow as the linear model says, and its onset has to be the linear model's. The growth
rates are sharp: a load cell's filter of half the bandwidth, 32 µs slower, changes them by 0.5 1/s and moves the onset
by 0.9 %. What a step of 50 µs changes, 0.04 1/s, is gone with finer steps.""",
    "several axes": """\
Two or three axes in one bench, each with a hand of its own, against as many benches of one axis: every recorded sample,
bit for bit.""",
    "energy": """\
Whole runs of the bench, audited from the recorded signals (`cls_bench/analysis/energy.py`): work of motor and hand =
change of kinetic, potential and elastic energy + losses by element. Limits: 0.2 % of the throughput; a loss gives
nothing back.""",
    "random trials": """\
Parameters drawn at random within their bounds, one in twenty up to three decades away from its default; each set runs
0.2 s of push, tightening grip and release, or is refused at load with the parameter to blame.""",
}
"""What a reader should know of a group before its table."""


ROUNDING = 1e-9
"""Part of the expected value below which a deviation is only rounding, and shown as 0."""


def number(value: float) -> str:
    """Five significant digits."""
    return f"{value + 0.0:.5g}".replace("-", "−")


def deviation(row: Row) -> str:
    """Deviation as a percentage, or in the row's unit."""
    return _share(row, row.deviation, signed=True)


def limit(row: Row) -> str:
    """Limit as a percentage, or in the row's unit."""
    return "±" + _share(row, row.limit, signed=False) if row.limit else "0"


def _share(row: Row, value: float, *, signed: bool) -> str:
    scale = abs(row.expected) if row.relative else max(abs(row.expected), row.limit)
    if abs(row.obtained - row.expected) <= ROUNDING * scale and signed:
        return "0"
    text = f"{100.0 * value:+.2g} %" if row.relative else f"{value:+.2g}"
    return (text if signed else text.lstrip("+")).replace("-", "−")


def verdict(row: Row) -> str:
    """A word."""
    return "passed" if row.passed else "FALLS SHORT"


def render(rows: Sequence[Row]) -> str:
    """The page as Markdown."""
    short = sum(not row.passed for row in rows)
    lines = [INTRODUCTION, f"**{len(rows)} rows, {short or 'none'} of which fall short.**", ""]
    for group, members in itertools.groupby(rows, key=lambda row: row.group):
        lines += [f"## {group[0].upper()}{group[1:]}", "", NOTES.get(group, ""), ""]
        lines += _table(members)
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _table(rows: Iterable[Row]) -> list[str]:
    return [
        "| quantity | unit | expected | source | obtained | deviation | limit | verdict |",
        "|---|---|---:|---|---:|---:|---:|---|",
        *(
            f"| {row.quantity} | {row.unit} | {number(row.expected)} | {row.source} | {number(row.obtained)} "
            f"| {deviation(row)} | {limit(row)} | {verdict(row)} |"
            for row in rows
        ),
    ]
