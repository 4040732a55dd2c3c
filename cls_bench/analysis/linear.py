"""Linear model of the whole bench for small motion about neutral, derived on its own from the book.

Nothing here is taken from the simulation: the plant is written down as five coupled inertias and solved exactly with
the matrix exponential; the sampled side is the block diagram of thesis figures 3.31 to 3.33 and 3.38 with its delays.
So agreement with the simulation is evidence for both.

**Plant.** Coordinates q = (motor, carrier, crank, column, limb) [rad]::

    M q̈ + D q̇ + K q = e_motor · K_t i + e_limb · T_hand
    L di/dt = u − R i − K_t θ̇

The meshes are springs k (θ/r − γ)²/2 at each stage's output, the load cell a spring between crank and column,

    force in the rod  F = c x + d ẋ,   x = r_arm φ − r_crank φ_c     (rod horizontal at neutral)

and the grip a spring and damper between column and limb. Gravity acts as the negative stiffness of what stands above
its axis. The mass of the rod's far end on the motor's side of the strain gauge moves with the crank, the rest of it
with the column (thesis 3.6.2: I_fwd is what lies forward of the gauge). Left out: all that is not linear (backlash,
friction, limits, quantisation, noise).

**Sampling.** Everything repeats after one PLC cycle of 400 µs. One cycle is worked through tick by tick (50 µs) with
every signal represented as a *linear form*, a row of coefficients over (state at the start of the cycle, inputs in
it). What comes out is the exact map of one cycle to the next, and with it

* stability: the eigenvalues of that map, no approximation by continuous delays;
* the loop gain G(e^{jωT}) from the feel model's torque to −T_meas, a single-input single-output sampled system, for
  Nyquist's criterion and margins with python-control;
* frequency responses between any two signals, each at the instants at which it is sampled or recorded.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from cls_bench.parameters import GRAVITY, Parameters
from cls_bench.signals import PLC_S, PLC_TICKS, TICK_S, VELOCITY_S, VELOCITY_TICKS

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

MOTOR, CARRIER, CRANK, COLUMN, LIMB = range(5)
"""Places in q."""

SLOW = 10.0
"""Where the loop's own oscillations begin [Hz]; voluntary motion and the arm on its stiffness stay below."""


@dataclass(frozen=True)
class Hand:
    """The hand at the operating point."""

    squeeze: float | None = 1.0
    """how tightly it grips, 0 loose to 1 tight; None when it has let go"""
    arm: bool = True
    """whether the arm holds its place with its impedance; otherwise the limb's mass is free"""


@dataclass(frozen=True)
class Compensation:
    """Post-sensor inertia compensation: T̃ = T_meas + inertia · φ̈, φ̈ from the encoder (thesis Eq. 3.10)."""

    inertia: float
    """[kg·m²]"""
    filter_time: float
    """time constant of the low pass on φ̈ [s]"""


def forward_inertia(p: Parameters, hand: Hand) -> float:
    """I_fwd [kg·m²]: column, what hangs on it forward of the strain gauge, and a limb as if gripped rigidly."""
    limb = 0.0 if hand.squeeze is None else p.limb.mass * p.column.grip_height**2
    return p.column.inertia + p.linkage.rod_end_mass * p.linkage.arm**2 + limb


def limb_mass_for(p: Parameters, inertia: float) -> float:
    """Limb mass [kg] with which a rigid grip makes I_fwd ``inertia`` [kg·m²]; negative below the bare column's."""
    return (inertia - forward_inertia(p, Hand(None))) / p.column.grip_height**2


