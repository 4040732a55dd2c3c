"""A scenario: what the hand does, what changes while the run goes on, and what is checked afterwards.

It is read from a TOML file (:mod:`cls_bench.scenario.reading`) or made in Python with the same keys, and checked as a
whole either way: an unknown key, a wrong type or an impossible value is an :class:`~cls_bench.errors.InputError` of one
line that names the key, the value and what would be valid. Units at this border stand in the key (``to_deg``,
``to_N``); keys without one are SI, as their descriptions say. Times are rounded to the tick, which follows from the
scenario's ``rates``.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from cls_bench.aircraft import Aircraft
from cls_bench.controllers import Place
from cls_bench.course import Course
from cls_bench.errors import InputError
from cls_bench.input.faults import FaultError, problem_of, shown
from cls_bench.input.files import read_file
from cls_bench.input.tables import LONGEST_LINE, Strict, place_of, worst
from cls_bench.parameters import PLANT, Parameters
from cls_bench.parameters.override import differences, flat, nested, parameters_with
from cls_bench.rigs import THESIS, Rig, find_rig
from cls_bench.scenario.beyond import beyond_the_rig
from cls_bench.scenario.entries import Change, Check, Controller, DriveStart, ExpectedTrip
from cls_bench.scenario.flight import Flight, Flown, fly
from cls_bench.scenario.moving import Motion, Switch, motion
from cls_bench.scenario.placing import place
from cls_bench.scenario.record import Record
from cls_bench.scenario.sample_file import MOST_BYTES
from cls_bench.scenario.segments import SEGMENTS, Line, Name, Samples, Segment, Span, Squeeze
from cls_bench.scenario.with_aircraft import AircraftChoice, put_on, said_of
from cls_bench.scenario.writing import as_toml, check_writable
from cls_bench.signals import Clock, Topic, topics
from cls_bench.step_limit import unstable_parameter
from cls_bench.text import escaped

SOON = 0.001
"""Time [s] within which a change has taken effect."""


@dataclass(frozen=True)
class Origin:
    """Where a scenario comes from; what it is validated with."""

    name: str = "scenario"
    path: Path | None = None
    source: bytes | None = None
    """the TOML text; None of one made in Python"""
    overrides: tuple[str, ...] = ()
    """``KEY=VALUE`` that were placed in it"""
    overridden: frozenset[str] = frozenset()
    """their full keys"""
    files: Mapping[str, bytes] | None = None
    """sample files and the rig's by name, instead of those on the disk"""
    rig: Rig | None = None
    """instead of the one that the scenario names"""
    written_for: str = ""
    """the one that it names, if another is taken instead"""
    file: str = field(default="scenario")
    """what messages call it"""


