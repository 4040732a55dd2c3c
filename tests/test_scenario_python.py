"""A scenario made in Python: the same keys, checks and lines as a file's, and the same experiment."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from cls_bench import experiment
from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, leaves
from cls_bench.recording import Recording
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import (
    Change,
    Check,
    Chirp,
    Controller,
    DriveStart,
    ExpectedTrip,
    Hold,
    Ramp,
    Record,
    Release,
    Samples,
    Scenario,
    Sine,
    Squeeze,
    Step,
    load_scenario,
    parse_scenario,
)
from cls_bench.scenario.writing import as_toml
from tests.running import collected, parameters

FILE = """
title = "One of everything"
description = "All keys there are."
duration = 0.6
seed = 7
rig = "one_stage"
parameters.feel.inertia = 0.25
parameters.feel.aft_limit.angle = 0.2
parameters.gearbox.stage1.backlash = 2e-3
parameters.plc.outer_loop = "velocity"
drive.power = "on"
hand = [
  {at = 0.0, kind = "hold", angle_deg = 1.0},
  {at = 0.1, kind = "ramp", to_deg = 3.0, over = 0.1, smooth = true},
  {at = 0.2, kind = "step", to_N = 4.0},
  {at = 0.3, kind = "sine", amplitude_N = 4.0, offset_N = 1.0, frequency = 9.0, phase_deg = 90.0, cycles = 1.0},
  {at = 0.4, kind = "chirp", amplitude_deg = 5.0, from_hz = 5.0, to_hz = 20.0, over = 0.1, fade = 0.02},
  {at = 0.55, kind = "release"},
]
squeeze = [{at = 0.1, value = 0.5, over = 0.1}, {at = 0.3, value = 1}]
changes = [
  {at = 0.2, mode = "position", parameters.feel.friction = 0.5},
  {at = 0.3, parameters.feel = {inertia = 0.3, aft_limit.stiffness = 10.0}},
  {at = 0.5, power = "off"},
]
checks = [{name = "peak", metric = "maximum", signal = "/column.angle", window = [0, 0.6], min = -1.0, max = 20}]
expected_trips = [{reason = "any", window = [0.0, 0.6]}]
record = {signals = ["/column.*", "/drive.current"], poses = false}
"""

TYPED = Scenario(
    title="One of everything",
    description="All keys there are.",
    duration=0.6,
    seed=7,
    rig="one_stage",
    parameters={
        "feel.inertia": 0.25, "feel.aft_limit.angle": 0.2, "gearbox.stage1.backlash": 2e-3,
        "plc.outer_loop": "velocity",
    },
    drive=DriveStart(power="on"),
    hand=[
        Hold(at=0.0, angle_deg=1.0),
        Ramp(at=0.1, to_deg=3.0, over=0.1, smooth=True),
        Step(at=0.2, to_N=4.0),
        Sine(at=0.3, amplitude_N=4.0, offset_N=1.0, frequency=9.0, phase_deg=90.0, cycles=1.0),
        Chirp(at=0.4, amplitude_deg=5.0, from_hz=5.0, to_hz=20.0, over=0.1, fade=0.02),
        Release(at=0.55),
    ],
    squeeze=[Squeeze(at=0.1, value=0.5, over=0.1), Squeeze(at=0.3, value=1)],
    changes=[
        Change(at=0.2, mode="position", parameters={"feel.friction": 0.5}),
        Change(at=0.3, parameters={"feel": {"inertia": 0.3, "aft_limit.stiffness": 10.0}}),
        Change(at=0.5, power="off"),
    ],
    checks=[Check(name="peak", metric="maximum", signal="/column.angle", window=(0, 0.6), min=-1.0, max=20)],
    expected_trips=[ExpectedTrip(reason="any", window=(0.0, 0.6))],
    record=Record(signals=["/column.*", "/drive.current"], poses=False),
)  # fmt: skip


def samples(scenario):
    bench = Bench(scenario.parameters_at_start(), seed=scenario.seed)
    return collected(bench, scripted.run(bench, scenario))


def listed(table):
    """The same with lists for tuples, as a file has them."""
    if isinstance(table, dict):
        return {key: listed(value) for key, value in table.items()}
    return [listed(value) for value in table] if isinstance(table, list | tuple) else table


def test_it_is_the_files_scenario():
    file = parse_scenario(FILE)
    assert listed(TYPED.table) == listed(file.table) == tomllib.loads(FILE)
    assert TYPED.parameters_at_start() == file.parameters_at_start()
    for time in (0.0, 0.25, 0.45):
        assert TYPED.parameters_at(time) == file.parameters_at(time)
    assert TYPED.the_rig.name == "one_stage"
    assert TYPED.recorded_topics == file.recorded_topics
    assert (TYPED.clock, TYPED.ticks, TYPED.notes) == (file.clock, file.ticks, file.notes)


def test_it_is_the_same_experiment():
    one, other = samples(TYPED), samples(parse_scenario(FILE))
    assert one.same_samples(other)
    assert one.events == other.events
    assert np.ptp(one["/column.angle"]) > 0.01


def test_its_text_is_a_file_of_the_same():
    again = parse_scenario(TYPED.source)
    assert listed(again.table) == listed(TYPED.table)
    assert again.source == TYPED.source


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_survives_python(name):
    """From the file to typed objects, to text and back."""
    file = load_scenario(name)
    typed = Scenario.model_validate({key: getattr(file, key) for key in file.model_fields_set})
    assert listed(typed.table) == listed(file.table)
    again = parse_scenario(typed.source)
    assert listed(again.table) == listed(file.table)
    assert again.parameters_at(file.duration) == file.parameters_at(file.duration)


def test_a_recording_of_it_says_how_to_run_it_again(tmp_path: Path):
    scenario = TYPED.changed({"record.signals": ["*"]})
    first = experiment.run(scenario, out=tmp_path / "a", rerun=False)
    recording = first.recording()
    again = experiment.run(parse_scenario(recording.attachments["scenario.toml"]), out=tmp_path / "b", rerun=False)
    other = Recording(again.mcap)
    for path in recording.topics:
        one, two = recording.read(path), other.read(path)
        assert len(one) == len(two) > 0
        for signal in recording.topics[path].names:
            np.testing.assert_array_equal(one[signal], two[signal])


def test_parameters_that_were_made_in_python_are_taken_as_they_are():
    """Whole parameters, also such as no key could set: nothing of the rig's is left, and the text says all of them."""
    made = parameters({"feel.inertia": 0.4, "column.mass": 0.8, "gearbox.stages": 1}).with_nameplate()
    scenario = Scenario(title="t", duration=0.1, hand=[Step(at=0.0, to_deg=5.0)]).on(made)
    assert scenario.parameters_at_start() == made
    again = parse_scenario(scenario.source)
    before = dict((key, value) for key, value, _ in leaves(again.parameters_at_start()))
    for key, value, _ in leaves(made):
        if not key.startswith(("gearbox.stage2.", "gearbox.stage3.")):
            assert before[key] == value, key
    assert samples(scenario).same_samples(samples(again))


