"""What a scenario's changes and flight make of the parameters over time.

Every live number that changes has a course (:mod:`cls_bench.course`), jumps included, so that a schedule of hundreds of
changes costs no more than the first. What is no number (switches, choices, tables) changes at a time and is kept apart.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench import course
from cls_bench.course import Course
from cls_bench.input.faults import FaultError, nearest, shown
from cls_bench.parameters import Parameters
from cls_bench.parameters.moving import HOST_CYCLE, STEPPED, numbers, value_of
from cls_bench.parameters.override import bounds, flat, known_keys, parameters_with
from cls_bench.scenario.entries import Change
from cls_bench.scenario.sample_file import Keys, read_samples
from cls_bench.scenario.segments import SampleKeys
from cls_bench.signals import Clock
from cls_bench.text import escaped

MOST_LINES = 20
"""Jumps of one parameter that the log tells one by one."""

PROBES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Shares of the way at which the rules that join several parameters are checked."""


class Switch(NamedTuple):
    """Parameters that are no moving numbers, changed at a time."""

    at: float
    """[s]"""
    values: Mapping[str, Any]
    """new values by dotted key"""


class Motion(NamedTuple):
    """What becomes of the parameters."""

    courses: Mapping[str, Course]
    """by dotted key"""
    switches: Sequence[Switch]
    probes: Sequence[tuple[str, float]]
    """key of a change, and tick of a moment on its way"""


class _Way:
    """The course of one parameter as it comes to be."""

    def __init__(self, key: str, start: float):
        self.key, self.start = key, start
        self.parts: list[NDArray[Any]] = []
        self.said: list[tuple[int, str]] = []
        self.jumps: list[tuple[int, float]] = []

    def at(self, tick: float) -> float:
        """Value just now; its parts begin before."""
        return self.start if not self.parts else Course(self.parts[-1]).at(tick) or 0.0

    def go(self, tick: int, pieces: NDArray[Any], clock: Clock) -> None:
        """Go on with other ``pieces`` from ``tick`` on."""
        if self.key in STEPPED and np.any(pieces["span"] > 0.0):
            pieces = _stairs(pieces, clock)
        if self.parts:
            last = self.parts[-1]
            self.parts[-1] = last[last["begin"] < tick]
            if not len(self.parts[-1]):
                self.parts.pop()
        self.parts.append(pieces)

    def course(self, unit: str) -> Course:
        """All of it, with what the log says."""
        said = self.said
        if len(self.jumps) > MOST_LINES:
            (first, start), (_, end) = self.jumps[0], self.jumps[-1]
            low, high = min(v for _, v in self.jumps), max(v for _, v in self.jumps)
            line = f"{self.key} in {len(self.jumps)} steps, from {start:g} to {end:g}{unit}"
            line += f", within {low:g} to {high:g}{unit}" if (low, high) != tuple(sorted((start, end))) else ""
            said = [*said, (first, line)]
        else:
            said = [*said, *((tick, f"{self.key} = {value}{unit}") for tick, value in self.jumps)]
        return Course(np.concatenate(self.parts), tuple(sorted(said)))


def _stairs(pieces: NDArray[Any], clock: Clock) -> NDArray[Any]:
    """The same as a step each host cycle."""
    cycle = max(1, round(HOST_CYCLE / clock.plc_s)) * clock.plc_ticks
    exact, first = Course(pieces), float(pieces["begin"][0])
    ticks = first + cycle * np.arange(math.ceil((exact.end - first) / cycle) + 1)
    return course.steps(ticks, [exact.at(tick) or 0.0 for tick in ticks.tolist()], start=float(pieces["start"][0]))


