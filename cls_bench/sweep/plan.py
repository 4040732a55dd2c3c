"""The sweep file: a scenario, the axes along which it varies, and the metrics to collect.

.. code-block:: toml

    title = "Tight grip over the rendered inertia"
    scenario = "stability_moderate"      # shipped, or a file beside this one
    samples = 50                         # draws of the random axes, for each combination of the others
    design = "latin_hypercube"
    seed = 1

    [[axes]]
    key = "feel.inertia"                 # what `cls-bench run --set` takes
    kind = "range"                       # list, range, log_range; uniform, log_uniform, normal
    from = 0.15
    to = 0.5
    count = 8

    [[axes]]
    key = "limb.mass"
    kind = "normal"
    mean = 1.8
    deviation = 0.3

Axes with listed values are combined with each other, the last one varying fastest; the same draws of the random axes
go with every combination. Values are SI, as in ``--set``.
"""

import itertools
import math
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from cls_bench.controllers import fingerprint
from cls_bench.errors import InputError
from cls_bench.input.faults import nearest, shown
from cls_bench.input.tables import IN_FILE
from cls_bench.input.toml_file import read_toml
from cls_bench.parameters.override import known_keys, not_in_use, whole_keys
from cls_bench.resources import shipped_scenarios
from cls_bench.rigs import Rig, find_rig
from cls_bench.scenario import Check, Scenario, load_scenario
from cls_bench.scenario.placing import IN_ENTRY, TABLES, TOP
from cls_bench.sweep.axes import MOST_POINTS, Array, Axis, Listed, Random, Strict
from cls_bench.sweep.engine import Point
from cls_bench.text import escaped


