"""What limits and safety functions did is seen: events, shares of time, trips, invalid numbers, MuJoCo's warnings."""

import math
from pathlib import Path
from typing import Any, get_args

import mujoco
import numpy as np
import pytest
from click.testing import CliRunner

from cls_bench import bench as bench_module
from cls_bench import experiment
from cls_bench.axis import AXIS, NUMBERS
from cls_bench.bench import Bench, DivergedError
from cls_bench.cli import main
from cls_bench.control import limits, plc, validity
from cls_bench.control.outer_loop import Command
from cls_bench.drivers import scripted
from cls_bench.parameters import CONTROL, Parameters, leaves
from cls_bench.plant import mechanism
from cls_bench.plant.state import BODY
from cls_bench.recording import Recording
from cls_bench.scenario import ExpectedTrip, parse_scenario
from cls_bench.signals import CLOCK, TOPIC
from tests.running import Run, run

STEP = 'hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}, {at = 0.02, kind = "step", to_deg = 12.0}]'
PUSHED = 'hand = [{at = 0.0, kind = "step", to_N = 900.0}]'
HELD = 'hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}]'
LIMITS = TOPIC["/limits"].names


class Jumps:
    """A loop that asks for an absurd angle after a while."""

    def __init__(self, angle: float, at: float = 0.05):
        self.angle, self.at = angle, at

    def step(self, inputs: Any) -> Command:
        return Command(self.angle if inputs.time >= self.at else inputs.angle)


def reached(r: Run) -> set[str]:
    return {name for name in LIMITS if r[f"/limits.{name}"].any()}


def warnings_of(r: Run, source: str) -> list[str]:
    return [event.message for event in r.events if event.level == "warning" and event.source == source]


# --- limits ----------------------------------------------------------------------------------------------------------


def test_a_quiet_run_reaches_none():
    r = run(HELD)
    assert reached(r) == set()
    assert r.events == []


def test_a_saturated_load_cell_says_how_far_and_how_long():
    r = run(STEP, set=["load_cell.capacity=20.0"], duration=0.5)
    full = 2.0**23
    at_end = (r["/load_cell.counts"] >= full - 1) | (r["/load_cell.counts"] <= -full)
    assert at_end.any()
    # Each row is the share of the eight ticks up to its own.
    shares = np.convolve(at_end, np.ones(8))[: len(at_end)][::8] / 8.0
    np.testing.assert_array_equal(r["/limits.load_cell"], shares)
    (message, *_) = warnings_of(r, "load cell")
    assert message.startswith("saturated: ")
    assert message.endswith(" N on a range of 20 N")
    first = next(event for event in r.events if event.source == "load cell")
    assert first.tick == 8 * np.flatnonzero(shares)[0]
    over = [event for event in r.events if event.source == "load cell" and event.level == "info"]
    seconds = sum(float(event.message.split("for ")[1].split(" s")[0]) for event in over)
    assert seconds == pytest.approx(at_end[: 8 * (len(shares) - 1) + 1].sum() * 5e-5, rel=1e-3)
    peak = max(float(event.message.split("at most ")[1].split()[0]) for event in over)
    assert peak == pytest.approx(np.abs(r["/load_cell.force"])[at_end].max(), rel=1e-3)


@pytest.mark.parametrize(("faults", "shown"), [
    ({"load_cell.spike_rate": 100.0, "load_cell.spike": 5000.0}, 5000.0),
    # From a slow amplifier, over many PLC cycles and from block to block.
    ({"load_cell.spike_rate": 3.0, "load_cell.spike": 50000.0, "load_cell.filter_bandwidth": 50.0}, 50000.0),
    ({"load_cell.wire": "signal_broken"}, 490.3),
    ({"load_cell.wire": "supply_broken"}, None),
])  # fmt: skip
def test_a_faulty_load_cell_tells_what_it_shows(faults, shown):
    """Not what is in the rod, and not what its filter has left of a spike in the ticks after it."""
    settings = [f"{key}={value}" for key, value in faults.items()] + ["load_cell.noise=0.0"]
    r = run('[drive]\npower = "off"', set=settings, duration=1.0)
    told = [event.message for event in r.events if event.source == "load cell"]
    assert np.abs(r["/load_cell.force"]).max() < 100.0
    assert bool(told) == (shown is not None) == bool(r["/limits.load_cell"].any())
    for message in told:
        value = message.partition("saturated: ")[2].partition(" N on a range of 490.3 N")[0]
        assert float(value or message.split("at most ")[1].split()[0]) == pytest.approx(shown, rel=0.02)


