"""The scenario file: what the hand does, what changes while the run goes on, and what is checked afterwards.

A scenario is a TOML file, typed and strict: an unknown key, a wrong type or an impossible value is an
:class:`~cls_bench.errors.InputError` of one line that names the file, the key, the value and what would be valid.
Units at this border stand in the key (``to_deg``, ``to_N``); keys without one are SI, as their descriptions say.
Times are rounded to the tick of 50 µs.
"""


from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, PrivateAttr, ValidationError, WithJsonSchema, field_validator, model_validator

from cls_bench.controllers import Place
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, Section
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario.faults import FaultError, TomlSchema, nearest, problem_of, shown
from cls_bench.scenario.files import read_file
from cls_bench.scenario.override import override, parameters_with
from cls_bench.scenario.record import SIGNALS, Record
from cls_bench.scenario.sample_file import MOST_BYTES
from cls_bench.scenario.segments import SEGMENTS, Line, Name, Samples, Segment, Span, Squeeze, Strict, Time
from cls_bench.scenario.toml_file import MOST_BYTES as MOST_TOML
from cls_bench.scenario.toml_file import parse_toml, place_override
from cls_bench.signals import TICK_S
from cls_bench.step_limit import unstable_parameter
from cls_bench.text import escaped

Limit = Annotated[float, Field(ge=-1e12, le=1e12)]

SOON = 0.001
"""Time [s] within which a change has taken effect."""

LONGEST_LINE = 1000
"""Characters of a message."""

def tick_of(time: float) -> int:
    """Number of the tick that is nearest to ``time`` [s]."""
    return round(time / TICK_S)


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


class Change(Strict):
    """What changes at a given time: the drive's power or mode, or parameters marked live."""

    at: Time
    """time of the change [s]"""
    power: Literal["on", "off"] | None = None
    """power of the drive; "off" is safe torque off"""
    mode: Literal["position", "velocity", "torque", "off"] | None = None
    """mode of the drive; "off" is safe torque off"""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """new values of live parameters, by dotted key, SI"""

    @model_validator(mode="after")
    def _something(self) -> "Change":
        if self.power is None and self.mode is None and not self.parameters:
            raise ValueError("changes nothing; give power, mode or parameters")
        if self.power == "on" and self.mode == "off":
            raise ValueError('power "on" contradicts mode "off"')
        return self

    def apply(self, parameters: Parameters) -> Parameters:
        """A copy of ``parameters`` with this change's values."""
        return override(parameters, self.parameters, live_only=True)


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


class Scenario(Strict):
    """One experiment. Made by :func:`load_scenario` or :func:`parse_scenario`, which also check it as a whole."""

    title: Line
    """one line that says what is shown"""
    description: str = ""
    """what happens, and what to look at"""
    duration: Span
    """length of the run [s]"""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """seed of the sensors' noise [1]"""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """values that differ from the defaults, by dotted key, SI"""
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
    changes: list[Change] = Field(default_factory=list, max_length=1000)
    """what changes while the run goes on, in order of time"""
    checks: list[Check] = Field(default_factory=list, max_length=1000)
    """metrics to evaluate after the run"""
    expected_trips: list[ExpectedTrip] = Field(default_factory=list, max_length=1000)
    """safety functions that are meant to switch the drive off"""

    _name: str = PrivateAttr(default="scenario")
    _path: Path | None = PrivateAttr(default=None)
    _source: bytes = PrivateAttr(default=b"")
    _overrides: tuple[str, ...] = PrivateAttr(default=())
    _sample_files: dict[str, bytes] = PrivateAttr(default_factory=dict)
    _notes: tuple[str, ...] = PrivateAttr(default=())

    @property
    def name(self) -> str:
        """Name of the scenario: its file's stem."""
        return self._name

    @property
    def path(self) -> Path | None:
        """The file it was read from, if it was."""
        return self._path

    @property
    def source(self) -> bytes:
        """The TOML text as read, without overrides."""
        return self._source

    @property
    def overrides(self) -> tuple[str, ...]:
        """Overrides of the file's values, as ``KEY=VALUE``."""
        return self._overrides

    @property
    def sample_files(self) -> Mapping[str, bytes]:
        """Contents of the sample files, by the name the scenario gives them."""
        return self._sample_files

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
        """What was understood of each sample file, in one line each."""
        return self._notes

    @property
    def ticks(self) -> int:
        """Length of the run in ticks."""
        return tick_of(self.duration)

    def with_checks(self, checks: Sequence[Check]) -> "Scenario":
        """The same experiment, measured by ``checks``. Raises InputError unless their names and windows fit."""
        other = self.model_copy(update={"checks": list(checks)})
        try:
            _check(other)
        except FaultError as fault:
            raise InputError(escaped(str(fault), LONGEST_LINE)) from None
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
        return override(Parameters(), self.parameters)

    def parameters_at(self, time: float) -> Parameters:
        """All parameters of the bench once every change up to and including ``time`` [s] was made."""
        parameters = self.parameters_at_start()
        for change in self.changes:
            if tick_of(change.at) <= tick_of(time):
                parameters = change.apply(parameters)
        return parameters


