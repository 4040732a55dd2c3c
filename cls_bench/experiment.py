"""One experiment from scenario to verdict: run the bench, record, measure."""

import datetime as dt
import hashlib
import inspect
import json
import math
import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from cls_bench import interrupts
from cls_bench.analysis import metrics
from cls_bench.analysis.memory import Memory
from cls_bench.analysis.window import Source, Window, holds_all
from cls_bench.bench import Bench, DivergedError, versions
from cls_bench.claims import RECORDINGS, claim_stem, file_name
from cls_bench.compiled import is_cached
from cls_bench.control.outer_loop import OuterLoop
from cls_bench.controllers import Controller, Place
from cls_bench.drivers import scripted
from cls_bench.errors import BenchError, ControllerError, ExitCode, InputError, Interrupted
from cls_bench.parameters import Parameters
from cls_bench.recording import Recorder, Recording, RunInfo
from cls_bench.recording.recorder import COMPLETE
from cls_bench.rigs import Rig
from cls_bench.run_log import Trip
from cls_bench.scenario import Check, ExpectedTrip, Scenario, load_scenario
from cls_bench.signals import Event
from cls_bench.text import utf8

PASSED, FAILED, DIVERGED, TRIPPED = "passed", "failed", "diverged", "tripped"
CONTROLLER_FAILED = "controller_failed"
EXIT_CODES: dict[str, int] = {
    PASSED: ExitCode.PASSED, FAILED: ExitCode.FAILED, DIVERGED: ExitCode.DIVERGED, TRIPPED: ExitCode.TRIPPED,
    CONTROLLER_FAILED: ExitCode.CONTROLLER,
}  # fmt: skip
"""Statuses of a run, with the exit code of the command line."""


@dataclass(frozen=True)
class CheckResult:
    """What a check measured."""

    check: Check
    value: float
    """NaN if it could not be measured"""
    unit: str
    note: str = ""
    """why it could not be measured"""

    @property
    def judged(self) -> bool:
        """Whether the check has a limit; otherwise it only reports."""
        return self.check.min is not None or self.check.max is not None

    @property
    def passed(self) -> bool:
        """Whether the value lies within the limits."""
        low = -math.inf if self.check.min is None else self.check.min
        high = math.inf if self.check.max is None else self.check.max
        return not self.judged or low <= self.value <= high


@dataclass(frozen=True)
class Timing:
    """How long the run took."""

    simulated_s: float
    wall_s: float
    """with recording, without compilation"""

    @property
    def real_time_factor(self) -> float:
        """Simulated over wall-clock time."""
        return self.simulated_s / self.wall_s if self.wall_s > 0 else math.inf


@dataclass(frozen=True)
class Result:
    """Outcome of a run."""

    scenario: Scenario
    status: str
    """one of :data:`EXIT_CODES`"""
    checks: tuple[CheckResult, ...]
    mcap: Path
    rrd: Path | None
    timing: Timing
    message: str = ""
    """why it neither passed nor failed by its checks"""
    events: tuple[Event, ...] = ()
    """what the log holds of level warning and error"""

    @property
    def exit_code(self) -> int:
        """Exit code of the command line."""
        return EXIT_CODES[self.status]

    def __getitem__(self, name: str) -> float:
        """Value of the metric that the scenario lists under ``name``; KeyError that names those there are."""
        values = {result.check.name: result.value for result in self.checks}
        if name not in values:
            raise KeyError(f"{name}; the scenario measures {', '.join(values) or 'nothing'}")
        return values[name]

    def recording(self) -> Recording:
        """The recording, to read signals from."""
        return Recording(self.mcap)

    def to_json(self) -> dict[str, Any]:
        """What ``cls-bench run --json`` prints."""
        return {
            "scenario": self.scenario.name,
            "status": self.status,
            **({"message": self.message} if self.message else {}),
            "metrics": {
                r.check.name: {"value": _finite(r.value), "unit": r.unit, **_why(r)} for r in self.checks
            },
            "checks": [
                {
                    "name": r.check.name, "metric": r.check.metric, "window": list(r.check.window),
                    "value": _finite(r.value), "unit": r.unit, "min": r.check.min, "max": r.check.max,
                    "passed": r.passed, **_why(r),
                }
                for r in self.checks if r.judged
            ],
            "events": [
                {"time": round(e.time, 6), "level": e.level, "source": e.source, "message": e.message}
                for e in self.events
            ],
            "recordings": {"mcap": str(self.mcap), "rrd": str(self.rrd) if self.rrd else None},
            "timing": {
                "simulated_s": self.timing.simulated_s,
                "wall_s": round(self.timing.wall_s, 4),
                "real_time_factor": round(self.timing.real_time_factor, 2),
            },
        }  # fmt: skip


def _why(result: CheckResult) -> dict[str, str]:
    return {"note": result.note} if result.note else {}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


class Progress:
    """Told how far a run is; the base class says nothing."""

    def compiling(self) -> None:
        """Called before the first run compiles the loop, which happens once."""

    def recording(self, mcap: Path) -> None:
        """Called when the recording's file is there."""

    def advanced(self, simulated_s: float, real_time_factor: float) -> None:
        """Called after every block."""


