"""The scenario file: what the hand does, what changes while the run goes on, and what is checked afterwards.

A scenario is a TOML file, typed and strict: an unknown key, a wrong type or an impossible value is an
:class:`~cls_bench.errors.InputError` of one line that names the file, the key, the value and what would be valid.
Units at this border stand in the key (``to_deg``, ``to_N``); keys without one are SI, as their descriptions say.
Times are rounded to the tick of 50 µs.
"""
# ruff: noqa: N815  (keys spell newton as SI does: to_N)

import csv
import difflib
import io
import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import ErrorDetails, core_schema

from cls_bench.controllers import Place
from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, Section, leaves
from cls_bench.resources import shipped_scenarios
from cls_bench.signals import TICK_S, TOPICS
from cls_bench.step_limit import unstable_parameter

Time = Annotated[float, Field(ge=0, le=3600)]
Span = Annotated[float, Field(gt=0, le=3600)]
Degrees = Annotated[float, Field(ge=-60, le=60)]
Newtons = Annotated[float, Field(ge=-2000, le=2000)]
Frequency = Annotated[float, Field(gt=0, le=1000)]
Text = Annotated[str, Field(min_length=1)]

_SIGNALS = tuple(f"{topic.path}.{name}" for topic in TOPICS for name in topic.names)


def tick_of(time: float) -> int:
    """Number of the tick that is nearest to ``time`` [s]."""
    return round(time / TICK_S)


