"""Compiled and plain Python run the same law: identical samples."""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable

import numpy as np
import pytest

from cls_bench.bench import Bench
from cls_bench.compiled import JIT  # noqa: F401  (told to whoever runs this in another process)
from cls_bench.drivers import scripted
from cls_bench.rigs import find_rig
from cls_bench.scenario import parse_scenario
from cls_bench.signals import Block
from tests.running import advanced, parameters

SCENARIO = """
title = "all elements at work"
duration = 0.2
seed = 5
[parameters.feel]
shaker.torque = 1.0
centering.stiffness = 50.0
centering.breakout = 1.0
[parameters.motor]
cogging_amplitude = 0.01
[parameters.drive]
feed_forward_inertia = true
feed_forward_pilot = true
feed_forward_velocity = true
[drive]
power = "on"
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 15.0
frequency = 6.0
[[squeeze]]
at = 0.05
value = 0.8
over = 0.05
[[hand]]
at = 0.15
kind = "release"
[[changes]]
at = 0.1
power = "off"
[[changes]]
at = 0.17
power = "on"
mode = "velocity"
"""


SHORT = """
title = "a moment on another rig"
duration = 0.06
seed = 2
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 12.0
frequency = 10.0
[[squeeze]]
at = 0.02
value = 0.7
[[changes]]
at = 0.04
mode = "torque"
"""


FEEL = """
title = "a feel model with everything in it"
duration = 0.16
seed = 3
[drive]
power = "on"
[parameters.feel]
bodies = "BODIES"
static_friction = 0.4
stribeck_velocity = 0.05
neutral = 0.01
trim.rate = 0.2
flight = { dynamic_pressure = 4000.0, airspeed = 80.0, angle_of_attack = 0.05, load_factor = 1.2, tab = 0.02 }
q_feel.gradient = 0.002
centering = { stiffness = 60.0, breakout = 1.0 }
hydraulics = { off_friction = 0.3, off_damping = 1.0, maximum_rate = 0.8, feel_share = 0.7 }
aft = { friction = 0.2, static_friction = 0.3, stribeck_velocity = 0.03 }
linkage = { backlash = 0.004, pretension = 2.0, override = 12.0, damping = 2.0 }
aft_limit = { angle = 0.1, back_angle = 0.08, stiffness = 800.0, damping = 3.0 }
forward_limit = { angle = 0.15, stiffness = 1500.0, damping = 15.0 }
unbalance = { torque = 0.1, gradient = 2.0 }
bob_weight.torque = 0.2
down_spring.torque = -0.2
shaker = { torque = 1.0, ramp = 0.01, duty = 0.5, period = 0.05 }
pusher = { torque = 3.0, ramp = 0.02 }
disturbance = { torque = 0.1, vibration = 0.2 }
gust.torque = 0.5
autopilot = { reference = 0.05, clutch = 2.0 }
[parameters.feel.surface]
area = 1.0
chord = 0.3
hinge_zero = 0.001
hinge_alpha = -0.01
hinge_deflection = -0.02
hinge_tab = 0.01
hinge_rate = -3.0
boost = 0.4
control_angle = [-0.2, 0.0, 0.03, 0.2]
deflection = [-0.3, 0.0, 0.05, 0.4]
[parameters.feel.detents]
place = [-0.04, 0.02]
width = [0.03, 0.04]
torque = [0.5, 0.8]
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 14.0
frequency = 8.0
[[squeeze]]
at = 0.0
value = 0.8
[[changes]]
at = 0.04
parameters.feel.autopilot.engaged = true
parameters.feel.pusher.engaged = true
[[changes]]
at = 0.07
parameters.feel.hydraulics.pressure = 0.4
parameters.feel.jam.of = "forward"
[[changes]]
at = 0.08
parameters.feel.jam.of = "aft"
[[changes]]
at = 0.1
parameters.feel.jam.of = "none"
parameters.feel.linkage.connected = false
[[changes]]
at = 0.12
parameters.feel.linkage.connected = true
parameters.feel.trim.released = true
[[changes]]
at = 0.14
parameters.feel.detents.profile = [0.0, 1.0, -1.0, 0.0]
parameters.feel.trim.released = false
"""


def of_scenario(text: str) -> tuple[Bench, Iterable[Block]]:
    scenario = parse_scenario(text)
    bench = Bench(scenario.parameters_at_start(), seed=scenario.seed)
    return bench, scripted.run(bench, scenario)


def two_axes() -> tuple[Bench, Iterable[Block]]:
    """With faults of sensors and bus on one of them, so that their streams are drawn."""
    faulty = {"load_cell.spike_rate": 2000.0, "load_cell.spike": 20.0, "load_cell.creep": 0.01, "plc.frame_loss": 0.2}
    axes = {"pitch": parameters(faulty, find_rig("one_stage").parameters), "roll": find_rig("direct_drive").parameters}
    bench = Bench(axes, seed=4)
    return bench, advanced(bench, 0.04, frequency=12.0)


CASES: dict[str, Callable[[], tuple[Bench, Iterable[Block]]]] = {
    "all elements": lambda: of_scenario(SCENARIO),
    "every feel element, one body": lambda: of_scenario(FEEL.replace("BODIES", "one")),
    "every feel element, two bodies": lambda: of_scenario(FEEL.replace("BODIES", "two")),
    "one stage": lambda: of_scenario(f'rig = "one_stage"\n{SHORT}'),
    "direct drive": lambda: of_scenario(f'rig = "direct_drive"\n{SHORT}'),
    "16 kHz drive, 1 kHz PLC": lambda: of_scenario(
        f"{SHORT}\n[parameters.rates]\ncurrent_cycle = 62.5e-6\nvelocity_cycle = 125e-6\nposition_cycle = 500e-6\n"
        "bus_cycle = 500e-6\nplc_cycle = 1e-3"
    ),
    "two axes": two_axes,
}


def digests() -> dict[str, dict[str, str]]:
    """Hashes of all that each case records, and whether the column moved in it."""
    found = {}
    for name, case in CASES.items():
        bench, running = case()
        blocks = list(running)
        rows = {t.path: np.concatenate([block.signals[t.path] for block in blocks]) for t in bench.topics}
        rows["poses"] = np.concatenate([block.poses for block in blocks])
        found[name] = {path: hashlib.sha256(data.tobytes()).hexdigest() for path, data in rows.items()}
        for path, data in rows.items():
            if path.endswith("/column"):
                assert np.ptp(data[:, 0]) > 0.01, "nothing happened"
    return found


def in_process(jit: bool) -> dict[str, dict[str, str]]:
    code = "import json; from tests import test_jit; print(json.dumps([bool(test_jit.JIT), test_jit.digests()]))"
    environment = {
        **os.environ, "NUMBA_DISABLE_JIT": "0" if jit else "1", "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)
    }  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    on, found = json.loads(done.stdout)
    assert on is jit
    return found


@pytest.fixture(scope="module")
def both() -> tuple[dict[str, dict[str, str]], dict[str, dict[str, str]]]:
    return in_process(True), in_process(False)


@pytest.mark.parametrize("case", CASES)
def test_jit_on_and_off_give_identical_samples(both, case):
    compiled, plain = both
    assert len(compiled[case]) >= 7
    assert plain[case] == compiled[case]


def test_the_cases_differ(both):
    """Each topic of each case has samples of its own: no hash is that of nothing."""
    columns = [digest for case in both[0].values() for path, digest in case.items() if path.endswith("/column")]
    assert len(set(columns)) == len(columns) == len(CASES) + 1
