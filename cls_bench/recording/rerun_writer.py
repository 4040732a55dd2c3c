"""Writes runs for the Rerun viewer: a view of the recording, not its master."""

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cls_bench.geometry import ARROWS, force_arrows
from cls_bench.recording import rerun_layout as layout
from cls_bench.recording import rerun_scene
from cls_bench.recording.mcap_reader import Recording
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import EVENTS_TOPIC, PLC_TICKS, POSE_TICKS, TICK_NS, TOPIC, TOPICS, Block, Event

Array = NDArray[np.float64]
Ticks = NDArray[np.int64]

VIEW_TICKS = PLC_TICKS
"""Samples are drawn at the PLC's rate, 2.5 kHz: rows whose tick is divisible by this."""

LOOP_TICKS = 40
"""Torque over displacement is drawn at 500 Hz."""

BATCH_TICKS = 40_000
"""Ticks that are sent at once (2 s): fewer and larger chunks make the viewer quicker."""

LEVELS = {"info": rr.TextLogLevel.INFO, "warning": rr.TextLogLevel.WARN, "error": rr.TextLogLevel.ERROR}
"""Log levels of :class:`cls_bench.signals.Event` in Rerun's terms."""

APPLICATION = "cls-bench"


class RerunRecorder:
    """An .rrd file with all topics at 2.5 kHz, events, the moving bench and a layout that shows them.

    Of topics that are sampled faster, the rows whose tick is divisible by :data:`VIEW_TICKS` are kept: analyses read
    the MCAP file. Data go to the file every 2 s of simulated time; torque over displacement, whose scales are known at
    the end, when it is finished. Raises :class:`OSError` when the file cannot be created or written.
    """

    def __init__(self, path: Path, info: RunInfo):
        with _os_errors():
            self._stream = rr.RecordingStream(APPLICATION)
            self._stream.save(path, default_blueprint=layout.blueprint([""], [info.scenario_name]))
            self._stream.send_recording_name(info.scenario_name)
            self._stream.send_property("run", _run_properties(info))
            self._run = _Run(self._stream, info, "")
            self._stream.flush()

    def write(self, block: Block) -> None:
        """Take over ``block``. Raises :class:`OSError` when the file cannot be written."""
        with _os_errors():
            self._run.write(block)

    def finish(self, status: str) -> None:
        """Write what is pending and ``status``, and close the file. Raises :class:`OSError`."""
        with _os_errors():
            self._run.finish()
            self._stream.send_property("result", rr.AnyValues(status=status))
            self._stream.flush()
            self._stream.disconnect()

    def close(self) -> None:
        """Close the file as it is; what was written stays readable. Never raises for a full disk."""
        with suppress(RuntimeError):
            self._stream.disconnect()


def write_rrd(recordings: Sequence[Recording], path: Path) -> None:
    """Write the .rrd of one recording, or of several side by side on one timeline. Raises :class:`OSError`.

    The first recording's entities are at the root; of several, each run's are below ``run_1``, ``run_2``, …
    """
    if len(recordings) == 1:
        recorder = RerunRecorder(path, recordings[0].run_info())
        for block in recordings[0].blocks():
            recorder.write(block)
        recorder.finish(recordings[0].status)
        return
    prefixes = [f"/run_{number}" for number in range(1, len(recordings) + 1)]
    titles = [recording.path.stem for recording in recordings]
    with _os_errors():
        stream = rr.RecordingStream(APPLICATION)
        stream.save(path, default_blueprint=layout.blueprint(prefixes, titles))
        stream.send_recording_name(" and ".join(titles))
        for prefix, recording in zip(prefixes, recordings, strict=True):
            run = _Run(stream, recording.run_info(), prefix)
            for block in recording.blocks():
                run.write(block)
            run.finish()
        stream.flush()
        stream.disconnect()


