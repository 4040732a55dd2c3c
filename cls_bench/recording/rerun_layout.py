"""What the Rerun viewer shows of a run, and where: curves, lanes and the arrangement of the views."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from cls_bench.recording.palette import (
    MEASURED,
    MODEL,
    MOTOR,
    PILOT,
    QUIET,
    STAGE1,
    STAGE2,
    STAGE3,
    STAGES,
    Color,
)
from cls_bench.signals import EVENTS_TOPIC, Topic, axes_of

TIMELINE = "sim_time"
"""Timeline of all data: time since the start of the run."""

PALETTE = np.array([MEASURED, PILOT, MOTOR, STAGE1, STAGE2, MODEL, STAGE3, QUIET], np.uint8)
"""Colours of the raw topics' signals, in column order."""

BENCH = "bench"
FORCES = "bench/forces"
SCENARIO = "scenario"
TORQUE_OVER_ANGLE = "torque_over_angle"
LANES = "state"
DRIVE_LANE, HAND_LANE, TRAVEL_LANE = f"{LANES}/drive", f"{LANES}/hand", f"{LANES}/travel"
EVENT_LANE = f"{LANES}/last_event"

DRIVE_STATES = {"power off": MODEL, "power on": MEASURED}
HAND_STATES = {"let go": (90, 98, 106), "loose": (148, 118, 62), "firm": (196, 140, 30), "tight": (230, 159, 0)}
TRAVEL_STATES = {"free": (70, 90, 84), "model's limit": STAGE2, "limit switch": (213, 64, 50)}
LEVEL_COLORS = {"info": (90, 98, 106), "warning": STAGE2, "error": (213, 64, 50)}
"""States in the lanes and their colours."""

_EYE, _LOOK_TARGET = (0.36, -0.74, 0.69), (-0.09, 0.03, 0.365)  # [m]

DEGREES = 180.0 / np.pi
RPM = 30.0 / np.pi


Curve = tuple[str, str, str, Color]
"""Topic, signal, name in the legend, colour."""


@dataclass(frozen=True)
class Plot:
    """A plot of signals from several topics of an axis; ``scale`` converts from their SI unit to that of the title."""

    entity: str
    title: str
    curves: tuple[Curve, ...]
    """of those that were recorded, what is drawn"""
    scale: float = 1.0


def _stages(what: str) -> tuple[Curve, ...]:
    named = enumerate(STAGES, start=1)
    return tuple(("/gearbox", f"stage{n}_{what}", f"stage {n} [N·m]", color) for n, color in named)


TORQUE = Plot("/plots/torque", "Torque at the column [N·m]", (
    ("/column", "torque", "pilot [N·m]", PILOT), ("/load_cell", "torque", "load cell [N·m]", MEASURED),
))  # fmt: skip
ANGLE = Plot("/plots/angle_deg", "Column angle, set against measured [°]", (
    ("/column", "angle", "column [°]", MEASURED), ("/feel", "angle", "feel model [°]", MODEL),
    ("/surface", "deflection", "surface [°]", MOTOR),
), DEGREES)  # fmt: skip
MOTOR_TORQUE = Plot("/plots/motor_torque", "Motor torque [N·m]", (
    ("/drive", "torque", "air gap [N·m]", MOTOR), ("/drive", "torque_command", "command [N·m]", MODEL),
))  # fmt: skip
MOTOR_SPEED = Plot("/plots/motor_speed_rpm", "Motor speed [1/min]", (
    ("/drive", "velocity", "measured [1/min]", MEASURED), ("/drive", "set_velocity", "set [1/min]", MODEL),
), RPM)  # fmt: skip
MESH_TORQUE = Plot("/plots/mesh_torque", "Torque through the meshes [N·m]", _stages("torque"))
MESH_FRICTION = Plot("/plots/mesh_friction", "Friction at the stages' inputs [N·m]", _stages("friction"))
PLOTS = (TORQUE, ANGLE, MOTOR_TORQUE, MOTOR_SPEED, MESH_TORQUE, MESH_FRICTION)


def lines(names: Sequence[str], colors: NDArray[np.uint8] | Sequence[Color]) -> rr.SeriesLines:
    """Names and colours of the curves of an entity; zoomed out they keep their peaks, which averages would hide."""
    policy = rr.components.AggregationPolicy.MinMax
    return rr.SeriesLines(names=names, colors=np.asarray(colors, np.uint8), aggregation_policy=policy)


class Shown(NamedTuple):
    """A run as the viewer is to show it."""

    prefix: str
    """root of its entities"""
    title: str
    topics: Sequence[Topic]


def axes(topics: Sequence[Topic]) -> tuple[str, ...]:
    """The axes of a run, one of no name if there is nothing to show either."""
    return axes_of(topics) or ("",)


def root(prefix: str, axis: str) -> str:
    """Root of the entities of an axis, in a run whose own root is ``prefix``."""
    return f"{prefix}/{axis}" if axis else prefix


