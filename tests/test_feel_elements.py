"""Every feel element alone, against a closed form; and for each parameter a motion that only its right value makes.

An oracle is a function of the parameters that knows nothing of the solver: a closed form of the motion that follows
from the element's law. Each parameter has a case: a model, a change of it, and the oracle that follows both. So a law
that ignored the parameter, or took it for another, would miss one of the two motions by a thousand tolerances.
"""

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.linalg import expm
from scipy.signal import tf2ss, welch
from scipy.special import ellipj, ellipk

from cls_bench.feel import solver
from cls_bench.feel.elements.gust import Gust
from cls_bench.parameters import Feel
from cls_bench.quantity import leaves
from tests.oracles.feel_driver import CYCLE, Model, feel_of, motion
from tests.oracles.feel_reference import reference

COUNT = 250
"""Cycles of a case: 0.1 s."""

BARE = {
    "stiffness": 0.0, "damping": 0.0, "friction": 0.0, "aft_limit.angle": 2.0, "forward_limit.angle": 2.0,
    "aft.friction": 0.0, "aft.damping": 0.0, "linkage.damping": 0.0,
}  # fmt: skip
"""Nothing acts on the body, or on either of two."""

Rows = np.ndarray[Any, np.dtype[np.float64]]


def after(count: int = COUNT) -> Rows:
    """Times at the end of the cycles [s]."""
    return CYCLE * np.arange(1, count + 1)


def driven(inertia: float, damping: float, stiffness: float, inputs: Any, x: float, v: float) -> Rows:
    """Angle and velocity of I φ¨ + d φ˙ + c φ = T with T held over each cycle: exact."""
    a = np.array([[0.0, 1.0, 0.0], [-stiffness / inertia, -damping / inertia, 1.0 / inertia], [0.0, 0.0, 0.0]])
    once = expm(a * CYCLE)
    rows = []
    for torque in inputs:
        x, v, _ = once @ [x, v, torque]
        rows.append([x, v])
    return np.array(rows)


def pushed(inertia: float, torque: float, x: float = 0.0, v: float = 0.0) -> Rows:
    """Angle and velocity of a body under a constant torque."""
    t = after()
    return np.stack([x + v * t + 0.5 * torque / inertia * t**2, v + torque / inertia * t], axis=1)


@dataclass
class Case:
    """A model, the closed form of its motion, and how each of some parameters is changed in it."""

    base: Mapping[str, Any]
    oracle: Callable[[Feel], Rows]
    changes: Mapping[str, Any]
    start: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
    torque: float = 0.0
    columns: tuple[int, ...] = (0, 1)
    tolerance: float = 2e-11
    before: Mapping[str, Any] = field(default_factory=dict)
    """parameters that are otherwise in the first cycle"""
    white: Sequence[float] | None = None

    def feel(self, **changed: Any) -> Feel:
        return feel_of({**BARE, **self.base, **changed})

    def moved(self, f: Feel, changed: Mapping[str, Any]) -> Rows:
        schedule: Any = f
        if self.before:
            schedule = [(0, self.feel(**{**changed, **self.before})), (1, f)]
        rows = motion(schedule, self.torque, COUNT, self.start, white=self.white)
        return rows[:, list(self.columns)]


# --- linear elements of one body -------------------------------------------------------------------------------------

ALL_LINEAR = {
    "inertia": 0.25, "damping": 1.2, "stiffness": 22.0, "neutral": 0.04, "flight.dynamic_pressure": 4000.0,
    "flight.airspeed": 80.0, "flight.angle_of_attack": 0.1, "flight.load_factor": 1.3, "flight.tab": 0.08,
    "q_feel.gradient": 0.003, "q_feel.most": 50.0, "hydraulics.pressure": 0.7, "hydraulics.feel_share": 0.8,
    "hydraulics.off_damping": 2.0, "surface.area": 1.4, "surface.chord": 0.3, "surface.hinge_zero": 0.002,
    "surface.hinge_alpha": -0.01, "surface.hinge_deflection": -0.02, "surface.hinge_tab": 0.015,
    "surface.hinge_rate": -8.0, "surface.boost": 0.4, "surface.gearing": 1.2, "unbalance.torque": 0.4,
    "unbalance.gradient": 3.0, "unbalance.level": 0.05, "bob_weight.torque": -0.6, "down_spring.torque": 0.5,
    "disturbance.torque": 0.3, "autopilot.torque": -0.7,
}  # fmt: skip


def all_linear(f: Feel) -> Rows:
    """Stiffness, damping and torque of a single body with every linear element, from their laws; then exactly."""
    fl, s, h = f.flight, f.surface, f.hydraulics
    load = fl.dynamic_pressure * s.area * s.chord * (1.0 - s.boost * h.pressure) * s.gearing
    left = (1.0 - h.feel_share) + h.feel_share * h.pressure
    q_feel = min(f.q_feel.gradient * fl.dynamic_pressure, f.q_feel.most)
    unit = 0.0 if f.trim.released else left * (f.stiffness + q_feel)
    stiffness = unit - load * s.hinge_deflection * s.gearing - fl.load_factor * f.unbalance.gradient
    damping = f.damping + (1.0 - h.pressure) * h.off_damping
    damping += f.trim.release_damping if f.trim.released else 0.0
    damping -= load * s.hinge_rate * s.chord / (2.0 * fl.airspeed) * s.gearing
    torque = unit * f.neutral + load * (s.hinge_zero + s.hinge_alpha * fl.angle_of_attack + s.hinge_tab * fl.tab)
    torque += fl.load_factor * (f.unbalance.torque - f.unbalance.gradient * f.unbalance.level + f.bob_weight.torque)
    torque += f.down_spring.torque + f.disturbance.torque + f.autopilot.torque
    return driven(f.inertia, damping, stiffness, np.full(COUNT, 1.5 + torque), 0.02, 0.3)


LINEAR = Case(
    ALL_LINEAR, all_linear, {**{key: 1.05 * value for key, value in ALL_LINEAR.items()}, "surface.boost": 0.5,
                             "q_feel.most": 8.0, "trim.released": True},
    start=(0.02, 0.3), torque=1.5,
)  # fmt: skip
RELEASED = Case({**ALL_LINEAR, "trim.released": True}, all_linear, {"trim.release_damping": 2.0}, (0.02, 0.3), 1.5)


# --- friction --------------------------------------------------------------------------------------------------------


