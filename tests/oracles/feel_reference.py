"""The feel model once more, integrated in small steps: a reference that shares no law with ``cls_bench.feel``.

Written from the equations (thesis 3.5.1, 3.5.2; the elements' docstrings), with the parameters read by their names.
Time stepping after Moreau: angles at the middle of a step, torques there, velocities by them, friction set-valued: a
body that comes to rest within a step is at rest after it, and leaves it when the other torques exceed its static
friction.
Damping acts on the velocity at the middle of the step, by the acceleration of the step before. Nothing is solved and no
event is sought, so the error falls with the step: at 0.2 µs it is far below what is asked (the tests print it).

What commands do once in a cycle (trim's rate, the autopilot's lead, ramps) is plain Python here.
"""

import math
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import Feel
from tests.oracles.feel_driver import CYCLE, record

STEP = 0.2e-6
"""Step of the reference [s]."""

_njit: Any = numba.njit(error_model="numpy")


@_njit
def _clip(x, most):
    return min(max(x, -most), most)


@_njit
def _stop(limit, x, v):
    """Torque of both stops, which only push."""
    back = limit.back_angle if limit.back_angle > 0.0 else limit.angle
    if x > limit.angle:
        return -max(0.0, limit.stiffness * (x - limit.angle) + limit.damping * v)
    if x < -back:
        return max(0.0, limit.stiffness * (-back - x) - limit.damping * v)
    return 0.0


@_njit
def _seat(f, x, v, zero, lead, lead_rate):
    """Torque of all that acts on the body with the feel unit, but friction."""
    h, fl, s = f.hydraulics, f.flight, f.surface
    total = 0.0
    if f.trim.released:
        total -= f.trim.release_damping * v
    else:
        left = 1.0 - h.feel_share + h.feel_share * h.pressure
        q = min(f.q_feel.gradient * fl.dynamic_pressure, f.q_feel.most)
        total -= left * ((f.stiffness + q) * (x - zero) + _clip(f.centering.stiffness * (x - zero),
                                                                f.centering.breakout))
    total += _stop(f.aft_limit, x, v)
    # surface
    n = s.control_angle.count
    if n == 0:
        deflection, ratio = s.gearing * x, s.gearing
    else:
        j = 0
        while j < n - 2 and x >= s.control_angle.values[j + 1]:
            j += 1
        ratio = s.deflection.values[j + 1] - s.deflection.values[j]
        ratio /= s.control_angle.values[j + 1] - s.control_angle.values[j]
        deflection = s.deflection.values[j] + ratio * (x - s.control_angle.values[j])
    c_h = s.hinge_zero + s.hinge_alpha * fl.angle_of_attack + s.hinge_deflection * deflection + s.hinge_tab * fl.tab
    if fl.airspeed > 0.0:
        c_h += s.hinge_rate * ratio * v * s.chord / (2.0 * fl.airspeed)
    total += (1.0 - s.boost * h.pressure) * ratio * fl.dynamic_pressure * s.area * s.chord * c_h
    # detents
    for k in range(f.detents.place.count):
        width, peak = f.detents.width.values[k], f.detents.torque.values[k]
        off = (x - f.detents.place.values[k]) / width  # −½ … ½
        if abs(off) <= 0.5:
            m = f.detents.profile.count
            if m == 0:
                total -= peak * math.sin(2.0 * math.pi * off)
            else:
                where = (off + 0.5) * (m - 1)
                low = min(int(where), m - 2)
                a, b = f.detents.profile.values[low], f.detents.profile.values[low + 1]
                total += peak * (a + (b - a) * (where - low))
    total += fl.load_factor * (f.unbalance.torque + f.unbalance.gradient * (x - f.unbalance.level))
    # hydraulics
    total -= (1.0 - h.pressure) * h.off_damping * v
    if h.maximum_rate > 0.0 and h.pressure > 0.0:
        most = h.maximum_rate * math.sqrt(h.pressure)
        total -= h.pressure * h.rate_damping * (v - _clip(v, most))
    if f.autopilot.engaged:
        total += _clip(f.autopilot.stiffness * (lead - x) + f.autopilot.damping * (lead_rate - v), f.autopilot.clutch)
    return total


@_njit
def _cable(f, u, rate):
    """Torque of the linkage on the aft body."""
    c = f.linkage
    if not c.connected:
        return 0.0
    side = 1.0 if u > 0.0 else -1.0
    e = abs(u) - 0.5 * c.backlash
    if e <= 0.0 and c.backlash > 0.0:
        return 0.0
    k = c.stiffness * e
    if c.pretension > 0.0 and k > 2.0 * c.pretension:
        k = c.pretension + 0.5 * k
    k += c.damping * side * rate
    if c.backlash > 0.0:
        k = max(0.0, k)
    if c.override > 0.0:
        k = _clip(k, c.override)
    return side * k


@_njit
def _moved(v, net, inertia, coulomb, static, stribeck, h):
    """Velocity after a step under all torques ``net`` but friction."""
    static = max(static, coulomb)
    if v == 0.0:
        if abs(net) <= static:
            return 0.0
        resisting = static if stribeck > 0.0 else coulomb
        return h / inertia * (net - math.copysign(resisting, net))
    friction = coulomb
    if stribeck > 0.0:
        friction += (static - coulomb) * math.exp(-abs(v) / stribeck)
    after = v + h / inertia * (net - math.copysign(friction, v))
    return after if after * v > 0.0 else 0.0


