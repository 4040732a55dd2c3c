"""Rigs: those that come with the bench, their figures, the rules that give them gains, faults of their files."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from click.testing import CliRunner

from cls_bench.cli import main
from cls_bench.errors import InputError
from cls_bench.kinematics import crank_from_column, rod_angle
from cls_bench.linear.alone import drive_alone
from cls_bench.linear.bench import LinearBench
from cls_bench.linear.hand import Hand, forward_inertia
from cls_bench.linear.least import GRIPS, least_inertia, search_range
from cls_bench.linear.plant import plant
from cls_bench.linear.variation import Setup, changed, variation
from cls_bench.parameters import ARCMIN, GRAVITY, Parameters
from cls_bench.resources import shipped_rigs
from cls_bench.rigs import figures, load_rig, parse_rig, resonances
from cls_bench.rigs.modes import chain
from cls_bench.rigs.tuning import GAIN_MARGIN, answer_delay, gain_limit
from cls_bench.scenario import load_scenario
from cls_bench.sweep.plan import load_sweep
from tests.running import run

SHIPPED = tuple(shipped_rigs())
BARE = 'title = "x"\n'

SIDE_STICK = """
title = "Side stick on a torque motor, no linkage"
[data_sheet]
gearbox = []
[data_sheet.motor]
stall_torque_Nm = 6.0
torque_constant_Nm_per_A = 1.1
motor_constant_Nm_per_sqrtW = 0.9
rotor_inertia_kgcm2 = 12
[data_sheet.load_cell]
capacity_Nm = 40
stiffness_Nm_per_rad = 20000
[parameters.linkage]
kind = "none"
[parameters.column]
inertia = 0.01
mass = 0.8
mass_height = 0.08
grip_height = 0.18
travel = 0.3
switch_angle = 0.32
stop_angle = 0.34
[parameters.feel]
inertia = 0.05
damping = 0.3
stiffness = 10
"""

CYCLIC = """
title = "Helicopter cyclic, a torque motor on the crank"
[data_sheet]
gearbox = []
[data_sheet.motor]
rated_torque_Nm = 12.0
rated_current_A = 5.0
torque_constant_Nm_per_A = 2.4
resistance_ohm = 4.5
inductance_mH = 20
rotor_inertia_kgcm2 = 25
[parameters.linkage]
crank = 0.08
rod = 0.35
arm = 0.10
rod_angle = 0.4
crank_angle = 0.2
arm_angle = -0.1
[parameters.column]
inertia = 0.35
mass = 2.0
mass_height = 0.3
grip_height = 0.65
travel = 0.2
switch_angle = 0.22
stop_angle = 0.24
"""

TILTED = (
    {"rod_angle": 0.4, "crank_angle": 0.3, "arm_angle": -0.1},
    {"rod_angle": 1.5, "crank_angle": 1.4, "arm_angle": 1.6, "rod": 0.4},
    {"rod_angle": 0.3, "crank_angle": -0.3, "arm_angle": -0.2, "rod": 0.4, "arm": 0.12, "rod_column_mass": 2.0},
)


def drive_growth(p: Parameters, hand: Hand, gain: float = 1.0) -> float:
    """Growth rate of the drive's own loops with its velocity controller's gain as many times as large [1/s]."""
    louder = changed(p, "drive.velocity_bandwidth", gain * p.drive.velocity_bandwidth)
    return LinearBench(louder, hand, closed=False, model=False).growth_rate


@pytest.mark.parametrize("name", SHIPPED)
def test_the_drive_of_a_shipped_rig_is_calm_however_it_is_gripped(name: str) -> None:
    p = load_rig(name).parameters
    assert all(drive_growth(p, hand) < 0.0 for hand in GRIPS)
    assert drive_growth(p, Hand(None), 0.9 * GAIN_MARGIN) < 0.0
    assert drive_alone(p) == ""


@pytest.mark.parametrize("toml", [SIDE_STICK, CYCLIC])
def test_the_rule_keeps_the_drive_from_singing(toml: str) -> None:
    p = parse_rig(toml).parameters
    assert all(drive_growth(p, hand) < 0.0 for hand in GRIPS)
    limit, sings = gain_limit(p)
    assert p.drive.velocity_bandwidth == pytest.approx(limit / GAIN_MARGIN)
    at_limit = limit / p.drive.velocity_bandwidth
    # The rule's loop is continuous, the linear model's sampled and with back EMF: a few degrees at a light resonance.
    assert drive_growth(p, Hand(None), 0.9 * at_limit) < 0.0 < drive_growth(p, Hand(None), 1.25 * at_limit)
    loud = changed(p, "drive.velocity_bandwidth", 1.3 * limit)
    frequency = LinearBench(loud, Hand(None), closed=False, model=False).growth.imag / (2.0 * math.pi)
    assert frequency == pytest.approx(sings, rel=0.1)
    assert "the drive itself is unstable at" in drive_alone(loud)


@pytest.mark.parametrize("name", SHIPPED)
def test_the_rules_limit_is_the_linear_models(name: str) -> None:
    p = load_rig(name).parameters
    at_limit = gain_limit(p)[0] / p.drive.velocity_bandwidth
    assert drive_growth(p, Hand(None), 0.88 * at_limit) < 0.0 < drive_growth(p, Hand(None), 1.12 * at_limit)


def test_gains_are_the_thesiss_in_proportion() -> None:
    """Each of the three bounds decides somewhere."""
    thesis = Parameters()
    soft = parse_rig(f"{BARE}[parameters.load_cell]\nstiffness = 2.0e5\n")
    share = resonances(soft.parameters).held / resonances(thesis).held
    assert soft.parameters.drive.velocity_bandwidth == pytest.approx(100.0 * share)
    assert soft.parameters.drive.position_bandwidth == pytest.approx(35.0 * share)
    assert soft.parameters.drive.velocity_integral_time == pytest.approx(0.02 / share)
    slow = parse_rig(f"{BARE}[data_sheet.drive]\nvelocity_cycle_us = 400\nposition_cycle_us = 400\n")
    share = answer_delay(thesis) / answer_delay(slow.parameters)
    assert slow.parameters.drive.velocity_bandwidth == pytest.approx(100.0 * share)
    assert answer_delay(thesis) == pytest.approx(200e-6 + 400e-6 + 75e-6 + 1.0 / (2000.0 * math.pi))
    stiff = parse_rig(f"{BARE}[parameters.load_cell]\nstiffness = 9.0e6\n")
    assert stiff.parameters.drive.velocity_bandwidth == 100.0
    stated = parse_rig(f"{BARE}[parameters.drive]\nvelocity_bandwidth = 55.0\n[parameters.column]\nmass = 1.0\n")
    assert stated.parameters.drive.velocity_bandwidth == 55.0


@pytest.mark.parametrize(("cycle", "bandwidth"), [(25, 1000.0), (50, 1000.0), (100, 500.0), (200, 250.0)])
def test_the_current_loop_follows_its_cycle(cycle: int, bandwidth: float) -> None:
    table = f"current_cycle_us = {cycle}\nvelocity_cycle_us = 400\nposition_cycle_us = 400\n"
    rig = parse_rig(f"{BARE}[data_sheet.drive]\n{table}")
    assert rig.parameters.drive.current_bandwidth == pytest.approx(bandwidth)
    assert [d.key for d in rig.derived].count("drive.current_bandwidth") == (cycle > 50)
    assert drive_alone(rig.parameters) == ""


@pytest.mark.parametrize("name", ["current", "velocity", "position"])
def test_a_bandwidth_is_at_most_half_the_rate_of_its_controller(name: str) -> None:
    cycles = "current_cycle = 0.0002\nvelocity_cycle = 0.0004\nposition_cycle = 0.0008\n"
    most = {"current": 2500.0, "velocity": 1250.0, "position": 625.0}[name]
    text = f"{BARE}[parameters.rates]\n{cycles}[parameters.drive]\n{name}_bandwidth = "
    assert getattr(parse_rig(f"{text}{most}\n").parameters.drive, f"{name}_bandwidth") == most
    with pytest.raises(InputError, match=f"^rig.toml: parameters.*{name}_bandwidth = .*must be at most {most:g} Hz$"):
        parse_rig(f"{text}{1.001 * most}\n")


def linear_resonances(p: Parameters) -> tuple[float, float]:
    """Free and held by the linear model, whose weights are left out."""
    light = p.model_copy(update={"column": p.column.model_copy(update={"mass_height": 0.0})})
    found = plant(light, Hand(None))

    def modes(first: int) -> list[float]:
        squares = scipy.linalg.eigh(found.stiffness[first:, first:], found.mass[first:, first:], eigvals_only=True)
        return sorted(math.sqrt(value) / (2.0 * math.pi) for value in squares if value > 0.0)

    return next(f for f in modes(0) if f > 5.0), modes(1)[0]


@pytest.mark.parametrize("rig", [*SHIPPED, *TILTED], ids=str)
def test_resonances_are_those_of_the_linear_model(rig: str | dict[str, float]) -> None:
    if isinstance(rig, str):
        p = load_rig(rig).parameters
    else:
        p = parse_rig(BARE + "[parameters.linkage]\n" + "".join(f"{key} = {x}\n" for key, x in rig.items())).parameters
    assert resonances(p) == pytest.approx(linear_resonances(p), rel=0.005)


def test_the_motor_finds_all_inertia_below_the_resonances_and_its_own_above() -> None:
    p = load_rig("direct_drive").parameters
    low, high = abs(chain(p).mobility(np.array([5.0, 5e4])))
    assert 1.0 / (2.0 * math.pi * 5.0 * low) == pytest.approx(p.nameplate.load_inertia, rel=0.001)
    link = p.linkage
    own = p.motor.rotor_inertia + link.crank_inertia + sum(link.masses[:2]) * link.crank**2
    assert 1.0 / (2.0 * math.pi * 5e4 * high) == pytest.approx(own, rel=0.001)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_rig_tracks_without_a_warning(name: str) -> None:
    """The motion of motion_tracking, with the rig's own feel, for half a second after it begins."""
    toml = """
[[hand]]
at = 0.0
kind = "hold"
angle_deg = 0.0
[[hand]]
at = 0.1
kind = "sine"
amplitude_deg = 5.0
frequency = 2.0
fade = 0.1
"""
    ran = run(f'rig = "{name}"\n{toml}', duration=0.6, seed=4)
    assert ran.error is None
    assert [event.message for event in ran.events if event.level in ("warning", "error")] == []
    moved, asked = ran["/column.angle"], ran["/feel.angle"]
    assert np.max(moved) > 0.01 and np.min(moved) < -0.01
    followed = moved - np.interp(ran.time("/column"), ran.time("/feel"), asked)
    assert np.max(np.abs(followed)) < 0.02 + 0.1 * np.max(np.abs(asked))