class _Run:
    """Sends one run's data to a stream, its entities below ``prefix``."""

    def __init__(self, stream: rr.RecordingStream, info: RunInfo, prefix: str):
        self._stream = stream
        self._prefix = prefix
        names = [name or f"body {i}" for i, name in enumerate(info.body_names)]
        self._bodies = [f"{prefix}/" + rr.new_entity_path([layout.BENCH, name]).lstrip("/") for name in names]
        arrows_on = ("column", "rod_end")
        self._arrow_bodies = [names.index(name) for name in arrows_on] if set(arrows_on) <= set(names) else None
        self._ticks: list[Ticks] = []
        self._rows: list[Array] = []
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
        columns = []
        for topic, rows in block:
            skipped = -block.first_tick % VIEW_TICKS // topic.ticks
            columns.append(rows[skipped :: VIEW_TICKS // topic.ticks])
        self._ticks.append(block.row_ticks(VIEW_TICKS))
        self._rows.append(np.concatenate(columns, axis=1))
        self._pose_ticks.append(block.row_ticks(POSE_TICKS))
        self._poses.append(block.poses)
        self._pending_ticks += block.ticks
        self._send_events(block.events)
        if self._pending_ticks >= BATCH_TICKS:
            self._send_pending()

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
        for topic in TOPICS:
            names = [f"{signal.name} [{signal.unit}]" for signal in topic.signals]
            self._log(topic.path, layout.lines(names, layout.PALETTE[np.arange(len(names)) % len(layout.PALETTE)]))
        for plot in layout.PLOTS:
            self._log(plot.entity, layout.lines([c[2] for c in plot.curves], [c[3] for c in plot.curves]))
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

    def _send_pending(self) -> None:
        """Send all that was collected, and wait until it is written: the file sets the pace."""
        if not self._ticks:
            return
        ticks, rows = np.concatenate(self._ticks), np.concatenate(self._rows)
        if len(ticks):
            self._send_samples(ticks, rows)
        pose_ticks, poses = np.concatenate(self._pose_ticks), np.concatenate(self._poses)
        if len(pose_ticks):
            self._send_poses(pose_ticks, poses, rows[np.isin(ticks, pose_ticks)])
        self._stream.flush()
        for pending in (self._ticks, self._rows, self._pose_ticks, self._poses):
            pending.clear()
        self._pending_ticks = 0

    def _send_samples(self, ticks: Ticks, rows: Array) -> None:
        time = [_time(ticks)]
        for topic in TOPICS:
            first = layout.FIRST_COLUMN[topic.path]
            part = np.ascontiguousarray(rows[:, first : first + len(topic.signals)])
            self._stream.send_columns(self._at(topic.path), time, rr.Scalars.columns(scalars=part))
        for plot in layout.PLOTS:
            scaled = rows[:, plot.columns] * plot.scale
            self._stream.send_columns(self._at(plot.entity), time, rr.Scalars.columns(scalars=scaled))
        powered = _powered(_column(rows, "/drive", "voltage") != 0.0)
        self._send_states(layout.DRIVE_LANE, ticks, np.where(powered, "power on", "power off"))
        self._send_states(layout.HAND_LANE, ticks, _hand_states(_column(rows, "/pilot", "squeeze")))
        if self._limits:
            beyond = np.digitize(np.abs(_column(rows, "/column", "angle")), self._limits)
            self._send_states(layout.TRAVEL_LANE, ticks, np.array(list(layout.TRAVEL_STATES))[beyond])
        kept = ticks % LOOP_TICKS == 0
        angle, torque = _column(rows, "/column", "angle")[kept], _column(rows, "/load_cell", "torque")[kept]
        self._loop.append(np.stack([ticks[kept], angle, torque, powered[kept]], axis=1))

    def _send_poses(self, ticks: Ticks, poses: Array, rows: Array) -> None:
        time = [_time(ticks)]
        for number, entity in enumerate(self._bodies[1:], start=1):
            translation, quaternion = poses[:, number, :3], poses[:, number, [4, 5, 6, 3]]  # w x y z -> x y z w
            transform = rr.Transform3D.columns(translation=translation, quaternion=quaternion)
            self._stream.send_columns(entity, time, transform)
        if self._arrow_bodies:
            column, rod_end = (poses[:, number] for number in self._arrow_bodies)
            hand_force, rod_force = _column(rows, "/pilot", "hand_force"), _column(rows, "/load_cell", "force")
            origins, vectors = force_arrows(column, rod_end, hand_force, rod_force)
            arrows = rr.Arrows3D.columns(origins=origins.reshape(-1, 3), vectors=vectors.reshape(-1, 3))
            pairs = arrows.partition(np.full(len(ticks), len(ARROWS)))
            self._stream.send_columns(self._at(layout.FORCES), time, pairs)

    def _send_states(self, lane: str, ticks: Ticks, states: NDArray[np.str_]) -> None:
        """Send the changes of a lane's state."""
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


def _column(rows: Array, topic: str, signal: str) -> Array:
    return rows[:, layout.FIRST_COLUMN[topic] + TOPIC[topic].names.index(signal)]


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


@contextmanager
def _os_errors() -> Iterator[None]:
    """Rerun raises RuntimeError for all that the system refuses; its text ends in the number of the error."""
    try:
        yield
    except RuntimeError as error:
        number = re.search(r"\(os error (\d+)\)", str(error))
        if number is None:
            raise
        raise OSError(int(number[1]), os.strerror(int(number[1]))) from error