@pytest.mark.parametrize(("limit", "override", "signal", "value", "scale"), [
    ("speed", "drive.speed_limit=20.0", "/drive.set_velocity", 20.0, 1.0),
    ("torque", "drive.torque_limit=0.2", "/drive.torque_command", 0.2, 1.0),
    ("current", "drive.peak_current=0.5", "/drive.current", 0.5, 1.0),
    ("voltage", "drive.dc_bus_voltage=15.0", "/drive.voltage", 15.0 * math.sqrt(1.5) * 0.883, 1.0),
])  # fmt: skip
def test_a_limit_of_the_drive_is_seen(limit, override, signal, value, scale):
    r = run(STEP, set=[override, "plc.following_error_limit=3.0"], duration=0.3)
    shares = r[f"/limits.{limit}"]
    assert 0.0 < shares.mean() < 1.0
    assert (shares <= 1.0).all()
    assert any(message.startswith(f"{limit} limit: ") for message in warnings_of(r, "drive"))
    held = np.abs(r[signal]) >= 0.98 * value
    assert held.mean() == pytest.approx(shares.mean(), abs=0.1)


def test_the_continuous_current_is_a_limit_once_i2t_is_full():
    r = run(STEP, set=["drive.continuous_current=0.01"], duration=0.3)
    assert any("current limit" in message for message in warnings_of(r, "drive"))
    assert r["/limits.current"].any()


def test_a_column_beyond_its_travel_is_seen():
    r = run(PUSHED, duration=0.3)
    beyond = np.abs(r["/column.angle"]) > 20.0 * math.pi / 180.0 * (1.0 + limits.ROUNDING)
    shares = np.convolve(beyond, np.ones(8))[: len(beyond)][::8] / 8.0
    np.testing.assert_array_equal(r["/limits.travel"], shares)
    assert warnings_of(r, "column")[0].startswith("beyond its travel: ")


def test_a_set_angle_beyond_the_software_limit_is_seen():
    r = run(controller=Jumps(0.6), set=["plc.following_error_limit=1.0"], duration=0.2)
    assert r["/limits.set_angle"].any()
    assert warnings_of(r, "plc") == ["set angle held at the software limit: 34.38° asked for, 22.5° allowed"]


@pytest.mark.parametrize(("loss", "rates", "frames"), [
    (0.0, [], 1000), (1e-9, [], 1000), (0.3, [], 1000), (1.0, [], 1000), (0.3, ["rates.bus_cycle=200e-6"], 2000),
])  # fmt: skip
def test_lost_frames_are_counted_and_said(loss, rates, frames):
    """Two frames a bus cycle; a lost one is half of it."""
    r = run(set=[f"plc.frame_loss={loss}", *rates], duration=0.2)
    lost = float(r["/limits.bus"].mean()) * frames
    assert lost == pytest.approx(loss * frames, abs=5.0 * math.sqrt(loss * (1.0 - loss) * frames) + 1e-9)
    quanta = r["/limits.bus"] * frames / len(r["/limits.bus"])
    np.testing.assert_array_equal(quanta, np.round(quanta))
    said = [(event.level, event.message) for event in r.events if event.source == "field bus"]
    first = CLOCK.plc_s * np.flatnonzero(quanta)[0] if lost else 0.0
    over = [("info", f"{round(lost)} frames lost since t = {first:.4f} s")]
    assert said == ([("warning", "a frame was lost"), *over] if lost else [])


def test_a_limit_reached_again_soon_is_one_event():
    """Chatter would fill the log; how the run is cut into blocks does not matter."""
    text, options = STEP, {"set": ["drive.torque_limit=0.2", "plc.following_error_limit=3.0"], "duration": 0.5}
    whole = run(text, **options)
    shares = whole["/limits.torque"]
    assert (np.diff((shares > 0).astype(int)) == 1).sum() > 3
    assert len(warnings_of(whole, "drive")) <= 3
    cut = run(text, **options, block_ticks=400)
    assert cut.same_samples(whole)
    assert [(e.tick, e.level) for e in cut.events] == [(e.tick, e.level) for e in whole.events]
    assert cut.events[-1] == whole.events[-1]


