"""Free response of the column after release: the expected one by an independent solution, and the Part 60 tolerances.

Expected is Eq. 3.15 of the thesis with all elements of the feel model, as one body or two, solved here by scipy, apart
from the controller's own code (the laws are :mod:`cls_bench.feel_laws`). The column's body has the inertia,
damping and friction of the feel model and of all that is forward of the load cell::

    (I_fcs + I_fwd) φ̈ + (d_fcs + d_fwd) φ̇ + springs, limits, linkage … + friction = T

14 CFR Part 60, table A2A, dynamic tests 2.b.1 to 2.b.3, judges the response of an underdamped control by the time to
the first crossing, the periods after it, the overshoots and their number, of an overdamped one by the time from 90 % to
10 % of the amplitude, and by its having no overshoot.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.analysis.quasi_static import Led
from cls_bench.feel_laws import AFT, COLUMN, Laws
from cls_bench.parameters import Parameters

Array = NDArray[np.float64]

DEPARTURE = 1e-12
"""Speed [rad/s] that a body is given as friction lets it go, so that rounding does not stop it at once."""

SLACK = 1e-9
"""Torque [N·m] beyond friction at which a body at rest is let go: above rounding where both are equal at first."""

STIFF = 1e3
"""Decay [1/s] of a body's motion above which an explicit method's steps would be needlessly short."""

PIECES = 10_000
"""Most pieces between reversals: far more than any response has that anyone would want to see."""


def forward_inertia(p: Parameters) -> float:
    """I_fwd [kg·m²]: column and rod end, all that is forward of the strain gauge."""
    return p.column.inertia + p.linkage.masses[2] * p.linkage.arm**2


def damping(p: Parameters, angle: float) -> float:
    """Viscous damping [N·m·s/rad] at the grip as the column passes ``angle`` [rad] slowly: of feel model and bearing.

    An aft body follows the column by the share r of its motion that linkage and springs leave it: it is felt as r² of
    its damping, and the linkage's as (1 − r)².
    """
    laws = Laws(p.feel)
    led = Led(laws, p.feel.neutral, p.feel.neutral)
    led.to(angle)
    at = laws.slopes(angle, led.aft)
    whole = p.column.viscous_friction + at.column_damping
    if at.link == 0.0 or laws.jammed[AFT]:
        return whole + at.link_damping
    follows = at.link / (at.link + at.aft)
    return whole + follows**2 * at.aft_damping + (1.0 - follows) ** 2 * at.link_damping


def expected_response(p: Parameters, angle: float, times: Array, aft: float | None = None) -> Array:
    """Column angle [rad] at ``times`` [s] after release at rest at ``angle`` [rad]; shape of ``times``.

    ``aft`` is where an aft body is released [rad]; unless given, where it is when a hand has led the column slowly from
    neutral to ``angle``.
    """
    laws = Laws(p.feel)
    if aft is None:
        led = Led(laws, p.feel.neutral, p.feel.neutral)
        led.to(angle)
        aft = led.aft
    return _Released(p, laws).motion(angle, aft, times)


class _Released:
    """The bodies after their release, solved piece by piece between the instants at which one stops or is let go."""

    def __init__(self, p: Parameters, laws: Laws) -> None:
        self._laws = laws
        self._bodies = range(2 if laws.two else 1)
        bearing, forward = p.column, forward_inertia(p)
        self._viscous = bearing.viscous_friction
        self._dry = (bearing.coulomb_friction, 0.0)
        self._inertia = (laws.inertia[COLUMN] + forward, laws.inertia[AFT])

    def _net(self, y: Sequence[float] | Array) -> tuple[float, float]:
        """Torque on each body but for friction; ``y`` is angle and velocity of the column's body, then of the aft one.
        """
        column, aft = self._laws.net(float(y[0]), float(y[1]), float(y[2]), float(y[3]))
        return column - self._viscous * float(y[1]), aft

    def _at_rest(self, body: int) -> float:
        return math.inf if self._laws.jammed[body] else self._laws.at_rest(body) + self._dry[body]

    def motion(self, angle: float, aft: float, times: Array) -> Array:
        from scipy.integrate import solve_ivp  # takes longer to import than a short run to simulate

        result = np.full_like(times, angle)
        now, y, ways = 0.0, np.array([angle, 0.0, aft, 0.0]), [0.0, 0.0]
        torn: int | None = None
        for _ in range(PIECES):
            net = self._net(y)
            for body in self._bodies:
                held = self._at_rest(body)
                if ways[body] == 0.0 and (body == torn or held == 0.0 or abs(net[body]) > held):
                    ways[body] = math.copysign(1.0, net[body])
                    y[2 * body + 1] = ways[body] * DEPARTURE
            if not any(ways):
                break
            events, bodies = self._events(ways)
            piece = solve_ivp(
                self._rate(ways), (now, float(times[-1])), y, self._method(y), events=events, rtol=1e-10, atol=1e-12,
                max_step=0.01, dense_output=True,
            )  # fmt: skip
            inside = (times >= now) & (times <= piece.t[-1])
            if np.any(inside):
                result[inside] = piece.sol(times[inside])[0]
            now, y, torn = float(piece.t[-1]), np.array(piece.y[:, -1]), None
            if piece.status == 0 or now >= times[-1]:
                break
            body = next(body for body, found in zip(bodies, piece.t_events, strict=True) if len(found))
            if ways[body] == 0.0:
                torn = body
            else:
                ways[body], y[2 * body + 1] = 0.0, 0.0
        result[times > now] = y[0]
        return result

    def _method(self, y: Array) -> str:
        """Explicit, or, where a body's damping is great for its inertia, implicit where it has to be."""
        at = self._laws.slopes(float(y[0]), float(y[2]))
        column, aft = at.column_damping + at.link_damping, at.aft_damping + at.link_damping
        decays = column / self._inertia[COLUMN], aft / self._inertia[AFT] if self._laws.two else 0.0
        return "LSODA" if max(decays) > STIFF else "DOP853"

    def _rate(self, ways: Sequence[float]) -> Callable[[float, Array], list[float]]:
        laws, ways = self._laws, tuple(ways)

        def rate(_: float, y: Array) -> list[float]:
            net, found = self._net(y), [0.0, 0.0, 0.0, 0.0]
            for body in self._bodies:
                if ways[body] != 0.0:
                    speed = float(y[2 * body + 1])
                    friction = laws.friction(body, speed) + self._dry[body]
                    found[2 * body] = speed
                    found[2 * body + 1] = (net[body] - ways[body] * friction) / self._inertia[body]
            return found

        return rate

    def _events(self, ways: Sequence[float]) -> tuple[list[Callable[[float, Array], float]], list[int]]:
        """Of each body that may have one: it stops, or the other tears it away."""

        def event(body: int, way: float) -> Callable[[float, Array], float]:
            def stops(_: float, y: Array) -> float:
                return float(y[2 * body + 1]) * way

            def torn(_: float, y: Array) -> float:
                return self._at_rest(body) + SLACK - abs(self._net(y)[body])

            found = torn if way == 0.0 else stops
            found.terminal, found.direction = True, -1.0  # type: ignore[attr-defined]
            return found

        bodies = [body for body in self._bodies if ways[body] != 0.0 or not self._laws.jammed[body]]
        return [event(body, ways[body]) for body in bodies], bodies


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
