"""The flight of a scenario: what a host computer would tell the feel model of it, over time.

``[flight]`` gives airspeed, altitude, angle of attack, load factor and tab, each as a constant, as points over time or
as a column of a file. In each host cycle of 10 ms the feel model's ``feel.flight`` parameters are worked out from them,
with the standard atmosphere (:mod:`cls_bench.atmosphere`). As over a real link, the bench goes to each value in a
straight line while the next is awaited: it is one host cycle late, and without stairs. Other live parameters may follow
schedules over the airspeed in the same way.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, WithJsonSchema, field_validator, model_validator

from cls_bench import atmosphere, course
from cls_bench.atmosphere import FOOT, KNOT
from cls_bench.course import Course
from cls_bench.input.faults import FaultError, shown
from cls_bench.parameters.moving import HOST_CYCLE, STEPPED
from cls_bench.parameters.override import bounds, flat
from cls_bench.quantity import DEG
from cls_bench.scenario.moving import check_follower
from cls_bench.scenario.sample_file import Keys, read_samples
from cls_bench.scenario.segments import FileKeys, Name
from cls_bench.signals import Clock
from cls_bench.text import escaped

Array = NDArray[np.float64]


class _Quantity(NamedTuple):
    unit: str
    low: float
    high: float


def _of_parameter(key: str, unit: str, scale: float) -> _Quantity:
    low, high = bounds(f"feel.flight.{key}")
    return _Quantity(unit, low / scale, high / scale)


QUANTITIES: Mapping[str, _Quantity] = {
    "airspeed_kt": _Quantity("kt", 0.0, 660.0),
    "true_airspeed_kt": _Quantity("kt", 0.0, 660.0),
    "altitude_ft": _Quantity("ft", atmosphere.LOWEST / FOOT, atmosphere.HIGHEST / FOOT),
    "angle_of_attack_deg": _of_parameter("angle_of_attack", "deg", DEG),
    "load_factor": _of_parameter("load_factor", "1", 1.0),
    "tab_deg": _of_parameter("tab", "deg", DEG),
}
"""What a flight is given by, with unit and bounds: 660 kt is the speed of sound at sea level, others are those of the
parameters."""

_FORM = "a number, points [[time, value], …], or the header of a column of file"

Schedule = Annotated[
    Any,
    WithJsonSchema(
        {
            "anyOf": [
                {"type": "number"}, {"type": "string", "minLength": 1, "maxLength": 200},
                {"type": "array", "minItems": 1, "items": {
                    "type": "array", "prefixItems": [{"type": "number"}, {"type": "number"}], "minItems": 2,
                    "maxItems": 2,
                }},
            ]
        }
    ),
]  # fmt: skip
"""A value over time."""

MOST_POINTS = 10_000
"""Points of a schedule in the scenario itself."""


def _are_points(given: Any) -> bool:
    return isinstance(given, list | tuple) and len(given) > 0 and all(
        isinstance(p, list | tuple) and len(p) == 2 and all(map(_is_number, p)) for p in given
    )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


class Flight(FileKeys):
    """The flight that the feel model follows, each value a number, points over time, or a column of a file."""

    airspeed_kt: Schedule | None = None
    """calibrated airspeed, what an indicator without error shows [kt]; or give true_airspeed_kt"""
    true_airspeed_kt: Schedule | None = None
    """true airspeed [kt]; or give airspeed_kt"""
    altitude_ft: Schedule | None = None
    """pressure altitude in the standard atmosphere [ft]; 0 if left out"""
    angle_of_attack_deg: Schedule | None = None
    """angle of attack, of a rudder the sideslip [deg]"""
    load_factor: Schedule | None = None
    """load factor n_z [1]"""
    tab_deg: Schedule | None = None
    """deflection of the trim tab [deg]"""
    schedules: dict[str, Any] = Field(default_factory=dict, max_length=100)
    """other live parameters that follow the airspeed, by dotted key: points [[kt, value], …], values in SI"""
    file: Name | None = None
    """text file with columns over time, as for a hand of recorded samples; relative to the scenario file"""

    @field_validator(*QUANTITIES)
    @classmethod
    def _valid(cls, given: Any, info: ValidationInfo) -> Any:
        name = str(info.field_name)
        if given is None or (isinstance(given, str) and 0 < len(given) <= 200):
            return given
        if _is_number(given):
            _check_value(name, given, "")
            return given
        if _are_points(given):
            if len(given) > MOST_POINTS:
                raise ValueError(f"has {len(given)} points; at most {MOST_POINTS} are valid")
            for before, after in pairwise(given):
                if not after[0] > before[0]:
                    raise ValueError(f"the time {after[0]:g} s does not come after {before[0]:g} s")
            for time, value in given:
                _check_value(name, value, f" at {time:g} s")
            return given
        raise ValueError(f"{shown(given)} is not valid; give {_FORM}")

    @model_validator(mode="after")
    def _together(self) -> "Flight":
        if self.airspeed_kt is not None and self.true_airspeed_kt is not None:
            raise ValueError("give either airspeed_kt or true_airspeed_kt")
        if self.altitude_ft is not None and self.airspeed_kt is None and self.true_airspeed_kt is None:
            raise ValueError("altitude_ft means nothing without airspeed_kt or true_airspeed_kt")
        columns = [name for name in QUANTITIES if isinstance(getattr(self, name), str)]
        if columns and self.file is None:
            raise ValueError(f"{columns[0]} = {shown(getattr(self, columns[0]))} is the column of a file; give file")
        if self.file is not None and not columns:
            raise ValueError(f"no value is taken from file {shown(self.file)}; give one a column's header")
        if self.file is None and (unused := self.model_fields_set & FileKeys.model_fields.keys()):
            raise ValueError(f"{sorted(unused)[0]} says how a file is read; give file")
        if self.schedules and self.airspeed is None:
            raise ValueError("schedules are over the airspeed; give airspeed_kt or true_airspeed_kt")
        if not self.given:
            raise ValueError(f"gives nothing; valid: {', '.join(QUANTITIES)}")
        return self

    @property
    def given(self) -> tuple[str, ...]:
        """Names of what is given."""
        return tuple(name for name in QUANTITIES if getattr(self, name) is not None)

    @property
    def airspeed(self) -> str | None:
        """Name of the airspeed that is given."""
        return next((name for name in ("airspeed_kt", "true_airspeed_kt") if name in self.given), None)

    @property
    def drives(self) -> tuple[str, ...]:
        """Keys of the parameters that follow from it."""
        return (*self.given_directly, *dict(flat(self.schedules)))

    @property
    def given_directly(self) -> tuple[str, ...]:
        """Those of them that no schedule gives."""
        keys = ["dynamic_pressure", "airspeed"] if self.airspeed else []
        keys += [key for key, name in _DIRECT.items() if name in self.given]
        return tuple(f"feel.flight.{key}" for key in keys)


_DIRECT = {"angle_of_attack": "angle_of_attack_deg", "load_factor": "load_factor", "tab": "tab_deg"}


def _check_value(name: str, value: float, where: str) -> None:
    quantity = QUANTITIES[name]
    if not quantity.low <= value <= quantity.high:
        unit = "" if quantity.unit == "1" else f" [{quantity.unit}]"
        raise ValueError(f"{value:g}{where} is not valid; it must be ≥ {quantity.low:g} and ≤ {quantity.high:g}{unit}")


class Flown(NamedTuple):
    """A flight as it is flown."""

    start: Mapping[str, float]
    """the parameters that follow from it, when the run begins"""
    courses: Mapping[str, Course]
    """of those that change"""
    notes: tuple[str, ...]
    """what was understood of its file"""
    probes: tuple[tuple[str, float], ...] = ()
    """where schedules are to be checked against the rules that join several parameters: key and tick"""


def fly(flight: Flight, clock: Clock, duration: float, content: bytes | None) -> Flown:
    """What the feel model is told in a run of ``duration`` [s]; ``content`` is that of the flight's file.

    Raises FaultError.
    """
    cycle = max(1, round(HOST_CYCLE / clock.plc_s)) * clock.plc_ticks
    ticks = np.arange(0, clock.tick_of(duration) + cycle, cycle).astype(np.float64)
    times = ticks * clock.tick_s
    notes: list[str] = []
    given = dict(_given(flight, times, duration, content, notes))
    told: dict[str, Array] = {}
    for name, of in (("airspeed_kt", atmosphere.of_calibrated), ("true_airspeed_kt", atmosphere.of_true)):
        if name in given:
            told |= _speeds(name, of, given[name], given.get("altitude_ft", np.zeros(1)), times)
    for key, name in _DIRECT.items():
        if name in given:
            told[f"feel.flight.{key}"] = given[name] * (DEG if name.endswith("_deg") else 1.0)
    scheduled = dict(flat(flight.schedules))
    for key, points in scheduled.items():
        told[key] = np.interp(given[str(flight.airspeed)], *_schedule(key, points, flight.given_directly))
    start: dict[str, float] = {}
    courses: dict[str, Course] = {}
    line = ", ".join([_line(flight, given), *(f"{key} over airspeed" for key in scheduled)])
    for key, values in told.items():
        start[key] = float(values[0])
        if np.ptp(values) > 0.0:
            # What the host works out at the beginning of its cycle is reached at the beginning of the next.
            late = np.append(values[0], values[:-1])
            new = np.append(True, np.diff(late) != 0.0)
            pieces = course.steps(ticks[new], late[new]) if key in STEPPED else course.lines(ticks, late)
            courses[key] = Course(pieces, () if courses else ((0, line),))
    moments = np.linspace(0.0, ticks[-1], 21).tolist() if scheduled else []
    return Flown(start, courses, tuple(notes), tuple(("flight.schedules", tick) for tick in moments))


def _schedule(key: str, points: Any, driven: Sequence[str]) -> tuple[Array, Array]:
    """Airspeeds [kt] and values of the schedule of a parameter that is not ``driven`` already. Raises FaultError."""
    where = f"flight.schedules.{key}"
    check_follower(where, key, driven)
    if not _are_points(points) or len(points) > MOST_POINTS:
        raise FaultError(where, f"{shown(points)} is not valid; give up to {MOST_POINTS} points [[kt, value], …]")
    speed, value = np.array(points, np.float64).T
    if not np.all(np.diff(speed) > 0.0):
        raise FaultError(where, "its airspeeds do not grow from point to point")
    low, high = bounds(key)
    for each in value.tolist():
        if not low <= each <= high:
            raise FaultError(where, f"{each:g} is not valid; it must be ≥ {low:g} and ≤ {high:g}")
    return speed, value


def _given(
    flight: Flight, times: Array, duration: float, content: bytes | None, notes: list[str]
) -> Iterator[tuple[str, Array]]:  # fmt: skip
    """What is given at ``times``, by name; a constant as one value."""
    for name in flight.given:
        value, quantity = getattr(flight, name), QUANTITIES[name]
        if isinstance(value, str):
            assert content is not None
            how = {key: getattr(flight, key) for key in FileKeys.model_fields}
            keys = Keys(quantity.unit, value, bounds=(quantity.low, quantity.high), constant=True, **how)
            try:
                read = read_samples(content, keys, duration)
            except ValueError as error:
                told = str(error)
                for absent in ("column", "scale"):  # keys of other files
                    told = told.partition(f"; give {absent}")[0]
                raise FaultError(f"flight.{name}", f"file {shown(flight.file)} {told}") from None
            notes.append(f"flight.{name} {escaped(str(flight.file))}: {read.note}")
            yield name, np.interp(times, read.times, read.values)
        elif isinstance(value, list | tuple):
            points = np.array(value, np.float64)
            yield name, np.interp(times, points[:, 0], points[:, 1])
        else:
            yield name, np.array([float(value)])


def _speeds(
    name: str, of: Callable[[Any, Any], atmosphere.Airspeed], airspeed: Array, altitude: Array, times: Array
) -> dict[str, Array]:
    speed, height = np.broadcast_arrays(KNOT * airspeed, FOOT * altitude)
    # Both bounds are rounded: 20 km in feet is not 20 km any more.
    height = np.clip(height, atmosphere.LOWEST, atmosphere.HIGHEST)
    try:
        found = of(speed, height)
    except ValueError:
        with np.errstate(all="ignore"):
            for k, (v, h) in enumerate(zip(speed.tolist(), height.tolist(), strict=True)):
                try:
                    of(v, h)
                except ValueError as error:
                    raise FaultError(
                        f"flight.{name}",
                        f"{v / KNOT:g} kt at {h / FOOT:g} ft, {times[k]:g} s, is not valid: {error}",
                    ) from None
        raise
    return {"feel.flight.dynamic_pressure": found.dynamic_pressure, "feel.flight.airspeed": found.true}


def _line(flight: Flight, given: Mapping[str, Array]) -> str:
    """What the log says of it."""
    said = []
    for name, values in given.items():
        low, high = float(np.min(values)), float(np.max(values))
        unit = QUANTITIES[name].unit
        unit = "" if unit == "1" else "°" if unit == "deg" else f" {unit}"
        what = name.removesuffix("_kt").removesuffix("_ft").removesuffix("_deg").replace("_", " ")
        said.append(f"{what} {low:.4g}{unit}" if low == high else f"{what} {low:.4g} to {high:.4g}{unit}")
    where = f" from {escaped(flight.file)}" if flight.file else ""
    return f"flight{where}: {', '.join(said)}"
