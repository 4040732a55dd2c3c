"""Stiction: breakaway, creep below it, and stick-slip on a spring against an event-driven solution."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from cls_bench.parameters import Gearbox, GearStage, Parameters
from cls_bench.verification.reading import Array, at
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Feedback, Specimen, Subject

GROUP = "stiction"


class _Element(NamedTuple):
    """A friction element on an otherwise free inertia."""

    name: str
    joint: str
    specimen: Specimen

    def run(self, torque: Array, *, spring: float = 0.0, drive: float = 0.0) -> tuple[Array, Array]:
        """Angle [rad] and speed [rad/s] under ``torque`` [N·m] and a spring [N·m/rad] whose end moves at ``drive``."""
        s = self.specimen
        time = np.asarray(np.arange(len(torque)) * s.step, dtype=np.float64)
        record = s.run(
            time, {self.joint: torque}, feedback={self.joint: Feedback(spring)}, target={self.joint: drive * time}
        )
        return record.angle[self.joint], record.velocity[self.joint]


def _mesh(subject: Subject, p: Parameters) -> _Element:
    """The meshing friction of stage 1 on the motor's rotor, its mesh with a play that is never taken up."""
    stage = p.gearbox.stage1.model_copy(update={"backlash": 1e6, "ripple": 0.0})
    box = p.gearbox.model_copy(update={"stage1": stage})
    specimen = subject.element(p.model_copy(update={"gearbox": box}), ("motor",))
    return _Element("gear mesh", "motor", specimen)


def _bearing(subject: Subject) -> _Element:
    """The column's bearing under the balanced column."""
    p = Parameters()
    balanced = p.column.model_copy(update={"mass_height": 0.0, "viscous_friction": 0.0, "stop_angle": 1e6})
    specimen = subject.element(p.model_copy(update={"column": balanced}), ("column",), ("rod", "weight"))
    return _Element("column bearing", "column", specimen)


def breakaway(subject: Subject) -> Iterator[Row]:
    """Least torque, held, that sets the element going: by bisection, both ways."""
    p = Parameters()
    mesh, bearing = p.gearbox.stage1.drag * p.gearbox.breakaway_ratio, p.column.coulomb_friction
    for sign, way in ((1.0, "forward"), (-1.0, "back")):
        for expected, source, element in (
            (mesh, "drag × breakaway ratio", _mesh(subject, p)),
            (bearing, "Coulomb friction", _bearing(subject)),
        ):
            low, high = 0.8 * expected, 1.2 * expected
            for _ in range(7):
                torque = 0.5 * (low + high)
                low, high = (low, torque) if _moves(element, sign * torque) else (torque, high)
            yield Row(GROUP, f"breakaway torque of the {element.name}, {way}", "N·m", expected, source,
                      0.5 * (low + high), 0.02)  # fmt: skip


def _moves(element: _Element, torque: float) -> bool:
    """Whether ``torque`` [N·m], put on slowly and held, sets the element going: ten times as far as bristles bend."""
    element.specimen.reset()
    time = element.specimen.times(1.0)
    return bool(abs(element.run(torque * np.minimum(time / 0.5, 1.0))[0][-1]) > 1e-3)


def creep(subject: Subject) -> Iterator[Row]:
    """Speed that is left under 90 % of breakaway, as the mean over a second, once the bristles have rung out."""
    p = Parameters()
    for torque, element in (
        (0.9 * p.gearbox.stage1.drag * p.gearbox.breakaway_ratio, _mesh(subject, p)),
        (0.9 * p.column.coulomb_friction, _bearing(subject)),
    ):
        time = element.specimen.times(3.0)
        angle, _ = element.run(torque * np.minimum(time / 0.2, 1.0))
        speed = angle[-1] - at(time, angle, 2.0)
        yield Row(GROUP, f"creep of the {element.name} at 90 % of breakaway", "rad/s", 0.0, "true stiction", speed,
                  1e-6, relative=False)  # fmt: skip


def stick_slip(subject: Subject) -> Iterator[Row]:
    """The rotor drawn over the meshing friction by a spring: period and length of a slip in the steady cycle."""
    static, coulomb, stribeck, spring, drive = 0.11, 0.055, 0.5, 0.5, 0.2
    stage = GearStage(stiffness=1000.0, drag=coulomb, ripple=0.0)
    box = Gearbox(breakaway_ratio=static / coulomb, stribeck_velocity=stribeck, stage1=stage, stage2=stage)
    element = _mesh(subject, Parameters(gearbox=box))
    time = element.specimen.times(4.0)
    angle, speed = element.run(np.zeros(len(time)), spring=spring, drive=drive)
    slipping = speed > 0.1
    starts = np.flatnonzero(slipping[1:] & ~slipping[:-1])[1:]
    ends = np.flatnonzero(~slipping[1:] & slipping[:-1])
    period = float(np.mean(np.diff(time[starts]))) if len(starts) > 1 else math.nan
    length = float(np.mean(np.diff(angle[ends]))) if len(ends) > 1 else math.nan
    p = Parameters()
    inertia = p.motor.rotor_inertia + p.gearbox.input_inertia
    expected_period, expected_length = _event_driven(inertia, static, coulomb, stribeck, spring, drive)
    source = "event-driven solution (solve_ivp)"
    yield Row(GROUP, "stick-slip: period", "s", expected_period, source, period, 0.02)
    yield Row(GROUP, "stick-slip: length of a slip", "rad", expected_length, source, length, 0.02)


def _event_driven(
    inertia: float, static: float, coulomb: float, stribeck: float, spring: float, drive: float
) -> tuple[float, float]:
    """Period [s] and slip length [rad] with true sticking: rest until the spring has the static friction, then slip."""

    def slide(_: float, y: Array) -> Array:
        stretch, speed = y
        level = coulomb + (static - coulomb) * math.exp(-((speed / stribeck) ** 2))
        return np.array([drive - speed, (spring * stretch - level) / inertia])

    def stopped(_: float, y: Array) -> float:
        return float(y[1])

    stopped.terminal, stopped.direction = True, -1.0  # type: ignore[attr-defined]
    solution = solve_ivp(
        slide, (0.0, 10.0), [static / spring, 1e-9], events=stopped, rtol=1e-10, atol=1e-12, method="LSODA"
    )
    duration, left = float(solution.t[-1]), float(solution.y[0, -1])
    stuck = (static / spring - left) / drive
    period = duration + stuck
    return period, drive * period