def coulomb(f: Feel) -> Rows:
    """A spring and Coulomb's friction from rest: half swings about ±μ/c, until one ends within the stiction band."""
    omega, shift, rows = math.sqrt(f.stiffness / f.inertia), f.friction / f.stiffness, []
    for t in after():
        x, half = 0.16, 0
        while abs(f.stiffness * x) > max(f.friction, f.static_friction):
            centre = math.copysign(shift, x)
            if t < (half + 1) * math.pi / omega:
                phase = omega * t - half * math.pi
                rows.append([centre + (x - centre) * math.cos(phase), -omega * (x - centre) * math.sin(phase)])
                break
            x, half = 2.0 * centre - x, half + 1
        else:
            rows.append([x, 0.0])
    return np.array(rows)


COULOMB = Case({"inertia": 0.02, "stiffness": 40.0, "friction": 0.9}, coulomb, {"friction": 1.1, "stiffness": 45.0},
               start=(0.16,))  # fmt: skip
STATIC = Case(
    {"inertia": 0.02, "stiffness": 40.0, "friction": 0.9, "static_friction": 1.2}, coulomb, {"static_friction": 4.8},
    start=(0.16,),
)  # fmt: skip


def stribeck(inertia: float, mu: float, static: float, speed: float, v: float) -> Rows:
    """Velocity under friction alone: with u = exp(v/v_s), I v_s u' = −(μ u + Δ), which is linear."""
    delta, t = max(static - mu, 0.0), after()
    u = (math.exp(v / speed) + delta / mu) * np.exp(-mu * t / (inertia * speed)) - delta / mu
    return np.where(u > 1.0, speed * np.log(np.maximum(u, 1.0)), 0.0)[:, None]


STRIBECK = Case(
    {"friction": 0.4, "static_friction": 0.9, "stribeck_velocity": 0.05},
    lambda f: stribeck(f.inertia, f.friction, f.static_friction, f.stribeck_velocity, 0.15),
    {"stribeck_velocity": 0.06, "static_friction": 1.0, "friction": 0.5, "inertia": 0.31},
    start=(0.0, 0.15), columns=(1,),
)  # fmt: skip
STEEP = Case({**STRIBECK.base, "stribeck_velocity": 2e-3}, STRIBECK.oracle, {"stribeck_velocity": 3e-3},
             STRIBECK.start, columns=(1,))  # fmt: skip
AFT_STRIBECK = Case(
    {"bodies": "two", "linkage.connected": False, "aft.friction": 0.4, "aft.static_friction": 0.9,
     "aft.stribeck_velocity": 0.05},
    lambda f: stribeck(f.aft.inertia, f.aft.friction, f.aft.static_friction, f.aft.stribeck_velocity, 0.15),
    {"aft.stribeck_velocity": 0.06, "aft.static_friction": 1.0, "aft.friction": 0.5, "aft.inertia": 0.3},
    start=(0.0, 0.0, 0.0, 0.15), columns=(3,),
)  # fmt: skip

# --- springs that end, detents, gearing ------------------------------------------------------------------------------


def centering(f: Feel) -> Rows:
    """Constant torque beyond the width, a swing within it."""
    k, most = f.centering.stiffness, f.centering.breakout
    width, x0 = most / k, 0.08
    begun = math.sqrt(2.0 * (x0 - width) * f.inertia / most)
    omega, rows = math.sqrt(k / f.inertia), []
    for t in after():
        if t < begun:
            rows.append([x0 - 0.5 * most / f.inertia * t**2, -most / f.inertia * t])
        else:
            v, s = -most / f.inertia * begun, t - begun
            rows.append([width * math.cos(omega * s) + v / omega * math.sin(omega * s),
                         v * math.cos(omega * s) - width * omega * math.sin(omega * s)])  # fmt: skip
    assert rows[-1][0] > -width
    assert rows[-1][0] < width
    return np.array(rows)


CENTERING = Case({"inertia": 0.1, "centering.stiffness": 50.0, "centering.breakout": 3.0}, centering,
                 {"centering.stiffness": 60.0, "centering.breakout": 2.7}, start=(0.08,))  # fmt: skip


def pendulum(f: Feel) -> Rows:
    """A body in a detent's sine is a pendulum; with a profile from 1 to −1 it is on a spring."""
    place, width, torque = f.detents.place[0], f.detents.width[0], f.detents.torque[0]
    t, x0 = after(), 0.045
    if f.detents.profile:
        assert f.detents.profile == (1.0, -1.0)
        omega = math.sqrt(2.0 * torque / width / f.inertia)
        return np.stack([place + (x0 - place) * np.cos(omega * t), -omega * (x0 - place) * np.sin(omega * t)], axis=1)
    wave = 2.0 * math.pi / width
    omega, m = math.sqrt(torque * wave / f.inertia), math.sin(0.5 * wave * (x0 - place)) ** 2
    sn, cn, _, _ = ellipj(ellipk(m) - omega * t, m)
    side = math.copysign(1.0, x0 - place)
    angle = place + side * 2.0 / wave * np.arcsin(math.sqrt(m) * sn)
    return np.stack([angle, -side * 2.0 * math.sqrt(m) * omega * cn / wave], axis=1)


DETENTS = Case(
    {"inertia": 0.1, "detents.place": [0.03], "detents.width": [0.06], "detents.torque": [1.5]}, pendulum,
    {"detents.place": [0.032], "detents.width": [0.065], "detents.torque": [1.7], "detents.profile": [1.0, -1.0]},
    start=(0.045,),
)  # fmt: skip


def geared(f: Feel) -> Rows:
    """A constant hinge moment through a table: one constant torque before its bend and another one after."""
    (a, b, c), (p, q, r) = f.surface.control_angle, f.surface.deflection
    moment = f.flight.dynamic_pressure * f.surface.area * f.surface.chord * f.surface.hinge_zero
    first, second = ((q - p) / (b - a) * moment / f.inertia, (r - q) / (c - b) * moment / f.inertia)
    v0, rows = 1.0, []
    begun = (-v0 + math.sqrt(v0**2 + 2.0 * first * b)) / first
    for t in after():
        s = max(t - begun, 0.0)
        t1 = min(t, begun)
        v1 = v0 + first * t1
        rows.append([v0 * t1 + 0.5 * first * t1**2 + v1 * s + 0.5 * second * s**2, v1 + second * s])
    return np.array(rows)


GEARED = Case(
    {"flight.dynamic_pressure": 2000.0, "surface.area": 1.0, "surface.chord": 0.5, "surface.hinge_zero": 0.004,
     "surface.control_angle": [-0.1, 0.05, 0.3], "surface.deflection": [-0.05, 0.1, 0.6]},
    geared, {"surface.control_angle": [-0.1, 0.06, 0.3], "surface.deflection": [-0.05, 0.12, 0.6]}, start=(0.0, 1.0),
)  # fmt: skip

