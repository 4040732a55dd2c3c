"""A feel model at a glance: torque over displacement in a slow sweep, and the free response; no bench is run."""

import math
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cls_bench.analysis.free_response import expected_response
from cls_bench.analysis.quasi_static import static_curve
from cls_bench.parameters import DEG, Parameters
from cls_bench.report.style import COLOR, legend, new_pair, room_above, torque_axes
from cls_bench.rigs import figures

Array = NDArray[np.float64]

POINTS = 400
"""Points of a sweep from one end to the other."""

BEYOND = 0.5 * DEG
"""How far the sweep goes beyond the column's travel limit [rad]."""

MOST_BEYOND = 1.1
"""Share of the load cell's range that is drawn, where a sweep goes beyond."""

_NOTICED = 0.005
"""Share of the way that is no overshoot yet."""


class Felt(NamedTuple):
    """What a feel model is like, from its parameters alone."""

    angle: Array
    """column angles of a slow sweep from neutral forward, aft and back again [rad]"""
    torque: Array
    """of the hand that leads it [N·m]"""
    time: Array
    """since the release [s]"""
    released: Array
    """column angle, let go from the first one at rest [rad]"""


def sweep_ends(p: Parameters, travel: float | None = None) -> tuple[float, float]:
    """Aft and forward end of the sweep [rad]: ±``travel``, by default a little beyond the column's limits, if the rig
    goes so far.
    """
    if travel is not None:
        return -travel, travel
    limit, reach = p.feel.forward_limit, p.column.stop_angle
    return -min(limit.back + BEYOND, reach), min(limit.angle + BEYOND, reach)


def felt(p: Parameters, *, travel: float | None = None, release: float | None = None, time: float = 3.0) -> Felt:
    """Static curve and free response of the feel model of ``p``.

    The sweep is between :func:`sweep_ends`; the column is let go from ``release`` [rad], by default half the way to the
    nearest limit.
    """
    end, forward = sweep_ends(p, travel)
    path = np.concatenate([
        np.linspace(0.0, forward, POINTS // 2), np.linspace(forward, end, POINTS)[1:],
        np.linspace(end, forward, POINTS)[1:],
    ])  # fmt: skip
    nearest = min(p.feel.aft_limit.angle, p.feel.forward_limit.angle, p.column.stop_angle)
    start = 0.5 * nearest if release is None else release
    times = np.linspace(0.0, time, 1501)
    return Felt(path, static_curve(p.feel, path), times, expected_response(p, start, times))


def feel_figure(p: Parameters, found: Felt, title: str) -> Figure:
    """The two in one figure."""
    figure, (static, free) = new_pair(height=7.2, shares=(1.5, 1))
    first = POINTS // 2 - 1  # the way out from neutral is gone over again on the way back
    static.plot(found.angle[first:] / DEG, found.torque[first:], color=COLOR["model"], label="slow sweep, both ways")
    static.set_title(title, loc="left", fontsize=10.5, fontweight="bold")
    torque_axes(static, p.column.grip_height, "torque of the hand [N·m]")
    marks = [("surface's limit", p.feel.aft_limit), ("column's limit", p.feel.forward_limit)]
    low, high = (float(x) / DEG for x in (found.angle.min(), found.angle.max()))
    for name, stop in marks:
        for at in (stop.angle / DEG, -stop.back / DEG):
            if low < at < high and stop.stiffness > 0.0:
                static.axvline(at, color=COLOR["muted"], lw=0.8, ls=":")
                static.annotate(
                    name, (at, 0.5 + math.copysign(0.46, -at)), xycoords=("data", "axes fraction"), rotation=90,
                    va="bottom" if at > 0.0 else "top", ha="right" if at > 0.0 else "left", fontsize=8.5,
                    color=COLOR["muted"],
                )  # fmt: skip
    measured = figures(p).measurable_force * p.column.grip_height
    if float(np.abs(found.torque).max()) > MOST_BEYOND * measured:  # a stiff stop makes all else small
        static.set_ylim(-MOST_BEYOND * measured, MOST_BEYOND * measured)
        room_above(static, 0.15)
        for way in (1.0, -1.0):
            static.axhline(way * measured, color=COLOR["muted"], lw=0.8, ls="--")
        static.plot([], [], color=COLOR["muted"], lw=0.8, ls="--", label="end of the load cell's range")
    legend(static, place="upper center")
    free.plot(found.time, found.released / DEG, color=COLOR["model"], label="let go at rest")
    free.axhline(p.feel.neutral / DEG, color=COLOR["muted"], lw=0.8, ls=":")
    free.set_xlabel("time since release [s]")
    free.set_ylabel("column angle φ [°]")
    legend(free, place="upper right")
    room_above(free, 0.15)
    figure.align_ylabels()
    return figure


class Swing(NamedTuple):
    """How the free response swings about the place where it comes to rest."""

    crossing: float
    """time at which it first passes that place [s]; NaN if it never does"""
    overshoot: float
    """how far it then goes, as a share of the way that it came [1]"""
    frequency: float
    """of the swing, from its release at rest to its first turn, half a period later: dry friction shifts crossings, but
    no turns [Hz]; NaN if there is none"""


def swing(found: Felt) -> Swing:
    """The swing of a free response."""
    x = (found.released - found.released[-1]) / (found.released[0] - found.released[-1] or 1.0)
    crossings = np.flatnonzero((x[:-1] > 0.0) != (x[1:] > 0.0))
    if not len(crossings) or np.min(x) > -_NOTICED:
        return Swing(math.nan, 0.0, math.nan)
    first = crossings[0]
    end = crossings[1] + 1 if len(crossings) > 1 else len(x)
    turn = first + int(np.argmin(x[first:end]))
    return Swing(float(found.time[first]), -float(np.min(x)), 0.5 / float(found.time[turn]))
