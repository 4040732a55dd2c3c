"""Where the running bench turns unstable: the gate that fails when the onset moves. Also the map and what helps."""

import json
import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from cls_bench.cli import main
from cls_bench.control.outer_loop import Command
from cls_bench.errors import InputError
from cls_bench.linear.hand import Hand, forward_inertia
from cls_bench.linear.variation import Setup, changed, ideal, variation
from cls_bench.parameters import Parameters
from cls_bench.stability import figures, onset, trial
from cls_bench.stability.loops import BuiltIn
from cls_bench.stability.map import Grid, compute
from cls_bench.stability.stabilisers import compare, stabilisers
from cls_bench.stability.trial import STILL, Standard

RECORDED_ONSET = 0.268
"""I_fcs [kg·m²] at which the shipped bench turns unstable under a tight grip (docs/stability.md)."""


def at(inertia: float, squeeze: float | None = 1.0, **changes: object) -> Setup:
    p = changed(Parameters(), "feel.inertia", inertia)
    for key, value in changes.items():
        p = changed(p, key.replace("__", "."), value)
    return Setup(p, Hand(squeeze))


def find(setup: Setup, name: str, low: float, high: float, tolerance: float = 0.05) -> float:
    found = onset.find(setup, variation(name, low, high), tolerance=tolerance, follow=False)
    assert found.value is not None
    return found.value


# The shipped bench


@pytest.fixture(scope="module")
def shipped() -> onset.Onset:
    return onset.find(Setup(), variation("feel.inertia", 0.15, 0.6))


def test_onset_of_the_shipped_bench_is_where_it_was(shipped):
    assert shipped.value == pytest.approx(RECORDED_ONSET, rel=0.05)
    assert 0.0 < shipped.stable_at - shipped.unstable_at <= 0.02 * shipped.stable_at


def test_the_onset_is_reported_with_its_limit_cycle_and_both_predictions(shipped):
    assert 35 < shipped.last_unstable.frequency < 60
    assert 0.01 < shipped.last_unstable.amplitude_deg < 0.5
    assert not shipped.last_unstable.stable
    # Eq. 3.16 is optimistic, the linear model less so; backlash takes the rest.
    assert shipped.rule < shipped.predicted < shipped.value


def test_the_thesis_s_three_outcomes():
    calm, moderate, severe = (trial.run(at(inertia), follow=True) for inertia in (0.30, 0.25, 0.15))
    assert calm.stable
    assert not moderate.stable and not severe.stable
    assert severe.amplitude_deg > 2.0 * moderate.amplitude_deg > 0.05
    for inertia in (0.25, 0.15):
        assert trial.run(at(inertia, squeeze=0.0)).stable


def test_stable_below_and_unstable_above_the_onset_when_forward_inertia_rises():
    limit = find(at(0.3), "forward_inertia", 0.1, 0.5, tolerance=0.02)
    here = variation("forward_inertia")
    for factor in (0.5, 0.9):
        assert trial.run(here.apply(at(0.3), factor * limit)).stable, factor
    for factor in (1.1, 2.0):
        assert not trial.run(here.apply(at(0.3), factor * limit)).stable, factor


def test_more_simulated_inertia_carries_more_limb():
    limits = [find(at(inertia), "limb_mass", 0.5, 8.0) for inertia in (0.2, 0.35, 0.6)]
    assert limits == sorted(limits)
    assert limits[-1] > 1.5 * limits[0]


def test_more_delay_carries_less_limb():
    limits = [find(at(0.3, plc__command_latency=n), "limb_mass", 0.5, 8.0) for n in (0, 2, 4)]
    assert limits == sorted(limits, reverse=True)
    assert limits[-1] < 0.85 * limits[0]


def test_a_tighter_grip_asks_for_more_simulated_inertia():
    limits = [find(at(0.3, squeeze), "feel.inertia", 0.02, 0.8) for squeeze in (0.0, 0.5, 1.0)]
    assert limits == sorted(limits)
    assert limits[-1] > 2.0 * limits[0]