# --- travel limits ---------------------------------------------------------------------------------------------------


def bounced(inertia: float, limit: Any, side: float) -> Rows:
    """Free flight, a damped half swing that ends where the stop would pull, and free flight again."""
    angle = limit.angle if side > 0.0 else limit.back
    v0, a, rows = 1.5, 0.5 * limit.damping / inertia, []
    omega = math.sqrt(limit.stiffness / inertia - a * a)
    begun = angle / v0
    long = math.atan2(2.0 * a * omega, a * a - omega * omega) / omega

    def within(s: float) -> tuple[float, float]:
        fade = v0 * math.exp(-a * s)
        return fade / omega * math.sin(omega * s), fade * (math.cos(omega * s) - a / omega * math.sin(omega * s))

    for t in after():
        if t < begun:
            rows.append([v0 * t, v0])
        else:
            e, v = within(min(t - begun, long))
            rows.append([angle + e + v * max(t - begun - long, 0.0), v])
    assert after()[-1] > begun + long
    return side * np.array(rows)


def stops(name: str, side: float, changes: Sequence[str]) -> Case:
    base = {"inertia": 0.1, "aft_limit.angle": 0.06, "aft_limit.back_angle": 0.05, "aft_limit.stiffness": 300.0,
            "aft_limit.damping": 3.0}  # fmt: skip
    if name == "forward_limit":
        base = {key.replace("aft_", "forward_"): value for key, value in base.items()} | {
            "aft_limit.angle": 0.03, "aft_limit.stiffness": 0.0, "aft_limit.damping": 0.0,
        }  # fmt: skip
    return Case(base, lambda f: bounced(f.inertia, getattr(f, name), side),
                {f"{name}.{key}": 1.1 * base[f"{name}.{key}"] for key in changes}, start=(0.0, 1.5 * side))  # fmt: skip


STOPS = [
    stops(name, side, changes) for name, (side, changes) in itertools.product(
        ("aft_limit", "forward_limit"), ((1.0, ("angle", "stiffness", "damping")), (-1.0, ("back_angle",))))
]  # fmt: skip

# --- hydraulics ------------------------------------------------------------------------------------------------------

OFF_FRICTION = Case(
    {"hydraulics.pressure": 0.25, "hydraulics.off_friction": 1.2, "friction": 0.3},
    lambda f: pushed(f.inertia, -f.friction - (1.0 - f.hydraulics.pressure) * f.hydraulics.off_friction, 0.0, 0.9),
    {"hydraulics.off_friction": 1.4, "hydraulics.pressure": 0.5}, start=(0.0, 0.9),
)  # fmt: skip


def rate_limited(f: Feel) -> Rows:
    """Under a torque that is constant: free up to the rate, and then into the oil's damper."""
    h, torque, t = f.hydraulics, 6.0, after()
    most = h.maximum_rate * math.sqrt(h.pressure)
    begun = most * f.inertia / torque
    damping = h.pressure * h.rate_damping
    s, pole = np.maximum(t - begun, 0.0), damping / f.inertia
    beyond = torque / damping
    x = 0.5 * torque / f.inertia * np.minimum(t, begun) ** 2 + most * s
    x += beyond * (s - (1.0 - np.exp(-pole * s)) / pole)
    v = np.where(t < begun, torque / f.inertia * t, most + beyond * (1.0 - np.exp(-pole * s)))
    return np.stack([x, v], axis=1)


RATE = Case(
    {"hydraulics.pressure": 0.49, "hydraulics.maximum_rate": 0.5, "hydraulics.rate_damping": 20.0}, rate_limited,
    {"hydraulics.maximum_rate": 0.6, "hydraulics.rate_damping": 25.0, "hydraulics.pressure": 0.64}, torque=6.0,
)  # fmt: skip

# --- commands: what is held over each cycle --------------------------------------------------------------------------

CYCLES = np.arange(COUNT)


def trimmed(f: Feel) -> Rows:
    """The zero climbs from 0 by rate · cycle each cycle from the second one on."""
    zero = np.minimum(f.trim.rate * CYCLE * CYCLES, f.neutral)
    return driven(f.inertia, 0.0, f.stiffness, f.stiffness * zero, 0.0, 0.0)


TRIM = Case({"stiffness": 60.0, "trim.rate": 0.8, "neutral": 0.05}, trimmed,
            {"trim.rate": 0.9, "neutral": 0.06}, before={"neutral": 0.0})  # fmt: skip


def led(f: Feel) -> Rows:
    """The servo is a spring and a damper about a reference that climbs from where it took over."""
    a = f.autopilot
    if not a.engaged:
        return pushed(f.inertia, 0.0, 0.02)
    lead = np.minimum(0.02 + a.rate * CYCLE * (CYCLES + 1), a.reference)
    rate = np.diff(lead, prepend=0.02) / CYCLE
    return driven(f.inertia, a.damping, a.stiffness, a.stiffness * lead + a.damping * rate, 0.02, 0.0)


AUTOPILOT = Case(
    {"autopilot.engaged": True, "autopilot.reference": 0.06, "autopilot.rate": 0.9, "autopilot.stiffness": 80.0,
     "autopilot.damping": 5.0, "autopilot.clutch": 100.0},
    led, {"autopilot.engaged": False, "autopilot.reference": 0.055, "autopilot.rate": 0.8, "autopilot.stiffness": 90.0,
          "autopilot.damping": 6.0}, start=(0.02,),
)  # fmt: skip
CLUTCH = Case(
    {"autopilot.engaged": True, "autopilot.reference": 1.0, "autopilot.rate": 0.0, "autopilot.clutch": 2.0},
    lambda f: pushed(f.inertia, f.autopilot.clutch), {"autopilot.clutch": 2.2},
)  # fmt: skip


def ramped(aims: Any, step: float) -> Rows:
    """A level that follows its aim by ``step`` a cycle at most."""
    level, found = 0.0, []
    for aim in aims:
        level = min(level + step, aim) if aim > level else max(level - step, aim)
        found.append(level)
    return np.array(found)


def shaken(f: Feel) -> Rows:
    s, time = f.shaker, CYCLE * CYCLES
    on = np.mod(time, s.period) < s.duty * s.period
    level = ramped(np.where(on, s.torque, 0.0), s.torque / s.ramp * CYCLE)
    return driven(f.inertia, 0.0, 0.0, level * np.sin(2.0 * np.pi * s.frequency * time), 0.0, 0.0)