def test_the_peak_current_is_no_limit_of_its_own_beside_the_torque_limit():
    """6.00 N·m ÷ K_t is 20.3804 A, the peak current of the same data sheet 20.38 A."""
    assert reached(run(PUSHED, duration=0.3)) == {"load_cell", "torque", "travel"}


def test_the_amount_of_a_limit_reached_at_a_blocks_last_tick_is_told():
    r = run(STEP, set=["drive.torque_limit=0.2", "plc.following_error_limit=3.0"], duration=0.3, block_ticks=8)
    told = [message for message in warnings_of(r, "drive") if message.startswith("torque limit")]
    assert told and not any(message.startswith("torque limit: 0 N·m") for message in told)


# --- trips -----------------------------------------------------------------------------------------------------------


def test_reasons_of_the_scenario_are_those_of_the_plc():
    assert (*plc.TRIPS[1:], "any") == get_args(ExpectedTrip.model_fields["reason"].annotation)


def scenario_of(text: str, duration: float = 0.3) -> Any:
    return parse_scenario(f'title = "t"\nduration = {duration}\n{text}')


@pytest.mark.parametrize(("text", "status", "message"), [
    (PUSHED, "tripped", "safe torque off: limit switch open"),
    (PUSHED + '\nexpected_trips = [{reason = "limit_switch", window = [0.0, 0.3]}]', "passed", ""),
    (PUSHED + '\nexpected_trips = [{reason = "any", window = [0.0, 0.3]}]', "passed", ""),
    (PUSHED + '\nexpected_trips = [{reason = "following_error", window = [0.0, 0.3]}]', "tripped", "limit switch open"),
    (PUSHED + '\nexpected_trips = [{reason = "limit_switch", window = [0.2, 0.3]}]', "tripped", "limit switch open"),
    (HELD, "passed", ""),
    (HELD + '\nexpected_trips = [{reason = "limit_switch", window = [0.0, 0.3]}]', "failed",
     "expected trip did not come: limit_switch from 0 to 0.3 s"),
])  # fmt: skip
def test_a_trip_that_is_not_expected_is_a_status(tmp_path, text, status, message):
    result = experiment.run(scenario_of(text), out=tmp_path, rerun=False)
    assert result.status == status
    assert message in result.message
    assert result.exit_code == {"passed": 0, "failed": 1, "tripped": 4}[status]
    trips = [e for e in result.events if e.source == "safety"]
    assert len(trips) == (1 if "900" in text else 0)
    assert Recording(result.mcap).status == ("complete" if status == "passed" else status)


def test_the_command_line_says_it_and_its_exit_code_is_4(tmp_path):
    path = tmp_path / "trip.toml"
    path.write_text(f'title = "t"\nduration = 0.2\n{PUSHED}')
    shown = CliRunner().invoke(main, ["run", str(path), "--out", str(tmp_path), "--no-rerun"])
    assert shown.exit_code == 4
    assert "TRIPPED at t = 0.0" in shown.stdout
    assert "warning: load cell at t = " in shown.stdout
    assert "error: safety at t = " in shown.stdout
    assert "3 warnings, 1 errors" in " ".join(shown.stdout.split())
    import json

    answer = json.loads(CliRunner().invoke(
        main, ["run", str(path), "--out", str(tmp_path), "--no-rerun", "--json"]
    ).stdout)  # fmt: skip
    assert answer["status"] == "tripped"
    assert [e["level"] for e in answer["events"]].count("error") == 1
    assert answer["events"][0]["source"] == "load cell"


def test_a_users_loop_that_commands_absurd_values_does_not_pass(tmp_path):
    for angle in (1e300, -1e300, 1e9):
        result = experiment.run(scenario_of(HELD), out=tmp_path, rerun=False, controller=Jumps(angle))
        assert result.status == "tripped"


# --- invalid numbers -------------------------------------------------------------------------------------------------


