"""What an aircraft's file may say.

.. code-block:: toml

    title = "…"
    description = "…"

    [elevator]                          # an axis: a control of the aircraft, by a name of its own
    title = "…"
    rig = "elevator"                    # the rig that fits it

    [elevator.feel]                     # parameters of the feel model, in units of the grip
    stiffness = { value = 16.0, unit = "N/deg", least = 14.0, greatest = 20.0, source = "…" }
    "centering.breakout" = { value = 25.0, unit = "N", least = 10.0, greatest = 46.0, source = "…" }

    [elevator.conditions.hydraulics_off]        # what differs
    title = "…"
    feel."hydraulics.pressure" = { value = 0.0, unit = "1", least = 0.0, greatest = 1.0, source = "…" }

    [[elevator.conditions.hydraulics_off.bands]]        # what the source allows
    name = "breakout"
    of = "breakout"
    greatest = 115.0
    unit = "N"
    source = "…"

Forward is positive, of positions and forces alike. A number without a source is refused; one that is assumed says why.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, Field, ValidationError, model_validator

from cls_bench.aircraft.units import find_unit, units_for
from cls_bench.input.faults import FaultError, listed, nearest, problem_of, shown
from cls_bench.input.tables import IN_FILE, Strict, place_of, worst
from cls_bench.parameters.override import known_keys

Title = Annotated[str, Field(min_length=1, max_length=200)]
Source = Annotated[str, Field(min_length=3, max_length=1000)]
Real = Annotated[float, Field(ge=-1e9, le=1e9)]
Share = Annotated[float, Field(gt=0, le=1)]


class Number(Strict):
    """A value of a feel model's parameter, with its bounds and source."""

    value: float | bool | str | Annotated[list[Real], Field(min_length=1, max_length=32)]
    """the value; a list of numbers for a table"""
    unit: str | None = None
    """its unit: of the grip, such as "N", "N/deg" or "mm", or SI; none of a word or of true and false"""
    least: Real | None = None
    """least value that the source, or reason, allows [the unit]"""
    greatest: Real | None = None
    """greatest value that it allows [the unit]"""
    source: Source
    """where it is from; "assumed: why" if there is no source"""

    @property
    def values(self) -> list[float]:
        """The numbers; none of a word."""
        if isinstance(self.value, list):
            return self.value
        return [] if isinstance(self.value, bool | str) else [self.value]

    @property
    def is_assumed(self) -> bool:
        """Whether it has no source but a reason."""
        return self.source.startswith("assumed")

    @model_validator(mode="after")
    def _bounded(self) -> "Number":
        check_source(self.source)
        if not self.values:
            if (self.unit, self.least, self.greatest) != (None, None, None):
                raise ValueError(f"{shown(self.value)} is no number; leave out unit, least and greatest")
            return self
        missing = [name for name in ("unit", "least", "greatest") if getattr(self, name) is None]
        if missing or self.least is None or self.greatest is None:
            raise ValueError(f"missing: {listed(missing)}; a number has value, unit, least, greatest and source")
        for value in self.values:
            if not self.least <= value <= self.greatest:
                raise ValueError(
                    f"{value:g} {self.unit} is not within its own bounds; give {self.least:g} to {self.greatest:g}"
                )
        return self


def check_source(source: str) -> None:
    """Raise ValueError unless it says where a number is from, or why it is assumed."""
    if source.startswith("assumed") and not source.removeprefix("assumed").strip(" :."):
        raise ValueError(f'source {shown(source)} does not say why; give "assumed: why"')