SHAKER = Case(
    {"shaker.torque": 3.0, "shaker.frequency": 22.0, "shaker.ramp": 0.013, "shaker.duty": 0.6, "shaker.period": 0.05},
    shaken, {"shaker.torque": 3.3, "shaker.frequency": 20.0, "shaker.ramp": 0.02, "shaker.duty": 0.7,
             "shaker.period": 0.06},
)  # fmt: skip


def pushes(f: Feel) -> Rows:
    p = f.pusher
    on = (p.longest > CYCLES * CYCLE) & p.engaged
    level = ramped(np.where(on, p.torque, 0.0), p.torque / p.ramp * CYCLE)
    return driven(f.inertia, 0.0, 0.0, level, 0.0, 0.0)


PUSHER = Case(
    {"pusher.engaged": True, "pusher.torque": 5.0, "pusher.ramp": 0.02, "pusher.longest": 0.0499}, pushes,
    {"pusher.engaged": False, "pusher.torque": 6.0, "pusher.ramp": 0.03, "pusher.longest": 0.0599},
)  # fmt: skip
VIBRATION = Case(
    {"disturbance.vibration": 2.0, "disturbance.frequency": 14.0},
    lambda f: driven(f.inertia, 0.0, 0.0, f.disturbance.vibration * np.sin(2 * np.pi * f.disturbance.frequency * CYCLE
                                                                          * CYCLES), 0.0, 0.0),
    {"disturbance.vibration": 2.2, "disturbance.frequency": 15.0},
)  # fmt: skip

DRYDEN = [math.sqrt(3.0), 1.0], [1.0, 2.0, 1.0]
KARMAN = [0.3398, 2.7478, 1.0], [0.1539, 1.9754, 2.9958, 1.0]
WHITE = np.random.default_rng(11).standard_normal(COUNT)


def karman_rms() -> float:
    """R.m.s. of the rational form, driven by white noise: ∫ |G|² dω / 2π over all ω, with ω = tan θ."""
    w = np.tan((np.arange(2000) + 0.5) / 2000 * 0.5 * np.pi)
    found = np.abs(np.polyval(KARMAN[0], 1j * w) / np.polyval(KARMAN[1], 1j * w)) ** 2 * (1.0 + w * w)
    return math.sqrt(np.mean(found) * 0.5)


def gusty(f: Feel) -> Rows:
    """Midpoint rule on the filter in state space, as scipy makes it of the transfer function."""
    numerator, denominator = DRYDEN if f.gust.spectrum == "dryden" else KARMAN
    a, b, c, _ = tf2ss(numerator, denominator)
    step = CYCLE * f.flight.airspeed / f.gust.length
    one = np.eye(len(a))
    x, torques = np.zeros((len(a), 1)), []
    for white in WHITE:
        x = np.linalg.solve(one - 0.5 * step * a, (one + 0.5 * step * a) @ x + math.sqrt(step) * white * b)
        torques.append(f.gust.torque * float((c @ x)[0, 0]))
    scale = 1.0 if f.gust.spectrum == "dryden" else 1.0 / karman_rms()
    return driven(f.inertia, 0.0, 0.0, scale * np.array(torques), 0.0, 0.0)


GUST = Case(
    {"gust.torque": 4.0, "gust.length": 60.0, "flight.airspeed": 70.0}, gusty,
    {"gust.torque": 4.4, "gust.length": 70.0, "flight.airspeed": 80.0, "gust.spectrum": "von_karman"}, white=WHITE,
)  # fmt: skip

# --- two bodies ------------------------------------------------------------------------------------------------------


def coupled(f: Feel) -> Rows:
    """Two bodies and a linkage that is always taut; or one body, which is but the first's."""
    if f.bodies == "one":
        return np.tile(pushed(f.inertia, 2.0, 0.01, 0.4), 2)
    k, d = f.linkage.stiffness, f.linkage.damping
    a = np.zeros((5, 5))
    a[0, 1] = a[2, 3] = 1.0
    a[1] = np.array([-k, -d, k, d, 2.0]) / f.inertia
    a[3] = np.array([k, d, -k, -d - f.aft.damping, 0.0]) / f.aft.inertia
    once, x, rows = expm(a * CYCLE), np.array([0.01, 0.4, -0.01, -0.2, 1.0]), []
    if not f.linkage.connected:
        free = pushed(f.inertia, 2.0, 0.01, 0.4)
        pole = f.aft.damping / f.aft.inertia
        gone = np.exp(-pole * after())
        return np.column_stack([free, -0.01 - 0.2 * (1.0 - gone) / pole, -0.2 * gone])
    for _ in range(COUNT):
        x = once @ x
        rows.append(x[:4])
    return np.array(rows)


COUPLED = Case(
    {"bodies": "two", "aft.inertia": 0.2, "aft.damping": 1.4, "linkage.stiffness": 500.0, "linkage.damping": 3.0},
    coupled, {"bodies": "one", "aft.inertia": 0.22, "aft.damping": 1.8, "linkage.stiffness": 550.0,
              "linkage.damping": 3.5, "linkage.connected": False},
    start=(0.01, 0.4, -0.01, -0.2), torque=2.0, columns=(0, 1, 2, 3),
)  # fmt: skip


def apart(f: Feel, u: Callable[[float], tuple[float, float]], v: float) -> Rows:
    """Both bodies from their difference and their common motion: the column starts at ``v``, the aft body at rest."""
    whole, rows = f.inertia + f.aft.inertia, []
    for t in after():
        common = f.inertia * v / whole
        x, rate = u(t)
        rows.append([common * t + f.aft.inertia / whole * x, common + f.aft.inertia / whole * rate,
                     common * t - f.inertia / whole * x, common - f.inertia / whole * rate])  # fmt: skip
    return np.array(rows)


def rattling(f: Feel) -> Rows:
    """Through the play with a constant speed, and back after half a swing."""
    reduced = f.inertia * f.aft.inertia / (f.inertia + f.aft.inertia)
    omega, v = math.sqrt(f.linkage.stiffness / reduced), 0.8
    half = 0.5 * f.linkage.backlash
    flight, contact = 2.0 * half / v, math.pi / omega

    def u(t: float) -> tuple[float, float]:
        t, side = t + 0.5 * flight, 1.0
        while t > flight + contact:
            t, side = t - flight - contact, -side
        if t < flight:
            return side * (v * t - half), side * v
        phase = omega * (t - flight)
        return side * (half + v / omega * math.sin(phase)), side * v * math.cos(phase)

    return apart(f, u, v)


