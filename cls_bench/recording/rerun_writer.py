"""Writes a run for the Rerun viewer: a view of the recording, not its master."""

import itertools
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from cls_bench.geometry import Geom, along_z, plane_box
from cls_bench.recording.run_info import RunInfo
from cls_bench.signals import (
    EVENTS_TOPIC,
    PLC_TICKS,
    POSE_TICKS,
    TICK_NS,
    TOPIC,
    TOPICS,
    Block,
    Event,
)

TIMELINE = "sim_time"
"""Timeline of all data: time since the start of the run."""

VIEW_TICKS = PLC_TICKS
"""Samples are drawn at the PLC's rate, 2.5 kHz: rows whose tick is divisible by this."""

BATCH_TICKS = 40_000
"""Ticks that are sent at once (2 s): fewer and larger chunks make the viewer quicker."""

COLORS = np.array([
    (86, 180, 233), (230, 159, 0), (0, 158, 115), (204, 121, 167), (240, 228, 66), (213, 94, 0), (0, 114, 178),
    (187, 187, 187),
], np.uint8)  # fmt: skip
"""Okabe and Ito's colours, which colour-blind people can tell apart."""

LEVELS = {"info": rr.TextLogLevel.INFO, "warning": rr.TextLogLevel.WARN, "error": rr.TextLogLevel.ERROR}
"""Log levels of :class:`cls_bench.signals.Event` in Rerun's terms."""

_BENCH = "bench"
_SCENARIO = "scenario"
_EYE, _LOOK_TARGET = (0.36, -0.80, 0.62), (-0.09, 0.05, 0.34)  # [m]


@dataclass(frozen=True)
class Plot:
    """A plot of signals from several topics; ``scale`` converts from their SI unit to that of the title."""

    entity: str
    title: str
    curves: tuple[tuple[str, str, str], ...]
    """topic, signal, name in the legend"""
    scale: float = 1.0

    @property
    def columns(self) -> list[int]:
        """Columns of the signals among all topics' signals."""
        return [_FIRST_COLUMN[topic] + TOPIC[topic].names.index(signal) for topic, signal, _ in self.curves]


_FIRST_COLUMN = dict(
    zip(TOPIC, itertools.accumulate((len(topic.signals) for topic in TOPICS), initial=0), strict=False)
)

PLOTS = (
    Plot(
        "/plots/torque",
        "Torque at the column [N·m]",
        (("/column", "torque", "pilot [N·m]"), ("/load_cell", "torque", "load cell [N·m]")),
    ),
    Plot(
        "/plots/angle_deg",
        "Column angle [°]",
        (("/column", "angle", "column [°]"), ("/feel", "angle", "feel model [°]")),
        scale=180.0 / np.pi,
    ),
    Plot(
        "/plots/drive",
        "Motor torque [N·m]",
        (("/drive", "torque_command", "command [N·m]"), ("/drive", "torque", "air gap [N·m]")),
    ),
)


