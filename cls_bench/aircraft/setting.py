"""One axis of an aircraft in one condition, put on a rig: its feel model, and the limits of its bands there."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from cls_bench.aircraft.file import AxisFile, Band, ConditionFile, Number
from cls_bench.aircraft.units import LOCAL, Scale, angle_deg, at_grip, find_unit
from cls_bench.errors import InputError
from cls_bench.input.faults import FaultError, listed, nearest, shown
from cls_bench.parameters import DEG, Feel, Parameters
from cls_bench.parameters.override import known_keys, override


class Limits(NamedTuple):
    """A band as a check of a run on a rig."""

    name: str
    metric: str
    arguments: dict[str, float]
    least: float | None
    greatest: float | None
    unit: str
    source: str


_METRICS = {
    "force": "grip_force", "unloading_force": "grip_force", "friction": "grip_friction", "breakout": "grip_breakout",
    "rest": "return_angle_deg", "play": "grip_play_mm",
}  # fmt: skip
"""The metric that judges each kind of band."""


@dataclass(frozen=True)
class Setting:
    """An axis in a condition."""

    axis: str
    condition: str
    """empty of an axis that has none"""
    about: AxisFile
    differs: ConditionFile | None
    scale: Scale

    @property
    def title(self) -> str:
        """What it is, in one line."""
        return self.about.title + (f", {self.differs.title}" if self.differs else "")

    @property
    def numbers(self) -> dict[str, Number]:
        """Parameters of the feel model by key, those of the condition instead of the axis's."""
        return {**self.about.feel, **(self.differs.feel if self.differs else {})}

    @property
    def bands(self) -> list[Band]:
        """What its source allows: the axis's bands and the condition's."""
        return [*self.about.bands, *(self.differs.bands if self.differs else [])]

    @property
    def scale_reason(self) -> str:
        """Why a scale is not 1; empty if both are."""
        if self.scale == Scale():
            return ""
        own = self.differs.scale_reason if self.differs else None
        return own or self.about.scale_reason or "chosen by the scenario"

    def feel(self, rig: Parameters) -> dict[str, Any]:
        """Values of the feel model's parameters on a rig, by dotted key, SI."""
        known = known_keys()
        found: dict[str, Any] = {}
        for key, number in self.numbers.items():
            if not number.values:
                found[f"feel.{key}"] = number.value
                continue
            unit = find_unit(number.unit or "", known[f"feel.{key}"]["unit"])
            if unit is None:
                raise FaultError(f"feel.{key}", f"{number.unit} is no unit of it")
            values = [
                unit.converted(value, rig.column.grip_height, self.scale, of_control=key not in LOCAL)
                for value in number.values
            ]
            found[f"feel.{key}"] = values if isinstance(number.value, list) else values[0]
        return found

    def on(self, rig: Parameters) -> Parameters:
        """The rig's parameters with this feel; of the rig's own only the stops' stiffness and damping are left.

        Raises FaultError, with the key as it is in a scenario.
        """
        bare, own = Feel(), rig.feel
        limits = {
            name: getattr(bare, name).model_copy(
                update={part: getattr(getattr(own, name), part) for part in ("stiffness", "damping")}
            )
            for name in ("aft_limit", "forward_limit")
        }
        return override(rig.model_copy(update={"feel": bare.model_copy(update=limits)}), self.feel(rig))

    def limits(self, rig: Parameters) -> list[Limits]:
        """The bands as checks of a run on a rig: forces in N at its grip, angles in degrees of its control."""
        return [self._limits(band, rig.column.grip_height) for band in self.bands]

    def _limits(self, band: Band, grip: float) -> Limits:
        def limit(value: float | None) -> float | None:
            if value is None:
                return None
            if band.of == "rest":
                return angle_deg(value, band.unit, grip, self.scale)
            if band.of == "play":  # a travel of the grip [mm]
                return angle_deg(value, band.unit, grip, self.scale) * DEG * grip * 1e3
            return at_grip(value, band.unit, grip, self.scale)

        arguments: dict[str, float] = {}
        if band.at is not None and band.at_unit is not None:
            if band.of == "play":
                arguments["force_N"] = at_grip(band.at, band.at_unit, grip, self.scale)
            else:
                name = "threshold_deg" if band.of == "breakout" else "at_deg"
                arguments[name] = angle_deg(band.at, band.at_unit, grip, self.scale)
        if band.of == "unloading_force":
            arguments["unloading"] = 1.0
        unit = {"rest": "deg", "play": "mm"}.get(band.of, "N")
        return Limits(
            band.name, _METRICS[band.of], arguments, limit(band.least), limit(band.greatest), unit, band.source
        )


def chosen(what: str, name: str | None, there: list[str]) -> str:
    """The one that is meant: by name, or the only one. Raises InputError that lists them."""
    if name is None:
        if len(there) != 1:
            raise InputError(f"missing; give the {what}: {listed(there)}")
        return there[0]
    if name not in there:
        raise InputError(f"{shown(name)} is no {what} of it; {nearest(name, there) if there else 'it has none'}")
    return name
