"""Parameters with the values of a nested table in place of their own."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import ValidationError

from cls_bench.parameters import Parameters, Section, leaves
from cls_bench.scenario.faults import FaultError, listed, nearest, problem_of, shown


def parameters_with(
    key: str, parameters: Parameters, table: Mapping[str, Any], *, live_only: bool = False
) -> Parameters:
    """As :func:`override`; faults are named below ``key``."""
    try:
        return override(parameters, table, live_only=live_only)
    except FaultError as fault:
        raise FaultError(f"{key}.{fault.key}".rstrip("."), fault.problem) from None


def _flat(table: Mapping[str, Any], known: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        key = prefix + name
        if isinstance(value, Mapping) and key not in known:
            yield from _flat(value, known, f"{key}.")
        else:
            yield key, value


def override(parameters: Parameters, table: Mapping[str, Any], *, live_only: bool = False) -> Parameters:
    """A copy of ``parameters`` with the values of the nested ``table``; raises FaultError at the first bad one."""
    known = {key: info for key, _, info in leaves(parameters)}
    merged = parameters.model_dump()
    for key, value in _flat(table, known):
        *parents, last = key.split(".")
        if key not in known:
            below = [name for name in known if name.startswith(f"{key}.")]
            if below:
                raise FaultError(key, f"{shown(value)} is not valid; it is a section with {listed(below)}")
            section = [name for name in known if name.startswith(".".join([*parents, ""]))]
            raise FaultError(key, f"unknown parameter; {nearest(key, section or known)}")
        if live_only and not known[key]["live"]:
            live = [name for name in known if known[name]["live"]]
            near = [name for name in live if name.startswith(f"{parents[0]}.")]
            near = near or [f"some of {name}" for name in dict.fromkeys(name.partition(".")[0] for name in live)]
            raise FaultError(key, f"holds for the whole run; these may change while it goes on: {listed(near)}")
        inner = merged
        for parent in parents:
            inner = inner[parent]
        inner[last] = value
    try:
        return Parameters.model_validate(merged)
    except ValidationError as failure:
        error = failure.errors(include_url=False)[0]
    section_type: type[Section] = Parameters
    for part in error["loc"]:
        inner_type = section_type.model_fields[str(part)].annotation
        if isinstance(inner_type, type) and issubclass(inner_type, Section):
            section_type = inner_type
    raise FaultError(".".join(map(str, error["loc"])), problem_of(error, section_type))
