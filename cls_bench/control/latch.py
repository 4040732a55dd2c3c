"""Latches: every delay of the real system, with its length in cycles."""

from typing import Any

from cls_bench.compiled import compiled

DEPTH = 17
"""Rows of a latch: delays of 0 to 16 cycles."""


@compiled
def write(latch: Any, cycle: int, slot: int, value: float) -> None:
    """Put ``value`` into column ``slot`` in this ``cycle``; ``latch`` has shape (:data:`DEPTH`, slots)."""
    latch[cycle % DEPTH, slot] = value


@compiled
def read(latch: Any, cycle: int, delay: int, slot: int) -> float:
    """The value written ``delay`` cycles ago; the first one written, before there was any that old."""
    return float(latch[max(cycle - delay, 0) % DEPTH, slot])


@compiled
def repeat(latch: Any, cycle: int) -> None:
    """A frame was lost: what was there stays for this ``cycle``."""
    for slot in range(latch.shape[1]):
        latch[cycle % DEPTH, slot] = latch[max(cycle - 1, 0) % DEPTH, slot]
