"""What a scenario asks of a rig that the rig cannot do: said when it is validated or run, not refused.

An angle is where the arm wants to be, so it may lie beyond the stops: the arm then presses on them, as strongly as its
stiffness says. Angles and forces mean those of the rig's own control.
"""

import math
from collections.abc import Iterator, Sequence

from cls_bench.parameters import Parameters
from cls_bench.parameters.inertias import column_inertia
from cls_bench.scenario.segments import Segment

STRONG = 334.0
"""What a pilot's two hands are taken to give for a short time [N]: 75 lb in pitch, 14 CFR 25.143(d)."""

RATIO = 1.2
"""Factor by which the true ratio from motor to control may differ from the believed one before that is said."""


def beyond_the_rig(hand: Sequence[Segment], p: Parameters) -> Iterator[str]:
    """One line for each thing that will not be as the scenario means it."""
    stiffness, stop = p.limb.arm_stiffness * p.column.grip_height, p.column.stop_angle
    pressed = [
        (stiffness * (segment.farthest - stop), k, segment)
        for k, segment in enumerate(hand)
        if segment.aim is not None and segment.aim.motion
    ]
    worst = max(pressed, key=lambda entry: entry[0], default=None)
    if worst is not None and worst[0] > STRONG:
        force, k, segment = worst
        yield (
            f"hand[{k}] aims at {math.degrees(segment.farthest):.4g}°, where this rig's control stops at "
            f"{math.degrees(stop):.3g}°: the arm will press on the stops with {force:.0f} N"
        )
    true, believed = p.gearbox.ratio * p.linkage.levers.ratio, p.nameplate.gear_ratio * p.nameplate.levers.ratio
    if not 1.0 / RATIO < true / believed < RATIO:
        yield (
            f"the motor turns {true:.4g} times for one turn of the control, and drive and PLC believe {believed:.4g} "
            "(nameplate): what a rig is built of belongs in its file, from which the nameplate follows"
        )
    own = column_inertia(p)
    if p.feel.inertia < own:
        yield (
            f"feel.inertia = {p.feel.inertia:g} kg·m² is less than the {own:.3g} kg·m² of this rig's own control: the "
            "outer loop will hardly be stable (thesis 3.6.2)"
        )
