"""The one rule by which a rig that states no bandwidths gets them: in proportion to the thesis's rig.

The current loop follows its cycle: a kilohertz at 50 µs, as much less as the cycle is longer.

Three things bound the velocity loop. Two of them are the time from a motion of the motor to the torque that answers it,
and the frequency at which the control swings on gears and load cell while the motor is held, where it drops out of the
load. The thesis's rig was tuned to 100 Hz by hand. Another one gets as much less as it is softer or slower, and never
more: what a rig that is stiffer and faster could bear has to be measured.

The third is that the drive must not sing by itself. The gain is for all inertia that there is, but above its resonances
the motor turns what is next to it alone, so that it answers as many times too strongly; and where the answer comes half
a period late, it drives what it should calm. So the loop's gain, out of the hand, has to be less than one by
:data:`GAIN_MARGIN` wherever its phase is −180° (Nyquist)::

    L = 2π f_v J · Y(f) · D(f)² F(f) C(f)

Y the mobility of the chain of shafts at the motor, D a velocity cycle of holding and one of differencing, F the speed
filter, C the current loop with its latch. The integral, slow beside that, is left out.

The position loop and the integral follow the velocity loop as on the thesis's rig. Gains follow from the bandwidths
(:mod:`cls_bench.control.tuning`).
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from cls_bench.parameters import Parameters
from cls_bench.rigs.derivation import Derived
from cls_bench.rigs.modes import chain, resonances

GAIN_MARGIN = 1.5
"""Factor by which the drive's own loop could bear more gain."""

LEAST_SHARE = 0.001
"""Of the thesis's bandwidths: a resonance that nothing damps bears no gain at all."""

BANDWIDTHS = ("drive.velocity_bandwidth", "drive.position_bandwidth")
"""What the rules give if the rig's file does not."""


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


def current_bandwidth(p: Parameters) -> list[Derived]:
    """Bandwidth of the current controller, if its cycle is longer than the thesis's."""
    default, cycle, usual = Parameters().drive.current_bandwidth, p.rates.current_cycle, 50e-6
    if cycle <= usual:
        return []
    how = f"as much less than the thesis's as its cycle is longer, {cycle * 1e6:g} µs"
    return [Derived("drive.current_bandwidth", default * usual / cycle, how)]


def gain_limit(p: Parameters) -> tuple[float, float]:
    """Velocity bandwidth at which the drive with its gains begins to sing, hand off, and the frequency of it [Hz]."""
    rates, drive, shafts = p.rates, p.drive, chain(p)
    top = 0.5 / rates.velocity_cycle
    f = np.geomspace(1e-3 * top, top, 3000)
    near = np.geomspace(1e-5, 0.1, 60)
    near = 1.0 + np.concatenate([-near, [0.0], near])  # peaks of resonances are sharp
    f = np.unique(np.concatenate([f, *(near * mode for mode in shafts.modes[1:])]))
    f = f[f <= top]
    s = 2j * math.pi * f
    cycle = rates.velocity_cycle
    hold = (1.0 - np.exp(-s * cycle)) / (s * cycle)
    weight = 1.0 - math.exp(-cycle / drive.speed_filter_time) if drive.speed_filter_time > 0.0 else 1.0
    speed_filter = weight / (1.0 - (1.0 - weight) * np.exp(-s * cycle))
    latch = (drive.voltage_latency + 0.5) * rates.current_cycle
    current = 1.0 / (1.0 + s / (2.0 * math.pi * drive.current_bandwidth) * np.exp(s * latch))
    loop = 2.0 * math.pi * p.nameplate.load_inertia * shafts.mobility(f) * hold**2 * speed_filter * current
    k = np.flatnonzero(loop.imag[1:] * loop.imag[:-1] < 0.0)
    share = loop.imag[k] / (loop.imag[k] - loop.imag[k + 1])
    real = loop.real[k] + share * (loop.real[k + 1] - loop.real[k])
    if not np.any(real < 0.0):
        return math.inf, math.nan
    worst = int(np.argmin(real))
    return float(-1.0 / real[worst]), float(f[k[worst]])


def bandwidths(p: Parameters) -> list[Derived]:
    """Bandwidths and integral time of the drive for a rig with these parameters, nameplate and current loop."""
    default, thesis = Parameters().drive, _thesis()
    held, delay = resonances(p).held, answer_delay(p)
    limit, sings = gain_limit(p)
    softer, slower = held / thesis.held, thesis.delay / delay
    louder = max(limit / GAIN_MARGIN / default.velocity_bandwidth, LEAST_SHARE)
    share = min(1.0, softer, slower, louder)
    if share == 1.0:
        how = "the thesis's: the rig is as stiff and as fast"
    elif share == softer:
        why = f"the control swings at {held:.3g} Hz with the motor held, not {thesis.held:.3g} Hz"
        how = f"{share:.3g} of the thesis's, as {why}"
    elif share == slower:
        why = f"the drive answers after {delay * 1e3:.3g} ms, not {thesis.delay * 1e3:.3g} ms"
        how = f"{share:.3g} of the thesis's, as {why}"
    else:
        why = f"the drive by itself would sing at {sings:.3g} Hz from a bandwidth of {limit:.3g} Hz on"
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