class Scenario(Strict):
    """One experiment."""

    title: Line
    """one line that says what is shown"""
    description: str = ""
    """what happens, and what to look at"""
    duration: Span
    """length of the run [s]"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """seed of the sensors' noise [1]"""
    rig: Name = THESIS
    """what it is run on: a rig that comes with the bench (`cls-bench rigs`), or a file, relative to this one"""
    aircraft: AircraftChoice | None = None
    """an aircraft's control, whose feel is put on the rig before the parameters"""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """values that differ from the rig's, by dotted key, SI"""
    drive: DriveStart = DriveStart()
    """state of the drive when the run begins"""
    controller: Controller | None = None
    """a controller of your own in place of the feel model"""
    hand: list[Annotated[Segment, Field(discriminator="kind")]] = Field(default_factory=list, max_length=10_000)
    """what the hand does, in order of time; before the first segment it does not grip"""
    squeeze: list[Squeeze] = Field(default_factory=list, max_length=10_000)
    """how tightly the hand grips, in order of time"""
    record: Record = Record()
    """what is recorded; without it all signals at their own rates"""
    flight: Flight | None = None
    """the flight that the feel model follows"""
    changes: list[Change] = Field(default_factory=list, max_length=1000)
    """what changes while the run goes on, in order of time"""
    checks: list[Check] = Field(default_factory=list, max_length=1000)
    """metrics to evaluate after the run"""
    expected_trips: list[ExpectedTrip] = Field(default_factory=list, max_length=1000)
    """safety functions that are meant to switch the drive off"""

    _origin: Origin = PrivateAttr(default_factory=Origin)
    _rig: Rig = PrivateAttr()
    _start: Parameters = PrivateAttr()
    _aircraft: Aircraft | None = PrivateAttr(default=None)
    _files: dict[str, bytes] = PrivateAttr(default_factory=dict)
    _motion: Motion = PrivateAttr(default=Motion({}, (), ()))
    _notes: tuple[str, ...] = PrivateAttr(default=())

    @model_validator(mode="wrap")
    @classmethod
    def _in_one_line(
        cls, data: Any, handler: ModelWrapValidatorHandler["Scenario"], info: ValidationInfo
    ) -> "Scenario":
        """As of every table, with the check of the whole."""
        origin = info.context if isinstance(info.context, Origin) else Origin()
        if isinstance(data, Scenario):
            return handler(data)
        try:
            try:
                scenario = handler(data)
            except ValidationError as failure:
                raise _fault(failure) from None
            scenario._settle(origin)
        except FaultError as fault:
            key, said = fault.key, origin.file
            if key in origin.overridden:
                said = "--set"
            elif any(name.startswith(f"{key}.") for name in origin.overridden):
                said = f"{said} with --set"  # a section as a whole, of which either may be to blame
            raise InputError(f"{said}: {escaped(str(fault), LONGEST_LINE)}") from None
        return scenario

    def _settle(self, origin: Origin) -> None:
        """Find what it names, and check it as a whole. Raises FaultError."""
        self._origin, self._files = origin, {}
        if origin.source is None:
            check_writable(self)
        self._find_rig()
        for key, _ in flat(self.parameters):
            if self.flight is not None and key in self.flight.drives:
                raise FaultError(f"parameters.{key}", "follows from [flight]; give one of them")
        base, of_aircraft = self._with_aircraft()
        self._start = parameters_with("parameters", base, self.parameters)
        _check(self)
        self._read_samples()
        of_files = self._set_in_motion()
        self._notes = (*self._notes, *of_files, *of_aircraft, *beyond_the_rig(self.hand, self._start))
        written_for = origin.written_for
        if written_for not in ("", self.rig) and any(c.min is not None or c.max is not None for c in self.checks):
            said = f"checks: their limits were written for the rig {shown(written_for)}"
            self._notes = (*self._notes, f"{said}, and may mean little on {self._rig.name}")

    def _find_rig(self) -> None:
        origin, given = self._origin, self._origin.files
        folder = origin.path.parent if origin.path else Path()
        try:
            self._rig = origin.rig or find_rig(self.rig, folder, given)
        except InputError as error:
            raise FaultError("rig", str(error)) from None
        if self._rig.name != THESIS:
            self._files[self._rig.file] = self._rig.source

    def _with_aircraft(self) -> tuple[Parameters, tuple[str, ...]]:
        """The rig's parameters with the feel of the aircraft, if there is one, and what is to be said of it."""
        rig = self._rig.parameters
        if self.aircraft is None:
            return rig, ()
        folder = self._origin.path.parent if self._origin.path else Path()
        aircraft, setting = self.aircraft.found(folder, self._origin.files)
        self._aircraft, self._files[aircraft.file] = aircraft, aircraft.source
        return put_on(setting, rig), tuple(said_of(aircraft, setting, rig))

    def _content(self, key: str, name: str) -> bytes:
        """Content of a file that is named at ``key``."""
        origin, given = self._origin, self._origin.files
        folder = origin.path.parent if origin.path else Path()
        if given is not None and name not in given:
            raise FaultError(key, f"{shown(name)} is not among the recording's attachments")
        try:
            self._files[name] = read_file(folder / name, MOST_BYTES) if given is None else given[name]
        except OSError as error:
            raise FaultError(key, f"{shown(name)} cannot be read: {error.strerror or error}") from None
        return self._files[name]

    def _set_in_motion(self) -> list[str]:
        """Work out how parameters move, and check them on their way; returns what was understood of files."""
        notes, flown, driven = list[str](), Flown({}, {}, ()), tuple[str, ...]()
        if (flight := self.flight) is not None:
            driven = flight.drives
            content = None if flight.file is None else self._content("flight.file", flight.file)
            flown = fly(flight, self.clock, self.duration, content)
            self._start = parameters_with("flight", self._start, flown.start)
            notes += flown.notes
        files = {
            k: self._content(f"changes[{k}].file", change.file)
            for k, change in enumerate(self.changes) if change.file is not None
        }  # fmt: skip
        self._motion = motion(
            self.changes, self._start, flown.courses, driven, self.clock, self.duration, files, notes
        )  # fmt: skip
        for key, tick in (*flown.probes, *self._motion.probes):
            _check_step(key, self._at(key, tick, self.clock.time(int(tick))))
        for k, change in enumerate(self.changes):
            if any(key.partition(".")[0] in PLANT for key in (change.parameter or "", *dict(flat(change.parameters)))):
                _check_step(f"changes[{k}].parameters", self.parameters_at(change.at + (change.over or 0.0)))
        return notes

    def _read_samples(self) -> None:
        """Take the samples of recorded hands from their files."""
        ends = [*(segment.at for segment in self.hand[1:]), self.duration]
        notes = []
        for k, (segment, end) in enumerate(zip(self.hand, ends, strict=False)):
            if isinstance(segment, Samples):
                key, file = f"hand[{k}].file", shown(segment.file)
                own = segment.model_copy()  # another scenario may have been made with it
                content = self._content(key, segment.file)
                try:
                    notes.append(f"hand[{k}] {escaped(segment.file)}: {own._read(content, end - segment.at)}")
                except ValueError as error:
                    raise FaultError(key, f"{file} {error}") from None
                self.hand[k] = own
        self._notes = tuple(notes)

    @property
    def name(self) -> str:
        """Name of the scenario: its file's stem."""
        return self._origin.name

    @property
    def path(self) -> Path | None:
        """The file it was read from, if it was."""
        return self._origin.path

    @property
    def source(self) -> bytes:
        """Its TOML text: as read, without overrides; written here of a scenario that was made in Python."""
        return as_toml(self.table) if self._origin.source is None else self._origin.source

    @property
    def table(self) -> dict[str, Any]:
        """The scenario as the table of its file, overrides placed in it."""
        table = self.model_dump(exclude_unset=True, exclude_none=True)
        for owner in (table, *table.get("changes", ())):
            if owner.get("parameters"):
                owner["parameters"] = nested(owner["parameters"])
        return table

    @property
    def overrides(self) -> tuple[str, ...]:
        """Overrides of the file's values, as ``KEY=VALUE``."""
        return self._origin.overrides

    @property
    def sample_files(self) -> Mapping[str, bytes]:
        """Contents of the files it names, samples and rig, by the name it gives them."""
        return self._files

    @property
    def the_rig(self) -> Rig:
        """The rig that it is run on."""
        return self._rig

    @property
    def the_aircraft(self) -> Aircraft | None:
        """The aircraft whose feel is put on the rig, if there is one."""
        return self._aircraft

    @property
    def controller_place(self) -> Place | None:
        """Where its controller is to be found; None for the feel model."""
        if self.controller is None:
            return None
        folder = self.path.parent if self.path else Path()
        key = f"{self.path or self.name}: controller.source:"
        return Place(self.controller.source, self.controller.arguments, folder, key)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was understood of each sample file, and what the rig cannot do, in one line each."""
        return self._notes

    @property
    def clock(self) -> Clock:
        """Ticks and cycles of its bench."""
        return self._start.rates.clock

    @property
    def ticks(self) -> int:
        """Length of the run in ticks."""
        return self.clock.tick_of(self.duration)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """All that its bench can record."""
        return topics(self.clock, self._start.gearbox.stages)

    @property
    def recorded_topics(self) -> tuple[Topic, ...]:
        """What is recorded of it."""
        return self.record.topics(self.topics)

    def with_checks(self, checks: Sequence[Check]) -> "Scenario":
        """The same experiment, measured by ``checks``. Raises InputError unless their names and windows fit."""
        other = self.model_copy(update={"checks": list(checks)})
        try:
            _check_checks(other)
        except FaultError as fault:
            raise InputError(escaped(str(fault), LONGEST_LINE)) from None
        return other

    def named(self, name: str) -> "Scenario":
        """The same under another name, which that of its recordings begins with."""
        other = self.model_copy()
        other._origin = Origin(name, file=name)
        return other

    def changed(self, values: Mapping[str, Any], *, rig: Rig | None = None) -> "Scenario":
        """The same with other values, by the keys that ``--set`` takes. Raises InputError."""
        table = copy.deepcopy(self.table)
        if rig is not None:
            values = {**values, "rig": rig.file if rig.is_file else rig.name}
        overridden = frozenset(place(table, key, value) for key, value in values.items())
        same_rig = rig or (None if "rig" in values else self._rig)
        # whether it names files that it has not read yet
        others = any(key in ("rig", "aircraft.name") or key.endswith(".file") for key in values)
        origin = Origin(
            self.name, self.path, None, (), overridden, None if others and rig is None else self._files, same_rig,
            self._origin.file,
        )  # fmt: skip
        return Scenario.model_validate(table, context=origin)

    def on(self, parameters: Parameters) -> "Scenario":
        """The same hand on a bench with these parameters, taken as they are; nothing of the rig's is left."""
        driven = () if self.flight is None else self.flight.drives
        table = {key: value for key, value in differences(Parameters(), parameters).items() if key not in driven}
        own = {"rig": THESIS, "aircraft": None, "parameters": table}
        other = self.model_copy(update=own)
        other._rig, other._start, other._aircraft = find_rig(THESIS), parameters, None
        other._origin = Origin(self.name, self.path, files=self._files)
        try:
            _check(other)
            other._set_in_motion()
        except FaultError as fault:
            raise InputError(f"{self.name}: {escaped(str(fault), LONGEST_LINE)}") from None
        return other

    def idle(self, start: float, end: float) -> str:
        """Why the column is not meant to follow the feel model from ``start`` to ``end`` [s]; empty if it is."""
        power, mode, since = self.drive.power, "", 0.0
        for change in [*self.changes, None]:
            until = self.duration if change is None else change.at
            if since < end and until > start + SOON and (power == "off" or mode in ("off", "torque")):
                state = "off" if "off" in (power, mode) else f"in mode {mode}"
                return f"the drive is {state} from {since:g} s to {until:g} s"
            if change is not None:
                power, mode, since = change.power or power, change.mode or mode, change.at
        return ""

    def parameters_at_start(self) -> Parameters:
        """All parameters of the bench when the run begins."""
        return self._start

    def parameters_at(self, time: float) -> Parameters:
        """All parameters of the bench in the PLC cycle of ``time`` [s], once every change up to then was made.

        Of those that move it is the value on their way.
        """
        return self._at("changes", self.clock.plc_cycle(time), time)

    def _at(self, key: str, tick: float, time: float) -> Parameters:
        """Parameters at ``tick``, those that are no numbers at ``time`` [s]. Raises FaultError at ``key``."""
        moved = ((name, found.at(tick)) for name, found in self._motion.courses.items())
        table: dict[str, Any] = {name: value for name, value in moved if value is not None}
        for switch in self._motion.switches:
            if self.clock.tick_of(switch.at) <= self.clock.tick_of(time):
                table |= switch.values
        return parameters_with(key, self._start, table, live_only=True) if table else self._start

    @property
    def courses(self) -> Mapping[str, Course]:
        """What live parameters that are numbers do while the run goes on, by dotted key."""
        return self._motion.courses

    @property
    def switches(self) -> Sequence[Switch]:
        """Live parameters that are no numbers, and when they change."""
        return self._motion.switches

    def moving(self, start: float, end: float) -> tuple[str, ...]:
        """Keys of the parameters that change after ``start``, before ``end`` [s]."""
        first, last = self.clock.plc_cycle(start), self.clock.plc_cycle(end) - 1
        found = [key for key, course in self._motion.courses.items() if course.moves(first, last)]
        for switch in self._motion.switches:
            if start < switch.at < end:
                found += switch.values
        return tuple(dict.fromkeys(found))


