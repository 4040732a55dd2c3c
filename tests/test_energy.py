from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cls_bench.analysis.energy import EnergyAudit, audit, loss_names
from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.errors import InputError
from cls_bench.experiment import run
from cls_bench.parameters import Parameters
from cls_bench.pilot import HandTimeline
from cls_bench.recording import Recording
from cls_bench.scenario import DriveStart, Release, Scenario, Sine, Squeeze, Step
from cls_bench.signals import Block
from tests.conftest import Runner

SWEEP = Scenario(
    title="sweep", duration=1.0, seed=3, hand=[Sine(at=0.0, amplitude_deg=8.0, frequency=1.5, fade=0.3)]
)  # fmt: skip
PUSH = Scenario(title="push", duration=1.0, seed=3, drive=DriveStart(power="off"), hand=[Step(at=0.0, to_N=150.0)])

RIGS = ("thesis", "one_stage", "direct_drive", "belt", "non_backdrivable", "elevator", "aileron", "rudder")

EACH_TICK = {"rates.velocity_cycle": 50e-6}
"""A row of drive and pilot for each tick."""

Run = tuple[list[Block], Parameters]


def made(scenario: Scenario, **values: Any) -> Run:
    changed = scenario.changed(values)
    p = changed.parameters_at_start()
    return list(scripted.run(Bench(p, seed=scenario.seed), changed)), p


@pytest.fixture(scope="module")
def sweep() -> Run:
    return made(SWEEP)


def split(blocks: list[Block], ticks: int) -> Iterator[Block]:
    """The same run in shorter blocks."""
    for block in blocks:
        for first in range(block.first_tick, block.end_tick, ticks):
            length = min(ticks, block.end_tick - first)
            signals = {}
            for topic, rows in block:
                at = block.row_ticks(topic.ticks)
                signals[topic.path] = rows[(at >= first) & (at < first + length)]
            yield replace(block, first_tick=first, ticks=length, signals=signals, poses=block.poses[:0])


def given_back(books: EnergyAudit) -> float:
    return max(*books.returned.values(), -min(books.losses.values())) / books.throughput


def test_books_balance_and_losses_add_up(sweep: Run) -> None:
    books = audit(*sweep)
    assert abs(books.relative_residual) < 1e-4
    assert books.throughput > 1.0
    assert tuple(sorted(books.losses)) == tuple(sorted(loss_names(2)))
    assert all(value >= 0.0 for value in books.losses.values())
    assert given_back(books) < 1e-5
    assert books.duration == pytest.approx(1.0, abs=2e-4)
    watts = books.watts()
    inflow = watts["work of the motor"] + watts["work of the hand"]
    out = sum(value for name, value in watts.items() if name.startswith(("lost", "stored")))
    assert out == pytest.approx(inflow, abs=1e-4 * books.throughput / books.duration)


def test_losses_are_those_of_the_stages_there_are() -> None:
    rest = ("load cell", "column bearing", "stop blocks")
    assert loss_names(0) == rest
    assert loss_names(2) == ("stage 1 friction", "stage 1 mesh", "stage 2 friction", "stage 2 mesh", *rest)


@pytest.mark.parametrize("ticks", [4, 888])
def test_length_of_blocks_makes_no_difference(sweep: Run, ticks: int) -> None:
    blocks, p = sweep
    whole, parts = audit(blocks, p), audit(split(blocks, ticks), p)
    assert parts.duration == pytest.approx(whole.duration)
    assert parts.throughput == pytest.approx(whole.throughput, rel=1e-9)
    for name, value in (whole.losses | whole.stored | whole.limb).items():
        assert (parts.losses | parts.stored | parts.limb)[name] == pytest.approx(value, rel=1e-6, abs=1e-8)


def test_reads_a_recording(recorded: Runner) -> None:
    result = recorded("motion_tracking")
    recording = Recording(result.mcap)
    books = audit(recording.blocks(), Parameters(**recording.parameters))
    assert abs(books.relative_residual) < 1e-3
    assert books.losses["stage 1 friction"] > books.losses["column bearing"] > 0.0