def blocks(bench: Bench, text: str = HELD) -> Any:
    return scripted.run(bench, scenario_of(text, 1.0))


PARAMETERS, STATES = NUMBERS[0].names, NUMBERS[1].names


def spoil(bench: Bench, name: str, value: float, *, axis: int = 0) -> None:
    """Put ``value`` into all places of a controller's number: a parameter, a sample, or what it remembers."""
    record = bench.axes[axis].record
    places = name.split(".")
    if name in record.samples.dtype.names:
        inner = record.samples
    else:
        inner = record.controller.parameters if name in PARAMETERS else record.controller.state
    for place in places[:-1] if places[0] not in plc.SLOTS else ():
        inner = inner[place]
    if places[0] in plc.SLOTS:
        inner[places[0]][:, plc.SLOTS[places[0]].index(places[-1])] = value
    elif places[-1].isdigit():  # of a table
        inner[int(places[-1]) - 1] = value
    else:
        inner[places[-1]] = value


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("name", PARAMETERS)
def test_an_invalid_parameter_trips_within_a_cycle_and_is_named(name, value):
    bench = Bench(Parameters())
    bench.block_ticks = 80
    run = blocks(bench)
    start = next(run).end_tick
    spoil(bench, name, value)
    block = next(run)
    assert [(t.tick, t.reason) for t in bench.trips] == [(start, "invalid_value")]
    assert block.events[-1].message == f"safe torque off: {name} is not a finite number"
    assert not block["/drive.voltage"][1:].any()
    for later in (block, next(run)):
        assert all(np.isfinite(rows).all() for rows in later.signals.values())


def test_every_parameter_is_watched():
    """Each number among the controller's parameters, by the name a user knows; none of the plant's."""
    bench = Bench(Parameters())
    watched = bench._watched
    words = watched.words[0]
    for k, name in enumerate(PARAMETERS):
        kept = words[watched.parameters[k]]
        spoil(bench, name, math.nan)
        assert validity.first_invalid(words, watched.parameters) == k, name
        words[watched.parameters[k]] = kept
    assert validity.first_invalid(words, watched.parameters) == -1
    own = {key: value for key, value, _ in leaves(Parameters()) if key.partition(".")[0] in CONTROL}
    tables = {key: info["most"] for key, value, info in leaves(Parameters()) if isinstance(value, tuple)}
    assert set(PARAMETERS) == {key for key, value in own.items() if isinstance(value, float)} | {
        f"{key}.values.{k + 1}" for key, most in tables.items() for k in range(most)
    }


def test_all_that_the_controller_remembers_is_watched():
    """Every word of its state and samples that is a number, and no word besides: the record is full of ones there."""
    memory = np.ones(1, AXIS).view(np.recarray)
    words = memory.view(np.float64, np.ndarray)
    words[:] = np.nan
    for part in (memory[0].controller.state, memory[0].samples):
        floats = [(part, name) for name in part.dtype.names]
        while floats:
            inner, name = floats.pop()
            kind = inner.dtype[name]
            if kind.names:
                floats += [(inner[name], below) for below in kind.names]
            elif kind.base == np.float64:
                inner[name] = 1.0
    assert validity.first_invalid(words, NUMBERS[1].words) == -1
    assert np.isfinite(words).sum() == len(NUMBERS[1].words)


@pytest.mark.parametrize("name", sorted(set(STATES)))
def test_an_invalid_number_in_the_controllers_memory_trips(name):
    bench = Bench(Parameters())
    run = blocks(bench)
    start = next(run).end_tick
    spoil(bench, name, math.nan)
    block = next(run)
    assert [(t.tick, t.reason) for t in bench.trips] == [(start, "invalid_value")]
    assert block.events[-1].message == f"safe torque off: {name} is not a finite number"
    assert all(np.isfinite(rows).all() for rows in block.signals.values())


def test_a_frame_on_the_bus_is_named_by_its_field():
    """A user is told which of its values was none, not that something on the bus was."""
    assert {"commands.torque", "commands.position", "feedback.velocity", "voltages.voltage"} <= set(STATES)
    assert not {"commands", "feedback", "voltages"} & set(STATES)
    bench = Bench(Parameters())
    run = blocks(bench)
    next(run)
    bench.axes[0].record.controller.state.commands[3, plc.COMMAND_ACCELERATION] = math.nan
    assert next(run).events[-1].message == "safe torque off: commands.acceleration is not a finite number"