def motion(
    changes: Sequence[Change], start: Parameters, flown: Mapping[str, Course], driven: Sequence[str], clock: Clock,
    duration: float, files: Mapping[int, bytes], notes: list[str],
) -> Motion:  # fmt: skip
    """What ``changes`` make of the parameters ``start``, beside those that are ``driven`` by a flight, as ``flown``.

    ``files`` are the contents of those that changes name, by their number; what was understood of them is added to
    ``notes``. Raises FaultError.
    """
    ways: dict[str, _Way] = {}
    switches: list[Switch] = []
    probes: list[tuple[str, float]] = []
    switched: dict[str, Any] = {}
    units = numbers()
    for k, change in enumerate(changes):
        name = f"changes[{k}].parameters"
        tick = clock.plc_cycle(change.at)
        table = dict(flat(change.parameters))
        present = switched | {key: way.at(tick) for key, way in ways.items()}
        if change.over is None:
            after = parameters_with(name, start, present | table, live_only=True)
        moved: list[tuple[str, NDArray[Any], str]] = []  # key, pieces, what the log says
        for key, given in table.items():
            _check_free(f"{name}.{key}", key, driven)
            if key not in units:
                if change.over is not None:
                    parameters_with(name, start, {key: given}, live_only=True)
                    raise FaultError(
                        f"{name}.{key}", f"{shown(given)} cannot be reached over a time; only numbers move: "
                        "change it at once, in a change without over"
                    )  # fmt: skip
                continue
            way = ways.setdefault(key, _Way(key, value_of(start, key)))
            now = way.at(tick)
            if change.over is None:
                end = value_of(after, key)
                moved.append((key, course.ramp(tick, 0.0, now, end), ""))
                if end != now:
                    way.jumps.append((tick, end))
            else:
                end = _checked(name, start, key, given)
                span = change.over / clock.tick_s
                how = f"over {change.over:g} s" + (", smoothly" if change.smooth else "")
                moved.append((
                    key, course.ramp(tick, span, now, end, smooth=change.smooth),
                    f"{key} from {now:g} to {end:g}{_spaced(units[key])} {how}",
                ))  # fmt: skip
                probes += [(name, tick + share * span) for share in PROBES]
        if change.parameter is not None:
            key = change.parameter
            check_follower(f"changes[{k}].parameter", key, driven)
            way = ways.setdefault(key, _Way(key, value_of(start, key)))
            pieces, line = _followed(k, change, tick, clock, duration, files[k], notes)
            pieces = np.concatenate([course.ramp(tick, 0.0, way.at(tick), float(pieces["start"][0])), pieces])
            moved.append((key, pieces, line))
            last = float(pieces["begin"][-1] + pieces["span"][-1])
            probes += [(f"changes[{k}].parameter", tick + share * (last - tick)) for share in np.linspace(0, 1, 21)]
        for key, pieces, line in moved:
            ways[key].go(tick, pieces, clock)
            if line:
                ways[key].said.append((tick, line))
        if rest := {key: value for key, value in table.items() if key not in units}:
            switched |= rest
            switches.append(Switch(change.at, rest))
    courses = {key: way.course(_spaced(units[key])) for key, way in ways.items()}
    return Motion({**flown, **courses}, switches, probes)


def _checked(where: str, start: Parameters, key: str, given: Any) -> float:
    """A value that a parameter may have on its own. Raises FaultError."""
    low, high = bounds(key)
    if isinstance(given, bool) or not isinstance(given, int | float) or not low <= given <= high:
        parameters_with(where, start, {key: given}, live_only=True)
    return float(given)


def _spaced(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _check_free(where: str, key: str, driven: Sequence[str]) -> None:
    if key in driven:
        raise FaultError(where, "follows from [flight]; change the flight, or leave it out")


def check_follower(where: str, key: str, driven: Sequence[str]) -> None:
    """Raise FaultError unless the parameter ``key`` may follow something and is not ``driven`` by the flight."""
    if key not in known_keys():
        raise FaultError(where, f"{shown(key)} is an unknown parameter; {nearest(key, numbers())}")
    if key not in numbers():
        why = "is no number" if known_keys()[key]["live"] else "holds for the whole run"
        raise FaultError(where, f"{shown(key)} {why}; {nearest(key, numbers())}")
    if key in driven:
        raise FaultError(where, f"{shown(key)} follows from [flight]; change the flight, or leave it out")


def _followed(
    k: int, change: Change, tick: int, clock: Clock, duration: float, content: bytes, notes: list[str]
) -> tuple[NDArray[Any], str]:
    """The course along a file's samples, and what the log says of it."""
    key = str(change.parameter)
    unit = known_keys()[key]["unit"]
    how = {name: getattr(change, name) for name in SampleKeys.model_fields}
    try:
        read = read_samples(content, Keys(unit=unit, bounds=bounds(key), **how), duration - change.at)
    except ValueError as error:
        raise FaultError(f"changes[{k}].file", f"{shown(change.file)} {error}") from None
    file = escaped(str(change.file))
    notes.append(f"changes[{k}] {file}: {read.note}")
    ticks, values = tick + read.times / clock.tick_s, read.values
    if ticks[0] > tick:
        ticks, values = np.append(tick, ticks), np.append(values[0], values)
    elif ticks[0] < tick:
        inside = ticks > tick
        at_start = np.interp(tick, ticks, values)
        ticks, values = np.append(tick, ticks[inside]), np.append(at_start, values[inside])
    low, high = float(np.min(values)), float(np.max(values))
    lasts = (ticks[-1] - tick) * clock.tick_s
    line = f"{key} follows {file}, within {low:g} to {high:g}{_spaced(unit)}, for {lasts:g} s"
    return course.lines(ticks, values), line
