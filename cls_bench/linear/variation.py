"""What an onset is searched over: a quantity of the bench or of the hand, with its range."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from pydantic import ValidationError

from cls_bench.errors import InputError
from cls_bench.linear.hand import Hand, forward_inertia, limb_mass_for
from cls_bench.parameters import Parameters, Section, leaves


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
    heaviest = bare + HEAVIEST * p.column.grip_height**2
    chosen = (
        Variation("limb_mass", "kg", 0.02, 20.0),
        Variation("forward_inertia", "kg·m²", _rounded(1.1 * bare), _rounded(min(50.0 * bare, heaviest))),
        Variation("squeeze", "1", 0.0, 1.0),
        Variation("delay", f"cycles of {p.rates.bus_cycle * 1e3:g} ms", 0, 16, whole=True),
        Variation("feel.inertia", "kg·m²", _rounded(0.5 * bare), _rounded(75.0 * bare)),
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
        value, unit = found[name]
        low, high = (0.1 * value if low is None else low), (10.0 * value if high is None else high)
        known = Variation(name, unit, low, high, whole=isinstance(value, int))
    low, high = (known.low if low is None else low), (known.high if high is None else high)
    if not low < high:
        raise InputError(f"range of {name} from {low:g} to {high:g}: must grow")
    return replace(known, low=low, high=high)


def changed(p: Parameters, key: str, value: Any) -> Parameters:
    """A copy of ``p`` with the parameter ``key`` (dotted) at ``value``; InputError if that is not allowed."""
    try:
        return _changed(p, key.split("."), value)
    except AttributeError:
        raise InputError(f'parameter "{key}" does not exist') from None
    except ValidationError as error:
        raise InputError(f"{key} = {value}: {error.errors()[0]['msg']}") from None


_S = TypeVar("_S", bound=Section)


def _changed(section: _S, path: Sequence[str], value: Any) -> _S:
    """Copies of the sections along ``path`` alone, each checked as a whole."""
    name, *rest = path
    if name not in type(section).model_fields:
        raise AttributeError(name)
    inner = getattr(section, name)
    if isinstance(inner, Section) != bool(rest):
        raise AttributeError(".".join(path))
    return type(section)(**{**dict(section), name: _changed(inner, rest, value) if rest else value})


def ideal(p: Parameters) -> Parameters:
    """``p`` without what is not linear or not exact: friction, backlash, cogging, tooth errors, noise, coarse counts.

    A worm no longer locks itself.
    """
    for name in ("stage1", "stage2", "stage3"):
        for key, value in (
            ("drag", 0.0), ("efficiency", 1.0), ("backdrive_efficiency", 1.0), ("backlash", 0.0),
            ("transmission_error", 0.0),
        ):  # fmt: skip
            p = changed(p, f"gearbox.{name}.{key}", value)
    for key, value in (
        ("motor.cogging_amplitude", 0.0), ("column.coulomb_friction", 0.0), ("feel.friction", 0.0),
        ("encoder.noise", 0.0), ("encoder.interpolation", 65536), ("load_cell.noise", 0.0),
    ):  # fmt: skip
        p = changed(p, key, value)
    return p