def test_the_page_shows_the_figures_of_the_shipped_rigs() -> None:
    """Figures with a closed form that a reader can work out, to the digits shown."""
    page = (Path(__file__).parent.parent / "docs" / "rigs.md").read_text()
    tables = re.findall(r"^ (\w+) {2,}([\w. ]+)$", page, re.MULTILINE)
    at_grip = {name: cells.split() for name, cells in tables[: len(SHIPPED)]}
    in_motion = {name: cells.split() for name, cells in tables[len(SHIPPED) : 2 * len(SHIPPED)]}
    assert sorted(at_grip) == sorted(in_motion) == sorted(SHIPPED)
    for name in SHIPPED:
        p = load_rig(name).parameters
        link, grip = p.linkage, p.column.grip_height
        ratio = 1.0 if link.kind == "none" else link.arm / link.crank
        step = grip * 2.0 * math.pi / (p.encoder.counts * p.encoder.interpolation * p.gearbox.ratio * ratio)
        assert float(at_grip[name][5]) == pytest.approx(1e6 * step, rel=0.005)
        assert float(at_grip[name][2]) == pytest.approx(p.load_cell.capacity * link.arm / grip, rel=0.005)
        total = p.nameplate.load_inertia / p.motor.rotor_inertia - 1.0
        assert float(in_motion[name][0]) == pytest.approx(total, rel=0.005)
        assert float(in_motion[name][3]) == pytest.approx(p.drive.velocity_bandwidth, rel=0.005)
        free, held = linear_resonances(p)
        assert [float(cell) for cell in in_motion[name][1:3]] == pytest.approx([free, held], rel=0.005)


