"""The tables of a scenario beside the hand: drive, controller, changes, checks, expected trips."""

from typing import Annotated, Any, Literal

from pydantic import Field, WithJsonSchema, field_validator, model_validator

from cls_bench.input.faults import nearest, shown
from cls_bench.input.tables import Strict
from cls_bench.scenario.record import SIGNALS
from cls_bench.scenario.segments import Line, Name, SampleKeys, Span, Time

Limit = Annotated[float, Field(ge=-1e12, le=1e12)]


class DriveStart(Strict):
    """State of the drive when the run begins."""

    power: Literal["on", "off"] = "on"
    """"off" is safe torque off: no torque at all, the motor turns freely"""


class Controller(Strict):
    """A controller of your own in place of the feel model."""

    source: Line
    """FILE.py:NAME, relative to the scenario file, or package.module:NAME"""
    arguments: dict[str, Any] = Field(default_factory=dict, max_length=100)
    """arguments with which NAME is called"""


class Change(SampleKeys):
    """What changes from a given time on: the drive's power or mode, or parameters marked live.

    Parameters jump to their new values, or go there ``over`` a time, or one of them follows recorded samples, linearly
    interpolated; before the first and after the last its value is held.
    """

    at: Time
    """time of the change [s]"""
    power: Literal["on", "off"] | None = None
    """power of the drive; "off" is safe torque off"""
    mode: Literal["position", "velocity", "torque", "off"] | None = None
    """mode of the drive; "off" is safe torque off"""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """new values of live parameters, by dotted key, SI"""
    over: Span | None = None
    """time within which the parameters go there from their present values [s]; at once if left out"""
    smooth: bool = False
    """minimum-jerk profile instead of a straight line"""
    parameter: Name | None = None
    """dotted key of the live parameter that follows the samples of a file"""
    file: Name | None = None
    """text file with a header and columns, as for a hand of recorded samples; values are SI, relative to this file"""

    @model_validator(mode="after")
    def _something(self) -> "Change":
        if self.power is None and self.mode is None and not self.parameters and self.parameter is self.file is None:
            raise ValueError("changes nothing; give power, mode or parameters, or a parameter and its file")
        if self.power == "on" and self.mode == "off":
            raise ValueError('power "on" contradicts mode "off"')
        if (self.parameter is None) != (self.file is None):
            raise ValueError("parameter and file belong together: the one follows the samples of the other")
        if self.file is not None and (self.parameters or self.over is not None):
            raise ValueError("a parameter that follows a file takes no other ones and no over; add another change")
        if self.over is not None and not self.parameters:
            raise ValueError("over is the time within which parameters move; give parameters")
        if self.over is not None and (self.power is not None or self.mode is not None):
            raise ValueError("power and mode change at once, and not over a time; add another change")
        if self.smooth and self.over is None:
            raise ValueError("smooth is the way that parameters go within a time; give over")
        if self.file is None and (unused := self.model_fields_set & SampleKeys.model_fields.keys()):
            raise ValueError(f"{sorted(unused)[0]} says how a file is read; give parameter and file")
        return self


class Check(Strict):
    """A metric over a time window, with limits; without limits it is only reported."""

    name: Line
    """name under which the result is listed; unique in the scenario"""
    metric: Name
    """what is measured, see `cls-bench list --metrics`"""
    window: Annotated[tuple[Time, Time], Field(strict=False)]
    """start and end [s]"""
    signal: Annotated[str, WithJsonSchema({"type": "string", "enum": list(SIGNALS)})] | None = None
    """recorded signal that a general metric evaluates, such as "/column.torque" (topic and name)"""
    min: Limit | None = None
    """least value that passes [unit of the metric]"""
    max: Limit | None = None
    """greatest value that passes [unit of the metric]"""
    arguments: dict[str, float] = Field(default_factory=dict, max_length=20)
    """further numbers that the metric takes"""

    @field_validator("signal")
    @classmethod
    def _known(cls, signal: str | None) -> str | None:
        if signal is not None and signal not in SIGNALS:
            raise ValueError(f"{shown(signal)} is not recorded; {nearest(signal, SIGNALS)}")
        return signal


class ExpectedTrip(Strict):
    """A safety function is meant to switch the drive off; without one, a trip makes the run `tripped`."""

    reason: Literal["limit_switch", "following_error", "invalid_value", "any"]
    """which one; "any" is whichever comes"""
    window: Annotated[tuple[Time, Time], Field(strict=False)]
    """when: start and end [s]; the run fails if none comes"""
