"""Parameters drawn by hypothesis within their bounds: each set runs, or is refused with a reason."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from cls_bench.verification.random_trials import accepted_trial, random_parameters, random_values, trial


def check(data: st.DataObject, bold: float) -> None:
    # One seed rather than a hundred numbers: hypothesis has nothing to shrink in a set that fails as a whole.
    random = data.draw(st.randoms(use_true_random=False, note_method_calls=False))
    try:
        parameters = random_parameters(random.random, bold=bold)
    except ValueError:
        reject()  # refused by the parameters themselves
    outcome = trial(parameters, seed=0)
    assert outcome == "ran" or outcome.startswith("refused: parameters.")


def profile(examples: int) -> settings:
    return settings(
        max_examples=examples, deadline=None, derandomize=True, database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
    )  # fmt: skip


@profile(25)
@given(st.data())
def test_near_the_defaults(data: st.DataObject) -> None:
    check(data, bold=0.02)


@pytest.mark.slow
@profile(200)
@given(st.data())
def test_far_from_the_defaults(data: st.DataObject) -> None:
    check(data, bold=0.1)


def accepted(count: int, seed: int) -> None:
    """``count`` sets of up to five parameters that a scenario accepts: each is built, and runs or says it diverges."""
    rng = np.random.default_rng(seed)
    tried = ran = 0
    while ran < count:
        values = random_values(rng.random)
        outcome = accepted_trial(values)
        tried += 1
        if not outcome.startswith("not accepted"):
            ran += 1
            assert outcome == "ran" or outcome.startswith("DivergedError: diverged at t"), (values, outcome)
    assert tried < 2.5 * count  # or the bounds would say little


def test_what_a_scenario_accepts_can_be_run() -> None:
    accepted(60, seed=1)


@pytest.mark.slow
def test_much_of_what_a_scenario_accepts_can_be_run() -> None:
    accepted(500, seed=2)
