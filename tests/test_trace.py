"""Each recorded signal is what its name says: held against the bench's own state and against laws, one by one.

The run is cut into blocks of one PLC cycle. Between two blocks the bench stands still, so what the first row of the
next one must say can be read from MuJoCo by joint name, and from laws written down here once more. A test then spoils
each signal in turn (zeros, another sign, the column beside it), and each spoilt one must be found.
"""

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from cls_bench import bench as bench_module
from cls_bench.bench import Bench
from cls_bench.control.limits import LIMITS
from cls_bench.scenario import parse_scenario
from cls_bench.signals import TOPIC, TOPICS
from cls_bench.trace import Trace, buffers, tables

CYCLE = 8
IDEAL = ["encoder.noise=0.0", "load_cell.noise=0.0", "gearbox.stage1.transmission_error=0.0",
         "gearbox.stage2.transmission_error=0.0", "load_cell.filter_bandwidth=100000.0"]  # fmt: skip
SWAY = """
title = "all in motion"
duration = 0.4
hand = [{at = 0.0, kind = "sine", amplitude_deg = 12.0, frequency = 4.0, fade = 0.1}]
squeeze = [{at = 0.0, value = 0.3, over = 0.0}]
"""
SIGNALS = [f"{topic.path}.{name}" for topic in TOPICS for name in topic.names if topic.path != "/limits"]
RATIO, HEIGHT, ARM = 5.0, 0.300, 0.175


class Recorded:
    """All rows by signal, and what the bench held before each cycle and after each."""

    def __init__(self) -> None:
        self.signals: dict[str, Any] = {}
        self.before: dict[str, Any] = {}
        self.after: dict[str, Any] = {}


def state_of(bench: Bench) -> dict[str, float]:
    """What MuJoCo and the controllers hold, by their own names."""
    data, servo, feel = bench.data, bench._state.servo, bench._state.feel
    joints = ("motor", "carrier1", "crank", "load_cell", "column", "limb")
    found = {name: float(data.joint(name).qpos[0]) for name in joints}
    found |= {f"{name}_rate": float(data.joint(name).qvel[0]) for name in joints}
    found |= {name: float(data.actuator(name).force[0]) for name in ("stage1_friction", "stage2_friction")}
    found["current"] = float(data.act[1])
    found["voltage"] = float(servo.voltage)
    found |= {f"feel_{name}": float(getattr(feel, name)) for name in ("angle", "velocity", "torque")}
    return found


@cache
def recorded() -> Recorded:
    scenario = parse_scenario(SWAY, set=IDEAL)
    bench = Bench(scenario.parameters_at_start())
    found, rows, before, after = Recorded(), {}, [], []
    whole, bench_module.BLOCK_TICKS = bench_module.BLOCK_TICKS, CYCLE
    try:
        run = bench.run(scenario)
        last = state_of(bench)
        for block in run:
            before.append(last)
            after.append(last := state_of(bench))
            for signal in SIGNALS:
                rows.setdefault(signal, []).append(block[signal])
    finally:
        bench_module.BLOCK_TICKS = whole
    found.signals = {signal: np.concatenate(parts) for signal, parts in rows.items()}
    found.before = {key: np.array([s[key] for s in before]) for key in before[0]}
    found.after = {key: np.array([s[key] for s in after]) for key in after[0]}
    return found


def dead_zone(x: Any, half: float) -> Any:
    return np.sign(x) * np.maximum(np.abs(x) - half, 0.0)