class _Strict(BaseModel):
    """Base of all tables: no unknown keys, no conversion of types, finite numbers."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


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


class _Segment(_Strict):
    """What the hand does from ``at`` until the next segment starts.

    "The value reached" is the last one asked for, in the segment's own unit. A change from an angle to a force
    starts from 0 N, a change from a force to an angle from the last angle asked for, or 0.
    """

    at: Time
    """start [s]"""

    @property
    def aim(self) -> Aim | None:
        """What it steers, with its leading value [rad or N]."""
        raise NotImplementedError

    @model_validator(mode="after")
    def _units(self) -> "_Segment":
        _ = self.aim  # raises ValueError unless the units are chosen once
        return self


class Hold(_Segment):
    """Hold an angle or a force; without a value, the one reached."""

    kind: Literal["hold"]
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

    kind: Literal["ramp"]
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

    kind: Literal["step"]
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

    @model_validator(mode="after")
    def _offset(self) -> "_Oscillation":
        _ = self.offset
        return self


class Sine(_Oscillation):
    """Oscillate: offset + amplitude · sin(2π frequency t + phase)."""

    kind: Literal["sine"]
    frequency: Frequency
    """frequency [Hz]"""
    phase_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    """phase at the start [deg]"""
    cycles: Annotated[float, Field(gt=0)] | None = None
    """number of periods, after which the value reached is held; without it until the next segment [1]"""


class Chirp(_Oscillation):
    """Oscillate while the frequency sweeps from one value to another, then hold the value reached."""

    kind: Literal["chirp"]
    from_hz: Frequency
    """frequency at the start [Hz]"""
    to_hz: Frequency
    """frequency at the end [Hz]"""
    over: Span
    """duration of the sweep [s]"""
    sweep: Literal["linear", "log"] = "linear"
    """whether the frequency or its logarithm grows linearly with time"""


class Samples(_Segment):
    """Follow recorded samples, linearly interpolated; before the first and after the last its value is held."""

    kind: Literal["samples"]
    file: Text
    """CSV file with a header line and a column "time" [s since the segment's start]; relative to the scenario file"""
    unit: Literal["deg", "N"]
    """unit of the values: an angle [deg] or a force [N]"""
    column: Text = "value"
    """header of the column with the values"""
    _times: NDArray[np.float64] = PrivateAttr(default_factory=lambda: np.zeros(1))
    _values: NDArray[np.float64] = PrivateAttr(default_factory=lambda: np.zeros(1))

    @property
    def aim(self) -> Aim:
        """The last value [rad or N]."""
        return Aim(self.unit == "deg", float(self._values[-1]))

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the samples since the segment's start [s]."""
        return self._times

    @property
    def values(self) -> NDArray[np.float64]:
        """The samples [rad or N]."""
        return self._values

    def _read(self, content: bytes) -> None:
        """Take the samples from the file's ``content``; ValueError with one line if it is not valid."""
        try:
            rows = list(csv.reader(io.StringIO(content.decode("utf-8-sig"))))
        except (UnicodeDecodeError, csv.Error) as error:
            raise ValueError(f"is not a CSV file: {error}") from None
        header = [name.strip() for name in rows[0]] if rows else []
        for name in ("time", self.column):
            if name not in header:
                raise ValueError(f'has no column "{name}" in its first line; found: {_names(header)}')
        picks = header.index("time"), header.index(self.column)
        samples: list[tuple[float, float]] = []
        for number, row in enumerate(rows[1:], start=2):
            if not row:
                continue
            try:
                time, value = (float(row[k]) for k in picks)
            except (ValueError, IndexError):
                raise ValueError(f"line {number}: needs a number for time and for {self.column}") from None
            if not (math.isfinite(time) and math.isfinite(value)):
                raise ValueError(f"line {number}: needs finite numbers")
            if samples and time <= samples[-1][0]:
                raise ValueError(f"line {number}: time {time:g} s must be greater than {samples[-1][0]:g} s before it")
            samples.append((time, value))
        if not samples:
            raise ValueError("has no samples below its first line")
        table = np.array(samples)
        self._times = table[:, 0].copy()
        self._values = np.radians(table[:, 1]) if self.unit == "deg" else table[:, 1].copy()


class Release(_Segment):
    """Let go of the grip; the forearm stays at the last angle asked for. Any later segment grips again."""

    kind: Literal["release"]

    @property
    def aim(self) -> None:
        """Nothing."""
        return None


Segment = Hold | Ramp | Step | Sine | Chirp | Samples | Release


class Squeeze(_Strict):
    """Change how tightly the hand grips; before the first change it is loose (0)."""

    at: Time
    """start [s]"""
    value: Annotated[float, Field(ge=0, le=1)]
    """from 0, loose, to 1, tight [1]"""
    over: Annotated[float, Field(ge=0, le=3600)] = 0.05
    """duration of the linear change [s]"""


class DriveStart(_Strict):
    """State of the drive when the run begins."""

    power: Literal["on", "off"] = "on"
    """"off" is safe torque off: no torque at all, the motor turns freely"""


class Controller(_Strict):
    """A controller of your own in place of the feel model."""

    source: Text
    """FILE.py:NAME, relative to the scenario file, or package.module:NAME"""
    arguments: dict[str, Any] = Field(default_factory=dict)
    """arguments with which NAME is called"""


class Change(_Strict):
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
        return _override(parameters, self.parameters, live_only=True)


class Check(_Strict):
    """A metric over a time window, with limits; without limits it is only reported."""

    name: Text
    """name under which the result is listed; unique in the scenario"""
    metric: Text
    """what is measured, see `cls-bench list --metrics`"""
    window: Annotated[tuple[Time, Time], Field(strict=False)]
    """start and end [s]"""
    signal: Annotated[str, WithJsonSchema({"type": "string", "enum": list(_SIGNALS)})] | None = None
    """recorded signal that a general metric evaluates, such as "/column.torque" (topic and name)"""
    min: float | None = None
    """least value that passes [unit of the metric]"""
    max: float | None = None
    """greatest value that passes [unit of the metric]"""
    arguments: dict[str, float] = Field(default_factory=dict)
    """further numbers that the metric takes"""

    @field_validator("signal")
    @classmethod
    def _known(cls, signal: str | None) -> str | None:
        if signal is not None and signal not in _SIGNALS:
            raise ValueError(f"{_shown(signal)} is not recorded; {_nearest(signal, _SIGNALS)}")
        return signal


class Scenario(_Strict):
    """One experiment. Made by :func:`load_scenario` or :func:`parse_scenario`, which also check it as a whole."""

    title: Text
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
    hand: list[Annotated[Segment, Field(discriminator="kind")]] = Field(default_factory=list)
    """what the hand does, in order of time; before the first segment it does not grip"""
    squeeze: list[Squeeze] = Field(default_factory=list)
    """how tightly the hand grips, in order of time"""
    changes: list[Change] = Field(default_factory=list)
    """what changes while the run goes on, in order of time"""
    checks: list[Check] = Field(default_factory=list)
    """metrics to evaluate after the run"""

    _name: str = PrivateAttr(default="scenario")
    _path: Path | None = PrivateAttr(default=None)
    _source: bytes = PrivateAttr(default=b"")
    _overrides: tuple[str, ...] = PrivateAttr(default=())
    _sample_files: dict[str, bytes] = PrivateAttr(default_factory=dict)

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
    def ticks(self) -> int:
        """Length of the run in ticks."""
        return tick_of(self.duration)

    def with_checks(self, checks: Sequence[Check]) -> "Scenario":
        """The same experiment, measured by ``checks``. Raises InputError unless their names and windows fit."""
        other = self.model_copy(update={"checks": list(checks)})
        try:
            _check(other)
        except _FaultError as fault:
            raise InputError(str(fault)) from None
        return other

    def parameters_at_start(self) -> Parameters:
        """All parameters of the bench when the run begins."""
        return _override(Parameters(), self.parameters)

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
        source = path.read_bytes()
    except FileNotFoundError:
        if path.suffix == ".toml" or len(path.parts) > 1:
            raise InputError(f"{text}: no such file") from None
        raise InputError(f"{text}: no such scenario or file; {_nearest(text, shipped)}") from None
    except OSError as error:
        raise InputError(f"{text}: cannot be read: {error.strerror}") from None
    return parse_scenario(source, path=path, seed=seed, set=set)


def parse_scenario(
    toml: str | bytes,
    *,
    name: str = "scenario",
    path: Path | None = None,
    seed: int | None = None,
    set: Sequence[str] = (),
) -> Scenario:
    """Make a scenario of TOML text and check it as a whole; as :func:`load_scenario` otherwise.

    ``path`` is where the text was read from: it gives the name, and sample files are looked for beside it (in the
    current folder without it). Raises InputError.
    """
    source = toml.encode() if isinstance(toml, str) else toml
    file = str(path) if path else name
    overrides = (*set, *((f"seed={seed}",) if seed is not None else ()))
    table = _parse_toml(source, file)
    from_command_line = {_place_override(table, entry) for entry in overrides}
    try:
        scenario = _validated(table)
        scenario._name, scenario._path = (path.stem, path) if path else (name, None)
        scenario._source, scenario._overrides = source, overrides
        _read_samples(scenario)
        _check(scenario)
    except _FaultError as fault:
        if fault.key in from_command_line:
            origin = "--set"
        elif any(key.startswith(f"{fault.key}.") for key in from_command_line):
            origin = f"{file} with --set"  # a section as a whole, of which either may be to blame
        else:
            origin = file
        raise InputError(f"{origin}: {fault}") from None
    return scenario


class _FaultError(Exception):
    """Something wrong at a key of the scenario."""

    def __init__(self, key: str, problem: str):
        super().__init__(f"{key}: {problem}" if key else problem)
        self.key = key
        self.problem = problem


def _parse_toml(source: bytes, file: str) -> dict[str, Any]:
    try:
        return tomllib.loads(source.decode())
    except UnicodeDecodeError as error:
        line = source.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}: line {line}: not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        problem, place = re.match(r"(.*) \(at (.*)\)$", str(error), re.DOTALL).groups()  # type: ignore[union-attr]
        if place == "end of document":
            lines = source.decode().split("\n")
            place = f"line {len(lines)}, column {len(lines[-1]) + 1}"
        raise InputError(f"{file}: {place}: broken TOML: {problem}") from None