class Band(Strict):
    """What the source allows, as a maintenance manual prints it: a check of a run."""

    name: Annotated[str, Field(pattern=r"[a-z][a-z0-9_]{0,39}")]
    """name of the check"""
    of: Literal["force", "unloading_force", "friction", "breakout", "rest", "play"]
    """what is judged at the grip: the force there, away from neutral or on the way back; half the difference of both;
    the force that moves it; where it rests after a release; the free play"""
    at: Real | None = None
    """position of the control, forward positive; of "breakout" how far it moves, of "play" the force that is taken"""
    at_unit: str | None = None
    """unit of the position: "deg", "mm", "in"; of "play" of the force"""
    least: Real | None = None
    """least value that is allowed [unit], forward positive"""
    greatest: Real | None = None
    """greatest value that is allowed [unit], forward positive"""
    unit: str
    """unit of the limits: of a force "N", "daN", "lbf", "kgf", of a wheel's torque "N·m"; of rest an angle or travel"""
    source: Source
    """where the band is printed, or "assumed: why" """

    @model_validator(mode="after")
    def _whole(self) -> "Band":
        check_source(self.source)
        if self.least is None and self.greatest is None:
            raise ValueError("give least, greatest or both")
        if self.least is not None and self.greatest is not None and self.least > self.greatest:
            raise ValueError(f"least {self.least:g} is above greatest {self.greatest:g}")
        of_angle = self.of in ("rest", "play")
        needed = "rad" if of_angle else "N·m"
        if find_unit(self.unit, needed) is None:
            raise ValueError(f"unit {shown(self.unit)} is not valid for {self.of}; give {_units(needed)}")
        if (self.at is None) != (self.at_unit is None):
            raise ValueError("give at and at_unit, or neither")
        if self.at is None:
            if self.of in ("force", "unloading_force", "friction", "play"):
                raise ValueError(f"missing: at; {self.of} is judged at a position")
            return self
        if self.of == "rest":
            raise ValueError("takes no at: it is judged where the control rests")
        needed = "N·m" if self.of == "play" else "rad"
        if find_unit(self.at_unit or "", needed) is None:
            raise ValueError(f"at_unit {shown(self.at_unit)} is not valid; give {_units(needed)}")
        return self


def _units(si: str) -> str:
    return listed(units_for(si))


def _numbers(table: Any) -> Any:
    """Tables within tables as dotted keys: ``[elevator.feel.centering]`` is as good as a dotted key."""
    if not isinstance(table, Mapping):
        return table
    found: dict[str, Any] = {}
    for name, entry in table.items():
        if isinstance(entry, Mapping) and name not in _keys() and entry and all(
            isinstance(inner, Mapping) for inner in entry.values()
        ):
            found |= {f"{name}.{key}": inner for key, inner in _numbers(entry).items()}
        else:
            found[name] = entry
    return found


def _keys() -> dict[str, str]:
    """Parameters of the feel model by key, with their SI units."""
    return {
        key.removeprefix("feel."): about["unit"] for key, about in known_keys().items() if key.startswith("feel.")
    }


Numbers = Annotated[dict[str, Number], BeforeValidator(_numbers)]


class ConditionFile(Strict):
    """What differs in a condition: a speed, a failure."""

    title: Title
    """one line that says which"""
    feel: Numbers = Field(default_factory=dict)
    """parameters of the feel model that differ, by dotted key"""
    bands: Annotated[list[Band], Field(max_length=100)] = Field(default_factory=list)
    """what the source allows in it"""
    force_scale: Share | None = None
    """forces of the rig over those of the aircraft in it [1]; the axis's if left out"""
    scale_reason: Source | None = None
    """why it is not 1"""


class AxisFile(Strict):
    """A control of an aircraft."""

    title: Title
    """one line that says what it is"""
    rig: Title
    """the rig that fits it, by name"""
    force_scale: Share = 1.0
    """forces of the rig over those of the aircraft, where the rig is too weak [1]"""
    angle_scale: Share = 1.0
    """angles of the rig over those of the aircraft, where its travel is too short [1]"""
    scale_reason: Source | None = None
    """why a scale is not 1"""
    feel: Numbers
    """parameters of the feel model, by dotted key"""
    conditions: dict[str, ConditionFile] = Field(default_factory=dict, max_length=30)
    """by name; a scenario has to name one if there are any"""
    bands: Annotated[list[Band], Field(max_length=100)] = Field(default_factory=list)
    """what the source allows in every condition"""

    @model_validator(mode="after")
    def _said(self) -> "AxisFile":
        if (self.force_scale, self.angle_scale) != (1.0, 1.0) and self.scale_reason is None:
            raise ValueError("missing: scale_reason; a scale that is not 1 says why")
        return self


