"""How many files a further thing takes: a kind of gear stage, a sensor, a signal, a feel element.

Each is added to a copy of the package, and run.

The page of all parameters (models/README.md) is made from them and not counted.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
Edits = Mapping[str, Sequence[tuple[str, str]]]

HARMONIC: Edits = {
    "parameters/plant.py": [('"belt", "worm"]', '"belt", "worm", "harmonic"]')],
    # A wave generator has two lobes, so its error comes twice a turn, whatever its teeth.
    "plant/gearbox.py": [
        ('row["teeth"] = stage.ratio, stage.teeth\n', 'row["teeth"] = stage.ratio, stage.teeth\n'
         '        if stage.kind == "harmonic":\n            row["teeth"] = 2.0\n'),
    ],
    "plant/shapes.py": [('"worm": self.worm}', '"worm": self.worm, "harmonic": self.planetary}')],
}  # fmt: skip

CRANK_SENSOR: Edits = {
    "parameters/__init__.py": [
        ("    potentiometer: Potentiometer = Potentiometer()\n",
         "    potentiometer: Potentiometer = Potentiometer()\n"
         "    crank_potentiometer: Potentiometer = Potentiometer(range=0.8, noise=1e-3)\n"),
        ('"encoder", "potentiometer")', '"encoder", "potentiometer", "crank_potentiometer")'),
    ],
    "plant/sensors.py": [
        ('        ("switch_forward", np.int64),',
         '        ("crank", np.float64),\n        ("switch_forward", np.int64),'),
        ('NORMAL = ("encoder", "load_cell", "potentiometer")',
         'NORMAL = ("encoder", "crank", "load_cell", "potentiometer")'),
        ("    encoder: NDArray[np.float64]\n", "    encoder: NDArray[np.float64]\n    crank: NDArray[np.float64]\n"),
        ("    samples.current = body.current\n",
         "    samples.current = body.current\n"
         "    second = p.crank_potentiometer\n"
         "    samples.crank = _quantised(plant.qpos[joints.crank] + second.noise * noise.crank[row, axis],\n"
         "                               2.0 * second.range / (1 << second.adc_bits))\n"),
    ],
}  # fmt: skip

SIGNAL: Edits = {
    "signals.py": [
        ('("torque", "N·m", "air-gap torque of the motor", "truth.body.motor_torque"),',
         '("torque", "N·m", "air-gap torque of the motor", "truth.body.motor_torque"),\n'
         '            ("integral", "N·m", "what the velocity controller has added up",\n'
         '             "controller.state.servo.velocity_integral"),'),
    ],
}  # fmt: skip


def copy_of_the_package(folder: Path, edits: Edits) -> Path:
    """The package with texts replaced, each of which stands there once."""
    shutil.copytree(ROOT / "cls_bench", folder / "cls_bench", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "scenarios"):
        (folder / name).symlink_to(ROOT / name)
    for file, replaced in edits.items():
        path = folder / "cls_bench" / file
        text = path.read_text(encoding="utf-8")
        for old, new in replaced:
            assert text.count(old) == 1, f"{file}: {old!r}"
            text = text.replace(old, new)
        path.write_text(text, encoding="utf-8")
    return folder


def run_there(folder: Path, program: str) -> Any:
    """What ``program`` prints as JSON, run as plain Python with the package in ``folder``."""
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


HARMONIC_DRIVE = """
import json
import numpy as np
from cls_bench.bench import Bench
from cls_bench.hand import HandSamples
from cls_bench.rigs import parse_rig

