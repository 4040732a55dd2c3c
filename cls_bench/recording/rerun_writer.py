"""Writes runs for the Rerun viewer: a view of the recording, not its master."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cls_bench.geometry import ARROWS, force_arrows
from cls_bench.recording import rerun_layout as layout
from cls_bench.recording import rerun_scene
from cls_bench.recording.layout import rows_of
from cls_bench.recording.mcap_reader import Recording
from cls_bench.recording.rerun_file import RerunFile
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import EVENTS_TOPIC, PLC_TICKS, POSE_TICKS, TICK_NS, TOPIC, TOPICS, Block, Event, Topic
from cls_bench.text import utf8

Array = NDArray[np.float64]
Ticks = NDArray[np.int64]
Named = tuple[str, str]

VIEW_TICKS = PLC_TICKS
"""Samples are drawn at the PLC's rate, 2.5 kHz: rows whose tick is divisible by this."""

LOOP_TICKS = 40
"""Torque over displacement is drawn at 500 Hz."""

BATCH_TICKS = 8_000
"""Ticks that are sent at once (0.4 s): as much as a killed run loses; larger chunks make the viewer quicker."""

LEVELS = {"info": rr.TextLogLevel.INFO, "warning": rr.TextLogLevel.WARN, "error": rr.TextLogLevel.ERROR}
"""Log levels of :class:`cls_bench.signals.Event` in Rerun's terms."""

APPLICATION = "cls-bench"


class RerunRecorder:
    """An .rrd file with the topics at 2.5 kHz, events, the moving bench and a layout that shows them.

    Of topics that are sampled faster, the rows whose tick is divisible by :data:`VIEW_TICKS` are kept: analyses read
    the MCAP file. Data go to the file every 0.4 s of simulated time; torque over displacement, whose scales are known
    at the end, when it is finished. ``topics`` and ``poses`` as for :class:`McapRecorder`. Raises :class:`OSError` when
    the file cannot be created or written.
    """

    def __init__(self, path: Path, info: RunInfo, *, topics: Sequence[Topic] = TOPICS, poses: bool = True):
        self._file = _opened(path, [""], [info.scenario_name])
        try:
            self._file.stream.send_recording_name(info.scenario_name)
            self._file.stream.send_property("run", _run_properties(info))
            self._run = _Run(self._file, info, "", topics, poses=poses)
            self._file.flush()
        except BaseException:
            self._file.close()
            raise

    @property
    def written_ticks(self) -> int:
        """How many ticks of the run the file holds, whatever becomes of this process."""
        return self._run.written_ticks

    def write(self, block: Block) -> None:
        """Take over ``block``. Raises :class:`OSError` when the file cannot be written."""
        self._run.write(block)

    def finish(
        self, status: str, wall_end: str = "", *, verdict: str = "", checks: Mapping[str, float | None] | None = None
    ) -> None:
        """Write what is pending, ``status`` and ``verdict``, and close the file. Raises :class:`OSError`."""
        try:
            self._run.finish()
            self._file.stream.send_property("result", rr.AnyValues(status=status, verdict=verdict or status))
        except BaseException:
            self.close()
            raise
        self._file.finish()

    def close(self) -> None:
        """Close the file as it is; what was written stays readable."""
        self._file.close()


def write_rrd(recordings: Sequence[Recording], path: Path) -> None:
    """Write the .rrd of one recording, or of several side by side on one timeline. Raises :class:`OSError`.

    The first recording's entities are at the root; of several, each run's are below ``run_1``, ``run_2``, …
    """
    alone = len(recordings) == 1
    prefixes = [""] if alone else [f"/run_{number}" for number in range(1, len(recordings) + 1)]
    infos = [recording.run_info() for recording in recordings]
    titles = [infos[0].scenario_name] if alone else [utf8(recording.path.stem) for recording in recordings]
    file = _opened(path, prefixes, titles)
    try:
        file.stream.send_recording_name(" and ".join(titles))
        if alone:
            file.stream.send_property("run", _run_properties(infos[0]))
        for prefix, info, recording in zip(prefixes, infos, recordings, strict=True):
            run = _Run(file, info, prefix, _known(recording))
            for block in recording.blocks():
                run.write(block)
            run.finish()
        if alone:
            file.stream.send_property("result", rr.AnyValues(status=recordings[0].status))
    except BaseException:
        file.close()
        raise
    file.finish()