def test_onset_with_two_bodies_is_the_linear_model_s():
    p = changed(ideal(Parameters()), "feel.bodies", "two")
    found = onset.find(Setup(p), variation("feel.inertia", 0.15, 0.35), STILL, tolerance=0.01, follow=False)
    assert found.value == pytest.approx(found.predicted, rel=0.01)
    one = onset.find(Setup(ideal(Parameters())), variation("feel.inertia", 0.15, 0.35), STILL, tolerance=0.01,
                     follow=False)  # fmt: skip
    assert found.predicted > 1.01 * one.predicted  # it is another model


def test_two_bodies_of_the_bench_as_it_is_have_an_onset_over_limb_and_simulated_inertia():
    setup = Setup(changed(at(0.3).parameters, "feel.bodies", "two"), Hand(1.0))
    assert find(setup, "feel.inertia", 0.1, 0.8) == pytest.approx(RECORDED_ONSET, rel=0.15)
    limit = find(setup, "forward_inertia", 0.1, 0.5)
    assert 0.15 < limit < 0.3


# The trial


def test_a_trial_ends_as_soon_as_it_is_decided():
    p = ideal(Parameters())
    for inertia, stable in ((0.19, False), (0.23, True)):
        verdict = trial.run(Setup(changed(p, "feel.inertia", inertia)), STILL)
        assert verdict.stable == stable
        assert verdict.simulated < 0.7


def test_a_trip_is_unstable():
    verdict = trial.run(at(0.05, plc__following_error_limit=0.01))
    assert not verdict.stable
    assert verdict.reason == "trip"


def test_too_fast_a_motion_is_refused():
    with pytest.raises(InputError, match="move slower"):
        Standard(rate_deg=60.0)


def test_a_loop_of_one_s_own_gets_the_same_verdicts_as_the_built_in_one():
    for inertia, stable in ((0.2, False), (0.4, True)):
        assert trial.run(at(inertia), make_loop=BuiltIn).stable == stable

    class Stiff:
        def step(self, inputs):
            return Command(0.0)

    assert trial.run(at(0.05), make_loop=lambda p: Stiff()).stable


def test_a_range_without_onset_says_which_way():
    found = onset.find(Setup(), variation("feel.inertia", 0.5, 1.0), follow=False)
    assert found.value is None and found.unstable_at is None and found.stable_at is not None


# Map and measures


def test_map_is_resumable_and_has_the_thesis_s_points(tmp_path):
    grid = Grid(variation("feel.inertia", 0.12, 0.8), variation("forward_inertia", 0.06, 0.6), 3, 3)
    setup, journal = Setup(ideal(Parameters())), tmp_path / "points.jsonl"
    first = compute(setup, grid, STILL, journal=journal)
    assert len(first.rows) == 9 + 3
    assert not any(row.error for row in first.rows)
    assert first.agreement == 1.0
    lines = journal.read_text().splitlines(keepends=True)
    journal.write_text("".join(lines[:5]))
    seen = []
    again = compute(setup, grid, STILL, journal=journal, resume=True, report=lambda done, total: seen.append(done))
    assert seen[0] == 4
    assert again.rows == first.rows
    thesis = first.rows[9:]
    assert [row.point["feel.inertia"] for row in thesis] == [0.30, 0.25, 0.15]
    assert thesis[0].point["forward_inertia"] == pytest.approx(forward_inertia(Parameters(), Hand()))
    assert first.rule_ratio == pytest.approx(1.27, abs=0.05)
    assert figures.stability_map(first).axes[0].get_xlabel() == "simulated inertia I_fcs [kg·m²]"


def test_velocity_feed_forward_helps_and_a_faster_position_controller_does_not():
    chosen = [s for s in stabilisers(Parameters()) if s.name in
              ("none", "feed-forward of the set velocity", "position controller 60 instead of 35 Hz")]  # fmt: skip
    none, ahead, faster = compare(Setup(ideal(Parameters())), STILL, measures=chosen)
    assert ahead.simulated < 0.7 * none.simulated < none.simulated < 0.7 * faster.simulated
    for row in (none, ahead, faster):
        assert row.predicted == pytest.approx(row.simulated, rel=0.08)
    assert len(figures.stabilisers([none, ahead, faster], 2.0).axes[0].patches) == 3


# The command line


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(main, arguments)
    return result.exit_code, result.output


