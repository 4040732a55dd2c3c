"""The one way in which a dotted key changes parameters: of rigs, scenarios, their changes, ``--set`` and sweeps."""

import math
import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

from pydantic import ValidationError

from cls_bench.input.faults import FaultError, listed, nearest, problem_of, shown
from cls_bench.parameters import Parameters, Section, leaves
from cls_bench.quantity import constraints

_OF_A_FOUR_BAR = tuple(
    f"linkage.{name}"
    for name in ("crank", "rod", "crank_angle", "rod_angle", "rod_crank_mass", "rod_column_mass", "rod_end_mass")
)


RENAMED = {
    "feel.centering_stiffness": "feel.centering.stiffness", "feel.centering_breakout": "feel.centering.breakout",
    "feel.shaker_torque": "feel.shaker.torque", "feel.shaker_frequency": "feel.shaker.frequency",
    "feel.autopilot_torque": "feel.autopilot.torque", "feel.disturbance_torque": "feel.disturbance.torque",
}  # fmt: skip
"""Parameters that had another name in earlier versions."""


def present_names(table: Mapping[str, Any]) -> dict[str, Any]:
    """A nested table of parameters, with those that had another name under their present one."""
    return nested({RENAMED.get(key, key): value for key, value in flat(table)})


@cache
def known_keys() -> Mapping[str, Mapping[str, Any]]:
    """All parameters by dotted key, with unit, source, meaning, what is valid, and whether they are live."""
    return {key: about for key, _, about in leaves(Parameters())}


@cache
def bounds(key: str) -> tuple[float, float]:
    """Least and greatest value that the parameter ``key`` may have; infinite where there is none."""
    section: Section = Parameters()
    *parents, last = key.split(".")
    for parent in parents:
        section = getattr(section, parent)
    declared = constraints(type(section).model_fields[last])
    low = math.nextafter(declared["gt"], math.inf) if "gt" in declared else declared.get("ge", -math.inf)
    high = math.nextafter(declared["lt"], -math.inf) if "lt" in declared else declared.get("le", math.inf)
    return low, high


def whole_keys() -> frozenset[str]:
    """Keys of parameters that are whole numbers."""
    return frozenset(key for key, value, _ in leaves(Parameters()) if type(value) is int)


def parameters_with(
    key: str, parameters: Parameters, table: Mapping[str, Any], *, live_only: bool = False
) -> Parameters:
    """As :func:`override`; faults are named below ``key``."""
    try:
        return override(parameters, table, live_only=live_only)
    except FaultError as fault:
        raise FaultError(f"{key}.{fault.key}".rstrip("."), fault.problem) from None


def flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """(dotted key, value) of a nested table; dotted keys in it are as good as tables."""
    for name, value in table.items():
        key = prefix + name
        if isinstance(value, Mapping) and key not in known_keys():
            yield from flat(value, f"{key}.")
        else:
            yield key, value


def nested(table: Mapping[str, Any]) -> dict[str, Any]:
    """The same values in tables alone, without dotted keys; of a key that is there twice the later one."""
    found: dict[str, Any] = {}
    for key, value in flat(table):
        *parents, last = key.split(".")
        inner = found
        for parent in parents:
            deeper = inner.get(parent)
            if not isinstance(deeper, dict):
                deeper = inner[parent] = {}
            inner = deeper
        inner[last] = value
    return found


_ALONE = frozenset({"feel", "limb", "load_cell", "encoder", "plc"})
"""Sections of whose live parameters no rule beyond the section itself speaks: a change checks those sections alone."""


def override(parameters: Parameters, table: Mapping[str, Any], *, live_only: bool = False) -> Parameters:
    """A copy of ``parameters`` with the values of the nested ``table``; raises FaultError at the first bad one."""
    known, changed = known_keys(), list[str]()
    merged: dict[str, Any] = {}
    for key, value in flat(table):
        *parents, last = key.split(".")
        if key in RENAMED:
            raise FaultError(key, f"is called {RENAMED[key]} now")
        if key not in known:
            below = [name for name in known if name.startswith(f"{key}.")]
            if below:
                inner = dict.fromkeys(f"{key}.{name[len(key) + 1 :].partition('.')[0]}" for name in below)
                raise FaultError(key, f"{shown(value)} is not valid; it is a section with {listed(list(inner))}")
            section = [name for name in known if name.startswith(".".join([*parents, ""]))]
            raise FaultError(key, f"unknown parameter; {nearest(key, section or known)}")
        if live_only and not known[key]["live"]:
            live = [name for name in known if known[name]["live"]]
            near = [name for name in live if name.startswith(f"{parents[0]}.")]
            near = near or [f"some of {name}" for name in dict.fromkeys(name.partition(".")[0] for name in live)]
            raise FaultError(key, f"holds for the whole run; these may change while it goes on: {listed(near)}")
        if parents[0] not in merged:
            merged[parents[0]] = getattr(parameters, parents[0]).model_dump()
        inner = merged
        for parent in parents:
            inner = inner[parent]
        inner[last] = value
        changed.append(key)
    prefix: tuple[str, ...] = ()
    try:
        if live_only and _ALONE.issuperset(merged):
            sections = {}
            for name, values in merged.items():
                prefix = (name,)
                sections[name] = type(getattr(parameters, name)).model_validate(values)
            found = parameters.model_copy(update=sections)
        else:
            found = Parameters.model_validate({**parameters.model_dump(), **merged})
    except ValidationError as failure:
        error = failure.errors(include_url=False)[0]
    else:
        for key in changed:
            if missing := not_in_use(found, key):
                raise FaultError(key, missing)
        return found
    # Of an entry of a table the table itself says what is wanted.
    place = tuple(part for part in (*prefix, *error["loc"]) if isinstance(part, str))
    section_type: type[Section] = Parameters
    for part in place:
        inner_type = section_type.model_fields[part].annotation
        if isinstance(inner_type, type) and issubclass(inner_type, Section):
            section_type = inner_type
    raise FaultError(".".join(place), problem_of({**error, "loc": place}, section_type))


def not_in_use(parameters: Parameters, key: str) -> str:
    """Why a parameter means nothing on a rig with these; empty if it does."""
    stages = parameters.gearbox.stages
    if (match := re.match(r"gearbox\.stage(\d)\.", key)) and int(match[1]) > stages:
        there = "no stage" if stages == 0 else "one stage" if stages == 1 else f"{stages} stages"
        return f"there is no stage {match[1]}: the gearbox has {there}, as gearbox.stages = {stages} says"
    if key in _OF_A_FOUR_BAR and parameters.linkage.kind == "none":
        return 'there is no four-bar linkage, as linkage.kind = "none" says'
    return ""


def differences(base: Parameters, parameters: Parameters) -> dict[str, Any]:
    """What :func:`override` makes of ``base`` to get ``parameters``: dotted keys in use and their values."""
    before = {key: value for key, value, _ in leaves(base)}
    return {
        key: value
        for key, value, _ in leaves(parameters)
        if value != before[key] and not not_in_use(parameters, key)
    }