@pytest.mark.parametrize("rig", RIGS)
def test_a_recording_of_every_rig_balances(rig: str, tmp_path: Path) -> None:
    scenario = Scenario(
        title="swept, let go", duration=1.2, rig=rig, hand=[*SWEEP.hand, Release(at=0.9)],
        squeeze=[Squeeze(at=0.5, value=0.6)],
    )  # fmt: skip
    recording = Recording(run(scenario, out=tmp_path, rerun=False).mcap)
    p = Parameters(**recording.parameters)
    books = audit(recording.blocks(), p)
    assert abs(books.relative_residual) < 5e-4
    assert given_back(books) < 1e-5
    assert set(books.losses) == set(loss_names(p.gearbox.stages))
    assert abs(books.electrical_residual) < 0.03 * (books.copper_loss + abs(books.work["motor"]))
    blocks, p = made(scenario, **EACH_TICK)
    books = audit(blocks, p)
    assert abs(books.relative_residual) < 1e-4
    assert abs(books.electrical_residual) < 2e-4 * (books.copper_loss + abs(books.work["motor"]))


@pytest.mark.parametrize("rig", ["thesis", "direct_drive", "aileron"])
def test_every_loss_is_at_work_somewhere(rig: str) -> None:
    values = {"column.stop_angle": 0.5, "column.switch_angle": 0.45, "column.travel": 0.4} if rig == "aileron" else {}
    books = audit(*made(PUSH, rig=rig, **values))
    assert all(value > 1e-3 for value in books.losses.values())
    assert abs(books.relative_residual) < 5e-4
    assert books.work["motor"] == pytest.approx(0.0, abs=1e-9)


def right_and_wrong(rig: str, key: str, factor: float) -> tuple[EnergyAudit, EnergyAudit]:
    """Books of a run that ends in motion, with the parameters of its rig and with a wrong one."""
    blocks, p = made(SWEEP, rig=rig, **EACH_TICK)
    section, *rest = key.split(".")
    wrong = p.model_copy(update={section: scaled(getattr(p, section), rest, factor)})
    return audit(blocks[:3], p), audit(blocks[:3], wrong)


@pytest.mark.parametrize(
    ("rig", "key", "factor"),
    [
        ("thesis", "motor.rotor_inertia", 0.25), ("thesis", "gearbox.stage1.inertia", 3.0),
        ("thesis", "gearbox.stage2.ratio", 1.02), ("thesis", "linkage.crank", 1.05),
        ("thesis", "linkage.rod_column_mass", 1.5), ("thesis", "column.mass", 1.2),
        ("thesis", "load_cell.stiffness", 0.5),
        ("direct_drive", "motor.cogging_amplitude", 0.5), ("direct_drive", "motor.rotor_inertia", 0.9),
        ("aileron", "linkage.arm", 1.3), ("aileron", "column.inertia", 0.9),
        ("non_backdrivable", "gearbox.stage1.inertia", 5.0),
    ],
)  # fmt: skip
def test_wrong_plant_does_not_balance(rig: str, key: str, factor: float) -> None:
    right, wrong = right_and_wrong(rig, key, factor)
    assert abs(right.relative_residual) < 1e-4
    assert abs(wrong.residual - right.residual) > 20.0 * abs(right.residual)


@pytest.mark.parametrize(
    ("key", "element"),
    [
        ("gearbox.stage1.stiffness", "stage 1 mesh"), ("gearbox.stage2.backlash", "stage 2 mesh"),
    ],
)  # fmt: skip
def test_wrong_spring_gives_back_what_was_never_lost(key: str, element: str) -> None:
    """What an element takes is known; how much of it is stored follows from its stiffness."""
    right, wrong = right_and_wrong("thesis", key, 0.5)
    assert wrong.returned[element] > 20.0 * right.returned[element]


def scaled(section: Any, path: list[str], factor: float) -> Any:
    inner = getattr(section, path[0])
    return section.model_copy(update={path[0]: inner * factor if len(path) == 1 else scaled(inner, path[1:], factor)})


