"""What an onset is searched over: a quantity of the bench or of the hand, with its range."""

from dataclasses import dataclass, field, replace
from typing import Any

from pydantic import BaseModel, ValidationError

from cls_bench.analysis.linear import Hand, limb_mass_for
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, leaves
from cls_bench.signals import PLC_S


@dataclass(frozen=True)
class Setup:
    """The bench and the hand on it: what a stability question is asked about."""

    parameters: Parameters = field(default_factory=Parameters)
    hand: Hand = field(default_factory=Hand)


@dataclass(frozen=True)
class Variation:
    """A quantity that moves a setup towards or away from instability."""

    name: str
    unit: str
    low: float
    high: float
    whole: bool = False
    """takes whole numbers only"""

    def apply(self, setup: Setup, value: float) -> Setup:
        """The ``setup`` with this quantity at ``value``; InputError if it cannot have it."""
        p, hand = setup.parameters, setup.hand
        match self.name:
            case "limb_mass":
                return Setup(changed(p, "limb.mass", value), hand)
            case "forward_inertia":
                mass = limb_mass_for(p, value)
                if mass <= 0:
                    raise InputError(f"forward_inertia = {value:g} kg·m²: the column alone has more")
                return Setup(changed(p, "limb.mass", mass), hand)
            case "squeeze":
                return Setup(p, replace(hand, squeeze=value))
            case "delay":
                return Setup(changed(p, "plc.command_latency", round(value)), hand)
            case key:
                return Setup(changed(p, key, value), hand)


_NAMED = {
    v.name: v
    for v in (
        Variation("limb_mass", "kg", 0.02, 20.0),
        Variation("forward_inertia", "kg·m²", 0.042, 2.0),
        Variation("squeeze", "1", 0.0, 1.0),
        Variation("delay", f"cycles of {PLC_S * 1e3:g} ms", 0, 16, whole=True),
        Variation("feel.inertia", "kg·m²", 0.02, 3.0),
        Variation("feel.damping", "N·m·s/rad", 0.1, 200.0),
    )
}


def variation(name: str, low: float | None = None, high: float | None = None) -> Variation:
    """The variation ``name``: one with a range of its own, or any numeric parameter by its dotted key with a range.

    Raises InputError for unknown names and empty ranges.
    """
    known = _NAMED.get(name)
    if known is None:
        found = {key: (value, extra["unit"]) for key, value, extra in leaves(Parameters())}
        if name not in found or isinstance(found[name][0], bool | str):
            raise InputError(f'vary = "{name}": must be {", ".join(_NAMED)} or the key of a numeric parameter')
        value, unit = found[name]
        low, high = (0.1 * value if low is None else low), (10.0 * value if high is None else high)
        known = Variation(name, unit, low, high, whole=isinstance(value, int))
    low, high = (known.low if low is None else low), (known.high if high is None else high)
    if not low < high:
        raise InputError(f"range of {name} from {low:g} to {high:g}: must grow")
    return replace(known, low=low, high=high)


def changed(p: Parameters, key: str, value: Any) -> Parameters:
    """A copy of ``p`` with the parameter ``key`` (dotted) at ``value``; InputError if that is not allowed."""
    copy = p.model_copy(deep=True)
    section: BaseModel = copy
    *path, leaf = key.split(".")
    try:
        for name in path:
            section = getattr(section, name)
        if leaf not in type(section).model_fields:
            raise AttributeError(leaf)
        setattr(section, leaf, value)
    except AttributeError:
        raise InputError(f'parameter "{key}" does not exist') from None
    except ValidationError as error:
        raise InputError(f"{key} = {value}: {error.errors()[0]['msg']}") from None
    return copy


def ideal(p: Parameters) -> Parameters:
    """``p`` without what is not linear or not exact: friction, backlash, transmission error, noise, coarse counts."""
    for key, value in (
        ("gearbox.stage1.drag", 0.0), ("gearbox.stage2.drag", 0.0), ("gearbox.efficiency", 1.0),
        ("gearbox.stage1.backlash", 0.0), ("gearbox.stage2.backlash", 0.0),
        ("gearbox.stage1.transmission_error", 0.0), ("gearbox.stage2.transmission_error", 0.0),
        ("column.coulomb_friction", 0.0), ("feel.friction", 0.0),
        ("encoder.noise", 0.0), ("encoder.interpolation", 65536), ("load_cell.noise", 0.0),
    ):  # fmt: skip
        p = changed(p, key, value)
    return p
