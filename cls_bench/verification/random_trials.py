"""Random rigs and parameters: each runs with finite states and no warning of MuJoCo, or is refused with a reason."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, get_args

import numpy as np
from pydantic.fields import FieldInfo

from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.errors import InputError
from cls_bench.parameters import ARCMIN, PLANT, Column, Gearbox, Parameters, Section
from cls_bench.quantity import constraints
from cls_bench.scenario import Release, Scenario, Squeeze, Step
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

GROUP = "random trials"
TRIALS = 60
BOLD = 0.05
"""Share of the parameters that are drawn far from their defaults."""


def push(duration: float, release: float) -> Scenario:
    """A push, a grip that tightens, and a release: contacts close, friction reverses, the controller works."""
    return Scenario(
        title="random trial", duration=duration, hand=[Step(at=0.0, to_N=40.0), Release(at=release)],
        squeeze=[Squeeze(at=0.05, value=1.0)],
    )  # fmt: skip


SCENARIO = push(0.2, 0.15)

Draw = Callable[[], float]
"""A number from 0 to 1."""

KINDS: Mapping[str, Mapping[str, float]] = {
    "planetary": {},
    "spur": {"ratio": 3.0},
    "belt": {"ratio": 2.5, "teeth": 0, "backlash": 0.0, "stiffness": 0.5 / ARCMIN, "transmission_error": 0.0},
    "worm": {"ratio": 20.0, "teeth": 1, "efficiency": 0.5, "backdrive_efficiency": -1.0},
}
"""What a stage of each kind has otherwise than a planetary one."""


def random_rig(draw: Draw) -> Parameters:
    """A rig of 0 to 3 stages of any kind with a four-bar of any angles, or none; unchecked. 0 draws the thesis's."""
    p = Parameters()
    stages = (p.gearbox.stages + int(4.0 * draw())) % 4
    drawn = {}
    for k in range(1, stages + 1):
        kind = tuple(KINDS)[min(int(len(KINDS) * draw()), len(KINDS) - 1)]
        drawn[f"stage{k}"] = getattr(p.gearbox, f"stage{k}").model_copy(update={"kind": kind, **KINDS[kind]})
    angles = {f"{link}_angle": (draw() + 0.5) % 1.0 * 0.4 - 0.2 for link in ("crank", "rod", "arm")}
    kind = "none" if draw() > 0.75 else "four_bar"
    return p.model_copy(update={
        "gearbox": p.gearbox.model_copy(update={"stages": stages, **drawn}),
        "linkage": p.linkage.model_copy(update={"kind": kind, **angles}),
    })  # fmt: skip


def random_parameters(draw: Draw, *, bold: float) -> Parameters:
    """A random rig, each of its values within the declared bounds, and the nameplate that its data sheets give.

    Most lie within 10 % of the rig's; a share ``bold`` of them anywhere within three decades on either side, as far as
    their bounds allow; so do those of the nameplate, which a rig need not keep to. Raises ValueError where they
    contradict each other, as pydantic does.
    """
    rig = random_rig(draw)
    plant = rig.model_copy(update={name: _scattered(getattr(rig, name), draw, bold) for name in PLANT}).with_nameplate()
    others = [name for name in type(rig).model_fields if name not in (*PLANT, "rates")]
    values = {name: _scattered(getattr(plant, name), draw, bold) for name in others}
    return Parameters.model_validate(
        {**{name: getattr(plant, name) for name in PLANT}, **values, "rates": _rates(draw, bold)}
    )


def _scattered(section: Section, draw: Draw, bold: float) -> Section:
    return type(section)(**_values(section, draw, bold))


def _values(section: Section, draw: Draw, bold: float) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, info in type(section).model_fields.items():
        default = getattr(section, name)
        if isinstance(default, Section):
            values[name] = _scattered(default, draw, bold)
        elif isinstance(section, Gearbox) and name == "stages":
            values[name] = default  # is the rig's
        elif isinstance(default, bool):
            values[name] = default if draw() <= 1.0 - bold else not default
        elif isinstance(default, int | float):
            values[name] = _number(default, _bounds(info), draw, bold)
        else:
            values[name] = default
    if isinstance(section, Column):  # which come one after the other
        angles = ("travel", "switch_angle", "stop_angle")
        values.update(zip(angles, sorted(values[name] for name in angles), strict=True))
    return values


