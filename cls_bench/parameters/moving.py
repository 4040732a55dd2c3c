"""How a live parameter may move while a run goes on: smoothly, in steps, or only from one value to another."""

from collections.abc import Mapping
from functools import cache

from cls_bench.parameters import Parameters, Section, leaves

STEPPED = frozenset(
    {
        # the drive's gains follow from them
        "drive.current_bandwidth", "drive.velocity_bandwidth", "drive.velocity_integral_time",
        "drive.position_bandwidth", "drive.position_integral_time", "drive.speed_filter_time", "nameplate.load_inertia",
        # the plant's constants
        "load_cell.creep_time", "limb.mass",
        # whether the plant's step carries them is to be asked
        *(f"limb.{name}" for name in ("loose_stiffness", "tight_stiffness", "loose_damping", "tight_damping",
                                      "arm_stiffness", "arm_damping")),
        # random numbers are drawn only where they are not 0
        "feel.gust.torque", "plc.frame_loss", "load_cell.spike_rate",
    }
)  # fmt: skip
"""Live numbers of which more follows than their own place in the record: they move by a change each host cycle.

All other live numbers are written in each PLC cycle. A test finds out which these are.
"""

HOST_CYCLE = 0.01
"""Cycle of the host computer [s]: 100 Hz, usual for a flight simulation."""


@cache
def numbers() -> Mapping[str, str]:
    """Live parameters that are real numbers, and so can move: dotted key and unit."""
    return {key: about["unit"] for key, value, about in leaves(Parameters()) if about["live"] and type(value) is float}


def replaced(parameters: Parameters, values: Mapping[str, float]) -> Parameters:
    """A copy with other ``values`` by dotted key, unchecked: each is within its bounds already."""
    tree: dict[str, object] = {}
    for key, value in values.items():
        *parents, last = key.split(".")
        inner = tree
        for parent in parents:
            inner = inner.setdefault(parent, {})  # type: ignore[assignment]
        inner[last] = value

    def copied(section: Section, table: Mapping[str, object]) -> Section:
        update = {
            name: copied(getattr(section, name), new) if isinstance(new, dict) else new for name, new in table.items()
        }
        return section.model_copy(update=update)

    found = copied(parameters, tree)
    assert isinstance(found, Parameters)
    return found


def value_of(parameters: Parameters, key: str) -> float:
    """The value of the parameter ``key``."""
    found: object = parameters
    for name in key.split("."):
        found = getattr(found, name)
    assert isinstance(found, float)
    return found
