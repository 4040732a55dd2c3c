"""``[aircraft]`` of a scenario: whose feel is put on the rig, and what that asks of it."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated

from pydantic import Field

from cls_bench.aircraft import Aircraft, Setting, find_aircraft, reach
from cls_bench.errors import InputError
from cls_bench.input.faults import FaultError
from cls_bench.input.tables import Strict
from cls_bench.parameters import Parameters
from cls_bench.scenario.segments import Name
from cls_bench.text import escaped

Share = Annotated[float, Field(gt=0, le=1)]


class AircraftChoice(Strict):
    """An aircraft's control, whose feel is put on the rig."""

    name: Name
    """an aircraft that comes with the bench (`cls-bench aircraft`), or a file, relative to this one"""
    axis: Name | None = None
    """which of its controls; may be left out if there is but one"""
    condition: Name | None = None
    """in which of its conditions, if it has any"""
    force_scale: Share | None = None
    """forces of the rig over those of the aircraft, instead of the aircraft's own [1]"""
    angle_scale: Share | None = None
    """angles of the rig over those of the aircraft, instead of the aircraft's own [1]"""

    def found(self, folder: Path, given: Mapping[str, bytes] | None) -> tuple[Aircraft, Setting]:
        """The aircraft and the setting that are meant. Raises FaultError."""
        try:
            aircraft = find_aircraft(self.name, folder, given)
        except InputError as error:
            raise FaultError("aircraft.name", str(error)) from None
        try:
            setting = aircraft.setting(
                self.axis, self.condition, force_scale=self.force_scale, angle_scale=self.angle_scale
            )
        except FaultError as fault:
            raise FaultError(f"aircraft.{fault.key}", fault.problem) from None
        return aircraft, setting


_VERDICTS = {
    "short": "enough for a short time", "too weak": "too weak, give aircraft.force_scale",
    "too far": "its travel is too short, give aircraft.angle_scale",
}  # fmt: skip


def put_on(setting: Setting, rig: Parameters) -> Parameters:
    """The rig's parameters with the aircraft's feel. Raises FaultError."""
    try:
        return setting.on(rig)
    except FaultError as fault:
        raise FaultError("aircraft", str(fault)) from None


def said_of(aircraft: Aircraft, setting: Setting, rig: Parameters) -> Iterator[str]:
    """What is to be known of the run: scales, reach, and how many numbers are assumed."""
    name = f"aircraft {aircraft.name}"
    scale = setting.scale
    if scale.force != 1.0 or scale.angle != 1.0:
        parts = [
            f"{what} are {value:g} of the aircraft's"
            for what, value in (("forces", scale.force), ("angles", scale.angle)) if value != 1.0
        ]  # fmt: skip
        yield f"{name}: {' and '.join(parts)} ({setting.scale_reason})"
    can = reach(setting, rig)
    if can.verdict != "lasting":
        yield (
            f"{name}: up to {can.largest:.0f} N at the grip and {can.travel:.3g}°; this rig holds {can.lasting:.0f} N "
            f"for good, measures {can.measured:.0f} N, pushes with {can.peak:.0f} N, and travels {can.room:.3g}°: "
            f"{_VERDICTS[can.verdict]}"
        )
    assumed = sum(number.is_assumed for number in setting.numbers.values())
    shown = escaped(aircraft.file) if aircraft.is_file else aircraft.name
    yield f"{name}: {assumed} of {len(setting.numbers)} numbers are assumed (`cls-bench aircraft {shown}`)"