def test_forces_are_those_of_the_bench() -> None:
    """The motor's continuous torque, held by a stiff hand, and the power off breakout: the thesis's by hand."""
    p = load_rig("one_stage").parameters
    found, stage = figures(p), p.gearbox.stage1
    at_crank = (0.51 * 4.80 - stage.drag) * 10.0 * stage.efficiency
    assert found.continuous_force == pytest.approx(at_crank * 1.75 / 0.3)
    static = p.gearbox.breakaway_ratio * (1.0 + stage.ripple)
    mesh = 10.0 * (0.02 + static * stage.drag) / (1.0 - static * (1.0 - stage.backdrive_efficiency))
    assert found.breakout_force == pytest.approx((mesh * 1.75 + 0.05) / 0.3)
    assert found.backlash == pytest.approx(4.0 * ARCMIN / 1.75 * 0.3)
    assert figures(load_rig("non_backdrivable").parameters).breakout_force == math.inf


def test_the_inertia_ratio_is_the_plants_not_what_the_drive_believes() -> None:
    text = f"{BARE}[parameters.motor]\nrotor_inertia = 6.0e-5\n"
    told, plain = (figures(parse_rig(text + more).parameters) for more in ("[nameplate]\nload_inertia = 5.0e-4\n", ""))
    assert told.inertia_ratio == plain.inertia_ratio == pytest.approx((9.275e-5 - 4e-5) / 6e-5, rel=1e-3)