def blueprint(shown: Sequence[Shown]) -> rrb.Blueprint:
    """The arrangement: bench and torque over displacement on the left, the curves on the right; of several runs, a
    column each. The axes of a run are tabs.
    """
    linked = rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    runs = [_one(run, linked) if len(shown) == 1 else _narrow(run, linked) for run in shown]
    return rrb.Blueprint(
        runs[0] if len(runs) == 1 else rrb.Horizontal(*runs),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
    )


def _tabs(views: Sequence[rrb.View | rrb.Container]) -> rrb.View | rrb.Container:
    """One view as it is, several as tabs."""
    return views[0] if len(views) == 1 else rrb.Tabs(*views)


def _one(run: Shown, linked: rrb.TimeAxis) -> rrb.Container:
    names = axes(run.topics)
    loops = [_torque_over_angle(root(run.prefix, axis), axis) for axis in names]
    left = rrb.Vertical(_bench(run.prefix), _tabs(loops), row_shares=[3, 2])
    texts = _texts(run.prefix)
    if len(names) == 1:
        views, shares = _curves(run, names[0], linked)
        right = rrb.Vertical(*views, texts, row_shares=[*shares, 1.4])
    else:
        groups = []
        for axis in names:
            views, shares = _curves(run, axis, linked)
            groups.append(rrb.Vertical(*views, row_shares=shares, name=axis))
        right = rrb.Vertical(_tabs(groups), texts, row_shares=[11, 1.4])
    return rrb.Horizontal(left, right, column_shares=[2, 3])


def _curves(run: Shown, axis: str, linked: rrb.TimeAxis) -> tuple[list[rrb.View | rrb.Container], list[float]]:
    """The curves and lanes of an axis, and their shares of the height."""
    place = root(run.prefix, axis)

    def plots(name: str, *plots: Plot) -> list[rrb.Container]:
        there = {topic.path for topic in run.topics}
        found = [plot for plot in plots if any(f"{root('', axis)}{topic}" in there for topic, *_ in plot.curves)]
        return [rrb.Horizontal(*(_plot(place, plot, linked) for plot in found), name=name)] if found else []

    details = [*plots("Drive", MOTOR_TORQUE, MOTOR_SPEED), *plots("Gearbox", MESH_TORQUE, MESH_FRICTION)]
    views: list[rrb.View | rrb.Container] = [_plot(place, ANGLE, linked), _plot(place, TORQUE, linked)]
    views += [rrb.Tabs(*details)] if details else []
    return [*views, _lanes(place, linked)], [2.5, 2.5, *([2.7] if details else []), 3.2]


def _narrow(run: Shown, linked: rrb.TimeAxis) -> rrb.Container:
    groups = []
    names = axes(run.topics)
    for axis in names:
        place = root(run.prefix, axis)
        groups.append([
            (_torque_over_angle(place, axis), 3.0), (_plot(place, ANGLE, linked), 2.0),
            (_plot(place, TORQUE, linked), 2.0), (_lanes(place, linked), 1.5),
        ])  # fmt: skip
    bench = _bench(run.prefix, f"Bench: {run.title}")
    if len(groups) == 1:
        views, shares = zip(*groups[0], strict=True)
        return rrb.Vertical(bench, *views, row_shares=[3, *shares], name=run.title)
    tabs = [
        rrb.Vertical(*(view for view, _ in group), row_shares=[share for _, share in group], name=axis)
        for axis, group in zip(names, groups, strict=True)
    ]
    return rrb.Vertical(bench, _tabs(tabs), row_shares=[3, 8.5], name=run.title)


def _bench(prefix: str, name: str = "Bench") -> rrb.View:
    return rrb.Spatial3DView(
        origin=f"{prefix}/{BENCH}",
        name=name,
        eye_controls=rrb.EyeControls3D(position=_EYE, look_target=_LOOK_TARGET, eye_up=(0.0, 0.0, 1.0)),
        line_grid=rrb.LineGrid3D(visible=False),
        background=(214, 219, 225),
    )


def _torque_over_angle(prefix: str, axis: str) -> rrb.View:
    return rrb.Spatial2DView(
        origin=f"{prefix}/{TORQUE_OVER_ANGLE}",
        name=f"{axis + ': t' if axis else 'T'}orque over displacement (blue: power on, orange: off)",
        background=(20, 22, 25),
        visual_bounds=rrb.VisualBounds2D(x_range=(-1.75, 1.75), y_range=(-1.2, 1.25)),
    )


def _plot(prefix: str, plot: Plot, linked: rrb.TimeAxis) -> rrb.View:
    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
    return rrb.TimeSeriesView(origin=f"{prefix}{plot.entity}", name=plot.title, axis_x=linked, plot_legend=legend)


def _lanes(prefix: str, linked: rrb.TimeAxis) -> rrb.View:
    return rrb.StateTimelineView(origin=f"{prefix}/{LANES}", name="Power, hand, travel, events", time_view=linked)


def _texts(prefix: str) -> rrb.Container:
    return rrb.Tabs(
        rrb.TextLogView(
            origin=f"{prefix}{EVENTS_TOPIC}",
            name="Events",
            columns=rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"]),
        ),
        rrb.TextDocumentView(origin=f"{prefix}/{SCENARIO}", name="Scenario"),
    )