def _known(recording: Recording) -> list[Topic]:
    """The topics of a recording as its blocks hold them: of those there are, with the rows that were recorded."""
    found = []
    for topic in recording.topics.values():
        if (ours := TOPIC.get(topic.path)) is not None:
            signals = tuple(signal for signal in ours.signals if signal.name in topic.names)
            ticks = ours.ticks if topic.ticks % ours.ticks else topic.ticks
            found.append(replace(ours, signals=signals, ticks=ticks))
    return [topic for topic in found if topic.signals]


def _opened(path: Path, prefixes: Sequence[str], titles: Sequence[str]) -> RerunFile:
    return RerunFile(path, APPLICATION, layout.blueprint(prefixes, titles))


class _Batch:
    """Samples of some ticks, by topic."""

    def __init__(self, parts: Mapping[str, Sequence[tuple[Ticks, Array]]], topics: Mapping[str, Topic]):
        self._topics = topics
        self._ticks = {path: np.concatenate([ticks for ticks, _ in found]) for path, found in parts.items()}
        self._rows = {path: np.concatenate([rows for _, rows in found]) for path, found in parts.items()}

    def topic(self, path: str) -> tuple[Ticks, Array]:
        """Ticks and samples of a topic, shape (rows, signals)."""
        return self._ticks[path], self._rows[path]

    def has(self, signal: Named) -> bool:
        """Whether a signal, given by topic and name, was recorded."""
        path, name = signal
        return path in self._topics and name in self._topics[path].names

    def columns(self, *signals: Named) -> tuple[Ticks, Array]:
        """The ticks that all of ``signals`` were sampled at, and the samples, shape (rows, signals).

        Without rows if one of them was not recorded.
        """
        if not signals or not all(map(self.has, signals)):
            return np.zeros(0, np.int64), np.zeros((0, len(signals)))
        paths = {path for path, _ in signals}
        columns = [self._rows[path][:, self._topics[path].names.index(name)] for path, name in signals]
        if len({self._topics[path].ticks for path in paths}) == 1:
            return self._ticks[signals[0][0]], np.stack(columns, axis=1)
        ticks = reduce(np.intersect1d, [self._ticks[path] for path in paths])
        kept = [np.isin(self._ticks[path], ticks) for path, _ in signals]
        return ticks, np.stack([column[there] for column, there in zip(columns, kept, strict=True)], axis=1)


