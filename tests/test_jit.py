"""Compiled and plain Python run the same law: identical samples."""

import json
import os
import subprocess
import sys

import numpy as np

SCRIPT = """
import hashlib, json, sys
import numpy as np
from cls_bench.bench import Bench
from cls_bench.compiled import JIT
from cls_bench.scenario import parse_scenario
from cls_bench.signals import TOPIC

scenario = parse_scenario(sys.argv[1])
blocks = list(Bench(scenario.parameters_at_start(), seed=scenario.seed).run(scenario))
rows = {path: np.concatenate([block.signals[path] for block in blocks]) for path in TOPIC}
print(json.dumps({
    "jit": bool(JIT),
    "column": rows["/column"][::100].tolist(),
    "hashes": {path: hashlib.sha256(data.tobytes()).hexdigest() for path, data in rows.items()},
    "poses": hashlib.sha256(np.concatenate([block.poses for block in blocks]).tobytes()).hexdigest(),
}))
"""

SCENARIO = """
title = "all elements at work"
duration = 0.2
seed = 5
[parameters.feel]
shaker_torque = 1.0
centering_stiffness = 50.0
centering_breakout = 1.0
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


def run(jit: bool) -> dict:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "0" if jit else "1"}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, SCENARIO], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout)


def test_jit_on_and_off_give_identical_samples():
    compiled, plain = run(True), run(False)
    assert (compiled["jit"], plain["jit"]) == (True, False)
    column = np.array(compiled["column"])
    assert np.ptp(column[:, 0]) > 0.1  # something happened
    np.testing.assert_array_equal(np.array(plain["column"]), column)
    assert plain["hashes"] == compiled["hashes"]
    assert plain["poses"] == compiled["poses"]

