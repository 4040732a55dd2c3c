"""The multi-rate loop: what it records when, and that it stops where a state leaves all bounds."""

import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cls_bench import tick
from cls_bench.bench import Bench
from cls_bench.hand import HandSamples
from cls_bench.parameters import Motor, Parameters
from cls_bench.signals import CLOCK, TOPICS
from tests.running import run

SWAY = """
hand = [{at = 0.0, kind = "hold", angle_deg = 0.0},
        {at = 0.01, kind = "sine", amplitude_deg = 10.0, frequency = 3.0, fade = 0.05}]
"""


@pytest.fixture(scope="module")
def sway():
    return run(SWAY, duration=0.6)


def test_rows_come_at_the_rate_of_their_topic(sway):
    for topic in TOPICS:
        for name in topic.names:
            assert len(sway[f"{topic.path}.{name}"]) == 12_000 // topic.ticks


def test_rows_show_the_state_at_their_own_time(sway):
    """Row 0 is the standstill at the start; velocity and angle fit together as the integrator makes them."""
    angle, velocity = sway["/column.angle"], sway["/column.velocity"]
    assert (angle[0], velocity[0]) == (0.0, 0.0)
    assert np.ptp(angle) > 0.1
    np.testing.assert_allclose(np.diff(angle), velocity[1:] * CLOCK.tick_s, atol=1e-14)


def test_forces_belong_to_the_state_of_their_row(sway):
    """Air-gap torque is K times the current of the same row: the current acts when it flows."""
    np.testing.assert_array_equal(sway["/drive.torque"], 0.2944 * sway["/drive.current"])
    assert np.ptp(sway["/drive.torque"]) > 0.1
    np.testing.assert_allclose(sway["/column.torque"][::4], 0.3 * sway["/pilot.hand_force"], rtol=1e-12, atol=1e-15)


def test_controllers_hold_their_output_between_their_cycles(sway):
    """Set position and torque command change with position and velocity cycles, the PLC's torque every 8 ticks."""
    torque = sway["/load_cell.torque"].reshape(-1, 8)
    assert (torque == torque[:, :1]).all()
    assert len(np.unique(torque[:, 0])) > 1000
    position = sway["/drive.set_position"].reshape(-1, 2)
    assert (position[:, 0] == position[:, 1]).all()
    assert len(np.unique(sway["/drive.torque_command"])) > 2000


def test_the_plc_sees_counts_not_forces(sway):
    """Its torque follows from the whole numbers the converter gave in the same tick."""
    counts = sway["/load_cell.counts"]
    assert (counts == np.round(counts)).all()
    force = counts[::8] * 2 * 50 * 9.80665 / 2**24
    # r F, but for the rod's inclination and the unbalance at the measured angle.
    np.testing.assert_allclose(sway["/load_cell.torque"][::8], 0.175 * force, atol=1.0)
    assert np.abs(force - sway["/load_cell.force"][::8]).max() > 0.0


def test_the_set_position_is_the_models_angle_a_bus_cycle_later(sway):
    from cls_bench.kinematics import FourBar, crank_from_column

    bar = FourBar(0.100, 0.209, 0.175)
    wanted = [25.0 * crank_from_column(bar, angle) for angle in sway["/feel.angle"]]
    np.testing.assert_allclose(sway["/drive.set_position"][2::2], wanted[:-1], atol=2.5e-4)


def test_substeps_refine_the_same_motion(sway):
    fine = run(SWAY, duration=0.6, set=["simulation.substeps=4"])
    error = np.abs(fine["/column.angle"] - sway["/column.angle"])
    assert 0.0 < error.max() < math.radians(0.02)


@pytest.mark.parametrize("value", [math.nan, math.inf, -2.0e4])
def test_a_lost_joint_is_found(value):
    bench = Bench(Parameters())
    assert tick.first_unbounded(bench.plant, tick.BOUND) == -1
    assert bench.model.nv == 5
    for joint in range(bench.model.nv):
        bench.plant.qvel[:] = 0.0
        bench.plant.qvel[joint] = value
        assert tick.first_unbounded(bench.plant, tick.BOUND) == joint


