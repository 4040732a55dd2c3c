from collections.abc import Iterator

import numpy as np
import pytest

from cls_bench.analysis.energy import LOSSES, audit
from cls_bench.bench import Bench
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters
from cls_bench.recording import Recording
from cls_bench.scenario import Scenario, parse_scenario
from cls_bench.signals import TOPICS, Block
from tests.conftest import Runner

SWEEP = """
title = "sweep"
duration = 1.0
seed = 3
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 8.0
frequency = 1.5
fade = 0.3
"""


def blocks_of(scenario: Scenario, p: Parameters | None = None) -> list[Block]:
    return list(Bench(p or scenario.parameters_at_start(), seed=scenario.seed).run(scenario))


@pytest.fixture(scope="module")
def sweep() -> tuple[list[Block], Parameters]:
    scenario = parse_scenario(SWEEP)
    return blocks_of(scenario), scenario.parameters_at_start()


def split(blocks: list[Block], ticks: int) -> Iterator[Block]:
    """The same run in shorter blocks."""
    for block in blocks:
        for first in range(block.first_tick, block.end_tick, ticks):
            length = min(ticks, block.end_tick - first)
            signals = {}
            for topic in TOPICS:
                at = block.row_ticks(topic.ticks)
                signals[topic.path] = block.signals[topic.path][(at >= first) & (at < first + length)]
            yield Block(first, length, signals, block.poses[:0])


def test_books_balance_and_losses_add_up(sweep: tuple[list[Block], Parameters]) -> None:
    books = audit(*sweep)
    assert abs(books.relative_residual) < 1e-3
    assert books.throughput > 1.0
    assert set(books.losses) == set(LOSSES)
    assert all(value >= 0.0 for value in books.losses.values())
    assert max(books.returned.values()) < 1e-5 * books.throughput
    assert books.duration == pytest.approx(1.0, abs=4e-4)
    watts = books.watts()
    inflow = watts["work of the motor"] + watts["work of the hand"]
    out = sum(value for name, value in watts.items() if name.startswith(("lost", "stored")))
    assert out == pytest.approx(inflow, abs=1e-3 * books.throughput / books.duration)


def test_length_of_blocks_makes_no_difference(sweep: tuple[list[Block], Parameters]) -> None:
    blocks, p = sweep
    whole, parts = audit(blocks, p), audit(split(blocks, 888), p)
    assert parts.duration == pytest.approx(whole.duration)
    assert parts.throughput == pytest.approx(whole.throughput, rel=1e-4)
    for name, value in whole.losses.items():
        assert parts.losses[name] == pytest.approx(value, rel=1e-4, abs=1e-7)


def test_reads_a_recording(recorded: Runner) -> None:
    result = recorded("motion_tracking")
    recording = Recording(result.mcap)
    books = audit(recording.blocks(), Parameters(**recording.parameters))
    assert abs(books.relative_residual) < 5e-3
    assert books.losses["stage 1 friction"] > books.losses["column bearing"] > 0.0


def test_every_loss_is_at_work_somewhere() -> None:
    scenario = parse_scenario(
        SWEEP.replace('kind = "sine"', 'kind = "step"\nto_N = 150.0').replace("amplitude_deg = 8.0", "")
        .replace("frequency = 1.5", "").replace("fade = 0.3", "") + '[drive]\npower = "off"\n'
    )  # fmt: skip
    books = audit(blocks_of(scenario), scenario.parameters_at_start())
    assert all(value > 1e-3 for value in books.losses.values())
    assert abs(books.relative_residual) < 5e-3
    assert books.work["motor"] == pytest.approx(0.0, abs=1e-9)


def test_wrong_plant_does_not_balance(sweep: tuple[list[Block], Parameters]) -> None:
    blocks, p = sweep
    lighter = p.model_copy(update={"motor": p.motor.model_copy(update={"rotor_inertia": 1e-5})})
    moving = blocks[: len(blocks) // 2]  # ends in motion, so that kinetic energy counts
    assert abs(audit(moving, lighter).residual - audit(moving, p).residual) > 1e-3


def test_transmission_error_makes_no_energy() -> None:
    scenario = parse_scenario(
        SWEEP + "[parameters.gearbox.stage1]\ntransmission_error = 3e-3\n"
        "[parameters.gearbox.stage2]\ntransmission_error = 3e-3\n"
    )
    books = audit(blocks_of(scenario), scenario.parameters_at_start())
    assert abs(books.relative_residual) < 5e-3


def test_too_short_a_run_is_refused(sweep: tuple[list[Block], Parameters]) -> None:
    blocks, p = sweep
    with pytest.raises(InputError, match="too short"):
        audit([], p)
    assert np.isfinite(audit(blocks[:1], p).residual)
