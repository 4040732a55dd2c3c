"""A run as its recording tells it: scenario, parameters, verdict and signals, without any other file."""

import tempfile
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench import experiment
from cls_bench.analysis.window import Window
from cls_bench.errors import InputError, one_line
from cls_bench.parameters import Parameters, leaves
from cls_bench.recording import Recording
from cls_bench.scenario import Scenario, parse_scenario
from cls_bench.signals import PLC_TICKS, POSE_TICKS, TICK_S

SCENARIO_FILE = "scenario.toml"
"""Attachment with the scenario as it was read."""


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


class RecordedRun:
    """A recording with the scenario that it carries. Raises InputError if it is no recording of a run."""

    def __init__(self, path: Path):
        self.recording = Recording(path)
        self.path = path
        if SCENARIO_FILE not in self.recording.attachments:
            raise InputError(f"{path} carries no scenario; it was cut short before its first samples")
        self.scenario = _scenario(self.recording)
        self._windows: dict[Span, Window] = {}

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
    def checks(self) -> tuple[experiment.CheckResult, ...]:
        """What the scenario's checks measure on this recording."""
        return experiment.measure(self.scenario, self.recording)

    @property
    def verdict(self) -> str:
        """``passed`` or ``failed`` by the checks; otherwise how the recording ended, such as ``diverged``."""
        if self.recording.status != "complete":
            return self.recording.status
        return experiment.PASSED if all(check.passed for check in self.checks) else experiment.FAILED

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
            self._windows[span] = Window(self.recording, *span, self.scenario.parameters_at(span.start))
        return self._windows[span]

    @property
    def whole(self) -> Window:
        """The whole run."""
        return self.window(Span(0.0, self.duration))

    def spans(self, *metrics: str, signal: str | None = None) -> list[Span]:
        """Windows of the checks that measure one of ``metrics``, in order of time, if they were recorded to their end.

        With ``signal``, only of those that measure it.
        """
        found = {
            Span(*check.window) for check in self.scenario.checks
            if check.metric in metrics and signal in (None, check.signal)
        }  # fmt: skip
        return sorted(span for span in found if span.end <= self.duration + TICK_S)

    @cached_property
    def powered(self) -> NDArray[np.bool_]:
        """Whether the drive's power stage was on, at the PLC's rate: without power its voltage is exactly 0."""
        voltage = self.recording.read("/drive", ["voltage"], every=PLC_TICKS // self.recording.topics["/drive"].ticks)
        return held_on(voltage["voltage"] != 0.0)

    def power_in(self, span: Span) -> str:
        """``"on"``, ``"off"`` or ``"changing"``: the drive's power in ``span``."""
        first, last = (round(time / (PLC_TICKS * TICK_S)) for time in span)
        on = self.powered[first:last]
        return "on" if on.all() else "changing" if on.any() else "off"


def held_on(nonzero: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """``nonzero`` with gaps of less than 10 ms filled: a signal may pass through 0 while its source is on."""
    rows = POSE_TICKS // PLC_TICKS
    seen = np.flatnonzero(nonzero)
    on = nonzero.copy()
    gaps = np.diff(seen)
    for k in np.flatnonzero((gaps > 1) & (gaps <= rows)):
        on[seen[k] : seen[k + 1]] = True
    return on


def open_runs(paths: Sequence[Path]) -> list[RecordedRun]:
    """The runs of several recordings."""
    return [RecordedRun(path) for path in paths]


def _scenario(recording: Recording) -> Scenario:
    """The scenario as it was run. Sample files that it names travel as attachments and are laid beside it."""
    overrides = [line for line in recording.metadata.get("overrides", "").split("\n") if line]
    with tempfile.TemporaryDirectory() as folder:
        for name, content in recording.attachments.items():
            place = (Path(folder) / name).resolve()
            if place.is_relative_to(Path(folder).resolve()):
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
        path = Path(folder) / f"{recording.scenario_name or 'scenario'}.toml"
        return parse_scenario(recording.attachments[SCENARIO_FILE], path=path, set=overrides)