class _Run:
    """Sends one run's data to a file, of its signals those of ``topics``, its entities below ``prefix``."""

    def __init__(
        self, file: RerunFile, info: RunInfo, prefix: str, topics: Sequence[Topic], *, poses: bool = True
    ):
        self.written_ticks = 0
        self._file, self._stream = file, file.stream
        self._prefix = prefix
        self._topics = {
            t.path: t if VIEW_TICKS % t.ticks else replace(t, ticks=VIEW_TICKS) for t in topics
        }  # fmt: skip
        self._has_poses = poses
        names = [name or f"body {i}" for i, name in enumerate(info.body_names)]
        self._bodies = [f"{prefix}/" + rr.new_entity_path([layout.BENCH, name]).lstrip("/") for name in names]
        arrows_on = ("column", "rod_end")
        self._arrow_bodies = [names.index(name) for name in arrows_on] if set(arrows_on) <= set(names) else None
        self._parts: dict[str, list[tuple[Ticks, Array]]] = {path: [] for path in self._topics}
        self._pose_ticks: list[Ticks] = []
        self._poses: list[Array] = []
        self._pending_ticks = 0
        self._loop: list[Array] = []  # time [tick], angle [rad], torque [N·m], powered
        self._states: dict[str, str] = {}
        self._said: dict[str, layout.Color] = {}  # event -> colour
        self._limits = _travel_limits(info.parameters)
        self._send_static(info)

    def write(self, block: Block) -> None:
        """Take over ``block``."""
        for path, topic in self._topics.items():
            self._parts[path].append((block.row_ticks(topic.ticks), rows_of(topic, block)))
        if self._has_poses:
            self._pose_ticks.append(block.row_ticks(POSE_TICKS))
            self._poses.append(block.poses)
        self._pending_ticks += block.ticks
        self._send_events(block.events)
        if self._pending_ticks >= BATCH_TICKS:
            self._send_pending()
            self.written_ticks = block.end_tick

    def finish(self) -> None:
        """Send what is pending, and what is known now that all was seen."""
        self._send_pending()
        self._send_loop()
        if self._said:
            look = rr.StateConfiguration(values=list(self._said), colors=list(self._said.values()))
            self._log(layout.EVENT_LANE, look)

    def _at(self, entity: str) -> str:
        return f"{self._prefix}/{entity.lstrip('/')}"

    def _log(self, entity: str, archetype: rr.AsComponents) -> None:
        self._stream.log(self._at(entity), archetype, static=True)

    def _send_static(self, info: RunInfo) -> None:
        for topic in self._topics.values():
            names = [f"{signal.name} [{signal.unit}]" for signal in topic.signals]
            self._log(topic.path, layout.lines(names, layout.PALETTE[np.arange(len(names)) % len(layout.PALETTE)]))
        for plot in layout.PLOTS:
            if curves := self._curves(plot):
                self._log(plot.entity, layout.lines([c[2] for c in curves], [c[3] for c in curves]))
        scenario = info.scenario_toml.decode(errors="replace")
        fence = "`" * max(3, 1 + max((len(run) for run in re.findall("`+", scenario)), default=0))
        text = f"{fence}toml\n{scenario}\n{fence}"
        self._log(layout.SCENARIO, rr.TextDocument(text, media_type="text/markdown"))
        self._log(layout.BENCH, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for body, kind in sorted({(geom.body, geom.kind) for geom in info.geoms}):
            geoms = [geom for geom in info.geoms if (geom.body, geom.kind) == (body, kind)]
            for number, archetype in enumerate(rerun_scene.archetypes(kind, geoms)):
                self._stream.log(f"{self._bodies[body]}/{kind}_{number}", archetype, static=True)
        if self._arrow_bodies:
            colors = [layout.PILOT, layout.MEASURED]
            look = rr.Arrows3D.from_fields(colors=colors, radii=[0.006], labels=list(ARROWS), show_labels=False)
            self._log(layout.FORCES, look)
        for lane, states in (
            (layout.DRIVE_LANE, layout.DRIVE_STATES),
            (layout.HAND_LANE, layout.HAND_STATES),
            (layout.TRAVEL_LANE, layout.TRAVEL_STATES),
        ):
            self._log(lane, rr.StateConfiguration(values=list(states), colors=list(states.values())))

    def _send_events(self, events: Sequence[Event]) -> None:
        if not events:
            return
        time = [_time(np.array([event.tick for event in events]))]
        text = [f"{event.source}: {event.message}" for event in events]
        levels = [LEVELS[event.level] for event in events]
        self._said |= {line: layout.LEVEL_COLORS[event.level] for line, event in zip(text, events, strict=True)}
        self._stream.send_columns(self._at(EVENTS_TOPIC), time, rr.TextLog.columns(text=text, level=levels))
        self._stream.send_columns(self._at(layout.EVENT_LANE), time, rr.StateChange.columns(state=text))

    def _curves(self, plot: layout.Plot) -> list[layout.Curve]:
        """The curves of a plot whose signals were recorded."""
        batch = _Batch({}, self._topics)
        return [curve for curve in plot.curves if batch.has(curve[:2])]

    def _send_pending(self) -> None:
        """Send all that was collected, and wait until it is written: the file sets the pace."""
        if not self._pending_ticks:
            return
        batch = _Batch(self._parts, self._topics)
        self._send_samples(batch)
        if self._poses:
            pose_ticks, poses = np.concatenate(self._pose_ticks), np.concatenate(self._poses)
            if len(pose_ticks):
                self._send_poses(pose_ticks, poses, batch)
        self._file.flush()
        self._parts = {path: [] for path in self._topics}
        self._pose_ticks.clear()
        self._poses.clear()
        self._pending_ticks = 0

    def _send_samples(self, batch: _Batch) -> None:
        for path in self._topics:
            self._send_scalars(path, *batch.topic(path))
        for plot in layout.PLOTS:
            ticks, rows = batch.columns(*(curve[:2] for curve in self._curves(plot)))
            self._send_scalars(plot.entity, ticks, rows * plot.scale)
        ticks, voltage = batch.columns(("/drive", "voltage"))
        powered = _powered(voltage[:, 0] != 0.0)
        self._send_states(layout.DRIVE_LANE, ticks, np.where(powered, "power on", "power off"))
        ticks, squeeze = batch.columns(("/pilot", "squeeze"))
        self._send_states(layout.HAND_LANE, ticks, _hand_states(squeeze[:, 0]))
        if self._limits:
            ticks, angle = batch.columns(("/column", "angle"))
            beyond = np.digitize(np.abs(angle[:, 0]), self._limits)
            self._send_states(layout.TRAVEL_LANE, ticks, np.array(list(layout.TRAVEL_STATES))[beyond])
        loop = ("/column", "angle"), ("/load_cell", "torque"), ("/drive", "voltage")
        ticks, rows = batch.columns(*loop[: 3 if batch.has(loop[2]) else 2])
        powered = _powered(rows[:, 2] != 0.0) if rows.shape[1] > 2 else np.ones(len(rows), np.bool_)
        kept = ticks % LOOP_TICKS == 0
        self._loop.append(np.stack([ticks, rows[:, 0], rows[:, 1], powered], axis=1)[kept])

    def _send_scalars(self, entity: str, ticks: Ticks, rows: Array) -> None:
        if len(ticks):
            scalars = rr.Scalars.columns(scalars=np.ascontiguousarray(rows))
            self._stream.send_columns(self._at(entity), [_time(ticks)], scalars)

    def _send_poses(self, ticks: Ticks, poses: Array, batch: _Batch) -> None:
        time = [_time(ticks)]
        for number, entity in enumerate(self._bodies[1:], start=1):
            translation, quaternion = poses[:, number, :3], poses[:, number, [4, 5, 6, 3]]  # w x y z -> x y z w
            transform = rr.Transform3D.columns(translation=translation, quaternion=quaternion)
            self._stream.send_columns(entity, time, transform)
        if self._arrow_bodies is None:
            return
        sampled, forces = batch.columns(("/pilot", "hand_force"), ("/load_cell", "force"))
        both, at, of = np.intersect1d(ticks, sampled, return_indices=True)
        if len(both):
            column, rod_end = (poses[at, number] for number in self._arrow_bodies)
            origins, vectors = force_arrows(column, rod_end, forces[of, 0], forces[of, 1])
            arrows = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
            pairs = arrows.partition(np.full(len(both), len(ARROWS)))
            self._stream.send_columns(self._at(layout.FORCES), [_time(both)], pairs)

    def _send_states(self, lane: str, ticks: Ticks, states: NDArray[np.str_]) -> None:
        """Send the changes of a lane's state."""
        if not len(ticks):
            return
        before = np.append(self._states.get(lane, ""), states[:-1])
        changed = states != before
        self._states[lane] = str(states[-1])
        if changed.any():
            changes = rr.StateChange.columns(state=states[changed].tolist())
            self._stream.send_columns(self._at(lane), [_time(ticks[changed])], changes)

    def _send_loop(self) -> None:
        """Torque over displacement: the whole curve, a dot that moves, and axes; y points down in Rerun's 2D views."""
        loop = np.concatenate(self._loop) if self._loop else np.zeros((0, 4))
        if len(loop) < 2:
            return
        angle, torque = loop[:, 1] * layout.DEGREES, loop[:, 2]
        right, top = _round_up(float(np.abs(angle).max())), _round_up(float(np.abs(torque).max()))
        points = np.stack([1.5 * angle / right, -torque / top], axis=1)
        at = layout.TORQUE_OVER_ANGLE
        cuts = np.flatnonzero(np.diff(loop[:, 3])) + 1
        strips = np.split(points, cuts)
        colors = [layout.MEASURED if part[0] else layout.MODEL for part in np.split(loop[:, 3], cuts)]
        axes = [[(-1.5, 0.0), (1.5, 0.0)], [(0.0, -1.0), (0.0, 1.0)]]
        self._log(f"{at}/axes", rr.LineStrips2D(axes, colors=[(90, 98, 106)], radii=rr.Radius.ui_points(0.75)))
        self._log(f"{at}/curve", rr.LineStrips2D(strips, colors=colors, radii=rr.Radius.ui_points(1.0)))
        marks = [(-1.5, 0.0), (1.5, 0.0), (0.0, -1.0), (0.0, 1.0)]
        labels = [f"−{right:g}°", f"{right:g}°", f"{top:g} N·m", f"−{top:g} N·m"]
        look = {"colors": [layout.QUIET], "radii": rr.Radius.ui_points(1.5)}
        self._log(f"{at}/marks", rr.Points2D(marks, labels=labels, show_labels=True, **look))
        self._log(f"{at}/now", rr.Points2D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(5.0)))
        shown = loop[:, 0] % POSE_TICKS == 0
        time = [_time(loop[shown, 0].astype(np.int64))]
        self._stream.send_columns(self._at(f"{at}/now"), time, rr.Points2D.columns(positions=points[shown]))


