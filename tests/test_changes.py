"""Parameters that change while a run goes on: jumps, ramps, recorded samples; what is written, said and judged."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cls_bench.analysis.window import Window
from cls_bench.axis import AXIS, WORDS, set_parameters
from cls_bench.bench import Bench
from cls_bench.compiled import JIT  # noqa: F401  (asked for by its name in another process)
from cls_bench.course import Course, lines, ramp, steps
from cls_bench.errors import InputError
from cls_bench.experiment import measure
from cls_bench.parameters import Parameters
from cls_bench.parameters.moving import HOST_CYCLE, STEPPED, numbers, replaced, value_of
from cls_bench.parameters.override import override
from cls_bench.pilot import ramp as of_the_hand
from cls_bench.plant import model as plant_model
from cls_bench.scenario import Scenario, parse_scenario
from tests.running import hold, parameters, run

PLC_S = 4e-4
HELD = '[[hand]]\nat = 0.0\nkind = "hold"\nangle_deg = 5.0\n'


def written(toml: str, key: str, *, duration: float = 0.2, folder: Path | None = None) -> tuple[np.ndarray, list[str]]:
    """What stands in the axis's record for ``key`` after each PLC cycle of a run, and what the log said."""
    from cls_bench.drivers import scripted

    text = f'title = "t"\nduration = {duration}\n{toml}'
    scenario = parse_scenario(text, path=folder / "s.toml" if folder else None)
    bench = Bench(scenario.parameters_at_start())
    bench.block_ticks = bench.clock.plc_ticks
    found, said = [], []
    for block in scripted.run(bench, scenario):
        found.append(float(bench._words[0, WORDS[key]]))
        assert bench.parameters == scenario.parameters_at(bench.time - PLC_S)
        said += [(event.time, event.message) for event in block.events]
    return np.array(found), said


# --- courses ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("smooth", [False, True])
def test_a_ramp_is_that_of_the_hand(smooth):
    t = np.linspace(0.0, 1.5, 1001)
    found = [Course(ramp(200, 1000, 3.0, -2.0, smooth=smooth)).at(200 + 1000 * x) for x in t]
    np.testing.assert_allclose(found, of_the_hand(3.0, -2.0, 1.0, smooth=smooth)(t)[0], rtol=0, atol=1e-14)
    assert found[-1] == -2.0


def test_lines_are_interpolation_and_rest_takes_one_piece():
    ticks, values = np.array([0, 10, 20, 30, 40, 50.0]), np.array([1.0, 1, 1, 5, 5, 5])
    course = Course(lines(ticks, values))
    assert [course.at(t) for t in range(60)] == pytest.approx(np.interp(np.arange(60), ticks, values), abs=1e-15)
    assert len(course.pieces) == 3
    assert (course.low, course.high, course.end) == (1.0, 5.0, 40.0)


def test_whether_a_course_moves_within_a_time():
    course = Course(np.concatenate([ramp(100, 50, 1.0, 2.0), steps([300, 400], [4.0, 4.0], start=2.0)]))
    assert course.at(99) is None
    assert course.moves(0, 110) and course.moves(120, 130) and course.moves(250, 300)
    assert not any(course.moves(*span) for span in ((0, 100), (150, 299), (300, 500)))


# --- what stands in the record ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("smooth", "at"), [("false", 0.05), ("true", 0.05), ("true", 0.0501)])
def test_a_ramp_at_every_plc_cycle(smooth, at):
    change = f"[[changes]]\nat = {at}\nover = 0.1\nsmooth = {smooth}\nparameters = {{feel.stiffness = 50.0}}"
    values, said = written(change, "feel.stiffness")
    begin = np.ceil(at / PLC_S - 1e-9) * PLC_S  # of the PLC cycle
    x = np.clip((np.arange(len(values)) * PLC_S - begin) / 0.1, 0.0, 1.0)
    share = x**3 * (10 - 15 * x + 6 * x**2) if smooth == "true" else x
    np.testing.assert_allclose(values, 35.0 + 15.0 * share, rtol=0, atol=1e-11)
    assert values[-1] == 50.0
    how = ", smoothly" if smooth == "true" else ""
    assert said == [(pytest.approx(begin), f"feel.stiffness from 35 to 50 N·m/rad over 0.1 s{how}")]


