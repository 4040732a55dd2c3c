"""Each recorded signal is what its name says: held against the bench's own state and against laws, one by one.

The run is cut into blocks of one PLC cycle. Between two blocks the bench stands still, so what the first row of the
next one must say can be read from MuJoCo by joint name, and from laws written down here once more. A test then spoils
each signal in turn (zeros, another sign, the column beside it), and each spoilt one must be found.
"""

import math
import re
from functools import cache
from typing import Any

import numpy as np
import pytest

from cls_bench.axis import AXIS
from cls_bench.bench import Bench, DivergedError
from cls_bench.control.limits import LIMITS
from cls_bench.drivers import scripted
from cls_bench.parameters import Gearbox, GearStage, Parameters
from cls_bench.scenario import parse_scenario
from cls_bench.signals import CLOCK, MOST_STAGES, TOPIC, Signal, Topic, topics
from cls_bench.tick import _trace
from cls_bench.trace import Buffers, words
from tests.running import advanced

CYCLE = 8
TICK = 5e-5
IDEAL = ["encoder.noise=0.0", "load_cell.noise=0.0", "gearbox.stage1.transmission_error=0.0",
         "gearbox.stage2.transmission_error=0.0", "load_cell.filter_bandwidth=100000.0",
         "potentiometer.noise=0.0", *(f"feel.{key}" for key in (
             'bodies="two"', "neutral=0.02", "stiffness=30.0", "aft.inertia=0.05", "aft.damping=0.2",
             "down_spring.torque=0.15", "linkage.stiffness=500.0", "linkage.damping=3.0",
             "aft_limit.angle=0.5", "forward_limit.angle=0.5",
             "surface.area=0.8", "surface.chord=0.4",
             "surface.hinge_zero=0.01", "surface.hinge_deflection=-0.05", "surface.gearing=1.4",
             "flight.dynamic_pressure=900.0", "autopilot.engaged=true", "autopilot.stiffness=20.0",
             "autopilot.clutch=100.0", "autopilot.damping=1.0", "autopilot.rate=0.0", "autopilot.reference=0.1"))]
RIGS = {
    "two stages": [],
    # Of the same ratio, so that drive and PLC are none the wiser.
    "three stages": [
        "gearbox.stages=3", "gearbox.stage2.ratio=2.5", 'gearbox.stage2.kind="spur"', "gearbox.stage3.ratio=2.0",
        "gearbox.stage3.backlash=5e-4", "gearbox.stage3.drag=0.2", "gearbox.stage3.efficiency=0.9",
        "gearbox.stage3.inertia=2e-4", 'gearbox.stage3.kind="worm"', "gearbox.stage3.teeth=2",
    ],
}  # fmt: skip
SWAY = """
title = "all in motion"
duration = 0.4
hand = [{at = 0.0, kind = "sine", amplitude_deg = 12.0, frequency = 4.0, fade = 0.1}]
squeeze = [{at = 0.0, value = 0.3, over = 0.0}]
"""
CRANK, ROD, HEIGHT, ARM = 0.100, 0.209, 0.300, 0.175
POTENTIOMETER = 2.0 * math.radians(30.0) / 2**16


def signals_of(rig: str) -> list[str]:
    found = topics(CLOCK, 3 if rig == "three stages" else 2)
    return [f"{topic.path}.{name}" for topic in found for name in topic.names if topic.path != "/limits"]


EVERY = [(rig, signal) for rig in RIGS for signal in signals_of(rig)]


class Recorded:
    """All rows by signal, and what the bench held before each cycle and after each."""

    def __init__(self, stages: tuple[GearStage, ...]) -> None:
        self.stages = stages
        self.signals: dict[str, Any] = {}
        self.before: dict[str, Any] = {}
        self.after: dict[str, Any] = {}