@dataclass(frozen=True)
class Plant:
    """M q̈ + D q̇ + K q = …, the motor's electrical side and the force in the rod, all for small motion."""

    mass: Array
    damping: Array
    stiffness: Array
    rod_force: Array
    """force in the rod [N] over (q, q̇)"""
    grip: tuple[float, float]
    """stiffness [N·m/rad] and damping [N·m·s/rad] of the grip about the column's axis"""
    motor: tuple[float, float, float]
    """torque constant [N·m/A], resistance [Ω], inductance [H]"""

    @property
    def freedoms(self) -> int:
        """4 without a limb, 5 with it."""
        return len(self.mass)

    def sampled(self, period: float) -> tuple[Array, Array]:
        """Exact transition of (q, q̇, i) over ``period`` [s], and its response to voltage and hand torque held."""
        n = self.freedoms
        constant, resistance, inductance = self.motor
        inverse = np.linalg.inv(self.mass)
        a = np.zeros((2 * n + 1, 2 * n + 1))
        a[:n, n : 2 * n] = np.eye(n)
        a[n : 2 * n, :n] = -inverse @ self.stiffness
        a[n : 2 * n, n : 2 * n] = -inverse @ self.damping
        a[n : 2 * n, 2 * n] = inverse[:, MOTOR] * constant
        a[2 * n, n + MOTOR] = -constant / inductance
        a[2 * n, 2 * n] = -resistance / inductance
        b = np.zeros((2 * n + 1, 2))
        b[2 * n, 0] = 1.0 / inductance
        b[n : 2 * n, 1] = inverse[:, n - 1]  # on the limb; on the column when the hand is off
        block = expm(np.block([[a, b], [np.zeros((2, 2 * n + 3))]]) * period)
        return block[: 2 * n + 1, : 2 * n + 1], block[: 2 * n + 1, 2 * n + 1 :]


def _spring(n: int, value: float, coefficients: Mapping[int, float]) -> Array:
    """Matrix of a spring or damper over Σ coefficient · q."""
    row = np.zeros(n)
    for place, coefficient in coefficients.items():
        row[place] = coefficient
    return value * np.outer(row, row)


def plant(p: Parameters, hand: Hand) -> Plant:
    """The plant at neutral with the parameters ``p``."""
    box, link, column, limb = p.gearbox, p.linkage, p.column, p.limb
    n = 4 if hand.squeeze is None else 5
    far = link.rod_column_mass - link.rod_end_mass  # motor's side of the strain gauge
    area = column.grip_height**2

    inertias = [
        p.motor.rotor_inertia + box.input_inertia,
        box.carrier1_inertia,
        box.carrier2_inertia + link.crank_inertia + (link.rod_crank_mass + far) * link.crank**2,
        column.inertia + link.rod_end_mass * link.arm**2,
        limb.mass * area,
    ]
    mass = np.diag(inertias[:n])

    def critical(stiffness: float, one: float, other: float) -> float:
        return 2.0 * math.sqrt(stiffness * one * other / (one + other))

    # The crank's own inertia carries the second mesh's damping ratio: a designer's number, without the rod's masses.
    crank = box.carrier2_inertia + link.crank_inertia
    stage1 = {MOTOR: 1.0 / box.ratio, CARRIER: -1.0}
    stage2 = {CARRIER: 1.0 / box.ratio, CRANK: -1.0}
    d1 = box.stage1.damping_ratio * critical(box.stage1.stiffness, inertias[MOTOR] * box.ratio**2, inertias[CARRIER])
    d2 = box.stage2.damping_ratio * critical(box.stage2.stiffness, inertias[CARRIER] * box.ratio**2, crank)
    cell = {COLUMN: link.arm, CRANK: -link.crank}
    carried = link.rod_end_mass + column.inertia / link.arm**2
    d_cell = p.load_cell.damping_ratio * 2.0 * math.sqrt(p.load_cell.stiffness * carried)

    stiffness = (
        _spring(n, box.stage1.stiffness, stage1)
        + _spring(n, box.stage2.stiffness, stage2)
        + _spring(n, p.load_cell.stiffness, cell)
    )
    damping = (
        _spring(n, d1, stage1)
        + _spring(n, d2, stage2)
        + _spring(n, d_cell, cell)
        + _spring(n, column.viscous_friction, {COLUMN: 1.0})
    )
    stiffness[CRANK, CRANK] -= GRAVITY * link.rod_crank_mass * link.crank
    stiffness[COLUMN, COLUMN] -= unbalance(p)
    grip = (0.0, 0.0)
    if hand.squeeze is not None:
        grip = (
            area * _squeezed(limb.loose_stiffness, limb.tight_stiffness, hand.squeeze),
            area * _squeezed(limb.loose_damping, limb.tight_damping, hand.squeeze),
        )
        stiffness += _spring(n, grip[0], {LIMB: 1.0, COLUMN: -1.0})
        damping += _spring(n, grip[1], {LIMB: 1.0, COLUMN: -1.0})
        if hand.arm:
            stiffness[LIMB, LIMB] += area * limb.arm_stiffness
            damping[LIMB, LIMB] += area * limb.arm_damping
    rod_force = np.zeros(2 * n)
    rod_force[[COLUMN, CRANK]] = p.load_cell.stiffness * np.array([link.arm, -link.crank])
    rod_force[[n + COLUMN, n + CRANK]] = d_cell * np.array([link.arm, -link.crank])
    return Plant(
        mass, damping, stiffness, rod_force, grip, (p.motor.torque_constant, p.motor.resistance, p.motor.inductance)
    )


