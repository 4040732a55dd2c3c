"""What a feel element is: its parameters, what it remembers, and how it acts on the model.

An element stands in a file of its own in ``elements/``, and becomes part of every feel model by its line in
:class:`cls_bench.feel.model.Feel`. Its laws are compiled functions of the whole feel record and of the model's state:

``each_cycle(feel, state, time, cycle)``
    Once in a PLC cycle [s], before the bodies move: what the element remembers, and torques that hold for the cycle,
    by :func:`push`.
``act(feel, state, piece)``
    In every piece of a cycle: the element's torque as it is around the point where the bodies are now. Within a piece
    all is linear, but for a sine and for Stribeck's curve: springs and dampers by :func:`spring` and :func:`damper`,
    the ends of the piece by :func:`edge`, a condition that holds within it by :func:`condition`.
``forget(feel, state)``
    In every cycle in which nothing obeys the model, which then goes along with the column: what the element forgets, so
    that the drive comes on without a jump.
``show(feel, state)``
    At the end of a cycle: what is recorded of it.

Torques and motions are those at the control's axis, also of the aft body: the linkage ratio is taken to be in its
parameters. ``seat`` is the body on which an element acts: :data:`COLUMN`, or the aft one, ``piece.aft``, which is the
same body where the model has but one.
"""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import ValidationInfo, field_validator

from cls_bench.compiled import compiled
from cls_bench.quantity import Section, check_each

COLUMN = 0
"""Number of the body at the column."""

NUDGE = 1e-13
"""How far ahead of a body [rad] is looked to tell on which side of an edge it is; of backlash likewise."""

MOMENT = 1e-10
"""How far ahead [s] is looked to tell whether a contact that carries no torque just now is about to press."""

TERMS = 22
"""Places for the terms of a power series."""

CONDITIONS = 40
"""Places for conditions in a piece; all elements of today together take 19."""

Law = Callable[..., None]


class Element(Section):
    """Base of the elements: a section of parameters with its laws; each is None where there is none."""

    remembers: ClassVar[Sequence[tuple[str, type[np.generic]]]] = ()
    """what it remembers, by name: fields of ``state.NAME`` where NAME is the element's in the list"""
    each_cycle: ClassVar[Law | None] = None
    act: ClassVar[Law | None] = None
    forget: ClassVar[Law | None] = None
    show: ClassVar[Law | None] = None

    @field_validator("*")
    @classmethod
    def _each(cls, value: Any, info: ValidationInfo) -> Any:
        """Every number of a table within its bounds."""
        if type(value) is tuple:
            check_each(cls.model_fields[str(info.field_name)], value)
        return value


PIECE = np.dtype(
    [
        ("aft", np.int64),  # number of the aft body: 1, or 0 where all is one body
        # where the bodies are, and where they will be in a moment
        ("angle", np.float64, (2,)), ("velocity", np.float64, (2,)),
        ("ahead", np.float64, (2,)), ("speed_ahead", np.float64, (2,)),
        ("apart_ahead", np.float64),  # column less aft
        # restoring torque of a body: stiffness · angle + damping · velocity + offset + sine
        ("stiffness", np.float64, (2,)), ("damping", np.float64, (2,)), ("offset", np.float64, (2,)),
        ("sine", np.float64, (2,)), ("sine_wave", np.float64, (2,)), ("sine_centre", np.float64, (2,)),
        # torque of the linkage on the aft body, by the bodies' difference
        ("link_stiffness", np.float64), ("link_damping", np.float64), ("link_offset", np.float64),
        # ends of the piece: of the column, of the aft body, of their difference
        ("low", np.float64, (3,)), ("high", np.float64, (3,)),
        # each ≥ 0 within the piece: a · column angle + b · its velocity + c · aft angle + d · its velocity + e
        ("conditions", np.int64), ("condition", np.float64, (CONDITIONS, 5)),
        # friction of a body
        ("coulomb", np.float64, (2,)), ("static", np.float64, (2,)), ("stribeck", np.float64, (2,)),
        ("held", np.int64, (2,)),  # whether it is jammed
        # of the solver
        ("inertia", np.float64, (2,)), ("way", np.float64, (2,)), ("torque", np.float64, (2,)),
        ("terms", np.float64, (2, TERMS)), ("event", np.float64, (TERMS,)),
        ("sines", np.float64, (2, TERMS)), ("cosines", np.float64, (2, TERMS)), ("curve", np.float64, (2, TERMS)),
    ]
)  # fmt: skip
"""Working memory of the solver: the linear piece in which the bodies are, and the power series of their motion."""