rig = parse_rig('''
title = "a harmonic drive"
[[data_sheet.gearbox]]
kind = "harmonic"
ratio = 50
efficiency = 0.75
backlash_arcmin = 0.0
stiffness_Nm_per_arcmin = 4.0
inertia_kgcm2 = 0.2
transmission_error_arcmin = 1.0
[parameters.gearbox.stage1]
drag = 0.0
ripple = 0.0
''')
bench = Bench(rig.parameters)
stage = bench.axes[0].record.truth.mechanism.stage[0]
turned = np.linspace(0.0, np.pi, 5)
found = []
for angle in turned:
    bench.reset()
    bench.plant.qpos[bench.model.joint("motor").id] = angle
    bench.plant.qpos[bench.model.joint("crank").id] = angle / 50.0
    none, no = np.zeros(8), np.zeros(8, np.bool_)
    bench.start(power=False)
    block = bench.advance(HandSamples(none, none, none, no, no, none))
    found.append(float(block["/gearbox.stage1_torque"][0]))
print(json.dumps({"torques": found, "stiffness": float(stage.stiffness), "error": float(stage.error),
                  "geoms": len(bench.geoms), "ratio": rig.parameters.gearbox.ratio}))
"""


def test_a_kind_of_gear_stage_takes_three_files(tmp_path):
    """Its name, its law and its drawing. A rig file may name it from then on; its error comes twice in a turn."""
    assert len(HARMONIC) <= 3
    found = run_there(copy_of_the_package(tmp_path, HARMONIC), HARMONIC_DRIVE)
    assert found["ratio"] == 50.0 and found["geoms"] > 30
    expected = found["stiffness"] * found["error"] * -np.sin(2.0 * np.linspace(0.0, np.pi, 5))
    assert found["error"] > 0.0
    np.testing.assert_allclose(found["torques"], expected, atol=1e-6 * np.abs(expected).max())


def test_a_kind_that_has_no_law_of_its_own_takes_two(tmp_path):
    edits = {file: replaced for file, replaced in HARMONIC.items() if file != "plant/gearbox.py"}
    assert len(edits) == 2
    program = HARMONIC_DRIVE.replace("[parameters.gearbox.stage1]", "[parameters.gearbox.stage1]\nteeth = 2")
    found = run_there(copy_of_the_package(tmp_path, edits), program)
    expected = found["stiffness"] * found["error"] * -np.sin(2.0 * np.linspace(0.0, np.pi, 5))
    np.testing.assert_allclose(found["torques"], expected, atol=1e-6 * np.abs(expected).max())


FOURTH_STAGE: Edits = {
    "signals.py": [("MOST_STAGES = 3\n", "MOST_STAGES = 4\n")],
    "parameters/plant.py": [
        ("    stage3: GearStage = part(\n",
         '    stage4: GearStage = part(GearStage(), "fourth", **dict.fromkeys(("inertia", "stiffness", "backlash",\n'
         '        "drag", "transmission_error", "efficiency", "backdrive_efficiency"), "not in use"))\n'
         "    stage3: GearStage = part(\n"),
    ],
}  # fmt: skip

FOUR_STAGES = """
import json
import numpy as np
from cls_bench.bench import Bench
from cls_bench.hand import HandSamples
from cls_bench.parameters import Gearbox, GearStage, Parameters

stages = {f"stage{k}": GearStage(ratio=k + 1.0, backlash=1e-3) for k in range(1, 5)}
bench = Bench(Parameters(gearbox=Gearbox(stages=4, **stages)).with_nameplate())
joints = [bench.model.joint(k).name for k in range(bench.model.njnt)]
# The crank held still, all backlash taken up: the motor turned by 1 rad, each shaft after it by its share.
turned = 1.0
for name in ("motor", "carrier1", "carrier2", "carrier3"):
    bench.plant.qpos[bench.model.joint(name).id] = turned
    turned /= 2.0 + ("motor", "carrier1", "carrier2", "carrier3").index(name)
bench.plant.qpos[bench.model.joint("carrier3").id] += 0.05
none, no = np.zeros(8), np.zeros(8, np.bool_)
bench.start(power=False)
block = bench.advance(HandSamples(none, none, none, no, no, none))
print(json.dumps({"joints": joints, "names": block.topic("/gearbox").names, "bodies": bench.body_names,
                  "first": block.signals["/gearbox"][0].tolist(), "stiffness": stages["stage4"].stiffness,
                  "turns": [block.poses[0, bench.body_names.index(name), 5] for name in bench.body_names
                            if name.startswith("carrier3")]}))