def validate(scenario: Scenario) -> None:
    """Raise InputError unless the bench can be built and all checks can be measured."""
    _check_metrics(scenario)
    if scenario.controller_place is not None:
        scenario.controller_place.check()
    Bench(scenario.parameters_at_start(), seed=scenario.seed)


def _check_metrics(scenario: Scenario) -> None:
    for k, check in enumerate(scenario.checks):
        try:
            metrics.validate(check)
        except InputError as error:
            raise InputError(f"{scenario.path or scenario.name}: checks[{k}].{error}") from None


def run(
    scenario: Scenario | str | Path,
    *,
    out: Path | str = RECORDINGS,
    seed: int | None = None,
    set: Sequence[str] = (),
    rig: str | Path | Rig | None = None,
    rerun: bool = True,
    controller: OuterLoop | str | Place | None = None,
    progress: Progress | None = None,
) -> Result:
    """Run a scenario, shipped by name, from a file or as an object; record it in the folder ``out``; measure it.

    ``seed``, ``set`` (``KEY=VALUE``) and ``rig`` override the file's values. ``controller`` replaces the feel model, or
    the scenario's own controller: an object, or ``"FILE.py:NAME"``, ``"package.module:NAME"``, or a
    :class:`~cls_bench.controllers.Place` with arguments. Raises InputError and OutputError, and ControllerError if a
    controller cannot be made. A run that diverges, or whose controller fails, is a Result with that status; its
    recording ends there.
    """
    if not isinstance(scenario, Scenario):
        scenario = load_scenario(scenario, seed=seed, set=set, rig=rig)
    elif seed is not None or set or rig is not None:
        raise InputError("seed, set and rig override the values of a file; this scenario is loaded already: changed()")
    progress = progress or Progress()
    _check_metrics(scenario)
    parameters = scenario.parameters_at_start()
    loop, about = _controller(scenario, parameters, controller)
    bench = Bench(parameters, seed=scenario.seed, controller=loop)
    if not is_cached():
        progress.compiling()
    bench.compile()
    topics = scenario.record.topics(bench.topics)
    whole = holds_all(topics, bench.topics, bench.clock)
    memory = None if whole else Memory(scenario.checks, bench.clock, bench.topics)
    failure: BenchError | None = None
    events: list[Event] = []
    simulated, recorder = 0.0, None
    info = run_info(scenario, bench, about)  # before a name is claimed: a process killed meanwhile leaves no empty file
    try:
        # A signal is noted while the files are open, and raised between two blocks.
        with (
            interrupts.held(),
            Recorder(
                _claimed(Path(out), scenario, rerun=rerun), info, rerun=rerun,
                topics=topics, poses=scenario.record.poses,
            ) as recorder,
        ):  # fmt: skip
            progress.recording(recorder.mcap_path)
            start = time.perf_counter()
            try:
                for block in scripted.run(bench, scenario):
                    recorder.write(block)
                    events += (event for event in block.events if event.level != "info")
                    if memory is not None:
                        memory.keep(block)
                    simulated = bench.time
                    progress.advanced(recorder.written_s, simulated / (time.perf_counter() - start))
                    interrupts.check()
            except (DivergedError, ControllerError) as error:
                failure = error
            recorder.flush()
            flushed = time.perf_counter()
            source = memory or Recording(recorder.mcap_path, unfinished=True)
            checks = measure(scenario, source, own_loop=loop is not None)
            ended = ending(scenario, bench.trips, failure)
            verdict = ended.judged(checks)
            measuring = time.perf_counter() - flushed
            recorder.finish(
                ended.status if ended.status != PASSED else COMPLETE, verdict.status,
                {result.check.name: _finite(result.value) for result in checks},
            )  # fmt: skip
            timing = Timing(simulated, time.perf_counter() - start - measuring)
            progress.advanced(simulated, timing.real_time_factor)
    except KeyboardInterrupt:
        if recorder is None:
            raise
        raise Interrupted(f"interrupted at t = {simulated:g} s; kept: {recorder.mcap_path}") from None
    return Result(
        scenario, verdict.status, checks, recorder.mcap_path, recorder.rrd_path, timing, verdict.message, tuple(events)
    )


class Ending(NamedTuple):
    """How a run ended."""

    status: str
    message: str = ""

    def judged(self, checks: Sequence[CheckResult]) -> "Ending":
        """The same with what its checks say: a run that ended well fails if one of them does."""
        if self.status == PASSED and not all(check.passed for check in checks):
            return Ending(FAILED)
        return self


def ending(scenario: Scenario, trips: Sequence[Trip], failure: BenchError | None) -> Ending:
    """How a run ended, its checks aside: by ``failure``, by a trip that the scenario does not expect, or well.

    A trip that the scenario expects and that did not come is a failure of the run.
    """
    if isinstance(failure, ControllerError):
        return Ending(CONTROLLER_FAILED, str(failure))
    if failure is not None:
        return Ending(DIVERGED, str(failure))
    expected = scenario.expected_trips
    for trip in trips:
        if not any(_is_expected(trip, entry) for entry in expected):
            return Ending(TRIPPED, f"at t = {trip.time:.4f} s: {trip.message}")
    for entry in expected:
        if not any(_is_expected(trip, entry) for trip in trips):
            start, end = entry.window
            return Ending(FAILED, f"expected trip did not come: {entry.reason} from {start:g} to {end:g} s")
    return Ending(PASSED)


