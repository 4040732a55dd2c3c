"""Motion of the feel model's bodies over a PLC cycle, exactly, from event to event.

    I_i φ̈_i + d_i φ̇_i + (springs of body i) ± T_linkage + F_i = T_i,   i = column, aft

F is Coulomb's friction with stiction: a body at rest stays there while the other torques sum up to no more than its
static friction; in motion F = μ + (μ_static − μ) exp(−|φ̇| / v_stribeck).

Between events (a spring's end, a stop reached or left, a clutch that slips, a reversal, a body that breaks away) the
law is linear, but for a detent's sine and Stribeck's curve. There the motion is a power series in time, whose
coefficients follow from the law one from the other,

    φ_{k+2} = (T [k = 0] − c φ_k − (k+1) d φ_{k+1} − …) / (I (k+1) (k+2)),

with those of sine, cosine and exponential by their own recurrences. A piece is so short that the series converges to
rounding; an event within it is bisected on the polynomial. So there is no integration error, no numerical damping, no
creep and no energy gained, at any cycle time.
"""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import MOMENT, NUDGE, TERMS, condition, ends_below
from cls_bench.feel.model import act, each_cycle, forget, show

PIECES = 1 << 20
"""Most pieces in a cycle; one of 400 µs has one or two."""

_REACH = 0.4
"""Longest piece, in the time of the fastest motion."""

_SOON = 1e-9
"""Shortest piece to an event, as a share of the piece: an event at hand does not stop time."""

_RATTLING, _COARSE = 100, 1e-3
"""After so many pieces in a cycle, the shortest to an event is that share of the cycle: what rattles without an end, as
at a kink where the torque jumps, comes to rest.
"""

_CURVE_ENDS = 32.0
"""Speed, in Stribeck velocities, from which on nothing is left of Stribeck's curve: e⁻³² is 1e-14."""


@compiled
def _clear(feel: Any, state: Any, piece: Any) -> None:
    """Begin a piece where the bodies are: nothing acts on them yet."""
    piece.angle[0], piece.velocity[0] = state.angle, state.velocity
    piece.angle[1], piece.velocity[1] = state.aft_angle, state.aft_velocity
    for i in range(2):
        piece.stiffness[i], piece.damping[i], piece.offset[i] = 0.0, 0.0, 0.0
        piece.sine[i] = 0.0
        piece.coulomb[i], piece.static[i], piece.stribeck[i], piece.held[i] = 0.0, 0.0, 0.0, 0
    piece.link_stiffness, piece.link_damping, piece.link_offset = 0.0, 0.0, 0.0
    for i in range(3):
        piece.low[i], piece.high[i] = -math.inf, math.inf
    piece.conditions = 0
    piece.inertia[0] = feel.inertia
    piece.damping[0] = feel.damping
    piece.coulomb[0] = feel.friction
    piece.static[0] = max(feel.friction, feel.static_friction)
    piece.stribeck[0] = feel.stribeck_velocity


@compiled
def _sign(x: float) -> float:
    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else 0.0


@compiled
def _look(feel: Any, state: Any, piece: Any) -> None:
    """The linear piece around the bodies, on the side to which each is on its way."""
    _clear(feel, state, piece)
    piece.ahead[0] = state.angle + piece.way[0] * NUDGE
    piece.speed_ahead[0] = state.velocity + MOMENT * state.acceleration
    piece.ahead[1] = state.aft_angle + piece.way[1] * NUDGE
    piece.speed_ahead[1] = state.aft_velocity + MOMENT * state.aft_acceleration
    apart_way = _sign(state.velocity - state.aft_velocity)
    if apart_way == 0.0:
        apart_way = _sign(piece.way[0] - piece.way[1])
    piece.apart_ahead = state.angle - state.aft_angle + apart_way * NUDGE
    act(feel, state, piece)
    for i in range(2):
        if piece.stribeck[i] > 0.0:
            end, speed = _CURVE_ENDS * piece.stribeck[i], abs(piece.velocity[i])
            if piece.static[i] <= piece.coulomb[i]:
                piece.stribeck[i] = 0.0
            elif speed > end:
                piece.stribeck[i] = 0.0
                condition(piece, i, 0.0, piece.way[i], -end)
            else:
                condition(piece, i, 0.0, -piece.way[i], end)


