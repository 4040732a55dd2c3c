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

from cls_bench.geometry import ARROWS, GRIP_HEIGHT, force_arrows
from cls_bench.recording import palette, rerun_scene
from cls_bench.recording import rerun_layout as layout
from cls_bench.recording.layout import rows_of
from cls_bench.recording.mcap_reader import Recording
from cls_bench.recording.rerun_file import RerunFile
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import EVENTS_TOPIC, Block, Event, Topic
from cls_bench.text import utf8

Array = NDArray[np.float64]
Ticks = NDArray[np.int64]
Named = tuple[str, str]

LOOP_S = 0.002
"""Torque over displacement is drawn at some 500 Hz: time between its points [s]."""

BATCH_S = 0.4
"""What is sent at once [s]: as much as a killed run loses; larger chunks make the viewer quicker."""

LEVELS = {"info": rr.TextLogLevel.INFO, "warning": rr.TextLogLevel.WARN, "error": rr.TextLogLevel.ERROR}
"""Log levels of :class:`cls_bench.signals.Event` in Rerun's terms."""

APPLICATION = "cls-bench"


class RerunRecorder:
    """An .rrd file with the topics at the PLC's rate, events, the moving bench and a layout that shows them.

    Of topics that are sampled faster, the rows at the PLC's ticks are kept: analyses read the MCAP file. Data go to the
    file every 0.4 s of simulated time; torque over displacement, whose scales are known at the end, when it is
    finished. ``topics`` and ``poses`` as for :class:`McapRecorder`. Raises :class:`OSError` when the file cannot be
    created or written.
    """

    def __init__(self, path: Path, info: RunInfo, *, topics: Sequence[Topic], poses: bool = True):
        self._file = _opened(path, [layout.Shown("", info.scenario_name, topics)])
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
    known = [_known(recording) for recording in recordings]
    file = _opened(path, [layout.Shown(*run) for run in zip(prefixes, titles, known, strict=True)])
    try:
        file.stream.send_recording_name(" and ".join(titles))
        if alone:
            file.stream.send_property("run", _run_properties(infos[0]))
        for prefix, info, topics, recording in zip(prefixes, infos, known, recordings, strict=True):
            run = _Run(file, info, prefix, topics)
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
    known = {topic.path: topic for topic in recording.known_topics}
    for topic in recording.topics.values():
        if (ours := known.get(topic.path)) is not None:
            signals = tuple(signal for signal in ours.signals if signal.name in topic.names)
            ticks = ours.ticks if topic.ticks % ours.ticks else topic.ticks
            found.append(replace(ours, signals=signals, ticks=ticks))
    return [topic for topic in found if topic.signals]


