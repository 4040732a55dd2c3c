"""A run as its recording tells it: scenario, parameters, verdict and signals, without any other file."""

import copy
import json
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench import experiment
from cls_bench.analysis import metrics
from cls_bench.analysis.window import Window, holds_all, on_axis
from cls_bench.errors import InputError, one_line
from cls_bench.parameters import Parameters, leaves
from cls_bench.recording import Recording
from cls_bench.recording.mcap_reader import INCOMPLETE
from cls_bench.recording.recorder import INTERRUPTED
from cls_bench.run_log import trip_of
from cls_bench.scenario import Scenario, parse_scenario
from cls_bench.signals import Clock, Event, Topic, axes_of, topics
from cls_bench.text import printable

SCENARIO_FILE = "scenario.toml"
"""Attachment with the scenario as it was read."""

LONGEST_SCENARIO = 1 << 20
"""Bytes of a scenario that are read."""

UNFINISHED = (experiment.DIVERGED, experiment.CONTROLLER_FAILED, INTERRUPTED, INCOMPLETE)
"""How a recording ended whose checks do not decide."""


class Span(NamedTuple):
    """A stretch of time [s]."""

    start: float
    end: float


class Changed(NamedTuple):
    """A parameter whose value differs from the default."""

    key: str
    value: Any
    default: Any
    unit: str
    meaning: str


NOT_MEASURED = "not measured"
"""Verdict of a run of which samples are lost that a check needs."""

SAME = 1e-6
"""Relative difference up to which a value is the one that was recorded: libraries and processors round differently."""


