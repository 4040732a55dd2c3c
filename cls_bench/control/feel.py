"""Feel model: the flight control system as a single body at the column's axis (thesis 3.5.2), sampled exactly.

    I φ̈ + d φ̇ + c (φ − φ₀) + centering(φ − φ₀) + aft(φ, φ̇) + forward(φ, φ̇) + μ sign φ̇ = T

The centering unit is a spring that saturates at its breakout torque; a travel limit adds stiffness and damping beyond
an angle; friction is Coulomb's, with stiction: at rest the body stays at rest while the other torques sum up to no
more than μ.

Between the angles at which a spring begins or saturates, and between reversals, the law is linear with constant
coefficients. So a cycle with constant T is solved in closed form from event to event: no integration error, no
numerical damping and no energy gained, at any cycle time.
"""

import math
from typing import Any

import numpy as np

from cls_bench.compiled import compiled

STATE = np.dtype(
    [
        ("angle", np.float64),  # [rad]
        ("velocity", np.float64),  # [rad/s]
        ("acceleration", np.float64),  # [rad/s²]
        ("torque", np.float64),  # sum of the torques that act on the model [N·m]
    ]
)

_EVENTS = 4096
"""Most pieces (between reversals, stops reached or left) in one cycle; a cycle of 400 µs has one or two."""


@compiled
def response(time: float, decay: float, frequency_squared: float) -> tuple[float, float, float]:
    """Q, Q̇ and Q̈ of Q̈ + 2a Q̇ + k Q = 1 from rest, after ``time`` [s].

    a = ``decay`` [1/s], k = ``frequency_squared`` [1/s²].

    Q̇ is the impulse response, so every solution of the linear body follows from these three. A power series where it
    converges to machine precision, which also covers k = 0; the closed form elsewhere.
    """
    if decay * time < 0.05 and abs(frequency_squared) * time * time < 0.0025:
        q0 = 0.0  # coefficient n of Q as a term, times t^n
        q1 = 0.5 * time * time  # coefficient n + 1
        q, dq, ddq = q1, time, 1.0
        n = 1
        while n < 12:
            # (n+2)(n+1) q[n+2] = −2a (n+1) q[n+1] − k q[n], all times t^(n+2)
            q2 = (-2.0 * decay * (n + 1) * q1 * time - frequency_squared * q0 * time * time) / ((n + 2) * (n + 1))
            q += q2
            dq += (n + 2) * q2 / time if time > 0.0 else 0.0
            q0, q1 = q1, q2
            n += 1
        ddq = 1.0 - 2.0 * decay * dq - frequency_squared * q
        return q, dq, ddq
    discriminant = frequency_squared - decay * decay
    fade = math.exp(-decay * time)
    if discriminant > 0.0:
        w = math.sqrt(discriminant)
        cosine, sine = fade * math.cos(w * time), fade * math.sin(w * time) / w
    elif discriminant < 0.0:
        w = math.sqrt(-discriminant)
        slow, fast = -frequency_squared / (decay + w), -(decay + w)  # the two poles [1/s], without cancellation
        spread = math.expm1(-2.0 * w * time)
        cosine, sine = math.exp(slow * time) * (1.0 + 0.5 * spread), math.exp(slow * time) * -0.5 * spread / w
        if frequency_squared * time * time < 0.0025:  # hardly any spring: the sum of the two poles' parts
            # Of the least numbers there are, the product is lost in rounding and the quotient with it.
            creep = math.expm1(slow * time) / slow if abs(slow * time) > 1e-300 else time
            return (creep - math.expm1(fast * time) / fast) / (2.0 * w), sine, cosine - decay * sine
    else:
        cosine, sine = fade, fade * time
    return (1.0 - cosine - decay * sine) / frequency_squared, sine, cosine - decay * sine


@compiled
def _bound(edge: float, probe: float, low: float, high: float) -> tuple[float, float]:
    if edge <= probe:
        return max(low, edge), high
    return low, min(high, edge)