def _place_override(table: dict[str, Any], entry: str) -> str:
    """Put the override ``KEY=VALUE`` into ``table``; returns its full key. InputError if it cannot be read."""
    key, equals, text = entry.partition("=")
    key, text = key.strip(), text.strip()
    entry, shown = " ".join(entry.split()), " ".join(text.split())
    if not equals or not key or not text:
        raise InputError(f"--set {entry}: not of the form KEY=VALUE, such as feel.inertia=0.25")
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        parsed = {"value": text} if re.fullmatch(r"[A-Za-z_]\w*", text) else {}
    if list(parsed) != ["value"]:
        raise InputError(f'--set {entry}: {shown} is not a TOML value, such as 0.25, true or "velocity"')
    if match := re.fullmatch(r"(\w+)\[(\d+)\]\.(.+)", key):
        table = _entry(table, match[1], int(match[2]))
        *parents, last = match[3].split(".")
    else:
        if key not in ("duration", "seed"):
            key = "parameters." + key.removeprefix("parameters.")
        *parents, last = key.split(".")
    for parent in parents:
        inner = table.setdefault(parent, {})
        if not isinstance(inner, dict):  # left as it is: the check of the table says what is wrong with it
            return key
        table = inner
    table[last] = parsed["value"]
    return key


def _entry(table: dict[str, Any], name: str, number: int) -> dict[str, Any]:
    """An entry of an array of tables, such as ``squeeze[0]``. Raises InputError unless it is there."""
    if name not in ("hand", "squeeze", "changes", "checks"):
        raise InputError(f"--set {name}[{number}]: {name} has no entries; valid: hand, squeeze, changes, checks")
    entries = table.get(name, [])
    count = len(entries) if isinstance(entries, list) else 0
    entry = entries[number] if number < count else None
    if not isinstance(entry, dict):
        raise InputError(f"--set {name}[{number}]: the scenario has {count} entries of {name}, counted from 0")
    return entry


