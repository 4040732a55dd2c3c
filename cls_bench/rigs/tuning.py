"""The one rule by which a rig that states no bandwidths gets them: in proportion to the thesis's rig.

Two things bound the velocity loop: the time from a motion of the motor to the torque that answers it, and the frequency
at which the control swings on gears and load cell while the motor is held, where it drops out of the load. The thesis's
rig was tuned to 100 Hz by hand. Another one gets as much less as it is softer or slower, and never more: what a rig
that is stiffer and faster could bear has to be measured. The position loop and the integral follow the velocity loop as
they do there. Gains follow from the bandwidths (:mod:`cls_bench.control.tuning`).
"""

import math
from functools import cache
from typing import NamedTuple

from cls_bench.parameters import Parameters
from cls_bench.rigs.derivation import Derived
from cls_bench.rigs.modes import resonances


class _Reference(NamedTuple):
    held: float
    delay: float


@cache
def _thesis() -> _Reference:
    return _Reference(resonances(Parameters()).held, answer_delay(Parameters()))


def answer_delay(p: Parameters) -> float:
    """Time from the motor's motion to the torque that the velocity controller answers with [s].

    Half a velocity cycle of holding, the speed as a difference over one, its filter, the voltage latch with half a
    current cycle of holding, and the current loop.
    """
    rates, drive = p.rates, p.drive
    latch = (drive.voltage_latency + 0.5) * rates.current_cycle
    return rates.velocity_cycle + drive.speed_filter_time + latch + 1.0 / (2.0 * math.pi * drive.current_bandwidth)


def bandwidths(p: Parameters) -> list[Derived]:
    """Bandwidths and integral time of the drive for a rig with these parameters."""
    default, thesis = Parameters().drive, _thesis()
    held, delay = resonances(p).held, answer_delay(p)
    softer, slower = held / thesis.held, thesis.delay / delay
    share = min(1.0, softer, slower)
    if share == 1.0:
        how = "the thesis's: the rig is as stiff and as fast"
    elif softer <= slower:
        why = f"the control swings at {held:.3g} Hz with the motor held, not {thesis.held:.3g} Hz"
        how = f"{share:.3g} of the thesis's, as {why}"
    else:
        why = f"the drive answers after {delay * 1e3:.3g} ms, not {thesis.delay * 1e3:.3g} ms"
        how = f"{share:.3g} of the thesis's, as {why}"
    return [
        Derived("drive.velocity_bandwidth", default.velocity_bandwidth * share, how),
        Derived("drive.velocity_integral_time", default.velocity_integral_time / share, "two periods of that"),
        Derived(
            "drive.position_bandwidth", default.position_bandwidth * share,
            f"{default.position_bandwidth / default.velocity_bandwidth:g} of the velocity bandwidth",
        ),
    ]  # fmt: skip


def in_proportion(p: Parameters) -> list[Derived]:
    """What the thesis's rig has in proportion to its travel: virtual stops, following error, potentiometer."""
    default, share = Parameters(), p.column.travel / Parameters().column.travel
    if p.column.travel == default.column.travel and p.column.stop_angle == default.column.stop_angle:
        return []
    how = "in proportion to the travel, as on the thesis's rig"
    found = [
        Derived(key, value * share, how)
        for key, value in (
            ("feel.aft_limit.angle", default.feel.aft_limit.angle),
            ("feel.forward_limit.angle", default.feel.forward_limit.angle),
            ("plc.following_error_limit", default.plc.following_error_limit),
        )
    ]
    reach = p.column.stop_angle * default.potentiometer.range / default.column.stop_angle
    return [*found, Derived("potentiometer.range", reach, "a third more than the stops, as on the thesis's rig")]
