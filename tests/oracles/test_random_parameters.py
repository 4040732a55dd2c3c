"""Parameters drawn by hypothesis within their bounds: each set runs, or is refused with a reason."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from cls_bench.analysis.energy import audit
from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.errors import InputError
from cls_bench.scenario import DriveStart, Scenario, Sine
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


def test_the_books_of_random_rigs_balance() -> None:
    """Swept by hand without power, so that all that goes in and out is recorded at every tick."""
    sweep = Scenario(
        title="sweep", duration=0.5, drive=DriveStart(power="off"),
        hand=[Sine(at=0.0, amplitude_deg=10.0, frequency=2.0, fade=0.1)],
    )  # fmt: skip
    rng = np.random.default_rng(4)
    rigs = set()
    balanced = 0
    while balanced < 40:
        try:
            p = random_parameters(rng.random, bold=0.0)
            bench = Bench(p)
        except (ValueError, InputError):
            continue
        books = audit(scripted.run(bench, sweep.on(p)), p)
        assert abs(books.relative_residual) < 1e-3, p
        assert max(*books.returned.values(), -min(books.losses.values())) < 1e-3 * books.throughput, p
        rigs.add((p.gearbox.stages, p.linkage.kind))
        balanced += 1
    assert len(rigs) == 8  # each number of stages with a four-bar and without