RATTLING = Case(
    {"bodies": "two", "inertia": 0.2, "aft.inertia": 0.3, "linkage.backlash": 0.02}, rattling,
    {"linkage.backlash": 0.022, "linkage.stiffness": 1000.0}, start=(0.0, 0.8, 0.0, 0.0), columns=(0, 1, 2, 3),
)  # fmt: skip


def slackening(f: Feel) -> Rows:
    """Both cables pull up to the knee; beyond it one alone, softer by half about another centre."""
    reduced = f.inertia * f.aft.inertia / (f.inertia + f.aft.inertia)
    k, p, v = f.linkage.stiffness, f.linkage.pretension, 0.8
    taut, soft = math.sqrt(k / reduced), math.sqrt(0.5 * k / reduced)
    knee, centre = 2.0 * p / k, -2.0 * p / k
    begun = math.asin(knee * taut / v) / taut
    speed = v * math.cos(taut * begun)
    ended = 2.0 * math.atan2(speed / soft, knee - centre) / soft  # back at the knee with the same speed

    def u(t: float) -> tuple[float, float]:
        if t < begun:
            return v / taut * math.sin(taut * t), v * math.cos(taut * t)
        if t < begun + ended:
            s = soft * (t - begun)
            return (centre + (knee - centre) * math.cos(s) + speed / soft * math.sin(s),
                    speed * math.cos(s) - soft * (knee - centre) * math.sin(s))  # fmt: skip
        if t < 2.0 * begun + ended:
            s = taut * (2.0 * begun + ended - t)
            return v / taut * math.sin(s), -v * math.cos(s)
        x, rate = u(t - 2.0 * begun - ended)
        return -x, -rate

    return apart(f, u, v)


SLACKENING = Case(
    {"bodies": "two", "inertia": 0.2, "aft.inertia": 0.3, "linkage.pretension": 3.0}, slackening,
    {"linkage.pretension": 3.5}, start=(0.0, 0.8, 0.0, 0.0), columns=(0, 1, 2, 3),
)  # fmt: skip


def overridden(f: Feel) -> Rows:
    """Beyond the override the strut's torque is constant: on the column, and on the aft body if it is not jammed."""
    held = {"forward": (0.0, 1.0), "aft": (1.0, 0.0), "none": (1.0, 1.0)}[f.jam.of]
    most = f.linkage.override
    column = pushed(f.inertia, held[0] * (30.0 - most), 0.3)
    aft = pushed(f.aft.inertia, held[1] * most)
    return np.hstack([column, aft])


OVERRIDE = Case(
    {"bodies": "two", "linkage.override": 15.0, "jam.of": "aft", "aft.inertia": 2.0}, overridden,
    {"linkage.override": 16.0, "jam.of": "forward"}, start=(0.3, 0.0, 0.0, 0.0), torque=30.0, columns=(0, 1, 2, 3),
)  # fmt: skip

CASES = {
    "linear": LINEAR, "force trim": RELEASED, "friction": COULOMB, "friction at rest": STATIC, "Stribeck": STRIBECK,
    "steep Stribeck": STEEP, "aft Stribeck": AFT_STRIBECK, "centering": CENTERING, "detents": DETENTS,
    "gearing": GEARED,
    **{f"stop {k}": case for k, case in enumerate(STOPS)}, "friction without hydraulics": OFF_FRICTION,
    "rate": RATE, "trim": TRIM, "autopilot": AUTOPILOT, "clutch": CLUTCH, "shaker": SHAKER, "pusher": PUSHER,
    "vibration": VIBRATION, "gust": GUST, "coupled": COUPLED, "rattling": RATTLING, "slackening": SLACKENING,
    "override": OVERRIDE,
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_the_motion_is_its_closed_form(name):
    case = CASES[name]
    f = case.feel()
    found, exact = case.moved(f, {}), case.oracle(f)
    assert np.abs(found).max() > 1e-3
    np.testing.assert_allclose(found, exact, rtol=0, atol=case.tolerance * max(1.0, np.abs(exact).max()))


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, case in CASES.items() for key in case.changes])
def test_each_parameter_changes_the_motion_as_its_oracle_says(name, key):
    case = CASES[name]
    changed = {key: case.changes[key]}
    f = case.feel(**changed)
    exact, before = case.oracle(f), case.oracle(case.feel())
    tolerance = case.tolerance * max(1.0, np.abs(exact).max())
    np.testing.assert_allclose(case.moved(f, changed), exact, rtol=0, atol=tolerance)
    assert np.abs(exact - before).max() > 1000.0 * tolerance, "a mutation of it would not be seen"


def test_every_parameter_has_an_oracle():
    """A new element, or a new parameter of one, needs a case of its own above."""
    covered = {key for case in CASES.values() for key in case.changes}
    assert {key for key, _, _ in leaves(Feel())} == covered


# --- what a motion alone does not show -------------------------------------------------------------------------------


def test_a_detents_period_is_a_pendulums():
    """Let go 10° short of its unstable end it swings for eight periods of 4 K(sin(θ_0/2)) / ω."""
    f = feel_of({**BARE, "inertia": 0.1, "detents.place": [0.0], "detents.width": [0.1], "detents.torque": [2.0]})
    theta = math.radians(170.0)
    period = 4.0 * ellipk(math.sin(0.5 * theta) ** 2) / math.sqrt(2.0 * (2 * math.pi / 0.1) / 0.1)
    x0 = theta * 0.1 / (2 * math.pi)
    cycle = period / 1000.0
    rows = motion(f, 0.0, 8000, (x0, 0.0), cycle=cycle)
    assert rows[999::1000, 0] == pytest.approx(x0, abs=1e-10)
    assert rows[249::500, 0] == pytest.approx(0.0, abs=1e-9)


def test_an_unbalance_topples_without_a_spring():
    """x = x_0 cosh(√(g/I) t) until it lies on its stop; a spring that is stiffer holds it."""
    values = {**BARE, "unbalance.gradient": 6.0, "flight.load_factor": 1.5, "inertia": 0.3, "aft_limit.angle": 0.2,
              "forward_limit.angle": 0.3, "damping": 0.0}  # fmt: skip
    rows = motion(feel_of(values), 0.0, 1000, (1e-3, 0.0))
    t, root = after(1000), math.sqrt(9.0 / 0.3)
    free = 1e-3 * np.cosh(root * t)
    assert rows[-1, 0] == pytest.approx(free[-1], rel=1e-11)
    lying = motion(feel_of({**values, "damping": 5.0}), 0.0, 15_000, (1e-3, 0.0))[-1]
    assert lying[0] == pytest.approx(0.2 * 150.0 / (150.0 - 9.0), rel=1e-9)  # c_hs (φ − limit) = g n_z φ
    held = motion(feel_of({**values, "damping": 5.0, "stiffness": 29.0}), 0.0, 5000, (0.1, 0.0))[-1]
    assert abs(held[0]) < 1e-3