# --- one line for each fault -----------------------------------------------------------------------------------------


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def _names(names: Sequence[str]) -> str:
    return ", ".join(names) if names else "none"


def _nearest(name: str, valid: Sequence[str] | Mapping[str, Any]) -> str:
    """The valid names that resemble ``name``, or all."""
    names = list(valid)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.6)
    return f"did you mean {' or '.join(close)}?" if close else f"valid: {_names(names)}"


def _wanted(schema: Mapping[str, Any]) -> str:
    """What a key takes, in words, from its JSON schema."""
    if "const" in schema:
        text = _shown(schema["const"])
    elif "enum" in schema:
        text = "one of " + ", ".join(_shown(choice) for choice in schema["enum"])
    else:
        kinds = {"number": "a number", "integer": "a whole number", "boolean": "true or false", "string": "a text"}
        kinds |= {"object": "a table", "array": "an array"}
        text = kinds.get(schema.get("type", "object"), "a table")
        if schema.get("minLength"):
            text += " that is not empty"
        if "prefixItems" in schema:
            text = f"an array of {len(schema['prefixItems'])} numbers"
    signs = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}
    bounds = [f"{sign} {schema[key]:g}" for key, sign in signs.items() if key in schema]
    text += " " + " and ".join(bounds) if bounds else ""
    if "unit" in schema:
        text += "" if schema["unit"] == "1" else f" [{schema['unit']}]"
    meaning = str(schema.get("description", "")).replace("\n", " ")
    return f"{text} ({meaning})" if meaning else text


def _problem(error: ErrorDetails, model: type[BaseModel]) -> str:
    """What is wrong, and what ``model`` would take, in the words of this project."""
    field = error["loc"][-1] if error["loc"] else ""
    properties = model.model_json_schema(schema_generator=_TomlSchema)["properties"]
    kind = error["type"]
    if kind == "extra_forbidden":
        return f"unknown key; {_nearest(str(field), properties)}"
    if kind == "union_tag_invalid":
        return f"{_shown(error['ctx']['tag'])} is unknown; {_nearest(error['ctx']['tag'], _SEGMENTS)}"
    if kind == "union_tag_not_found":
        return f"missing; valid: {_names(list(_SEGMENTS))}"
    if kind == "value_error":
        return str(error["ctx"]["error"])
    wanted = _wanted(properties[field]) if field in properties else "a table"
    if kind == "missing":
        return f"missing; give {wanted}"
    return f"{_shown(error['input'])} is not valid; give {wanted}"


_SEGMENTS: Mapping[str, type[_Segment]] = {
    "hold": Hold, "ramp": Ramp, "step": Step, "sine": Sine, "chirp": Chirp, "samples": Samples, "release": Release,
}  # fmt: skip
_TABLES: Mapping[str, type[_Strict]] = {
    "controller": Controller, "drive": DriveStart, "squeeze": Squeeze, "changes": Change, "checks": Check,
}  # fmt: skip


class _TomlSchema(GenerateJsonSchema):
    """JSON schema without null: TOML has none, an absent key stands for it."""

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = schema["schema"]
        return self.generate_inner(inner) if schema.get("default", ...) is None else super().default_schema(schema)


def scenario_schema() -> dict[str, Any]:
    """JSON schema of the scenario file for editors, with descriptions, units, defaults and all parameters."""
    schema = Scenario.model_json_schema(schema_generator=_TomlSchema)
    for properties, live_only in ((schema["properties"], False), (schema["$defs"]["Change"]["properties"], True)):
        description = properties["parameters"]["description"]
        properties["parameters"] = _section_schema(Parameters(), live_only) | {"description": description}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _section_schema(section: Section, live_only: bool) -> dict[str, Any]:
    own = type(section).model_json_schema(schema_generator=_TomlSchema)["properties"]
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
        model = _SEGMENTS[str(loc[2])]
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
    raise _FaultError(key, _problem({**error, "loc": (owner,)}, model))