def test_without_keys_it_is_the_thesiss_rig():
    scenario = Scenario(title="t", duration=1.0)
    assert scenario.parameters_at_start() == Parameters()
    assert scenario.table == {"title": "t", "duration": 1.0}
    assert scenario.source == as_toml({"title": "t", "duration": 1.0})


def test_numpys_floats_are_floats():
    scenario = Scenario(title="t", duration=np.float64(1.0), parameters={"feel.inertia": np.float64(0.4)})
    assert scenario.parameters_at_start().feel.inertia == 0.4
    assert parse_scenario(scenario.source).parameters_at_start() == scenario.parameters_at_start()


def test_two_scenarios_share_nothing(tmp_path: Path):
    """What one is changed to, the other is not; also of lists that both were made with."""
    hand = [Hold(at=0.0, angle_deg=1.0)]
    one, other = (Scenario(title="t", duration=1.0, hand=hand) for _ in range(2))
    changed = one.changed({"hand[0].angle_deg": 3.0, "feel.inertia": 0.5})
    assert [s.hand[0].angle_deg for s in (one, other, changed)] == [1.0, 1.0, 3.0]
    assert one.parameters_at_start() == other.parameters_at_start() == Parameters()
    assert changed.parameters_at_start().feel.inertia == 0.5


# --- mistakes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("keys", "says"), [
    ({"duration": -1.0}, "scenario: duration: -1.0 is not valid; give a number > 0"),
    ({"duration": "1"}, 'scenario: duration: "1" is not valid'),
    ({"titel": "t"}, 'scenario: titel: unknown key; did you mean title'),
    ({"parameters": {"feel.inertai": 1.0}}, "parameters.feel.inertai: unknown parameter; did you mean feel.inertia"),
    ({"parameters": {"feel.inertia": -1.0}}, "scenario: parameters.feel.inertia: -1.0 is not valid"),
    ({"parameters": {"feel.inertia": object()}}, "a object cannot be written to TOML"),
    ({"changes": [Change(at=2.0, power="off")]}, "changes[0].at: 2 s is not inside the run of 1 s"),
    ({"changes": [Change(at=0.5, parameters={"motor.resistance": 5.0})]}, "motor.resistance: holds for the whole run"),
    ({"hand": [Hold(at=0.5), Hold(at=0.2)]}, "hand[1].at: 0.2 s does not come after hand[0].at = 0.5 s"),
    ({"hand": [Samples(at=0.0, file="none.csv", unit="deg")]}, 'hand[0].file: "none.csv" cannot be read'),
    ({"hand": [{"at": 0.0, "kind": "stepp", "to_deg": 1.0}]}, "hand[0].kind"),
    ({"checks": [Check(name="x", metric="maximum", signal="/gearbox.stage3_twist", window=(0, 1))]},
     "gearbox.stages = 2"),
    ({"rig": "one_stag"}, "scenario: rig: "),
])  # fmt: skip
def test_a_mistake_is_one_line(keys, says):
    with pytest.raises(InputError) as refused:
        Scenario(**{"title": "t", "duration": 1.0, **keys})
    message = str(refused.value)
    assert says in message, message
    assert "\n" not in message


def test_a_mistake_in_a_part_is_told_where_it_is_made():
    with pytest.raises(ValueError, match="changes nothing; give power, mode or parameters"):
        Change(at=0.5)
    with pytest.raises(ValueError, match="give either to_deg or to_N"):
        Step(at=0.0)


def test_it_may_name_a_controller():
    scenario = Scenario(title="t", duration=1.0, controller=Controller(source="loops.py:Own", arguments={"gain": 2.0}))
    place = scenario.controller_place
    assert place is not None
    assert (place.place, place.arguments) == ("loops.py:Own", {"gain": 2.0})