def _squeezed(loose: float, tight: float, squeeze: float) -> float:
    """A grip value at ``squeeze``: on a logarithmic scale, or straight where one end is zero."""
    if loose > 0.0 and tight > 0.0:
        return float(loose ** (1.0 - squeeze) * tight**squeeze)
    return loose + squeeze * (tight - loose)


def unbalance(p: Parameters) -> float:
    """Torque of gravity per angle about neutral [N·m/rad]: of the column, and of the rod's share that hangs on it."""
    return GRAVITY * (p.column.mass * p.column.mass_height + p.linkage.rod_column_mass * p.linkage.arm)


def _removed_unbalance(p: Parameters) -> float:
    """What the PLC takes out per angle: the least-squares line to the unbalance torque over the travel a.

    ∫ φ sin φ dφ / ∫ φ² dφ over ±a, times the slope at neutral.
    """
    a = p.column.travel
    return unbalance(p) * 3.0 * (math.sin(a) - a * math.cos(a)) / a**3


INPUTS = ("torque", "angle", "velocity", "hand")
"""Where the model can be excited: torque at the feel model's input [N·m], set angle and set velocity of the column at
the PLC's output [rad, rad/s] (all held for a PLC cycle), torque on the limb [N·m] (held for a tick)."""


@dataclass(frozen=True)
class Lifted:
    """One cycle of the bench: x⁺ = A x + Σ B_k u_k, and signals y_j = C_j x + Σ D_jk u_k at their ticks."""

    transition: Array
    inputs: Mapping[str, Sequence[tuple[int, Array]]]
    """per input: (tick, column B_k)"""
    signals: Mapping[str, Sequence[tuple[int, Array, Mapping[str, Array]]]]
    """per signal: (tick, row C_j, per input the D_jk in the order of :attr:`inputs`)"""

    @cached_property
    def eigenvalues(self) -> ComplexArray:
        """Of the map from one cycle to the next."""
        return np.asarray(np.linalg.eigvals(self.transition), dtype=complex)

    def spectrum(self, source: str, frequencies: Any) -> dict[str, ComplexArray]:
        """Amplitude and phase of every signal for the input ``source`` = e^{jωt} at ``frequencies`` [Hz].

        Each as the discrete Fourier transform of the recorded signal would give it, at its own sampling rate.
        """
        omega = 2.0 * np.pi * np.atleast_1d(np.asarray(frequencies, dtype=float))
        result = {name: np.zeros(len(omega), dtype=complex) for name in self.signals}
        identity = np.eye(len(self.transition))
        for at, w in enumerate(omega):
            held = [np.exp(1j * w * tick * TICK_S) for tick, _ in self.inputs[source]]
            drive = sum(h * b for h, (_, b) in zip(held, self.inputs[source], strict=True))
            x = np.linalg.solve(np.exp(1j * w * PLC_S) * identity - self.transition, drive)
            for name, samples in self.signals.items():
                for tick, c, d in samples:
                    value = c @ x + np.dot(d[source], held)
                    result[name][at] += value * np.exp(-1j * w * tick * TICK_S) / len(samples)
        return result