def test_stick_slip_against_its_closed_form():
    """A spring that is pulled along: stuck up to the static friction, then a slip whose length is known.

    In the spring's stretch y: ω² = c/I, y = μ/c + Δ cos ωt + (r/ω) sin ωt with Δ = (μ_s − μ)/c; it ends where y˙ is
    the rate r again, at ωt = 2 (π − atan(Δω/r)).
    """
    f = feel_of({**BARE, "inertia": 0.02, "stiffness": 60.0, "friction": 0.6, "static_friction": 1.5, "neutral": 2.0,
                 "trim.rate": 0.05})  # fmt: skip
    model = Model(feel_of({**BARE, "neutral": 0.0}))
    model.step()
    model.set(f)
    rows = []
    for _ in range(40_000):
        model.step()
        rows.append((model.state.angle, model.state.velocity, model.state.trim.zero))
    x, v, zero = np.array(rows).T
    begun = np.flatnonzero((v[1:] != 0.0) & (v[:-1] == 0.0))
    ended = np.flatnonzero((v[1:] == 0.0) & (v[:-1] != 0.0)) + 1
    rate, omega, more = 0.05, math.sqrt(60.0 / 0.02), (1.5 - 0.6) / 60.0
    lasts = 2.0 * (math.pi - math.atan(more * omega / rate)) / omega
    slip = rate * lasts + more - (more * math.cos(omega * lasts) + rate / omega * math.sin(omega * lasts))
    assert len(ended) > 15
    assert 60.0 * (zero - x)[begun] == pytest.approx(1.5, abs=60.0 * rate * CYCLE * 1.01)
    jumps = x[ended] - x[begun[: len(ended)]]
    assert jumps == pytest.approx(slip, rel=2e-3)  # the zero climbs in steps of a cycle
    assert np.diff(ended) * CYCLE == pytest.approx(slip / rate, rel=0.02)


SHAPED = {
    **BARE, "damping": 0.3, "detents.place": [-0.06, 0.03], "detents.width": [0.05, 0.06],
    "detents.torque": [1.0, 1.6], "detents.profile": [0.2, 1.0, 0.3, 0.0, -0.6, -1.0, 0.0],
}  # fmt: skip
TABLED = {
    **BARE, "surface.control_angle": [-0.2, -0.05, 0.02, 0.1], "surface.deflection": [-0.5, -0.08, 0.02, 0.3],
    "surface.area": 1.0, "surface.chord": 0.4, "surface.hinge_deflection": -0.03, "surface.hinge_rate": -0.6,
    "surface.hinge_zero": 0.001, "flight.dynamic_pressure": 3000.0, "flight.airspeed": 70.0,
}  # fmt: skip
FALLEN = {
    **TABLED, "friction": 0.2, "stiffness": 20.0, "centering.stiffness": 60.0, "centering.breakout": 1.0,
    "hydraulics.pressure": 0.5, "hydraulics.off_friction": 0.7, "hydraulics.off_damping": 1.0,
    "hydraulics.feel_share": 0.6, "hydraulics.maximum_rate": 0.6, "surface.boost": 0.7,
}  # fmt: skip


@pytest.mark.parametrize("values", [SHAPED, TABLED, FALLEN, {**FALLEN, "hydraulics.pressure": 0.0}])
def test_shapes_without_a_closed_form_agree_with_an_integration(values):
    f, torque = feel_of(values), 3.0 * np.sin(2 * math.pi * 3.0 * CYCLE * np.arange(600))
    found, exact = motion(f, torque, 600, (-0.1, 0.5)), reference(f, torque, 600, (-0.1, 0.5), step=0.4e-6)
    assert np.ptp(found[:, 0]) > 0.1
    np.testing.assert_allclose(found[:, 0], exact[:, 0], rtol=0, atol=1e-6)


def test_hydraulics_that_fail_slowly_end_as_those_that_are_off():
    """The last thousandth of the pressure, gone or not, is not felt: nothing blocks on the way down."""
    base = {**BARE, "hydraulics.maximum_rate": 0.6, "hydraulics.off_damping": 2.0, "hydraulics.off_friction": 0.5}
    ends = [motion(feel_of({**base, "hydraulics.pressure": left}), 3.0, 500)[-1] for left in (1e-3, 0.0)]
    assert ends[1][1] > 0.5
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.1)


def test_a_detent_that_pushes_out_at_its_edge_is_refused():
    """Beside it the spring would push in: a place to chatter at."""
    one = {"detents.place": [0.0], "detents.width": [0.1], "detents.torque": [1.0]}
    feel_of({**one, "detents.profile": [1.0, -1.0]})
    for profile in ([-0.1, 0.0], [0.0, 1.0]):
        with pytest.raises(ValidationError, match="profile must not begin below 0 nor end above it"):
            feel_of({**one, "detents.profile": profile})


@pytest.mark.parametrize("name", ["shaker", "pusher"])
def test_what_ramps_up_ramps_down_when_its_torque_is_taken_away(name):
    """By the ramp of the torque that it had: not at once, and not never."""
    on = {f"{name}.torque": 4.0, f"{name}.ramp": 0.02}
    model = Model(feel_of({**BARE, **on, **({"pusher.engaged": True} if name == "pusher" else {})}))
    levels = []
    for k in range(200):
        if k == 100:
            model.set(feel_of({**BARE, f"{name}.ramp": 0.02}))
        model.step()
        levels.append(float(model.state[name]["level"]))
    assert levels[24] == pytest.approx(2.0)
    assert levels[99] == 4.0
    assert levels[124] == pytest.approx(2.0)
    assert levels[150] == pytest.approx(0.0, abs=1e-12)
    assert levels[199] == 0.0


def test_force_trim_leaves_the_zero_where_the_button_was_let_go():
    """While it is pressed the feel unit is silent; afterwards it pulls to where the control was."""
    values = {**BARE, "stiffness": 30.0, "damping": 2.0, "friction": 0.05, "neutral": 0.01}
    model = Model(feel_of(values))
    for k in range(30_000):
        if k == 500:
            model.set(feel_of({**values, "trim.released": True}))
        if k == 3000:
            place = model.state.angle
            model.set(feel_of(values))
        model.step(0.5 if 500 <= k < 3000 else 0.0)
        if 500 <= k < 3000:
            assert model.state.surface.feel_torque == 0.0
    assert place > 0.1
    assert model.state.trim.zero == pytest.approx(place, abs=1e-3)  # it moved on by a cycle
    assert model.state.angle == pytest.approx(model.state.trim.zero, abs=0.05 / 30.0)


