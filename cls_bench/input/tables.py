"""Base of what is read from TOML tables, or made in Python with the same keys and the same checks."""

from typing import Any

from pydantic import BaseModel, ConfigDict, ModelWrapValidatorHandler, ValidationError, ValidationInfo, model_validator

from cls_bench.errors import InputError
from cls_bench.input.faults import problem_of
from cls_bench.text import escaped

IN_FILE = "file"
"""Context of a validation whose faults are said by whoever reads the file."""

LONGEST_LINE = 1000
"""Characters of a message."""


class Strict(BaseModel):
    """Base of all tables: no unknown keys, no conversion of types, finite numbers.

    One that is made in Python and is not valid is an :class:`~cls_bench.errors.InputError` of one line.
    """

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )

    @model_validator(mode="wrap")
    @classmethod
    def _in_one_line(cls, data: Any, handler: ModelWrapValidatorHandler["Strict"], info: ValidationInfo) -> "Strict":
        if info.context is not None:
            return handler(data)
        try:
            return handler(data)
        except ValidationError as failure:
            error = worst(failure)
            place = place_of(error["loc"])
            line = f"{place}: {problem_of({**error, 'loc': error['loc'][:1]}, cls)}".removeprefix(": ")
            raise InputError(escaped(f"{cls.__name__}: {line}", LONGEST_LINE)) from None


def worst(failure: ValidationError) -> Any:
    """The fault that says most: a misspelt key is both unknown and missing."""
    errors = failure.errors(include_url=False)
    return next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])


def place_of(loc: tuple[int | str, ...]) -> str:
    """Where a fault is, as a key such as ``hand[0].to_deg``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).lstrip(".")