@pytest.mark.parametrize(("torque_constant", "sound"), [(0.2944, False), (0.01, True)])
def test_a_fast_motor_is_not_taken_for_a_lost_one(torque_constant, sound):
    """At 12 000 rad/s a motor of 35 000 rad/s at no load is at ease; the thesis's would be at ten times its 1190."""
    fast = Parameters(motor=Motor(torque_constant=torque_constant)).with_nameplate()
    bench = Bench({"pitch": Parameters(), "roll": fast})
    bench.plant.qvel[bench.model.joint("roll/motor").id] = 1.2e4
    hand = HandSamples(*[np.zeros(1)] * 3, *[np.zeros(1, np.bool_)] * 2, np.zeros(1))
    bench.start(power=False)
    bench.advance([hand, hand], last=True)
    assert (bench.failure is None) == sound


# --- the one order ----------------------------------------------------------------------------------------------------

WORK = {
    "parameters that move: their present values": ("course.move",),
    "PLC: self-check of its numbers": ("control.controller.check_numbers",),
    "sample: encoder, current, load cell, potentiometer, limit switches": (
        "plant.mechanism.arrive", "plant.sensors.sample",
    ),
    "drive: speed filter": ("control.servo.speed_filter",),
    "field bus: position and velocity of the drive → PLC": ("control.latch.write feedback",),
    "PLC: torque measurement, outer loop, safety, kinematic chain": (
        "control.plc.measure", "control.plc.admittance", "control.plc.supervise", "control.plc.command",
    ),
    "field bus: newest command of the PLC → drive": ("control.plc.send", "control.latch.write commands"),
    "drive: position controller": ("control.servo.position_controller",),
    "drive: velocity controller": ("control.servo.velocity_controller",),
    "drive: current controller → voltage, through its latch": (
        "control.servo.current_controller", "control.latch.write voltages",
    ),
    "limits: what was asked for beyond one": ("tick._note_limits",),
    "plant: forces of the present state": ("plant.limb.set_grip", "plant.mechanism.act"),
    "trace: the state at the tick's time": ("plant.mechanism.show", "tick._trace"),
    "mj_step; forces and mj_step again for each further one of simulation.substeps": ("mj_step",),
}  # fmt: skip
"""What each line of the order calls."""

CYCLES = {"every tick": 1, "velocity cycle": 2, "bus cycle": 3, "position cycle": 4, "plc cycle": 6}
"""Ticks of the cycles in :mod:`tests.traced_tick`."""


def written_order(text):
    """The lines of the order: cycle and what is done in it."""
    lines = [line.strip() for line in text.splitlines()]
    first = next(k for k, line in enumerate(lines) if line.startswith("plc cycle"))
    last = next(k for k, line in enumerate(lines) if k > first and not line.startswith(tuple(CYCLES)))
    cut = [re.fullmatch(r"(\S+ \S+) {2,}(.*)", line) for line in lines[first:last]]
    return [found.groups() for found in cut]


ORDER = written_order(tick.__doc__)


def test_the_page_has_the_order_of_the_code():
    page = (Path(__file__).parents[1] / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert written_order(page) == ORDER
    assert [work for _, work in ORDER] == list(WORK)


@pytest.mark.parametrize("substeps", [1, 3])
def test_the_code_keeps_the_written_order(substeps):
    """As plain Python the loop is watched: what each tick calls, in which order, and in which cycles."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.traced_tick", "24", str(substeps)], capture_output=True, text=True, check=True,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"}, cwd=Path(__file__).parents[1],
    )  # fmt: skip
    ticks = json.loads(done.stdout)
    assert len(ticks) == 24
    known = {call for calls in WORK.values() for call in calls}
    again = ["plant.mechanism.arrive", "plant.limb.set_grip", "plant.mechanism.act", "mj_step"]
    for number, called in enumerate(ticks):
        seen = [call for call in called if call in known]
        expected = [call for cycle, work in ORDER if number % CYCLES[cycle] == 0 for call in WORK[work]]
        once = [call for k, call in enumerate(seen) if k == 0 or call != seen[k - 1]]
        assert once == expected + again * (substeps - 1), f"tick {number}"