def state_of(bench: Bench) -> dict[str, float]:
    """What MuJoCo, the plant's laws and the controllers remember, by their own names."""
    data, body, control = bench.data, bench.axes[0].record.truth.body, bench.axes[0].record.controller.state
    joints = [bench.model.joint(k).name for k in range(bench.model.njnt)]
    found = {name: float(data.joint(name).qpos[0]) for name in joints}
    found |= {f"{name}_rate": float(data.joint(name).qvel[0]) for name in joints}
    found |= {f"bristle{k}": float(body.bristle[k]) for k in range(MOST_STAGES)}
    found["current"], found["terminals"] = float(body.current), float(body.voltage)
    found["temperature"] = float(body.temperature)
    found["voltage"] = float(control.servo.voltage)
    found |= {f"feel_{name}": float(control.feel[name]) for name in ("angle", "velocity", "torque", "aft_angle",
                                                                   "aft_velocity")}
    return found


@cache
def recorded(rig: str) -> Recorded:
    scenario = parse_scenario(SWAY, set=[*IDEAL, *RIGS[rig]])
    parameters = scenario.parameters_at_start()
    bench = Bench(parameters)
    bench.block_ticks = CYCLE
    found, rows, before, after = Recorded(parameters.gearbox.in_use), {}, [], []
    last = state_of(bench)
    for block in scripted.run(bench, scenario):
        before.append(last)
        after.append(last := state_of(bench))
        for signal in signals_of(rig):
            rows.setdefault(signal, []).append(block[signal])
    found.signals = {signal: np.concatenate(parts) for signal, parts in rows.items()}
    found.before = {key: np.array([s[key] for s in before]) for key in before[0]}
    found.after = {key: np.array([s[key] for s in after]) for key in after[0]}
    return found


def dead_zone(x: Any, half: float) -> Any:
    return np.sign(x) * np.maximum(np.abs(x) - half, 0.0)


def rod_force(was: dict[str, Any]) -> Any:
    """Of the load cell, as stiff as it is damped, from where the rod's ends are and how fast they part."""
    damping = 2.0 * 0.02 * math.sqrt(3.0e6 * (0.15 + 3.51e-2 / ARM**2))
    crank, column = was["crank"], was["column"]
    x = ARM * np.sin(column) + ROD - CRANK * np.sin(crank)
    z = ARM * np.cos(column) - ARM + CRANK - CRANK * np.cos(crank)
    x_rate = ARM * np.cos(column) * was["column_rate"] - CRANK * np.cos(crank) * was["crank_rate"]
    z_rate = -ARM * np.sin(column) * was["column_rate"] + CRANK * np.sin(crank) * was["crank_rate"]
    length = np.hypot(x, z)
    return 3.0e6 * (length - ROD) + damping * (x * x_rate + z * z_rate) / length


def friction(stage: GearStage, bristle: Any, turned: Any, output: Any, velocity: Any, torque: Any) -> Any:
    """LuGre at the stage's input shaft (Canudas de Wit 1995), its level after the load as LossyGear has it."""
    driven = bristle * torque >= 0.0
    drag = stage.drag  # the same for both ways, or it would pass from the one to the other
    loss = np.where(driven, 1.0 / stage.efficiency - 1.0, 1.0 - stage.backdrive_efficiency)
    phase = stage.teeth * (turned - output if stage.kind == "planetary" else turned)
    level = (drag + loss * np.abs(torque) / stage.ratio) * (1.0 + stage.ripple * np.sin(phase))
    z = np.clip(bristle, -level * 1.1 / 800.0, level * 1.1 / 800.0)
    fade = np.exp(-(velocity**2))
    # ż = v − σ0 |v| z / g over the step that led here, its speed held: towards v g / (σ0 |v|), the bristle first.
    decay = 800.0 * np.abs(velocity) / (level * (1.0 + 0.1 * fade))
    slipping = velocity / np.maximum(decay, 1e-300)
    z = np.where(decay * TICK > 1e-9, slipping + (z - slipping) * np.exp(-decay * TICK), z + velocity * TICK)
    damping = np.minimum(0.15 * fade, level / np.maximum(np.abs(velocity), 1e-12))
    return 800.0 * z + damping * (velocity - decay * z)


