"""The feel model: the flight control system that the pilot is to feel, as one body or two (thesis 3.5.1, 3.5.2).

:class:`Feel` is the list of the elements: a line here is all that a new one needs beside its own file.
"""

from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from cls_bench.compiled import in_turn
from cls_bench.feel.element import Element
from cls_bench.feel.elements.aft_body import AftBody
from cls_bench.feel.elements.autopilot import Autopilot
from cls_bench.feel.elements.bob_weight import BobWeight
from cls_bench.feel.elements.centering import Centering
from cls_bench.feel.elements.detents import Detents
from cls_bench.feel.elements.disturbance import Disturbance
from cls_bench.feel.elements.down_spring import DownSpring
from cls_bench.feel.elements.feel_spring import QFeel
from cls_bench.feel.elements.flight import Flight
from cls_bench.feel.elements.gust import Gust
from cls_bench.feel.elements.hydraulics import Hydraulics
from cls_bench.feel.elements.jam import Jam
from cls_bench.feel.elements.linkage import Linkage
from cls_bench.feel.elements.stick_pusher import StickPusher
from cls_bench.feel.elements.stick_shaker import StickShaker
from cls_bench.feel.elements.surface import Surface
from cls_bench.feel.elements.travel_limit import AftLimit, ForwardLimit
from cls_bench.feel.elements.trim import Trim
from cls_bench.feel.elements.unbalance import Unbalance
from cls_bench.quantity import DEG, WIDEST, Section, part, quantity

FASTEST = 1e6
"""Fastest motion [1/s] that a model may have; the solver works it out in steps of 0.4 of its time."""


class Feel(Section):
    """Flight control system at the column's axis: a body, or one at the column and one aft, and their elements."""

    bodies: Literal["one", "two"] = quantity(
        "one", "1", "whether the aft body moves on its own, behind the linkage", "thesis 3.5.2: one is enough for most"
    )
    inertia: float = quantity(
        0.3, "kg·m²", "I_fcs, of the body at the column", "thesis figure 4.2", ge=1e-3, le=100, live=True
    )
    damping: float = quantity(
        1.5, "N·m·s/rad", "d_fcs, of the body at the column", "thesis figure 4.2", ge=0, le=1e4, live=True
    )
    stiffness: float = quantity(
        35.0, "N·m/rad", "c_fcs, of the feel spring about neutral", "thesis figure 4.2", ge=0, le=1e5, live=True
    )
    friction: float = quantity(
        0.25, "N·m", "Coulomb friction μ_fcs of the body at the column, with stiction", "thesis figure 4.2",
        ge=0, le=1e3, live=True,
    )
    static_friction: float = quantity(
        0.0, "N·m", "its friction at rest; 0 is the Coulomb friction", "0: as in motion", ge=0, le=1e3, live=True
    )
    stribeck_velocity: float = quantity(
        0.0, "rad/s", "speed over which friction falls from that at rest; 0 is at once", "0: at once", ge=0, le=10,
        live=True,
    )
    neutral: float = quantity(
        0.0, "rad", "neutral position φ_0 (trim)", "thesis 3.5.2", gt=-WIDEST, lt=WIDEST, live=True
    )
    # the elements
    flight: Flight = Flight()
    trim: Trim = Trim()
    q_feel: QFeel = QFeel()
    centering: Centering = Centering()
    hydraulics: Hydraulics = Hydraulics()
    surface: Surface = Surface()
    aft: AftBody = AftBody()
    linkage: Linkage = Linkage()
    aft_limit: AftLimit = part(
        AftLimit(angle=14.0 * DEG, stiffness=150.0, damping=2.0),
        "travel limit of the control surface; of a single body softened by the cables",
        angle="assumed: within the travel of ±20°, so that both limits of thesis figure 4.2 are reached",
        stiffness="assumed: four times c_fcs, so that the torque bends visibly, as in thesis figure 4.2",
        damping="assumed: a little more than the model's own",
    )
    forward_limit: ForwardLimit = part(
        ForwardLimit(angle=17.0 * DEG, stiffness=1500.0, damping=15.0),
        "travel limit of the column itself, stiff",
        angle="assumed: 3° beyond the surface's, before the limit switches",
        stiffness="assumed: ten times the cables': thesis 4.2 calls it the stiff one",
        damping="assumed: a third of critical for the model's inertia",
    )
    detents: Detents = Detents()
    unbalance: Unbalance = Unbalance()
    bob_weight: BobWeight = BobWeight()
    down_spring: DownSpring = DownSpring()
    autopilot: Autopilot = Autopilot()
    shaker: StickShaker = StickShaker()
    pusher: StickPusher = StickPusher()
    disturbance: Disturbance = Disturbance()
    gust: Gust = Gust()
    jam: Jam = Jam()

    @model_validator(mode="after")
    def _limits(self) -> "Feel":
        if self.bodies == "one":
            for name in ("angle", "back"):
                if not getattr(self.aft_limit, name) <= getattr(self.forward_limit, name):
                    raise ValueError(f"aft_limit.{name} must not exceed forward_limit.{name}")
        return self

    @model_validator(mode="after")
    def _slow_enough(self) -> "Feel":
        """No motion so fast that the solver would work on it for ever."""
        for inertia, stiffness, damping in self._bounds():
            fastest = (sum(stiffness.values()) / inertia) ** 0.5 + sum(damping.values()) / inertia
            if not fastest <= FASTEST:
                shares = {key: (value / inertia) ** 0.5 for key, value in stiffness.items()}
                shares |= {key: value / inertia for key, value in damping.items()}
                raise ValueError(
                    f"stiffness and damping are too much for an inertia of {inertia:g} kg·m², most of all "
                    f"{max(shares, key=shares.__getitem__)}: motion of {fastest:.3g} 1/s, at most {FASTEST:g} 1/s is "
                    "worked out"
                )
        return self

    def _bounds(self) -> list[tuple[float, dict[str, float], dict[str, float]]]:
        """Of each body its inertia and, by their keys, bounds of the stiffnesses and dampings that act on it."""
        s, detents, hydraulics, servo, flight = self.surface, self.detents, self.hydraulics, self.autopilot, self.flight
        ratio, load = s.steepest, flight.dynamic_pressure * s.area * s.chord
        rate = abs(s.hinge_rate) * s.chord / (2.0 * flight.airspeed) if flight.airspeed > 0.0 else 0.0
        column = {"forward_limit.stiffness": self.forward_limit.stiffness}
        column_damping = {"damping": self.damping, "forward_limit.damping": self.forward_limit.damping}
        aft = {
            "stiffness": self.stiffness,
            "q_feel": min(self.q_feel.gradient * flight.dynamic_pressure, self.q_feel.most),
            "centering.stiffness": self.centering.stiffness if self.centering.breakout > 0.0 else 0.0,
            "surface.hinge_deflection": load * abs(s.hinge_deflection) * ratio**2, "detents": detents.steepest,
            "unbalance.gradient": abs(flight.load_factor * self.unbalance.gradient),
            "autopilot.stiffness": servo.stiffness if servo.engaged else 0.0,
            "aft_limit.stiffness": self.aft_limit.stiffness,
        }  # fmt: skip
        aft_damping = {
            "surface.hinge_rate": load * rate * ratio**2, "hydraulics.off_damping": hydraulics.off_damping,
            "hydraulics.rate_damping": hydraulics.rate_damping if hydraulics.maximum_rate > 0.0 else 0.0,
            "trim.release_damping": self.trim.release_damping if self.trim.released else 0.0,
            "autopilot.damping": servo.damping if servo.engaged else 0.0,
            "aft_limit.damping": self.aft_limit.damping,
        }  # fmt: skip
        if self.bodies == "one":
            return [(self.inertia, column | aft, column_damping | aft_damping)]
        link, link_damping = {"linkage.stiffness": self.linkage.stiffness}, {"linkage.damping": self.linkage.damping}
        return [
            (self.inertia, column | link, column_damping | link_damping),
            (self.aft.inertia, aft | link, aft_damping | link_damping | {"aft.damping": self.aft.damping}),
        ]