def _read_samples(scenario: Scenario) -> None:
    folder = scenario.path.parent if scenario.path else Path()
    for k, segment in enumerate(scenario.hand):
        if isinstance(segment, Samples):
            key = f"hand[{k}].file"
            try:
                content = (folder / segment.file).read_bytes()
                segment._read(content)
            except OSError as error:
                raise _FaultError(key, f"{_shown(segment.file)} cannot be read: {error.strerror}") from None
            except ValueError as error:
                raise _FaultError(key, f"{_shown(segment.file)} {error}") from None
            scenario._sample_files[segment.file] = content


def _check(scenario: Scenario) -> None:
    """What no single key can know: order, the run's length, unique names, parameters."""
    if scenario.ticks < 1:
        raise _FaultError("duration", f"{scenario.duration:g} s is less than one tick of {TICK_S:g} s")
    for name in ("hand", "squeeze", "changes"):
        before = -1.0
        for k, entry in enumerate(getattr(scenario, name)):
            key = f"{name}[{k}].at"
            if entry.at >= scenario.duration:
                raise _FaultError(key, f"{entry.at:g} s is not inside the run of {scenario.duration:g} s")
            if tick_of(entry.at) <= tick_of(max(before, 0.0)) and before >= 0.0:
                raise _FaultError(key, f"{entry.at:g} s does not come after {name}[{k - 1}].at = {before:g} s")
            before = entry.at
    for k, check in enumerate(scenario.checks):
        start, end = check.window
        if not start < end <= scenario.duration:
            raise _FaultError(
                f"checks[{k}].window",
                f"[{start:g}, {end:g}] s is not valid; start < end ≤ duration = {scenario.duration:g} s must hold",
            )
        if check.min is not None and check.max is not None and check.min > check.max:
            raise _FaultError(f"checks[{k}].min", f"{check.min:g} is greater than max = {check.max:g}")
        if check.name in [other.name for other in scenario.checks[:k]]:
            raise _FaultError(
                f"checks[{k}].name", f"{_shown(check.name)} is the name of an earlier check; names are unique"
            )
    parameters = _at("parameters", Parameters(), scenario.parameters)
    _check_step("parameters", parameters)
    for k, change in enumerate(scenario.changes):
        key = f"changes[{k}].parameters"
        parameters = _at(key, parameters, change.parameters, live_only=True)
        _check_step(key, parameters)


def _check_step(key: str, parameters: Parameters) -> None:
    if (found := unstable_parameter(parameters)) is not None:
        raise _FaultError(f"{key}.{found[0]}", found[1])


# --- parameters ------------------------------------------------------------------------------------------------------


def _at(key: str, parameters: Parameters, table: Mapping[str, Any], *, live_only: bool = False) -> Parameters:
    try:
        return _override(parameters, table, live_only=live_only)
    except _FaultError as fault:
        raise _FaultError(f"{key}.{fault.key}".rstrip("."), fault.problem) from None


def _flat(table: Mapping[str, Any], known: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in table.items():
        key = prefix + name
        if isinstance(value, Mapping) and key not in known:
            yield from _flat(value, known, f"{key}.")
        else:
            yield key, value


def _override(parameters: Parameters, table: Mapping[str, Any], *, live_only: bool = False) -> Parameters:
    """A copy of ``parameters`` with the values of the nested ``table``; raises _FaultError at the first bad one."""
    known = {key: info for key, _, info in leaves(parameters)}
    merged = parameters.model_dump()
    for key, value in _flat(table, known):
        *parents, last = key.split(".")
        if key not in known:
            below = [name for name in known if name.startswith(f"{key}.")]
            if below:
                raise _FaultError(key, f"{_shown(value)} is not valid; it is a section with {_names(below)}")
            section = [name for name in known if name.startswith(".".join([*parents, ""]))]
            raise _FaultError(key, f"unknown parameter; {_nearest(key, section or known)}")
        if live_only and not known[key]["live"]:
            live = [name for name in known if known[name]["live"]]
            near = [name for name in live if name.startswith(f"{parents[0]}.")]
            near = near or [f"some of {name}" for name in dict.fromkeys(name.partition(".")[0] for name in live)]
            raise _FaultError(key, f"holds for the whole run; these may change while it goes on: {_names(near)}")
        inner = merged
        for parent in parents:
            inner = inner[parent]
        inner[last] = value
    try:
        return Parameters.model_validate(merged)
    except ValidationError as failure:
        error = failure.errors(include_url=False)[0]
    section_type: type[Section] = Parameters
    for part in error["loc"]:
        inner_type = section_type.model_fields[str(part)].annotation
        if isinstance(inner_type, type) and issubclass(inner_type, Section):
            section_type = inner_type
    raise _FaultError(".".join(map(str, error["loc"])), _problem(error, section_type))
