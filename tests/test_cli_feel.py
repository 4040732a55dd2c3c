"""``cls-bench feel``: what it says of a feel model, and what it says of nonsense."""

import json
import math
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from cls_bench.analysis.free_response import forward_inertia
from cls_bench.cli import main
from cls_bench.parameters import Parameters

SPRUNG = """
title = "A spring"
duration = 2.0
[parameters.feel]
stiffness = 60.0
friction = 0.5
[[hand]]
at = 0.0
kind = "hold"
angle_deg = 0.0
[[changes]]
at = 1.0
parameters = { feel.neutral = 0.02, feel.jam.of = "none" }
"""


@pytest.fixture
def sprung(tmp_path: Path) -> Path:
    path = tmp_path / "sprung.toml"
    path.write_text(SPRUNG)
    return path


def feel(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, ["feel", *map(str, arguments)])


@pytest.mark.parametrize(("at", "neutral"), [(0.0, 0.0), (1.5, 0.02)])
def test_a_spring_with_friction(sprung, tmp_path, at, neutral):
    """c (φ − φ₀) ± μ at the angles asked for, with the parameters of that time; let go, it swings as they say."""
    said = feel(sprung, "--at", at, "--angle-deg", "6", "--angle-deg", "-3", "--json", "--out", tmp_path / "out")
    assert said.exit_code == 0, said.stderr
    found = json.loads(said.stdout)
    for row, degrees in zip(found["curve"], (6.0, -3.0), strict=True):
        for key, way in (("there", math.copysign(1.0, degrees)), ("back", -math.copysign(1.0, degrees))):
            torque = 60.0 * (math.radians(degrees) - neutral) + way * 0.5
            assert row[f"{key}_Nm"] == pytest.approx(torque, abs=1e-9)
            assert row[f"{key}_N"] == pytest.approx(torque / 0.30, abs=1e-9)
    inertia, damping = 0.3 + forward_inertia(Parameters()), 1.5 + Parameters().column.viscous_friction
    frequency = math.sqrt(60.0 / inertia - (damping / (2.0 * inertia)) ** 2) / (2.0 * math.pi)
    assert found["free_response"]["frequency"] == pytest.approx(frequency, rel=0.01)  # whatever the friction
    assert all(Path(path).stat().st_size > 1000 for path in found["figures"])


def test_it_may_be_let_go_at_zero(sprung, tmp_path):
    """Zero is an angle, not the lack of one: with a neutral elsewhere it swings there."""
    without = "--set", "feel.friction=0"
    said = feel(sprung, "--at", 1.5, "--release-deg", 0, *without, "--json", "--out", tmp_path / "out")
    found = json.loads(said.stdout)
    assert found["release_deg"] == 0.0
    assert found["free_response"]["overshoot"] > 0.1


@pytest.mark.parametrize(("arguments", "said"), [
    (["--angle-deg", "90"], "--angle-deg 90: the sweep is from -17.5 to 17.5; --travel-deg sets it"),
    (["--travel-deg", "5", "--release-deg", "-6"], "--release-deg -6: the sweep is from -5 to 5; --travel-deg sets it"),
    (["--at", "2.5"], "--at 2.5: FILE ends at 2 s"),
    (["--set", "feel.jam.of=aft"], "FILE: parameters.feel.jam.of: the column is jammed then, and no torque leads it"),
    (["--set", "feel.jam.of=forward", "--set", 'feel.bodies="two"'],
     "FILE: parameters.feel.jam.of: the column is jammed then, and no torque leads it"),
])  # fmt: skip
@pytest.mark.parametrize("form", [[], ["--json"]])
def test_nonsense_is_one_line(sprung, tmp_path, arguments, said, form):
    """Not the torque of the sweep's end, nor numbers that are none."""
    result = feel(sprung, *arguments, *form, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr == f"error: {said.replace('FILE', str(sprung))}\n"
    assert result.stdout == ""
    assert not (tmp_path / "out").exists()