def _opened(path: Path, shown: Sequence[layout.Shown]) -> RerunFile:
    return RerunFile(path, APPLICATION, layout.blueprint(shown))


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
        self.file, self.clock = file, info.clock
        view = self.clock.plc_ticks
        self.topics = {t.path: t if view % t.ticks else replace(t, ticks=view) for t in topics}
        self._prefix = prefix
        self._has_poses = poses
        names = [name or f"body {i}" for i, name in enumerate(info.body_names)]
        self._bodies = [f"{prefix}/" + rr.new_entity_path([layout.BENCH, name]).lstrip("/") for name in names]
        self._axes = [_Axis(self, prefix, axis, names, info.parameters) for axis in layout.axes(topics)]
        self._parts: dict[str, list[tuple[Ticks, Array]]] = {path: [] for path in self.topics}
        self._pose_ticks: list[Ticks] = []
        self._poses: list[Array] = []
        self._pending_ticks = 0
        self._said: dict[str, palette.Color] = {}  # event -> colour
        self._send_static(info)

    def write(self, block: Block) -> None:
        """Take over ``block``."""
        if block.clock != self.clock:
            raise ValueError(f"a block of {block.clock} in a view at {self.clock}")
        for path, topic in self.topics.items():
            self._parts[path].append((block.row_ticks(topic.ticks), rows_of(topic, block)))
        if self._has_poses:
            self._pose_ticks.append(block.row_ticks(self.clock.pose_ticks))
            self._poses.append(block.poses)
        self._pending_ticks += block.ticks
        self._send_events(block.events)
        if self.clock.time(self._pending_ticks) >= BATCH_S:
            self._send_pending()
            self.written_ticks = block.end_tick

    def finish(self) -> None:
        """Send what is pending, and what is known now that all was seen."""
        self._send_pending()
        for axis in self._axes:
            axis.send_loop()
        if self._said:
            look = rr.StateConfiguration(values=list(self._said), colors=list(self._said.values()))
            for axis in self._axes:
                self.log(axis.at(layout.EVENT_LANE), look)

    def log(self, entity: str, archetype: rr.AsComponents) -> None:
        """Send what holds for all time."""
        self.file.stream.log(entity, archetype, static=True)

    def send(self, entity: str, ticks: Ticks, columns: Any) -> None:
        """Send what belongs to ``ticks``."""
        self.file.stream.send_columns(entity, [self.time(ticks)], columns)

    def time(self, ticks: Ticks) -> rr.TimeColumn:
        """Ticks on the timeline, in integer nanoseconds: float seconds would be off by one now and then."""
        return rr.TimeColumn(layout.TIMELINE, duration=(ticks * self.clock.tick_ns).astype("timedelta64[ns]"))

    def _at(self, entity: str) -> str:
        return f"{self._prefix}/{entity.lstrip('/')}"

    def _send_static(self, info: RunInfo) -> None:
        for topic in self.topics.values():
            names = [f"{signal.name} [{signal.unit}]" for signal in topic.signals]
            look = layout.lines(names, layout.PALETTE[np.arange(len(names)) % len(layout.PALETTE)])
            self.log(self._at(topic.path), look)
        scenario = info.scenario_toml.decode(errors="replace")
        fence = "`" * max(3, 1 + max((len(run) for run in re.findall("`+", scenario)), default=0))
        text = f"{fence}toml\n{scenario}\n{fence}"
        self.log(self._at(layout.SCENARIO), rr.TextDocument(text, media_type="text/markdown"))
        self.log(self._at(layout.BENCH), rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        for body, kind in sorted({(geom.body, geom.kind) for geom in info.geoms}):
            geoms = [geom for geom in info.geoms if (geom.body, geom.kind) == (body, kind)]
            for number, archetype in enumerate(rerun_scene.archetypes(kind, geoms)):
                self.log(f"{self._bodies[body]}/{kind}_{number}", archetype)
        for axis in self._axes:
            axis.send_static()

    def _send_events(self, events: Sequence[Event]) -> None:
        if not events:
            return
        ticks = np.array([event.tick for event in events])
        text = [f"{event.source}: {event.message}" for event in events]
        levels = [LEVELS[event.level] for event in events]
        self._said |= {line: layout.LEVEL_COLORS[event.level] for line, event in zip(text, events, strict=True)}
        self.send(self._at(EVENTS_TOPIC), ticks, rr.TextLog.columns(text=text, level=levels))
        for axis in self._axes:
            self.send(axis.at(layout.EVENT_LANE), ticks, rr.StateChange.columns(state=text))

    def _send_pending(self) -> None:
        """Send all that was collected, and wait until it is written: the file sets the pace."""
        if not self._pending_ticks:
            return
        batch = _Batch(self._parts, self.topics)
        for path in self.topics:
            self.send_scalars(self._at(path), *batch.topic(path))
        for axis in self._axes:
            axis.send_samples(batch)
        if self._poses:
            pose_ticks, poses = np.concatenate(self._pose_ticks), np.concatenate(self._poses)
            if len(pose_ticks):
                self._send_poses(pose_ticks, poses)
                for axis in self._axes:
                    axis.send_arrows(pose_ticks, poses, batch)
        self.file.flush()
        self._parts = {path: [] for path in self.topics}
        self._pose_ticks.clear()
        self._poses.clear()
        self._pending_ticks = 0

    def send_scalars(self, entity: str, ticks: Ticks, rows: Array) -> None:
        """Send the curves of an entity, shape (ticks, curves)."""
        if len(ticks):
            self.send(entity, ticks, rr.Scalars.columns(scalars=np.ascontiguousarray(rows)))

    def _send_poses(self, ticks: Ticks, poses: Array) -> None:
        for number, entity in enumerate(self._bodies[1:], start=1):
            translation, quaternion = poses[:, number, :3], poses[:, number, [4, 5, 6, 3]]  # w x y z -> x y z w
            self.send(entity, ticks, rr.Transform3D.columns(translation=translation, quaternion=quaternion))


class _Axis:
    """Sends what is shown of one axis of a run: plots, lanes, torque over displacement, forces."""

    def __init__(self, run: _Run, prefix: str, axis: str, bodies: Sequence[str], parameters: Mapping[str, Any]):
        self._run, self._axis = run, axis
        self._root = layout.root(prefix, axis)
        column, rod_end = (f"{axis}/{name}" if axis else name for name in ("column", "rod_end"))
        self._bodies = [bodies.index(name) for name in (column, rod_end) if name in bodies]
        self._has_arrows = column in bodies
        self._limits = _travel_limits(parameters, axis)
        self._grip_height = _grip_height(parameters, axis)
        self._loop: list[Array] = []  # time [tick], angle [rad], torque [N·m], powered
        self._states: dict[str, str] = {}
        clock = run.clock
        self._loop_ticks = clock.plc_ticks * max(1, round(LOOP_S / clock.plc_s))

    def at(self, entity: str) -> str:
        """The entity's path in the file."""
        return f"{self._root}/{entity.lstrip('/')}"

    def _named(self, topic: str, name: str) -> Named:
        return f"/{self._axis}{topic}" if self._axis else topic, name

    def _curves(self, plot: layout.Plot) -> list[layout.Curve]:
        """The curves of a plot whose signals were recorded."""
        batch = _Batch({}, self._run.topics)
        return [curve for curve in plot.curves if batch.has(self._named(*curve[:2]))]

    def send_static(self) -> None:
        """Send how things look."""
        for plot in layout.PLOTS:
            if curves := self._curves(plot):
                self._run.log(self.at(plot.entity), layout.lines([c[2] for c in curves], [c[3] for c in curves]))
        if self._has_arrows:
            arrows = rr.Arrows3D.from_fields(
                colors=[palette.PILOT, palette.MEASURED][: len(self._bodies)], radii=[0.006],
                labels=list(ARROWS)[: len(self._bodies)], show_labels=False,
            )  # fmt: skip
            self._run.log(self.at(layout.FORCES), arrows)
        for lane, states in (
            (layout.DRIVE_LANE, layout.DRIVE_STATES),
            (layout.HAND_LANE, layout.HAND_STATES),
            (layout.TRAVEL_LANE, layout.TRAVEL_STATES),
        ):
            look = rr.StateConfiguration(values=list(states), colors=list(states.values()))
            self._run.log(self.at(lane), look)

    def send_samples(self, batch: _Batch) -> None:
        """Send plots and lanes, and keep what is drawn over displacement."""
        for plot in layout.PLOTS:
            ticks, rows = batch.columns(*(self._named(*curve[:2]) for curve in self._curves(plot)))
            self._run.send_scalars(self.at(plot.entity), ticks, rows * plot.scale)
        ticks, voltage = batch.columns(self._named("/drive", "voltage"))
        powered = _powered(voltage[:, 0] != 0.0)
        self._send_states(layout.DRIVE_LANE, ticks, np.where(powered, "power on", "power off"))
        ticks, squeeze = batch.columns(self._named("/pilot", "squeeze"))
        self._send_states(layout.HAND_LANE, ticks, _hand_states(squeeze[:, 0]))
        if self._limits:
            ticks, angle = batch.columns(self._named("/column", "angle"))
            beyond = np.digitize(np.abs(angle[:, 0]), self._limits)
            self._send_states(layout.TRAVEL_LANE, ticks, np.array(list(layout.TRAVEL_STATES))[beyond])
        loop = [self._named(*s) for s in (("/column", "angle"), ("/load_cell", "torque"), ("/drive", "voltage"))]
        ticks, rows = batch.columns(*loop[: 3 if batch.has(loop[2]) else 2])
        powered = _powered(rows[:, 2] != 0.0) if rows.shape[1] > 2 else np.ones(len(rows), np.bool_)
        kept = ticks % self._loop_ticks == 0
        self._loop.append(np.stack([ticks, rows[:, 0], rows[:, 1], powered], axis=1)[kept])

    def send_arrows(self, ticks: Ticks, poses: Array, batch: _Batch) -> None:
        """Send the forces on the column: the hand's, and the rod's if there is one."""
        if not self._has_arrows:
            return
        wanted = [self._named("/pilot", "hand_force"), self._named("/load_cell", "force")]
        sampled, forces = batch.columns(*wanted)
        both, at, of = np.intersect1d(ticks, sampled, return_indices=True)
        if len(both):
            column, *last = (poses[at, body] for body in self._bodies)
            count = len(self._bodies)
            rod_end = last[0] if last else None
            origins, vectors = force_arrows(column, rod_end, forces[of, 0], forces[of, 1], self._grip_height)
            arrows = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
            self._run.send(self.at(layout.FORCES), both, arrows.partition(np.full(len(both), count)))

    def _send_states(self, lane: str, ticks: Ticks, states: NDArray[np.str_]) -> None:
        """Send the changes of a lane's state."""
        if not len(ticks):
            return
        before = np.append(self._states.get(lane, ""), states[:-1])
        changed = states != before
        self._states[lane] = str(states[-1])
        if changed.any():
            changes = rr.StateChange.columns(state=states[changed].tolist())
            self._run.send(self.at(lane), ticks[changed], changes)

    def send_loop(self) -> None:
        """Torque over displacement: the whole curve, a dot that moves, and axes; y points down in Rerun's 2D views."""
        loop = np.concatenate(self._loop) if self._loop else np.zeros((0, 4))
        if len(loop) < 2:
            return
        angle, torque = loop[:, 1] * layout.DEGREES, loop[:, 2]
        right, top = _round_up(float(np.abs(angle).max())), _round_up(float(np.abs(torque).max()))
        points = np.stack([1.5 * angle / right, -torque / top], axis=1)
        at = self.at(layout.TORQUE_OVER_ANGLE)
        cuts = np.flatnonzero(np.diff(loop[:, 3])) + 1
        strips = np.split(points, cuts)
        colors = [palette.MEASURED if part[0] else palette.MODEL for part in np.split(loop[:, 3], cuts)]
        axes = [[(-1.5, 0.0), (1.5, 0.0)], [(0.0, -1.0), (0.0, 1.0)]]
        log = self._run.log
        log(f"{at}/axes", rr.LineStrips2D(axes, colors=[(90, 98, 106)], radii=rr.Radius.ui_points(0.75)))
        log(f"{at}/curve", rr.LineStrips2D(strips, colors=colors, radii=rr.Radius.ui_points(1.0)))
        marks = [(-1.5, 0.0), (1.5, 0.0), (0.0, -1.0), (0.0, 1.0)]
        labels = [f"−{right:g}°", f"{right:g}°", f"{top:g} N·m", f"−{top:g} N·m"]
        look = {"colors": [palette.QUIET], "radii": rr.Radius.ui_points(1.5)}
        log(f"{at}/marks", rr.Points2D(marks, labels=labels, show_labels=True, **look))
        log(f"{at}/now", rr.Points2D.from_fields(colors=[(255, 255, 255)], radii=rr.Radius.ui_points(5.0)))
        every = self._loop_ticks * max(1, round(self._run.clock.pose_ticks / self._loop_ticks))
        shown = loop[:, 0] % every == 0
        self._run.send(f"{at}/now", loop[shown, 0].astype(np.int64), rr.Points2D.columns(positions=points[shown]))


def _powered(driven: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether the power stage is on: its voltage is exactly 0 when it is off, and crosses 0 when it is on."""
    return np.asarray(driven | np.append(driven[1:], False) | np.append(False, driven[:-1]))


def _hand_states(squeeze: Array) -> NDArray[np.str_]:
    names = list(layout.HAND_STATES)
    return np.array(names)[np.digitize(squeeze, [0.0, 0.1, 0.6])]


def _travel_limits(parameters: Mapping[str, Any], axis: str) -> list[float]:
    """Column angles [rad], at the start of the run, where the feel model's first limit begins and the switches open.

    None of parameters that do not say so, as those of a file may.
    """
    try:
        own = parameters.get(axis, parameters)
        angles = sorted([float(own["feel"]["aft_limit"]["angle"]), float(own["column"]["switch_angle"])])
    except (KeyError, TypeError, ValueError, OverflowError):
        return []
    return angles if np.isfinite(angles).all() else []


def _grip_height(parameters: Mapping[str, Any], axis: str) -> float:
    """Height of the grip above the column's axis [m]; the thesis's, of parameters that do not say so."""
    try:
        height = float(parameters.get(axis, parameters)["column"]["grip_height"])
    except (KeyError, TypeError, ValueError, OverflowError):
        return GRIP_HEIGHT
    return height if np.isfinite(height) else GRIP_HEIGHT


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
