"""Aircraft: files and their faults, units of the grip on any rig, bands as checks, the command, the page."""

import json
import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cls_bench.aircraft import Setting, find_aircraft, load_aircraft, parse_aircraft, reach
from cls_bench.aircraft.page import with_tables
from cls_bench.aircraft.reach import largest_torque, spring_torque
from cls_bench.aircraft.units import UNITS, Scale, angle_deg, at_grip
from cls_bench.analysis.quasi_static import static_curve
from cls_bench.cli import main
from cls_bench.errors import InputError
from cls_bench.feel.elements.flight import Flight
from cls_bench.feel.elements.linkage import Linkage
from cls_bench.feel.elements.surface import Surface
from cls_bench.linear.hand import Hand
from cls_bench.linear.prediction import growth_rate
from cls_bench.linear.variation import Setup
from cls_bench.parameters import Feel, Parameters
from cls_bench.resources import shipped_aircraft, shipped_rigs, shipped_scenarios
from cls_bench.rigs import load_rig
from cls_bench.scenario import load_scenario, parse_scenario
from tests.conftest import Runner

SHIPPED = tuple(shipped_aircraft())
SCENARIOS = tuple(name for name in shipped_scenarios() if name.startswith("aircraft_"))
PAGE = Path(__file__).parent.parent / "docs" / "aircraft.md"

STICK = """
title = "A stick"
[stick]
title = "stick"
rig = "thesis"
[stick.feel]
inertia = { value = 4.0, unit = "kg", least = 1.0, greatest = 9.0, source = "invented" }
damping = { value = 20.0, unit = "N·s/m", least = 0.0, greatest = 90.0, source = "invented" }
stiffness = { value = 0.2, unit = "N/mm", least = 0.1, greatest = 0.4, source = "invented" }
friction = { value = 2.0, unit = "N", least = 0.0, greatest = 3.0, source = "invented" }
"aft_limit.angle" = { value = 80.0, unit = "mm", least = 70.0, greatest = 90.0, source = "invented" }
"forward_limit.angle" = { value = 85.0, unit = "mm", least = 70.0, greatest = 90.0, source = "invented" }
[[stick.bands]]
name = "at_50mm"
of = "force"
at = 50.0
at_unit = "mm"
least = 10.0
greatest = 14.0
unit = "N"
source = "invented"
"""


def stick(**scale: float) -> str:
    lines = "".join(f"{key} = {value}\n" for key, value in scale.items())
    return STICK.replace('rig = "thesis"\n', f'rig = "thesis"\nscale_reason = "a test"\n{lines}')


# --- what is shipped -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_every_control_fits_its_rig_in_every_condition(name: str) -> None:
    for setting in load_aircraft(name).settings:
        assert setting.about.rig in shipped_rigs()
        assert reach(setting, load_rig(setting.about.rig).parameters).verdict in ("lasting", "short"), setting.title


@pytest.mark.parametrize("name", SHIPPED)
def test_every_number_says_where_it_is_from_or_why_it_is_assumed(name: str) -> None:
    begins = re.compile(r"assumed: \w|fit: \w|derived: \w|\w.*\d|the condition itself")
    for setting in load_aircraft(name).settings:
        for key, number in setting.numbers.items():
            assert begins.match(number.source), f"{name} {key}: {number.source}"


@pytest.mark.parametrize("name", SHIPPED)
def test_a_damping_is_the_share_of_critical_that_its_source_says(name: str) -> None:
    said = 0
    for axis in load_aircraft(name).axes:
        first = next(s for s in load_aircraft(name).settings if s.axis == axis)
        source = first.numbers["damping"].source
        if share := re.search(r"([\d.]+) of critical", source):
            feel = first.on(load_rig(first.about.rig).parameters).feel
            stiffness = feel.stiffness + feel.q_feel.gradient * feel.flight.dynamic_pressure
            found = feel.damping / (2.0 * math.sqrt(stiffness * feel.inertia))
            assert found == pytest.approx(float(share[1]), abs=0.03)
            said += 1
    assert said or name in ("bell412", "engine_lever", "light_aircraft")