class RecordedRun:
    """A recording with the scenario that it carries. Raises InputError if it is no recording of a run with samples."""

    axis = ""
    """the axis that windows, spans and power are of; empty if there is but one"""

    def __init__(self, path: Path):
        self.path = path
        self.recording = Recording(path)
        self.recording.verify()
        self.recording.require_samples()
        if SCENARIO_FILE not in self.recording.attachments:
            raise InputError(f"{path}: carries no scenario")
        self.scenario, self._unknown = _scenario(self.recording)
        self._windows: dict[Span, Window] = {}

    @property
    def clock(self) -> Clock:
        """Rates of the run."""
        return self.recording.clock

    @cached_property
    def simulated(self) -> tuple[Topic, ...]:
        """All topics of the run, recorded or not, with the rows that were simulated."""
        known = self.recording.known_topics
        if axes_of(known) not in ((), ("",)):
            return known
        return topics(self.clock, self.scenario.parameters_at_start().gearbox.stages)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes; one empty name if there is but one."""
        return axes_of(self.simulated)

    def on(self, axis: str) -> "RecordedRun":
        """The same run, seen from one of its axes."""
        if axis == self.axis:
            return self
        other = copy.copy(self)
        other.axis, other._windows = axis, {}
        other.__dict__.pop("powered", None)
        return other

    @property
    def name(self) -> str:
        """Name of the scenario."""
        return self.scenario.name

    @property
    def controller(self) -> str:
        """Name of the controller that ran; recordings that do not say so are of the feel model."""
        return self.recording.metadata.get("controller.name", experiment.FEEL_MODEL)

    @property
    def has_feel_model(self) -> bool:
        """Whether the feel model ran, and not a controller of the user's own."""
        return self.controller == experiment.FEEL_MODEL

    @property
    def set_label(self) -> str:
        """What the angle is called that the column should follow."""
        return "feel model (set)" if self.has_feel_model else f"{one_line(self.controller)[:40]} (set)"

    @property
    def duration(self) -> float:
        """Recorded time [s]."""
        return self.recording.duration

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """What the log holds."""
        return self.recording.events()

    @cached_property
    def checks(self) -> tuple[experiment.CheckResult, ...]:
        """What the scenario's checks measure on this recording.

        Of signals that were not recorded, the values are those of the run itself.
        """
        return tuple(self._with_recorded_value(result) for result in self._measured)

    @cached_property
    def _measured(self) -> tuple[experiment.CheckResult, ...]:
        return experiment.measure(self.scenario, self.recording, own_loop=not self.has_feel_model)

    def _with_recorded_value(self, result: experiment.CheckResult) -> experiment.CheckResult:
        value = self._recorded_values.get(result.check.name)
        if self._is_whole or self.recording.losses or value is None or not math.isnan(result.value):
            return result
        return replace(result, value=value, note="as measured by the run; its samples were not recorded")

    @property
    def _is_whole(self) -> bool:
        """Whether all that checks can need was recorded."""
        return holds_all(self.recording.topics.values(), self.simulated, self.clock)

    @cached_property
    def _recorded_values(self) -> dict[str, float | None]:
        """Values of the checks as the run recorded them; None where there was none."""
        try:
            found = json.loads(self.recording.result.get("checks", "{}"))
            return {str(name): None if value is None else float(value) for name, value in found.items()}
        except (ValueError, TypeError, AttributeError, RecursionError, OverflowError):
            return {}

    @property
    def verdict(self) -> str:
        """The verdict from the samples and events; otherwise how the recording ended, such as ``diverged``.

        ``not measured`` if samples are lost that a check needs and no other check fails.
        """
        status = self.recording.status
        if status in UNFINISHED:
            return status
        trips = [trip for trip in map(trip_of, self.events) if trip]
        verdict = experiment.ending(self.scenario, trips, None).judged(self.checks).status
        if self.recording.losses:
            failing = [result for result in self.checks if not result.passed]
            if verdict == experiment.FAILED and failing and all(math.isnan(result.value) for result in failing):
                return NOT_MEASURED
            recorded = self.recording.result.get("verdict", "")
            if verdict == experiment.PASSED and recorded in experiment.EXIT_CODES:
                return recorded  # what made it otherwise may be what is lost
        return verdict

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """What is wrong with the recording, and where it says something else than its samples; one line each."""
        return (*self.recording.doubts, *(printable(line, 500) for line in self._contradictions()))

    def _contradictions(self) -> Iterator[str]:
        yield from self._unknown
        result, status = self.recording.result, self.recording.status
        said = self.scenario.parameters_at_start().rates.clock
        if self.clock != said:
            yield f"the clock of its samples is {_rates(self.clock)}, that of its scenario {_rates(said)}"
        if not result and not self.recording.truncated:
            yield "the file was closed, but says nothing of how the run ended"
        if self.duration > self.scenario.duration + self.clock.tick_s:
            yield f"its samples go on to {self.duration:g} s, its scenario to {self.scenario.duration:g} s"
        with suppress(ValueError):
            ran = self.clock.time(int(result.get("ticks", "0")))
            if ran > self.duration + self.clock.plc_s:
                yield f"the run went on to {ran:g} s, its samples end at {self.duration:g} s"
        recorded = result.get("verdict", status)
        if recorded != self.verdict and (recorded != status or status in experiment.EXIT_CODES):
            yield f'the file says "{recorded}", its samples and events give "{self.verdict}"'
        found = {entry.check.name: entry.value for entry in self._measured}
        for name, value in self._recorded_values.items():
            ours = found.get(name)
            if ours is None:
                yield f'the file has a value of "{name}", which its scenario does not measure'
            elif (self._is_whole or not math.isnan(ours)) and not _same(math.nan if value is None else value, ours):
                yield f'"{name}": the file says {_shown(value)}, its samples give {_shown(ours)}'

    @cached_property
    def changed_parameters(self) -> list[Changed]:
        """Parameters at the start of the run that differ from the defaults."""
        defaults = {key: value for key, value, _ in leaves(Parameters())}
        found = leaves(self.scenario.parameters_at_start())
        return [
            Changed(key, value, defaults[key], about["unit"], about["meaning"])
            for key, value, about in found
            if value != defaults[key]
        ]

    def window(self, span: Span) -> Window:
        """Signals in ``span`` at the PLC's rate, read once."""
        if span not in self._windows:
            parameters = self.scenario.parameters_at(span.start)
            self._windows[span] = Window(
                self.recording, *span, parameters, axis=self.axis, moving=self.scenario.moving(*span)
            )
        return self._windows[span]

    @property
    def whole(self) -> Window:
        """The whole run."""
        return self.window(Span(0.0, min(self.duration, self.scenario.duration)))

    def spans(self, *names: str, signal: str | None = None) -> list[Span]:
        """Windows of the checks of the axis that measure one of ``names``, in order of time, if they were recorded
        without a gap.

        With ``signal``, only of those that measure it.
        """
        found = {
            Span(*check.window) for check in self.scenario.checks
            if check.metric in names and metrics.axis_of(check) == self.axis
            and (signal is None or on_axis(check.signal or "", self.axis) == on_axis(signal, self.axis))
        }  # fmt: skip
        losses = self.recording.losses
        return sorted(
            span for span in found
            if span.end <= self.duration + self.clock.tick_s
            and not any(loss.start < span.end and span.start < loss.end for loss in losses)
        )  # fmt: skip

    @cached_property
    def powered(self) -> NDArray[np.bool_]:
        """Whether the drive's power stage was on, at the PLC's rate: without power its voltage is exactly 0."""
        voltage = self.whole["/drive.voltage"]
        return held_on((voltage != 0.0) & ~np.isnan(voltage), max(round(HELD_S / self.clock.plc_s), 1))

    def power_in(self, span: Span) -> str:
        """``"on"``, ``"off"`` or ``"changing"``: the drive's power in ``span``."""
        first, last = (round(time / self.clock.plc_s) for time in span)
        on = self.powered[first:last]
        return "on" if on.all() else "changing" if on.any() else "off"


