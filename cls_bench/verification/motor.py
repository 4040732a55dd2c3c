"""Motor: current step, torque-speed envelope, power balance, winding temperature."""

import math
from collections.abc import Iterator

import numpy as np

from cls_bench.parameters import RPM, Parameters
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Record, Specimen, Subject

GROUP = "motor"


def _alone(subject: Subject, p: Parameters) -> Specimen:
    """The rotor on its own: stage 1 without drag, its mesh with a play that is never taken up."""
    stage = p.gearbox.stage1.model_copy(update={"backlash": 1e9, "drag": 0.0})
    box = p.gearbox.model_copy(update={"stage1": stage})
    return subject.element(p.model_copy(update={"gearbox": box}), ("motor",))


def _run_at(specimen: Specimen, voltage: float, duration: float) -> Record:
    """Constant ``voltage`` [V] from rest."""
    return specimen.run(specimen.times(duration), voltage=voltage)


def _locked(subject: Subject) -> Specimen:
    p = Parameters()
    great = p.motor.model_copy(update={"rotor_inertia": 1e9})
    return _alone(subject, p.model_copy(update={"motor": great}))


def current_step(subject: Subject) -> Iterator[Row]:
    """Current after a voltage step on the locked rotor, against i = U/R (1 − exp(−t R/L))."""
    m = Parameters().motor
    voltage = 10.0
    specimen = _locked(subject)
    current = _run_at(specimen, voltage, 0.01).signal["current"]
    for time in (0.2e-3, 1e-3, 5e-3):
        expected = voltage / m.resistance * -math.expm1(-time * m.resistance / m.inductance)
        yield Row(GROUP, f"current {time * 1e3:g} ms after a step of {voltage:g} V", "A", expected,
                  "closed form of the RL circuit", float(current[round(time / specimen.step)]), 1e-3)  # fmt: skip


def acts_when_it_flows(subject: Subject) -> Iterator[Row]:
    """Motion of a rotor under a step of voltage, against the exact solution of current and speed together.

    A torque that acted half a step early or late would show as so much of the run-up; the limit is a tenth of a step.
    Semi-implicit Euler itself puts the speed where it is half a step later.
    """
    p = Parameters()
    m = p.motor
    specimen = _alone(subject, p)
    voltage, h = 20.0, specimen.step
    record = _run_at(specimen, voltage, 0.004)
    inertia = m.rotor_inertia + p.gearbox.input_inertia
    # d/dt (i, ω) = A (i, ω) + (u/L, 0)
    a = np.array([
        [-m.resistance / m.inductance, -m.torque_constant / m.inductance],
        [m.torque_constant / inertia, 0.0],
    ])  # fmt: skip
    values, vectors = np.linalg.eig(a)
    rest = -np.linalg.solve(a, [voltage / m.inductance, 0.0])
    weights = np.linalg.solve(vectors, -rest)

    def exact(t: float) -> tuple[float, float, float]:
        """Current [A], speed [rad/s] and acceleration [rad/s²]."""
        current, speed = (rest + (vectors * np.exp(values * t)) @ weights).real
        return float(current), float(speed), m.torque_constant / inertia * float(current)

    for time in (0.5e-3, 2e-3):
        k = round(time / h)
        current, speed, acceleration = exact(time)
        lag = (speed - record.velocity["motor"][k]) / acceleration
        yield Row(GROUP, f"time by which the speed lags {time * 1e3:g} ms after a step of {voltage:g} V, in steps", "1",
                  0.5, "exact solution; half a step is semi-implicit Euler's", float(lag / h), 0.1,
                  relative=False)  # fmt: skip
        yield Row(GROUP, f"current {time * 1e3:g} ms after it, with the rotor running up", "A", current,
                  "exact solution", float(record.signal["current"][k]), 0.01)  # fmt: skip


def envelope(subject: Subject) -> Iterator[Row]:
    """The corners of the torque-speed chart, the rotor held or running up freely."""
    p = Parameters()
    sheet = "data sheet, thesis table 3.2"

    def held(current: float) -> float:
        return float(_run_at(_locked(subject), current * p.motor.resistance, 0.02).signal["motor_torque"][-1])

    yield Row(GROUP, "torque held at the peak current of 20.38 A", "N·m", 6.0, sheet, held(20.38), 0.01)
    yield Row(GROUP, "torque held at the stall current of 3.45 A", "N·m", 1.0, sheet,
              held(3.45), 0.02)  # fmt: skip
    free = _alone(subject, p)
    speed = _run_at(free, free.parameters.drive.voltage_limit, 0.15).velocity["motor"]
    yield Row(GROUP, "no-load speed at the voltage limit", "rad/s", 11400.0 * RPM, sheet, float(speed[-1]), 0.01)


def power_balance(subject: Subject) -> Iterator[Row]:
    """Run up under voltage: electrical energy = copper loss + work on the rotor + energy in the inductance."""
    p = Parameters()
    specimen = _alone(subject, p)
    voltage = 100.0
    record = _run_at(specimen, voltage, 0.02)
    speed, current, torque = record.velocity["motor"], record.signal["current"], record.signal["motor_torque"]
    electrical = voltage * float(np.trapezoid(current, dx=specimen.step))
    copper = p.motor.resistance * float(np.trapezoid(current**2, dx=specimen.step))
    stored = 0.5 * p.motor.inductance * float(current[-1]) ** 2
    inertia = p.motor.rotor_inertia + p.gearbox.input_inertia
    # The torque is held over a step, in which the speed changes evenly.
    work = float(np.sum(torque[:-1] * 0.5 * (speed[:-1] + speed[1:])) * specimen.step)
    yield Row(GROUP, "work in a run-up: electrical less copper loss and inductance", "J",
              electrical - copper - stored, "energy balance", work, 0.005)  # fmt: skip
    yield Row(GROUP, "kinetic energy of the rotor after it", "J", work, "work of the air-gap torque",
              0.5 * inertia * float(speed[-1]) ** 2, 0.005)  # fmt: skip


def temperature(subject: Subject) -> Iterator[Row]:
    """Winding temperature after 1 s at the stall torque, against the first-order closed form."""
    m = Parameters().motor
    current = 1.0 / m.torque_constant
    rise = _run_at(_locked(subject), current * m.resistance, 1.0).signal["temperature"]
    final = m.resistance * current**2 * m.thermal_resistance
    yield Row(GROUP, "winding's temperature rise after 1 s at stall torque", "K",
              final * -math.expm1(-1.0 / m.thermal_time_constant), "closed form", float(rise[-1]), 0.01)  # fmt: skip