class AircraftFile(Strict):
    """An aircraft as its file describes it: title, description, and a table for each axis."""

    title: Title
    """one line that says what it is"""
    description: str = ""
    """what is to be known of it, and of its sources"""
    axes: Annotated[dict[str, AxisFile], Field(min_length=1, max_length=20)]
    """its controls"""


NEEDED = ("inertia", "damping", "stiffness", "friction", "aft_limit.angle", "forward_limit.angle")
"""What every axis says; the rest of a feel model is left out unless given, stops are as stiff as the rig's."""


def read_table(table: Mapping[str, Any]) -> AircraftFile:
    """The aircraft in a file's ``table``. Raises FaultError."""
    head = {key: value for key, value in table.items() if key in ("title", "description")}
    axes = {key: value for key, value in table.items() if key not in head}
    for name, value in axes.items():
        if not isinstance(value, Mapping):
            raise FaultError(name, f"unknown key; {nearest(name, ('title', 'description'))} or a table for an axis")
    if not axes:
        raise FaultError("", "has no axis; give a table for each, such as [elevator]")
    try:
        found = AircraftFile.model_validate({**head, "axes": axes}, context=IN_FILE)
    except ValidationError as failure:
        raise _fault(failure) from None
    for name, axis in found.axes.items():
        _check_axis(name, axis)
    return found


def _fault(failure: ValidationError) -> FaultError:
    error = worst(failure)
    loc = tuple(part for part in error["loc"] if part not in ("float", "bool", "str") and not _is_kind(part))
    model: type[BaseModel] = AircraftFile
    owner = ""
    for part in loc:
        if isinstance(part, int) or owner in ("axes", "conditions", "feel"):
            owner = ""
            continue
        step = _TABLES.get(part)
        owner = part
        if step is not None and part != loc[-1]:
            model = step
    problem = problem_of({**error, "loc": (owner,)}, model)
    return FaultError(place_of(loc[1:] if loc[:1] == ("axes",) else loc), problem)


_TABLES: Mapping[str, type[BaseModel]] = {
    "axes": AxisFile, "conditions": ConditionFile, "feel": Number, "bands": Band,
}  # fmt: skip


def _is_kind(part: Any) -> bool:
    """Whether a part of a place is pydantic's name of a kind of value, not a key."""
    return isinstance(part, str) and part.startswith(("list[", "constrained-", "function-"))


def _check_axis(name: str, axis: AxisFile) -> None:
    """Keys and units of its numbers, what it has to say, names that are there once. Raises FaultError."""
    for key in NEEDED:
        if key not in axis.feel:
            raise FaultError(f"{name}.feel.{key}", "missing; every axis gives " + listed(NEEDED))
    _check_numbers(f"{name}.feel", axis.feel)
    for condition, about in axis.conditions.items():
        place = f"{name}.conditions.{condition}"
        if about.force_scale not in (None, axis.force_scale) and about.scale_reason is None:
            raise FaultError(f"{place}.scale_reason", "missing; a scale that is not the axis's says why")
        _check_numbers(f"{place}.feel", about.feel)
        _check_names(place, [*axis.bands, *about.bands])
    _check_names(name, axis.bands)
    if axis.angle_scale != 1.0:
        for feel in (axis.feel, *(about.feel for about in axis.conditions.values())):
            if "surface.gearing" in feel and feel["surface.gearing"].unit == "1":
                raise FaultError(f"{name}.feel.surface.gearing", "with an angle_scale give it in rad/m of the grip")


def _check_numbers(place: str, numbers: Mapping[str, Number]) -> None:
    known = _keys()
    for key, number in numbers.items():
        where = f"{place}.{key}"
        if key not in known:
            raise FaultError(where, f"unknown parameter of the feel model; {nearest(key, known)}")
        if not number.values:
            continue
        if find_unit(number.unit or "", known[key]) is None:
            raise FaultError(f"{where}.unit", f"{shown(number.unit)} is not valid; give {_units(known[key])}")


def _check_names(place: str, bands: list[Band]) -> None:
    names = [band.name for band in bands]
    for name in names:
        if names.count(name) > 1:
            raise FaultError(f"{place}.bands", f"{shown(name)} is the name of two bands; names are unique")