HELD_S = 0.01
"""Shortest time for which power is switched off [s]; a voltage may pass through 0 for less while it is on."""


def held_on(nonzero: NDArray[np.bool_], rows: int) -> NDArray[np.bool_]:
    """``nonzero`` with gaps of less than ``rows`` filled: a signal may pass through 0 while its source is on."""
    seen = np.flatnonzero(nonzero)
    on = nonzero.copy()
    gaps = np.diff(seen)
    for k in np.flatnonzero((gaps > 1) & (gaps <= rows)):
        on[seen[k] : seen[k + 1]] = True
    return on


def open_runs(paths: Sequence[Path]) -> list[RecordedRun]:
    """The runs of several recordings."""
    return [RecordedRun(path) for path in paths]


def _rates(clock: Clock) -> str:
    return f"a tick of {1e6 * clock.tick_s:g} µs and {clock.plc_ticks} in a PLC cycle"


def _same(a: float, b: float) -> bool:
    return math.isclose(a, b, rel_tol=SAME, abs_tol=1e-12) or (math.isnan(a) and math.isnan(b))


def _shown(value: float | None) -> str:
    return "that it was not measured" if value is None or math.isnan(value) else f"{value:.6g}"


def _overrides(text: str) -> list[str]:
    """The overrides, a JSON list; recordings made before it was one have a line each."""
    with suppress(ValueError, RecursionError):
        found = json.loads(text)
        if isinstance(found, list):
            return [str(entry) for entry in found]
    return [line for line in text.split("\n") if line]


def _scenario(recording: Recording) -> tuple[Scenario, list[str]]:
    """The scenario as it was run, and what this version does not know of it. Sample files travel as attachments."""
    overrides = _overrides(recording.metadata.get("overrides", ""))
    name = re.sub(r"[^\w.-]+", "_", printable(recording.scenario_name, 100)).lstrip(".-") or "scenario"
    source = recording.attachments[SCENARIO_FILE]
    try:
        if len(source) > LONGEST_SCENARIO:
            raise InputError(f"it has {len(source)} bytes, {LONGEST_SCENARIO} at most")
        scenario = parse_scenario(source, name=name, set=overrides, sample_files=recording.attachments)
    except (InputError, RecursionError) as error:
        text = str(error) if isinstance(error, InputError) else "it is nested too deeply"
        raise InputError(f"{recording.path}: its scenario cannot be read: {printable(text, 500)}") from None
    known, unknown = [], []
    for check in scenario.checks:
        try:
            metrics.validate(check)
            known.append(check)
        except InputError as error:
            unknown.append(f'check "{check.name}" cannot be measured by this version: {error}')
    return (scenario.with_checks(known) if unknown else scenario), unknown