def gear_laws(r: Recorded, first: Any) -> dict[str, tuple[Any, Any, float]]:
    was, found = r.before, {}
    shafts = ["motor", *(f"carrier{k}" for k in range(1, len(r.stages))), "crank"]
    for k, stage in enumerate(r.stages):
        name, before, behind = f"/gearbox.stage{k + 1}", shafts[k], shafts[k + 1]
        twist = was[before] / stage.ratio - was[behind]
        rate = was[f"{before}_rate"] / stage.ratio - was[f"{behind}_rate"]
        torque = first(f"{name}_torque")
        spring = stage.stiffness * dead_zone(twist, 0.5 * stage.backlash)
        rubbed = friction(stage, was[f"bristle{k}"], was[before], was[behind], was[f"{before}_rate"], torque)
        found[f"{name}_twist"] = first(f"{name}_twist"), twist, 1e-15
        found[f"{name}_torque"] = torque, spring, 0.03 + 0.5 * np.abs(rate)
        found[f"{name}_friction"] = first(f"{name}_friction"), rubbed, 1e-9
    return found


def expected(r: Recorded, signals: dict[str, Any]) -> dict[str, tuple[Any, Any, float]]:
    """For each signal: rows as recorded, rows as they should be, tolerance."""
    was, became = r.before, r.after
    count = len(was["column"])

    def first(signal: str) -> Any:
        """The rows at the start of each cycle."""
        return signals[signal].reshape(count, -1)[:, 0]

    force = rod_force(was)
    grip = HEIGHT**2 * 800.0 * (2.0e6 / 800.0) ** 0.3, HEIGHT**2 * 10.0 * 15.0**0.3
    hand = grip[0] * (was["limb"] - was["column"]) + grip[1] * (was["limb_rate"] - was["column_rate"])
    set_position, position = signals["/drive.set_position"][::2], signals["/drive.position"][::2]
    output = 2.0 * math.pi * 35.0 * (set_position - position)
    e = signals["/drive.set_velocity"] - signals["/drive.velocity"]
    k_p = 9.27e-5 * 2.0 * math.pi * 100.0
    integral = signals["/drive.torque_command"] - k_p * e
    interpolated = np.repeat(output, 2)
    interpolated[2::2] = 0.5 * (output[:-1] + output[1:])
    # Over the step that led here, with the voltage that was on and the speed that moved the rotor.
    final = (was["terminals"] - 0.2944 * was["motor_rate"]) / 6.0
    current = final + (was["current"] - final) * math.exp(-TICK * 6.0 / 6.0e-3)
    shown = np.floor(was["column"] / POTENTIOMETER + 0.5) * POTENTIOMETER
    heat = 6.0 * was["current"] ** 2 * 1.444
    warmed = heat + (was["temperature"] - heat) * math.exp(-TICK / 60.0)
    angle = np.append([0.0, 0.0], signals["/feel.angle"])[:count]  # a bus cycle, then the drive's own
    aft, aft_rate = became["feel_aft_angle"], became["feel_aft_velocity"]
    cable = 500.0 * (became["feel_angle"] - aft) + 3.0 * (became["feel_velocity"] - aft_rate)
    return {
        "/pilot.hand_force": (first("/pilot.hand_force"), hand / HEIGHT, 1e-9),
        "/pilot.squeeze": (signals["/pilot.squeeze"], np.full(2 * count, 0.3), 1e-12),
        "/pilot.limb_angle": (first("/pilot.limb_angle"), was["limb"], 0.0),
        "/column.angle": (first("/column.angle"), was["column"], 0.0),
        "/column.velocity": (first("/column.velocity"), was["column_rate"], 0.0),
        "/column.torque": (first("/column.torque"), hand, 1e-9),
        "/column.potentiometer": (first("/column.potentiometer"), shown, 1e-12),
        "/drive.set_position": (set_position, 1.75 * 25.0 * angle, 0.6),
        "/drive.position": (first("/drive.position"), was["motor"], 2.5e-5),
        "/drive.set_velocity": (signals["/drive.set_velocity"], interpolated, 1e-9),
        "/drive.velocity": (first("/drive.velocity"), was["motor_rate"], 8.0),
        "/drive.torque_command": (np.diff(integral), k_p / 0.02 * e[1:] * 2e-4, 1e-9),
        "/drive.current": (first("/drive.current"), current, 1e-12),
        "/drive.voltage": (first("/drive.voltage"), was["voltage"], 0.0),
        "/drive.torque": (first("/drive.torque"), 0.2944 * current, 1e-12),
        "/drive.winding_temperature": (first("/drive.winding_temperature"), warmed, 1e-12),
        **gear_laws(r, first),
        "/load_cell.force": (first("/load_cell.force"), force, 1e-6),
        "/load_cell.torque": (first("/load_cell.torque"), ARM * force, 2.0),
        "/load_cell.counts": (first("/load_cell.counts"), force * 2**23 / (50.0 * 9.80665), 1.0),
        "/feel.torque": (signals["/feel.torque"], became["feel_torque"], 0.0),
        "/feel.angle": (signals["/feel.angle"], became["feel_angle"], 0.0),
        "/feel.velocity": (signals["/feel.velocity"], became["feel_velocity"], 0.0),
        "/feel.own_torque": (signals["/feel.own_torque"], np.full(count, 0.15), 1e-12),
        "/surface.deflection": (signals["/surface.deflection"], 1.4 * aft, 1e-12),
        "/surface.velocity": (signals["/surface.velocity"], 1.4 * became["feel_aft_velocity"], 1e-12),
        "/surface.hinge_moment": (
            signals["/surface.hinge_moment"], 900.0 * 0.8 * 0.4 * (0.01 - 0.05 * 1.4 * aft), 1e-12
        ),
        "/surface.cable_torque": (signals["/surface.cable_torque"], cable, 1e-9),
        "/surface.feel_torque": (signals["/surface.feel_torque"], 30.0 * (aft - 0.02), 1e-12),
        "/surface.autopilot_torque": (signals["/surface.autopilot_torque"], 20.0 * (0.1 - aft) - aft_rate, 1e-12),
        "/surface.trim": (signals["/surface.trim"], np.full(count, 0.02), 0.0),
    }