class Sweep(Strict):
    """A sweep as its file describes it; made by :func:`load_sweep`."""

    title: Annotated[str, Field(min_length=1, max_length=1000)]
    """one line that says what is looked for"""
    scenario: Annotated[str, Field(min_length=1, max_length=1000)]
    """name of a shipped scenario, or a file, relative to this one"""
    axes: Annotated[list[Axis], Field(min_length=1, max_length=50)]
    """what varies"""
    samples: Annotated[int, Field(ge=1, le=MOST_POINTS)] | None = None
    """number of draws of the random axes"""
    design: Literal["random", "latin_hypercube"] = "random"
    """how the random axes are drawn: independently, or as a latin hypercube, which fills each axis evenly"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """seed of the draws"""
    collect: Annotated[list[str], Field(min_length=1, max_length=1000)] | None = None
    """names of the scenario's checks to collect; all if left out"""
    checks: list[Check] = Field(default_factory=list, max_length=1000)
    """further metrics to collect, in the form of a scenario's checks"""

    @model_validator(mode="after")
    def _whole(self) -> "Sweep":
        keys = [axis.key for axis in self.axes]
        for key in keys:
            if keys.count(key) > 1:
                raise ValueError(f'the axis "{key}" is there twice')
        if self.random != (self.samples is not None):
            raise ValueError("samples: give it if there are random axes, and only then")
        if self.size > MOST_POINTS:
            raise ValueError(f"{self.size} points are more than the {MOST_POINTS} a sweep may have")
        return self

    @property
    def random(self) -> bool:
        """Whether an axis is drawn."""
        return any(isinstance(axis, Random) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(axis.length for axis in self.axes if isinstance(axis, Listed)) * (self.samples or 1)

    @cached_property
    def points(self) -> list[Point]:
        """The points in order: key -> value. Values of whole-number parameters are rounded."""
        whole = whole_keys() | {"seed"}
        listed = [
            [(axis.key, _rounded(value, axis.key in whole)) for value in axis.listed()]
            for axis in self.axes if isinstance(axis, Listed)
        ]  # fmt: skip
        random = [axis for axis in self.axes if isinstance(axis, Random)]
        columns = [axis.drawn(share).tolist() for axis, share in zip(random, self._shares(len(random)), strict=True)]
        draws = [
            [(axis.key, _rounded(value, axis.key in whole)) for axis, value in zip(random, row, strict=True)]
            for row in zip(*columns, strict=True)
        ] or [[]]
        keys = [axis.key for axis in self.axes]
        points = [dict((*cells, *draw)) for cells in itertools.product(*listed) for draw in draws]
        return [{key: point[key] for key in keys} for point in points]

    def _shares(self, axes: int) -> Array:
        """Numbers in (0, 1), shape (axes, samples)."""
        if not axes or self.samples is None:
            return np.zeros((0, 0))
        rng = np.random.default_rng(self.seed)
        if self.design == "random":
            return rng.random((axes, self.samples))
        from scipy.stats.qmc import LatinHypercube  # heavy, and few sweeps need it

        return np.asarray(LatinHypercube(axes, rng=rng).random(self.samples).T)


def _rounded(value: Any, whole: bool) -> Any:
    return round(value) if whole and isinstance(value, float) else value


class Plan:
    """A sweep with its scenario, checked: what is needed to evaluate a point."""

    def __init__(self, sweep: Sweep, scenario: Scenario, source: bytes, name: str, folder: Path):
        self.sweep = sweep
        self.scenario = scenario
        self.source = source
        """the sweep file as read"""
        self.name = name
        """stem of the sweep file"""
        self.checks = _collected(sweep, scenario)
        """what is collected at every point"""
        self.rigs = _rigs(sweep, scenario, folder)
        """rigs that an axis chooses among, by name"""

    @property
    def identity(self) -> str:
        """What is evaluated, for the journal: both files, samples and rigs they name, and the controller's sources."""
        parts = [
            self.source, self.scenario.source, *self.scenario.sample_files.values(), *self._chosen_files(),
            *(entry.encode() for entry in self.scenario.overrides),
            *(rig.source for rig in self.rigs.values()),
        ]  # fmt: skip
        place = self.scenario.controller_place
        controller = "" if place is None else fingerprint(place)
        return "\n".join([*(part.decode(errors="replace") for part in parts), controller])

    def _chosen_files(self) -> Iterator[bytes]:
        """Contents of the files that an axis chooses among, such as ``flight.file`` or ``aircraft.name``."""
        if not any(_names_a_file(axis.key) for axis in self.sweep.axes):
            return
        seen = list[dict[str, Any]]()
        for point in self.sweep.points:
            table = {key: value for key, value in point.items() if _names_a_file(key) or key.startswith(TABLES)}
            if table in seen:
                continue
            seen.append(table)
            with suppress(InputError):  # that point is a row with its error
                yield from self.scenario.changed(table).sample_files.values()


def _names_a_file(key: str) -> bool:
    return key == "aircraft.name" or key.endswith(".file")


def _collected(sweep: Sweep, scenario: Scenario) -> tuple[Check, ...]:
    known = {check.name: check for check in scenario.checks}
    for name in sweep.collect or []:
        if name not in known:
            has = escaped(", ".join(known) or "none", 500)
            raise InputError(f"collect: {shown(name)} is no check of {scenario.name}; it has {has}")
    chosen = [known[name] for name in sweep.collect] if sweep.collect is not None else list(scenario.checks)
    if not (chosen or sweep.checks):
        raise InputError(f"checks: {scenario.name} measures nothing; give [[checks]] to collect")
    checks = (*chosen, *sweep.checks)
    taken = {"point", "status", "message", *(axis.key for axis in sweep.axes)}
    for check in checks:
        if check.name in taken:
            raise InputError(f'checks: "{check.name}" is the name of another column; choose another')
    return checks


def _rigs(sweep: Sweep, scenario: Scenario, folder: Path) -> dict[str, Rig]:
    """The rigs of an axis ``rig``, as they are now: files beside the scenario, or in the sweep's ``folder``."""
    beside, found = scenario.path.parent if scenario.path else folder, {}
    for point in sweep.points if any(axis.key == "rig" for axis in sweep.axes) else ():
        name = point["rig"]
        if not isinstance(name, str):
            raise InputError(f"axes: {shown(name)} is no rig; give names or files")
        if name not in found:
            found[name] = find_rig(name, beside if (beside / name).is_file() else folder)
    return found


def load_sweep(path: Path, *, rig: str | Path | None = None) -> Plan:
    """Read a sweep file and its scenario; ``rig`` replaces the scenario's.

    Raises InputError with one line that says what is wrong.
    """
    from cls_bench.experiment import validate

    file = escaped(str(path), 500)
    try:
        source, table = read_toml(path, file)
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from None
    try:
        sweep = Sweep.model_validate(table, context=IN_FILE)
    except ValidationError as failure:
        raise InputError(f"{file}: {_fault(failure)}") from None
    named = sweep.scenario
    scenario = load_scenario(named if named in shipped_scenarios() else path.parent / named, rig=rig)
    try:
        _check_keys(sweep, scenario)
        plan = Plan(sweep, scenario, source, path.stem, path.parent)
        validate(scenario.with_checks(plan.checks))
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    return plan


def _check_keys(sweep: Sweep, scenario: Scenario) -> None:
    """Refuse keys that no point could have; a parameter's value that is not valid is a row with its error."""
    varied = {axis.key for axis in sweep.axes}
    parameters, other_rigs = scenario.parameters_at_start(), varied & {"rig", "gearbox.stages", "linkage.kind"}
    if tables := {key: value for key, value in sweep.points[0].items() if key.startswith(TABLES)}:
        scenario.changed(tables)  # together: a condition belongs to the axis beside it
    for k, axis in enumerate(sweep.axes):
        key = axis.key.removeprefix("parameters.")
        if IN_ENTRY.fullmatch(key):
            scenario.changed({key: sweep.points[0][axis.key]})
        elif key not in (*known_keys(), *TOP, *tables):
            raise InputError(
                f"axes[{k}].key: {shown(axis.key)} is unknown; valid are parameters (cls-bench list --parameters), "
                "duration, seed, rig, those of tables such as aircraft.condition and flight.airspeed_kt, and "
                "of entries such as squeeze[0].value"
            )
        elif not other_rigs and (missing := not_in_use(parameters, key)):
            raise InputError(f"axes[{k}].key: {axis.key}: {missing}")


def _fault(failure: ValidationError) -> str:
    """The first fault as ``key: what is wrong``."""
    errors = failure.errors(include_url=False)
    # A misspelt key is both unknown and missing: the first says more.
    error = next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])
    kinds = ("list", "range", "log_range", "uniform", "log_uniform", "normal")
    key = ""
    for part in error["loc"]:
        if part not in kinds:
            key += f"[{part}]" if isinstance(part, int) else f".{part}"
    key = escaped(key.lstrip("."))
    if error["type"] == "extra_forbidden":
        return f"{key}: unknown key" + (f"; {nearest(key, Sweep.model_fields)}" if len(error["loc"]) == 1 else "")
    if error["type"] == "missing":
        return f"{key}: missing"
    if error["type"] == "value_error":
        return f"{key}: {error['ctx']['error']}" if key else str(error["ctx"]["error"])
    if error["type"] == "too_long" and "actual_length" in error["ctx"]:
        return f"{key}: has {error['ctx']['actual_length']} entries; at most {error['ctx']['max_length']} are valid"
    return f"{key}: {shown(error['input'])} is not valid; {error['msg'][0].lower()}{error['msg'][1:]}"
