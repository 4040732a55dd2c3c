"""What a two-body feel model asks for is what the bench gives at the grip: the published signatures, drive on."""

import numpy as np
import pytest

from cls_bench.analysis.quasi_static import static_curve
from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.parameters import DEG
from cls_bench.scenario import Scenario
from tests.oracles.feel_signatures import ANGLES, BASE, SIGNATURES
from tests.running import collected

TOLERANCE = 0.3, 0.02
"""Of the torque at the grip: the greater of so many N·m and that share."""

BEARING, BEARING_DAMPING = 0.05, 0.05
"""Of the column itself [N·m, N·m·s/rad]: in front of the load cell, so no feel model takes it away."""

PLAY, STIFFNESS = 0.08 * DEG, 13e3
"""What lies between the model and the column [rad, N·m/rad]: play, lag, and the least stiffness that the drive train
has been seen to give, whatever a model asks for.
"""

AIMS = {"jammed": 34.5, "override": 31.0}
"""How far the arm aims [°]: its own stiffness gives way. 5° against the jam are 79 N·m, near the load cell's end."""

SPEED = 0.05
"""What damping adds in the reference's sweep [N·m]: some 0.05 rad/s on 0.7 N·m·s/rad."""

REACHED = {"jammed": ANGLES[:1]}
"""Angles that the rig can hold, where it is not all."""


def scenario(name: str, aim: float) -> Scenario:
    feel = {**BASE, **SIGNATURES[name].changes, "inertia": 0.3}  # at rest the inertia does not count
    return Scenario.model_validate({
        "title": name, "duration": 17.0,
        "parameters": {"feel": feel},
        "hand": [
            {"at": 0.0, "kind": "hold", "angle_deg": 0.0},
            {"at": 0.5, "kind": "ramp", "to_deg": aim, "over": 8.0},
            {"at": 9.0, "kind": "ramp", "to_deg": -2.0, "over": 8.0},
        ],
        "squeeze": [{"at": 0.0, "value": 0.35}],
    })  # fmt: skip


def passing(
    model: np.ndarray, torque: np.ndarray, column: np.ndarray, at: float, rising: bool
) -> tuple[float, float, float]:
    """Torque [N·m], the model's speed [rad/s] and how far the column is from it [rad], where it passes ``at`` [rad] on
    the way there or on the way back; averaged over a tenth of a degree.
    """
    top = int(np.argmax(model))
    part = slice(None, top) if rising else slice(top, None)
    near = np.flatnonzero(np.abs(model[part] - at) < 0.05 * DEG)
    assert len(near) > 10, f"the model does not pass {at / DEG:g}°, but reaches {model.max() / DEG:.2f}°"
    k = near + (0 if rising else top)
    speed = (model[k[-1]] - model[k[0]]) / ((k[-1] - k[0]) * 4e-4)
    return float(np.mean(torque[k])), float(speed), float(np.mean(column[k] - model[k]))


@pytest.mark.parametrize("name", SIGNATURES)
def test_signature(name: str) -> None:
    """Torque at the grip where the model is at the angle; the column itself is the drive train's stretch behind it."""
    tried = scenario(name, AIMS.get(name, 29.0))
    bench = Bench(tried.parameters_at_start())
    run = collected(bench, scripted.run(bench, tried))
    assert run.error is None and not bench.trips
    model, column, torque = run["/feel.angle"], run["/column.angle"][::8], run["/column.torque"][::8]
    feel = tried.parameters_at_start().feel
    there = [at * DEG for at in REACHED.get(name, ANGLES)]
    path = np.concatenate([[0.0], there, [max(model.max(), there[-1])], there[::-1], [0.0]])
    asked = static_curve(feel, path)
    worst = behind = 0.0
    for k, at in enumerate(there):
        assert asked[1 + k] == pytest.approx(SIGNATURES[name].forward[k], abs=SIGNATURES[name].rounding + SPEED)
        for rising, wanted in ((True, asked[1 + k]), (False, asked[-2 - k])):
            felt, speed, stretch = passing(model, torque, column, at, rising)
            own = np.sign(speed) * BEARING + speed * (feel.damping + feel.aft.damping + BEARING_DAMPING)
            worst = max(worst, abs(felt - own - wanted) / max(TOLERANCE[0], TOLERANCE[1] * abs(wanted)))
            behind = max(behind, abs(stretch) / (PLAY + abs(felt) / STIFFNESS))
    print(f"{name}: {worst:.2f} of the tolerance; the column is behind by {behind:.2f} of play and stretch")
    assert worst < 1.0
    assert behind < 1.0