@pytest.mark.parametrize("link", TILTED, ids=str)
def test_unbalance_of_a_tilted_linkage(link: dict[str, float]) -> None:
    """Torque of all weights on the column near neutral, by statics of the moving linkage, is what the PLC takes out."""
    table = "".join(f"{key} = {x}\n" for key, x in link.items())
    p = parse_rig(f"{BARE}[parameters.linkage]\n{table}").parameters
    bar, (_, far, end) = p.linkage.four_bar, p.linkage.masses

    def torque(angle: float) -> float:
        rod, arm = rod_angle(bar, crank_from_column(bar, angle), angle), angle + bar.arm_angle
        across = np.array([math.sin(rod), math.cos(rod)])
        pin = bar.arm * np.array([math.cos(arm), -math.sin(arm)])  # its motion for a turn of the column
        of_far = far * across[1] * float(across @ pin)  # the share of the weight across the rod, on the pin
        return -GRAVITY * (of_far + end * pin[1] - p.column.mass * p.column.mass_height * math.sin(angle))

    slope = (torque(1e-4) - torque(-1e-4)) / 2e-4
    a = p.column.travel
    assert p.nameplate.unbalance == pytest.approx(slope * 3.0 * (math.sin(a) - a * math.cos(a)) / a**3, rel=1e-4)


def test_the_crank_of_a_rig_without_one_is_said() -> None:
    rig = parse_rig(f'{BARE}[parameters.linkage]\nkind = "none"\n')
    (said,) = [entry for entry in rig.derived if entry.key == "linkage.crank_inertia"]
    assert said.value == rig.parameters.linkage.crank_inertia and said.how.startswith("assumed")
    stated = parse_rig(f'{BARE}[parameters.linkage]\nkind = "none"\ncrank_inertia = 1.0e-4\n')
    assert stated.parameters.linkage.crank_inertia == 1e-4
    assert "linkage.crank_inertia" not in [entry.key for entry in stated.derived]


