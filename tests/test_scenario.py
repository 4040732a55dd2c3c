"""The scenario file: what is read, and one clear line for whatever is wrong."""

import copy
import json
import math
import tomllib

import jsonschema
import pytest

from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, leaves
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import load_scenario, parse_scenario, scenario_schema

EVERYTHING = """
title = "One of everything"
description = "All keys there are."
duration = 4.0
seed = 7

[parameters]
feel.inertia = 0.25
feel.aft_limit.angle = 0.2
plc.outer_loop = "velocity"
drive.feed_forward_velocity = true
encoder.counts = 2048

[drive]
power = "off"

[[hand]]
at = 0.0
kind = "hold"
angle_deg = 1.0
[[hand]]
at = 0.2
kind = "hold"
[[hand]]
at = 0.5
kind = "ramp"
to_deg = 3.0
over = 0.2
smooth = true
[[hand]]
at = 1.0
kind = "step"
to_N = 4.0
[[hand]]
at = 1.5
kind = "sine"
amplitude_N = 4.0
offset_N = 1.0
frequency = 2.0
phase_deg = 90.0
cycles = 1.0
fade = 0.1
[[hand]]
at = 2.0
kind = "chirp"
amplitude_deg = 1.0
offset_deg = 0.5
from_hz = 1.0
to_hz = 10.0
over = 0.3
sweep = "log"
fade = 0.05
[[hand]]
at = 2.5
kind = "samples"
file = "hand.csv"
unit = "deg"
column = "angle"
[[hand]]
at = 3.0
kind = "release"

[[squeeze]]
at = 0.5
value = 1
over = 0.1

[[changes]]
at = 0.5
power = "on"
[[changes]]
at = 1.0
mode = "position"
parameters.feel.friction = 1.5
[[changes]]
at = 2.0
parameters.feel = {inertia = 0.3, aft_limit.stiffness = 10.0}

[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.torque"
window = [0, 4.0]
min = -1.0
max = 20
arguments = {at = 1.0}
"""

MINIMAL = 'title = "t"\nduration = 1.0\n'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "hand.csv").write_text("time,angle\n0.0,1.0\n0.1,2.0\n")
    (tmp_path / "everything.toml").write_text(EVERYTHING)
    return tmp_path


def test_one_of_everything(folder):
    s = load_scenario(folder / "everything.toml")
    assert (s.name, s.title, s.duration, s.seed, s.ticks) == ("everything", "One of everything", 4.0, 7, 80_000)
    assert s.source == EVERYTHING.encode()
    assert [h.kind for h in s.hand] == ["hold", "hold", "ramp", "step", "sine", "chirp", "samples", "release"]
    p = s.parameters_at_start()
    assert (p.feel.inertia, p.feel.aft_limit.angle, p.plc.outer_loop) == (0.25, 0.2, "velocity")
    assert (p.drive.feed_forward_velocity, p.encoder.counts) == (True, 2048)
    assert p.feel.aft_limit.stiffness == Parameters().feel.aft_limit.stiffness
    check = s.checks[0]
    assert (check.signal, check.window, check.min, check.max) == ("/column.torque", (0.0, 4.0), -1.0, 20.0)


def test_parameters_at_a_time(folder):
    s = load_scenario(folder / "everything.toml")
    feels = [s.parameters_at(time).feel for time in (0, 1, 1.99, 2)]
    seen = [(feel.friction, feel.inertia, feel.aft_limit.stiffness) for feel in feels]
    assert seen == [(0.25, 0.25, 150.0), (1.5, 0.25, 150.0), (1.5, 0.25, 150.0), (1.5, 0.3, 10.0)]
    assert s.parameters_at(0.0) == s.parameters_at_start()


def test_defaults():
    s = parse_scenario(MINIMAL, name="tiny")
    assert (s.name, s.seed, s.hand, s.drive.power) == ("tiny", 0, [], "on")
    assert s.parameters_at_start() == Parameters()


def test_overrides(folder):
    s = load_scenario(
        folder / "everything.toml", seed=3,
        set=["feel.inertia=0.15", 'plc.outer_loop="position"', "parameters.feel.friction = 1", "duration=5.0",
             "drive.feed_forward_velocity=false"],
    )  # fmt: skip
    p = s.parameters_at_start()
    assert (s.seed, s.duration, p.feel.inertia, p.feel.friction, p.plc.outer_loop) == (3, 5.0, 0.15, 1.0, "position")
    assert p.drive.feed_forward_velocity is False
    assert s.source == EVERYTHING.encode()
    assert parse_scenario(MINIMAL, set=["plc.outer_loop=velocity"]).parameters_at_start().plc.outer_loop == "velocity"


