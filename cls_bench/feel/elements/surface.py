"""Control surface: gearing and aerodynamic hinge moment (thesis Eq. 2.1, 2.2; 3.5.2).

    δ = gearing(φ),  R = dδ/dφ
    H = ½ρv² S c̄ (C_0 + C_α α + C_δ δ + C_t δ_t)
    T = (1 − boost · pressure) · R · (H + ½ρv² S c̄ · c̄ / 2v · C_rate R φ̇)

A surface that is stable on its own has C_δ < 0: H drives it back. ``boost`` is the share that the actuator bears: 0 is
reversible, 1 irreversible. With the gearing as a table, R is that of the piece in which the surface is; beyond the
table it goes on as at its end.
"""

from itertools import pairwise
from typing import Any

from pydantic import model_validator

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, damper, edge, restore, spring
from cls_bench.quantity import WIDEST, Table, quantity, table

STEEPEST = 20.0
"""Greatest gearing, to either side: more than any linkage has."""


@compiled
def gearing(surface: Any, angle: float) -> tuple[float, float]:
    """Deflection δ [rad] and gearing R = dδ/dφ at an angle of the aft body [rad]."""
    count = surface.control_angle.count
    if count == 0:
        return surface.gearing * angle, surface.gearing
    k = 0
    for j in range(1, count - 1):
        if angle >= surface.control_angle.values[j]:
            k = j
    x, y = surface.control_angle.values[k], surface.deflection.values[k]
    ratio = (surface.deflection.values[k + 1] - y) / (surface.control_angle.values[k + 1] - x)
    return y + ratio * (angle - x), ratio


@compiled
def load(feel: Any) -> float:
    """½ρv² S c̄ [N·m]."""
    return float(feel.flight.dynamic_pressure * feel.surface.area * feel.surface.chord)


@compiled
def felt(feel: Any) -> float:
    """Share of the hinge moment that the pilot bears."""
    return float(1.0 - feel.surface.boost * feel.hydraulics.pressure)


@compiled
def hinge_moment(feel: Any, deflection: float) -> float:
    """H [N·m] at rest."""
    s, f = feel.surface, feel.flight
    at_neutral = s.hinge_zero + s.hinge_alpha * f.angle_of_attack + s.hinge_tab * f.tab
    return float(load(feel) * (at_neutral + s.hinge_deflection * deflection))


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    s = feel.surface
    whole = load(feel)
    if whole == 0.0:
        return
    seat = piece.aft
    for j in range(1, s.control_angle.count - 1):
        edge(piece, seat, s.control_angle.values[j])
    deflection, ratio = gearing(s, piece.ahead[seat])
    share = felt(feel) * ratio
    restore(piece, seat, -share * hinge_moment(feel, deflection - ratio * piece.ahead[seat]))
    spring(piece, seat, -share * whole * s.hinge_deflection * ratio, 0.0)
    if feel.flight.airspeed > 0.0:
        damper(piece, seat, -share * ratio * whole * s.hinge_rate * s.chord / (2.0 * feel.flight.airspeed))


@compiled
def _show(feel: Any, state: Any) -> None:
    deflection, ratio = gearing(feel.surface, state.seat_angle)
    state.surface.deflection = deflection
    state.surface.velocity = ratio * state.seat_velocity
    state.surface.hinge_moment = hinge_moment(feel, deflection)


class Surface(Element):
    """The surface that the control moves; without area it has a deflection and no hinge moment."""

    area: float = quantity(0.0, "m²", "S behind the hinge", "none unless an aircraft has it", ge=0, le=200, live=True)
    chord: float = quantity(0.0, "m", "mean chord c̄ behind the hinge", "none unless an aircraft has it", ge=0, le=10,
                            live=True)  # fmt: skip
    hinge_zero: float = quantity(0.0, "1", "C_H0", "thesis Eq. 2.2", ge=-5, le=5, live=True)
    hinge_alpha: float = quantity(0.0, "1/rad", "∂C_H/∂α", "thesis Eq. 2.2", ge=-10, le=10, live=True)
    hinge_deflection: float = quantity(0.0, "1/rad", "∂C_H/∂δ: below 0 it drives back", "thesis Eq. 2.2", ge=-10,
                                       le=10, live=True)  # fmt: skip
    hinge_tab: float = quantity(0.0, "1/rad", "∂C_H/∂δ_t", "thesis Eq. 2.2", ge=-10, le=10, live=True)
    hinge_rate: float = quantity(
        0.0, "1/rad", "∂C_H/∂(δ˙ c̄ / 2v): below 0 it damps", "thesis 3.5.1, aerodynamic damping", ge=-100, le=0,
        live=True,
    )
    boost: float = quantity(0.0, "1", "share of the hinge moment that the actuator bears at full pressure",
                            "assumed: reversible", ge=0, le=1, live=True)  # fmt: skip
    gearing: float = quantity(1.0, "1", "R = dδ/dφ where there is no table", "assumed: as the column", ge=-STEEPEST,
                            le=STEEPEST)  # fmt: skip
    control_angle: Table = table("rad", "angles of the gearing's table, rising; none is a constant gearing",
                                 "none unless an aircraft has it", 16, gt=-WIDEST, lt=WIDEST)  # fmt: skip
    deflection: Table = table("rad", "deflections δ at those angles", "none unless an aircraft has it", 16,
                              gt=-WIDEST, lt=WIDEST)  # fmt: skip

    act = staticmethod(_act)
    show = staticmethod(_show)

    @property
    def steepest(self) -> float:
        """Greatest gearing |R|."""
        pieces = zip(pairwise(self.control_angle), pairwise(self.deflection), strict=True)
        return max((abs((y - x) / (b - a)) for (a, b), (x, y) in pieces), default=abs(self.gearing))

    @model_validator(mode="after")
    def _fit(self) -> "Surface":
        angles = self.control_angle
        if len(angles) != len(self.deflection):
            raise ValueError(
                f"control_angle and deflection need equally many values; there are {len(angles)} and "
                f"{len(self.deflection)}"
            )
        if len(angles) == 1:
            raise ValueError("control_angle needs two values at least, or none for a constant gearing")
        if any(b <= a for a, b in pairwise(angles)):
            raise ValueError(f"control_angle must rise: {list(angles)}")
        if not self.steepest <= STEEPEST:
            raise ValueError(
                f"deflection changes by {self.steepest:.3g} times the change of control_angle; at most {STEEPEST:g} "
                "times"
            )
        return self
