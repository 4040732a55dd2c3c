"""Detents: places that hold the control (thesis 3.5.2, figure 3.29).

Within half a width of its place a detent drives back to it, by default with a torque of one period of a sine::

    T = −torque · sin(2π (φ − place) / width)

``profile`` replaces the sine by torques from −width/2 to width/2, equally spaced, as shares of the peak, straight in
between, positive forward; outside a detent is silent, so a profile may not begin below 0 nor end above it: at such an
edge the control would be pushed out by the detent and in by the springs.
"""

import math
from itertools import pairwise
from typing import Any

from pydantic import model_validator

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, edge, restore, spring
from cls_bench.quantity import WIDEST, Table, table


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    d = feel.detents
    seat = piece.aft
    for k in range(d.place.count):
        centre, half = d.place.values[k], 0.5 * d.width.values[k]
        if not edge(piece, seat, centre - half) or edge(piece, seat, centre + half):
            continue
        peak = d.torque.values[k]
        if d.profile.count == 0:
            piece.sine[seat] = peak
            piece.sine_wave[seat] = math.pi / half
            piece.sine_centre[seat] = centre
            continue
        pieces = d.profile.count - 1
        length = 2.0 * half / pieces
        first = 0
        for j in range(1, pieces):
            if edge(piece, seat, centre - half + j * length):
                first = j
        low, high = d.profile.values[first], d.profile.values[first + 1]
        slope = -peak * (high - low) / length
        spring(piece, seat, slope, centre - half + first * length)
        restore(piece, seat, -peak * low)


class Detents(Element):
    """Detents at some places, a value of each list for each."""

    place: Table = table("rad", "where they are", "none unless a control has them", 32, gt=-WIDEST, lt=WIDEST,
                         live=True)  # fmt: skip
    width: Table = table("rad", "over how much they are felt", "none unless a control has them", 32, ge=1e-4,
                         lt=WIDEST, live=True)  # fmt: skip
    torque: Table = table("N·m", "peak torque", "none unless a control has them", 32, ge=0, le=1e3, live=True)
    profile: Table = table(
        "1", "torque over the width as shares of the peak, at equal distances; none is a sine, thesis figure 3.29",
        "thesis 3.5.2", 32, ge=-1, le=1, live=True,
    )

    act = staticmethod(_act)

    @property
    def steepest(self) -> float:
        """Greatest stiffness, of either sign [N·m/rad]."""
        slope = 2.0 * math.pi
        if self.profile:
            slope = (len(self.profile) - 1) * max(abs(b - a) for a, b in pairwise(self.profile))
        return max((slope * peak / width for peak, width in zip(self.torque, self.width, strict=True)), default=0.0)

    @model_validator(mode="after")
    def _fit(self) -> "Detents":
        if not len(self.place) == len(self.width) == len(self.torque):
            raise ValueError(
                f"place, width and torque need a value for each detent; there are {len(self.place)}, "
                f"{len(self.width)} and {len(self.torque)}"
            )
        if len(self.profile) == 1:
            raise ValueError("profile needs two values at least, or none for a sine")
        if self.profile and (self.profile[0] < 0.0 or self.profile[-1] > 0.0):
            raise ValueError(
                "profile must not begin below 0 nor end above it: a detent that pushes out at its own edge has no rest "
                "there"
            )
        found = sorted(zip(self.place, self.width, strict=True))
        for (a, of_a), (b, of_b) in pairwise(found):
            if b - a < 0.5 * (of_a + of_b) * (1.0 - 1e-9):
                raise ValueError(f"the detents at {a:g} and {b:g} rad overlap: {of_a:g} and {of_b:g} rad wide")
        return self
