"""How a parameter is declared: one definition each, with unit, default, bounds and source.

SI and radians throughout. The sections are pydantic models, strict about unknown keys, wrong types and impossible
values. "assumed" as a source always says why. Parameters marked *live* may change while a run goes on (scenario
``[[changes]]``); all others shape the model or the wiring of the loops and hold for the whole run.
"""

import math
import operator
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from pydantic.config import JsonDict
from pydantic.fields import FieldInfo

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

ARCMIN = math.pi / 180.0 / 60.0
"""One minute of arc [rad]."""

RPM = 2.0 * math.pi / 60.0
"""One revolution per minute [rad/s]."""

DEG = math.pi / 180.0
"""One degree [rad]."""

WIDEST = 3.0
"""No angle of a control is beyond this [rad]."""


def quantity(default: Any, unit: str, meaning: str, source: str, *, live: bool = False, **bounds: Any) -> Any:
    """Declare a parameter; ``bounds`` are pydantic's ``gt``, ``ge``, ``lt``, ``le``. No default (``...``): it is given.
    """
    extra: JsonDict = {"unit": unit, "source": source, "live": live}
    if isinstance(default, float) or (default is ... and bounds):
        bounds["allow_inf_nan"] = False
    return Field(default=default, description=meaning, json_schema_extra=extra, **bounds)


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


Table = Annotated[tuple[float, ...], BeforeValidator(_as_tuple)]
"""A parameter that is a list of numbers."""


def table(unit: str, meaning: str, source: str, most: int, *, live: bool = False, **bounds: float) -> Any:
    """Declare a parameter that is a list of up to ``most`` numbers, none by default; ``bounds`` hold for each."""
    each: JsonDict = {**bounds}
    extra: JsonDict = {"unit": unit, "source": source, "live": live, "most": most, "each": each}
    return Field(default=(), description=meaning, json_schema_extra=extra, max_length=most)


def check_each(info: FieldInfo, values: tuple[float, ...]) -> None:
    """Raise ValueError unless every number of a table is finite and within its bounds."""
    extra: Any = info.json_schema_extra
    for value in values:
        if not math.isfinite(value) or not all(_HOLDS[key](value, bound) for key, bound in extra["each"].items()):
            raise ValueError(f"{value:g} is not valid; every value must be {_bounds(extra['each'])}")


_HOLDS = {"gt": operator.gt, "ge": operator.ge, "lt": operator.lt, "le": operator.le}


def part(default: Any, meaning: str, **sources: str) -> Any:
    """Declare a section that is used more than once, with the sources of the values that differ from place to place."""
    extra: JsonDict = {"sources": {**sources}}
    return Field(default=default, description=meaning, json_schema_extra=extra)


class Section(BaseModel):
    """Base of all parameter sections: values that do not change, strict, without unknown keys."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def leaves(
    section: Section, prefix: str = "", sources: Mapping[str, str] | None = None
) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield (dotted key, value, {"unit", "source", "live", "meaning", "valid"}) of all parameters below ``section``."""
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        extra: Any = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
        if isinstance(value, Section):
            yield from leaves(value, f"{prefix}{name}.", extra.get("sources"))
        else:
            source = (sources or {}).get(name) or extra["source"]
            about = {**extra, "source": source, "meaning": info.description, "valid": _valid(info)}
            yield f"{prefix}{name}", value, about


def constraints(info: FieldInfo) -> dict[str, float]:
    """Bounds that are declared for a parameter, by pydantic's names of them: ``gt``, ``ge``, ``lt``, ``le``."""
    return {key: getattr(m, key) for m in info.metadata for key in _SIGNS if hasattr(m, key)}


_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def _valid(info: FieldInfo) -> str:
    """What values a parameter may have, in words; empty if any of its type."""
    if get_origin(info.annotation) is Literal:
        return ", ".join(get_args(info.annotation))
    extra: Any = info.json_schema_extra
    if "each" in extra:
        return f"up to {extra['most']} numbers, each {_bounds(extra['each'])}"
    return _bounds(constraints(info))


def _bounds(declared: Mapping[str, float]) -> str:
    return ", ".join(f"{_SIGNS[key]} {bound:.6g}" for key, bound in declared.items())