def test_what_the_notes_mark_as_from_memory_is_assumed() -> None:
    cyclic = load_aircraft("cyclic")
    for setting in cyclic.settings:
        assert all(band.source.startswith("assumed") for band in setting.bands)
    surface = load_aircraft("light_aircraft").setting("elevator", "kt65").numbers
    assert all(surface[f"surface.{key}"].is_assumed for key in ("area", "chord", "hinge_deflection", "hinge_alpha"))


def test_every_aircraft_has_a_scenario() -> None:
    flown = {load_scenario(name).aircraft.name for name in SCENARIOS}  # type: ignore[union-attr]
    assert flown == set(SHIPPED)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenarios_limits_are_the_files_bands_times_the_scale(name: str) -> None:
    """And none is left out: what the manufacturer allows is what the bench is judged by."""
    scenario = load_scenario(name)
    choice = scenario.aircraft
    assert choice is not None
    setting = load_aircraft(choice.name).setting(choice.axis, choice.condition)
    assert scenario.rig == setting.about.rig
    assert scenario.parameters == {}
    assert setting.bands
    checks = {check.name: check for check in scenario.checks}
    for limits in setting.limits(scenario.the_rig.parameters):
        check = checks[limits.name]
        assert check.metric == limits.metric
        assert check.arguments == pytest.approx(limits.arguments, rel=1e-5)
        for found, wanted in ((check.min, limits.least), (check.max, limits.greatest)):
            assert found == (None if wanted is None else pytest.approx(wanted, rel=1e-5))


SETTINGS = [
    pytest.param(setting, id=f"{name}-{setting.axis}-{setting.condition}")
    for name in SHIPPED
    for setting in load_aircraft(name).settings
]


def on_paper(setting: Setting, at_deg: float, unloading: bool) -> float:
    """Force at the grip of the feel model alone, led slowly past an angle; by the theory, without the bench [N]."""
    rig = load_rig(setting.about.rig).parameters
    feel, at = setting.on(rig).feel, math.radians(at_deg)
    beyond = at * 1.1 if unloading else at
    path = np.concatenate([np.linspace(0.0, beyond, 100), np.linspace(beyond, at, 20)])
    return float(static_curve(feel, path)[-1]) / rig.column.grip_height


@pytest.mark.parametrize("setting", SETTINGS)
def test_every_band_of_a_force_or_friction_holds_on_paper(setting: Setting) -> None:
    """Of the settings that no scenario runs too: the numbers fit their sources."""
    for limits in setting.limits(load_rig(setting.about.rig).parameters):
        if limits.metric not in ("grip_force", "grip_friction"):
            continue
        at = limits.arguments["at_deg"]
        loading, unloading = on_paper(setting, at, False), on_paper(setting, at, True)
        found = loading if limits.metric == "grip_force" else 0.5 * abs(loading - unloading)
        assert (limits.least or -math.inf) < found < (limits.greatest or math.inf), limits.name


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_largest_force_is_that_of_the_theory(setting: Setting) -> None:
    feel = setting.on(load_rig(setting.about.rig).parameters).feel
    if feel.jam.of == "aft" and not feel.linkage.override:
        return  # the pilot decides
    if feel.bodies == "two" and not feel.linkage.override:  # the aft body is to reach the end of its travel
        feel = feel.model_copy(update={"linkage": Linkage(stiffness=1e6)})
    ends = [np.linspace(0.0, limit, 401) for limit in (feel.aft_limit.angle, -feel.aft_limit.back)]
    greatest = max(float(np.max(np.abs(static_curve(feel, 0.999 * path)))) for path in ends)
    assert largest_torque(feel) == pytest.approx(greatest, rel=0.02)


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_outer_loop_is_calm_as_the_page_says(setting: Setting) -> None:
    """By the linear model: tight and as loose as in the scenarios all are, full-scale rigs at any squeeze."""
    p = setting.on(load_rig(setting.about.rig).parameters)
    growth = {hand: growth_rate(Setup(p, hand)) for hand in (Hand(1.0), Hand(0.25), Hand(0.6, False), Hand(0.7, False))}
    assert growth[Hand(1.0)] < -5.0  # 1/s
    assert growth[Hand(0.25)] < -5.0
    full_scale = setting.about.rig in ("elevator", "rudder", "aileron") and setting.condition != "kt315"
    assert (max(growth.values()) < -1e-6) == full_scale


