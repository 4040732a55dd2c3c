"""What an onset is searched over: a quantity of the bench or of the hand, with its range."""

from dataclasses import dataclass, field, replace
from typing import Any

from cls_bench.errors import InputError
from cls_bench.input.faults import FaultError
from cls_bench.linear.hand import Hand, forward_inertia, limb_mass_for
from cls_bench.parameters import Parameters, leaves
from cls_bench.parameters.override import bounds, override


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


HEAVIEST = 95.0
"""Limb [kg] up to which an onset is searched."""


def _named(p: Parameters) -> dict[str, Variation]:
    """Variations with a range of their own: in inertias, from below the bare column's to far beyond a limb's."""
    bare = forward_inertia(p, Hand(None))
    least, most = bounds("feel.inertia")
    lightest, heaviest = (bare + mass * p.column.grip_height**2 for mass in (1.05 * bounds("limb.mass")[0], HEAVIEST))
    chosen = (
        Variation("limb_mass", "kg", 0.02, 20.0),
        Variation(
            "forward_inertia", "kg·m²", max(_rounded(1.1 * bare), lightest), _rounded(min(50.0 * bare, heaviest))
        ),
        Variation("squeeze", "1", 0.0, 1.0),
        Variation("delay", f"cycles of {p.rates.bus_cycle * 1e3:g} ms", 0, 16, whole=True),
        Variation("feel.inertia", "kg·m²", max(_rounded(0.5 * bare), least), min(_rounded(75.0 * bare), most)),
        Variation("feel.damping", "N·m·s/rad", 0.1, 200.0),
    )
    return {v.name: v for v in chosen}


def _rounded(value: float) -> float:
    """``value`` with two digits."""
    return float(f"{value:.1e}")


def of_bare(p: Parameters, factor: float) -> float:
    """``factor`` times the bare column's I_fwd [kg·m²], rounded to one digit."""
    return float(f"{factor * forward_inertia(p, Hand(None)):.0e}")


def variation(
    name: str, low: float | None = None, high: float | None = None, *, of: Parameters | None = None
) -> Variation:
    """The variation ``name``: one with a range of its own, or any numeric parameter by its dotted key with a range.

    Ranges that are not given suit the bench ``of``, the default one unless given. Raises InputError for unknown names
    and empty ranges.
    """
    p = Parameters() if of is None else of
    named = _named(p)
    known = named.get(name)
    if known is None:
        found = {key: (value, extra["unit"]) for key, value, extra in leaves(p)}
        if name not in found or isinstance(found[name][0], bool | str):
            raise InputError(f'vary = "{name}": must be {", ".join(named)} or the key of a numeric parameter')
        (value, unit), (least, most) = found[name], bounds(name)
        low, high = max(0.1 * value, least) if low is None else low, min(10.0 * value, most) if high is None else high
        known = Variation(name, unit, low, high, whole=isinstance(value, int))
    low, high = (known.low if low is None else low), (known.high if high is None else high)
    if not low < high:
        raise InputError(f"range of {name} from {low:g} to {high:g}: must grow")
    return replace(known, low=low, high=high)


def changed(p: Parameters, key: str, value: Any) -> Parameters:
    """A copy of ``p`` with the parameter ``key`` (dotted) at ``value``; InputError if that is not allowed."""
    try:
        return override(p, {key: value})
    except FaultError as fault:
        raise InputError(str(fault)) from None


def ideal(p: Parameters) -> Parameters:
    """``p`` without what is not linear or not exact: friction, backlash, cogging, tooth errors, noise, coarse counts.

    A worm no longer locks itself; the feel model's gusts, shaker and vibration are off.
    """
    exact = {"drag": 0.0, "efficiency": 1.0, "backdrive_efficiency": 1.0, "backlash": 0.0, "transmission_error": 0.0}
    calm = (
        "friction", "static_friction", "aft.friction", "aft.static_friction", "hydraulics.off_friction",
        "linkage.backlash", "gust.torque", "shaker.torque", "disturbance.vibration",
    )
    return override(p, {
        **{f"gearbox.stage{k}.{key}": value for k in range(1, p.gearbox.stages + 1) for key, value in exact.items()},
        **{f"feel.{key}": 0.0 for key in calm},
        "motor.cogging_amplitude": 0.0, "column.coulomb_friction": 0.0,
        "encoder.noise": 0.0, "encoder.interpolation": 65536, "load_cell.noise": 0.0,
    })  # fmt: skip