def test_after_force_trim_nothing_of_an_old_trim_is_left_to_go():
    """The trim motor was on its way to neutral as the button was pressed; let go, the zero stays where the control was.
    """
    values = {**BARE, "stiffness": 30.0, "damping": 2.0, "friction": 0.05, "trim.rate": 0.01}
    model = Model(feel_of(values))
    model.step()
    parts = ({"neutral": 0.1}, 0.0, 500), ({"trim.released": True}, 0.5, 1000), ({}, 0.0, 9000)
    for changed, torque, cycles in parts:
        values = {**values, "trim.released": False, **changed}
        model.set(feel_of(values))
        for _ in range(cycles):
            model.step(torque)
            if "trim.released" in changed:
                place = model.state.trim.zero
    assert model.state.trim.zero == place
    model.set(feel_of({**values, "neutral": 0.12}))  # a trim of its own moves it, at its rate
    for _ in range(1000):
        model.step()
    assert model.state.trim.zero == pytest.approx(place + 0.01 * 1000 * CYCLE, abs=1e-12)


@pytest.mark.parametrize(("torque", "frequency"), [("shaker.torque", "shaker.frequency"),
                                                   ("disturbance.vibration", "disturbance.frequency")])  # fmt: skip
def test_a_vibration_that_changes_its_frequency_does_not_jump(torque, frequency):
    """From 10 to 20 Hz in half a second, an hour after the start: the phase is the integral of the frequency."""
    model, phase = Model(feel_of({**BARE, torque: 2.0})), 0.0
    model.cycles = 9_000_000
    for k in range(1250):
        hertz = 10.0 + 10.0 * k / 1250
        model.set(feel_of({**BARE, torque: 2.0, frequency: hertz}))
        model.step()
        assert model.state.torque == pytest.approx(2.0 * math.sin(2.0 * math.pi * phase), abs=1e-9)
        phase += hertz * CYCLE


def test_commands_begin_anew_as_the_drive_is_switched_on():
    """Off, the model goes along with the column; on again, autopilot, pusher and shaker begin as they first did."""
    values = {**BARE, "autopilot.engaged": True, "autopilot.reference": 0.1, "pusher.engaged": True,
              "pusher.torque": 3.0, "pusher.ramp": 0.04, "shaker.torque": 2.0, "shaker.ramp": 0.04}  # fmt: skip
    model = Model(feel_of(values))
    for _ in range(1000):
        model.step()
    solver.follow(model.feel, model.state, -0.15, 0.0, 0.0)
    assert model.state.surface.autopilot_torque == 0.0
    model.step()
    assert model.state.autopilot.reference == pytest.approx(-0.15 + 0.2 * CYCLE, abs=1e-12)
    assert model.state.pusher.level == pytest.approx(3.0 * CYCLE / 0.04)
    assert model.state.shaker.level == pytest.approx(2.0 * CYCLE / 0.04)


def test_the_autopilot_leads_is_overridden_and_leads_back():
    """It back-drives the control at its rate; a hand meets the clutch's torque and no more; let go, it comes back."""
    values = {**BARE, "autopilot.engaged": True, "autopilot.reference": 0.1, "autopilot.rate": 0.05,
              "autopilot.clutch": 8.0, "damping": 10.0}  # fmt: skip
    model = Model(feel_of(values))
    angles = []
    for _ in range(10_000):
        model.step()
        angles.append(model.state.angle)
    slope = (angles[4000] - angles[2000]) / (2000 * CYCLE)
    assert slope == pytest.approx(0.05, rel=1e-6)
    assert angles[-1] == pytest.approx(0.1, abs=1e-9)
    for _ in range(2000):  # 2 N·m more than the clutch: against the body's damper it goes at 0.2 rad/s in the end
        model.step(10.0)
    assert model.state.velocity == pytest.approx(0.2, rel=1e-6)
    assert model.state.surface.autopilot_torque == -8.0
    for _ in range(10_000):
        model.step()
    assert model.state.angle == pytest.approx(0.1, abs=1e-6)


# --- gusts -----------------------------------------------------------------------------------------------------------


def psd(spectrum: str, frequency: Rows, tau: float) -> Rows:
    """One-sided spectrum of the vertical gust for each hertz, of r.m.s. 1 (MIL-F-8785C): ∫ from 0 is 1.

    Dryden: (τ/π) (1 + 3 x²) / (1 + x²)² for each rad/s, x = τω; von Kármán: (τ/π) (1 + 8/3 y²) / (1 + y²)^(11/6),
    y = 1.339 x.
    """
    x = tau * 2.0 * math.pi * frequency
    if spectrum == "dryden":
        return 2.0 * tau * (1.0 + 3.0 * x**2) / (1.0 + x**2) ** 2
    y = 1.339 * x
    return 2.0 * tau * (1.0 + 8.0 / 3.0 * y**2) / (1.0 + y**2) ** (11.0 / 6.0)


@pytest.mark.parametrize(("spectrum", "band"), [("dryden", 0.07), ("von_karman", 0.16)])
def test_gusts_have_their_spectrum_and_their_rms(spectrum, band):
    """Welch's estimate of a long noise against the published spectrum, up to ten corner frequencies.

    The rational form of von Kármán's leaves it by up to 3 % there, 11 % at ten, and 4 % are its scaling.
    """
    values = {**BARE, "gust.torque": 3.0, "gust.spectrum": spectrum, "flight.airspeed": 100.0, "gust.length": 1.0}
    tau, torque, model = 0.01, [], Model(feel_of(values))
    feel, state, gust = model.feel, model.state, model.state.gust
    for white in np.random.default_rng(5).standard_normal(150_000):
        state["own_torque"], gust["white"] = 0.0, white
        Gust.each_cycle(feel, state, 0.0, CYCLE)
        torque.append(state["own_torque"])
    assert np.std(torque) == pytest.approx(3.0, rel=0.02)  # of 6000 times τ: ±0.8 %
    frequency, found = welch(np.array(torque), fs=1.0 / CYCLE, nperseg=2048)
    here = (frequency > 2.0) & (frequency < 10.0 / (2.0 * math.pi * tau))
    share = found[here] / (9.0 * psd(spectrum, frequency[here], tau))
    # neighbours averaged: each estimate of 145 segments varies by a twelfth
    groups = np.array([part.mean() for part in np.array_split(share, 8)])
    np.testing.assert_allclose(groups, 1.0, rtol=0, atol=band)