@pytest.mark.parametrize(
    ("toml", "problem"),
    [
        ("", "title: missing"),
        (f"{BARE}[parameters.linkage]\nrod_angle = 0.5\ncrank_angle = 0.5\narm_angle = -0.3\n",
         "parameters: polynomials of degree 9 do not follow the linkage"),
        (f"{BARE}[parameters.linkage]\nrod = 0.02\n", "parameters: linkage: crank, rod and arm: the linkage cannot be"),
        (f"{BARE}[parameters.gearbox.stage1]\nstiffness = 1.0e9\ninertia = 1.0e-8\n",
         r"parameters\.gearbox\.stage1\.\w+: .* is too (high|low) .* no number of substeps carries it"),
        (f"{BARE}[nameplate]\ngear_rato = 25.0\n", "nameplate.gear_rato: unknown parameter; did you mean"),
        (f"{BARE}[parameters.nameplate]\ngear_ratio = 25.0\n", "parameters.nameplate.gear_ratio: give it in the table"),
        (f"{BARE}[parameters.colum]\nmass = 1.0\n", "parameters.colum.mass: unknown parameter"),
        (f"{BARE}[data_sheet.motor]\nstall_torque = 1.0\n", "data_sheet.motor.stall_torque: unknown key; did you mean"),
        (f"{BARE}[[data_sheet.gearbox]]\nratio = 10\n", r"data_sheet.gearbox\[0\]\.\w+: missing"),
        ("title = 3\n", "title: 3 is not valid"),
        ("title = \n", ".*line 1"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_one_line(toml: str, problem: str) -> None:
    with pytest.raises(InputError, match=f"^my.toml: {problem}") as failure:
        parse_rig(toml, name="my")
    assert "\n" not in str(failure.value)


def test_a_name_that_is_no_rig() -> None:
    with pytest.raises(InputError, match=r"^direct_drve: no such rig or file; did you mean direct_drive"):
        load_rig("direct_drve")


@pytest.mark.parametrize("inertia", [0.0009, 6.0])
def test_the_least_inertia_of_heavy_and_light_controls_is_searched_where_it_may_be(inertia: float) -> None:
    column = f"[parameters.column]\ninertia = {inertia}\nmass = 0.05\nmass_height = 0.01\ngrip_height = 0.75\n"
    p = parse_rig(f"{BARE}{column}[parameters.linkage]\nrod_column_mass = 0.0\nrod_end_mass = 0.0\n").parameters
    low, high = search_range(p)
    assert (low, high) == (0.001, pytest.approx(20.0 * forward_inertia(p, Hand()))) if inertia < 1.0 else high == 100.0
    assert least_inertia(p, [Hand(1.0)])[0] >= 0.0
    for name in ("feel.inertia", "forward_inertia", "limb_mass", "feel.damping", "load_cell.adc_bits"):
        found = variation(name, of=p)
        for end in (found.low, found.high):
            found.apply(Setup(p), round(end) if found.whole else end)


def test_a_ratio_that_drive_and_plc_do_not_believe_is_said() -> None:
    def notes(*overrides: str) -> list[str]:
        return [n for n in load_scenario("motion_tracking", set=overrides).notes if "believe" in n]

    assert notes() == notes("gearbox.stage1.ratio=5.8") == notes("linkage.crank=0.101") == []
    (note,) = notes("gearbox.stages=1")
    assert note.startswith("the motor turns 8.75 times for one turn of the control, and drive and PLC believe 43.75")
    assert len(notes("gearbox.stage2.ratio=6.1")) == len(notes("gearbox.stage2.ratio=4.1")) == 1
    assert load_scenario("motion_tracking", rig="one_stage").parameters_at_start().nameplate.gear_ratio == 10.0


def test_a_sweep_finds_rigs_beside_it(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(f"{BARE}[parameters.column]\nmass = 1.0\n")
    axis = '[[axes]]\nkey = "rig"\nkind = "list"\nvalues = ["mine.toml", "one_stage"]\n'
    path = tmp_path / "sweep.toml"
    path.write_text(f'title = "x"\nscenario = "motion_tracking"\ncollect = ["lag"]\n{axis}')
    assert load_sweep(path).rigs["mine.toml"].parameters.column.mass == 1.0
    path.write_text(f'title = "x"\nscenario = "motion_tracking"\ncollect = ["lag"]\n{axis.replace("mine", "his")}')
    with pytest.raises(InputError, match=r"his\.toml: no such file"):
        load_sweep(path)


@pytest.mark.parametrize("command", ["rigs", "predict", "run"])
def test_a_drive_that_sings_is_said(command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loud.toml").write_text(f"{SIDE_STICK}[parameters.drive]\nvelocity_bandwidth = 100.0\n")
    Path("calm.toml").write_text(SIDE_STICK)
    words = {"rigs": ["rigs", "{}"], "predict": ["predict", "--rig", "{}"],
             "run": ["run", "motion_tracking", "--rig", "{}", "--out", "o"]}[command]  # fmt: skip
    loud, calm = (CliRunner().invoke(main, [w.format(f) for w in words]) for f in ("loud.toml", "calm.toml"))
    assert re.search(r"^warning: (loud: )?the drive itself is unstable at 6\d\d Hz", loud.stderr, re.MULTILINE)
    assert "the drive itself" not in calm.stderr


@pytest.mark.parametrize("seed", range(40))
def test_the_drive_of_a_random_rig_does_not_sing(seed: int) -> None:
    """Motors of mechanical time constants from 0.7 to 10 ms, none to two stages, on controls up to absurdly heavy."""
    rng = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    constant, stall, stages = between(0.1, 5.0), between(0.3, 30.0), int(rng.integers(3))
    resistance = constant**2 / stall * between(3.0, 20.0)
    rotor = 1e4 * between(7e-4, 1e-2) * constant**2 / (1.5 * resistance)
    gearbox = "" if stages == 0 else (
        f"[[data_sheet.gearbox]]\nratio = {between(2, 40)}\nstages = {stages}\nefficiency = 0.9\n"
        f"stiffness_Nm_per_arcmin = {between(0.3, 30)}\ninertia_kgcm2 = {between(0.05, 1) * rotor}\n"
    )  # fmt: skip
    p = parse_rig(
        f"{BARE}[data_sheet]\n{'' if stages else 'gearbox = []'}\n[data_sheet.motor]\nstall_torque_Nm = {stall}\n"
        f"torque_constant_Nm_per_A = {constant}\nresistance_ohm = {resistance}\nrotor_inertia_kgcm2 = {rotor}\n"
        f"electrical_time_constant_ms = {between(0.5, 8)}\n{gearbox}[parameters.load_cell]\n"
        f"stiffness = {between(1e5, 2e7)}\n[parameters.column]\ninertia = {between(0.01, 5)}\nmass = 0.5\n"
        "mass_height = 0.1\n"
    ).parameters
    assert drive_alone(p) == ""
    assert all(drive_growth(p, Hand(squeeze)) < 0.0 for squeeze in (0.0, 0.5, 1.0))
