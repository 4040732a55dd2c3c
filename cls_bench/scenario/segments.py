"""What the hand does: the segments of a scenario's ``[[hand]]`` and ``[[squeeze]]``."""
# ruff: noqa: N815  (keys spell newton as SI does: to_N)

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    ConfigDict,
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from cls_bench.input.faults import shown
from cls_bench.input.tables import Strict
from cls_bench.scenario.sample_file import LARGEST, Keys, read_samples

Time = Annotated[float, Field(ge=0, le=3600)]
Span = Annotated[float, Field(gt=0, le=3600)]
Degrees = Annotated[float, Field(ge=-LARGEST["deg"], le=LARGEST["deg"])]
Newtons = Annotated[float, Field(ge=-LARGEST["N"], le=LARGEST["N"])]
Frequency = Annotated[float, Field(gt=0, le=1000)]
Name = Annotated[str, Field(min_length=1, max_length=200)]


def _one_line(text: str) -> str:
    if not text.isprintable():
        raise ValueError(f"{shown(text)} is not one line of printable characters")
    return text


Line = Annotated[Name, AfterValidator(_one_line)]


class Aim(NamedTuple):
    """What a segment steers: the arm's motion, or the force on the forearm's mass; in SI."""

    motion: bool
    """whether :attr:`value` is an angle [rad]; otherwise a force [N]"""
    value: float


def _aim(keys: str, degrees: float | None, newtons: float | None) -> Aim:
    """The angle [deg] or force [N], whichever is given; ValueError that names ``keys`` unless it is exactly one."""
    if degrees is not None and newtons is None:
        return Aim(True, math.radians(degrees))
    if newtons is not None and degrees is None:
        return Aim(False, newtons)
    raise ValueError(f"give either {keys}")


def _with_kind(schema: dict[str, Any]) -> None:
    """A file has to say what kind of segment it means; in Python the class says it."""
    schema["required"] = ["kind", *schema.get("required", ())]


