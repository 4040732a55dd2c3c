"""Gearbox: efficiency both ways, stiction, backlash, stiffness, ripple, transmission error; all kinds and numbers of
stages; drag that depends on who drives."""

import math
from typing import Any, get_args

import numpy as np
import pytest

from cls_bench.kinematics import crank_from_column, crank_ratio
from cls_bench.parameters import ARCMIN, DEG, Gearbox, GearStage, Parameters, Simulation
from cls_bench.parameters.plant import StageKind
from cls_bench.plant.gearbox import friction_level
from cls_bench.plant.state import STAGE
from cls_bench.rigs.figures import breakout_torque
from cls_bench.verification.rigs import BELT, WORM, rigs
from cls_bench.verification.subject import Feedback, Record, Specimen
from tests.running import run

P = Parameters()
BOX = P.gearbox
KINDS = get_args(StageKind)


def heavy(p: Parameters = P) -> Parameters:
    """The same with a rotor that nothing slows down; a copy is not held to the bounds of a bench."""
    return p.model_copy(update={"motor": p.motor.model_copy(update={"rotor_inertia": 1e4})})


def with_stages(*stages: GearStage, **box: Any) -> Parameters:
    """The thesis's rig with these stages, from the motor on."""
    named = {f"stage{k}": stage for k, stage in enumerate(stages, 1)}
    return Parameters(gearbox=Gearbox(stages=len(stages), **named, **box))


def alone(p: Parameters = P, *, held: tuple[str, ...] = ()) -> Specimen:
    """The gearbox from the motor to the crank; the column is held, and the rod off."""
    shafts = Specimen(p).shafts
    return Specimen(p, [name for name in shafts if name not in held], ("rod", "weight"))


def settle(gears: Specimen, last: float, torque: float, seconds: float = 0.15) -> float:
    """Angle [rad] of the crank once its torque [N·m] has gone from ``last`` to ``torque``; it is damped to rest."""
    time = gears.times(seconds)
    pulled = last + (torque - last) * np.minimum(2.0 * time / seconds, 1.0)
    return gears.run(time, {"crank": pulled}, feedback={"crank": Feedback(damping=0.5)}).final["crank"][0]


def test_total_backlash_at_the_output_is_under_5_arcmin():
    """Motor shaft held, crank turned to and fro: the play left when the elastic twist is extrapolated away."""
    gears = alone(held=("motor",))
    lost, last = {}, 0.0
    for torque in (2.0, 4.0, 8.0):
        settle(gears, last, -torque)
        aft = settle(gears, -torque, -torque)
        forward = settle(gears, -torque, torque)
        lost[torque], last = (forward - aft) / ARCMIN, torque
    play = 2 * lost[4.0] - lost[8.0]
    assert play == pytest.approx(4.0, abs=0.3)
    assert play < 5.0
    # What is left is elastic: 6 N·m/arcmin behind 25 × 1.2 N·m/arcmin, both ways.
    stiffness = 1 / (1 / 6.0 + 1 / 30.0)
    assert lost[8.0] - lost[4.0] == pytest.approx(2 * 4.0 / stiffness, rel=0.05)


def test_the_play_transmits_nothing():
    """Within the dead zone the crank swings freely while the motor side rests."""
    gears = alone(held=("motor",))
    gears.push(crank=0.5 * ARCMIN / 0.01)
    record = gears.run(np.arange(200) * gears.step)  # half an arc minute in 10 ms
    assert not record.signal["torque2"].any()
    assert record.final["crank"][1] == pytest.approx(0.5 * ARCMIN / 0.01, rel=1e-9)


