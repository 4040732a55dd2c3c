"""The axes of a sweep: along which key a scenario varies, and over which values."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Array = NDArray[np.float64]
MOST_POINTS = 1_000_000
"""Points a sweep may have: so many rows fit into memory with ease."""

Number = Annotated[float, Field(ge=-1e15, le=1e15, allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=1e-15, le=1e15, allow_inf_nan=False)]
Whole = Annotated[int, Field(ge=-(2**63), lt=2**63)]
Text = Annotated[str, Field(min_length=1, max_length=200)]
Cell = Annotated[bool | Whole | Number | Text, Field(union_mode="left_to_right")]


class Strict(BaseModel):
    """Base of the sweep file's tables: no unknown keys, no conversion of types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, use_attribute_docstrings=True)


class _Axis(Strict):
    key: Text
    """a parameter such as "feel.inertia", "duration", "seed", or the key of an entry such as "squeeze[0].value\""""


class Listed(_Axis):
    """An axis whose values are combined with those of the others."""

    @property
    @abstractmethod
    def length(self) -> int:
        """Number of its values."""

    @abstractmethod
    def listed(self) -> Sequence[bool | int | float | str]:
        """Its values in order."""


class Random(_Axis):
    """An axis whose values are drawn."""

    @abstractmethod
    def drawn(self, share: Array) -> Array:
        """Values below which a ``share`` in (0, 1) of the distribution lies."""


class ListAxis(Listed):
    """Values one by one."""

    kind: Literal["list"]
    values: Annotated[list[Cell], Field(min_length=1)]
    """numbers, texts or booleans"""

    @property
    def length(self) -> int:
        """As many as are given."""
        return len(self.values)

    def listed(self) -> Sequence[bool | int | float | str]:
        """As given."""
        return self.values


class _Range(Listed):
    start: Number = Field(alias="from")
    """first value"""
    to: Number
    """last value"""
    count: Annotated[int, Field(ge=2, le=MOST_POINTS)]
    """number of values, both ends among them"""

    @property
    def length(self) -> int:
        """As asked for."""
        return self.count


class RangeAxis(_Range):
    """Values at equal distances."""

    kind: Literal["range"]

    def listed(self) -> Sequence[float]:
        """From first to last, evenly."""
        values: list[float] = np.linspace(self.start, self.to, self.count).tolist()
        return values


class LogRangeAxis(_Range):
    """Values at equal ratios."""

    kind: Literal["log_range"]
    start: Positive = Field(alias="from")
    """first value"""
    to: Positive
    """last value"""

    def listed(self) -> Sequence[float]:
        """From first to last, evenly on a logarithmic scale."""
        values: list[float] = np.geomspace(self.start, self.to, self.count).tolist()
        return values


class UniformAxis(Random):
    """Evenly distributed values."""

    kind: Literal["uniform"]
    start: Number = Field(alias="from")
    """least value"""
    to: Number
    """greatest value"""

    def drawn(self, share: Array) -> Array:
        """Quantiles of the even distribution."""
        return self.start + (self.to - self.start) * share


class LogUniformAxis(Random):
    """Values whose logarithm is evenly distributed."""

    kind: Literal["log_uniform"]
    start: Positive = Field(alias="from")
    """least value"""
    to: Positive
    """greatest value"""

    def drawn(self, share: Array) -> Array:
        """Quantiles of the log-even distribution."""
        return np.asarray(self.start * (self.to / self.start) ** share)


class NormalAxis(Random):
    """Normally distributed values."""

    kind: Literal["normal"]
    mean: Number
    """mean"""
    deviation: Positive
    """standard deviation"""

    def drawn(self, share: Array) -> Array:
        """Quantiles of the normal distribution."""
        from scipy.special import ndtri  # heavy, and few sweeps need it

        return np.asarray(self.mean + self.deviation * ndtri(share))


Axis = Annotated[
    ListAxis | RangeAxis | LogRangeAxis | UniformAxis | LogUniformAxis | NormalAxis, Field(discriminator="kind")
]