"""


def test_a_further_stage_takes_two_files(tmp_path):
    """How many there can be is one number, and the parameters of each are declared."""
    found = run_there(copy_of_the_package(tmp_path, FOURTH_STAGE), FOUR_STAGES)
    assert found["joints"] == ["column", "limb", "motor", "carrier1", "carrier2", "carrier3", "crank"]
    assert found["names"] == [f"stage{k}_{what}" for k in range(1, 5) for what in ("twist", "torque", "friction")]
    held = 1.0 / 24.0 + 0.05
    twist, torque = found["first"][9:11]
    assert twist == pytest.approx(held / 5.0, rel=1e-12)
    assert torque == pytest.approx(found["stiffness"] * (held / 5.0 - 5e-4), rel=1e-6)
    assert found["turns"] == pytest.approx([np.sin(0.5 * held)], abs=1e-12)


SAMPLES = """
import json
import numpy as np
from cls_bench.bench import Bench
from cls_bench.hand import HandSamples
from cls_bench.parameters import Parameters

bench, found = Bench(Parameters(), seed=7), {}
bench.start(power=True)
yes, none = np.ones(8, np.bool_), np.zeros(8)
samples = bench.axes[0].record.samples
for first in range(0, 480, 8):
    bench.advance(HandSamples(none, none, none + 60.0, yes, yes, none + 0.5))
    for name in samples.dtype.names:
        found.setdefault(name, []).append(float(samples[name]))
print(json.dumps({"samples": found, "crank": float(bench.plant.qpos[bench.model.joint("crank").id])}))
"""


def test_a_sensor_takes_three_files_and_leaves_the_others_samples(tmp_path):
    """A potentiometer on the crank with noise of its own: the others sample on to the last bit."""
    assert len(CRANK_SENSOR) <= 3
    for name in ("before", "after"):
        (tmp_path / name).mkdir()
    before = run_there(copy_of_the_package(tmp_path / "before", {}), SAMPLES)
    after = run_there(copy_of_the_package(tmp_path / "after", CRANK_SENSOR), SAMPLES)
    new = np.array(after["samples"].pop("crank"))
    assert after == before
    assert len(set(before["samples"]["encoder"])) > 5
    assert np.ptp(new) > 1e-4
    assert (np.round(new / (1.6 / 2**16)) * 1.6 / 2**16 == pytest.approx(new, abs=1e-12))
    assert new[-1] == pytest.approx(after["crank"], abs=6e-3)


RECORD = """
import json
from pathlib import Path
from cls_bench import Recording, run