@compiled
def _own(piece: Any, i: int) -> float:
    """Torque [N·m] on a body at rest, but for friction and the linkage."""
    own = piece.torque[i] - piece.stiffness[i] * piece.angle[i] - piece.offset[i]
    if piece.sine[i] != 0.0:
        own -= piece.sine[i] * math.sin(piece.sine_wave[i] * (piece.angle[i] - piece.sine_centre[i]))
    return float(own)


@compiled
def _link(piece: Any, apart: float, rate: float) -> float:
    """Torque [N·m] of the linkage on the aft body, by the bodies' difference."""
    return float(piece.link_stiffness * apart + piece.link_damping * rate + piece.link_offset)


@compiled
def _net(piece: Any, i: int) -> float:
    """Torque [N·m] on a body at rest, but for friction."""
    net = _own(piece, i)
    if piece.aft == 1:
        link = _link(piece, piece.angle[0] - piece.angle[1], piece.velocity[0] - piece.velocity[1])
        net += link if i == 1 else -link
    return float(net)


@compiled
def _choose(feel: Any, state: Any, piece: Any, last: int) -> None:
    """Find the piece, and for each body whether it moves, and whither; 0 is at rest."""
    piece.way[0], piece.way[1] = _sign(state.velocity), _sign(state.aft_velocity)
    for _ in range(2):
        _look(feel, state, piece)
        caught = False
        for i in range(last + 1):
            if piece.held[i] != 0:
                caught = caught or piece.velocity[i] != 0.0
                piece.way[i] = 0.0
                if i == 0:
                    state.velocity = 0.0
                else:
                    state.aft_velocity = 0.0
        if caught:  # what is jammed has stopped: what the other body feels of it is another thing now
            continue
        settled = True
        for i in range(last + 1):
            if piece.held[i] == 0 and piece.velocity[i] == 0.0:
                net = _net(piece, i)
                if abs(net) > piece.static[i] or piece.static[i] == 0.0:
                    piece.way[i] = 1.0 if net >= 0.0 else -1.0
                    settled = False
        if settled:
            return
        _look(feel, state, piece)
        for i in range(last + 1):
            if piece.way[i] != 0.0 and piece.velocity[i] == 0.0 and piece.way[i] * _net(piece, i) < -piece.static[i]:
                # At a kink where the torque jumps, and either side drives back to it: there it stays in this cycle.
                piece.way[i], piece.held[i] = 0.0, 1
        return


@compiled
def _rate(piece: Any, last: int) -> float:
    """A bound of the fastest motion [1/s]."""
    squares, rate = 0.0, 0.0
    for i in range(last + 1):
        if piece.way[i] == 0.0:
            continue
        stiffness = abs(piece.stiffness[i]) + piece.link_stiffness
        damping = abs(piece.damping[i]) + piece.link_damping
        net = _net(piece, i) if piece.sine[i] != 0.0 or piece.stribeck[i] > 0.0 else 0.0
        if piece.sine[i] != 0.0:
            stiffness += piece.sine[i] * piece.sine_wave[i]
            rate += piece.sine_wave[i] * abs(piece.velocity[i])
            squares += piece.sine_wave[i] * abs(net) / piece.inertia[i]
        if piece.stribeck[i] > 0.0:
            over = (piece.static[i] - piece.coulomb[i]) * math.exp(-abs(piece.velocity[i]) / piece.stribeck[i])
            net -= piece.damping[i] * piece.velocity[i] + piece.way[i] * (piece.coulomb[i] + over)
            damping += over / piece.stribeck[i]
            rate += abs(net) / (piece.inertia[i] * piece.stribeck[i])
        squares += stiffness / piece.inertia[i]
        rate += damping / piece.inertia[i]
    return rate + math.sqrt(squares)