def test_overrides_reach_entries(folder):
    s = load_scenario(folder / "everything.toml", set=["squeeze[0].value=0.5", "changes[1].parameters.feel.friction=2"])
    assert s.squeeze[0].value == 0.5
    assert s.parameters_at(1.0).feel.friction == 2.0


def test_checks_can_be_exchanged(folder):
    s = load_scenario(folder / "everything.toml")
    other = parse_scenario('title = "t"\nduration = 9.0\nchecks = [{name = "a", metric = "m", window = [1, 5]}]').checks
    with pytest.raises(InputError, match=r"^checks\[0\]\.window: \[1, 5\] s is not valid"):
        s.with_checks(other)
    assert s.with_checks([]).checks == []
    assert s.with_checks([]).parameters_at_start() == s.parameters_at_start()
    assert len(s.checks) == 1


BAD_KEYS = [
    # (TOML added to or put for the minimal file, key in the message, value or problem, what is valid)
    ("durations = 2.0", "durations", "unknown key", "duration"),
    ("[parameters]\nfeel.inertai = 0.3", "parameters.feel.inertai", "unknown parameter", "feel.inertia"),
    ("[parameters]\nfell.inertia = 0.3", "parameters.fell.inertia", "unknown parameter", "feel.inertia"),
    ("[parameters]\nfeel = 3", "parameters.feel", "3", "section"),
    ("[parameters]\nfeel.inertia = -0.3", "parameters.feel.inertia", "-0.3", "≥ 0.001 and ≤ 100"),
    ("[parameters]\nfeel.inertia = 0", "parameters.feel.inertia", "0", "≥ 0.001"),
    ('[parameters]\nfeel.inertia = "0.3"', "parameters.feel.inertia", '"0.3"', "a number"),
    ("[parameters]\nfeel.inertia = true", "parameters.feel.inertia", "true", "a number"),
    ("[parameters]\nencoder.counts = 10.5", "parameters.encoder.counts", "10.5", "whole number"),
    ("[parameters]\nplc.remove_unbalance = 1", "parameters.plc.remove_unbalance", "1", "true or false"),
    ('[parameters]\nplc.outer_loop = "torque"', "parameters.plc.outer_loop", '"torque"', '"position", "velocity"'),
    ("seed = -1", "seed", "-1", "≥ 0"),
    ("seed = 1.5", "seed", "1.5", "whole number"),
    ('[drive]\npower = "idle"', "drive.power", '"idle"', '"on", "off"'),
    ("[drive]\npwr = 1", "drive.pwr", "unknown key", "power"),
    ('hand = [{at = 0.0, kind = "hold", angel_deg = 1.0}]', "hand[0].angel_deg", "unknown key", "angle_deg"),
    ('hand = [{at = 0.0, kind = "rmap"}]', "hand[0].kind", '"rmap"', "ramp"),
    ("hand = [{at = 0.0}]", "hand[0].kind", "missing", "ramp"),
    ("hand = [3]", "hand[0]", "3", "a table"),
    ("hand = 3", "hand", "3", "an array"),
    ('hand = [{kind = "release"}]', "hand[0].at", "missing", "a number ≥ 0"),
    ('hand = [{at = "0", kind = "release"}]', "hand[0].at", '"0"', "a number"),
    ('hand = [{at = -1.0, kind = "release"}]', "hand[0].at", "-1", "≥ 0"),
    ('hand = [{at = 0.0, kind = "step", to_deg = 190.0}]', "hand[0].to_deg", "190", "≤ 170"),
    ('hand = [{at = 0.0, kind = "ramp", to_deg = 9.0, over = 0.0}]', "hand[0].over", "0", "> 0"),
    ('hand = [{at = 0.0, kind = "sine", amplitude_deg = 1.0}]', "hand[0].frequency", "missing", "Hz"),
    ("squeeze = [{at = 0.0, value = 1.5}]", "squeeze[0].value", "1.5", "≤ 1"),
    ('changes = [{at = 0.5, mode = "fast"}]', "changes[0].mode", '"fast"', '"position"'),
    (
        "changes = [{at = 0.5, parameters.column.inertia = 0.1}]",
        "changes[0].parameters.column.inertia", "whole run", "may change",
    ),
    (
        "changes = [{at = 0.5, parameters.feel.inertia = -1.0}]",
        "changes[0].parameters.feel.inertia", "-1", "≥ 0.001",
    ),
    ('checks = [{name = "a", metric = "m", window = [0.5]}]', "checks[0].window[1]", "missing", "array of 2 numbers"),
    ('checks = [{name = "a", metric = "m", window = 1.0}]', "checks[0].window", "1.0", "an array of 2 numbers"),
    ('checks = [{name = "a", metric = "m", window = ["0", 1]}]', "checks[0].window[0]", '"0"', "an array of 2 numbers"),
    ('checks = [{name = "", metric = "m", window = [0, 1]}]', "checks[0].name", '""', "not empty"),
    (
        'checks = [{name = "a", metric = "m", window = [0, 1], signal = "/column.torqe"}]',
        "checks[0].signal", '"/column.torqe"', "/column.torque",
    ),
    (
        'checks = [{name = "a", metric = "m", window = [0, 1], arguments = {x = "1"}}]',
        "checks[0].arguments.x", '"1"', "",
    ),
]  # fmt: skip
"""Each wrong on its own."""

