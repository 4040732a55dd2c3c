"""Motor: current step, torque-speed envelope, power balance, winding temperature."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from cls_bench.compiled import compiled, mj_step
from cls_bench.parameters import RPM, Parameters
from cls_bench.plant import motor
from cls_bench.plant.state import CURRENT, TEMPERATURE, Plant
from cls_bench.verification.reading import Array
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Specimen, Subject

GROUP = "motor"


@compiled
def _run(plant: Plant, parameters: Any, voltage: float, out: Any) -> None:
    for k in range(out.shape[0]):
        motor.apply_voltage(plant, parameters, True, voltage)
        out[k, 0], out[k, 1], out[k, 2] = plant.qvel[0], plant.act[CURRENT], plant.act[TEMPERATURE]
        mj_step(plant.model, plant.data)
        out[k, 3] = plant.actuator_force[0]


def _run_at(specimen: Specimen, voltage: float, duration: float) -> Array:
    """Constant ``voltage`` [V] from rest.

    Columns: speed [rad/s], current [A], temperature rise [K] before each step, air-gap torque [N·m] in it.
    """
    out = np.empty((len(specimen.times(duration)), 4))
    _run(specimen.plant, specimen.record.motor, voltage, out)
    return out


def _locked(subject: Subject) -> Specimen:
    p = Parameters()
    great = p.motor.model_copy(update={"rotor_inertia": 1e9})
    return subject.element(p.model_copy(update={"motor": great}), ("motor",), ("motor",))


def current_step(subject: Subject) -> Iterator[Row]:
    """Current after a voltage step on the locked rotor, against i = U/R (1 − exp(−t R/L))."""
    m = Parameters().motor
    voltage = 10.0
    specimen = _locked(subject)
    out = _run_at(specimen, voltage, 0.01)
    for time in (0.2e-3, 1e-3, 5e-3):
        expected = voltage / m.resistance * -math.expm1(-time * m.resistance / m.inductance)
        yield Row(GROUP, f"current {time * 1e3:g} ms after a step of {voltage:g} V", "A", expected,
                  "closed form of the RL circuit", float(out[round(time / specimen.step), 1]), 1e-3)  # fmt: skip


def envelope(subject: Subject) -> Iterator[Row]:
    """The corners of the torque-speed chart, the rotor held or running up freely."""
    p = Parameters()
    sheet = "data sheet, thesis table 3.2"

    def held(current: float) -> float:
        return float(_run_at(_locked(subject), current * p.motor.resistance, 0.02)[-1, 3])

    yield Row(GROUP, "torque held at the peak current of 20.38 A", "N·m", 6.0, sheet, held(20.38), 0.01)
    yield Row(GROUP, "torque held at the stall current of 3.45 A", "N·m", 1.0, sheet,
              held(3.45), 0.02)  # fmt: skip
    free = subject.element(p, ("motor",), ("motor",))
    speed = _run_at(free, free.parameters.drive.voltage_limit, 0.15)[:, 0]
    yield Row(GROUP, "no-load speed at the voltage limit", "rad/s", 11400.0 * RPM, sheet, float(speed[-1]), 0.01)


def power_balance(subject: Subject) -> Iterator[Row]:
    """Run up under voltage: electrical energy = copper loss + work on the rotor + energy in the inductance."""
    p = Parameters()
    specimen = subject.element(p, ("motor",), ("motor",))
    voltage = 100.0
    out = _run_at(specimen, voltage, 0.02)
    speed, current, torque = out[:, 0], out[:, 1], out[:, 3]
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
    out = _run_at(_locked(subject), current * m.resistance, 1.0)
    final = m.resistance * current**2 * m.thermal_resistance
    yield Row(GROUP, "winding's temperature rise after 1 s at stall torque", "K",
              final * -math.expm1(-1.0 / m.thermal_time_constant), "closed form", float(out[-1, 2]), 0.01)  # fmt: skip