@compiled
def _series(piece: Any, last: int, time: float, terms: int) -> None:
    """Coefficients of the bodies' angles in the share of ``time`` [s] that has passed: φ = Σ terms_k sᵏ."""
    per = 1.0 / time
    for i in range(last + 1):
        piece.terms[i, 0], piece.terms[i, 1] = piece.angle[i], piece.velocity[i] * time
        if piece.sine[i] != 0.0:
            phase = piece.sine_wave[i] * (piece.angle[i] - piece.sine_centre[i])
            piece.sines[i, 0], piece.cosines[i, 0] = math.sin(phase), math.cos(phase)
        if piece.stribeck[i] > 0.0:
            piece.curve[i, 0] = math.exp(-abs(piece.velocity[i]) / piece.stribeck[i])
    if last == 0:
        piece.terms[1, 0], piece.terms[1, 1] = 0.0, 0.0
    for k in range(terms - 2):
        share = time * time / ((k + 1) * (k + 2))
        link = 0.0
        if last == 1:
            link = piece.link_stiffness * (piece.terms[0, k] - piece.terms[1, k])
            link += piece.link_damping * per * (k + 1) * (piece.terms[0, k + 1] - piece.terms[1, k + 1])
            if k == 0:
                link += piece.link_offset
        for i in range(last + 1):
            if piece.way[i] == 0.0:
                piece.terms[i, k + 2] = 0.0
                continue
            torque = -piece.stiffness[i] * piece.terms[i, k]
            torque -= piece.damping[i] * per * (k + 1) * piece.terms[i, k + 1]
            torque += link if i == 1 else -link
            if k == 0:
                torque += piece.torque[i] - piece.offset[i] - piece.way[i] * piece.coulomb[i]
            if piece.sine[i] != 0.0:
                if k > 0:
                    sine = cosine = 0.0
                    for j in range(1, k + 1):
                        step = j * piece.sine_wave[i] * piece.terms[i, j]
                        sine += step * piece.cosines[i, k - j]
                        cosine -= step * piece.sines[i, k - j]
                    piece.sines[i, k], piece.cosines[i, k] = sine / k, cosine / k
                torque -= piece.sine[i] * piece.sines[i, k]
            if piece.stribeck[i] > 0.0:
                if k > 0:
                    curve = 0.0
                    for j in range(1, k + 1):
                        speed = (j + 1) * piece.terms[i, j + 1] * per
                        curve -= j * piece.way[i] * speed / piece.stribeck[i] * piece.curve[i, k - j]
                    piece.curve[i, k] = curve / k
                torque -= piece.way[i] * (piece.static[i] - piece.coulomb[i]) * piece.curve[i, k]
            piece.terms[i, k + 2] = torque * share / piece.inertia[i]


@compiled
def _terms(piece: Any, last: int, reach: float) -> int:
    """How many terms converge to rounding within ``reach``, the piece's length in the time of the fastest motion.

    Of a linear law the terms fall as reachᵏ / k!, of a sine and of Stribeck's curve as reachᵏ at least.
    """
    linear = piece.sine[0] == 0.0 and piece.stribeck[0] == 0.0
    if last == 1:
        linear = linear and piece.sine[1] == 0.0 and piece.stribeck[1] == 0.0
    if reach < 0.02:
        return 8 if linear else 12
    if reach < 0.1:
        return 11 if linear else 18
    return 16 if linear else TERMS


@compiled
def _angle(piece: Any, i: int, share: float, terms: int) -> float:
    value = 0.0
    for k in range(terms - 1, -1, -1):
        value = value * share + piece.terms[i, k]
    return value


@compiled
def _velocity(piece: Any, i: int, share: float, terms: int, time: float) -> float:
    value = 0.0
    for k in range(terms - 1, 0, -1):
        value = value * share + k * piece.terms[i, k]
    return value / time


@compiled
def _acceleration(piece: Any, i: int, share: float, terms: int, time: float) -> float:
    value = 0.0
    for k in range(terms - 1, 1, -1):
        value = value * share + k * (k - 1) * piece.terms[i, k]
    return value / (time * time)