BAD_TOGETHER = [
    ("[parameters]\nfeel.inertia = nan", "parameters.feel.inertia", "NaN", "a number"),
    ("[parameters]\nfeel.aft_limit.angle = 0.4", "parameters.feel", "aft_limit.angle", "forward_limit.angle"),
    ('hand = [{at = 1.0, kind = "release"}]', "hand[0].at", "1 s", "inside the run of 1 s"),
    ('hand = [{at = 0.5, kind = "release"}, {at = 0.2, kind = "release"}]', "hand[1].at", "0.2 s", "hand[0].at = 0.5"),
    ('hand = [{at = 0.0, kind = "step"}]', "hand[0]", "give either", "to_deg or to_N"),
    ('hand = [{at = 0.0, kind = "step", to_deg = 1.0, to_N = 1.0}]', "hand[0]", "give either", "to_deg or to_N"),
    (
        'hand = [{at = 0.0, kind = "sine", amplitude_deg = 1.0, offset_N = 1.0, frequency = 1.0}]',
        "hand[0]", "offset_deg", "amplitude_deg",
    ),
    ("changes = [{at = 0.5}]", "changes[0]", "changes nothing", "power, mode or parameters"),
    ('changes = [{at = 0.5, power = "on", mode = "off"}]', "changes[0]", "contradicts", "off"),
    ('checks = [{name = "a", metric = "m", window = [0.5, 1.5]}]', "checks[0].window", "[0.5, 1.5]", "duration = 1 s"),
    ('checks = [{name = "a", metric = "m", window = [0.5, 0.5]}]', "checks[0].window", "[0.5, 0.5]", "start < end"),
    (
        'checks = [{name = "a", metric = "m", window = [0, 1]}, {name = "a", metric = "m", window = [0, 1]}]',
        "checks[1].name", '"a"', "unique",
    ),
    (
        'checks = [{name = "a", metric = "m", window = [0, 1], min = 2.0, max = 1.0}]',
        "checks[0].min", "2", "max = 1",
    ),
]  # fmt: skip
"""Wrong only together with others, or beyond JSON: no matter for the schema."""


@pytest.mark.parametrize(("text", "key", "problem", "valid"), BAD_KEYS + BAD_TOGETHER)
def test_what_is_wrong_is_said_in_one_line(text, key, problem, valid):
    with pytest.raises(InputError) as caught:
        parse_scenario(MINIMAL + text, name="file.toml")
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"file.toml: {key}: ")
    assert problem in message
    assert valid in message
    assert len(message) < 600


@pytest.mark.parametrize(
    ("text", "key", "problem"),
    [
        ('title = "t"', "duration", "missing"),
        ("duration = 1.0", "title", "missing"),
        ('title = ""\nduration = 1.0', "title", "not empty"),
        ('title = "t"\nduration = 0.0', "duration", "> 0"),
        ('title = "t"\nduration = -3', "duration", "> 0"),
        ('title = "t"\nduration = 1e-6', "duration", "less than one tick"),
        ('title = "t"\nduration = inf', "duration", "a number"),
        ('title = "t"\nduration = 1e9', "duration", "≤ 3600"),
        ('title = "t"\nduration = "1"', "duration", "a number"),
    ],
)
def test_title_and_duration(text, key, problem):
    with pytest.raises(InputError, match=f"^scenario: {key}: .*{problem}"):
        parse_scenario(text)


