"""A scenario as TOML text, so that a run of one that was made in Python can be repeated from its recording."""

from typing import Any

import tomli_w

from cls_bench.input.faults import FaultError, shown


def as_toml(table: dict[str, Any]) -> bytes:
    """The text of a scenario's table."""
    return tomli_w.dumps(table).encode()


def check_writable(scenario: Any) -> None:
    """Raise FaultError for a value that TOML has no form for: those of its free tables may be anything."""
    free = {"parameters": scenario.parameters}
    free |= {f"changes[{k}].parameters": change.parameters for k, change in enumerate(scenario.changes)}
    if scenario.flight is not None:
        free["flight.schedules"] = scenario.flight.schedules
    if scenario.controller is not None:
        free["controller.arguments"] = scenario.controller.arguments
    for key, value in free.items():
        _check(key, value)


def _check(key: str, value: Any) -> None:
    if isinstance(value, dict):
        for name, inner in value.items():
            if not isinstance(name, str):
                raise FaultError(key, f"{shown(str(name))} is no key; keys are texts")
            _check(f"{key}.{name}", inner)
    elif isinstance(value, list | tuple):
        for number, inner in enumerate(value):
            _check(f"{key}[{number}]", inner)
    elif not isinstance(value, bool | int | float | str):
        raise FaultError(key, f"a {type(value).__name__} cannot be written to TOML; give a number, text, true or false")