def test_a_later_change_takes_over_from_the_value_on_its_way():
    text = """
    [[changes]]
    at = 0.02
    over = 0.1
    parameters = {feel.damping = 3.5, feel.neutral = 0.1}
    [[changes]]
    at = 0.06
    over = 0.04
    parameters.feel.damping = 0.5
    [[changes]]
    at = 0.08
    parameters.feel.damping = 9.0
    [[changes]]
    at = 0.1
    parameters.plc.remove_unbalance = false
    """
    values, said = written(text, "feel.damping")
    t = np.arange(len(values)) * PLC_S
    expected = np.interp(t, [0.02, 0.06, 0.1], [1.5, 2.3, 0.5])
    expected[t > 0.08 - 1e-9] = 9.0
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-12)
    neutral, _ = written(text, "feel.neutral")
    np.testing.assert_allclose(neutral, np.interp(t, [0.02, 0.12], [0.0, 0.1]), rtol=0, atol=1e-12)
    assert [message for _, message in said] == [
        "feel.damping from 1.5 to 3.5 N·m·s/rad over 0.1 s", "feel.neutral from 0 to 0.1 rad over 0.1 s",
        "feel.damping from 2.3 to 0.5 N·m·s/rad over 0.04 s", "feel.damping = 9.0 N·m·s/rad",
        "plc.remove_unbalance = False",
    ]  # fmt: skip


def test_recorded_samples(tmp_path):
    (tmp_path / "c.csv").write_text("time [ms];c [N·m/rad]\n10;40,5\n30;45,5\n50;45,5\n70;41,0\n")
    text = '[[changes]]\nat = 0.04\nparameter = "feel.stiffness"\nfile = "c.csv"\ncolumn = "c"'
    values, said = written(text, "feel.stiffness", folder=tmp_path)
    t = np.arange(len(values)) * PLC_S
    expected = np.interp(t - 0.04, [0.01, 0.03, 0.05, 0.07], [40.5, 45.5, 45.5, 41.0])
    expected[t < 0.04 - 1e-9] = 35.0
    np.testing.assert_allclose(values, expected, rtol=0, atol=1e-11)
    assert said == [(0.04, "feel.stiffness follows c.csv, within 40.5 to 45.5 N·m/rad, for 0.07 s")]
    scenario = parse_scenario(f'title = "t"\nduration = 0.2\n{text}', path=tmp_path / "s.toml")
    assert "4 samples" in scenario.notes[0]
    again = parse_scenario(scenario.source, sample_files=scenario.sample_files)
    assert again.parameters_at(0.06) == scenario.parameters_at(0.06)
    other = scenario.on(scenario.parameters_at_start())
    assert other.parameters_at(0.06) == scenario.parameters_at(0.06)
    assert other.notes == scenario.notes


@pytest.mark.parametrize("key", ["drive.velocity_bandwidth", "limb.mass", "limb.tight_stiffness", "feel.gust.torque"])
def test_what_is_designed_from_moves_in_steps_of_the_host_cycle(key):
    start = value_of(Parameters(), key)
    target = 0.5 * start or 2.0
    text = f"[[changes]]\nat = 0.02\nover = 0.06\nparameters.{key} = {target}"
    scenario = parse_scenario(f'title = "t"\nduration = 0.12\n{HELD}{text}')
    found = run(f"{HELD}{text}", duration=0.12)
    assert found.error is None
    for cycle in range(0, 300, 3):
        stairs = 0.02 + HOST_CYCLE * np.floor((cycle * PLC_S - 0.02) / HOST_CYCLE + 1e-9)
        expected = start + (target - start) * np.clip((stairs - 0.02) / 0.06, 0.0, 1.0)
        assert value_of(scenario.parameters_at(cycle * PLC_S), key) == pytest.approx(expected, rel=1e-12)
    assert value_of(found.bench.parameters, key) == target
    assert [event.message.split(" over ")[1] for event in found.events] == ["0.06 s"]


