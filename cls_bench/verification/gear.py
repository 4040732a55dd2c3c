"""Gear with losses: Modelica's LossyGearDemo1, the same with drag per direction, efficiency both ways, self-locking."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from cls_bench.parameters import Gearbox, GearStage, Motor, Parameters, Simulation
from cls_bench.verification.lossy_gear import Gear, Motion, follow
from cls_bench.verification.reading import Array, at, crossing, start
from cls_bench.verification.rigs import rigs
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Feedback, Record, Specimen, Subject

GROUP = "gear with losses"
DEMO = "Modelica LossyGearDemo1"
BOTH_WAYS = "drive and back-drive"


def shafts(p: Parameters) -> tuple[str, ...]:
    """Joints of the gearbox from the motor to the crank."""
    return ("motor", *(f"carrier{k}" for k in range(1, p.gearbox.stages)), "crank")


def stage_alone(subject: Subject, p: Parameters, number: int = 1) -> Specimen:
    """A stage between two free shafts."""
    others = [f"stage{k}" for k in range(1, p.gearbox.stages + 1) if k != number]
    return subject.element(p, shafts(p)[number - 1 : number + 1], ("rod", "weight", *others))


def with_stages(p: Parameters, **changes: object) -> Parameters:
    """The same with every stage in use changed alike. A copy is not held to the bounds of a bench."""
    stages = {f"stage{k}": stage.model_copy(update=changes) for k, stage in enumerate(p.gearbox.in_use, 1)}
    return p.model_copy(update={"gearbox": p.gearbox.model_copy(update=stages)})


def demo_parameters(*, drag: float = 0.0, drag_ratio: float = 1.0) -> Parameters:
    """Inertias 1 and 1.5 kg·m² through a ratio of 2, mesh efficiency 0.5 both ways.

    The reference is rigid, so mesh and bristles are as stiff as the finest step carries: 1e-9 rad of give under the
    torques of the demo.
    """
    stiffness, tiny = 3e9, 1e-9
    # Copies are not held to the bounds of a bench: the example's gears are a thousand times heavier.
    stage = GearStage(ratio=2.0, efficiency=0.5, backdrive_efficiency=0.5, ripple=0.0).model_copy(
        update={"stiffness": stiffness, "damping_ratio": 0.5, "inertia": 1.5, "drag": drag, "drag_ratio": drag_ratio}
    )
    gearbox = Gearbox(input_inertia=tiny, breakaway_ratio=1.0, stribeck_velocity=1e-3).model_copy(
        update={"bristle_stiffness": stiffness, "bristle_damping": math.sqrt(stiffness), "stage1": stage}
    )
    motor = Motor().model_copy(update={"rotor_inertia": 1.0 - tiny})
    parts = {"motor": motor, "gearbox": gearbox, "simulation": Simulation(substeps=64)}
    return Parameters().model_copy(update=parts)


def _demo(subject: Subject, p: Parameters) -> Record:
    stage = stage_alone(subject, p)
    time = stage.times(0.5)
    return stage.run(time, {"motor": 10.0 * np.sin(2.0 * np.pi * time), "carrier1": -10.0 + 2.5 * time})


_STILL = 2e-5
"""Speed [rad/s] of a shaft that sticks; above what the bristles ring with after a stop."""


def lossy_gear_demo(subject: Subject) -> Iterator[Row]:
    """Sticking, breaking away and reversing at the times and places of the reference result."""
    record = _demo(subject, demo_parameters())
    time, angle, speed = record.time, record.angle["carrier1"], record.velocity["carrier1"]
    for quantity, expected, obtained in (
        ("sticks", 0.0805, crossing(time, np.abs(speed), _STILL, after=0.05)),
        ("breaks away", 0.1995, start(time, speed, 1e-4, after=0.1)),
        ("sticks again", 0.3713, crossing(time, np.abs(speed), _STILL, after=0.3)),
        ("reverses", 0.4645, start(time, -speed, 1e-4, after=0.4)),
    ):
        yield Row(GROUP, f"time at which it {quantity}", "s", expected, DEMO, obtained, 0.5e-3, relative=False)
    for quantity, unit, expected, obtained in (
        ("load angle while it sticks", "rad", -1.117e-3, at(time, angle, 0.15)),
        ("load angle while it sticks again", "rad", 2.084e-4, at(time, angle, 0.43)),
        ("load angle at 0.5 s", "rad", 1.66e-5, float(angle[-1])),
        ("load speed at 0.5 s", "rad/s", -0.01626, float(speed[-1])),
    ):
        yield Row(GROUP, quantity, unit, expected, DEMO, obtained, 0.01)


def drag_per_direction(subject: Subject) -> Iterator[Row]:
    """The same gear with a drag of 0.2 N·m that is 2.5 times as much when the load drives, against a rigid one.

    The rigid gear (:mod:`cls_bench.verification.lossy_gear`) goes from event to event; without drag it has to give the
    reference result first.
    """
    solution = follow(Gear(), 0.5)
    law, what = "rigid gear, event by event", "of the rigid gear without drag"
    yield Row(GROUP, f"load angle at 0.5 s {what}", "rad", 1.66e-5, DEMO, float(solution.angle[-1]), 0.01)
    yield Row(GROUP, f"load speed at 0.5 s {what}", "rad/s", -0.01626, DEMO, float(solution.speed[-1]), 0.01)

    drag, ratio = 0.2, 2.5
    expected = follow(Gear(drag=drag, drag_back=ratio * drag), 0.5)
    record = _demo(subject, demo_parameters(drag=drag, drag_ratio=ratio))
    angle, speed = record.angle["carrier1"], record.velocity["carrier1"]
    begins = {"sticks": 0.05, "breaks away": 0.1, "sticks again": 0.3, "reverses": 0.4}
    for name, after in begins.items():
        sticks = name.startswith("sticks")
        way = 1.0 if name == "breaks away" else -1.0
        obtained = (
            crossing(record.time, np.abs(speed), _STILL, after=after) if sticks
            else start(record.time, way * speed, 1e-4, after=after)
        )  # fmt: skip
        yield Row(GROUP, f"drag per direction: time at which it {name}", "s", _event(expected, sticks, after), law,
                  obtained, 0.5e-3, relative=False)  # fmt: skip
    for quantity, time in (("while it sticks", 0.15), ("while it sticks again", 0.43), ("at 0.5 s", 0.5)):
        yield Row(GROUP, f"drag per direction: load angle {quantity}", "rad", at(expected.time, expected.angle, time),
                  law, at(record.time, angle, time), 2e-6, relative=False)  # fmt: skip


def _event(motion: Motion, sticks: bool, after: float) -> float:
    """First time [s] after ``after`` at which a rigid gear comes to rest, or leaves it; NaN if never."""
    times = [time for time, stuck in motion.events if stuck == sticks and time >= after]
    return times[0] if times else math.nan


# --- the whole gearbox ---


def _smooth(p: Parameters) -> Parameters:
    """Without ripple and transmission error: an efficiency is a mean over the teeth."""
    return with_stages(p, ripple=0.0, transmission_error=0.0)


def _efficiency(subject: Subject, p: Parameters, torque: float, *, back: bool) -> float:
    """Power out over power in of the whole gearbox at a steady speed, against a brake on the other shaft."""
    box = subject.element(p, shafts(p), ("rod", "weight"))
    ratio, inertia = p.gearbox.ratio, p.motor.rotor_inertia + p.gearbox.inertia_at_motor
    motor_speed = 100.0  # rad/s, far above the Stribeck velocity of every stage
    # The brake is viscous and takes about what comes out, so the speed settles near motor_speed.
    brake = torque / (ratio * motor_speed) if back else torque * ratio**2 / motor_speed
    seen = brake if back else brake / ratio**2
    time = box.times(max(0.3, 12.0 * inertia / seen))
    on, braked = ("crank", "motor") if back else ("motor", "crank")
    record = box.run(time, {on: torque}, feedback={braked: Feedback(damping=brake)})
    motor, crank = (float(record.velocity[name][-400:].mean()) for name in ("motor", "crank"))
    if back:
        return brake * motor**2 / (torque * crank)
    return brake * crank**2 / (torque * motor)


def _expected_driving(stages: Sequence[GearStage], torque: float) -> float:
    """Efficiency by the definition: each stage takes its drag, then its mesh loss from what is left."""
    carried, ratio = torque, 1.0
    for stage in stages:
        carried, ratio = (carried - stage.drag) * stage.efficiency * stage.ratio, ratio * stage.ratio
    return carried / (torque * ratio)


def _expected_back(stages: Sequence[GearStage], torque: float) -> float:
    carried, ratio = torque, 1.0
    for stage in reversed(stages):
        carried = carried / stage.ratio * stage.backdrive_efficiency - stage.drag * stage.drag_ratio
        ratio *= stage.ratio
    return carried * ratio / torque


def efficiency(subject: Subject) -> Iterator[Row]:
    """Efficiency of the whole gearbox both ways, over torque; without ripple and transmission error."""
    p = _smooth(Parameters())
    stages = p.gearbox.in_use
    law = "definition, stage by stage"
    yield Row(BOTH_WAYS, "efficiency, motor drives at 1 N·m", "1", 0.85, "thesis 3.2.2",
              _efficiency(subject, p, 1.0, back=False), 0.005)  # fmt: skip
    for torque in (0.25, 0.5, 2.0, 4.0):
        yield Row(BOTH_WAYS, f"efficiency, motor drives at {torque:g} N·m", "1", _expected_driving(stages, torque), law,
                  _efficiency(subject, p, torque, back=False), 0.005)  # fmt: skip
    for torque in (10.0, 25.0, 50.0, 100.0):
        yield Row(BOTH_WAYS, f"efficiency, {torque:g} N·m at the crank drives the motor", "1",
                  _expected_back(stages, torque), law, _efficiency(subject, p, torque, back=True), 0.005)  # fmt: skip


def efficiency_of_rigs(subject: Subject) -> Iterator[Row]:
    """The same for one stage, three stages, a belt and a worm."""
    law = "definition, stage by stage"
    for name, forth, back in (
        ("one stage", 2.0, 40.0), ("three stages", 1.0, 40.0), ("belt", 2.0, 50.0), ("worm", 1.0, 0.0),
    ):  # fmt: skip
        p = _smooth(rigs()[name])
        stages = p.gearbox.in_use
        yield Row(BOTH_WAYS, f"{name}: efficiency, motor drives at {forth:g} N·m", "1",
                  _expected_driving(stages, forth), law, _efficiency(subject, p, forth, back=False), 0.005)  # fmt: skip
        if back:
            yield Row(BOTH_WAYS, f"{name}: efficiency, {back:g} N·m at the crank drives the motor", "1",
                      _expected_back(stages, back), law, _efficiency(subject, p, back, back=True), 0.005)  # fmt: skip


def self_locking(subject: Subject) -> Iterator[Row]:
    """A worm holds any load at its output without creep, and the motor can lower it; one with η' > 0 yields.

    With a back-driving efficiency η' the friction is D + (1 − η') T/r against the load's T/r.
    """
    group, p = "self-locking", with_stages(rigs()["worm"], ripple=0.0, transmission_error=0.0)
    stage = p.gearbox.stage1
    drag = stage.drag * stage.drag_ratio
    for load in (20.0, 200.0):
        worm = stage_alone(subject, p)
        time = worm.times(1.5)
        angle = worm.run(time, {"crank": load * np.minimum(time / 0.2, 1.0)}).angle["motor"]
        creep = (angle[-1] - at(time, angle, 0.5)) / (time[-1] - 0.5)
        yield Row(group, f"worm, {load:g} N·m at the crank: speed of the motor shaft", "rad/s", 0.0, "true stiction",
                  float(creep), 1e-6, relative=False)  # fmt: skip

    load, speed = 50.0, 50.0
    worm = stage_alone(subject, p)
    time = worm.times(1.2)
    acted: dict[str, Array] = {}
    worm.run(
        time, {"crank": load * np.minimum(time / 0.2, 1.0)}, feedback={"motor": Feedback(damping=0.02)},
        target={"motor": speed * np.maximum(time - 0.3, 0.0)}, acted=acted,
    )  # fmt: skip
    lowering = float(acted["motor"][-4000:].mean())
    yield Row(group, f"worm, {load:g} N·m at the crank: motor torque that lowers it", "N·m",
              drag - stage.backdrive_efficiency * load / stage.ratio, "D − η' T/r", lowering, 0.01)  # fmt: skip

    efficiency = 0.3
    yielding = stage_alone(subject, with_stages(p, backdrive_efficiency=efficiency))
    before = p.motor.rotor_inertia + p.gearbox.input_inertia
    behind = stage.inertia + p.linkage.crank_inertia + p.linkage.rod_crank_mass * p.linkage.crank**2
    time = yielding.times(0.4)
    record = yielding.run(time, {"crank": load})
    late = time > 0.2
    expected = (efficiency * load / stage.ratio - drag) / (before * stage.ratio + efficiency * behind / stage.ratio)
    yield Row(group, f"the same with a back-driving efficiency of {efficiency:g}: acceleration of the crank", "rad/s²",
              expected, "closed form", float(np.polyfit(time[late], record.velocity["crank"][late], 1)[0]),
              0.01)  # fmt: skip