@compiled
def _events(piece: Any, last: int) -> int:
    """Put all events of the piece beside the elements' own; returns the first of the bodies' own.

    Of each body two: its reversal, and the edge ahead. Without friction nothing changes at a reversal; the edge behind
    is then the other one.
    """
    if last == 1:
        for i in range(2):
            if piece.way[i] == 0.0 and piece.held[i] == 0:  # the other body may tear it away
                k, d = piece.link_stiffness, piece.link_damping
                sign = 1.0 if i == 1 else -1.0
                own = _own(piece, i) + sign * piece.link_offset
                for side in (1.0, -1.0):
                    s = side * sign
                    ends_below(piece, -s * k, -s * d, s * k, s * d, piece.static[i] - side * own)
        if piece.high[2] < math.inf:
            ends_below(piece, -1.0, 0.0, 1.0, 0.0, piece.high[2])
        if piece.low[2] > -math.inf:
            ends_below(piece, 1.0, 0.0, -1.0, 0.0, -piece.low[2])
    first = piece.conditions
    for i in range(last + 1):
        a, c = (1.0, 0.0) if i == 0 else (0.0, 1.0)
        way = piece.way[i]
        behind, edge = (piece.low[i], piece.high[i]) if way >= 0.0 else (piece.high[i], piece.low[i])
        if piece.static[i] > 0.0 or way == 0.0:
            ends_below(piece, 0.0, way * a, 0.0, way * c, 0.0)
        else:
            ends_below(piece, way * a, 0.0, way * c, 0.0, -way * behind if abs(behind) < math.inf else math.inf)
        reachable = way != 0.0 and abs(edge) < math.inf
        ends_below(piece, -way * a, 0.0, -way * c, 0.0, way * edge if reachable else math.inf)
    return int(first)


@compiled
def _first_event(piece: Any, last: int, terms: int, time: float, soon: float) -> tuple[float, int]:
    """The share of the piece at which the first event comes, and its row; 1 and −1 if none does.

    An event is where its expression is below 0. It is bisected, to the last bit, on the expression's polynomial. Angles
    and velocities at that share are left in the piece.
    """
    share, what = 1.0, -1
    x0, v0, x1, v1 = 0.0, 0.0, 0.0, 0.0
    new = True
    for row in range(piece.conditions + 1):
        if new:
            x0, v0 = _angle(piece, 0, share, terms), _velocity(piece, 0, share, terms, time)
            if last == 1:
                x1, v1 = _angle(piece, 1, share, terms), _velocity(piece, 1, share, terms, time)
            new = False
        if row == piece.conditions:
            break
        a, b, c, d = piece.condition[row, 0], piece.condition[row, 1], piece.condition[row, 2], piece.condition[row, 3]
        e = piece.condition[row, 4]
        if not a * x0 + b * v0 + c * x1 + d * v1 + e < 0.0:
            continue
        for k in range(terms):
            term = a * piece.terms[0, k] + c * piece.terms[1, k]
            if k + 1 < terms:
                term += (k + 1) * (b * piece.terms[0, k + 1] + d * piece.terms[1, k + 1]) / time
            piece.event[k] = term
        piece.event[0] += e
        low, high = 0.0, share
        for _ in range(64):
            middle = 0.5 * (low + high)
            if middle <= low or middle >= high:
                break
            value = 0.0
            for k in range(terms - 1, -1, -1):
                value = value * middle + piece.event[k]
            if value < 0.0:
                high = middle
            else:
                low = middle
        share, what, new = max(high, soon), row, True
    piece.angle[0], piece.velocity[0], piece.angle[1], piece.velocity[1] = x0, v0, x1, v1
    return share, what


@compiled
def _arrive(state: Any, piece: Any, event: int, rattling: bool) -> None:
    """At an event of a single body it is where the event is, without rounding; at rest there if it rattles."""
    if event < 0:
        return
    i = event // 2
    reversal = event % 2 == 0 and piece.static[i] > 0.0
    if not reversal:
        ahead = event % 2 == 1
        edge = piece.high[i] if (piece.way[i] > 0.0) == ahead else piece.low[i]
        if i == 0:
            state.angle = edge
        else:
            state.aft_angle = edge
    if reversal or rattling:
        if i == 0:
            state.velocity = 0.0
        else:
            state.aft_velocity = 0.0