def test_a_band_fails_a_feel_that_is_out_of_it(recorded: Runner) -> None:
    wrong = recorded("aircraft_a320_pitch", "feel.stiffness=125.0")
    recording = wrong.recording()
    assert recording.metadata["aircraft"] == "a320"
    assert recording.attachments["a320.aircraft.toml"] == shipped_aircraft()["a320"].read_bytes()
    assert wrong.status == "failed"
    assert not next(check for check in wrong.checks if check.check.name == "forward_8deg").passed


# --- units -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", shipped_rigs())
def test_the_force_at_a_travel_of_the_grip_is_the_aircrafts_on_any_rig(name: str) -> None:
    """0.2 N/mm is 10 N at 50 mm, whatever the rig's grip; mass and damper likewise."""
    rig = load_rig(name).parameters
    setting = parse_aircraft(STICK).setting()
    p, r = setting.on(rig), rig.column.grip_height
    assert spring_torque(p.feel, 0.05 / r) / r == pytest.approx(10.0)
    assert p.feel.inertia / r**2 == pytest.approx(4.0)
    assert p.feel.damping / r**2 == pytest.approx(20.0)
    assert p.feel.friction / r == pytest.approx(2.0)
    assert p.feel.aft_limit.angle * r == pytest.approx(0.080)
    assert p.feel.forward_limit.stiffness == rig.feel.forward_limit.stiffness
    assert p.feel.centering == Feel().centering
    (limits,) = setting.limits(rig)
    assert (limits.least, limits.greatest) == pytest.approx((10.0, 14.0))
    assert math.radians(limits.arguments["at_deg"]) * r == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("unit", "si", "at_02"),
    [("N", "N·m", 0.2), ("daN", "N·m", 2.0), ("lbf", "N·m", 0.889644), ("kgf", "N·m", 1.96133), ("N·m", "N·m", 1.0),
     ("N/deg", "N·m/rad", 11.459156), ("lbf/in", "N·m/rad", 7.005073), ("N/mm", "N·m/rad", 40.0),
     ("mm", "rad", 0.005), ("in", "rad", 0.127), ("deg", "rad", 0.01745329), ("kg", "kg·m²", 0.04),
     ("N·s/m", "N·m·s/rad", 0.04), ("mbar", "Pa", 100.0), ("kt", "m/s", 0.514444), ("rad/m", "1", 0.2)],
)  # fmt: skip
def test_units_at_a_grip_of_200_mm(unit: str, si: str, at_02: float) -> None:
    assert UNITS[unit].si == si
    assert UNITS[unit].converted(1.0, 0.2, Scale()) == pytest.approx(at_02, rel=1e-6)


def test_scales_keep_frequency_and_damping_ratio_and_scale_the_bands() -> None:
    rig = Parameters()
    whole, scaled = (parse_aircraft(text).setting() for text in (STICK, stick(force_scale=0.5, angle_scale=0.4)))
    a, b = whole.on(rig).feel, scaled.on(rig).feel
    assert b.stiffness / b.inertia == pytest.approx(a.stiffness / a.inertia)
    assert b.damping**2 / (b.stiffness * b.inertia) == pytest.approx(a.damping**2 / (a.stiffness * a.inertia))
    assert spring_torque(b, 0.4 * 0.1) == pytest.approx(0.5 * spring_torque(a, 0.1))
    assert b.aft_limit.angle == pytest.approx(0.4 * a.aft_limit.angle)
    (limits,), (full,) = scaled.limits(rig), whole.limits(rig)
    assert limits.greatest == pytest.approx(7.0)
    assert limits.arguments["at_deg"] == pytest.approx(0.4 * full.arguments["at_deg"])


def test_a_scaled_surface_gives_the_scaled_torque_at_the_scaled_angle() -> None:
    rig = Parameters()
    craft = load_aircraft("light_aircraft")
    whole = craft.setting("elevator", "kt65", force_scale=1.0, angle_scale=1.0).on(rig).feel
    scaled = craft.setting("elevator", "kt65", force_scale=0.5, angle_scale=0.4).on(rig).feel
    assert spring_torque(scaled, 0.4 * 0.3) == pytest.approx(0.5 * spring_torque(whole, 0.3))
    # 2.04 rad/m, H = q S c̄ |C_δ| δ: 960 N/m at the grip
    assert spring_torque(whole, 0.1 / 0.3) / 0.3 == pytest.approx(685.0 * 1.35 * 0.42 * 0.594 * 2.04**2 * 0.1)


