"""Autopilot: a servo with a slip clutch on the aft body, which back-drives the control; T_ap of thesis 3.5.2.

    T = max(−clutch, min(clutch, stiffness · (reference − φ) + damping · (ref˙ − φ̇))) + torque

Engaged, or engaged still as the drive is switched on, it takes the control where it is and leads it to the reference at
``rate``. Whoever holds against it feels no
more than the clutch's torque; it leads the control back when he lets go.
"""

from typing import Any

import numpy as np

from cls_bench.compiled import compiled
from cls_bench.feel.element import MOMENT, Element, condition, damper, push, restore, spring, within
from cls_bench.quantity import WIDEST, quantity


@compiled
def _each_cycle(feel: Any, state: Any, time: float, cycle: float) -> None:
    k, s = feel.autopilot, state.autopilot
    if k.torque != 0.0:
        push(state, 1, k.torque)
    if not k.engaged:
        s.engaged, s.rate = 0.0, 0.0
        return
    if s.engaged == 0.0:
        s.engaged, s.reference = 1.0, state.seat_angle
    before = s.reference
    if k.rate > 0.0:
        s.reference += within(k.reference - s.reference, k.rate * cycle)
        s.rate = (s.reference - before) / cycle
    else:
        s.reference, s.rate = k.reference, 0.0


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    k, s = feel.autopilot, state.autopilot
    if not k.engaged or k.clutch <= 0.0:
        return
    seat = piece.aft
    drive = k.stiffness * s.reference + k.damping * s.rate
    ahead = piece.angle[seat] + MOMENT * piece.velocity[seat]
    restoring = k.stiffness * ahead + k.damping * piece.speed_ahead[seat]
    if restoring - drive > k.clutch:
        restore(piece, seat, k.clutch)
        condition(piece, seat, k.stiffness, k.damping, -drive - k.clutch)
    elif restoring - drive < -k.clutch:
        restore(piece, seat, -k.clutch)
        condition(piece, seat, -k.stiffness, -k.damping, drive - k.clutch)
    else:
        spring(piece, seat, k.stiffness, s.reference)
        damper(piece, seat, k.damping)
        restore(piece, seat, -k.damping * s.rate)
        condition(piece, seat, -k.stiffness, -k.damping, drive + k.clutch)
        condition(piece, seat, k.stiffness, k.damping, -drive + k.clutch)


@compiled
def _forget(feel: Any, state: Any) -> None:
    state.autopilot.engaged = 0.0


@compiled
def _show(feel: Any, state: Any) -> None:
    k, s = feel.autopilot, state.autopilot
    torque = 0.0
    if k.engaged and s.engaged != 0.0:
        asked = k.stiffness * (s.reference - state.seat_angle) + k.damping * (s.rate - state.seat_velocity)
        torque = within(asked, k.clutch)
    state.surface.autopilot_torque = torque + k.torque


class Autopilot(Element):
    """A servo with a slip clutch, and a torque that a simulation may ask for beside it."""

    engaged: bool = quantity(False, "1", "whether the servo is engaged", "a command", live=True)
    reference: float = quantity(0.0, "rad", "where it leads the control", "a command", gt=-WIDEST, lt=WIDEST, live=True)
    rate: float = quantity(0.2, "rad/s", "greatest rate at which it leads; 0 is at once",
                           "assumed: 11°/s, slow enough to follow", ge=0, le=1e3, live=True)  # fmt: skip
    stiffness: float = quantity(
        200.0, "N·m/rad", "stiffness of the servo", "assumed: a hand that holds 2° against it meets the clutch", ge=0,
        le=1e5, live=True,
    )
    damping: float = quantity(8.0, "N·m·s/rad", "damping of the servo",
                              "assumed: about critical with the default inertia", ge=0, le=1e4, live=True)  # fmt: skip
    clutch: float = quantity(8.0, "N·m", "torque at which the clutch slips",
                             "assumed: a hand overrides it with 27 N at 0.3 m", ge=0, le=1e3, live=True)  # fmt: skip
    torque: float = quantity(0.0, "N·m", "T_ap, asked for directly", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)

    remembers = (("engaged", np.float64), ("reference", np.float64), ("rate", np.float64))
    each_cycle = staticmethod(_each_cycle)
    act = staticmethod(_act)
    forget = staticmethod(_forget)
    show = staticmethod(_show)