def wrong(rig: str, signals: dict[str, Any]) -> set[str]:
    """Names of the signals that are not what they should be."""
    found = set()
    for name, (rows, right, tolerance) in expected(recorded(rig), signals).items():
        settled = slice(4, None)  # the first cycles fill the latches
        if not (np.abs(rows - right) <= tolerance)[settled].all():
            found.add(name)
    return found


@pytest.mark.parametrize("rig", RIGS)
def test_every_signal_has_its_law(rig: str) -> None:
    assert list(expected(recorded(rig), recorded(rig).signals)) == signals_of(rig)
    assert wrong(rig, recorded(rig).signals) == set()


@pytest.mark.parametrize(("rig", "signal"), EVERY)
def test_a_spoilt_signal_is_found(rig: str, signal: str) -> None:
    """The proof that the test above sees every column: each is spoilt in turn, and must be noticed by its own law."""
    path, _, name = signal.rpartition(".")
    names = [other.rpartition(".")[2] for other in signals_of(rig) if other.startswith(f"{path}.")]
    beside = f"{path}.{names[(names.index(name) + 1) % len(names)]}"
    rows = recorded(rig).signals
    for spoilt in (np.zeros_like(rows[signal]), -rows[signal], rows[beside], np.full_like(rows[signal], np.nan)):
        assert signal in wrong(rig, {**rows, signal: spoilt})


def test_every_signal_has_a_source_of_its_own() -> None:
    for stages in range(MOST_STAGES + 1):
        sources = [signal.source for topic in topics(CLOCK, stages) for signal in topic.signals]
        assert len(set(sources)) == len(sources)
        assert all(sources)
    assert TOPIC["/limits"].names == LIMITS


@pytest.mark.parametrize(("source", "says"), [
    ("truth.body.heat", 'source "truth.body.heat" stands nowhere in an axis\'s record'),
    ("", 'source "" stands nowhere'),
    ("truth.body", "stands nowhere"),
    ("truth.body.twist", "stands nowhere"),
    ("truth.body.twist.4", "stands nowhere"),
    ("controller.state.commands.torque", "stands 17 times"),
    ("samples.switch_aft", "is of int64, not of float64"),
])  # fmt: skip
def test_a_source_that_is_none_is_named(source: str, says: str) -> None:
    fine = Signal("fine", "K", "", "truth.body.temperature")
    declared = Topic("/drive", 4, "", (fine, Signal("heat", "K", "", source)))
    with pytest.raises(ValueError, match=f"^/drive.heat: .*{re.escape(says)}"):
        words(AXIS, [declared])


