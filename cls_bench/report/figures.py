"""The figures of a run: which ones follows from what the scenario measures, so that they show what is judged."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cls_bench.parameters import DEG
from cls_bench.report.recorded_run import RecordedRun, Span
from cls_bench.report.style import COLOR, legend, new_figure, thin, thin_path

Array = NDArray[np.float64]

BREAKOUT_LIMIT = 9.0
"""Tolerance of the breakout force at the grip [N]: 0.9 daN (14 CFR Part 60, table A2A)."""


@dataclass(frozen=True)
class Picture:
    """A figure with what to say of it."""

    name: str
    """unique in the run; the file's stem"""
    title: str
    caption: str
    """one or two sentences: what is drawn, and what to look at"""
    figure: Figure


def pictures(run: RecordedRun) -> Iterator[Picture]:
    """The figures of ``run``: those that belong to its checks, then the overview of the whole run."""
    for metrics, draw in _FIGURES:
        spans = run.spans(*metrics)
        if spans:
            yield from draw(run, spans)
    yield overview(run)


# --- torque over displacement ----------------------------------------------------------------------------------------


def friction(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis figure 4.1: torque at the load cell over displacement, power off against on."""
    figure, (ax,) = new_figure()
    limit = BREAKOUT_LIMIT * run.scenario.parameters_at_start().column.grip_height
    ax.axhspan(-limit, limit, color=COLOR["band"], zorder=0, label="Part 60 breakout tolerance, ±0.9 daN at the grip")
    looks = {"off": (COLOR["power_off"], "drive power off"), "on": (COLOR["measured"], "drive on, feel model running")}
    for span in spans:
        window = run.window(span)
        color, label = looks.get(run.power_in(span), (COLOR["muted"], f"{span.start:g} to {span.end:g} s"))
        x, y = thin_path(window["/column.angle"] / DEG, window["/load_cell.torque"])
        ax.plot(x, y, color=color, label=label)
    _torque_axes(ax, run)
    legend(ax, place="upper left")
    _room_above(ax, 0.30)
    yield Picture(
        "torque_over_displacement",
        "Torque over displacement",
        "Torque T_meas that the load cell feels while the hand moves the column slowly to and fro. A loop is as wide "
        "as twice the friction that the hand has to overcome.",
        figure,
    )


def _torque_axes(ax: Axes, run: RecordedRun) -> None:
    ax.set_xlabel("column angle φ [°]")
    ax.set_ylabel("torque T_meas [N·m]")
    height = run.scenario.parameters_at_start().column.grip_height

    scales: tuple[Any, Any] = (lambda torque: torque / height, lambda force: force * height)
    side = ax.secondary_yaxis("right", functions=scales)
    side.set_ylabel("as a force at the grip [N]", color=COLOR["ink"])
    side.tick_params(color=COLOR["muted"], labelcolor=COLOR["ink"])
    side.spines["right"].set_color(COLOR["muted"])


def _room_above(ax: Axes, share: float) -> None:
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + share * (high - low))


# --- overview --------------------------------------------------------------------------------------------------------


def overview(run: RecordedRun) -> Picture:
    """The whole run at a glance."""
    w = run.whole
    figure, (angle, torque, drive, state) = new_figure(4, height=6.6, shares=(3, 3, 2.4, 1.1))
    for signal, color, label, style in (
        ("/column.angle", "measured", "column", "-"), ("/feel.angle", "model", "feel model", "--"),
    ):  # fmt: skip
        x, y = thin(w.time, w[signal] / DEG)
        angle.plot(x, y, style, color=COLOR[color], label=label)
    angle.set_ylabel("angle [°]")
    for signal, color, label, style in (
        ("/column.torque", "pilot", "pilot", "-"), ("/load_cell.torque", "measured", "load cell", "--"),
    ):  # fmt: skip
        x, y = thin(w.time, w[signal])
        torque.plot(x, y, style, color=COLOR[color], label=label)
    torque.set_ylabel("torque [N·m]")
    x, y = thin(w.time, w["/drive.torque"])
    drive.plot(x, y, color=COLOR["third"], label="motor")
    drive.set_ylabel("motor torque\n[N·m]")
    _lanes(state, run)
    state.set_xlabel("time [s]")
    for ax in (angle, torque):
        legend(ax, columns=2, place="upper right")
        _room_above(ax, 0.12)
    figure.align_ylabels()
    caption = "The whole run: what the hand did, what the column did, what the motor did; below, when power was on and "
    return Picture("overview", "The whole run", caption + "how tightly the hand gripped.", figure)


def _lanes(ax: Axes, run: RecordedRun) -> None:
    """Power and grip over time as bars."""
    w = run.whole
    squeeze = w["/pilot.squeeze"]
    ax.fill_between(*_steps(w.time, run.powered.astype(float) * 0.8), color=COLOR["measured"], alpha=0.55, lw=0)
    x, held = _steps(w.time, (squeeze >= 0.0).astype(float) * 0.25)
    ax.fill_between(x, 1.0, 1.0 + held, color=COLOR["pilot"], alpha=0.45, lw=0)
    x, y = thin(w.time, np.maximum(squeeze, 0.0) * 0.55)
    ax.fill_between(x, 1.25, 1.25 + y, color=COLOR["pilot"], alpha=0.85, lw=0)
    ax.set_ylim(-0.1, 1.9)
    ax.set_yticks([0.4, 1.4], ["power", "grip"])
    ax.grid(visible=False)


def _steps(time: Array, level: Array) -> tuple[Array, Array]:
    """A piecewise constant signal by its corners."""
    at = np.flatnonzero(np.diff(level)) + 1
    x = np.concatenate([[time[0]], np.repeat(time[at], 2), [time[-1]]])
    y = np.concatenate([[level[0]], np.stack([level[at - 1], level[at]], axis=1).ravel(), [level[-1]]])
    return x, y


_FIGURES: tuple[tuple[tuple[str, ...], Callable[[RecordedRun, Sequence[Span]], Iterator[Picture]]], ...] = (
    (("breakout_torque",), friction),
)
"""Metrics and the figure that shows what they measure."""