def test_calm_air_and_no_airspeed_have_no_gusts():
    for values in ({"flight.airspeed": 100.0}, {"gust.torque": 3.0}):
        torque = motion(feel_of({**BARE, **values}), 0.0, 100, white=WHITE, of=lambda state: state.torque)
        assert not torque.any()


# --- recorded --------------------------------------------------------------------------------------------------------


def test_what_is_recorded_of_the_aft_side_is_what_acts():
    """Each of the recorded torques, from its law at the recorded state; and together they are the aft body's motion."""
    values = {**ALL_LINEAR, **BARE, "bodies": "two", "stiffness": 22.0, "aft.inertia": 0.3, "aft.damping": 1.0,
              "linkage.backlash": 0.01, "linkage.damping": 2.0, "centering.stiffness": 40.0,
              "centering.breakout": 0.5, "hydraulics.off_damping": 0.0, "surface.hinge_rate": 0.0,
              "autopilot.engaged": True, "autopilot.reference": 0.2, "autopilot.clutch": 3.0}  # fmt: skip
    f = feel_of(values)
    model = Model(f)
    seen = set()
    for k in range(1500):
        model.step(6.0 * math.sin(0.01 * k))
        s, u = model.state, model.state.surface
        y, w = s.aft_angle, s.aft_velocity
        left = 1.0 - 0.8 * (1.0 - 0.7)
        most = f.centering.breakout
        feel = left * ((22.0 + 0.003 * 4000.0) * (y - 0.04) + min(max(40.0 * (y - 0.04), -most), most))
        load = 4000.0 * 1.4 * 0.3
        hinge = load * (0.002 - 0.01 * 0.1 + 0.015 * 0.08 - 0.02 * 1.2 * y)
        a = f.autopilot
        servo = a.stiffness * (s.autopilot.reference - y) + a.damping * (s.autopilot.rate - w)
        stretch = s.angle - y
        cable = 0.0
        if abs(stretch) > 0.005:
            side = math.copysign(1.0, stretch)
            cable = side * max(0.0, 900.0 * (abs(stretch) - 0.005) + 2.0 * side * (s.velocity - w))
        seen.add((cable == 0.0, abs(servo) > 3.0))
        assert u.deflection == pytest.approx(1.2 * y, abs=1e-14)
        assert u.velocity == pytest.approx(1.2 * w, abs=1e-14)
        assert u.hinge_moment == pytest.approx(hinge, abs=1e-12)
        assert u.feel_torque == pytest.approx(feel, abs=1e-12)
        assert u.autopilot_torque == pytest.approx(min(max(servo, -3.0), 3.0) - 0.7, abs=1e-12)
        assert u.trim == 0.04
        assert u.cable_torque == pytest.approx(cable, abs=1e-8)
        total = cable - feel + (1.0 - 0.4 * 0.7) * 1.2 * hinge + u.autopilot_torque + 0.3 - 1.0 * w
        total += 1.3 * (0.4 + 3.0 * (y - 0.05))
        assert s.aft_acceleration == pytest.approx(total / 0.3, abs=1e-6)
    assert len(seen) >= 3


# --- hostile ---------------------------------------------------------------------------------------------------------


IN_A_GALE = {"flight.dynamic_pressure": 2e5, "flight.airspeed": 1.0, "surface.area": 200.0, "surface.chord": 10.0}
TOO_FAST = {
    "hinge_rate": {**IN_A_GALE, "surface.hinge_rate": -100.0},
    "hinge_rate, hardly any airspeed": {**IN_A_GALE, "surface.hinge_rate": -1e-3, "flight.airspeed": 1e-300},
    "hinge_deflection": {**IN_A_GALE, "surface.hinge_deflection": 10.0, "surface.gearing": 20.0, "inertia": 0.1},
    "autopilot.damping": {"autopilot.engaged": True, "autopilot.damping": 1e4, "inertia": 1e-3},
    "rate_damping": {"hydraulics.maximum_rate": 0.1, "hydraulics.rate_damping": 1e4, "inertia": 1e-3},
    "off_damping": {"hydraulics.off_damping": 1e4, "inertia": 1e-3},
    "release_damping": {"trim.released": True, "trim.release_damping": 1e4, "inertia": 1e-3},
    "aft.damping": {"bodies": "two", "aft.damping": 1e4, "aft.inertia": 1e-3},
    "linkage.damping": {"bodies": "two", "linkage.damping": 1e4, "inertia": 1e-3},
}  # fmt: skip


@pytest.mark.parametrize("key", TOO_FAST)
def test_motion_that_the_solver_would_work_on_for_ever_is_refused(key):
    """A fifth of a second for each cycle, or numbers that are none, if it were let in; what is to blame is named."""
    with pytest.raises(ValidationError, match=rf"most of all \S*{key.split(',')[0]}: motion of"):
        feel_of(TOO_FAST[key])


def test_a_gearing_steeper_than_any_linkage_is_refused():
    with pytest.raises(ValidationError, match="deflection changes by 1e\\+09 times the change of control_angle"):
        feel_of({"surface.control_angle": [0.0, 1e-9], "surface.deflection": [0.0, 1.0]})


@pytest.mark.parametrize("torque", [math.nan, math.inf, 1e308])
@pytest.mark.parametrize("bodies", ["one", "two"])
def test_a_number_that_is_none_does_not_stop_time(torque, bodies):
    """The PLC trips on it in its next cycle; until then the solver must come back."""
    model = Model(feel_of({"bodies": bodies}))
    model.step(1.0)
    begun = time.perf_counter()
    for _ in range(3):
        model.step(torque)
    assert time.perf_counter() - begun < 0.1
    assert math.isfinite(torque) or not math.isfinite(model.state.angle)


def test_what_is_jammed_moves_the_other_body_in_the_same_cycle_as_it_should():
    """The aft body comes in fast and is caught: what the linkage's damper asked of the column is gone with it."""
    f = feel_of({**BARE, "bodies": "two", "linkage.damping": 50.0, "friction": 1.0, "jam.of": "aft"})
    model = Model(f, (0.0, 0.0, 0.0, -1.0))
    model.step(1.5)
    exact = driven(0.3, 50.0, 900.0, [0.5], 0.0, 0.0)[0]
    assert [model.state.angle, model.state.velocity] == pytest.approx(exact, rel=1e-9)
    assert model.state.aft_velocity == 0.0