def test_stepped_are_just_those_from_which_more_follows():
    """Each live number is changed alone: which others of the record, or of the plant, go with it?"""
    base = override(Parameters(), {"feel.flight.airspeed": 50.0, "load_cell.creep": 0.01})
    bench = Bench(base)
    words = np.zeros(1, AXIS)
    record = words.view(np.recarray)[0]

    def numbers_of(p):
        set_parameters(record, p)
        plant_model.set_weights(bench.model, "", p)
        weights = np.concatenate([bench.model.body_mass, bench.model.body_inertia.ravel()])
        return np.concatenate([words.view(np.float64).ravel(), weights])

    before, more = numbers_of(base).copy(), set()
    for key in numbers():
        value = value_of(base, key)
        after = numbers_of(replaced(base, {key: 0.75 * value if value else 0.01}))
        changed = np.flatnonzero(before.view(np.int64) != after.view(np.int64)).tolist()
        assert changed, key
        if changed != [WORDS.get(key)]:
            assert key in STEPPED
            more.add(key)
    asked = {key for key in STEPPED if key.startswith("limb.")}
    drawn = {"feel.gust.torque", "plc.frame_loss", "load_cell.spike_rate"}
    assert more - asked | asked | drawn == STEPPED
    assert more >= STEPPED - asked - drawn
    assert not STEPPED & WORDS.keys()


# --- samples ----------------------------------------------------------------------------------------------------------

MOVING = """
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 9.0
frequency = 8.0
[[changes]]
at = 0.01
over = 0.04
smooth = true
parameters = {feel.stiffness = 90.0, feel.neutral = 0.05, drive.torque_limit = 2.0}
[[changes]]
at = 0.03
over = 0.02
parameters = {feel.damping = 0.5, drive.position_bandwidth = 20.0}
[[changes]]
at = 0.045
parameters = {feel.friction = 1.0}
mode = "velocity"
"""


def test_the_same_run_twice_and_in_other_blocks():
    one, two = run(MOVING, duration=0.08), run(MOVING, duration=0.08)
    assert one.same_samples(two)
    assert [e.message for e in one.events] == [e.message for e in two.events]
    for ticks in (8, 56, 720):
        other = run(MOVING, duration=0.08, block_ticks=ticks)
        assert one.same_samples(other)
        assert [(e.tick, e.message) for e in one.events] == [(e.tick, e.message) for e in other.events]
    still = run(MOVING.replace("90.0", "35.0"), duration=0.08)
    assert not one.same_samples(still)


def digest() -> str:
    found = run(MOVING, duration=0.05)
    assert found.error is None
    rows = np.concatenate([found[name] for name in sorted(found.signals)])
    return hashlib.sha256(rows.tobytes()).hexdigest()


def test_plain_python_gives_the_same_samples():
    code = "import json; from tests import test_changes as t; print(json.dumps([bool(t.JIT), t.digest()]))"
    environment = {
        **os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)
    }  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == [False, digest()]


def test_jumps_are_those_that_a_program_makes_one_by_one():
    """As before courses: the block ends, and :meth:`Bench.change` sets all parameters anew."""
    from cls_bench.drivers import timed
    from tests.running import collected, swaying

    jumps = [(0.01 + 0.0012 * k, 35.0 + k) for k in range(60)]
    made = [
        timed.Change(at, lambda bench, value=value: bench.change(override(bench.parameters, {"feel.stiffness": value})))
        for at, value in jumps
    ]

    def hands(first, ticks):
        return swaying(first, ticks, 0.1, 8.0)

    bench = Bench(Parameters(), seed=3)
    expected = collected(bench, timed.run(bench, hands, made, 0.12))
    bench = Bench(Parameters(), seed=3)
    ticks = [bench.clock.plc_cycle(at) for at, _ in jumps]
    bench.follow({"feel.stiffness": Course(steps(ticks, [value for _, value in jumps]))})
    assert collected(bench, timed.run(bench, hands, [], 0.12)).same_samples(expected)
    assert bench.parameters.feel.stiffness == 94.0


# --- what the log says ------------------------------------------------------------------------------------------------