def test_no_creep_below_breakaway_and_slip_above():
    """90 % of breakaway at the motor shaft: under 1e-6 rad/s; half as much again as both stages' friction: it runs."""
    breakaway = BOX.breakaway_ratio * BOX.stage1.drag
    gears = alone()
    gears.run(gears.times(0.5), {"motor": 0.9 * breakaway})
    still = gears.run(gears.times(0.2), {"motor": 0.9 * breakaway})
    for name in gears.shafts:
        assert abs(still.angle[name][-1] - still.angle[name][0]) / 0.2 < 1e-6
        assert np.abs(still.velocity[name]).max() < 1e-6
    slip = 1.5 * (breakaway + BOX.breakaway_ratio * BOX.stage2.drag / BOX.stage1.ratio)
    assert gears.run(gears.times(0.2), {"motor": slip}).final["motor"][1] > 1.0


@pytest.mark.parametrize("name", ["thesis", "one stage", "three stages", "belt"])
def test_back_driven_it_holds_below_breakout_and_yields_above(name):
    """At the crank, motor free: from where on it yields, against the sum of drags and losses stage by stage.

    Without teeth's ripple, so that one figure holds at every tooth. The drag of stage k counts by the ratios behind it.
    """
    p = rigs()[name]
    smooth = {f"stage{k}": s.model_copy(update={"ripple": 0.0}) for k, s in enumerate(p.gearbox.in_use, 1)}
    p = p.model_copy(update={"gearbox": p.gearbox.model_copy(update=smooth)})
    held, b = 0.0, p.gearbox.breakaway_ratio
    for stage in p.gearbox.in_use:
        held = stage.ratio * (held + b * stage.drag * stage.drag_ratio) / (1.0 - b * (1.0 - stage.backdrive_efficiency))
    assert breakout_torque(p) == pytest.approx(
        held * p.linkage.arm / p.linkage.crank + p.column.coulomb_friction, rel=1e-9
    )

    def creep(torque: float) -> float:
        gears = alone(p)
        settle(gears, 0.0, torque, 0.4)
        record = gears.run(gears.times(0.2), {"crank": torque})
        return float(record.angle["motor"][-1] - record.angle["motor"][0]) / 0.2

    assert abs(creep(0.95 * held)) < 1e-6
    assert creep(1.08 * held) > 1.0


def steady(speed: float, torque: float) -> float:
    """Mean motor torque [N·m] while its shaft turns at ``speed`` [rad/s] against ``torque`` [N·m] at the crank."""
    gears = alone(heavy())
    gears.push(motor=speed, carrier1=speed / 5.0, crank=speed / 25.0)
    turn = round(2.0 * math.pi / abs(speed) / gears.step)
    record = gears.run(np.arange(2 * turn) * gears.step, {"crank": -torque})  # a revolution to settle, one to measure
    assert record.final["motor"][1] == pytest.approx(speed, rel=1e-3)
    return float(np.mean(record.signal["torque1"][turn:] / 5.0 + record.signal["friction1"][turn:]))


def test_efficiency_is_085_driving_and_less_back_driven():
    """At 1.0 N·m of motor torque the crank gives 21.25 N·m; carrying as much back, the motor gets less than 85 %.

    With ripple and transmission error, over a revolution; without them verification has it over torque.
    """
    motor = steady(100.0, 21.25)
    assert motor == pytest.approx(1.0, rel=0.01)
    driving = 21.25 / motor / 25.0
    back = steady(-100.0, 21.25) * 25.0 / 21.25
    assert driving == pytest.approx(0.85, rel=0.01)
    assert 0.7 < back < driving - 0.03


def test_efficiency_falls_at_part_load():
    """The drag costs the same at any load."""
    assert 4.0 / steady(100.0, 4.0) / 25.0 < 0.70


# --- teeth ---


def turned_without_load(p: Parameters, revolutions: float) -> Record:
    """A stage whose motor turns and whose output follows without touching; the phase of its teeth shows in friction."""
    stage = p.gearbox.stage1.model_copy(update={"backlash": 1.0})
    box = p.gearbox.model_copy(update={"stages": 1, "stage1": stage})
    free = Specimen(heavy(p.model_copy(update={"gearbox": box})), ("motor", "crank"), ("rod", "weight"))
    free.push(motor=100.0, crank=100.0 / stage.ratio)
    steps = round(revolutions * 2.0 * math.pi / 100.0 / free.step)
    return free.run(np.arange(steps) * free.step)