@_njit
def _advance(f, state, column, aft, zero, lead, lead_rate, h, steps):
    x, v, y, w, a, b = state
    two = f.bodies == 1
    off = (1.0 - f.hydraulics.pressure) * f.hydraulics.off_friction
    held0 = f.jam.of == 1 or (f.jam.of == 2 and not two)
    held1 = f.jam.of == 2
    static0 = max(f.friction, f.static_friction)
    static1 = max(f.aft.friction, f.aft.static_friction)
    for _ in range(steps):
        if held0:
            v, a = 0.0, 0.0
        if held1:
            w, b = 0.0, 0.0
        xm, ym = x + 0.5 * h * v, y + 0.5 * h * w
        vm, wm = v + 0.5 * h * a, w + 0.5 * h * b
        net = column - f.damping * vm + _stop(f.forward_limit, xm, vm)
        if two:
            link = _cable(f, xm - ym, vm - wm)
            net -= link
            other = aft + link - f.aft.damping * wm + _seat(f, ym, wm, zero, lead, lead_rate)
            w1 = 0.0
            if not held1:
                w1 = _moved(w, other, f.aft.inertia, f.aft.friction + off, static1 + off, f.aft.stribeck_velocity, h)
            b = (w1 - w) / h
            y += 0.5 * h * (w + w1)
            w = w1
            v1 = 0.0
            if not held0:
                v1 = _moved(v, net, f.inertia, f.friction, static0, f.stribeck_velocity, h)
        else:
            net += aft + _seat(f, xm, vm, zero, lead, lead_rate)
            v1 = 0.0
            if not held0:
                v1 = _moved(v, net, f.inertia, f.friction + off, static0 + off, f.stribeck_velocity, h)
        a = (v1 - v) / h
        x += 0.5 * h * (v + v1)
        v = v1
    return x, v, y, w, a, b


def _towards(value: float, aim: float, step: float) -> float:
    return aim if abs(aim - value) <= step else value + math.copysign(step, aim - value)


class Commands:
    """What is led once in a cycle: trim, autopilot, pusher and shaker."""

    def __init__(self, f: Any):
        self.position = float(f.neutral)
        self.offset = 0.0
        self.lead: float | None = None
        self.lead_rate = 0.0
        self.pushed = 0.0
        self.pushing = 0.0
        self.shaking = 0.0
        self.full = {"pusher": 0.0, "shaker": 0.0}

    def cycle(self, f: Any, seat: float, time: float, cycle: float) -> tuple[float, float, float]:
        """(torque on the column, on the aft body, zero of the feel unit)."""
        waits = f.trim.rate > 0.0 and not f.trim.released
        self.position = _towards(self.position, f.neutral, f.trim.rate * cycle if waits else math.inf)
        if f.trim.released:
            self.offset = seat - self.position
        if f.autopilot.engaged:
            before = seat if self.lead is None else self.lead
            rate = f.autopilot.rate
            self.lead = _towards(before, f.autopilot.reference, rate * cycle if rate > 0.0 else math.inf)
            self.lead_rate = (self.lead - before) / cycle if rate > 0.0 else 0.0
        else:
            self.lead = None
        pusher, shaker = f.pusher, f.shaker
        aim = 0.0
        if pusher.engaged:
            if pusher.longest == 0.0 or self.pushed < pusher.longest:
                aim = pusher.torque
            self.pushed += cycle
        else:
            self.pushed = 0.0
        self.pushing = self._ramp("pusher", self.pushing, aim, pusher.torque, pusher.ramp, cycle)
        on = shaker.duty >= 1.0 or math.fmod(time, shaker.period) < shaker.duty * shaker.period
        aim = shaker.torque if on else 0.0
        self.shaking = self._ramp("shaker", self.shaking, aim, shaker.torque, shaker.ramp, cycle)
        column = f.bob_weight.torque * f.flight.load_factor + f.down_spring.torque + self.pushing
        column += self.shaking * math.sin(2.0 * math.pi * shaker.frequency * time)
        aft = f.disturbance.torque + f.autopilot.torque
        aft += f.disturbance.vibration * math.sin(2.0 * math.pi * f.disturbance.frequency * time)
        return column, aft, self.position + self.offset

    def _ramp(self, name: str, level: float, aim: float, torque: float, ramp: float, cycle: float) -> float:
        """From none to the full torque, the last that was asked for, in the time ``ramp``; and back."""
        if torque != 0.0:
            self.full[name] = abs(torque)
        return _towards(level, aim, self.full[name] / ramp * cycle if ramp > 0.0 else math.inf)


def reference(
    feel: Feel | Sequence[tuple[int, Feel]], torque: float | Sequence[float], cycles: int,
    start: Sequence[float] = (0.0, 0.0, 0.0, 0.0), *, step: float = STEP, cycle: float = CYCLE,
) -> NDArray[np.float64]:  # fmt: skip
    """As :func:`tests.oracles.feel_driver.motion`, integrated."""
    changes = [(0, feel)] if isinstance(feel, Feel) else list(feel)
    at = {k: record(value) for k, value in changes}
    f = at[0]
    commands = Commands(f)
    state = (*map(float, (*start, 0.0, 0.0, 0.0, 0.0)[:4]), 0.0, 0.0)
    steps = round(cycle / step)
    rows = []
    for k in range(cycles):
        f = at.get(k, f)
        column, aft, zero = commands.cycle(f, state[2] if f.bodies == 1 else state[0], k * cycle, cycle)
        column += torque if isinstance(torque, (int, float)) else torque[k]
        lead = 0.0 if commands.lead is None else commands.lead
        state = _advance(f, state, column, aft, zero, lead, commands.lead_rate, cycle / steps, steps)
        rows.append(state[:4] if f.bodies == 1 else (state[0], state[1], state[0], state[1]))
    return np.array(rows)