@compiled
def push(state: Any, seat: int, torque: float) -> None:
    """A torque [N·m] on a body that holds for the cycle; ``seat`` 0 the column, 1 the aft body."""
    state.own_torque += torque
    if seat == 1:
        state.aft_torque += torque


@compiled
def spring(piece: Any, seat: int, stiffness: float, centre: float) -> None:
    """Restoring torque stiffness · (φ − centre) on a body."""
    piece.stiffness[seat] += stiffness
    piece.offset[seat] -= stiffness * centre


@compiled
def damper(piece: Any, seat: int, damping: float) -> None:
    """Restoring torque damping · φ̇ on a body."""
    piece.damping[seat] += damping


@compiled
def restore(piece: Any, seat: int, torque: float) -> None:
    """A constant restoring torque [N·m] on a body: positive drives it back."""
    piece.offset[seat] += torque


@compiled
def edge(piece: Any, seat: int, at: float) -> bool:
    """End the piece where a body passes the angle ``at`` [rad]; whether the body is beyond it, or on its way there."""
    beyond = bool(piece.ahead[seat] >= at)
    if beyond:
        piece.low[seat] = max(piece.low[seat], at)
    else:
        piece.high[seat] = min(piece.high[seat], at)
    return beyond


@compiled
def ends_below(piece: Any, a: float, b: float, c: float, d: float, e: float) -> None:
    """End the piece where a φ + b φ̇ + c φ_aft + d φ̇_aft + e falls below 0."""
    k = piece.conditions
    piece.condition[k, 0], piece.condition[k, 1] = a, b
    piece.condition[k, 2], piece.condition[k, 3] = c, d
    piece.condition[k, 4] = e
    piece.conditions = k + 1


@compiled
def condition(piece: Any, seat: int, of_angle: float, of_velocity: float, constant: float) -> None:
    """End the piece where of_angle · φ + of_velocity · φ̇ + constant of a body falls below 0."""
    if seat == COLUMN:
        ends_below(piece, of_angle, of_velocity, 0.0, 0.0, constant)
    else:
        ends_below(piece, 0.0, 0.0, of_angle, of_velocity, constant)


@compiled
def condition_apart(piece: Any, of_angle: float, of_velocity: float, constant: float) -> None:
    """As :func:`condition`, of the difference of the bodies, column less aft."""
    ends_below(piece, of_angle, of_velocity, -of_angle, -of_velocity, constant)


@compiled
def within(value: float, most: float) -> float:
    """``value`` within ±``most``."""
    return min(max(value, -most), most)


@compiled
def ramped(level: float, wanted: float, full: float, time: float, cycle: float) -> float:
    """What becomes of ``level`` in a ``cycle`` [s] on its way to ``wanted``, at ``full`` in ``time`` [s]; 0 is at once.
    """
    return level + within(wanted - level, full / time * cycle) if time > 0.0 else wanted


@compiled
def saturating(piece: Any, seat: int, stiffness: float, centre: float, most: float) -> None:
    """A spring about ``centre`` whose torque ends at ±``most`` [N·m]."""
    if stiffness <= 0.0 or most <= 0.0:
        return
    width = most / stiffness
    if edge(piece, seat, centre + width):
        restore(piece, seat, most)
    elif not edge(piece, seat, centre - width):
        restore(piece, seat, -most)
    else:
        spring(piece, seat, stiffness, centre)


@compiled
def stop(piece: Any, seat: int, side: float, at: float, stiffness: float, damping: float) -> None:
    """A stop beyond ``at`` [rad] on one ``side``, ±1: a spring with a damper that pushes back and never pulls.

    Its torque is max(0, stiffness · e + damping · ė) with the indentation e = side · (φ − at).
    """
    if edge(piece, seat, at) != (side > 0.0):
        return
    if damping > 0.0:
        moving = stiffness * piece.velocity[seat] * MOMENT + damping * piece.speed_ahead[seat]
        pressing = side * (stiffness * (piece.angle[seat] - at) + moving)
        if pressing < 0.0:  # it has let go before the edge is reached
            condition(piece, seat, -side * stiffness, -side * damping, side * stiffness * at)
            return
        condition(piece, seat, side * stiffness, side * damping, -side * stiffness * at)
        damper(piece, seat, damping)
    spring(piece, seat, stiffness, at)