@pytest.mark.parametrize("kind", KINDS)
def test_friction_ripples_with_the_tooth_passing_frequency(kind):
    """± 25 % of the drag as often as the input's teeth pass, of a planetary stage relative to its carrier.

    18 teeth at a ratio of 5: 18 · 4/5 a revolution of the motor if the mesh goes round with the output, else 18.
    """
    teeth = 0 if kind == "belt" else 18
    stage = GearStage(kind=kind, ratio=5.0, teeth=teeth, drag=0.055)
    record = turned_without_load(with_stages(stage), 6.0)
    assert not record.signal["torque1"].any()
    level = record.signal["friction1"][len(record.time) // 6 :]  # 5 revolutions
    assert level.mean() == pytest.approx(0.055, rel=0.02)
    if not teeth:
        assert np.ptp(level) < 1e-9
        return
    assert np.ptp(level) / 2 / level.mean() == pytest.approx(0.25, rel=0.05)
    spectrum = np.abs(np.fft.rfft(level - level.mean()))
    assert np.argmax(spectrum) / 5.0 == pytest.approx(18 * 0.8 if kind == "planetary" else 18, abs=0.2)


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "belt"])
def test_transmission_error_shows_at_the_output(kind):
    """Without play and friction, turned slowly: the crank runs ahead and behind by the error, tooth by tooth."""
    quiet = GearStage(ratio=5.0, stiffness=6.0 / ARCMIN, ripple=0.0)
    wavy = quiet.model_copy(update={"kind": kind, "teeth": 18, "transmission_error": 0.4 * ARCMIN})
    gears = alone(heavy(with_stages(wavy, quiet)))
    gears.push(motor=20.0, carrier1=4.0, crank=0.8)
    turn = round(2.0 * math.pi / 20.0 / gears.step)
    record = gears.run(np.arange(3 * turn) * gears.step)
    ahead = (record.angle["motor"] / 25.0 - record.angle["crank"])[turn:]
    assert np.ptp(ahead) / 2 == pytest.approx(0.4 * ARCMIN / 5.0, rel=0.05)
    passed = np.argmax(np.abs(np.fft.rfft(ahead - ahead.mean()))) / 2.0
    assert passed == pytest.approx(18 * 0.8 if kind == "planetary" else 18, abs=0.5)


# --- energy ---


def energies(gears: Specimen, p: Parameters, steps: int) -> Any:
    """What shafts, meshes and bristles hold while the gearbox moves on by itself [J].

    The motion's share is ½ J v₋ v₊ with the speeds of the steps to and from a position: of semi-implicit Euler, that is
    what does not change with the phase of an oscillation.
    """
    inertias = {name: float(gears.model.joint(name).M0[0]) for name in gears.shafts}
    total = np.zeros(steps)
    for n in range(steps):
        record = gears.run(np.zeros(1))
        for name, inertia in inertias.items():
            total[n] += 0.5 * inertia * record.velocity[name][0] * record.final[name][1]
        for k, stage in enumerate(p.gearbox.in_use):
            beyond = abs(gears.truth.body.twist[k] - stage.transmission_error * teeth_of(stage, k, gears, record))
            total[n] += 0.5 * stage.stiffness * max(beyond - 0.5 * stage.backlash, 0.0) ** 2
            total[n] += 0.5 * p.gearbox.bristle_stiffness * gears.truth.body.bristle[k] ** 2
    return total


def teeth_of(stage: GearStage, k: int, gears: Specimen, record: Record) -> float:
    """Sine of a stage's mesh phase at the first of the recorded states."""
    before, behind = (float(record.angle[gears.shafts[k + n]][0]) for n in (0, 1))
    return math.sin(stage.teeth * (before - behind if stage.kind == "planetary" else before))