ELEMENTS: dict[str, type[Element]] = {
    name: info.annotation
    for name, info in Feel.model_fields.items()
    if isinstance(info.annotation, type) and issubclass(info.annotation, Element)
}
"""The elements by name, in the order in which they are worked out."""

each_cycle: Any = in_turn([e.each_cycle for e in ELEMENTS.values() if e.each_cycle is not None])
"""(feel, state, time, cycle): what is done once in a cycle, of all elements."""

act: Any = in_turn([e.act for e in ELEMENTS.values() if e.act is not None])
"""(feel, state, piece): torques around the point where the bodies are, of all elements."""

forget: Any = in_turn([e.forget for e in ELEMENTS.values() if e.forget is not None])
"""(feel, state): what is forgotten while nothing obeys the model, of all elements."""

show: Any = in_turn([e.show for e in ELEMENTS.values() if e.show is not None])
"""(feel, state): what is recorded, of all elements."""

SURFACE = ("deflection", "velocity", "hinge_moment", "cable_torque", "feel_torque", "autopilot_torque", "trim")
"""What is recorded of the aft side."""

STATE = np.dtype(
    [
        ("angle", np.float64), ("velocity", np.float64), ("acceleration", np.float64),  # of the body at the column
        ("aft_angle", np.float64), ("aft_velocity", np.float64), ("aft_acceleration", np.float64),
        ("torque", np.float64),  # sum of the torques that act on the model [N·m]
        ("own_torque", np.float64),  # what of it is not the pilot's: shaker, pusher, gusts, bob-weight …
        ("aft_torque", np.float64),  # those of them that act on the aft body
        ("seat_angle", np.float64), ("seat_velocity", np.float64),  # of the body on which the feel unit acts
        ("surface", [(name, np.float64) for name in SURFACE]),
        *((name, [*e.remembers]) for name, e in ELEMENTS.items() if e.remembers),
    ]
)  # fmt: skip
"""What the model remembers [rad, rad/s, rad/s², N·m]."""