def test_hundreds_of_jumps_are_one_line():
    text = "".join(
        f"[[changes]]\nat = {0.01 + 0.002 * k:.3f}\nparameters.feel.stiffness = {35 + 0.1 * k:.1f}\n" for k in range(40)
    )
    assert [e.message for e in run(text, duration=0.1).events] == [
        "feel.stiffness in 39 steps, from 35.1 to 38.9 N·m/rad"
    ]
    few = "".join(f"[[changes]]\nat = {at}\nparameters.feel.stiffness = 36.0\n" for at in (0.01, 0.02))
    assert [(e.time, e.message) for e in run(few, duration=0.03).events] == [(0.01, "feel.stiffness = 36.0 N·m/rad")]


# --- no bump ----------------------------------------------------------------------------------------------------------

BUMP = """
[[hand]]
at = 0.0
kind = "hold"
force_N = 0.0
[[hand]]
at = 0.2
kind = "ramp"
to_N = 20.0
over = 0.5
smooth = true
[[changes]]
at = 2.0
"""


def test_a_change_over_a_time_does_not_bump():
    """A pilot who pushes with 20 N, and neutral that goes by 0.1 rad (3.5 N·m of the feel spring)."""

    def jolt(text):
        found = run(f"{BUMP}{text}", duration=4.5)
        assert found.error is None
        before, after = found.between("/column.angle", 1.9, 2.0), found.between("/column.angle", 4.4, 4.5)
        force = found.between("/load_cell.force", 1.95, 4.5)
        quiet = np.ptp(found.between("/load_cell.force", 1.8, 2.0))
        return np.ptp(force) - quiet, np.mean(after) - np.mean(before)

    jump, moved = jolt("parameters = {feel.neutral = 0.1}")
    over, moved_over = jolt("over = 2.0\nsmooth = true\nparameters = {feel.neutral = 0.1}")
    rate, moved_rate = jolt("parameters = {feel.neutral = 0.1, feel.trim.rate = 0.05}")
    assert moved > 0.07  # into the softer limit
    assert moved == pytest.approx(moved_over, abs=0.002) == moved_rate
    assert jump > 15.0  # N in the rod
    assert over < 0.2 * jump
    assert rate < 0.4 * jump


# --- parameters, in a run and in windows ------------------------------------------------------------------------------


def test_a_change_by_hand_takes_a_parameter_over_and_lets_others_go_on():
    bench = Bench(Parameters())
    bench.start()
    bench.follow({
        key: Course(ramp(0, 4000, start, end))
        for key, start, end in (("feel.stiffness", 35.0, 55.0), ("feel.damping", 1.5, 3.5))
    })  # fmt: skip
    bench.advance(hold(2000))
    half = 1992 / 4000  # of the last PLC cycle
    assert bench.parameters.feel.stiffness == pytest.approx(35.0 + 20.0 * half)
    assert bench.parameters.feel.damping == pytest.approx(1.5 + 2.0 * half)
    bench.change(override(bench.parameters, {"feel.stiffness": 20.0}))
    assert bench.parameters.feel.stiffness == 20.0
    bench.advance(hold(2400))
    assert (bench.parameters.feel.stiffness, bench.parameters.feel.damping) == (20.0, 3.5)
    assert not bench._following
    bench.reset()
    assert bench.parameters == Parameters()


def test_a_host_leads_parameters_and_nothing_out_of_bounds_gets_in():
    bench = Bench(parameters({"feel.flight.dynamic_pressure": 1000.0}))
    key, quick = "feel.flight.dynamic_pressure", {"feel.flight.dynamic_pressure": 5000.0}
    bench.start()

    def after(value, rates=None, blocks=1):
        bench.lead({key: value}, 0.01, rates=rates)
        for _ in range(blocks):
            bench.advance(hold(200))
        return bench.parameters.feel.flight.dynamic_pressure

    assert after(2000.0) == pytest.approx(2000.0 - 1000.0 * 8 / 200)  # there with the next PLC cycle
    assert after(2000.0) > 1995.0
    held = bench.parameters.feel.flight.dynamic_pressure
    assert after(float("nan")) == held
    assert bench.refused["", key] == 25
    assert after(-1e9) == 0.0
    assert bench.refused["", key] > 40
    assert after(1e6, quick) == pytest.approx(24 * 5000.0 * PLC_S)
    assert after(1e6, quick, 4) == pytest.approx(123 * 5000.0 * PLC_S)