@pytest.mark.parametrize("kind", KINDS)
def test_transmission_error_makes_no_energy(kind):
    """A lossless stage that coasts over its teeth: what the error takes from the motion it gives back."""
    stage = GearStage(
        kind=kind, ratio=5.0, teeth=18, stiffness=4000.0, transmission_error=1e-3, damping_ratio=0.0, ripple=0.0,
        inertia=1e-3,
    )  # fmt: skip
    p = with_stages(stage).model_copy(update={"simulation": Simulation(substeps=8)})
    gears = alone(p)
    gears.push(motor=20.0, crank=4.0)
    energy = energies(gears, p, 8_000)
    assert gears.data.qpos[gears.joints.index("motor")] > 0.5  # over a tooth and more
    assert energy == pytest.approx(energy[0], rel=1e-3)


@pytest.mark.parametrize("drag_ratio", [0.0, 0.3, 1.0, 4.0])
def test_energy_never_grows(drag_ratio):
    """A stage with play and lossy teeth, its drag unlike for the two ways, rattles to rest by itself."""
    stage = GearStage(
        ratio=4.0, stiffness=4000.0, backlash=6 * ARCMIN, drag=0.05, drag_ratio=drag_ratio, efficiency=0.9,
        backdrive_efficiency=0.85, inertia=1e-3,
    )  # fmt: skip
    p = with_stages(stage).model_copy(update={"simulation": Simulation(substeps=8)})
    gears = alone(p)
    gears.push(motor=40.0, crank=-15.0)
    energy = energies(gears, p, 24_000)
    assert energy[-1] < 0.1 * energy[0]
    assert (energy - np.minimum.accumulate(energy)).max() < 1e-4 * energy[0]


# --- who drives ---


def levels(stage: GearStage, torques: Any, *, way: float = 1.0, mesh: float = 0.0) -> Any:
    """Friction level [N·m] over the torque of the mesh [N·m], sliding in the direction ``way``."""
    p = with_stages(stage)
    record = Specimen(p).truth.mechanism.stage[0]
    assert record.dtype == STAGE
    return np.array([friction_level(record, way * 1e-5, torque, mesh) for torque in torques])


@pytest.mark.parametrize("kind", KINDS)
def test_one_drag_for_both_ways_is_the_plain_law(kind):
    """To the last bit: (drag + μ |T| / r) (1 + ripple sin ψ), with μ for the way the torque goes."""
    stage = GearStage(kind=kind, ratio=7.0, drag=0.13, efficiency=0.87, backdrive_efficiency=0.79, ripple=0.3)
    torques = np.random.default_rng(1).uniform(-30.0, 30.0, 500)
    for way, mesh in ((1.0, 0.0), (-1.0, 0.4), (1.0, -1.0)):
        loss = np.where(way * torques < 0.0, 1.0 - 0.79, 1.0 / 0.87 - 1.0)
        plain = (0.13 + loss * np.abs(torques) / 7.0) * (1.0 + 0.3 * mesh)
        np.testing.assert_array_equal(levels(stage, torques, way=way, mesh=mesh), plain)