def test_gate_passes_and_fails_by_its_exit_code():
    status, output = invoke("check", "onset", "--ideal", "--min-ratio", "0.5", "--json")
    assert status == 0
    found = json.loads(output)
    assert found["status"] == "passed"
    assert found["ratio"] == pytest.approx(0.86, abs=0.05)
    assert found["ratio"] == pytest.approx(found["critical_forward_inertia"] / 0.3)
    assert found["present_forward_inertia"] == pytest.approx(0.2017, abs=1e-4)
    assert found["margin"] == pytest.approx(found["critical_forward_inertia"] / 0.20169 - 1.0, abs=1e-3)
    status, output = invoke("check", "onset", "--ideal", "--min-ratio", "1.5")
    assert status == 1
    assert output.startswith("FAILED: onset at I_fwd = 0.2")


def test_gate_fails_when_the_present_hand_is_beyond_the_onset():
    status, output = invoke("check", "onset", "--ideal", "--min-ratio", "0.7", "--set", "feel.inertia=0.2")
    assert status == 1
    assert "THE PRESENT HAND IS BEYOND THE ONSET" in output
    assert "margin -5" in output


def test_gate_asks_for_a_margin():
    assert invoke("check", "onset", "--ideal", "--min-margin", "0.1")[0] == 0
    status, output = invoke("check", "onset", "--ideal", "--min-margin", "0.6", "--json")
    assert status == 1
    assert json.loads(output)["status"] == "failed"


def test_predict_command():
    status, output = invoke("predict", "--set", "feel.inertia=0.15", "--json")
    found = json.loads(output)
    assert status == 0
    assert found["stable"] is False
    assert found["gain_margin"] < 1.0
    assert found["rule"]["critical_ratio"] == pytest.approx(1.27, abs=0.05)
    assert math.isclose(found["critical"]["squeeze"], 0.4965, rel_tol=0.02)


def test_onset_command_with_a_controller_of_one_s_own(tmp_path, monkeypatch):
    (tmp_path / "my_loop.py").write_text("from cls_bench.stability.loops import BuiltIn as make\n")
    monkeypatch.chdir(tmp_path)
    status, output = invoke(
        "onset", "--ideal", "--from", "0.15", "--to", "0.3", "--tolerance", "0.2", "--controller", "my_loop:make",
        "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(output[output.index("{") :])
    assert found["predicted"] is None
    assert found["onset"] == pytest.approx(0.21, rel=0.15)


def test_frequency_response_command(tmp_path):
    status, output = invoke(
        "frequency-response", "outer-loop", "--ideal", "--excitation", "stepped-sine", "--amplitude", "0.05",
        "--from-hz", "20", "--to-hz", "80", "--points", "6", "--out", str(tmp_path), "--json",
    )  # fmt: skip
    assert status == 0
    found = json.loads(output)
    assert {Path(path).name for path in found["files"]} == {
        "open.csv", "bode_open.svg", "bode_open.png", "nyquist.svg", "nyquist.png"
    }  # fmt: skip
    assert 45 < found["numbers"]["open"]["phase_crossover_Hz"] < 60


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("onset", "--vary", "mass"), 'vary = "mass": must be limb_mass'),
        (("onset", "--grip", "2"), "--grip 2: must be a number from 0"),
        (("onset", "--controller", "no_such:thing"), "--controller no_such:thing: there is no module no_such"),
        (("onset", "--controller", "math:no"), "--controller math:no: defines no no"),
        (("check", "onset"), "give --min-ratio, --min-margin, or both"),
        (("check", "onset", "--min-ratio", "nan"), "not a finite number"),
        (("check", "onset", "--min-ratio", "-1"), "--min-ratio"),
        (("check", "onset", "--min-margin", "inf"), "--min-margin"),
        (("onset", "--from", "nan"), "not a finite number"),
        (("onset", "--seed", str(2**63)), "--seed"),
        (("onset", "--from", "3", "--to", "1"), "must grow"),
        (("onset", "--rate-deg", "90"), "move slower"),
        (("predict", "--set", "feel.inertia=-1"), "feel.inertia"),
    ],
)
def test_bad_input_is_one_line(arguments, message):
    status, output = invoke(*arguments)
    assert status == 2
    assert message in output
    assert len(output.strip().splitlines()) == 1
