"""Limits of drive, PLC and sensors: who reached which, how often and how far.

Nothing is limited here. The tick notes what was asked beyond a limit, so that no limit does its work unseen.
"""

from typing import Any

import numpy as np

from cls_bench.compiled import compiled

LIMITS = ("load_cell", "set_angle", "speed", "torque", "current", "voltage", "travel", "bus")
"""Names, as those of the signals of ``/limits``."""

SLOTS = {name: LIMITS for name in ("ticks", "peak", "limit", "share")}
"""Names of the columns of :data:`STATE`."""

LOAD_CELL, SET_ANGLE, SPEED, TORQUE, CURRENT, VOLTAGE, TRAVEL, BUS = range(len(LIMITS))

STATE = np.dtype(
    [
        ("ticks", np.float64, (len(LIMITS),)),  # at the limit, since the last recorded row
        ("peak", np.float64, (len(LIMITS),)),  # greatest amount asked for while at the limit; the log clears it
        ("limit", np.float64, (len(LIMITS),)),  # the limit at that moment
        ("share", np.float64, (len(LIMITS),)),  # of the ticks of the last PLC cycle that was closed
    ]
)


ROUNDING = 1e-4
"""Share of a limit by which more is not called more: two limits of one data sheet may differ by its last digit."""


@compiled
def note(watch: Any, which: int, asked: float, limit: float) -> None:
    """Note a tick that was spent at a limit, where ``asked`` was beyond ``limit``; both are magnitudes."""
    watch.ticks[which] += 1.0
    if asked > watch.peak[which]:
        watch.peak[which] = asked
        watch.limit[which] = limit


@compiled
def compare(watch: Any, which: int, asked: float, limit: float) -> None:
    """:func:`note` the tick if ``asked`` is beyond ± ``limit``."""
    if abs(asked) > limit * (1.0 + ROUNDING):
        note(watch, which, abs(asked), limit)


@compiled
def lose(watch: Any, cycle: int) -> None:
    """Note that the bus lost one of the two frames of its ``cycle`` [ticks]."""
    watch.ticks[BUS] += 0.5 * cycle


@compiled
def close(watch: Any, ticks: int) -> None:
    """The share of the last ``ticks`` ticks that was spent at each limit; counting starts anew."""
    for which in range(watch.ticks.shape[0]):
        watch.share[which] = watch.ticks[which] / ticks
        watch.ticks[which] = 0.0