class _Segment(Strict):
    """What the hand does from ``at`` until the next segment starts.

    "The value reached" is the last one asked for, in the segment's own unit. A change from an angle to a force
    starts from 0 N, a change from a force to an angle from the last angle asked for, or 0.
    """

    model_config = ConfigDict(json_schema_extra=_with_kind)

    at: Time
    """start [s]"""

    @property
    def aim(self) -> Aim | None:
        """What it steers, with its leading value [rad or N]."""
        raise NotImplementedError

    @property
    def farthest(self) -> float:
        """Greatest magnitude that it asks for itself [rad or N]."""
        return 0.0 if self.aim is None else abs(self.aim.value)

    @model_serializer(mode="wrap")
    def _kept(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {"kind": getattr(self, "kind"), **handler(self)}  # noqa: B009  (the classes below have it)

    @model_validator(mode="after")
    def _units(self) -> "_Segment":
        _ = self.aim  # raises ValueError unless the units are chosen once
        return self


class Hold(_Segment):
    """Hold an angle or a force; without a value, the one reached."""

    kind: Literal["hold"] = "hold"
    angle_deg: Degrees | None = None
    """column angle that the hand holds [deg]; or give force_N"""
    force_N: Newtons | None = None
    """force on the forearm's mass [N], positive forward; or give angle_deg"""

    @property
    def aim(self) -> Aim | None:
        """The angle [rad] or force [N] to hold; None for the value reached."""
        if self.angle_deg is None and self.force_N is None:
            return None
        return _aim("angle_deg or force_N", self.angle_deg, self.force_N)


class Ramp(_Segment):
    """Go from the value reached to a new one within a time, then hold it."""

    kind: Literal["ramp"] = "ramp"
    to_deg: Degrees | None = None
    """column angle at the end [deg]; or give to_N"""
    to_N: Newtons | None = None
    """force at the end [N]; or give to_deg"""
    over: Span
    """duration of the ramp [s]"""
    smooth: bool = False
    """minimum-jerk profile instead of a straight line"""

    @property
    def aim(self) -> Aim:
        """Angle [rad] or force [N] at the end."""
        return _aim("to_deg or to_N", self.to_deg, self.to_N)


class Step(_Segment):
    """Jump to a new value and hold it."""

    kind: Literal["step"] = "step"
    to_deg: Degrees | None = None
    """column angle [deg]; or give to_N"""
    to_N: Newtons | None = None
    """force [N]; or give to_deg"""

    @property
    def aim(self) -> Aim:
        """Angle [rad] or force [N] after the step."""
        return _aim("to_deg or to_N", self.to_deg, self.to_N)


class _Oscillation(_Segment):
    """What sine and chirp have in common."""

    amplitude_deg: Degrees | None = None
    """amplitude [deg]; or give amplitude_N"""
    amplitude_N: Newtons | None = None
    """amplitude [N]; or give amplitude_deg"""
    offset_deg: Degrees | None = None
    """mean [deg], with amplitude_deg; 0 if left out"""
    offset_N: Newtons | None = None
    """mean [N], with amplitude_N; 0 if left out"""
    fade: Annotated[float, Field(ge=0, le=3600)] = 0.0
    """time over which the oscillation takes over smoothly from the value reached [s]"""

    @property
    def aim(self) -> Aim:
        """Amplitude [rad or N]."""
        return _aim("amplitude_deg or amplitude_N", self.amplitude_deg, self.amplitude_N)

    @property
    def offset(self) -> float:
        """Mean [rad or N]."""
        unit, other = ("deg", self.offset_N) if self.aim.motion else ("N", self.offset_deg)
        if other is not None:
            raise ValueError(f"give offset_{unit}, in the unit of amplitude_{unit}")
        return math.radians(self.offset_deg or 0.0) if self.aim.motion else self.offset_N or 0.0

    @property
    def farthest(self) -> float:
        """Greatest magnitude [rad or N]."""
        return abs(self.offset) + abs(self.aim.value)

    @model_validator(mode="after")
    def _offset(self) -> "_Oscillation":
        _ = self.offset
        return self


class Sine(_Oscillation):
    """Oscillate: offset + amplitude · sin(2π frequency t + phase)."""

    kind: Literal["sine"] = "sine"
    frequency: Frequency
    """frequency [Hz]"""
    phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """phase at the start [deg]"""
    cycles: Annotated[float, Field(gt=0, le=3.6e6)] | None = None
    """number of periods, after which the value reached is held; without it until the next segment [1]"""


class Chirp(_Oscillation):
    """Oscillate while the frequency sweeps from one value to another, then hold the value reached."""

    kind: Literal["chirp"] = "chirp"
    from_hz: Frequency
    """frequency at the start [Hz]"""
    to_hz: Frequency
    """frequency at the end [Hz]"""
    over: Span
    """duration of the sweep [s]"""
    sweep: Literal["linear", "log"] = "linear"
    """whether the frequency or its logarithm grows linearly with time"""


class FileKeys(Strict):
    """How a file with columns over time is read."""

    time_column: Name | None = None
    """header of the column with the time; found if it is called time, t, timestamp or the like"""
    time_unit: Literal["s", "ms", "us", "µs", "ns", "min", "h", "d"] | None = None
    """unit of the time, or of the first field of a clock with two; that of the header, or s, if left out"""
    time_zero: Annotated[float, Field(ge=-1e20, le=1e20)] | None = None
    """what the file's clock shows at the start, in its own unit [1]; if left out 0, or the first
    sample's time where the clock has another origin"""
    delimiter: Literal[",", ";", "\t", "|", " "] | None = None
    """what separates the columns; found out if left out"""
    decimal: Literal[".", ","] | None = None
    """decimal mark; found out if left out"""
    skip: Annotated[int, Field(ge=0, le=100_000)] = 0
    """lines to leave out at the file's beginning [1]"""


class SampleKeys(FileKeys):
    """How a file of recorded samples is read."""

    column: Name = "value"
    """header of the column with the values; its number, such as "2", in a file without headers"""
    scale: Annotated[float, Field(ge=-1e12, le=1e12)] | None = None
    """factor from the file's values to the unit [1]; 1 if left out"""
    offset: Annotated[float, Field(ge=-1e12, le=1e12)] | None = None
    """added to the scaled values, in the unit [1]; 0 if left out"""


class Samples(_Segment, SampleKeys):
    """Follow recorded samples, linearly interpolated; before the first and after the last its value is held."""

    kind: Literal["samples"] = "samples"
    file: Name
    """text file with a header and columns, as loggers and spreadsheets write it; relative to the scenario file"""
    unit: Literal["deg", "N"]
    """unit of the values, after scale and offset: an angle [deg] or a force [N]"""
    _times: NDArray[np.float64] = PrivateAttr(default_factory=lambda: np.zeros(1))
    _values: NDArray[np.float64] = PrivateAttr(default_factory=lambda: np.zeros(1))

    @property
    def aim(self) -> Aim:
        """The last value [rad or N]."""
        return Aim(self.unit == "deg", float(self._values[-1]))

    @property
    def farthest(self) -> float:
        """Greatest magnitude of a sample [rad or N]."""
        return float(np.max(np.abs(self._values)))

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the samples since the segment's start [s]."""
        return self._times

    @property
    def values(self) -> NDArray[np.float64]:
        """The samples [rad or N]."""
        return self._values

    def _read(self, content: bytes, span: float) -> str:
        """Take the samples from the file's ``content``, of which the segment hears ``span`` [s].

        Returns what was understood, in one line; ValueError with one line if the file is not valid.
        """
        keys = {name: getattr(self, name) for name in SampleKeys.model_fields}
        read = read_samples(content, Keys(unit=self.unit, **keys), span)
        self._times, self._values = read.times, np.radians(read.values) if self.unit == "deg" else read.values
        return read.note


class Release(_Segment):
    """Let go of the grip; the forearm stays at the last angle asked for. Any later segment grips again."""

    kind: Literal["release"] = "release"

    @property
    def aim(self) -> None:
        """Nothing."""
        return None


Segment = Hold | Ramp | Step | Sine | Chirp | Samples | Release


class Squeeze(Strict):
    """Change how tightly the hand grips; before the first change it is loose (0)."""

    at: Time
    """start [s]"""
    value: Annotated[float, Field(ge=0, le=1)]
    """from 0, loose, to 1, tight [1]"""
    over: Annotated[float, Field(ge=0, le=3600)] = 0.05
    """duration of the linear change [s]"""


SEGMENTS: Mapping[str, type[_Segment]] = {
    "hold": Hold, "ramp": Ramp, "step": Step, "sine": Sine, "chirp": Chirp, "samples": Samples, "release": Release,
}  # fmt: skip
