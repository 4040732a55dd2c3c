"""Topics and blocks as values: of any clock, number of gear stages and axis."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from cls_bench.parameters.rates import Rates
from cls_bench.signals import CLOCK, TOPICS, Block, Clock, Event, axes_of, axis_of, topics

DRIVE_16_KHZ = Clock(tick_ns=62_500, velocity_ticks=2, position_ticks=4, bus_ticks=16, plc_ticks=16)
"""Current controller at 16 kHz, PLC at 1 kHz."""


def table(first: int, ticks: int, clock: Clock, *groups: tuple[int, str]) -> Block:
    """A block of numbered samples of axes with (stages, name)."""
    own = tuple(topic for stages, axis in groups for topic in topics(clock, stages, axis))
    rows = {t.path: np.arange(t.rows(first, ticks) * len(t.signals), dtype=float) for t in own}
    shaped = {t.path: rows[t.path].reshape(-1, len(t.signals)) for t in own}
    poses = np.zeros((len(range(-(-first // clock.pose_ticks), -(-(first + ticks) // clock.pose_ticks))), 1, 7))
    return Block(first, ticks, shaped, poses, (), clock, own)


@pytest.mark.parametrize("stages", [0, 1, 2, 3])
def test_the_gearbox_has_the_signals_of_its_stages(stages: int) -> None:
    found = {topic.path: topic for topic in topics(stages=stages)}
    assert ("/gearbox" in found) == (stages > 0)
    if stages:
        what = ("twist", "torque", "friction")
        assert found["/gearbox"].names == tuple(f"stage{n + 1}_{name}" for n in range(stages) for name in what)
    assert {**found, "/gearbox": 0}.keys() == {topic.path for topic in TOPICS}


@pytest.mark.parametrize("stages", [-1, 4])
def test_a_gearbox_has_three_stages_at_most(stages: int) -> None:
    with pytest.raises(ValueError, match=f"0 to 3 stages, not {stages}"):
        topics(stages=stages)


def test_rates_follow_the_clock() -> None:
    rates = {topic.path: topic.rate for topic in topics(DRIVE_16_KHZ)}
    assert rates["/column"] == rates["/gearbox"] == 16_000.0
    assert rates["/drive"] == rates["/pilot"] == 8_000.0
    assert rates["/feel"] == rates["/limits"] == 1_000.0
    assert {topic.path: topic.rate for topic in TOPICS}["/drive"] == 5_000.0


def test_an_axis_goes_before_the_path() -> None:
    both = topics(axis="pitch") + topics(stages=0, axis="roll")
    assert [topic.path for topic in both if topic.path.endswith("column")] == ["/pitch/column", "/roll/column"]
    assert axes_of(both) == ("pitch", "roll") and axes_of(TOPICS) == ("",)
    assert (axis_of("/pitch/column.angle"), axis_of("/column.angle")) == ("pitch", "")


@pytest.mark.parametrize("name", ["Pitch", "a/b", "1", " ", "pitch.up", "x" * 21, "pitch\n"])
def test_a_name_of_an_axis_is_a_plain_word(name: str) -> None:
    with pytest.raises(ValueError, match="no name of an axis"):
        topics(axis=name)


CLOCKS = [
    Clock(tick, velocity, position, bus, bus * many)
    for tick, velocity, position, bus, many in itertools.product(
        (10_000, 31_250, 50_000, 200_000), (1, 3, 4), (12,), (1, 5, 8), (1, 3)
    )
]


@pytest.mark.parametrize("clock", CLOCKS, ids=str)
def test_every_topic_has_a_row_on_every_tick_of_the_plc(clock: Clock) -> None:
    """So a window at the PLC's rate holds samples of the same instants, and blocks that begin there one row of each."""
    for topic in topics(clock):
        assert clock.plc_ticks % topic.ticks == 0, topic.path
        for first, ticks in ((0, 1), (clock.plc_ticks, 1), (3, 7), (1, 1000)):
            expected = [tick for tick in range(first, first + ticks) if tick % topic.ticks == 0]
            assert topic.rows(first, ticks) == len(expected)
    assert clock.velocity_ticks % clock.drive_ticks == 0
    assert clock.pose_ticks % clock.plc_ticks == 0
    assert 0.0 < clock.time(clock.pose_ticks) <= max(1.5 * 0.01, clock.plc_s)


def test_times_of_a_clock() -> None:
    assert CLOCK.time(3) == 150e-6 and DRIVE_16_KHZ.time(16) == 1e-3
    assert DRIVE_16_KHZ.tick_of(0.0125) == 200
    assert (CLOCK.drive_ticks, CLOCK.pose_ticks) == (4, 200) and DRIVE_16_KHZ.pose_ticks == 160


def test_a_block_knows_its_topics_and_its_clock() -> None:
    block = table(32, 48, DRIVE_16_KHZ, (3, "pitch"), (0, "roll"))
    assert [topic.path for topic, _ in block] == [topic.path for topic in block.topics]
    assert np.array_equal(block["/pitch/gearbox.stage3_friction"], block.signals["/pitch/gearbox"][:, 8])
    assert block.row_ticks(block.topic("/roll/feel").ticks).tolist() == [32, 48, 64]
    for signal in ("/roll/gearbox.stage1_twist", "/column.angle"):
        with pytest.raises(KeyError):
            block[signal]


def test_events_have_the_clock_of_their_block() -> None:
    block = table(0, 16, DRIVE_16_KHZ, (1, ""))
    with_event = replace(block, events=(Event(8, "info", "drive", "on"),))
    assert math.isclose(with_event.events[0].time, 8 * 62.5e-6)
    assert Event(8, "info", "drive", "on").time == 400e-6


def test_a_clock_is_allowed_where_the_parameters_allow_it() -> None:
    rng = np.random.default_rng(1)
    counts, seen = [0, 1, 2, 3, 4, 8, 16, 50, 51, 64, 65, 1000], set()
    for _ in range(3000):
        tick = int(rng.choice([0, 9_999, 10_000, 31_250, 50_000, 200_000, 200_001, 10**9]))
        velocity, bus = (int(n) for n in rng.choice(counts, 2))
        clock = Clock(tick, velocity, velocity * int(rng.integers(1, 5)), bus, bus * int(rng.integers(0, 9)))
        if rng.random() < 0.2:
            clock = clock._replace(position_ticks=int(rng.choice(counts)), plc_ticks=int(rng.choice(counts)))
        cycles = [clock.time(1), *(clock.time(ticks) for ticks in clock[1:])]
        try:
            names = ("current_cycle", "velocity_cycle", "position_cycle", "bus_cycle", "plc_cycle")
            assert Rates(**dict(zip(names, cycles, strict=True))).clock == clock
            allowed = True
        except (ValidationError, ZeroDivisionError):
            allowed = False
        seen.add(allowed)
        if allowed:
            clock.check()
        else:
            with pytest.raises(ValueError, match=r"is not|is no multiple"):
                clock.check()
    assert seen == {True, False}
