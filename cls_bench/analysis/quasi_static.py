"""What a feel model asks of a hand that leads the column slowly: torque over angle, with all history (figure 3.22).

The hand is stiff and infinitely slow, so the column is where the path says, and its damping is not felt. An aft body
follows through the linkage: it stays until the torque on it exceeds its friction, and then slides along the angles at
which both are equal. Where there is no such angle nearby (friction that falls when it moves, a detent that lets go, a
servo's reference far away) it jumps, and where it comes to rest is the motion of its own inertia with the column held.
In the limit of no speed Stribeck's friction is that at rest; one that falls at once is Coulomb's.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cls_bench.feel_laws import AFT, COLUMN, Laws
from cls_bench.parameters import Feel
from cls_bench.quantity import WIDEST

Array = NDArray[np.float64]

STEP = 2e-3
"""Longest step of the column [rad] from one equilibrium to the next; a tenth of a detent where that is less."""

SHORTEST = 1e-4
"""Shortest such step [rad]."""

AT_REST = 1e-5
"""Speed [rad/s] at which a jump is over."""

LONGEST, SWINGS = 20.0, 100
"""Time [s] and reversals after which a jump that finds no rest is taken to the nearest equilibrium."""

SHARE, NEAR = 0.2, 0.02
"""Time step of a jump in the time of its fastest motion; how near to its stop [rad] a body may reach it in one."""


def static_curve(feel: Feel, angles: Array, aft: float | None = None) -> Array:
    """Torque of the hand [N·m] along a path of column ``angles`` [rad], one after the other.

    The path is there and back to see friction and backlash. ``aft`` is where an aft body is at first; unless given, it
    begins at the column's angle and settles. NaN if the column is jammed: no torque leads it.
    """
    path = np.asarray(angles, dtype=float)
    laws = Laws(feel)
    torque = np.full(len(path), math.nan)
    if laws.jammed[COLUMN] or not len(path):
        return torque
    moves = path[np.flatnonzero(np.diff(path)) + 1][:1] - path[:1]
    way = float(np.sign(moves[0])) if len(moves) else 0.0
    led = Led(laws, float(path[0]), float(path[0]) if aft is None else aft)
    for k, angle in enumerate(path):
        if k and angle != path[k - 1]:
            way = math.copysign(1.0, angle - path[k - 1])
        led.to(float(angle))
        torque[k] = led.torque(way)
    return torque


class Led:
    """A feel model whose column a hand leads, and where its aft body is."""

    def __init__(self, laws: Laws, column: float, aft: float) -> None:
        self._laws, feel = laws, laws.feel
        self.column, self.aft = column, aft
        self._slides = 0.0  # the way in which the aft body slides; 0 at rest
        self._step = max(SHORTEST, min([STEP, *(0.1 * width for width in feel.detents.width)]))
        falls = laws.falls(AFT)
        self._steady = falls == math.inf or falls <= feel.aft.damping + feel.linkage.damping
        self._at_rest, self._sliding = laws.at_rest(AFT), slow_friction(laws, AFT)
        self._stiffness, self._damping = laws.fastest()
        if laws.two and not laws.jammed[AFT] and abs(self._net(aft)) > self._at_rest:
            self._jump(self._sign(aft))

    def torque(self, way: float) -> float:
        """Torque of the hand [N·m] that leads the column on its ``way``, ±1; 0 leaves the column's friction out."""
        link = self._laws.link(self.column - self.aft)
        return self._laws.column(self.column) + link + way * slow_friction(self._laws, COLUMN)

    def to(self, column: float) -> None:
        """Lead the column to an angle [rad]."""
        if not self._laws.two or self._laws.jammed[AFT]:
            self.column = column
            return
        start = self.column
        count = math.ceil(abs(column - start) / self._step)
        for k in range(1, count + 1):
            before, self.column = self.column, start + (column - start) * k / count
            self._follow(abs(self.column - before))

    def _net(self, aft: float) -> float:
        """Torque that drives the aft body where it were at ``aft``, friction left out."""
        return self._laws.link(self.column - aft) - self._laws.aft(aft)

    def _sign(self, aft: float) -> float:
        return math.copysign(1.0, self._net(aft))

    def _follow(self, moved: float) -> None:
        way = self._slides
        if way == 0.0 or way * self._net(self.aft) < self._sliding:  # at rest, or it comes to rest
            self._slides = 0.0
            if abs(self._net(self.aft)) <= self._at_rest:
                return
            way = self._sign(self.aft)
            if not self._steady or self._at_rest > self._sliding:
                self._jump(way)
                return
        self._slide(way, moved)

    def _slide(self, way: float, moved: float) -> None:
        """On to the first angle where friction and all else are equal, if that is reached without a jump."""
        # Before the column moved, nothing drove it on: more than the linkage can have added is the start of a jump.
        most = self._laws.feel.linkage.stiffness * moved * 1.001 + 1e-9
        low, excess = self.aft, way * self._net(self.aft) - self._sliding
        above = excess
        for _ in range(100):
            high = low + way * moved
            below = way * self._net(high) - self._sliding
            if below <= 0.0:
                self.aft = _root(lambda y: way * self._net(y) - self._sliding, low, high, above, below)
                self._slides = way
                return
            if below > most:
                break
            low, above = high, below
        self._jump(way)

    def _jump(self, way: float) -> None:
        """Let the aft body go where its inertia takes it, the column held."""
        left = LONGEST
        for _ in range(SWINGS):
            left -= self._swing(way, left)
            if left <= 0.0:
                break
            net = self._net(self.aft)
            left_over = 2.0 * self._damping * AT_REST  # what keeps it at the speed that counts as rest
            if abs(net) <= self._at_rest + left_over:
                slides = self._steady and abs(way * net - self._sliding) < left_over
                self._slides = way if slides else 0.0
                return
            way = math.copysign(1.0, net)
        self.aft, self._slides = _balanced(self._laws, self.column, self.aft), 0.0

    def _swing(self, way: float, longest: float) -> float:
        """Move the aft body until it stops (Runge-Kutta, fourth order); returns the time that it takes [s]."""
        laws, column, inertia = self._laws, self.column, self._laws.inertia[AFT]

        def acceleration(at: float, speed: float) -> float:
            net = laws.link(column - at, -speed) - laws.aft(at, speed)
            return (net - way * laws.friction(AFT, speed)) / inertia

        at, speed, time = self.aft, 0.0, 0.0
        while time < longest:
            h = self._moment(at, speed)
            a1 = acceleration(at, speed)
            v2 = speed + 0.5 * h * a1
            a2 = acceleration(at + 0.5 * h * speed, v2)
            v3 = speed + 0.5 * h * a2
            a3 = acceleration(at + 0.5 * h * v2, v3)
            v4 = speed + h * a3
            a4 = acceleration(at + h * v3, v4)
            after = speed + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            if way * after <= 0.0:  # it stops within the step, its speed falling on a straight line
                share = speed / (speed - after) if speed != after else 0.0
                self.aft = at + 0.5 * share * h * speed
                return time + share * h
            at += h / 6.0 * (speed + 2.0 * v2 + 2.0 * v3 + v4)
            slower = way * after < way * speed
            speed, time = after, time + h
            if slower and way * speed < AT_REST:
                break
        self.aft = at
        return time

    def _moment(self, at: float, speed: float) -> float:
        """Time step [s] in which the aft body's fastest motion about ``at`` is followed closely."""
        limit = self._laws.feel.aft_limit
        near = not -limit.back + NEAR < at < limit.angle - NEAR
        stiffness, damping = self._stiffness, self._damping
        if near:
            stiffness, damping = stiffness + limit.stiffness, damping + limit.damping
        if abs(speed) > 0.5 * self._laws.fastest_rate:
            damping += self._laws.rate_damping
        inertia = self._laws.inertia[AFT]
        return SHARE / (math.sqrt(stiffness / inertia) + damping / inertia)