def test_forces_and_angles_at_the_grip() -> None:
    assert at_grip(3.3, "N·m", 0.19, Scale()) == pytest.approx(3.3 / 0.19)
    assert at_grip(10.0, "daN", 0.3, Scale(0.5)) == pytest.approx(50.0)
    assert angle_deg(75.0, "mm", 0.4, Scale()) == pytest.approx(math.degrees(0.1875))
    for wrong in (lambda: at_grip(1.0, "mm", 0.3, Scale()), lambda: angle_deg(1.0, "N", 0.3, Scale())):
        with pytest.raises(ValueError, match="is no unit of"):
            wrong()


def test_the_hinge_moment_of_a_gearing_table_counts() -> None:
    table = {"control_angle": [-0.3, 0.0, 0.1, 0.3], "deflection": [-0.5, 0.0, 0.1, 0.6], "hinge_zero": 0.01}
    surface = Surface(area=1.2, chord=0.4, hinge_deflection=-0.5, **table)  # type: ignore[arg-type]
    feel = Feel(friction=0.0, static_friction=0.0, surface=surface, flight=Flight(dynamic_pressure=900.0))
    path = np.linspace(-0.2, 0.2, 9)
    theory = static_curve(feel, path).tolist()
    assert [spring_torque(feel, angle) for angle in path.tolist()] == pytest.approx(theory)


def test_the_largest_force_is_that_at_the_end_of_the_travel() -> None:
    setting = load_aircraft("c27j").setting("elevator", "low_speed")
    rig = load_rig("elevator").parameters
    assert largest_torque(setting.on(rig).feel) / rig.column.grip_height == pytest.approx(34.0 + 11.5 * 16.6)
    assert reach(setting, rig).verdict == "short"
    rudder = load_aircraft("c27j").setting("rudder")
    assert reach(rudder, load_rig("thesis").parameters).verdict == "too weak"
    weaker = load_aircraft("c27j").setting("rudder", force_scale=0.4)
    assert reach(weaker, load_rig("thesis").parameters).verdict == "short"
    jammed = load_aircraft("b737ng").setting("wheel", "jammed")
    assert reach(jammed, load_rig("aileron").parameters).largest == pytest.approx(0.5 * 42.8 / 0.19)


# --- faults of a file ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('unit = "kg", least = 1.0', 'unit = "pound", least = 1.0',
         'stick.feel.inertia.unit: "pound" is not valid; give kg·m², kg'),
        ('unit = "N/mm"', 'unit = "N"', 'stick.feel.stiffness.unit: "N" is not valid; give N·m/rad, N·m/deg, N/deg, '),
        ("value = 4.0", "value = 40.0",
         "stick.feel.inertia: 40 kg is not within its own bounds; give 1 to 9"),
        ('greatest = 3.0, source = "invented"', "greatest = 3.0",
         "stick.feel.friction.source: missing; give a text"),
        ('greatest = 3.0, source = "invented"', 'greatest = 3.0, source = "assumed: "', "does not say why"),
        ("least = 0.0, greatest = 3.0, ", "", "stick.feel.friction: missing: least, greatest; a number has"),
        ("friction =", "fricton =", "stick.feel.friction: missing; every axis gives inertia, damping"),
        ("[[stick", '[stick.feel.tirm]\nx = { value = 1.0, unit = "N", least = 0.0, greatest = 2.0, source = "yes" }'
         "\n[[stick", "stick.feel.tirm.x: unknown parameter of the feel model; "),
        ('title = "stick"', 'title = "stick"\nspeed = 3', "stick.speed: unknown key; "),
        ('of = "force"', 'of = "weight"', 'bands[0].of: "weight" is not valid; give one of "force"'),
        ('unit = "N"\nsource', 'unit = "kg"\nsource', 'bands[0]: unit "kg" is not valid for force; give N·m, N, daN'),
        ("at = 50.0\nat_unit", "at_unit", "bands[0]: give at and at_unit, or neither"),
        ("least = 10.0", "least = 20.0", "bands[0]: least 20 is above greatest 14"),
        ('rig = "thesis"', 'rig = "thesis"\nforce_scale = 0.5', "stick: missing: scale_reason"),
        ('rig = "thesis"', 'rig = "thesis"\nforce_scale = 2', "stick.force_scale: 2 is not valid; give a number > 0"),
        ("value = 85.0", "value = 75.0", "aft_limit.angle must not exceed forward_limit.angle"),
        ('title = "A stick"', "titel = 1", "titel: unknown key; did you mean title?"),
        ("value = 2.0, unit", "value = nan, unit", "stick.feel.friction"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line_that_says_where_and_what(old: str, new: str, said: str) -> None:
    assert old in STICK
    with pytest.raises(InputError) as caught:
        parse_aircraft(STICK.replace(old, new, 1), name="mine")
    line = str(caught.value)
    assert line.startswith("mine.toml: ")
    assert said in line
    assert "\n" not in line
    assert len(line) < 700


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="c27: no such aircraft or file; did you mean c27j"):
        load_aircraft("c27")
    with pytest.raises(InputError, match="not among the recording's attachments"):
        find_aircraft("mine.toml", tmp_path, {})
    with pytest.raises(InputError, match="has no axis"):
        parse_aircraft('title = "x"')