def load_scenario(name_or_path: str | Path, *, seed: int | None = None, set: Sequence[str] = ()) -> Scenario:
    """Read a shipped scenario by name, or any scenario file by path.

    ``seed`` replaces the file's; ``set`` holds overrides ``KEY=VALUE`` with TOML values, where the key is a parameter
    (``feel.inertia=0.25``), ``duration``, ``seed`` or that of an entry (``squeeze[0].value``). Raises InputError.
    """
    shipped = shipped_scenarios()
    text = str(name_or_path)
    path = shipped.get(text) or Path(name_or_path)
    try:
        source = read_file(path, MOST_TOML)
    except FileNotFoundError:
        if path.suffix == ".toml" or len(path.parts) > 1:
            raise InputError(f"{escaped(text, 500)}: no such file") from None
        raise InputError(f"{escaped(text)}: no such scenario or file; {nearest(text, shipped)}") from None
    except OSError as error:
        raise InputError(f"{escaped(text, 500)}: cannot be read: {error.strerror}") from None
    return parse_scenario(source, path=path, seed=seed, set=set)


def parse_scenario(
    toml: str | bytes,
    *,
    name: str = "scenario",
    path: Path | None = None,
    seed: int | None = None,
    set: Sequence[str] = (),
    sample_files: Mapping[str, bytes] | None = None,
) -> Scenario:
    """Make a scenario of TOML text and check it as a whole; as :func:`load_scenario` otherwise.

    ``path`` is where the text was read from: it gives the name, and sample files are looked for beside it (in the
    current folder without it). If ``sample_files`` is given, name -> content, they are taken from there and nothing is
    read from the disk. Raises InputError.
    """
    source = toml.encode(errors="surrogatepass") if isinstance(toml, str) else toml
    file = escaped(str(path) if path else name, 500)
    overrides = (*set, *((f"seed={seed}",) if seed is not None else ()))
    table = parse_toml(source, file)
    from_command_line = {place_override(table, entry) for entry in overrides}
    try:
        scenario = _validated(table)
        scenario._name, scenario._path = (path.stem, path) if path else (name, None)
        scenario._source, scenario._overrides = source, overrides
        _check(scenario)
        _read_samples(scenario, sample_files)
    except FaultError as fault:
        if fault.key in from_command_line:
            origin = "--set"
        elif any(key.startswith(f"{fault.key}.") for key in from_command_line):
            origin = f"{file} with --set"  # a section as a whole, of which either may be to blame
        else:
            origin = file
        raise InputError(f"{origin}: {escaped(str(fault), LONGEST_LINE)}") from None
    return scenario


_TABLES: Mapping[str, type[Strict]] = {
    "controller": Controller, "drive": DriveStart, "squeeze": Squeeze, "record": Record, "changes": Change,
    "checks": Check, "expected_trips": ExpectedTrip,
}  # fmt: skip


def scenario_schema() -> dict[str, Any]:
    """JSON schema of the scenario file for editors, with descriptions, units, defaults and all parameters."""
    schema = Scenario.model_json_schema(schema_generator=TomlSchema)
    for properties, live_only in ((schema["properties"], False), (schema["$defs"]["Change"]["properties"], True)):
        description = properties["parameters"]["description"]
        properties["parameters"] = _section_schema(Parameters(), live_only) | {"description": description}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _section_schema(section: Section, live_only: bool) -> dict[str, Any]:
    own = type(section).model_json_schema(schema_generator=TomlSchema)["properties"]
    properties: dict[str, Any] = {}
    for name in type(section).model_fields:
        value = getattr(section, name)
        if isinstance(value, Section):
            inner = _section_schema(value, live_only)
            if inner["properties"]:
                properties[name] = inner
        elif own[name]["live"] or not live_only:
            properties[name] = own[name] | {"default": value}
    description = (type(section).__doc__ or "").strip().splitlines()[0]
    return {"type": "object", "description": description, "properties": properties, "additionalProperties": False}


