"""A layout for Lichtblick and Foxglove: bench, torque over displacement, curves and events, a group for each axis."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from cls_bench.recording.mcap_writer import SCENE_TOPIC
from cls_bench.recording.palette import MEASURED, MODEL, MOTOR, PILOT, STAGES, Color, hexadecimal
from cls_bench.signals import EVENTS_TOPIC, Topic, axes_of

BENCH, EVENTS, DETAILS, AXES = "3D!bench", "RosOut!events", "Tab!details", "Tab!axes"
"""Panels that are there once."""

_Node = str | dict[str, Any]


class _Plot(NamedTuple):
    name: str
    title: str
    curves: tuple[tuple[str, str, Color], ...]
    """signal, name in the legend, colour"""
    over: str = ""
    """signal along x; time if empty"""


_STAGES = tuple(enumerate(STAGES, start=1))

_PLOTS = (
    _Plot("loop", "Load cell torque [N·m] over column angle [rad]", (("/load_cell.torque", "load cell", MEASURED),),
          over="/column.angle"),
    _Plot("angle", "Column angle [rad]",
          (("/column.angle", "column", MEASURED), ("/feel.angle", "feel model", MODEL),
           ("/surface.deflection", "surface", MOTOR))),
    _Plot("torque", "Torque at the column [N·m]",
          (("/column.torque", "pilot", PILOT), ("/load_cell.torque", "load cell", MEASURED))),
    _Plot("motor", "Motor torque [N·m]",
          (("/drive.torque", "air gap", MOTOR), ("/drive.torque_command", "command", MODEL))),
    _Plot("speed", "Motor speed [rad/s]",
          (("/drive.velocity", "measured", MEASURED), ("/drive.set_velocity", "set", MODEL))),
    _Plot("mesh", "Torque through the meshes [N·m]",
          tuple((f"/gearbox.stage{n}_torque", f"stage {n}", color) for n, color in _STAGES)),
    _Plot("friction", "Friction at the stages' inputs [N·m]",
          tuple((f"/gearbox.stage{n}_friction", f"stage {n}", color) for n, color in _STAGES)),
    _Plot("hand", "Hand: force [N]", (("/pilot.hand_force", "hand force", PILOT),)),
)  # fmt: skip

_BENCH: Mapping[str, Any] = {
    "cameraState": {
        "distance": 1.15, "perspective": True, "phi": 68, "target": [0, 0, 0], "targetOffset": [-0.08, 0.03, 0.34],
        "targetOrientation": [0, 0, 0, 1], "thetaOffset": 30, "fovy": 45, "near": 0.01, "far": 50,
    },
    "followMode": "follow-none", "followTf": "world",
    "scene": {"backgroundColor": "#d6dbe1", "transforms": {"visible": False, "showLabel": False}},
    "transforms": {}, "topics": {SCENE_TOPIC: {"visible": True}}, "layers": {}, "imageMode": {},
}  # fmt: skip


def foxglove_layout(topics: Iterable[Topic]) -> dict[str, Any]:
    """The layout for what was recorded, as JSON has it: plots of the signals there are, of several axes a tab each."""
    topics = tuple(topics)
    axes = axes_of(topics) or ("",)
    there = {f"{topic.path}.{name}" for topic in topics for name in topic.names}
    panels: dict[str, Any] = {BENCH: {**_BENCH}}
    groups = {axis: _plots(axis, there, panels) for axis in axes}
    panels[EVENTS] = {
        **_titled("Events"), "searchTerms": [], "minLogLevel": 1, "topicToRender": EVENTS_TOPIC
    }  # fmt: skip
    if len(axes) == 1:
        whole = _one(groups[axes[0]], panels)
    else:
        panels[AXES] = _tabs([(axis, node) for axis in axes if (node := _stacked(groups[axis])) is not None])
        whole = _row(BENCH, _column(AXES, EVENTS, 85), 30)
    return {
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": {"speed": 1}, "layout": whole
    }  # fmt: skip


def _plots(axis: str, there: set[str], panels: dict[str, Any]) -> dict[str, str]:
    """Adds the plots of an axis to ``panels``; returns their names there, by what they show."""
    root = f"/{axis}" if axis else ""
    found = {}
    for plot in _PLOTS:
        curves = [(f"{root}{signal}", label, color) for signal, label, color in plot.curves]
        curves = [curve for curve in curves if curve[0] in there]
        if not curves or (plot.over and f"{root}{plot.over}" not in there):
            continue
        found[plot.name] = name = f"Plot!{axis}_{plot.name}" if axis else f"Plot!{plot.name}"
        panels[name] = {
            **_titled(f"{axis}: {plot.title}" if axis else plot.title),
            "paths": [
                {"value": signal, "label": label, "color": hexadecimal(color), "enabled": True,
                 "timestampMethod": "receiveTime"}
                for signal, label, color in curves
            ],
            "showLegend": True, "legendDisplay": "floating", "showPlotValuesInLegend": False,
            "showXAxisLabels": True, "showYAxisLabels": True, "isSynced": not plot.over,
            "xAxisVal": "custom" if plot.over else "timestamp", "sidebarDimension": 240,
            **({"xAxisPath": {"value": f"{root}{plot.over}", "enabled": True}} if plot.over else {}),
        }  # fmt: skip
    return found


def _titled(title: str) -> dict[str, str]:
    return {"lichtblickPanelTitle": title, "foxglovePanelTitle": title}


def _row(first: _Node, second: _Node, share: float) -> _Node:
    return {"direction": "row", "first": first, "second": second, "splitPercentage": share}


def _column(first: _Node, second: _Node, share: float) -> _Node:
    return {"direction": "column", "first": first, "second": second, "splitPercentage": share}


def _tabs(tabs: Sequence[tuple[str, _Node]]) -> dict[str, Any]:
    return {"activeTabIdx": 0, "tabs": [{"title": title, "layout": layout} for title, layout in tabs]}


def _beside(plots: Mapping[str, str], *names: str) -> _Node | None:
    """Those of two plots that are there, side by side."""
    found = [plots[name] for name in names if name in plots]
    return None if not found else found[0] if len(found) == 1 else _row(found[0], found[1], 50)


def _under(first: _Node | None, second: _Node | None, share: float) -> _Node | None:
    """One under the other, as far as they are there."""
    if first is None or second is None:
        return first if second is None else second
    return _column(first, second, share)


def _one(plots: Mapping[str, str], panels: dict[str, Any]) -> _Node:
    """The whole layout of a bench with one axis."""
    details = [
        (title, node)
        for title, names in (("Drive", ("motor", "speed")), ("Gearbox", ("mesh", "friction")), ("Hand", ("hand",)))
        if (node := _beside(plots, *names)) is not None
    ]
    if details:
        panels[DETAILS] = _tabs(details)
    curves = _under(plots.get("angle"), plots.get("torque"), 50)
    below = _under(DETAILS if details else None, EVENTS, 65)
    left, right = _under(BENCH, plots.get("loop"), 60), _under(curves, below, 55)
    assert left is not None and right is not None
    return _row(left, right, 40)


def _stacked(plots: Mapping[str, str]) -> _Node | None:
    """The plots of one of several axes."""
    upper = _under(_beside(plots, "angle", "torque"), _beside(plots, "loop", "hand"), 50)
    return _under(upper, _under(_beside(plots, "motor", "speed"), _beside(plots, "mesh", "friction"), 50), 50)