def expected(r: Recorded, signals: dict[str, Any]) -> dict[str, tuple[Any, Any, float]]:
    """For each signal: rows as recorded, rows as they should be, tolerance."""
    was, became = r.before, r.after
    count = len(was["column"])

    def first(signal: str) -> Any:
        """The rows at the start of each cycle."""
        return signals[signal].reshape(count, -1)[:, 0]

    def last(signal: str) -> Any:
        """The rows of the last tick of each cycle: MuJoCo still holds the forces of that tick."""
        return signals[signal].reshape(count, -1)[:, -1]

    minute = math.pi / 180.0 / 60.0
    twist1, rate1 = was["motor"] / RATIO - was["carrier1"], was["motor_rate"] / RATIO - was["carrier1_rate"]
    twist2, rate2 = was["carrier1"] / RATIO - was["crank"], was["carrier1_rate"] / RATIO - was["crank_rate"]
    cell_damping = 2.0 * 0.02 * math.sqrt(3.0e6 * (0.15 + 3.51e-2 / ARM**2))
    force = 3.0e6 * was["load_cell"] + cell_damping * was["load_cell_rate"]
    grip = HEIGHT**2 * 800.0 * (2.0e6 / 800.0) ** 0.3, HEIGHT**2 * 10.0 * 15.0**0.3
    hand = grip[0] * (was["limb"] - was["column"]) + grip[1] * (was["limb_rate"] - was["column_rate"])
    set_position, position = signals["/drive.set_position"][::2], signals["/drive.position"][::2]
    output = 2.0 * math.pi * 35.0 * (set_position - position)
    e = signals["/drive.set_velocity"] - signals["/drive.velocity"]
    k_p = 9.27e-5 * 2.0 * math.pi * 100.0
    integral = signals["/drive.torque_command"] - k_p * e
    interpolated = np.repeat(output, 2)
    interpolated[2::2] = 0.5 * (output[:-1] + output[1:])
    angle = np.append([0.0, 0.0], signals["/feel.angle"])[:count]  # a bus cycle, then the drive's own
    found = {
        "/pilot.hand_force": (first("/pilot.hand_force"), hand / HEIGHT, 1e-9),
        "/pilot.squeeze": (signals["/pilot.squeeze"], np.full(2 * count, 0.3), 1e-12),
        "/pilot.limb_angle": (first("/pilot.limb_angle"), was["limb"], 0.0),
        "/column.angle": (first("/column.angle"), was["column"], 0.0),
        "/column.velocity": (first("/column.velocity"), was["column_rate"], 0.0),
        "/column.torque": (first("/column.torque"), hand, 1e-9),
        "/drive.set_position": (set_position, 1.75 * 25.0 * angle, 0.6),
        "/drive.position": (first("/drive.position"), was["motor"], 2.5e-5),
        "/drive.set_velocity": (signals["/drive.set_velocity"], interpolated, 1e-9),
        "/drive.velocity": (first("/drive.velocity"), was["motor_rate"], 8.0),
        "/drive.torque_command": (np.diff(integral), k_p / 0.02 * e[1:] * 2e-4, 1e-9),
        "/drive.current": (first("/drive.current"), was["current"], 0.0),
        "/drive.voltage": (first("/drive.voltage"), was["voltage"], 0.0),
        "/drive.torque": (signals["/drive.torque"], 0.2944 * signals["/drive.current"], 0.01),
        "/gearbox.stage1_twist": (first("/gearbox.stage1_twist"), twist1, 1e-15),
        "/gearbox.stage1_torque": (
            first("/gearbox.stage1_torque"), 1.2 / minute * dead_zone(twist1, 2.5 * minute), 0.03 + 0.05 * np.abs(rate1)
        ),
        "/gearbox.stage1_friction": (last("/gearbox.stage1_friction"), -became["stage1_friction"], 0.0),
        "/gearbox.stage2_twist": (first("/gearbox.stage2_twist"), twist2, 1e-15),
        "/gearbox.stage2_torque": (
            first("/gearbox.stage2_torque"), 6.0 / minute * dead_zone(twist2, 1.5 * minute), 0.03 + 0.5 * np.abs(rate2)
        ),
        "/gearbox.stage2_friction": (last("/gearbox.stage2_friction"), -became["stage2_friction"], 0.0),
        "/load_cell.force": (first("/load_cell.force"), force, 1e-6),
        "/load_cell.torque": (first("/load_cell.torque"), ARM * force, 2.0),
        "/load_cell.counts": (first("/load_cell.counts"), force * 2**23 / (50.0 * 9.80665), 1.0),
        "/feel.torque": (signals["/feel.torque"], became["feel_torque"], 0.0),
        "/feel.angle": (signals["/feel.angle"], became["feel_angle"], 0.0),
        "/feel.velocity": (signals["/feel.velocity"], became["feel_velocity"], 0.0),
    }  # fmt: skip
    return found


def wrong(signals: dict[str, Any]) -> set[str]:
    """Names of the signals that are not what they should be."""
    found = set()
    for name, (rows, right, tolerance) in expected(recorded(), signals).items():
        settled = slice(4, None)  # the first cycles fill the latches
        if not (np.abs(rows - right) <= tolerance)[settled].all():
            found.add(name)
    return found


def test_every_signal_has_its_law() -> None:
    assert list(expected(recorded(), recorded().signals)) == SIGNALS
    assert wrong(recorded().signals) == set()


@pytest.mark.parametrize("signal", SIGNALS)
def test_a_spoilt_signal_is_found(signal: str) -> None:
    """The proof that the test above sees every column: each is spoilt in turn, and must be noticed by its own law."""
    path, _, name = signal.rpartition(".")
    names = TOPIC[path].names
    beside = f"{path}.{names[(names.index(name) + 1) % len(names)]}"
    rows = recorded().signals
    for spoilt in (np.zeros_like(rows[signal]), -rows[signal], rows[beside], np.full_like(rows[signal], np.nan)):
        assert signal in wrong({**rows, signal: spoilt})


def test_fields_follow_from_the_table() -> None:
    assert Trace._fields == (*(topic.path.strip("/") for topic in TOPICS), "poses")
    assert TOPIC["/limits"].names == LIMITS


def test_a_row_is_nan_until_it_is_written() -> None:
    trace = buffers(8, 16, 3)
    trace.drive[2].voltage = 5.0
    found = tables(trace, 8, 16)
    assert found["/drive"].shape == (4, 8)
    assert found["/drive"][2, TOPIC["/drive"].names.index("voltage")] == 5.0
    assert sum(np.isfinite(table).sum() for table in found.values()) == 1
    assert np.isnan(trace.poses).all()


def test_a_signal_that_nothing_writes_ends_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a declared and forgotten signal would look like: its column stays NaN."""
    whole = bench_module.tables

    def forgetful(*arguments: Any) -> Any:
        found = dict(whole(*arguments))
        found["/feel"][:, 1] = np.nan
        return found

    monkeypatch.setattr(bench_module, "tables", forgetful)
    scenario = parse_scenario(SWAY)
    with pytest.raises(bench_module.DivergedError, match=r"recorded signal /feel\.angle is not finite"):
        list(Bench(scenario.parameters_at_start()).run(scenario))
