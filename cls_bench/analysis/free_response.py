"""Free response of the column after release: the expected one by an independent solution, and the Part 60 tolerances.

Expected is Eq. 3.15 of the thesis with the feel model's other elements: a single body with the inertia and damping of
the feel model and of all that is forward of the load cell, solved here by scipy, apart from the controller's own code::

    (I_fcs + I_fwd) φ̈ + (d_fcs + d_fwd + d_hs) φ̇ + c (φ − φ₀) + centering + travel limits + (μ_fcs + μ_fwd) sign φ̇ = T

14 CFR Part 60, table A2A, dynamic tests 2.b.1 to 2.b.3, judges the response of an underdamped control by the time to
the first crossing, the periods after it, the overshoots and their number, of an overdamped one by the time from 90 % to
10 % of the amplitude, and by its having no overshoot.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import Feel, Parameters

Array = NDArray[np.float64]


def forward_inertia(p: Parameters) -> float:
    """I_fwd [kg·m²]: column and rod end, all that is forward of the strain gauge."""
    return p.column.inertia + p.linkage.masses[2] * p.linkage.arm**2


def spring_torque(feel: Feel, angle: float) -> float:
    """Torque [N·m] of the model's springs at ``angle`` [rad]: stiffness, centering unit, travel limits."""
    offset = angle - feel.neutral
    torque = feel.stiffness * offset
    torque += float(np.clip(feel.centering.stiffness * offset, -feel.centering.breakout, feel.centering.breakout))
    for limit in (feel.aft_limit, feel.forward_limit):
        torque += limit.stiffness * float(np.sign(angle)) * max(abs(angle) - limit.angle, 0.0)
    return torque


def damping(p: Parameters, angle: float) -> float:
    """Viscous damping [N·m·s/rad] at the grip at ``angle`` [rad]: of feel model, travel limits and bearing."""
    beyond = (limit.damping for limit in (p.feel.aft_limit, p.feel.forward_limit) if abs(angle) > limit.angle)
    return p.feel.damping + p.column.viscous_friction + sum(beyond)


def expected_response(p: Parameters, angle: float, times: Array) -> Array:
    """Column angle [rad] at ``times`` [s] after release at rest at ``angle`` [rad]; shape of ``times``.

    Solved piece by piece between reversals (an event of the integrator); at a reversal the body stays where it is if
    friction holds it.
    """
    from scipy.integrate import solve_ivp  # takes longer to import than a short run to simulate

    feel = p.feel
    inertia = feel.inertia + forward_inertia(p)
    friction = feel.friction + p.column.coulomb_friction
    external = feel.autopilot.torque + feel.disturbance.torque
    result = np.full_like(times, angle)
    now, x = 0.0, angle
    while now < times[-1]:
        net = external - spring_torque(feel, x)
        if abs(net) <= friction:
            result[times >= now] = x
            break
        way = np.sign(net)

        def slope(_: float, y: Array, way: float = way) -> list[float]:
            torque = external - spring_torque(feel, y[0]) - damping(p, y[0]) * y[1] - way * friction
            return [y[1], torque / inertia]

        def reversal(t: float, y: Array, way: float = way, begin: float = now) -> float:
            return y[1] * way if t > begin + 1e-6 else 1.0

        reversal.terminal = True  # type: ignore[attr-defined]
        reversal.direction = -1.0  # type: ignore[attr-defined]
        piece = solve_ivp(
            slope, (now, times[-1]), [x, 0.0], events=reversal, rtol=1e-8, atol=1e-10, max_step=0.01, dense_output=True
        )
        inside = (times >= now) & (times <= piece.t[-1])
        result[inside] = piece.sol(times[inside])[0]
        now, x = float(piece.t[-1]), float(piece.y[0, -1])
        if piece.status == 0:
            break
    return result


class Item(NamedTuple):
    """One quantity that Part 60 judges."""

    name: str
    measured: float
    expected: float
    tolerance: float

    @property
    def share(self) -> float:
        """Part of the tolerance that is used: up to 1 is within it."""
        return abs(self.measured - self.expected) / self.tolerance


class _Shape(NamedTuple):
    """Landmarks of a response that starts at 1 and ends at 0."""

    ninety: float  # time at which it falls below 0.9 [s]
    ten: float  # time at which it falls below 0.1 [s]
    crossings: Array  # times of the zero crossings [s]
    overshoots: Array  # largest excursions between the crossings [1]


BAND = 0.05
"""Residual band as a part of the amplitude: smaller oscillations are not judged."""


def _first_below(times: Array, x: Array, level: float) -> float:
    below = np.flatnonzero(x < level)
    if not len(below):
        return float("nan")
    k = int(below[0])
    if k == 0:
        return float(times[0])
    return float(np.interp(-level, [-x[k - 1], -x[k]], times[k - 1 : k + 1]))


def _shape(times: Array, x: Array) -> _Shape:
    crossings, overshoots = [], []
    at = np.flatnonzero(np.sign(x[:-1]) * np.sign(x[1:]) < 0)
    for begin, end in zip(at, [*at[1:], len(x) - 1], strict=False):
        excursion = float(np.max(np.abs(x[begin : end + 1])))
        if excursion < BAND:
            break
        overshoots.append(excursion)
        share = x[begin] / (x[begin] - x[begin + 1])
        crossings.append(float(times[begin] + share * (times[begin + 1] - times[begin])))
    return _Shape(_first_below(times, x, 0.9), _first_below(times, x, 0.1), np.array(crossings), np.array(overshoots))


def part60(times: Array, measured: Array, expected: Array) -> list[Item]:
    """The Part 60 quantities of a measured against an expected response; ``times`` [s], angles [rad], equal shapes.

    The amplitude A is taken from the start to the resting place of the expected response: with dry friction a control
    need not come back to neutral.
    """
    rest = float(expected[-1])
    amplitude = float(expected[0]) - rest
    got, want = _shape(times, (measured - rest) / amplitude), _shape(times, (expected - rest) / amplitude)
    residual = Item("residual", float(np.abs(measured[-1] - rest) / abs(amplitude)), 0.0, BAND)
    items = [residual]
    if len(want.crossings):
        n = min(len(want.crossings), len(got.crossings))
        items.append(Item("number of overshoots", len(got.overshoots), len(want.overshoots), 1.0))
        if not n:
            return [*items, Item("first zero crossing", float("inf"), want.crossings[0] - want.ninety, 0.1)]
        first = want.crossings[0] - want.ninety
        items.append(Item("time from 0.9 A to the first crossing", got.crossings[0] - got.ninety, first, 0.1 * first))
        for k in range(0, n - 2, 2):  # every second crossing ends a period
            period = k // 2 + 1
            expected_period = float(want.crossings[k + 2] - want.crossings[k])
            measured_period = float(got.crossings[k + 2] - got.crossings[k])
            items.append(
                Item(f"period {period}", measured_period, expected_period, 0.1 * (period + 1) * expected_period)
            )
        items.append(Item("first overshoot", got.overshoots[0], want.overshoots[0], 0.1 * want.overshoots[0]))
        items += (
            Item(f"overshoot {k + 1}", got.overshoots[k], want.overshoots[k], 0.1 * want.overshoots[0])
            for k in range(1, n)
        )
    else:
        fall = want.ten - want.ninety
        items.append(Item("time from 0.9 A to 0.1 A", got.ten - got.ninety, fall, 0.1 * fall))
        items.append(Item("overshoot where none is expected", float(max(got.overshoots, default=0.0)), 0.0, BAND))
    return items