class RerunRecorder:
    """An .rrd file with all topics at 2.5 kHz, events, the moving bench and a layout that shows them.

    Of topics that are sampled faster, the rows whose tick is divisible by :data:`VIEW_TICKS` are kept: analyses read
    the MCAP file. Data go to the file every 2 s of simulated time. Raises :class:`OSError` when the file cannot be
    created or written.
    """

    def __init__(self, path: Path, info: RunInfo):
        self._bodies = [rr.new_entity_path([_BENCH, name or f"body {i}"]) for i, name in enumerate(info.body_names)]
        self._ticks: list[NDArray[np.int64]] = []
        self._rows: list[NDArray[np.float64]] = []
        self._pose_ticks: list[NDArray[np.int64]] = []
        self._poses: list[NDArray[np.float64]] = []
        self._pending_ticks = 0
        with _os_errors():
            self._stream = rr.RecordingStream("cls-bench")
            self._stream.save(path, default_blueprint=_blueprint())
            self._stream.send_recording_name(info.scenario_name)
            self._stream.send_property("run", _run_properties(info))
            self._send_static(info)
            self._stream.flush()

    def write(self, block: Block) -> None:
        """Take over ``block``. Raises :class:`OSError` when the file cannot be written."""
        ticks = block.row_ticks(VIEW_TICKS)
        columns = []
        for topic, rows in block:
            skipped = -block.first_tick % VIEW_TICKS // topic.ticks
            columns.append(rows[skipped :: VIEW_TICKS // topic.ticks])
        self._ticks.append(ticks)
        self._rows.append(np.concatenate(columns, axis=1))
        self._pose_ticks.append(block.row_ticks(POSE_TICKS))
        self._poses.append(block.poses)
        self._pending_ticks += block.ticks
        with _os_errors():
            self._send_events(block.events)
            if self._pending_ticks >= BATCH_TICKS:
                self._send_pending()

    def finish(self, status: str) -> None:
        """Write what is pending and ``status``, and close the file. Raises :class:`OSError`."""
        with _os_errors():
            self._send_pending()
            self._stream.send_property("result", rr.AnyValues(status=status))
            self._stream.flush()
            self._stream.disconnect()

    def close(self) -> None:
        """Close the file as it is; what was written stays readable. Never raises for a full disk."""
        with suppress(RuntimeError):
            self._stream.disconnect()

    def _send_static(self, info: RunInfo) -> None:
        stream = self._stream
        for topic in TOPICS:
            names = [f"{signal.name} [{signal.unit}]" for signal in topic.signals]
            stream.log(topic.path, _lines(names), static=True)
        for plot in PLOTS:
            stream.log(plot.entity, _lines([name for _, _, name in plot.curves]), static=True)
        scenario = info.scenario_toml.decode(errors="replace")
        stream.log(_SCENARIO, rr.TextDocument(f"```toml\n{scenario}\n```", media_type="text/markdown"), static=True)
        stream.log(_BENCH, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for body, kind in sorted({(geom.body, geom.kind) for geom in info.geoms}):
            geoms = [geom for geom in info.geoms if (geom.body, geom.kind) == (body, kind)]
            for number, archetype in enumerate(_archetypes(kind, geoms)):
                stream.log(f"{self._bodies[body]}/{kind}_{number}", archetype, static=True)

    def _send_events(self, events: Sequence[Event]) -> None:
        if events:
            self._stream.send_columns(
                EVENTS_TOPIC,
                [_time(np.array([event.tick for event in events]))],
                rr.TextLog.columns(
                    text=[f"{event.source}: {event.message}" for event in events],
                    level=[LEVELS[event.level] for event in events],
                ),
            )

    def _send_pending(self) -> None:
        """Send all that was collected, and wait until it is written: the file sets the pace."""
        if not self._ticks:
            return
        ticks, rows = np.concatenate(self._ticks), np.concatenate(self._rows)
        if len(ticks):
            time = [_time(ticks)]
            for topic in TOPICS:
                first = _FIRST_COLUMN[topic.path]
                part = np.ascontiguousarray(rows[:, first : first + len(topic.signals)])
                self._stream.send_columns(topic.path, time, rr.Scalars.columns(scalars=part))
            for plot in PLOTS:
                scaled = rows[:, plot.columns] * plot.scale
                self._stream.send_columns(plot.entity, time, rr.Scalars.columns(scalars=scaled))
        pose_ticks, poses = np.concatenate(self._pose_ticks), np.concatenate(self._poses)
        if len(pose_ticks):
            time = [_time(pose_ticks)]
            for number, entity in enumerate(self._bodies[1:], start=1):
                translation, quaternion = poses[:, number, :3], poses[:, number, [4, 5, 6, 3]]  # w x y z -> x y z w
                transform = rr.Transform3D.columns(translation=translation, quaternion=quaternion)
                self._stream.send_columns(entity, time, transform)
        self._stream.flush()
        for pending in (self._ticks, self._rows, self._pose_ticks, self._poses):
            pending.clear()
        self._pending_ticks = 0


def _time(ticks: NDArray[np.int64]) -> rr.TimeColumn:
    # Integer nanoseconds: float seconds would be off by one now and then.
    return rr.TimeColumn(TIMELINE, duration=(ticks * TICK_NS).astype("timedelta64[ns]"))


def _lines(names: Sequence[str]) -> rr.SeriesLines:
    return rr.SeriesLines(names=names, colors=COLORS[np.arange(len(names)) % len(COLORS)])


def _run_properties(info: RunInfo) -> rr.AnyValues:
    """The metadata, under names that Rerun takes for components."""
    values: dict[str, Any] = {re.sub(r"\W", "_", name): text for name, text in info.metadata.items()}
    return rr.AnyValues(**values)


def _archetypes(kind: str, geoms: Sequence[Geom]) -> list[rr.AsComponents]:
    """Shapes of one kind and body in Rerun's terms."""
    sizes = np.array([geom.size for geom in geoms])
    look: dict[str, Any] = {
        "quaternions": np.array([geom.quaternion for geom in geoms])[:, [1, 2, 3, 0]],
        "colors": np.round(255 * np.array([geom.rgba for geom in geoms])).astype(np.uint8),
    }
    solid = {**look, "fill_mode": rr.components.FillMode.Solid}
    centers = np.array([geom.position for geom in geoms])
    match kind:
        case "box":
            return [rr.Boxes3D(half_sizes=sizes, centers=centers, **solid)]
        case "plane":
            half_sizes, centers = (np.array(part) for part in zip(*map(plane_box, geoms), strict=True))
            return [rr.Boxes3D(half_sizes=half_sizes, centers=centers, **solid)]
        case "sphere":
            return [rr.Ellipsoids3D(radii=sizes[:, 0], centers=centers, **solid)]
        case "ellipsoid":
            return [rr.Ellipsoids3D(half_sizes=sizes, centers=centers, **solid)]
        case "cylinder":
            return [rr.Cylinders3D(lengths=2.0 * sizes[:, 1], radii=sizes[:, 0], centers=centers, **solid)]
        case "capsule":  # Rerun's start at the origin and point along z
            starts = np.array([along_z(geom, -geom.size[1]) for geom in geoms])
            return [rr.Capsules3D(lengths=2.0 * sizes[:, 1], radii=sizes[:, 0], translations=starts, **solid)]
        case "mesh":
            return [_mesh(geom) for geom in geoms]
        case _:
            raise ValueError(f"cannot draw a geom of kind {kind!r}")


def _mesh(geom: Geom) -> rr.Mesh3D:
    vertices = np.zeros((0, 3)) if geom.vertices is None else geom.vertices
    w, *xyz = geom.quaternion
    axis = np.array(xyz)
    doubled = 2.0 * np.cross(axis, vertices)
    turned = vertices + w * doubled + np.cross(axis, doubled)
    return rr.Mesh3D(vertex_positions=turned + geom.position, triangle_indices=geom.faces, albedo_factor=geom.rgba)


def _blueprint() -> rrb.Blueprint:
    """Bench and log on the left, the plots above each other on the right with one common time axis."""
    linked = rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    legend = rrb.PlotLegend(rrb.Corner2D.RightTop)
    bench = rrb.Spatial3DView(
        origin=_BENCH,
        name="Bench",
        eye_controls=rrb.EyeControls3D(position=_EYE, look_target=_LOOK_TARGET, eye_up=(0.0, 0.0, 1.0)),
        line_grid=rrb.LineGrid3D(spacing=0.1),
        background=(222, 226, 230),
    )
    log = rrb.Tabs(
        rrb.TextLogView(
            origin=EVENTS_TOPIC,
            name="Events",
            columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
        ),
        rrb.TextDocumentView(origin=_SCENARIO, name="Scenario"),
    )
    plots = [
        rrb.TimeSeriesView(origin=plot.entity, name=plot.title, axis_x=linked, plot_legend=legend) for plot in PLOTS
    ]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(bench, log, row_shares=[3, 1]), rrb.Vertical(*plots), column_shares=[2, 3]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
    )


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