hand = 'hand = [{at = 0.0, kind = "step", to_N = 60.0}]'
Path("t.toml").write_text(f'title = "t"\\nduration = 0.01\\n{hand}')
result = run("t.toml", out=Path("out"), rerun=False)
drive = Recording(result.mcap).read("/drive")
names = "integral", "torque_command", "set_velocity", "velocity"
print(json.dumps({name: drive[name].tolist() for name in names}))
"""


def test_a_signal_takes_its_declaration(tmp_path):
    """One file; what is written and recorded, and what reads a recording, have it from then on."""
    assert len(SIGNAL) == 1
    found = run_there(copy_of_the_package(tmp_path, SIGNAL), RECORD)
    integral, torque, asked, velocity = (np.array(rows) for rows in found.values())
    assert len(integral) == 50
    # T = k_p e + integral: what is left of the torque but for the proportional part.
    np.testing.assert_allclose(integral, torque - 9.27e-5 * 2.0 * np.pi * 100.0 * (asked - velocity), atol=1e-12)
    assert np.ptp(integral) > 5e-4


EDDY_BRAKE = '''"""Eddy-current brake: a damper whose torque ends at ``most``."""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import Element, condition, damper, restore
from cls_bench.quantity import quantity


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    b, seat = feel.eddy_brake, piece.aft
    speed = piece.speed_ahead[seat]
    if b.damping * abs(speed) < b.most:
        damper(piece, seat, b.damping)
        condition(piece, seat, 0.0, -b.damping, b.most)
        condition(piece, seat, 0.0, b.damping, b.most)
    else:
        side = 1.0 if speed > 0.0 else -1.0
        restore(piece, seat, side * b.most)
        condition(piece, seat, 0.0, side * b.damping, -b.most)


class EddyBrake(Element):
    """T = max(-most, min(most, damping * speed))."""

    damping: float = quantity(0.0, "N·m·s/rad", "its damping", "none unless asked for", ge=0, le=100, live=True)
    most: float = quantity(1.0, "N·m", "its greatest torque", "assumed", ge=0, le=100, live=True)

    act = staticmethod(_act)
'''

EDDY_BRAKE_LISTED: Edits = {
    "feel/model.py": [
        ("from cls_bench.feel.elements.down_spring import DownSpring\n",
         "from cls_bench.feel.elements.down_spring import DownSpring\n"
         "from cls_bench.feel.elements.eddy_brake import EddyBrake\n"),
        ("    jam: Jam = Jam()\n", "    jam: Jam = Jam()\n    eddy_brake: EddyBrake = EddyBrake()\n"),
    ],
}  # fmt: skip

BRAKED = """
import json
from pathlib import Path
import numpy as np
from cls_bench import Recording, run
from cls_bench.feel import solver
from cls_bench.feel.element import PIECE
from cls_bench.feel.model import STATE, Feel
from cls_bench.parameters import Parameters, record_of

found = {}
for bodies, name in (("one", "velocity"), ("two", "aft_velocity")):
    feel = Feel(bodies=bodies, friction=0.0, damping=0.0, stiffness=0.0, eddy_brake={"damping": 5.0, "most": 2.0},
                aft={"damping": 0.0, "friction": 0.0, "inertia": 0.3}, linkage={"connected": False})
    record = record_of(Parameters(feel=feel)).feel
    state, piece = (np.zeros(1, dtype=kind).view(np.recarray)[0] for kind in (STATE, PIECE))
    state[name], found[bodies] = 1.0, []
    for k in range(400):
        solver.step(record, state, piece, 0.0, k * 4e-4, 4e-4)
        found[bodies].append(float(state[name]))

# A scenario has it too, and may change it while it runs.
hand = 'hand = [{at = 0.0, kind = "release"}]'
change = "changes = [{at = 0.004, parameters.feel.eddy_brake.damping = 7.0}]"
Path("t.toml").write_text(f'title = "t"\\nduration = 0.01\\n{hand}\\n{change}')
result = run("t.toml", set=["feel.eddy_brake.most=3"], out=Path("out"), rerun=False)
found["most"] = Recording(result.mcap).parameters["feel"]["eddy_brake"]["most"]
print(json.dumps(found))
"""


def test_a_feel_element_takes_its_file_and_a_line_in_the_list(tmp_path):
    """And that line's import. Its parameters, bounds and live changes are there at once, with one body and with two."""
    (_, replaced), = EDDY_BRAKE_LISTED.items()
    assert sum(new.count("\n") - old.count("\n") for old, new in replaced) == 2
    folder = copy_of_the_package(tmp_path, EDDY_BRAKE_LISTED)
    (folder / "cls_bench/feel/elements/eddy_brake.py").write_text(EDDY_BRAKE, encoding="utf-8")
    found = run_there(folder, BRAKED)
    time = 4e-4 * np.arange(1, 401)
    slow = 0.6 * 0.3 / 2.0  # from 1 rad/s it takes so long until 5 N·m·s/rad make less than 2 N·m
    speed = np.where(time < slow, 1.0 - 2.0 / 0.3 * time, 0.4 * np.exp(-5.0 / 0.3 * np.maximum(time - slow, 0.0)))
    np.testing.assert_allclose(found["one"], speed, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["two"], speed, rtol=0, atol=1e-12)
    assert found["most"] == 3.0
