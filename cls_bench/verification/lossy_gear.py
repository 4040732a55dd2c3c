"""A rigid gear with losses between two inertias, solved from event to event.

One degree of freedom, the load's angle φ; the input turns r times as far::

    J₁ r φ̈ = τ₁ − F − T/r,    J₂ φ̈ = T + τ₂

T is what the mesh carries, at the output. The friction F at the input opposes the motion with drag + μ |T|/r, either
with a value for the motor driving the load (F T > 0) and one for the load driving the motor (F T < 0), as Modelica's
LossyGear has it. While sliding, T and with it φ̈ follow from the two equations for whichever of the two is true. At rest
friction is what rest needs, T = −τ₂, as long as it does not exceed its level.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

Array = NDArray[np.float64]


def _demo_input(t: float) -> float:
    return 10.0 * math.sin(2.0 * math.pi * t)


def _demo_load(t: float) -> float:
    return -10.0 + 2.5 * t


class Gear(NamedTuple):
    """Modelica's LossyGearDemo1, unless told otherwise."""

    before: float = 1.0  # inertias [kg·m²]
    behind: float = 1.5
    ratio: float = 2.0
    loss: float = 1.0  # 1/η − 1, motor driving
    loss_back: float = 0.5  # 1 − η, load driving
    drag: float = 0.0  # [N·m]
    drag_back: float = 0.0
    input: Callable[[float], float] = _demo_input  # torques over time [N·m]
    load: Callable[[float], float] = _demo_load


class Motion(NamedTuple):
    """Of the load."""

    time: Array
    angle: Array
    speed: Array
    events: tuple[tuple[float, bool], ...]
    """(time, True if it came to rest then, False if it left it)"""


def _sliding(gear: Gear, t: float, way: float, driving: bool) -> tuple[float, float]:
    """Acceleration and torque of the mesh while it slides in the direction ``way``, the one or the other driving."""
    r, load = gear.ratio, gear.load(t)
    # way · T is positive while the motor drives; F = way · (drag + loss |T|/r) = way · drag + sign · loss · T/r
    drag, share = (gear.drag, 1.0 + gear.loss) if driving else (gear.drag_back, 1.0 - gear.loss_back)
    acceleration = (gear.input(t) - way * drag + share * load / r) / (gear.before * r + share * gear.behind / r)
    return acceleration, gear.behind * acceleration - load


def _breaks_away(gear: Gear, t: float) -> float:
    """By how much [N·m] the friction that rest needs exceeds what there is; negative at rest."""
    carried = -gear.load(t)
    needed = gear.input(t) - carried / gear.ratio
    driving = needed * carried > 0.0
    drag, loss = (gear.drag, gear.loss) if driving else (gear.drag_back, gear.loss_back)
    return abs(needed) - drag - loss * abs(carried) / gear.ratio


def follow(gear: Gear, duration: float, *, step: float = 1e-4) -> Motion:
    """The motion from rest at t = 0, sampled every ``step`` [s]."""
    grid = np.asarray(np.arange(round(duration / step) + 1) * step, dtype=np.float64)
    angles, speeds = np.zeros(len(grid)), np.zeros(len(grid))
    t, angle, speed, way = 0.0, 0.0, 0.0, 0.0
    events: list[tuple[float, bool]] = []
    while t < duration:
        if way == 0.0:
            till = _rest_until(gear, t, duration, step)
            inside = (grid >= t) & (grid <= till)
            angles[inside] = angle
            t = till
            if t < duration:
                way = math.copysign(1.0, gear.input(t) + gear.load(t) / gear.ratio)
                if t > 0.0:
                    events.append((t, False))
            continue
        driving = way * _sliding(gear, t, way, True)[1] > 0.0

        def motion(at: float, y: Array, way: float = way, driving: bool = driving) -> Array:
            return np.array([y[1], _sliding(gear, at, way, driving)[0]])

        def stops(at: float, y: Array, way: float = way) -> float:
            return float(way * y[1])

        def turns(at: float, y: Array, way: float = way, driving: bool = driving) -> float:
            return way * _sliding(gear, at, way, driving)[1]

        stops.terminal, stops.direction = True, -1.0  # type: ignore[attr-defined]
        turns.terminal, turns.direction = True, -1.0 if driving else 1.0  # type: ignore[attr-defined]
        solution = solve_ivp(
            motion, (t, duration), [angle, speed], events=(stops, turns), rtol=1e-11, atol=1e-14, dense_output=True,
            max_step=1e-3,
        )  # fmt: skip
        end = float(solution.t[-1])
        inside = (grid >= t) & (grid <= end)
        angles[inside], speeds[inside] = solution.sol(grid[inside])
        t, angle, speed = end, float(solution.y[0, -1]), float(solution.y[1, -1])
        if len(solution.t_events[0]):
            speed, way = 0.0, 0.0
            events.append((t, True))
        elif len(solution.t_events[1]):
            t += 1e-12  # on the other side, where the other of the two drives
    return Motion(grid, angles, speeds, tuple(events))


def _rest_until(gear: Gear, t: float, duration: float, step: float) -> float:
    """When rest ends [s]."""
    if _breaks_away(gear, t) > 0.0:
        return t
    for later in np.arange(t + step, duration + step, step):
        if _breaks_away(gear, later) > 0.0:
            return float(brentq(lambda x: _breaks_away(gear, x), later - step, later, xtol=1e-14))
    return duration