@pytest.mark.parametrize("drag_ratio", [0.0, 0.3, 1.3, 4.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_two_drags_pass_into_each_other(drag_ratio, way):
    """Far from no torque LossyGear's; between the two a straight line; nowhere as steep as the torque at the input."""
    stage = GearStage(ratio=5.0, drag=0.2, drag_ratio=drag_ratio, efficiency=0.9, backdrive_efficiency=0.85)
    width = 5.0 * abs(0.2 * drag_ratio - 0.2)
    torques = np.linspace(-3.0 * width, 3.0 * width, 6001)
    driving = way * torques > 0.0
    level = levels(stage, torques, way=way)
    loss = np.where(driving, 1.0 / 0.9 - 1.0, 0.15) * np.abs(torques) / 5.0
    lossy_gear = np.where(driving, 0.2, 0.2 * drag_ratio) + loss
    far = np.abs(torques) >= width
    np.testing.assert_allclose(level[far], lossy_gear[far], rtol=1e-12)
    steepest = np.abs(np.diff(level)).max() / np.diff(torques / 5.0).max()
    assert steepest < 0.5 + 0.15 + 1e-6
    between = (level - loss)[~far]
    np.testing.assert_allclose(between, np.linspace(between[0], between[-1], len(between)), rtol=1e-9)
    assert level[3000] == pytest.approx(0.1 * (1.0 + drag_ratio))  # no torque: the mean


def brake(p: Parameters, speed: float, torque: float) -> float:
    """Mean friction [N·m] of stage 1, its motor turning at ``speed`` [rad/s] against ``torque`` [N·m] at the crank."""
    gears = alone(heavy(p))
    gears.push(motor=speed, crank=speed / p.gearbox.ratio)
    record = gears.run(gears.times(0.1), {"crank": -torque})
    return float(record.signal["friction1"][-500:].mean())


def test_each_way_has_its_drag_in_motion():
    stage = GearStage(ratio=5.0, drag=0.1, drag_ratio=3.0, efficiency=0.95, backdrive_efficiency=0.9, ripple=0.0)
    p = with_stages(stage)
    for way in (1.0, -1.0):
        assert brake(p, way * 50.0, way * 20.0) * way == pytest.approx(0.1 + (1 / 0.95 - 1) * 4.0, rel=0.01)
        assert brake(p, way * 50.0, -way * 20.0) * way == pytest.approx(0.3 + 0.1 * 4.0, rel=0.01)
        assert brake(p, way * 50.0, 0.0) * way == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("load", [5.0, 500.0])
@pytest.mark.parametrize("place", [1, 2, 3])
def test_self_locking_holds_any_load_wherever_the_stage_is(place, load):
    """A worm among other stages: nothing moves for good; with a little efficiency left, it runs."""
    stages = [BELT.model_copy(update={"ratio": 2.0})] * 3

    def creep(efficiency: float) -> float:
        worm = WORM.model_copy(update={"backdrive_efficiency": efficiency, "drag": 0.0, "ripple": 0.0})
        box = [*stages[: place - 1], worm, *stages[place:]]
        gears = alone(with_stages(*(s.model_copy(update={"drag": 0.0}) for s in box)))
        settle(gears, 0.0, load, 1.0)
        damped = {"crank": Feedback(damping=0.5)}
        gears.run(gears.times(0.8), {"crank": load}, feedback=damped)  # rung out
        record = gears.run(gears.times(0.2), {"crank": load}, feedback=damped)
        worm_input = record.angle[gears.shafts[place - 1]]
        return float(worm_input[-1] - worm_input[0]) / 0.2

    assert abs(creep(-0.2)) < 1e-6
    assert creep(0.5) > 1.0


@pytest.mark.parametrize("name", list(rigs()))
def test_the_crank_follows_the_motor_by_the_ratio(name):
    """Any number of stages, none included: the motor turned by 2 rad, and what play and give leave of it."""
    p = rigs()[name]
    gears = alone(p)
    assert gears.shafts == ({0: ("crank",), 1: ("motor", "crank")}.get(p.gearbox.stages) or
                            ("motor", *(f"carrier{k}" for k in range(1, p.gearbox.stages)), "crank"))  # fmt: skip
    assert gears.joints == ("column", "limb", *gears.shafts)
    motor = gears.shafts[0]
    time = gears.times(1.0)
    target = np.minimum(time / 0.8, 1.0) * 2.0
    record = gears.run(time, feedback={motor: Feedback(200.0, 0.5)}, target={motor: target})
    turned, crank = record.final[motor][0], record.final["crank"][0]
    assert turned == pytest.approx(2.0, abs=0.01)
    loose, behind = 0.0, p.gearbox.ratio
    for stage in p.gearbox.in_use:
        behind /= stage.ratio
        loose += (0.5 * stage.backlash + stage.transmission_error) / behind
    give = sum(0.5 * stage.drag / stage.stiffness for stage in p.gearbox.in_use) + 1e-5
    assert crank == pytest.approx(turned / p.gearbox.ratio, abs=loose + give)


def test_a_gear_without_any_drag_is_finite():
    """Friction that vanishes with the load must neither divide by zero nor kick."""
    free = GearStage(backlash=3 * ARCMIN, stiffness=4000.0)
    gears = alone(with_stages(free, free))
    time = gears.times(0.2)
    record = gears.run(time, {"crank": 5.0 * np.sin(2 * math.pi * 10 * time)})
    for number in (1, 2):
        assert np.abs(record.signal[f"friction{number}"]).max() < 0.5
        assert np.abs(record.signal[f"torque{number}"]).max() > 0.1
    assert all(np.isfinite(angle).all() for angle in record.angle.values())


# --- the whole bench ---

STATIC = """
hand = [{at = 0.0, kind = "ramp", to_deg = -5.0, over = 0.5, smooth = true},
        {at = 1.0, kind = "ramp", to_deg = 5.0, over = 2.5},
        {at = 4.0, kind = "ramp", to_deg = -5.0, over = 2.5}]
squeeze = [{at = 0.0, value = 1.0}]
changes = [{at = 0.0, mode = "torque"}, {at = 0.8, parameters = {"drive.set_torque" = 1.0}}]
"""


def test_at_stall_torque_the_column_gives_37_2_nm():
    """Thesis 3.2.2: 1.0 N·m · 25 · 0.85 · 1.75 = 37.19 N·m, 124.0 N at the grip, while the motor slowly drives.

    The encoder's noise is off: at standstill it would be a dither of 1e-4 N·m.
    """
    ran = run(STATIC, duration=7.0, seed=3, set=[
        "encoder.noise=0.0", "plc.following_error_limit=10.0", "limb.arm_stiffness=2e5", "limb.arm_damping=400.0",
    ])  # fmt: skip
    assert ran.error is None
    assert not [event for event in ran.events if event.level != "info"]
    assert ran.between("/drive.torque", 1.0, 6.9) == pytest.approx(1.0, rel=0.01)
    bar = P.linkage.four_bar

    def column_torque(start: float, end: float) -> float:
        """Mean torque on the hand, brought to the linkage ratio of neutral."""
        angle = ran.between("/column.angle", start, end)
        ratio = [crank_ratio(bar, crank_from_column(bar, x), x) for x in angle[::20]]
        return float(np.mean(-ran.between("/column.torque", start, end)[::20] / ratio) * 1.75)

    driving, back_driven = column_torque(1.2, 3.4), column_torque(4.2, 6.4)
    assert ran.between("/column.velocity", 1.2, 3.4).mean() == pytest.approx(10 * DEG / 2.5, rel=0.01)
    assert driving == pytest.approx(37.2, rel=0.03)
    assert driving / 0.3 == pytest.approx(124.0, rel=0.03)
    assert -ran.between("/pilot.hand_force", 1.2, 3.4).mean() == pytest.approx(124.0, rel=0.03)
    # Back-driven, the friction helps the motor to hold: efficiency below that of driving.
    assert 43.75 / back_driven < driving / 43.75 - 0.02
    # At standstill nothing creeps, and the torque may lie anywhere between the two.
    still = ran.between("/column.velocity", 3.9, 4.0)
    assert np.abs(still).max() < 1e-6
    assert driving * 0.95 < -ran.between("/column.torque", 3.9, 4.0).mean() < back_driven