def _rates(draw: Draw, bold: float) -> dict[str, float]:
    """Cycles that are multiples of each other: a tick within 10 % of the default, boldly other numbers of them."""
    cycle = round(50_000 * 1.1 ** ((2.0 * draw() + 1.0) % 2.0 - 1.0)) * 1e-9

    def times(default: int) -> int:
        return default if draw() <= 1.0 - bold else 1 + int(4.0 * draw())

    velocity, bus = times(4), times(8)
    position, plc = velocity * times(2), bus * times(1)
    return {
        "current_cycle": cycle, "velocity_cycle": velocity * cycle, "position_cycle": position * cycle,
        "bus_cycle": bus * cycle, "plc_cycle": plc * cycle,
    }  # fmt: skip


def _bounds(info: FieldInfo) -> tuple[float, float]:
    """What a parameter may not go beyond, whether or not it may be there."""
    declared = constraints(info)
    low = declared.get("gt", declared.get("ge", -math.inf))
    return low, declared.get("lt", declared.get("le", math.inf))


def _number(default: float, bounds: tuple[float, float], draw: Draw, bold: float) -> Any:
    reach = 1000.0 if draw() > 1.0 - bold else 1.1
    exponent = (2.0 * draw() + 1.0) % 2.0 - 1.0  # 0 draws the default
    if default == 0.0 and reach == 1.1:
        return default
    value = default * reach**exponent if default else draw()
    low, high = bounds
    # Bounds may be open: keep a little away from them.
    inside = 1e-9 * max(1.0, abs(value))
    value = min(max(value, low + inside), high - inside)
    return round(value) if isinstance(default, int) else value


def random_values(draw: Draw, most: int = 5) -> dict[str, Any]:
    """Up to ``most`` parameters by key, each anywhere within its bounds, evenly or on a logarithmic scale."""
    known = list(_known(Parameters()))
    chosen = {int(draw() * len(known)) for _ in range(1 + int(draw() * most))}
    return {key: _anywhere(default, valid, draw) for key, default, valid in (known[k] for k in sorted(chosen))}


def _anywhere(default: Any, valid: tuple[Any, ...], draw: Draw) -> Any:
    if isinstance(default, str):
        return valid[min(int(draw() * len(valid)), len(valid) - 1)]
    if isinstance(default, bool):
        return draw() < 0.5
    low, high = valid
    share, way = draw(), draw()
    if low > 0.0 and way < 0.7:
        value = low * (high / low) ** share
    elif way < 0.7:  # from nought: its magnitude over eight decades
        value = math.copysign(max(high, -low) * 10.0 ** (-8.0 * share), low + draw() * (high - low))
    else:
        value = low + share * (high - low)
    value = min(max(value, low), high - 1e-9 * (high - low))
    return round(value) if isinstance(default, int) else value


def _known(section: Section, prefix: str = "") -> Iterator[tuple[str, Any, tuple[Any, ...]]]:
    """Key and value of each parameter, and what it may be: its bounds, or the words to choose from."""
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            yield from _known(value, f"{prefix}{name}.")
        elif isinstance(value, str):
            yield f"{prefix}{name}", value, get_args(info.annotation)
        else:
            yield f"{prefix}{name}", value, _bounds(info)


def accepted_trial(values: Mapping[str, Any]) -> str:
    """Outcome of the trial's start with ``values`` of parameters by key: ``"not accepted: …"``, or as :func:`trial`.

    What a scenario accepts has to be built: a refusal there is ``"refused: …"``.
    """
    try:
        scenario = push(0.06, 0.055).changed(values)
    except InputError as error:
        return f"not accepted: {error}"
    return trial(scenario.parameters_at_start(), 0, scenario)


def trial(parameters: Parameters, seed: int, scenario: Scenario = SCENARIO) -> str:
    """Outcome of ``scenario`` with ``parameters``: ``"ran"``, ``"refused: …"``, or what went wrong."""
    try:
        bench = Bench(parameters, seed=seed)
    except InputError as error:
        return f"refused: {error}"
    return _outcome(bench, scenario.on(parameters))


def _outcome(bench: Bench, scenario: Scenario) -> str:
    try:
        for block in scripted.run(bench, scenario):
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
