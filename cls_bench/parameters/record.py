"""Parameters as the NumPy records that compiled code reads."""

from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from cls_bench.quantity import Section


def _most(table: FieldInfo) -> int:
    extra: Any = table.json_schema_extra
    return int(extra["most"])


def kind_of(section: type[Section]) -> np.dtype[Any]:
    """The record that holds a section: numbers, flags as 0 and 1, choices as their place, tables with their length."""
    fields: list[tuple[str, Any]] = []
    for name, info in section.model_fields.items():
        kind: Any = info.annotation
        if isinstance(kind, type) and issubclass(kind, Section):
            fields.append((name, kind_of(kind)))
        elif kind is float:
            fields.append((name, np.float64))
        elif kind == tuple[float, ...]:  # a table: how many values there are, and room for the most
            fields.append((name, [("count", np.int64), ("values", np.float64, (_most(info),))]))
        else:  # int, bool, or the index of a Literal's choice
            fields.append((name, np.int64))
    return np.dtype(fields)


def values_of(section: Section) -> tuple[Any, ...]:
    """The values of a section, nested as :func:`kind_of` is."""
    values: list[Any] = []
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            values.append(values_of(value))
        elif isinstance(value, tuple):
            values.append((len(value), value + (0.0,) * (_most(info) - len(value))))
        elif get_origin(info.annotation) is Literal:
            values.append(get_args(info.annotation).index(value))
        else:
            values.append(value)
    return tuple(values)


def memory_of(section: Section) -> np.ndarray[Any, Any]:
    """A section as an array of one nested record."""
    return np.array([values_of(section)], dtype=kind_of(type(section)))


def record_of(section: Section) -> Any:
    """A section as one nested NumPy record, readable by attribute in plain and in compiled code."""
    return memory_of(section).view(np.recarray)[0]
