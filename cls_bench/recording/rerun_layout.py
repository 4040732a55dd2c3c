"""What the Rerun viewer shows of a run, and where: curves, lanes and the arrangement of the views."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from cls_bench.signals import EVENTS_TOPIC

TIMELINE = "sim_time"
"""Timeline of all data: time since the start of the run."""

Color = tuple[int, int, int]

PILOT: Color = (230, 159, 0)
MEASURED: Color = (86, 180, 233)
MODEL: Color = (255, 138, 76)
MOTOR: Color = (47, 199, 157)
STAGE1: Color = (204, 121, 167)
STAGE2: Color = (240, 228, 66)
QUIET: Color = (140, 148, 156)
"""Colours by meaning, as in the reports: Okabe and Ito's, which colour-blind people can tell apart."""

PALETTE = np.array([MEASURED, PILOT, MOTOR, STAGE1, STAGE2, MODEL, (0, 114, 178), QUIET], np.uint8)
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
    """A plot of signals from several topics; ``scale`` converts from their SI unit to that of the title."""

    entity: str
    title: str
    curves: tuple[Curve, ...]
    scale: float = 1.0


TORQUE = Plot("/plots/torque", "Torque at the column [N·m]", (
    ("/column", "torque", "pilot [N·m]", PILOT), ("/load_cell", "torque", "load cell [N·m]", MEASURED),
))  # fmt: skip
ANGLE = Plot("/plots/angle_deg", "Column angle, set against measured [°]", (
    ("/column", "angle", "column [°]", MEASURED), ("/feel", "angle", "feel model [°]", MODEL),
), DEGREES)  # fmt: skip
MOTOR_TORQUE = Plot("/plots/motor_torque", "Motor torque [N·m]", (
    ("/drive", "torque", "air gap [N·m]", MOTOR), ("/drive", "torque_command", "command [N·m]", MODEL),
))  # fmt: skip
MOTOR_SPEED = Plot("/plots/motor_speed_rpm", "Motor speed [1/min]", (
    ("/drive", "velocity", "measured [1/min]", MEASURED), ("/drive", "set_velocity", "set [1/min]", MODEL),
), RPM)  # fmt: skip
MESH_TORQUE = Plot("/plots/mesh_torque", "Torque through the meshes [N·m]", (
    ("/gearbox", "stage1_torque", "stage 1 [N·m]", STAGE1), ("/gearbox", "stage2_torque", "stage 2 [N·m]", STAGE2),
))  # fmt: skip
MESH_FRICTION = Plot("/plots/mesh_friction", "Friction at the stages' inputs [N·m]", (
    ("/gearbox", "stage1_friction", "stage 1 [N·m]", STAGE1), ("/gearbox", "stage2_friction", "stage 2 [N·m]", STAGE2),
))  # fmt: skip
PLOTS = (TORQUE, ANGLE, MOTOR_TORQUE, MOTOR_SPEED, MESH_TORQUE, MESH_FRICTION)


def lines(names: Sequence[str], colors: NDArray[np.uint8] | Sequence[Color]) -> rr.SeriesLines:
    """Names and colours of the curves of an entity; zoomed out they keep their peaks, which averages would hide."""
    policy = rr.components.AggregationPolicy.MinMax
    return rr.SeriesLines(names=names, colors=np.asarray(colors, np.uint8), aggregation_policy=policy)


def blueprint(prefixes: Sequence[str], titles: Sequence[str]) -> rrb.Blueprint:
    """The arrangement: bench and torque over displacement on the left, the curves on the right; of several runs, a
    column each. ``prefixes`` are the roots of the runs' entities.
    """
    linked = rrb.TimeAxis(link=rrb.components.LinkAxis.LinkToGlobal)
    runs = [_one(prefix, linked) if len(prefixes) == 1 else _narrow(prefix, title, linked)
            for prefix, title in zip(prefixes, titles, strict=True)]  # fmt: skip
    return rrb.Blueprint(
        runs[0] if len(runs) == 1 else rrb.Horizontal(*runs),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        auto_views=False,
    )


def _one(prefix: str, linked: rrb.TimeAxis) -> rrb.Container:
    def plot(plot: Plot) -> rrb.View:
        return _plot(prefix, plot, linked)

    left = rrb.Vertical(_bench(prefix), _torque_over_angle(prefix), row_shares=[3, 2])
    details = rrb.Tabs(
        rrb.Horizontal(plot(MOTOR_TORQUE), plot(MOTOR_SPEED), name="Drive"),
        rrb.Horizontal(plot(MESH_TORQUE), plot(MESH_FRICTION), name="Gearbox"),
    )
    right = rrb.Vertical(
        plot(ANGLE), plot(TORQUE), details, _lanes(prefix, linked), _texts(prefix), row_shares=[2.5, 2.5, 2.7, 3.2, 1.4]
    )
    return rrb.Horizontal(left, right, column_shares=[2, 3])


def _narrow(prefix: str, title: str, linked: rrb.TimeAxis) -> rrb.Container:
    views = [
        _bench(prefix, f"Bench: {title}"),
        _torque_over_angle(prefix),
        _plot(prefix, ANGLE, linked),
        _plot(prefix, TORQUE, linked),
    ]
    return rrb.Vertical(*views, _lanes(prefix, linked), row_shares=[3, 3, 2, 2, 1.5], name=title)


def _bench(prefix: str, name: str = "Bench") -> rrb.View:
    return rrb.Spatial3DView(
        origin=f"{prefix}/{BENCH}",
        name=name,
        eye_controls=rrb.EyeControls3D(position=_EYE, look_target=_LOOK_TARGET, eye_up=(0.0, 0.0, 1.0)),
        line_grid=rrb.LineGrid3D(visible=False),
        background=(214, 219, 225),
    )


def _torque_over_angle(prefix: str) -> rrb.View:
    return rrb.Spatial2DView(
        origin=f"{prefix}/{TORQUE_OVER_ANGLE}",
        name="Torque over displacement (blue: power on, orange: off)",
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
