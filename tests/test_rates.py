"""Rates as parameters: what if the PLC ran at 1 kHz and the drive at 16 kHz. Cycles, delays and recordings follow."""

import math
from pathlib import Path

import numpy as np
import pytest

from cls_bench import experiment
from cls_bench import tick as tick_module
from cls_bench.bench import Bench
from cls_bench.control.outer_loop import Command
from cls_bench.errors import InputError
from cls_bench.kinematics import FourBar, crank_from_column
from cls_bench.parameters import Parameters
from cls_bench.recording import Recording
from cls_bench.scenario import parse_scenario
from tests.running import Run, advanced, collected, parameters, run, swaying

BAR = FourBar(0.100, 0.209, 0.175)


def rates(current: float, velocity: int, position: int, bus: int, plc: int) -> list[str]:
    """``--set`` for a tick of ``current`` µs and cycles of so many ticks."""
    names = ("velocity", "position", "bus", "plc")
    cycles = zip(names, (velocity, position, bus, plc), strict=True)
    return [f"rates.current_cycle={current * 1e-6!r}", *(
        f"rates.{name}_cycle={round(ticks * current * 1000) * 1e-9!r}" for name, ticks in cycles
    )]  # fmt: skip


CASES = {
    "as shipped": (50.0, 4, 8, 8, 8),
    "PLC 1 kHz, drive 16 kHz": (62.5, 2, 8, 8, 16),
    "bus of 250 µs": (62.5, 4, 8, 4, 16),
    "position 6, bus 4, PLC 12": (50.0, 2, 6, 4, 12),
    "all in every tick": (50.0, 1, 1, 1, 1),
    "slow drive, fast PLC": (50.0, 10, 20, 2, 4),
}
"""Tick [µs], and ticks of velocity, position, bus and PLC cycle."""


@pytest.fixture(params=CASES, ids=lambda name: name)
def case(request):
    return CASES[request.param]


class Steps:
    """Asks for an angle, a torque from a time on; remembers what it was given."""

    def __init__(self, at: float = math.inf):
        self.at, self.seen = at, []

    def step(self, inputs):
        self.seen.append(inputs)
        return Command(0.01 if inputs.time >= self.at - 1e-9 else 0.0)


def row_ticks(r: Run, path: str) -> np.ndarray:
    """Numbers of the ticks of a topic's rows."""
    topic = r.topic(path)
    return np.arange(len(r[f"{path}.{topic.names[0]}"])) * topic.ticks