def test_a_source_is_a_place_in_the_record() -> None:
    """By the name a reader of the code would use, in records within records and in tables."""
    memory = np.zeros(1, AXIS)
    axis = memory.view(np.recarray)[0]
    axis.truth.body.mesh_torque[1] = 1.0
    axis.limits.share[LIMITS.index("current")] = 2.0
    axis.controller.parameters.feel.forward_limit.angle = 3.0
    sources = "truth.body.mesh_torque.2", "limits.share.current", "controller.parameters.feel.forward_limit.angle"
    ((*places,),) = words(AXIS, [Topic("/x", 1, "", tuple(Signal("y", "1", "", source) for source in sources))])
    assert memory.view(np.float64)[places].tolist() == [1.0, 2.0, 3.0]


def test_a_row_is_nan_until_it_is_written() -> None:
    room = Buffers(CLOCK, 1, 3, 8, 16)
    trace = room.part(8, 16)
    words = np.zeros((1, AXIS.itemsize // 8))
    number = TOPIC["/drive"].names.index("voltage")
    one = trace.drive[len(TOPIC["/pilot"].names) + number :][:1]  # topics of one cycle stand in the table's order
    words[0, one[0, 0]] = 5.0
    _trace(trace.values, one, words, 0, 2)
    found = room.tables([topics()], 8, 16)
    assert list(found) == [topic.path for topic in topics()]
    assert found["/drive"].shape == (4, len(TOPIC["/drive"].names))
    assert found["/drive"][2, number] == 5.0
    assert sum(np.isfinite(table).sum() for table in found.values()) == 1
    assert np.isnan(trace.poses).all()


def test_a_part_of_the_room_is_the_rows_of_its_ticks() -> None:
    """Room is made for a long block and cut into short ones: what one writes no other sees, and nothing is left out."""
    room = Buffers(CLOCK, 2, 1, 16, 400)
    declared = [topics(CLOCK, MOST_STAGES, axis) for axis in ("pitch", "roll")]
    record = np.arange(AXIS.itemsize // 8)
    for number, first in enumerate(range(16, 416, 8)):
        part = room.part(first, 8)
        assert all(np.isnan(table).all() for table in room.tables(declared, first, 8).values())
        for places, every in ((part.tick, 1), (part.drive, 4), (part.plc, 8)):
            for row in range(8 // every):
                for axis in range(2):
                    _trace(part.values, places, 1e6 * axis + 1e3 * number + np.stack([record, record]), axis, row)
    whole = room.tables(declared, 16, 400)
    for axis, own in enumerate(declared):
        for topic, places in zip(own, words(AXIS, own), strict=True):
            rows = np.arange(400 // topic.ticks) * topic.ticks // 8
            np.testing.assert_array_equal(whole[topic.path], 1e6 * axis + 1e3 * rows[:, None] + places)
    assert not np.isnan(room.part(16, 400).values).any()
    assert room.part(16, 400).poses.shape == (2, 1, 7)  # at ticks 200 and 400


@pytest.mark.parametrize("stages", range(MOST_STAGES + 1))
def test_what_a_rig_has_not_is_not_handed_on(stages: int) -> None:
    """Nothing in the tables but signals of the stages there are, and all of those are written."""
    p = Parameters(gearbox=Gearbox(stages=stages))
    bench = Bench(p.with_nameplate())
    for block in advanced(bench, 0.01):
        assert list(block.signals) == [topic.path for topic in topics(CLOCK, stages)]
        assert ("/gearbox" in block.signals) == (stages > 0)
        for topic, rows in block:
            assert rows.shape[1] == len(topic.signals)
            assert np.isfinite(rows).all()
    if stages:
        assert block.signals["/gearbox"].shape[1] == 3 * stages


def test_a_signal_that_nothing_writes_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a declared and forgotten signal would look like: its column stays NaN."""
    whole = Buffers.tables

    def forgetful(*arguments: Any) -> Any:
        found = dict(whole(*arguments))
        found["/feel"][:, 1] = np.nan
        return found

    monkeypatch.setattr(Buffers, "tables", forgetful)
    scenario = parse_scenario(SWAY)
    with pytest.raises(DivergedError, match=r"recorded signal /feel\.angle is not finite"):
        list(scripted.run(Bench(scenario.parameters_at_start()), scenario))