def _is_expected(trip: Trip, entry: ExpectedTrip) -> bool:
    start, end = entry.window
    return entry.reason in ("any", trip.reason) and start - _HALF <= trip.time <= end + _HALF


_HALF = 25e-6
"""Half a tick [s]: times of a file are rounded to ticks."""


FEEL_MODEL = "feel model"
"""What a recording calls the controller of a run without one of the user's own."""


def make_controller(scenario: Scenario, parameters: Parameters) -> OuterLoop | None:
    """A fresh object of the controller that the scenario names; None for the feel model."""
    place = scenario.controller_place
    loop: OuterLoop | None = None if place is None else Controller(place).make(parameters.for_control)
    return loop


def _controller(
    scenario: Scenario, parameters: Parameters, given: OuterLoop | str | Place | None
) -> tuple[OuterLoop | None, dict[str, bytes | str]]:
    """The outer loop of a run, and what the recording says of it: its text under ``controller.py``, else metadata."""
    place = scenario.controller_place if given is None else given
    if isinstance(place, str):
        place = Place(place, key="controller")
    if isinstance(place, Place):
        found = Controller(place)
        return found.make(parameters.for_control), {**found.metadata, CONTROLLER_FILE: found.text}
    if place is None:
        return None, {"controller.name": FEEL_MODEL}
    return place, {"controller.name": type(place).__name__, **_source_of(type(place))}


CONTROLLER_FILE = "controller.py"
"""Attachment with the source of the user's controller."""


def _source_of(kind: type) -> dict[str, bytes | str]:
    """Where the class of an object was written, as far as that is known."""
    try:
        path = Path(inspect.getfile(kind))
        text = path.read_bytes()
    except (OSError, TypeError):
        return {}
    return {
        "controller.source": path.name, "controller.sha256": hashlib.sha256(text).hexdigest(), CONTROLLER_FILE: text,
    }  # fmt: skip


def measure(scenario: Scenario, recording: Source, *, own_loop: bool = False) -> tuple[CheckResult, ...]:
    """Evaluate the scenario's checks on a recording of it, or on samples kept in memory.

    ``own_loop`` says that a user's outer loop ran instead of the feel model.
    """
    windows: dict[tuple[float, float], Window] = {}
    results = []
    for check in scenario.checks:
        if check.window not in windows:
            start, end = check.window
            windows[check.window] = Window(
                recording, start, end, scenario.parameters_at(start), idle=scenario.idle(start, end), own_loop=own_loop,
                moving=scenario.moving(start, end),
            )  # fmt: skip
        value, note = metrics.evaluate(check, windows[check.window])
        results.append(CheckResult(check, value, metrics.unit(check), note))
    return tuple(results)


def run_info(scenario: Scenario, bench: Bench, controller: Mapping[str, bytes | str]) -> RunInfo:
    """What the recording says of a run besides its samples; ``controller`` is what it says of the controller."""
    files = {name: content for name, content in controller.items() if isinstance(content, bytes) and content}
    about = {name: text for name, text in controller.items() if isinstance(text, str)}
    return RunInfo(
        scenario_name=utf8(scenario.name),
        scenario_toml=scenario.source,
        mjcf={**bench.mjcf, **scenario.sample_files, **files},
        parameters=bench.parameters.model_dump(),
        metadata={
            **scenario.the_rig.metadata, **(scenario.the_aircraft.metadata if scenario.the_aircraft else {}),
            "title": scenario.title, "seed": str(scenario.seed),
            "overrides": json.dumps(scenario.overrides),
            **({"notes": "\n".join(scenario.notes)} if scenario.notes else {}),
            "units": "SI; radians", "commit": _commit(), **{name: utf8(text) for name, text in about.items()},
            **versions(),
        },
        wall_start=dt.datetime.now(dt.UTC).isoformat(timespec="milliseconds"),
        body_names=bench.body_names,
        geoms=bench.geoms,
        clock=bench.clock,
    )  # fmt: skip


def _claimed(folder: Path, scenario: Scenario, *, rerun: bool) -> Path:
    """A name in ``folder`` that no other run has, however many start at the same moment."""
    name = f"{file_name(scenario.name)}-{dt.datetime.now():%Y%m%d-%H%M%S}"
    made, others = ((".mcap", ".rrd"), ()) if rerun else ((".mcap",), (".rrd",))
    return claim_stem(folder, name, made, others)


def _commit() -> str:
    """Commit of the checkout the package runs from; "none" outside of one."""
    folder = Path(__file__).parent
    try:
        git = subprocess.run(
            ["git", "describe", "--always", "--dirty", "--abbrev=12"],
            cwd=folder, capture_output=True, text=True, timeout=5, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return "none"
    return git.stdout.strip()