class _Forms:
    """Signals as rows of coefficients over (states at the start of the cycle, inputs during it)."""

    def __init__(self, states: Sequence[str], inputs: Sequence[tuple[str, int]]):
        self.size = len(states) + len(inputs)
        self.states = list(states)
        self.inputs = list(inputs)
        unit = np.eye(self.size)
        self.value = {name: unit[k] for k, name in enumerate(states)}
        self.source = {key: unit[len(states) + k] for k, key in enumerate(inputs)}
        self.recorded: dict[str, list[tuple[int, Array]]] = {}

    def zero(self) -> Array:
        return np.zeros(self.size)

    def record(self, tick: int, **signals: Array) -> None:
        for name, row in signals.items():
            self.recorded.setdefault(name, []).append((tick, row.copy()))

    def lifted(self) -> Lifted:
        n = len(self.states)
        end = np.array([self.value[name] for name in self.states])
        names = dict.fromkeys(name for name, _ in self.inputs)
        places = {name: [n + k for k, (other, _) in enumerate(self.inputs) if other == name] for name in names}
        return Lifted(
            end[:, :n],
            {
                name: [(tick, end[:, n + k]) for k, (other, tick) in enumerate(self.inputs) if other == name]
                for name in names
            },
            {
                name: [(tick, row[:n], {i: row[places[i]] for i in names}) for tick, row in rows]
                for name, rows in self.recorded.items()
            },
        )


@dataclass(frozen=True)
class LinearBench:
    """The bench with parameters ``p``, linear about neutral, in position or velocity architecture.

    ``closed``: whether the load cell's torque reaches the feel model; open for the loop gain. ``model``: whether there
    is a feel model at all, or set values from outside alone; without it for the inner loop.
    """

    p: Parameters
    hand: Hand = field(default_factory=Hand)
    compensation: Compensation | None = None
    closed: bool = True
    model: bool = True

    @cached_property
    def plant(self) -> Plant:
        """The continuous part."""
        return plant(self.p, self.hand)

    @cached_property
    def lifted(self) -> Lifted:
        """One PLC cycle of everything."""
        return _cycle(self.p, self.plant, self.compensation, self.closed, self.model)

    @cached_property
    def growth(self) -> complex:
        """Fastest growing (or slowest decaying) oscillation: growth rate + j · angular frequency [1/s, rad/s].

        Motion slower than :data:`SLOW` is left out unless it grows: the hand's and the feel model's own, which has
        nothing to do with the loop's stability limit.
        """
        values = self.lifted.eigenvalues
        s = np.log(values[np.abs(values) > 1e-9]) / PLC_S
        fast = s[(np.abs(s.imag) > 2.0 * math.pi * SLOW) | (s.real > 1e-3)]
        top = fast[np.argmax(fast.real)]
        return complex(top.real, abs(top.imag))

    @property
    def stable(self) -> bool:
        """Whether every oscillation decays."""
        return self.growth.real < 0.0

    def open_loop(self) -> Any:
        """G(z) from the feel model's torque to −T_meas as a python-control state-space system at the PLC's rate."""
        import control

        opened = LinearBench(self.p, self.hand, self.compensation, closed=False).lifted
        ((_, b),) = opened.inputs["torque"]
        ((_, c, d),) = opened.signals["measured_torque"]
        return control.ss(
            opened.transition, b[:, None], -c[None, :], -np.atleast_2d(d["torque"]), PLC_S,
            inputs="T_model", outputs="T_meas", name="G",
        )  # fmt: skip


