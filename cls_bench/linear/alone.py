"""The drive by itself: its own loops with the control's shafts, no hand, nothing asked of it."""

import math

from cls_bench.linear.bench import DRIFT, SLOW, LinearBench
from cls_bench.linear.hand import Hand
from cls_bench.parameters import Parameters


def drive_alone(p: Parameters) -> str:
    """What is wrong if the drive oscillates by itself, hand off and with the outer loop open; else empty."""
    growth = LinearBench(p, Hand(None), closed=False, model=False).growth
    frequency = growth.imag / (2.0 * math.pi)
    if growth.real <= DRIFT or frequency <= SLOW:
        return ""
    return (
        f"the drive itself is unstable at {frequency:.3g} Hz (hand off, outer loop open; {growth.real:+.3g} 1/s by the "
        f"linear model): {p.drive.velocity_bandwidth:.3g} Hz of drive.velocity_bandwidth are too many"
    )
