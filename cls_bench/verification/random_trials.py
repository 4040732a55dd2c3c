"""Random sets of parameters: each runs with finite states and no warning of MuJoCo, or is refused with a reason."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from cls_bench.bench import Bench
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, Section
from cls_bench.scenario import Scenario, parse_scenario
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

GROUP = "random trials"
TRIALS = 60
BOLD = 0.05
"""Share of the parameters that are drawn far from their defaults."""

SCENARIO = """
    title = "random trial"
    duration = 0.2
    [[hand]]
    at = 0.0
    kind = "step"
    to_N = 40.0
    [[squeeze]]
    at = 0.05
    value = 1.0
    [[hand]]
    at = 0.15
    kind = "release"
"""
"""A push, a grip that tightens, and a release: contacts close, friction reverses, the controller works."""

Draw = Callable[[], float]
"""A number from 0 to 1."""


def random_parameters(draw: Draw, *, bold: float) -> Parameters:
    """Parameters about the defaults, each within its declared bounds.

    Most lie within 10 % of their default; a share ``bold`` of them anywhere within three decades on either
    side, as far as their bounds allow. Raises ValueError where they contradict each other, as pydantic does.
    """
    return Parameters(**_sections(Parameters(), draw, bold))


def _sections(section: Section, draw: Draw, bold: float) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, info in type(section).model_fields.items():
        default = getattr(section, name)
        if isinstance(default, Section):
            values[name] = type(default)(**_sections(default, draw, bold))
        elif isinstance(default, bool):
            values[name] = default if draw() <= 1.0 - bold else not default
        elif isinstance(default, int | float):
            values[name] = _number(default, _bounds(info.metadata), draw, bold)
        else:
            values[name] = default
    return values


def _bounds(metadata: list[Any]) -> tuple[float, float]:
    low, high = -math.inf, math.inf
    for bound in metadata:
        low = max(low, getattr(bound, "ge", -math.inf), getattr(bound, "gt", -math.inf))
        high = min(high, getattr(bound, "le", math.inf), getattr(bound, "lt", math.inf))
    return low, high


def _number(default: float, bounds: tuple[float, float], draw: Draw, bold: float) -> Any:
    reach = 1000.0 if draw() > 1.0 - bold else 1.1
    exponent = (2.0 * draw() + 1.0) % 2.0 - 1.0  # 0 draws the default
    value = default * reach**exponent if default else (draw() if reach > 1.1 else 0.0)
    low, high = bounds
    # Bounds may be open: keep a little away from them.
    inside = 1e-9 * max(1.0, abs(value))
    value = min(max(value, low + inside), high - inside)
    return round(value) if isinstance(default, int) else value


def random_overrides(draw: Draw, most: int = 5) -> list[str]:
    """Up to ``most`` parameters as ``KEY=VALUE``, each anywhere within its bounds, evenly or on a logarithmic scale."""
    known = [(key, value, info) for key, value, info in _numeric(Parameters())]
    chosen = {int(draw() * len(known)) for _ in range(1 + int(draw() * most))}
    overrides = []
    for number in sorted(chosen):
        key, default, (low, high) = known[number]
        if isinstance(default, bool):
            overrides.append(f"{key}={str(draw() < 0.5).lower()}")
            continue
        share, way = draw(), draw()
        if low > 0.0 and way < 0.7:
            value = low * (high / low) ** share
        elif way < 0.7:  # from nought: its magnitude over eight decades
            value = math.copysign(max(high, -low) * 10.0 ** (-8.0 * share), low + draw() * (high - low))
        else:
            value = low + share * (high - low)
        value = min(max(value, low), high - 1e-9 * (high - low))
        overrides.append(f"{key}={round(value) if isinstance(default, int) else repr(value)}")
    return overrides


def _numeric(section: Section, prefix: str = "") -> Iterator[tuple[str, Any, tuple[float, float]]]:
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from _numeric(value, f"{prefix}{name}.")
        elif isinstance(value, int | float):
            yield f"{prefix}{name}", value, _bounds(info.metadata)


def accepted_trial(overrides: list[str]) -> str:
    """Outcome of the trial's start with ``overrides``: ``"not accepted: …"``, or as :func:`trial`.

    What a scenario accepts has to be built: a refusal there is ``"refused: …"``.
    """
    try:
        scenario = parse_scenario(SCENARIO.replace("0.2", "0.06", 1).replace("0.15", "0.05"), set=overrides)
    except InputError as error:
        return f"not accepted: {error}"
    try:
        bench = Bench(scenario.parameters_at_start())
    except InputError as error:
        return f"refused: {error}"
    return _outcome(bench, scenario)


def trial(parameters: Parameters, seed: int) -> str:
    """Outcome of 0.2 s with ``parameters``: ``"ran"``, ``"refused: …"``, or what went wrong."""
    scenario = parse_scenario(SCENARIO)
    try:
        bench = Bench(parameters, seed=seed)
    except InputError as error:
        return f"refused: {error}"
    return _outcome(bench, scenario)


def _outcome(bench: Bench, scenario: Scenario) -> str:
    try:
        for block in bench.run(scenario):
            for topic, rows in block:
                if not np.all(np.isfinite(rows)):
                    return f"not finite: {topic.path}"
    except Exception as error:  # whatever it is, it is the result of the trial
        return f"{type(error).__name__}: {error}"
    warnings = [i for i, warning in enumerate(bench.data.warning) if warning.number]
    return f"MuJoCo warning {warnings[0]}" if warnings else "ran"


def trials(subject: Subject) -> Iterator[Row]:
    """Count the trials that neither run nor are refused."""
    rng = np.random.default_rng(1)
    outcomes: list[str] = []
    while len(outcomes) < TRIALS:
        try:
            parameters = random_parameters(rng.random, bold=BOLD)
        except ValueError:
            continue  # refused by the parameters themselves, with a reason
        outcomes.append(trial(subject.alter(parameters), len(outcomes)))
    failed = [outcome for outcome in outcomes if outcome != "ran" and not outcome.startswith("refused")]
    yield Row(GROUP, f"trials of {TRIALS} that failed", "1", 0.0, "run 0.2 s, or refused with a reason",
              float(len(failed)), 0.0, relative=False)  # fmt: skip
    refused = sum(outcome.startswith("refused") for outcome in outcomes)
    yield Row(GROUP, f"trials of {TRIALS} that were refused", "1", 0.0, "half at most, or the trials would say little",
              float(refused), TRIALS / 2.0, relative=False)  # fmt: skip