def _cycle(p: Parameters, plant: Plant, compensation: Compensation | None, closed: bool, model: bool) -> Lifted:
    """Work through the eight ticks of one PLC cycle with linear forms."""
    n = plant.freedoms
    drive, motor, feel = p.drive, p.motor, p.feel
    ratio = p.gearbox.ratio**2 * p.linkage.arm / p.linkage.crank  # motor over column
    body = [*(f"q{k}" for k in range(n)), *(f"v{k}" for k in range(n)), "current"]
    command, feedback = p.plc.command_latency, p.plc.feedback_latency
    fields = ("position", "velocity", "acceleration", "torque")
    states = [
        *body, "amplifier", "encoder_before", "speed", "speed_integral", "output", "position_integral", "ahead",
        "current_integral", "feel_angle", "feel_velocity", "acceleration", "velocity_before",
        *(f"voltage-{k}" for k in range(1, drive.voltage_latency + 1)),
        *(f"{name}-{k}" for name in fields for k in range(1, command + 1)),
        *(f"{name}-{k}" for name in ("angle", "rate") for k in range(1, feedback + 1)),
    ]  # fmt: skip
    inputs = [("torque", 0), ("angle", 0), ("velocity", 0), *(("hand", tick) for tick in range(PLC_TICKS))]
    f = _Forms(states, inputs)
    v = f.value
    transition, response = plant.sampled(TICK_S)

    # Gains as designed: thesis 3.6.1 with the bandwidths of the parameters.
    current_p = 2.0 * math.pi * drive.current_bandwidth * motor.inductance
    current_i = 2.0 * math.pi * drive.current_bandwidth * motor.resistance
    speed_p = 2.0 * math.pi * drive.velocity_bandwidth * drive.load_inertia
    position_p = 2.0 * math.pi * drive.position_bandwidth
    speed_weight = 1.0 - math.exp(-VELOCITY_S / drive.speed_filter_time) if drive.speed_filter_time > 0 else 1.0
    amplifier_weight = 1.0 - math.exp(-2.0 * math.pi * p.load_cell.filter_bandwidth * TICK_S)
    feel_transition, feel_response = _feel(feel)
    torque_command = f.zero()

    for tick in range(PLC_TICKS):
        rod_force = sum(c * v[body[k]] for k, c in enumerate(plant.rod_force))
        v["amplifier"] = v["amplifier"] + amplifier_weight * (rod_force - v["amplifier"])
        encoder = v["q0"]
        if tick % VELOCITY_TICKS == 0:  # speed filter
            raw = (encoder - v["encoder_before"]) / VELOCITY_S
            v["encoder_before"] = encoder
            v["speed"] = v["speed"] + speed_weight * (raw - v["speed"])

        if tick == 0:  # PLC
            seen = _shift(v, "angle", feedback, encoder) / ratio
            seen_speed = _shift(v, "rate", feedback, v["speed"]) / ratio
            measured = p.linkage.arm * v["amplifier"]
            if p.plc.remove_unbalance:
                measured = measured - _removed_unbalance(p) * seen
            torque = f.source["torque", 0] + (measured if closed else 0.0)
            if compensation is not None:
                weight = 1.0 - math.exp(-PLC_S / compensation.filter_time)
                raw = (seen_speed - v["velocity_before"]) / PLC_S
                v["acceleration"] = v["acceleration"] + weight * (raw - v["acceleration"])
                v["velocity_before"] = seen_speed
                if closed:
                    torque = torque + compensation.inertia * v["acceleration"]
                measured = measured + compensation.inertia * v["acceleration"]
            start = seen if p.plc.outer_loop == "velocity" else v["feel_angle"]
            angle, velocity = (
                feel_transition @ np.array([start, v["feel_velocity"]]) + np.outer(feel_response, torque)
            )
            v["feel_angle"], v["feel_velocity"] = angle, velocity
            acceleration = (torque - _stiffness(feel) * angle - feel.damping * velocity) / feel.inertia
            if not model:
                angle, velocity, acceleration = f.zero(), f.zero(), f.zero()
            set_angle = angle + f.source["angle", 0]
            set_velocity = velocity + f.source["velocity", 0]
            pilot = -measured / ratio if drive.feed_forward_pilot else f.zero()
            asked = [
                _shift(v, name, command, value)
                for name, value in zip(
                    fields, (ratio * set_angle, ratio * set_velocity, ratio * acceleration, pilot), strict=True
                )
            ]
            f.record(tick, measured_torque=measured, model_torque=torque, set_angle=set_angle)

            # Position controller, in the drive
            before = v["output"]
            if p.plc.outer_loop == "velocity":
                v["output"] = asked[1]
                set_position = encoder
            else:
                set_position = asked[0]
                error = set_position - encoder
                if drive.position_integral_time > 0:
                    v["position_integral"] = (
                        v["position_integral"] + position_p * PLC_S / drive.position_integral_time * error
                    )
                v["output"] = position_p * error + v["position_integral"]
                if drive.feed_forward_velocity:
                    v["output"] = v["output"] + asked[1]
            v["ahead"] = asked[3]
            if drive.feed_forward_inertia:
                v["ahead"] = v["ahead"] + drive.load_inertia * asked[2]
            f.record(tick, set_position=set_position, position=encoder, position_error=set_position - encoder)

        if tick % VELOCITY_TICKS == 0:  # velocity controller
            set_speed = 0.5 * (before + v["output"]) if tick == 0 else v["output"]
            error = set_speed - v["speed"]
            v["speed_integral"] = v["speed_integral"] + speed_p * VELOCITY_S / drive.velocity_integral_time * error
            torque_command = speed_p * error + v["speed_integral"] + v["ahead"]
            f.record(tick, set_velocity=set_speed, velocity=v["speed"], velocity_error=error)

        error = torque_command / motor.torque_constant - v["current"]
        v["current_integral"] = v["current_integral"] + current_i * TICK_S * error
        voltage = current_p * error + v["current_integral"] + motor.torque_constant * v["speed"]
        voltage = _shift(v, "voltage", drive.voltage_latency, voltage)

        grip = f.zero()
        if n > LIMB:
            grip = plant.grip[0] * (v["q4"] - v["q3"]) + plant.grip[1] * (v["v4"] - v["v3"])
        f.record(tick, column_angle=v["q3"], column_velocity=v["v3"], grip_torque=grip, rod_force=rod_force)

        state = np.array([v[name] for name in body])
        held = np.array([voltage, f.source["hand", tick]])
        state = transition @ state + response @ held
        for name, row in zip(body, state, strict=True):
            v[name] = row
    return f.lifted()


def _shift(value: dict[str, Array], name: str, delay: int, newest: Array) -> Array:
    """Put ``newest`` into a delay line; returns what comes out, ``delay`` steps old."""
    if delay == 0:
        return newest
    oldest = value[f"{name}-{delay}"]
    for k in range(delay, 1, -1):
        value[f"{name}-{k}"] = value[f"{name}-{k - 1}"]
    value[f"{name}-1"] = newest
    return oldest


def _stiffness(feel: Any) -> float:
    """Stiffness of the feel model about neutral [N·m/rad]; inside its breakout the centering unit adds its own."""
    centering = feel.centering_stiffness if feel.centering_breakout > 0 else 0.0
    return float(feel.stiffness + centering)


def _feel(feel: Any) -> tuple[Array, Array]:
    """I φ̈ + d φ̇ + c φ = T over one PLC cycle with T held: transition of (φ, φ̇) and response to T."""
    a = np.array([[0.0, 1.0, 0.0], [-_stiffness(feel), -feel.damping, 1.0], [0.0, 0.0, 0.0]])
    a[1] /= feel.inertia
    block = expm(a * PLC_S)
    return block[:2, :2], block[:2, 2]