def test_what_cannot_follow_a_course():
    bench = Bench(Parameters())
    for key, what in (
        ("feel.stiffnes", "is no parameter"), ("column.inertia", "holds for the whole run"),
        ("plc.remove_unbalance", "is no number"), ("limb.mass", "change it instead"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=rf"^parameters\.{key}: .*{what}"):
            bench.follow({key: Course(steps([0], [1.0]))})
        with pytest.raises(InputError, match=what):
            bench.lead({key: 1.0}, 0.01)
    for value in (-1.0, float("nan"), 1e9):
        with pytest.raises(InputError, match=r"^parameters\.feel\.stiffness: .* is not valid; it must be ≥ 0, ≤ 1"):
            bench.follow({"feel.stiffness": Course(steps([0], [value]))})
    with pytest.raises(InputError, match="rate"):
        bench.follow({"feel.stiffness": Course(steps([0], [1.0]))}, rates={"feel.stiffness": 0.0})
    with pytest.raises(InputError, match="axis"):
        bench.follow({"feel.stiffness": Course(steps([0], [1.0]))}, axis="yaw")


def test_one_axis_of_two_follows():
    both = Bench({"pitch": Parameters(), "roll": Parameters()})
    both.start()
    both.follow({"feel.stiffness": Course(ramp(0, 200, 35.0, 70.0))}, axis="roll")
    both.advance([hold(400)] * 2)
    assert both.parameters_of["pitch"].feel.stiffness == 35.0
    assert both.parameters_of["roll"].feel.stiffness == 70.0


def test_metrics_know_the_parameters_of_their_window():
    text = """
    title = "t"
    duration = 2.0
    [[changes]]
    at = 1.0
    over = 0.5
    parameters = {feel.neutral = 0.1, plc.frame_loss = 0.0}
    [[checks]]
    name = "on the way"
    metric = "rest_offset_deg"
    window = [1.1, 1.4]
    max = 100.0
    [[checks]]
    name = "then"
    metric = "rest_offset_deg"
    window = [1.5, 2.0]
    max = 100.0
    """
    scenario = parse_scenario(text)
    assert scenario.moving(0.0, 1.0) == () == scenario.moving(1.5, 2.0)
    assert scenario.moving(1.1, 1.4) == ("feel.neutral",) == scenario.moving(0.0, 1.1)
    assert scenario.parameters_at(1.25).feel.neutral == pytest.approx(0.05, abs=1e-12)

    class Still:
        clock = scenario.clock

        @property
        def topics(self):
            return {topic.path: topic for topic in scenario.topics}

        def samples_at(self, signal, ticks):
            from cls_bench.signals import Column

            return Column(np.array(ticks), np.full(len(ticks), 0.07))

    window = Window(Still(), 1.1, 1.4, scenario.parameters_at(1.1), moving=scenario.moving(1.1, 1.4))
    assert window.parameters.feel.neutral == pytest.approx(0.02, abs=1e-12)
    moving, still = measure(scenario, Still())
    assert np.isnan(moving.value) and not moving.passed
    assert moving.note == "neutral is not one angle: feel.neutral changes within the window"
    assert still.value == pytest.approx(np.degrees(0.03))


# --- what is wrong ----------------------------------------------------------------------------------------------------

WRONG = [
    ("over = 0.1\nparameters = {plc.remove_unbalance = false}", ".parameters.plc.remove_unbalance", "only numbers"),
    ('over = 0.1\nparameters = {load_cell.wire = "whole"}', ".parameters.load_cell.wire", "only numbers move"),
    ('over = 0.1\nparameters = {feel.stiffness = 1.0}\nmode = "off"', "", "power and mode change at once"),
    ('over = 0.1\nmode = "off"', "", "give parameters"),
    ("over = 0.0\nparameters = {feel.stiffness = 1.0}", ".over", "> 0"),
    ("over = -1.0\nparameters = {feel.stiffness = 1.0}", ".over", "> 0"),
    ("smooth = true\nparameters = {feel.stiffness = 1.0}", "", "give over"),
    ("over = 0.1\nparameters = {feel.stiffness = -1.0}", ".parameters.feel.stiffness", "≥ 0"),
    ("over = 0.1\nparameters = {feel.inertia = 1e-3, feel.damping = 1e4}", ".parameters.feel", ""),
    ("over = 0.1\nparameters = {feel.aft_limit.angle = 0.4}", ".parameters.feel", "must not exceed"),
    ("parameters = {feel.detents.place = [0.0, true]}", ".parameters.feel.detents.place", "true is not valid"),
    ("parameters = {feel.detents.place = [[0, 1]]}", ".parameters.feel.detents.place", "[0, 1] is not valid"),
    ("over = 0.1\nparameters = {limb.tight_stiffness = 1e9}", ".parameters.limb.tight_stiffness", ""),
    ("over = 0.1\nparameters = {column.inertia = 1.0}", ".parameters.column.inertia", "whole run"),
    ('parameter = "feel.stiffness"', "", "belong together"),
    ('file = "c.csv"', "", "belong together"),
    ('parameter = "feel.stiffness"\nfile = "c.csv"\nover = 1.0', "", "no over"),
    ('parameters = {feel.stiffness = 1.0}\ncolumn = "c"', "", "column says how a file is read"),
    ('parameter = "feel.stiffnes"\nfile = "c.csv"', ".parameter", "did you mean feel.stiffness"),
    ('parameter = "plc.remove_unbalance"\nfile = "c.csv"', ".parameter", "is no number"),
    ('parameter = "column.inertia"\nfile = "c.csv"', ".parameter", "whole run"),
    ('parameter = "feel.stiffness"\nfile = "none.csv"', ".file", "cannot be read"),
    ('parameter = "feel.stiffness"\nfile = "c.csv"\ncolumn = "d"', ".file", 'has no column \\"d\\"'),
    ('parameter = "feel.stiffness"\nfile = "c.csv"\ncolumn = "low"', ".file", "line 3: -1 N·m/rad is not valid"),
    ('parameter = "feel.neutral"\nfile = "c.csv"\ncolumn = "angle"', ".file", "give scale = 0.0174532925199"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "key", "what"), WRONG)
def test_what_is_wrong_is_said_in_one_line(tmp_path, text, key, what):
    (tmp_path / "c.csv").write_text("time,value,low,angle [deg]\n0.0,1.0,1.0,1\n0.1,2.0,-1.0,2\n0.2,3.0,1.0,3\n")
    toml = f'title = "t"\nduration = 1.0\n[[changes]]\nat = 0.5\n{text}'
    with pytest.raises(InputError) as caught:
        parse_scenario(toml, path=tmp_path / "s.toml")
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 's.toml'}: changes[0]{key}")
    assert what.replace('\\"', '"') in message
    assert "\n" not in message and len(message) < 600


def test_a_rule_that_only_holds_at_both_ends_of_a_way():
    """The stops pass each other: aft below forward at the start and at the end, and not between."""
    text = """
    title = "t"
    duration = 1.0
    [[changes]]
    at = 0.1
    over = 0.2
    parameters.feel.aft_limit.angle = 0.5
    [[changes]]
    at = 0.2
    over = 0.01
    parameters.feel.forward_limit.angle = 0.6
    """
    with pytest.raises(InputError, match=r"changes\[0\]\.parameters.*must not exceed"):
        parse_scenario(text)
    parse_scenario(text.replace("over = 0.2", "over = 0.9"))


def test_scenarios_in_python_and_on_other_rigs():
    change = {"at": 0.1, "over": 0.2, "smooth": True, "parameters": {"feel.stiffness": 50.0}}
    made = Scenario.model_validate({"title": "t", "duration": 1.0, "changes": [change]})
    assert parse_scenario(made.source).parameters_at(0.2) == made.parameters_at(0.2)
    assert made.changed({"feel.stiffness": 20.0}).parameters_at(0.2).feel.stiffness == pytest.approx(35.0)
    assert made.changed({"changes[0].over": 0.4}).parameters_at(0.3).feel.stiffness == pytest.approx(42.5)