def _validated(table: dict[str, Any]) -> Scenario:
    try:
        return Scenario.model_validate(table)
    except ValidationError as failure:
        errors = failure.errors(include_url=False)
    # A misspelt key is both unknown and missing: the first says more.
    error = next((e for e in errors if e["type"] == "extra_forbidden"), errors[0])
    loc = error["loc"]
    model: type[BaseModel] = Scenario
    if loc[0] == "hand" and len(loc) > 2:
        model = SEGMENTS[str(loc[2])]
        loc = loc[:2] + loc[3:]
    elif loc[0] in _TABLES and len(loc) > 1:
        model = _TABLES[str(loc[0])]
    if error["type"].startswith("union_tag"):
        loc = (*loc, "kind")
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc).lstrip(".")
    names = [part for part in loc if isinstance(part, str)]
    # Inside an array or free table (window, arguments) the owning key says what is wanted.
    owner = names[0] if model is Scenario else names[1] if len(names) > 1 else ""
    if isinstance(loc[-1], int) and model is Scenario:
        owner = ""  # an entry of an array of tables
    raise FaultError(key, problem_of({**error, "loc": (owner,)}, model, list(SEGMENTS)))


def _read_samples(scenario: Scenario, given: Mapping[str, bytes] | None) -> None:
    folder = scenario.path.parent if scenario.path else Path()
    ends = [*(segment.at for segment in scenario.hand[1:]), scenario.duration]
    notes = []
    for k, (segment, end) in enumerate(zip(scenario.hand, ends, strict=False)):
        if isinstance(segment, Samples):
            key, file = f"hand[{k}].file", shown(segment.file)
            try:
                if given is not None and segment.file not in given:
                    raise FaultError(key, f"{file} is not among the recording's attachments")
                content = read_file(folder / segment.file, MOST_BYTES) if given is None else given[segment.file]
                notes.append(f"hand[{k}] {escaped(segment.file)}: {segment._read(content, end - segment.at)}")
            except OSError as error:
                raise FaultError(key, f"{file} cannot be read: {error.strerror or error}") from None
            except ValueError as error:
                raise FaultError(key, f"{file} {error}") from None
            scenario._sample_files[segment.file] = content
    scenario._notes = tuple(notes)


def _check(scenario: Scenario) -> None:
    """What no single key can know: order, the run's length, unique names, parameters."""
    if scenario.ticks < 1:
        raise FaultError("duration", f"{scenario.duration:g} s is less than one tick of {TICK_S:g} s")
    for name in ("hand", "squeeze", "changes"):
        before = -1.0
        for k, entry in enumerate(getattr(scenario, name)):
            key = f"{name}[{k}].at"
            if entry.at >= scenario.duration:
                raise FaultError(key, f"{entry.at:g} s is not inside the run of {scenario.duration:g} s")
            if tick_of(entry.at) <= tick_of(max(before, 0.0)) and before >= 0.0:
                raise FaultError(key, f"{entry.at:g} s does not come after {name}[{k - 1}].at = {before:g} s")
            before = entry.at
    for name in ("checks", "expected_trips"):
        for k, entry in enumerate(getattr(scenario, name)):
            start, end = entry.window
            if not start < end <= scenario.duration:
                raise FaultError(
                    f"{name}[{k}].window",
                    f"[{start:g}, {end:g}] s is not valid; start < end ≤ duration = {scenario.duration:g} s must hold",
                )
    names = set[str]()
    for k, check in enumerate(scenario.checks):
        if check.min is not None and check.max is not None and check.min > check.max:
            raise FaultError(f"checks[{k}].min", f"{check.min:g} is greater than max = {check.max:g}")
        if check.name in names:
            raise FaultError(
                f"checks[{k}].name", f"{shown(check.name)} is the name of an earlier check; names are unique"
            )
        names.add(check.name)
    parameters = parameters_with("parameters", Parameters(), scenario.parameters)
    _check_step("parameters", parameters)
    for k, change in enumerate(scenario.changes):
        key = f"changes[{k}].parameters"
        parameters = parameters_with(key, parameters, change.parameters, live_only=True)
        _check_step(key, parameters)


def _check_step(key: str, parameters: Parameters) -> None:
    if (found := unstable_parameter(parameters)) is not None:
        raise FaultError(f"{key}.{found[0]}", found[1])