@pytest.mark.parametrize(
    ("source", "place"),
    [
        (b'title = "t"\nduration = \n', "line 2"),
        (b'title = "t\nduration = 1.0\n', "line 1"),
        (b'title = "t"\n[parameters\n', "line 2"),
        (b'title = "t"\ntitle = "u"\n', "line 2"),
        (b'title = "t', "line 1"),
        (b'duration = 1.0\ntitle = "\xff"\n', "line 2: not UTF-8"),
    ],
)
def test_broken_toml(tmp_path, source, place):
    file = tmp_path / "broken.toml"
    file.write_bytes(source)
    with pytest.raises(InputError) as caught:
        load_scenario(file)
    message = str(caught.value)
    assert message.startswith(f"{file}: {place}")
    assert "\n" not in message


def test_missing_files(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.toml: no such file"):
        load_scenario("nowhere.toml")
    with pytest.raises(InputError, match="no such scenario or file; did you mean friction_masking"):
        load_scenario("friction_maskin")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        load_scenario(tmp_path)
    unreadable = tmp_path / "sub" / "x.toml"
    with pytest.raises(InputError, match="no such file"):
        load_scenario(unreadable)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("feel.inertia", "not of the form KEY=VALUE"),
        ("=3", "not of the form KEY=VALUE"),
        ("feel.inertia=", "not of the form KEY=VALUE"),
        ("feel.inertia=0.3 kg", "not a TOML value"),
        ("feel.inertia=1\nseed=2", "not a TOML value"),
        ("feel.inertia=-1", "--set: parameters.feel.inertia: -1 is not valid"),
        ("feel.inertai=1", "--set: parameters.feel.inertai: unknown parameter; did you mean feel.inertia"),
        ("feel=1", "--set: parameters.feel: 1 is not valid"),
        ("feel.inertia.x=1", "scenario with --set: parameters.feel.inertia: "),
        ("feel.aft_limit.angle=0.5", "scenario with --set: parameters.feel: aft_limit.angle"),
        ("duration=0", "--set: duration: 0 is not valid"),
        ("seed=x", "--set: seed: "),
        ("squeeze[0].value=1", "--set squeeze[0]: the scenario has 0 entries of squeeze"),
        ("title[0].x=1", "--set title[0]: title has no entries; valid: hand"),
        ("title=x", "--set: parameters.title: unknown parameter"),
    ],
)
def test_bad_overrides(override, message):
    with pytest.raises(InputError) as caught:
        parse_scenario(MINIMAL, set=[override])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


# --- schema ----------------------------------------------------------------------------------------------------------


def test_schema_is_valid_json_schema(folder):
    schema = json.loads(json.dumps(scenario_schema()))
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    validator.validate(tomllib.loads(EVERYTHING))
    validator.validate(tomllib.loads(MINIMAL))


@pytest.mark.parametrize("text", [text for text, *_ in BAD_KEYS])
def test_schema_refuses_what_the_reader_refuses(text):
    validator = jsonschema.Draft202012Validator(json.loads(json.dumps(scenario_schema())))
    assert not validator.is_valid(tomllib.loads(MINIMAL + text))


def test_schema_lists_every_parameter_with_its_unit():
    schema = scenario_schema()
    for live_only, top in ((False, schema), (True, schema["$defs"]["Change"])):
        for key, value, info in leaves(Parameters()):
            place = top["properties"]["parameters"]
            parts = key.split(".")
            found = all((place := place["properties"].get(part)) is not None for part in parts if place)
            if live_only and not info["live"]:
                assert not found
                continue
            assert found, key
            assert place["default"] == value
            assert place["unit"] == info["unit"]


def test_schema_is_not_shared():
    first = copy.deepcopy(scenario_schema())
    scenario_schema()["properties"].clear()
    assert scenario_schema() == first


# --- shipped ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(shipped_scenarios()))
def test_shipped_scenarios_validate(name):
    scenario = load_scenario(name)
    jsonschema.validate(tomllib.loads(scenario.source.decode()), json.loads(json.dumps(scenario_schema())))
    assert scenario.name == name
    assert math.isfinite(scenario.duration)
    assert scenario.checks


def test_all_experiments_of_the_thesis_are_shipped():
    assert set(shipped_scenarios()) >= {
        "friction_masking", "fcs_validation_1", "fcs_validation_2", "fcs_validation_3", "motion_tracking",
        "stability_moderate", "stability_severe", "gearbox_imperfections",
    }  # fmt: skip