@pytest.mark.parametrize("kind", ["planetary", "spur"])
def test_transmission_error_makes_no_energy(kind: str) -> None:
    values = {f"gearbox.stage{k}.{name}": value for k in (1, 2) for name, value in (
        ("transmission_error", 3e-3), ("kind", kind)
    )}  # fmt: skip
    books = audit(*made(SWEEP, **values))
    assert abs(books.relative_residual) < 1e-3


def test_winding_s_book_is_closed_where_each_tick_has_its_row() -> None:
    books = audit(*made(SWEEP, **EACH_TICK))
    assert books.electrical == pytest.approx(books.copper_loss + books.inductance + books.work["motor"], rel=1e-4)
    assert books.copper_loss > 0.1
    blocks, p = made(SWEEP, **EACH_TICK, **{"motor.inductance": 60e-3, "nameplate.inductance": 60e-3})
    books = audit(blocks[:3], p)  # ends under current
    assert abs(books.inductance) > 10.0 * abs(books.electrical_residual)


def test_work_of_the_arm_is_its_force_along_the_way() -> None:
    blocks, p = made(PUSH)
    books = audit(blocks, p)
    way = blocks[-1]["/pilot.limb_angle"][-1] - blocks[0]["/pilot.limb_angle"][0]
    assert books.limb["arm"] == pytest.approx(150.0 * p.column.grip_height * way, rel=1e-3)
    assert abs(books.limb["squeezing"]) < 1e-3 * books.limb["arm"]
    assert books.limb["grip lost"] > 1.0 and books.limb["grip elastic"] > 1.0
    silent = [replace(block, topics=tuple(t for t in block.topics if t.path != "/pilot")) for block in blocks]
    without = audit(silent, p)
    assert without.limb == {} and without.residual == books.residual


def test_what_a_grip_holds_is_given_up_with_it() -> None:
    blocks, p = made(SWEEP.changed({"duration": 0.6}), **EACH_TICK)
    held = audit(blocks, p).limb["grip elastic"]
    released = Scenario(title="let go", duration=0.7, seed=3, hand=[*SWEEP.hand, Release(at=0.6)])
    books = audit(*made(released, **EACH_TICK))
    assert held > 1e-3
    assert books.limb["grip elastic"] == pytest.approx(0.0, abs=1e-12)
    assert books.limb["squeezing"] == pytest.approx(-held, rel=0.02)


def test_axes_have_books_of_their_own() -> None:
    axes = {name: Scenario(title=name, duration=1.0, rig=rig).parameters_at_start()
            for name, rig in (("pitch", "elevator"), ("roll", "aileron"))}  # fmt: skip
    bench, timeline = Bench(axes, seed=1), HandTimeline(SWEEP)
    bench.start()
    blocks = [bench.advance([timeline.sample(bench.next_tick, 4000)] * 2) for _ in range(5)]
    found = {name: audit(blocks, p, name) for name, p in axes.items()}
    for books in found.values():
        assert abs(books.relative_residual) < 5e-4
    assert found["pitch"].throughput != found["roll"].throughput
    with pytest.raises(InputError, match=r"^the run cannot be audited: it has no /yaw/column\.angle$"):
        audit(blocks, axes["roll"], "yaw")


def test_too_short_a_run_is_refused(sweep: Run) -> None:
    blocks, p = sweep
    with pytest.raises(InputError, match="too short"):
        audit([], p)
    with pytest.raises(InputError, match="too short"):
        audit(list(split(blocks[:1], 3))[:1], p)
    assert np.isfinite(audit(blocks[:1], p).residual)


def test_a_run_with_a_gap_or_without_a_signal_is_refused(sweep: Run) -> None:
    blocks, p = sweep
    with pytest.raises(InputError, match=r"before 0\.4000 s ticks are lost$"):
        audit([blocks[0], blocks[2]], p)
    more = p.model_copy(update={"gearbox": p.gearbox.model_copy(update={"stages": 3})})
    with pytest.raises(InputError, match=r"it has no /gearbox\.stage3_twist$"):
        audit(blocks, more)