def ceil_to(tick: int, every: int) -> int:
    return -(-tick // every) * every


# --- cycles -----------------------------------------------------------------------------------------------------------


def test_the_outer_loop_is_asked_in_every_plc_cycle(case):
    tick, *_, plc = case
    loop = Steps()
    run(controller=loop, duration=0.05, set=rates(*case))
    expected = np.arange(len(loop.seen)) * plc * tick * 1e-6
    np.testing.assert_allclose([i.time for i in loop.seen], expected, atol=1e-12)
    assert len(loop.seen) == math.ceil(round(0.05 / (plc * tick * 1e-6), 6))


def test_each_controller_works_in_its_own_cycle(case):
    """By what changes in the record from tick to tick: at most of its own cycles, and between them never."""
    _, velocity, position, _, plc = case
    bench = Bench(parameters(dict(map(_pair, rates(*case)))), seed=2)
    bench.start()
    state = bench.axes[0].record.controller.state
    watched = {
        "velocity": lambda: float(state.servo.velocity_integral),
        "position": lambda: float(state.servo.position_output),
        "plc": lambda: float(state.feel.torque),
        "current": lambda: float(state.servo.voltage),
    }
    every = {"velocity": velocity, "position": position, "plc": plc, "current": 1}
    moved = {name: [] for name in watched}
    before = {name: get() for name, get in watched.items()}
    steps = 6 * math.lcm(velocity, position, plc)
    hand = tick_module.Hand.of([swaying(0, steps, 0.2, 20.0, bench.clock.tick_s)])
    noise = bench._streams.draw(steps, bench._chances)
    for k in range(steps):  # tick by tick, which no driver may: blocks are of whole PLC cycles
        part = bench._room(k, 1)
        one = type(noise)(*[values[k : k + 1] for values in noise])
        bench._tick = k
        assert bench._advance(hand.part(k, 1), one, part, 1) == 1
        for name, get in watched.items():
            if (now := get()) != before[name]:
                moved[name].append(k)
            before[name] = now
    for name, found in moved.items():  # an encoder's count may stay the same from one cycle to the next
        assert all(k % every[name] == 0 for k in found), name
        assert len(found) > 0.5 * steps / every[name], name
        assert math.gcd(*found) == every[name], name


def _pair(override: str) -> tuple[str, float]:
    key, _, value = override.partition("=")
    return key, float(value)


def test_set_velocities_are_interpolated_over_a_position_cycle():
    """Four velocity cycles in one position cycle: a quarter of the way, half, three quarters, the newest."""
    loop = type("Loop", (), {"step": lambda _, i: Command(0.05 * math.sin(20.0 * i.time))})()
    r = run(controller=loop, duration=0.3, set=rates(50.0, 2, 8, 8, 8))
    v = r["/drive.set_velocity"]
    newest = v[3::4]
    assert r.topic("/drive").ticks == 2
    for k, share in ((0, 0.25), (1, 0.5), (2, 0.75)):
        between = v[4 + k :: 4][: len(newest) - 1]
        expected = (1.0 - share) * newest[:-1] + share * newest[1:]
        np.testing.assert_allclose(between, expected[: len(between)], atol=1e-12)
    assert np.ptp(v) > 10.0


# --- delays -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_command_comes_its_bus_cycles_late(case, delay):
    """From the PLC's cycle to the first position cycle in which its frame is there."""
    tick, _, position, bus, plc = case
    asked = 40 * plc
    r = run(controller=Steps(asked * tick * 1e-6), duration=0.15, set=[*rates(*case), f"plc.command_latency={delay}"])
    arrived = ceil_to(asked + delay * bus, position)
    rows = row_ticks(r, "/drive")
    moved = rows[np.flatnonzero(r["/drive.set_position"] > 0.1)[0]]
    assert moved == ceil_to(arrived, r.topic("/drive").ticks)


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_feedback_comes_its_bus_cycles_late(case, delay):
    """What the PLC is given is the encoder of so many bus cycles ago, tick by tick."""
    *_, bus, plc = case
    seen = []

    class Watch:
        def step(self, inputs):
            seen.append(inputs)
            return Command(0.05 * math.sin(15.0 * inputs.time))

    slow = ["drive.velocity_bandwidth=40.0", "drive.position_bandwidth=10.0"]
    r = run(controller=Watch(), duration=0.3, set=[*rates(*case), f"plc.feedback_latency={delay}", *slow])
    assert not r.error
    at = dict(zip(row_ticks(r, "/drive").tolist(), r["/drive.position"].tolist(), strict=True))
    expected, given = [], []
    for k, inputs in enumerate(seen):
        then = k * plc - delay * bus
        if then in at and k > 10:
            expected.append(at[then])
            given.append(25.0 * crank_from_column(BAR, inputs.angle))
    assert len(expected) > 5
    np.testing.assert_allclose(given, expected, atol=5e-4)
    assert np.ptp(expected) > 2.0


@pytest.mark.parametrize("delay", [0, 1, 4, 16])
def test_a_voltage_comes_its_ticks_late(case, delay):
    """From the position cycle that asks for torque to the terminals, to within a row of the record."""
    tick, _, position, _, plc = case
    starts = []
    for ticks in (0, delay):
        r = run(
            f'changes = [{{at = {40 * plc * tick * 1e-6!r}, mode = "torque"}}]', duration=0.1,
            set=[*rates(*case), f"drive.voltage_latency={ticks}", "drive.set_torque=1.0",
                 "drive.current_bandwidth=20.0"],
        )  # fmt: skip
        rows = row_ticks(r, "/drive")
        starts.append(rows[np.flatnonzero(np.abs(r["/drive.voltage"]) > 0.5)[0]])
    grid = r.topic("/drive").ticks
    first = ceil_to(40 * plc, position)
    assert starts == [ceil_to(first, grid), ceil_to(first + delay, grid)]


def test_the_drives_gains_know_its_cycle():
    """The speed filter's weight is 1 − exp(−cycle/T), whatever the cycle; loops keep their bandwidth."""
    shipped = Bench(Parameters()).axes[0].record.controller.design.gains
    for current, velocity in ((50.0, 4), (62.5, 2), (31.25, 16)):
        p = parameters(dict(map(_pair, rates(current, velocity, 2 * velocity, 16, 16))))
        gains = Bench(p).axes[0].record.controller.design.gains
        cycle = current * velocity * 1e-6
        assert gains.speed_filter == pytest.approx(1.0 - math.exp(-cycle / 4e-4), rel=1e-12)
        assert gains.velocity_proportional == shipped.velocity_proportional


# --- what is the same at any rate -------------------------------------------------------------------------------------


def test_faster_control_is_the_same_bench():
    """The plant's own motion does not depend on the clock: with the drive off, half the tick moves the column alike."""
    text = """
    hand = [{at = 0.0, kind = "hold", angle_deg = 0.0},
            {at = 0.05, kind = "ramp", to_deg = 10.0, over = 0.3, smooth = true}]
    drive.power = "off"
    """
    slow, fast = run(text, duration=0.5), run(text, duration=0.5, set=rates(25.0, 8, 16, 16, 16))
    assert len(fast["/column.angle"]) == 2 * len(slow["/column.angle"])
    np.testing.assert_allclose(fast["/column.angle"][::2], slow["/column.angle"], atol=math.radians(0.02))
    assert np.ptp(slow["/column.angle"]) > math.radians(5.0)


def test_the_shipped_rates_are_no_rates():
    given = rates(50.0, 4, 8, 8, 8)
    assert run(set=given, duration=0.05).same_samples(run(duration=0.05))


# --- recordings -------------------------------------------------------------------------------------------------------

SCENARIO = """
title = "a PLC at 1 kHz, a drive at 16 kHz"
duration = 0.3
[parameters.rates]
current_cycle = 62.5e-6
velocity_cycle = 125e-6
position_cycle = 500e-6
bus_cycle = 500e-6
plc_cycle = 1e-3
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 8.0
frequency = 3.0
[[changes]]
at = 0.1004
parameters.feel.inertia = 0.5
[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, 0.3]
min = 0.05
"""


def test_a_scenario_with_rates_is_run_and_recorded_at_them(tmp_path: Path):
    result = experiment.run(parse_scenario(SCENARIO), out=tmp_path, rerun=False)
    assert result.status == "passed"
    recording = Recording(result.mcap)
    clock = recording.clock
    assert clock == (62_500, 2, 8, 8, 16)
    found = {topic.path: topic.rate for topic in recording.topics.values()}
    assert found["/column"] == 16_000.0 and found["/drive"] == 8_000.0 and found["/feel"] == 1_000.0
    bench = Bench(parse_scenario(SCENARIO).parameters_at_start())
    assert {t.path: t.rate for t in bench.topics} == found
    for topic in recording.topics.values():
        rows = recording.read(topic.path)
        assert len(rows) == 4800 // topic.ticks
    assert recording.parameters["rates"]["plc_cycle"] == 1e-3
    (change,) = [event for event in recording.events() if "feel.inertia" in event.message]
    assert change.tick == 1616  # 0.1004 s is within a PLC cycle, which ends at 0.101 s
    assert change.time == pytest.approx(0.101)


def test_blocks_are_of_whole_plc_cycles():
    p = parse_scenario(SCENARIO).parameters_at_start()
    bench = Bench(p)
    assert bench.block_ticks == 3200
    blocks = list(advanced(bench, 0.5))
    assert [block.ticks for block in blocks] == [3200, 3200, 1600]
    r = collected(bench, blocks)
    assert r.time("/column")[-1] == pytest.approx(0.5 - 62.5e-6)


# --- mistakes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("override", "says"), [
    ("rates.velocity_cycle=175e-6", "velocity_cycle must be a multiple of current_cycle = 5e-05 s"),
    ("rates.position_cycle=300e-6", "position_cycle must be a multiple of velocity_cycle = 0.0002 s"),
    ("rates.bus_cycle=420e-6", "bus_cycle must be a multiple of current_cycle = 5e-05 s"),
    ("rates.plc_cycle=1e-3", "plc_cycle must be a multiple of bus_cycle = 0.0004 s"),
    ("rates.plc_cycle=4e-3", "plc_cycle must be at most 64 cycles of the current controller"),
    ("rates.current_cycle=50.000002e-6", "current_cycle: 5e-05 s is not a whole number of nanoseconds"),
    ("rates.current_cycle=5e-6", "rates.current_cycle: 5e-06 is not valid"),
    ("rates.plc_cycle=0.02", "rates.plc_cycle: 0.02 is not valid"),
    ("rates.plc_cycle=0.0", "rates.plc_cycle: 0.0 is not valid; give a number ≥ 1e-05 and ≤ 0.01 [s]"),
])  # fmt: skip
def test_a_wrong_rate_is_one_clear_line(override, says):
    with pytest.raises(InputError) as refused:
        parse_scenario('title = "t"\nduration = 1.0', set=[override])
    message = str(refused.value)
    assert says in message and "rates" in message
    assert "\n" not in message


def test_rates_hold_for_the_whole_run():
    with pytest.raises(InputError, match=r"rates\.plc_cycle: holds for the whole run"):
        parse_scenario('title = "t"\nduration = 1.0\nchanges = [{at = 0.5, parameters.rates.plc_cycle = 8e-4}]')