@compiled
def step(feel: Any, state: Any, piece: Any, torque: float, time: float, cycle: float) -> None:
    """Advance the model by ``cycle`` [s] from ``time`` [s] on, under the pilot's constant ``torque`` [N·m]."""
    last = 1 if feel.bodies == 1 else 0
    piece.aft = last
    if last == 1:
        state.seat_angle, state.seat_velocity = state.aft_angle, state.aft_velocity
    else:
        state.seat_angle, state.seat_velocity = state.angle, state.velocity
    state.own_torque, state.aft_torque = 0.0, 0.0
    each_cycle(feel, state, time, cycle)
    state.torque = torque + state.own_torque
    if last == 1:
        piece.torque[0], piece.torque[1] = state.torque - state.aft_torque, state.aft_torque
    else:
        piece.torque[0] = state.torque
    remaining = cycle
    for count in range(PIECES):
        _choose(feel, state, piece, last)
        if piece.way[0] == 0.0 and (last == 0 or piece.way[1] == 0.0):  # at rest for the rest of the cycle
            state.acceleration, state.aft_acceleration = 0.0, 0.0
            state.velocity, state.aft_velocity = 0.0, 0.0
            break
        rate = _rate(piece, last)
        length = remaining if rate * remaining <= _REACH else _REACH / rate
        terms = _terms(piece, last, rate * length)
        _series(piece, last, length, terms)
        first = _events(piece, last)
        rattling = count >= _RATTLING and length > _COARSE * cycle
        soon = _COARSE * cycle / length if rattling else _SOON
        share, what = _first_event(piece, last, terms, length, soon)
        state.angle, state.velocity = piece.angle[0], piece.velocity[0]
        state.acceleration = _acceleration(piece, 0, share, terms, length)
        if last == 1:
            state.aft_angle, state.aft_velocity = piece.angle[1], piece.velocity[1]
            state.aft_acceleration = _acceleration(piece, 1, share, terms, length)
        _arrive(state, piece, what - first, rattling)
        if share == 1.0 and length == remaining:
            break
        remaining -= share * length
        if not remaining > 0.0:  # nor for a number that is none, in which there are no events
            break
    if last == 1:
        state.seat_angle, state.seat_velocity = state.aft_angle, state.aft_velocity
        apart, rate = state.angle - state.aft_angle, state.velocity - state.aft_velocity
        state.surface.cable_torque = _link(piece, apart, rate)
    else:
        state.aft_angle, state.aft_velocity = state.angle, state.velocity
        state.aft_acceleration = state.acceleration
        state.seat_angle, state.seat_velocity = state.angle, state.velocity
        state.surface.cable_torque = 0.0
    state.surface.feel_torque = 0.0
    show(feel, state)


@compiled
def follow(feel: Any, state: Any, angle: float, velocity: float, torque: float) -> None:
    """While nothing obeys the model, it goes along with the column [rad, rad/s]; the aft body too."""
    state.angle, state.velocity, state.acceleration = angle, velocity, 0.0
    state.aft_angle, state.aft_velocity, state.aft_acceleration = angle, velocity, 0.0
    state.seat_angle, state.seat_velocity = angle, velocity
    state.torque, state.own_torque, state.aft_torque = torque, 0.0, 0.0
    state.surface.cable_torque, state.surface.feel_torque = 0.0, 0.0
    forget(feel, state)
    show(feel, state)
    shown = state.surface
    total = shown.deflection + shown.velocity + shown.hinge_moment + shown.feel_torque + shown.autopilot_torque
    if not abs(total + shown.trim) < math.inf:  # a parameter that is no number has switched the drive off
        shown.deflection, shown.velocity, shown.hinge_moment = 0.0, 0.0, 0.0
        shown.feel_torque, shown.autopilot_torque, shown.trim = 0.0, 0.0, 0.0