_TABLES: Mapping[str, type[Strict]] = {
    "aircraft": AircraftChoice,
    "controller": Controller, "drive": DriveStart, "squeeze": Squeeze, "record": Record, "changes": Change,
    "checks": Check, "expected_trips": ExpectedTrip, "flight": Flight,
}  # fmt: skip


def _fault(failure: ValidationError) -> FaultError:
    """The fault that says most, with its key."""
    error = worst(failure)
    loc = error["loc"]
    model: type[BaseModel] = Scenario
    if loc and loc[0] == "hand" and len(loc) > 2:
        model = SEGMENTS[str(loc[2])]
        loc = loc[:2] + loc[3:]
    elif loc and loc[0] in _TABLES and len(loc) > 1:
        model = _TABLES[str(loc[0])]
    if error["type"].startswith("union_tag"):
        loc = (*loc, "kind")
    names = [part for part in loc if isinstance(part, str)]
    # Inside an array or free table (window, arguments) the owning key says what is wanted.
    owner = (names[0] if names else "") if model is Scenario else names[1] if len(names) > 1 else ""
    if loc and isinstance(loc[-1], int) and model is Scenario:
        owner = ""  # an entry of an array of tables
    return FaultError(place_of(loc), problem_of({**error, "loc": (owner,)}, model, list(SEGMENTS)))


