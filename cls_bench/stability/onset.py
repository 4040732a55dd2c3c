"""Onset search: at which value of a quantity does the running bench turn unstable?

Bisection between a stable and an unstable value, on a logarithmic scale, until the bracket is narrower than 2 %. The
first two trials are at the ends of the range; which of them is stable also tells the direction.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from cls_bench.linear.cycle import Compensation
from cls_bench.linear.hand import limb_mass_for
from cls_bench.linear.prediction import critical, rule
from cls_bench.linear.variation import Setup, Variation
from cls_bench.parameters import ControlParameters
from cls_bench.stability import trial
from cls_bench.stability.loops import BuiltIn, InertiaCompensated, MakeLoop
from cls_bench.stability.trial import Standard, Verdict

TOLERANCE = 0.02
"""Width of the final bracket over its value."""


@dataclass(frozen=True)
class Onset:
    """Where the bench turns unstable."""

    vary: Variation
    value: float | None
    """in the middle of the bracket; None if both ends of the range are alike"""
    stable_at: float | None
    """the stable end of the bracket (of the range if there is no onset); None if nothing is stable"""
    unstable_at: float | None
    last_unstable: Verdict | None
    """the trial at the unstable end; with ``follow`` run to its end, so that it shows the limit cycle"""
    predicted: float | None
    """by the linear model"""
    rule: float | None
    """by Eq. 3.16; None where the rule does not say"""
    trials: int
    """trials in the search"""
    simulated: float
    """time simulated in all [s]"""


def find(
    setup: Setup,
    vary: Variation,
    standard: Standard | None = None,
    *,
    tolerance: float = TOLERANCE,
    make_loop: MakeLoop | None = None,
    compensation: Compensation | None = None,
    follow: bool = True,
    report: Callable[[float, Verdict], None] = lambda value, verdict: None,
) -> Onset:
    """Search the onset of ``setup`` over ``vary``.

    ``make_loop`` is a user's own outer loop; for it there is no prediction. ``compensation`` wraps the built-in loop
    instead and is part of the prediction. ``follow`` runs the last unstable value to its end, for the amplitude of the
    limit cycle. ``report`` is told every trial. Raises InputError for values that the bench cannot have.
    """
    with threadpool_limits(1):  # the small matrices of fits and predictions gain nothing from BLAS threads
        return _find(setup, vary, standard, tolerance, make_loop, compensation, follow, report)


def _find(
    setup: Setup,
    vary: Variation,
    standard: Standard | None,
    tolerance: float,
    make_loop: MakeLoop | None,
    compensation: Compensation | None,
    follow: bool,
    report: Callable[[float, Verdict], None],
) -> Onset:
    predicted = critical(setup, vary, compensation) if make_loop is None else None
    if compensation is not None:
        make_loop = compensated(compensation)
    done: dict[float, Verdict] = {}

    def run(value: float) -> Verdict:
        verdict = trial.run(vary.apply(setup, value), standard, make_loop=make_loop)
        done[value] = verdict
        report(value, verdict)
        return verdict

    low, high = vary.low, vary.high
    at_low, at_high = run(low), run(high)
    value = None
    stable, unstable = (low, high) if at_low.stable else (high, low)
    if at_low.stable == at_high.stable:
        stable_at, unstable_at = (high, None) if at_low.stable else (None, high)
    else:
        while not _narrow(stable, unstable, vary, tolerance):
            middle = _between(stable, unstable, vary)
            if run(middle).stable:
                stable = middle
            else:
                unstable = middle
        stable_at, unstable_at = stable, unstable
        value = unstable if vary.whole else math.sqrt(stable * unstable) if low > 0 else 0.5 * (stable + unstable)
    simulated = sum(verdict.simulated for verdict in done.values())
    last = None if unstable_at is None else done[unstable_at]
    if unstable_at is not None and follow:
        last = trial.run(vary.apply(setup, unstable_at), standard, make_loop=make_loop, follow=True)
        simulated += last.simulated
    return Onset(
        vary, value, stable_at, unstable_at, last, predicted, _by_rule(setup, vary), len(done), simulated
    )


def compensated(compensation: Compensation) -> MakeLoop:
    """The built-in loop with post-sensor inertia compensation."""

    def make(parameters: ControlParameters) -> InertiaCompensated:
        return InertiaCompensated(BuiltIn(parameters), compensation, parameters.rates.plc_cycle)

    return make


def _narrow(one: float, other: float, vary: Variation, tolerance: float) -> bool:
    if vary.whole:
        return abs(one - other) <= 1
    return abs(one - other) <= tolerance * max(abs(one), abs(other))


def _between(one: float, other: float, vary: Variation) -> float:
    if vary.whole:
        return float(round(0.5 * (one + other)))
    return math.sqrt(one * other) if vary.low > 0 else 0.5 * (one + other)


def _by_rule(setup: Setup, vary: Variation) -> float | None:
    """Where Eq. 3.16 sees the onset; it speaks of the two inertias only."""
    if vary.name not in ("feel.inertia", "forward_inertia", "limb_mass"):
        return None
    found = rule(setup)
    inertia = setup.parameters.feel.inertia
    if vary.name == "feel.inertia":
        return found.ratio * inertia / found.critical_ratio
    forward = found.critical_ratio * inertia
    if vary.name == "forward_inertia":
        return forward
    return limb_mass_for(setup.parameters, forward)