def _time(ticks: Ticks) -> rr.TimeColumn:
    # Integer nanoseconds: float seconds would be off by one now and then.
    return rr.TimeColumn(layout.TIMELINE, duration=(ticks * TICK_NS).astype("timedelta64[ns]"))


def _powered(driven: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether the power stage is on: its voltage is exactly 0 when it is off, and crosses 0 when it is on."""
    return np.asarray(driven | np.append(driven[1:], False) | np.append(False, driven[:-1]))


def _hand_states(squeeze: Array) -> NDArray[np.str_]:
    names = list(layout.HAND_STATES)
    return np.array(names)[np.digitize(squeeze, [0.0, 0.1, 0.6])]


def _travel_limits(parameters: Mapping[str, Any]) -> list[float]:
    """Column angles [rad], at the start of the run, where the feel model's first limit begins and the switches open."""
    try:
        return sorted([float(parameters["feel"]["aft_limit"]["angle"]), float(parameters["column"]["switch_angle"])])
    except KeyError:
        return []


def _round_up(value: float) -> float:
    """The next of 1, 2, 2.5, 5 and 10 times a power of ten."""
    scale = 10.0 ** np.floor(np.log10(max(value, 1e-3)))
    return float(next(step * scale for step in (1.0, 2.0, 2.5, 5.0, 10.0, 20.0) if step * scale >= value))


def _run_properties(info: RunInfo) -> rr.AnyValues:
    """The metadata, under names that Rerun takes for components."""
    values: Mapping[str, Any] = {
        re.sub(r"\W", "_", name): text for name, text in info.metadata.items() if name != "drop_untyped_nones"
    }
    return rr.AnyValues(**values)
