"""How often things happen: the drive's cascade, the field bus, the PLC, the plant's step."""

from typing import Any

from pydantic import model_validator

from cls_bench.quantity import Section, quantity
from cls_bench.signals import LONGEST_CYCLE, LONGEST_TICK, MOST_TICKS, SHORTEST_TICK, Clock

_CYCLE: dict[str, Any] = {"ge": SHORTEST_TICK, "le": LONGEST_CYCLE}


class Rates(Section):
    """Cycle times. All are whole multiples of the current controller's, which is the tick of everything recorded."""

    current_cycle: float = quantity(
        50.0e-6, "s", "current controller, and the tick", "thesis 3.6.1", ge=SHORTEST_TICK, le=LONGEST_TICK
    )
    velocity_cycle: float = quantity(
        200.0e-6, "s", "velocity controller; a multiple of current_cycle", "thesis 3.6.1", **_CYCLE
    )
    position_cycle: float = quantity(
        400.0e-6, "s", "position controller; a multiple of velocity_cycle", "thesis 3.6.1", **_CYCLE
    )
    bus_cycle: float = quantity(
        400.0e-6, "s", "field bus: a frame either way; a multiple of current_cycle", "thesis 3.2.3: Powerlink",
        **_CYCLE,
    )  # fmt: skip
    plc_cycle: float = quantity(
        400.0e-6, "s", "PLC task, synchronous with the bus; a multiple of bus_cycle", "thesis 3.6", **_CYCLE
    )

    @model_validator(mode="after")
    def _multiples(self) -> "Rates":
        tick = round(self.current_cycle * 1e9)
        if abs(self.current_cycle * 1e9 - tick) > 1e-3:
            raise ValueError(f"current_cycle: {self.current_cycle:g} s is not a whole number of nanoseconds")
        for name, of in (
            ("velocity_cycle", "current_cycle"), ("position_cycle", "velocity_cycle"), ("bus_cycle", "current_cycle"),
            ("plc_cycle", "bus_cycle"),
        ):  # fmt: skip
            count = getattr(self, name) / getattr(self, of)
            if round(count) < 1 or abs(count - round(count)) > 1e-6:
                raise ValueError(f"{name} must be a multiple of {of} = {getattr(self, of):g} s")
            if round(getattr(self, name) / self.current_cycle) > MOST_TICKS:
                raise ValueError(f"{name} must be at most {MOST_TICKS} cycles of the current controller")
        return self

    @property
    def clock(self) -> Clock:
        """The same in ticks."""
        def ticks(cycle: float) -> int:
            return round(cycle / self.current_cycle)

        return Clock(
            round(self.current_cycle * 1e9), ticks(self.velocity_cycle), ticks(self.position_cycle),
            ticks(self.bus_cycle), ticks(self.plc_cycle),
        )  # fmt: skip


class Simulation(Section):
    """The numerical side."""

    substeps: int = quantity(
        1, "1", "plant steps in a tick", "1 is converged: see docs/architecture.md", ge=1, le=64
    )