def _check(scenario: Scenario) -> None:
    """What no single key can know: order, the run's length, signals, unique names, parameters."""
    clock = scenario.clock
    if scenario.ticks < 1:
        raise FaultError("duration", f"{scenario.duration:g} s is less than one tick of {clock.tick_s:g} s")
    for name in ("hand", "squeeze", "changes"):
        before = -1.0
        for k, entry in enumerate(getattr(scenario, name)):
            key = f"{name}[{k}].at"
            if entry.at >= scenario.duration:
                raise FaultError(key, f"{entry.at:g} s is not inside the run of {scenario.duration:g} s")
            if clock.tick_of(entry.at) <= clock.tick_of(max(before, 0.0)) and before >= 0.0:
                raise FaultError(key, f"{entry.at:g} s does not come after {name}[{k - 1}].at = {before:g} s")
            before = entry.at
    try:
        scenario.record.check(clock)
    except ValueError as error:
        raise FaultError("record.rate_hz", str(error)) from None
    if not scenario.recorded_topics:
        raise FaultError("record.signals", f"{shown(scenario.record.signals)} are signals that {_gearbox(scenario)}")
    _check_checks(scenario)
    _check_step("parameters", scenario._start)


def _check_checks(scenario: Scenario) -> None:
    """Windows, limits, names and signals of the checks; windows of expected trips."""
    for name in ("checks", "expected_trips"):
        for k, entry in enumerate(getattr(scenario, name)):
            start, end = entry.window
            if not start < end <= scenario.duration:
                raise FaultError(
                    f"{name}[{k}].window",
                    f"[{start:g}, {end:g}] s is not valid; start < end ≤ duration = {scenario.duration:g} s must hold",
                )
    recorded = {f"{topic.path}.{name}" for topic in scenario.topics for name in topic.names}
    names = set[str]()
    for k, check in enumerate(scenario.checks):
        if check.min is not None and check.max is not None and check.min > check.max:
            raise FaultError(f"checks[{k}].min", f"{check.min:g} is greater than max = {check.max:g}")
        if check.name in names:
            raise FaultError(
                f"checks[{k}].name", f"{shown(check.name)} is the name of an earlier check; names are unique"
            )
        if check.signal is not None and check.signal not in recorded:
            raise FaultError(f"checks[{k}].signal", f"{shown(check.signal)} is a signal that {_gearbox(scenario)}")
        names.add(check.name)


def _gearbox(scenario: Scenario) -> str:
    """Why a signal of a gear stage is not there."""
    return f"the rig {scenario.the_rig.name} has not: gearbox.stages = {scenario._start.gearbox.stages}"


def _check_step(key: str, parameters: Parameters) -> None:
    if (found := unstable_parameter(parameters)) is not None:
        raise FaultError(f"{key}.{found[0]}", found[1])
