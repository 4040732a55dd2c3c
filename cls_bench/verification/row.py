"""One line of the verification table."""

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """A quantity of the plant beside what it has to be.

    ``limit`` is the largest deviation that passes: in ``unit``, or with ``relative`` as a fraction of ``expected``.
    """

    group: str
    """what is tested: the element, or the whole plant"""
    quantity: str
    unit: str
    expected: float
    source: str
    """where the expected value comes from"""
    obtained: float
    limit: float
    relative: bool = True

    @property
    def deviation(self) -> float:
        """Obtained less expected, in ``unit`` or as a fraction of ``expected``."""
        difference = self.obtained - self.expected
        return difference / abs(self.expected) if self.relative else difference

    @property
    def passed(self) -> bool:
        """Whether the deviation lies within the limit; a value that is not finite never passes."""
        return bool(math.isfinite(self.obtained) and abs(self.deviation) <= self.limit)  # bool: numpy's is not JSON's

    def to_json(self) -> dict[str, Any]:
        """The row as plain values; numbers that are not finite become None."""
        numbers = {name: getattr(self, name) for name in ("expected", "obtained", "deviation", "limit")}
        return {
            "group": self.group,
            "quantity": self.quantity,
            "unit": self.unit,
            "source": self.source,
            **{name: float(value) if math.isfinite(value) else None for name, value in numbers.items()},
            "relative": self.relative,
            "passed": self.passed,
        }