def test_what_becomes_invalid_within_a_cycle_trips_in_it():
    """Sound numbers whose law gives an infinite one: the drive must not be asked for it."""
    r = run(controller=Jumps(0.0), set=["plc.following_error_limit=0.5"], duration=0.2)
    assert r.events == []

    class Overflows:
        def step(self, inputs: Any) -> Command:
            return Command(0.0, 0.0, 0.0, 1e308) if inputs.time > 0.05 else Command(0.0)

    r = run(controller=Overflows(), duration=0.2, set=["linkage.crank=0.11"])
    assert all(np.isfinite(rows).all() for rows in r.signals.values())
    assert [event.level for event in r.events if event.source != "safety"]


# --- MuJoCo ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("what", ["qpos", "qvel", "grip_rest"])
def test_any_warning_of_mujoco_makes_the_run_diverged(what):
    """MuJoCo warns once of a kind and goes on with other numbers; the run must not."""
    bench = Bench(Parameters())
    run = blocks(bench)
    next(run)
    if what in ("qpos", "qvel"):
        getattr(bench.data, what)[:] = 1e30
    else:  # what MuJoCo meets through a force
        bench.axes[0].record.truth.body.grip_rest = math.nan
    with pytest.raises(DivergedError) as raised:
        next(run), next(run)
    assert "MuJoCo warned" in raised.value.cause or "velocity of joint" in raised.value.cause


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("name", mechanism.REMEMBERED)
def test_what_the_plant_alone_has_lost_is_not_passed_over(name, value):
    """The drive would trip on the sample, clear it, and leave no trace; but the plant lost its number: diverged."""
    bench = Bench(Parameters())
    run = blocks(bench, f'{HELD}\nexpected_trips = [{{reason = "any", window = [0.0, 1.0]}}]')
    start = next(run).end_tick
    bench.axes[0].record.truth.body[name] = value
    with pytest.raises(DivergedError, match=f"{name} in the plant is not finite"):
        next(run), next(run)
    assert bench.trips == []
    assert bench.next_tick == start


def test_all_that_the_plant_remembers_is_looked_at():
    """Of what is not MuJoCo's, each number is looked at, moves a joint, or is made anew in every step."""
    through_a_force = {"bristle", "bearing_bristle", "grip_stiffness", "grip_damping", "grip_rest"}
    anew = {
        "voltage", "connected", "motor_torque", "rod_force", "along_crank", "along_column", "across_column",
        "far_along", "far_across", "grip_torque", "twist", "mesh_torque", "mesh_friction", "shown_force",
    }  # fmt: skip
    assert {*mechanism.REMEMBERED, *through_a_force, *anew} == set(BODY.names or ())


def test_a_warning_alone_is_enough(monkeypatch):
    bench = Bench(Parameters())
    run = blocks(bench)
    next(run)
    step = bench._advance

    def warns(*arguments: Any) -> int:
        bench_module._hear("one of MuJoCo's many warnings")
        return step(*arguments)

    monkeypatch.setattr(bench, "_advance", warns)
    block = next(run)
    assert (block.events[-1].level, block.events[-1].source) == ("error", "simulation")
    with pytest.raises(DivergedError, match="MuJoCo warned: one of MuJoCo's many warnings"):
        next(run)
    assert mujoco.__version__


# --- metrics ---------------------------------------------------------------------------------------------------------


def test_shares_of_time_are_metrics(tmp_path: Path):
    checks = "".join(
        f'[[checks]]\nname = "{name}"\nmetric = "{name}_limited_share"\nwindow = [0.0, 0.3]\n' for name in LIMITS
    )
    result = experiment.run(scenario_of(f"{PUSHED}\n{checks}"), out=tmp_path, rerun=False)
    r = run(PUSHED, duration=0.3)
    for name in LIMITS:
        assert result[name] == pytest.approx(float(r[f"/limits.{name}"].mean()), abs=1e-12)
    assert result["travel"] > 0.5