def balanced(laws: Laws, column: float) -> float:
    """Where an aft body is in balance without friction [rad], the nearest place to the ``column`` that is."""
    return _balanced(laws, column, column)


def _balanced(laws: Laws, column: float, start: float) -> float:
    def net(aft: float) -> float:
        return laws.link(column - aft) - laws.aft(aft)

    way, low = math.copysign(1.0, net(start)), start
    while abs(low) < WIDEST:
        high = low + way * STEP
        above, below = way * net(low), way * net(high)
        if below <= 0.0:
            return _root(lambda y: way * net(y), low, high, above, below)
        low = high
    return start


def slow_friction(laws: Laws, body: int) -> float:
    """Friction [N·m] of a body that is led slowly: at rest's, unless it falls at once."""
    return laws.friction(body, 0.0)


def _root(excess: Callable[[float], float], low: float, high: float, above: float, below: float) -> float:
    """Where ``excess`` comes down to zero between ``low`` and ``high``, where it is ``above`` and ``below`` it.

    Regula falsi (Illinois): at once where the excess is straight.
    """
    if above <= 0.0:
        return low
    for _ in range(100):
        at = (low * below - high * above) / (below - above)
        value = excess(at)
        if abs(value) < 1e-12:
            return at
        if value > 0.0:
            low, above, below = at, value, 0.5 * below
        else:
            high, below, above = at, value, 0.5 * above
        if abs(high - low) < 1e-14:
            break
    return low
