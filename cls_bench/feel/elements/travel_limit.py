"""Travel limits: stops of surface and column (thesis 3.5.2, figures 3.22 and 3.26).

Beyond an angle a stop adds stiffness and damping, and lets go when its torque has come down to zero: it never pulls.
"""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import COLUMN, Element, stop
from cls_bench.quantity import WIDEST, quantity


@compiled
def _stops(piece: Any, seat: int, limit: Any) -> None:
    back = limit.back_angle if limit.back_angle > 0.0 else limit.angle
    stop(piece, seat, 1.0, limit.angle, limit.stiffness, limit.damping)
    stop(piece, seat, -1.0, -back, limit.stiffness, limit.damping)


@compiled
def _aft(feel: Any, state: Any, piece: Any) -> None:
    _stops(piece, piece.aft, feel.aft_limit)


@compiled
def _forward(feel: Any, state: Any, piece: Any) -> None:
    _stops(piece, COLUMN, feel.forward_limit)


class TravelLimit(Element):
    """A stop to either side: T = max(0, stiffness · e + damping · ė), e being how far the angle is beyond it."""

    angle: float = quantity(0.0, "rad", "where it begins, forward and, unless back_angle says otherwise, aft", "",
                            ge=1e-3, lt=WIDEST, live=True)  # fmt: skip
    back_angle: float = quantity(0.0, "rad", "where it begins aft, as a positive angle; 0: as forward",
                                 "0: as forward", ge=0, lt=WIDEST, live=True)  # fmt: skip
    stiffness: float = quantity(0.0, "N·m/rad", "additional stiffness c_hs", "", ge=0, le=1e6, live=True)
    damping: float = quantity(0.0, "N·m·s/rad", "additional damping d_hs", "", ge=0, le=1e5, live=True)

    @property
    def back(self) -> float:
        """Where it begins aft, as a positive angle [rad]."""
        return self.back_angle or self.angle


class AftLimit(TravelLimit):
    """The stop of the control surface, or of what moves it; of a single body felt at the column."""

    act = staticmethod(_aft)


class ForwardLimit(TravelLimit):
    """The stop of the column."""

    act = staticmethod(_forward)