@compiled
def segment(feel: Any, probe: float) -> tuple[float, float, float, float, float]:
    """The linear piece around ``probe`` [rad]: (stiffness c, offset τ₀, damping d, lower end, upper end).

    Within it the springs' torque is c φ + τ₀.
    """
    stiffness = feel.stiffness
    offset = -feel.stiffness * feel.neutral
    damping = feel.damping
    low, high = -math.inf, math.inf
    if feel.centering_stiffness > 0.0 and feel.centering_breakout > 0.0:
        width = feel.centering_breakout / feel.centering_stiffness
        low, high = _bound(feel.neutral - width, probe, low, high)
        low, high = _bound(feel.neutral + width, probe, low, high)
        if probe >= feel.neutral + width:
            offset += feel.centering_breakout
        elif probe < feel.neutral - width:
            offset -= feel.centering_breakout
        else:
            stiffness += feel.centering_stiffness
            offset -= feel.centering_stiffness * feel.neutral
    for limit in (feel.aft_limit, feel.forward_limit):
        low, high = _bound(-limit.angle, probe, low, high)
        low, high = _bound(limit.angle, probe, low, high)
        if probe >= limit.angle:
            stiffness += limit.stiffness
            offset -= limit.stiffness * limit.angle
            damping += limit.damping
        elif probe < -limit.angle:
            stiffness += limit.stiffness
            offset += limit.stiffness * limit.angle
            damping += limit.damping
    return stiffness, offset, damping, low, high


@compiled
def spring_torque(feel: Any, angle: float) -> float:
    """Torque [N·m] of all springs at ``angle``, damping and friction left out."""
    stiffness, offset, _, _, _ = segment(feel, angle)
    return stiffness * angle + offset


@compiled
def _root(target: float, of_velocity: bool, x: float, v: float, a0: float, decay: float, k: float, end: float) -> float:
    """Time in (0, ``end``] at which the position (or velocity) reaches ``target``: bisection, to the last bit.

    The caller knows that it is reached once, so the sign of the difference tells the side.
    """
    low, high = 0.0, end
    q, dq, ddq = response(end, decay, k)
    at_end = (v * ddq + a0 * dq if of_velocity else x + v * dq + a0 * q) - target
    for _ in range(60):
        middle = 0.5 * (low + high)
        q, dq, ddq = response(middle, decay, k)
        value = (v * ddq + a0 * dq if of_velocity else x + v * dq + a0 * q) - target
        if value * at_end > 0.0:
            high = middle
        else:
            low = middle
    return high


@compiled
def step(feel: Any, state: Any, torque: float, cycle: float) -> None:
    """Advance the model by ``cycle`` [s] under the constant ``torque`` T [N·m]."""
    state.torque = torque
    inertia = feel.inertia
    x, v = state.angle, state.velocity
    acceleration = 0.0
    remaining = cycle
    for _ in range(_EVENTS):
        if remaining <= 0.0:
            break
        if v == 0.0:
            net = torque - spring_torque(feel, x)
            if abs(net) <= feel.friction:  # sticks for the rest of the cycle
                acceleration = 0.0
                break
            way = 1.0 if net > 0.0 else -1.0
        else:
            way = 1.0 if v > 0.0 else -1.0
        # A body that stands on an edge belongs to the side it moves to.
        c, offset, d, low, high = segment(feel, x + way * 1e-13)
        decay, k = 0.5 * d / inertia, c / inertia
        drive = (torque - offset - way * feel.friction - c * x) / inertia
        # Short enough that the body cannot turn round twice.
        time = remaining if k * remaining * remaining < 1.0 else 1.0 / math.sqrt(k)
        q, dq, ddq = response(time, decay, k)
        end_v = v * ddq + drive * dq
        if end_v * way <= 0.0:
            time = _root(0.0, True, x, v, drive, decay, k, time)
            q, dq, ddq = response(time, decay, k)
            end_v = 0.0
        end_x = x + v * dq + drive * q
        edge = high if way > 0.0 else low
        if (end_x - edge) * way > 0.0:
            time = _root(edge, False, x, v, drive, decay, k, time)
            q, dq, ddq = response(time, decay, k)
            end_x, end_v = edge, v * ddq + drive * dq
        acceleration = (torque - offset - way * feel.friction - c * end_x - d * end_v) / inertia
        x, v = end_x, end_v
        remaining -= time
    state.angle = x
    state.velocity = v
    state.acceleration = acceleration
