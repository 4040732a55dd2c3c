"""The thesis's chapter 4 on the bench: every shipped scenario passes its own checks, and what they mean together."""

import numpy as np
import pytest

from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import load_scenario
from tests.conftest import Runner

GAINS = ("drive", "plc", "motor", "gearbox", "linkage", "load_cell", "column", "limb", "encoder")


@pytest.mark.parametrize("name", shipped_scenarios())
def test_it_passes_its_own_checks(recorded: Runner, name: str) -> None:
    result = recorded(name)
    failed = {r.check.name: (r.value, r.check.min, r.check.max) for r in result.checks if not r.passed}
    assert result.status == "passed", failed


def test_all_use_one_set_of_gains_and_one_plant() -> None:
    for name in shipped_scenarios():
        assert set(load_scenario(name).parameters) <= {"feel"}, name


def test_friction_is_masked_ten_times_and_the_motion_is_smoother(recorded: Runner) -> None:
    result = recorded("friction_masking")
    assert result["breakout_off"] > 10.0 * result["breakout_on"]
    assert result["torque_ripple_off"] > 3.0 * result["torque_ripple_on"]
    assert result["velocity_ripple_off"] > 3.0 * result["velocity_ripple_on"]


def test_static_friction_is_the_feel_models_and_the_bearings(recorded: Runner) -> None:
    assert recorded("fcs_validation_1")["static_friction"] == pytest.approx(0.25 + 0.05, abs=0.02)
    for name in ("fcs_validation_2", "fcs_validation_3"):
        assert recorded(name)["static_friction"] == pytest.approx(2.0 + 0.05, abs=0.02)


def test_the_centering_unit_brings_the_column_closer_to_its_start(recorded: Runner) -> None:
    without, with_unit = recorded("fcs_validation_2"), recorded("fcs_validation_3")
    for way in ("forward", "aft"):
        assert without[f"{way}_rest_offset"] > 2.0
        assert with_unit[f"{way}_rest_offset"] < 0.2 * without[f"{way}_rest_offset"]


def test_the_sweep_reaches_both_travel_limits(recorded: Runner) -> None:
    feel = load_scenario("fcs_validation_1").parameters_at_start().feel
    angle = recorded("fcs_validation_1").recording().read("/column", ["angle"], 0.0, 26.0, every=8)["angle"]
    assert np.max(angle) > feel.forward_limit.angle
    assert np.min(angle) < -feel.forward_limit.angle


def test_both_loops_pass_the_first_feel_model(recorded: Runner) -> None:
    result = recorded("fcs_validation_1", "plc.outer_loop=velocity")
    assert result.status == "passed", {r.check.name: r.value for r in result.checks if not r.passed}


def test_thesis_outcome_stable_at_030_shaking_at_025_violent_at_015(recorded: Runner) -> None:
    normal = recorded("stability_moderate", "feel.inertia=0.30")
    assert normal["loose_amplitude"] < 0.01
    assert normal["squeezed_amplitude"] < 0.02
    moderate, severe = recorded("stability_moderate"), recorded("stability_severe")
    assert moderate["squeezed_amplitude"] > 10.0 * moderate["loose_amplitude"]
    assert severe["squeezed_amplitude"] > 2.0 * moderate["squeezed_amplitude"]
    for result in (moderate, severe):  # the loop's own frequency, far above voluntary motion
        assert 35.0 < result["squeezed_frequency"] < 80.0


@pytest.mark.parametrize("substeps", [2, 4])
def test_the_plants_step_is_converged(recorded: Runner, substeps: int) -> None:
    """Half and quarter of the 50 µs step move the tracked column angle by less than 0.02° r.m.s."""
    coarse = recorded("fcs_validation_1").recording().read("/column", ["angle"], every=8)["angle"]
    fine = recorded("fcs_validation_1", f"simulation.substeps={substeps}").recording()
    difference = np.degrees(fine.read("/column", ["angle"], every=8)["angle"] - coarse)
    assert np.sqrt(np.mean(difference**2)) < 0.02
