"""The figure of a sweep: every metric over every axis, or a map where two axes span a grid."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from cls_bench.analysis import metrics
from cls_bench.report.style import _RC, COLOR
from cls_bench.sweep.axes import Axis, ListAxis, Listed, LogRangeAxis, LogUniformAxis
from cls_bench.sweep.engine import Row
from cls_bench.sweep.plan import Plan

Array = NDArray[np.float64]

MOST_METRICS, MOST_AXES = 8, 6
"""Rows and columns of plots; the table has the rest."""

FEW = 6
"""Listed numbers that get a tick each."""

STATUS = {"passed": ("measured", "o"), "failed": ("power_off", "^"), "diverged": ("error", "X")}
"""Colour and marker of points by status."""


def sweep_figure(plan: Plan, rows: Sequence[Row]) -> Figure:
    """Draw the first metrics over the first axes; points without a value are left out."""
    axes, checks = plan.sweep.axes[:MOST_AXES], plan.checks[:MOST_METRICS]
    as_map = len(plan.sweep.axes) == 2 and all(isinstance(a, Listed) and len(a.listed()) > 2 for a in axes)
    columns = 1 if as_map else len(axes)
    with mpl.rc_context(_RC):
        figure = Figure(figsize=(max(6.0, 0.8 + 3.2 * columns), 0.6 + 2.7 * len(checks)), layout="constrained")
        plots = figure.subplots(len(checks), columns, squeeze=False, sharex="col")
        figure.suptitle(plan.sweep.title, x=0.01, ha="left", weight="bold", fontsize=11)
        for check, line in zip(checks, plots, strict=True):
            values = np.array([_number(row.values.get(check.name)) for row in rows])
            label = f"{check.name} [{metrics.unit(check)}]"
            if as_map:
                _draw_map(figure, line[0], axes[0], axes[1], rows, values, label)
                continue
            for k, axis in enumerate(axes):
                _draw_points(line[k], axis, rows, values)
                if k == 0:
                    line[k].set_ylabel(label)
        for k in range(columns):
            plots[-1, k].set_xlabel(axes[k].key)
        if not as_map:
            handles, labels = _legend(plots)
            if len(labels) > 1:
                figure.legend(handles, labels, loc="outside lower right", ncols=len(labels))
    return figure


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def _place(axis: Axis, rows: Sequence[Row]) -> tuple[Array, list[str]]:
    """Where the points lie along an axis; texts and booleans side by side, with their names."""
    cells = [row.point[axis.key] for row in rows]
    if all(isinstance(cell, int | float) and not isinstance(cell, bool) for cell in cells):
        return np.array([_number(cell) for cell in cells]), []
    names = list(dict.fromkeys(str(cell) for cell in cells))
    return np.array([float(names.index(str(cell))) for cell in cells]), names


def _scale(ax: Axes, way: str, axis: Axis, names: list[str]) -> None:
    """Along ``way``, x or y: logarithmic where the axis is; ticks at names and at listed numbers if they are few."""
    line = {"x": ax.xaxis, "y": ax.yaxis}[way]
    if isinstance(axis, LogRangeAxis | LogUniformAxis):
        ax.set(**{f"{way}scale": "log"})
        line.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        line.set_major_formatter(StrMethodFormatter("{x:g}"))
        line.set_minor_formatter(NullFormatter())
    elif names:
        line.set_ticks(range(len(names)), names)
        ax.set(**{f"{way}lim": (-0.5, len(names) - 0.5)})
    elif isinstance(axis, ListAxis) and len(axis.values) <= FEW:
        line.set_ticks([_number(value) for value in axis.values])


def _draw_points(ax: Axes, axis: Axis, rows: Sequence[Row], values: Array) -> None:
    at, names = _place(axis, rows)
    states = np.array([row.values.get("status", "") for row in rows])
    for status, (color, marker) in STATUS.items():
        chosen = (states == status) & np.isfinite(values)
        if chosen.any():
            size = 26.0 if chosen.sum() < 200 else 8.0
            ax.scatter(at[chosen], values[chosen], s=size, c=COLOR[color], marker=marker, label=status, linewidths=0)
    _scale(ax, "x", axis, names)


def _legend(plots: Any) -> tuple[list[Any], list[str]]:
    found: dict[str, Any] = {}
    for ax in plots.flat:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    return list(found.values()), list(found)


def _draw_map(
    figure: Figure, ax: Axes, horizontal: Axis, vertical: Axis, rows: Sequence[Row], values: Array, label: str
) -> None:
    x, x_names = _place(horizontal, rows)
    y, y_names = _place(vertical, rows)
    xs, ys = np.unique(x), np.unique(y)
    grid = np.full((len(ys), len(xs)), np.nan)
    grid[np.searchsorted(ys, y), np.searchsorted(xs, x)] = values
    mesh = ax.pcolormesh(xs, ys, np.ma.masked_invalid(grid), shading="nearest", cmap="cividis")
    ax.grid(visible=False)
    figure.colorbar(mesh, ax=ax, label=label)
    ax.set_ylabel(vertical.key)
    _scale(ax, "x", horizontal, x_names)
    _scale(ax, "y", vertical, y_names)