# --- in a scenario ---------------------------------------------------------------------------------------------------

RUN = 'title = "x"\nduration = 1.0\nrig = "elevator"\n[aircraft]\nname = "c27j"\naxis = "elevator"\n'


def test_the_feel_is_the_aircrafts_and_parameters_come_last() -> None:
    scenario = parse_scenario(RUN + 'condition = "low_speed"\n[parameters.feel]\nfriction = 1.0\n')
    feel = scenario.parameters_at_start().feel
    assert feel.stiffness == pytest.approx(16.6 * 180.0 / math.pi * 0.8)
    assert feel.friction == 1.0
    assert load_rig("elevator").parameters.feel.stiffness != feel.stiffness


def test_the_condition_may_be_set_and_swept() -> None:
    off = parse_scenario(RUN, set=["aircraft.condition=hydraulics_off"])
    assert off.parameters_at_start().feel.hydraulics.pressure == 0.0
    medium = off.changed({"aircraft.condition": "medium"})
    assert medium.parameters_at_start().feel.flight.dynamic_pressure == pytest.approx(6430.0)
    other = load_scenario("aircraft_b757_wheel").changed({"aircraft.name": "b737ng", "aircraft.condition": "free"})
    assert other.parameters_at_start().feel.stiffness == pytest.approx(0.05 * 180.0 / math.pi)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (RUN, "aircraft.condition: missing; give the condition: low_speed, medium, hydraulics_off"),
        (RUN + 'condition = "medum"\n', 'aircraft.condition: "medum" is no condition of it; did you mean medium?'),
        (RUN.replace('axis = "elevator"', ""), "aircraft.axis: missing; give the axis: elevator, rudder"),
        (RUN.replace("c27j", "c27"), "aircraft.name: c27: no such aircraft or file; did you mean c27j?"),
        (RUN + "speed = 3\n", "aircraft.speed: unknown key; valid: name, axis, condition, force_scale, angle_scale"),
        (RUN + 'condition = "medium"\nforce_scale = 2.0\n', "aircraft.force_scale: 2.0 is not valid; give a num"),
    ],
)
def test_a_scenarios_choice_that_is_not_there(text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        parse_scenario(text)
    assert said in str(caught.value)


def test_a_run_says_its_scales_and_what_the_rig_cannot_do() -> None:
    def notes(*overrides: str) -> str:
        return "\n".join(load_scenario("aircraft_c27j_rudder", set=overrides, rig="thesis").notes)

    assert "too weak, give aircraft.force_scale" in notes()
    assert "forces are 0.4 of the aircraft's" in notes("aircraft.force_scale=0.4")
    assert "numbers are assumed" in notes()
    assert "angles are 0.8" in "\n".join(load_scenario("aircraft_a320_roll").notes)


def test_a_run_with_a_file_of_ones_own_names_that_file(tmp_path: Path) -> None:
    (tmp_path / "c27j.toml").write_text(STICK)
    text = 'title = "t"\nduration = 0.1\n[aircraft]\nname = "c27j.toml"\n'
    scenario = parse_scenario(text, path=tmp_path / "s.toml")
    assert any("`cls-bench aircraft c27j.toml`" in note for note in scenario.notes)


def test_a_recording_carries_the_aircraft(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(STICK)
    text = 'title = "x"\nduration = 1.0\n[aircraft]\nname = "mine.toml"\n'
    (tmp_path / "run.toml").write_text(text)
    scenario = load_scenario(tmp_path / "run.toml")
    assert scenario.sample_files["mine.toml"] == STICK.encode()
    again = parse_scenario(scenario.source, sample_files=scenario.sample_files)
    assert again.parameters_at_start() == scenario.parameters_at_start()
    shipped = load_scenario("aircraft_b757_wheel")
    changed = {**shipped.sample_files}
    changed["b757.aircraft.toml"] = changed["b757.aircraft.toml"].replace(b"value = 0.122", b"value = 0.130")
    again = parse_scenario(shipped.source, sample_files=changed)  # what was run counts, not what is shipped now
    assert again.parameters_at_start().feel.stiffness == pytest.approx(0.130 * 180.0 / math.pi)
    alone = scenario.on(scenario.parameters_at_start())
    assert alone.aircraft is None
    assert alone.parameters_at_start() == scenario.parameters_at_start()


# --- command and page ------------------------------------------------------------------------------------------------


def run(*arguments: str) -> str:
    answer = CliRunner().invoke(main, ["aircraft", *arguments])
    assert answer.exit_code == 0, answer.output
    return answer.stdout


def test_the_command_lists_and_shows() -> None:
    listing = " ".join(run().split())
    for name in SHIPPED:
        for setting in load_aircraft(name).settings:
            assert " ".join(f"{name} {setting.axis} {setting.condition}".split()) in listing
    shown = " ".join(run("cyclic").split())
    assert "thesis shakes in 4 of 23 grips, most at squeeze 0.7, driven by a force" in shown
    assert "MIL-H-8501A" in shown and "centering.breakout 2.5 N 1 to 5 assumed" in shown
    found = json.loads(run("c27j", "--json", "--rig", "thesis"))["c27j"]["settings"][0]
    assert found["measured"] == pytest.approx(490.3 * 0.175 / 0.3, rel=1e-3)
    assert found["checks"][0]["metric"] == "grip_force"
    for setting in json.loads(run("--json")).values():
        assert all(number["source"] for each in setting["settings"] for number in each["numbers"].values())


def test_the_command_refuses_in_one_line() -> None:
    answer = CliRunner().invoke(main, ["aircraft", "c27"])
    assert answer.exit_code == 2
    assert "no such aircraft" in answer.output


def test_the_page_is_up_to_date() -> None:
    """If this fails: python -m cls_bench.aircraft.page docs/aircraft.md"""
    page = PAGE.read_text(encoding="utf-8")
    assert with_tables(page) == page


def test_the_page_does_what_it_shows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = PAGE.read_text(encoding="utf-8")
    commands = 0
    for language, file, block in re.findall(r"^```(\w*) ?(\S*)\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
        if language == "toml" and file:
            Path(file).write_text(block)
        for command, shown in re.findall(r"^\$ cls-bench (aircraft.*)\n((?:(?!\$ ).*\n)*)", block, re.MULTILINE):
            answer = CliRunner().invoke(main, shlex.split(command))
            assert answer.exit_code == 0, answer.output
            printed = [" ".join(line.split()) for line in answer.stdout.splitlines()]
            assert all(" ".join(line.split()) in printed for line in shown.splitlines())
            commands += 1
    assert commands == 3


def test_the_page_shows_every_band_of_the_scenarios_as_measured_within_its_limits() -> None:
    """If this fails: python -m benchmarks.aircraft docs/aircraft.md"""
    section = PAGE.read_text(encoding="utf-8").split("## Measured")[1].split("\n## ")[0]
    shown = dict(re.findall(r"^\| (`\w+` \| \w+) \| .* \| (\S+) \S+ \|$", section, re.MULTILINE))
    there = {}
    for name in SCENARIOS:
        scenario = load_scenario(name)
        choice = scenario.aircraft
        assert choice is not None
        setting = load_aircraft(choice.name).setting(choice.axis, choice.condition)
        for limits in setting.limits(scenario.the_rig.parameters):
            there[f"`{name}` | {limits.name}"] = limits
    assert shown.keys() == there.keys()
    for row, limits in there.items():
        assert (limits.least or -math.inf) <= float(shown[row]) <= (limits.greatest or math.inf), row
