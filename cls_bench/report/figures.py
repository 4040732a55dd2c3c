"""The figures of a run: which ones follows from what the scenario measures, so that they show what is judged."""

import math
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cls_bench.analysis import free_response, metrics
from cls_bench.analysis.quasi_static import static_curve
from cls_bench.atmosphere import KNOT
from cls_bench.errors import InputError
from cls_bench.parameters import DEG, Feel, Gearbox
from cls_bench.parameters.moving import numbers
from cls_bench.parameters.override import flat
from cls_bench.report.recorded_run import RecordedRun, Span
from cls_bench.report.style import COLOR, legend, new_figure, new_pair, room_above, thin, thin_path, torque_axes
from cls_bench.scenario import Change
from cls_bench.text import printable

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
    table: tuple[tuple[str, ...], ...] = ()
    """numbers that belong to it, the header first"""


CANNOT_DRAW = (InputError, ValueError, ArithmeticError, IndexError, np.linalg.LinAlgError)
"""What drawing may raise of samples that are not there or that no bench gives."""


def pictures(run: RecordedRun, left_out: list[str] | None = None) -> Iterator[Picture]:
    """The figures of ``run``: those that belong to its checks, then the overview of the whole run.

    Of several axes one after the other. What cannot be drawn, since samples are missing or are none of a bench, is
    named in ``left_out`` with the reason.
    """
    left_out = [] if left_out is None else left_out
    for axis in run.axes:
        here, missed = run.on(axis), list[str]()
        for picture in _of_axis(here, missed):
            yield replace(picture, name=f"{axis}_{picture.name}", title=f"{axis}: {picture.title}") if axis else picture
        left_out += [f"{axis}: {line}" if axis else line for line in missed]


def _of_axis(run: RecordedRun, left_out: list[str]) -> Iterator[Picture]:
    for names, signal, draw in _FIGURES:
        spans = run.spans(*names, signal=signal)
        if spans:
            yield from _drawn(draw, run, spans, left_out)
    if any("/surface." in (check.signal or "") or "/feel.own" in (check.signal or "") for check in run.scenario.checks):
        yield from _drawn(lambda run, spans: [aft_side(run)], run, [], left_out)
    yield from _drawn(lambda run, spans: [overview(run)], run, [], left_out)


def _drawn(
    draw: Callable[[RecordedRun, Sequence[Span]], Iterable[Picture]], run: RecordedRun, spans: Sequence[Span],
    left_out: list[str],
) -> list[Picture]:  # fmt: skip
    try:
        with np.errstate(all="ignore"):
            return list(draw(run, spans))
    except CANNOT_DRAW as error:
        what = draw.__name__.strip("<>").replace("lambda", "the whole run")
        left_out.append(f"{what}: {printable(str(error), 300)}")
        return []


# --- torque over displacement ----------------------------------------------------------------------------------------


def friction(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis figure 4.1: torque at the load cell over displacement, power off against on."""
    figure, (ax,) = new_figure()
    limit = BREAKOUT_LIMIT * run.scenario.parameters_at_start().column.grip_height
    ax.axhspan(-limit, limit, color=COLOR["band"], zorder=0, label="Part 60 breakout tolerance, ±0.9 daN at the grip")
    for span in spans:
        window = run.window(span)
        color, label = _power_look(run, span)
        x, y = thin_path(window["/column.angle"] / DEG, window["/load_cell.torque"])
        ax.plot(x, y, color=color, label=label)
    _torque_axes(ax, run)
    legend(ax, place="upper left")
    room_above(ax, 0.30)
    yield Picture(
        "torque_over_displacement",
        "Torque over displacement",
        "Torque T_meas that the load cell feels while the hand moves the column slowly to and fro. A loop is as wide "
        "as twice the friction that the hand has to overcome.",
        figure,
    )


def _power_look(run: RecordedRun, span: Span) -> tuple[str, str]:
    """Colour and label of a curve, by the drive's power."""
    running = f"drive on, {'feel model' if run.has_feel_model else run.set_label.removesuffix(' (set)')} running"
    looks = {"off": (COLOR["power_off"], "drive power off"), "on": (COLOR["measured"], running)}
    return looks.get(run.power_in(span), (COLOR["muted"], f"{span.start:g} to {span.end:g} s"))


def _torque_axes(ax: Axes, run: RecordedRun) -> None:
    torque_axes(ax, run.scenario.parameters_at_start().column.grip_height, "torque T_meas [N·m]")


# --- feel model: static sweep and free response ----------------------------------------------------------------------


def static(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis figures 4.2 to 4.4, left: torque over displacement in a slow sweep, with what the feel model asks for."""
    for k, span in enumerate(spans, start=1):
        w = run.window(span)
        figure, (ax, error) = new_pair(height=6.2, shares=(3, 1.2))
        angle, model, torque = w["/column.angle"] / DEG, w["/feel.angle"] / DEG, w["/load_cell.torque"]
        ax.plot(*thin_path(angle, torque), color=COLOR["measured"], lw=2.4, label="column (measured)")
        ax.plot(*thin_path(model, torque), color=COLOR["model"], lw=1.0, ls=(0, (4, 3)), label=run.set_label)
        if run.has_feel_model:
            path = _to_and_fro(model)
            asked = static_curve(w.parameters.feel, path * DEG)
            ax.plot(path, asked, color=COLOR["expected"], lw=1.0, ls=":", label="expected of an infinitely slow sweep")
        _torque_axes(ax, run)
        ax.set_xlabel("")
        legend(ax, place="upper left")
        if np.any((angle < angle.min() + 0.5 * np.ptp(angle)) & (torque > torque.max() - 0.25 * np.ptp(torque))):
            room_above(ax, 0.25)  # a curve where the legend is
        error.plot(*thin_path(angle, angle - model), color=COLOR["error"], lw=1.0)
        error.set_ylabel("column − set [°]")
        error.set_xlabel("column angle φ [°]")
        error.sharex(ax)
        figure.align_ylabels()
        yield Picture(
            f"static_{k}" if len(spans) > 1 else "static",
            "Static sweep: torque over displacement",
            _of_a_sweep(w.parameters.feel if run.has_feel_model else None, model),
            figure,
        )


def _of_a_sweep(feel: Feel | None, model: Array) -> str:
    """What to say of a static sweep over the angles ``model`` [deg]; None is a controller of the user's own."""
    caption = "The hand moves the column slowly. The loop's width is twice the friction, its slopes are "
    if feel is None:
        return caption + "the springs, as the user's own controller renders them."
    limit = feel.aft_limit
    reached = limit.stiffness > 0.0 and (np.max(model) > limit.angle / DEG or np.min(model) < -limit.back / DEG)
    caption += "the springs, its ends the travel limits; " if reached else "the springs; "
    caption += "the dotted line follows from the parameters alone, without the damping a slow motion still feels"
    if feel.detents.place:
        caption += ", and without the arm's give, by which the column snaps from where a detent lets go"
    return caption + "."


TURN_DEG = 0.2
"""A reversal by less than this, or by less than a tenth of the whole way, is none of the sweep's [deg]."""

LEG = 200
"""Points from one reversal of a sweep to the next."""


def _to_and_fro(angle: Array) -> Array:
    """The path of a sweep [deg]: straight from where it begins to each of its reversals, and to its end."""
    turns, way, furthest = [float(angle[0])], 0.0, float(angle[0])
    turn = min(TURN_DEG, 0.1 * float(np.ptp(angle)))
    for x in thin_path(angle, angle)[0]:
        if way == 0.0 and abs(x - furthest) > turn:
            way = math.copysign(1.0, x - furthest)
        elif way * (furthest - x) > turn:
            turns.append(furthest)
            way = -way
        elif way * (x - furthest) <= 0.0:
            continue
        furthest = float(x) if way != 0.0 else furthest
    turns.append(furthest)
    return np.concatenate([np.linspace(a, b, LEG) for a, b in pairwise(turns)])


def released(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis figures 4.2 to 4.4, right: the free response, with an independent solution of the equation of motion."""
    for k, span in enumerate(spans, start=1):
        w = run.window(span)
        time, angle = w.time - w.time[0], w["/column.angle"]
        figure, (ax, error) = new_figure(2, height=5.2, shares=(3, 1.3))
        ax.plot(*thin(time, angle / DEG), color=COLOR["measured"], label="column (measured)")
        ax.plot(*thin(time, w["/feel.angle"] / DEG), color=COLOR["model"], ls=(0, (4, 3)), label=run.set_label)
        ax.set_ylabel("angle φ [°]")
        error.plot(*thin(time, (angle - w["/feel.angle"]) / DEG), color=COLOR["error"], label="column − set")
        table: tuple[tuple[str, ...], ...] = ()
        caption = "The hand lets go and the column moves freely."
        if run.has_feel_model:
            expected = free_response.expected_response(w.parameters, float(angle[0]), time)
            curve: dict[str, Any] = {"color": COLOR["expected"], "ls": ":"}
            ax.plot(*thin(time, expected / DEG), **curve, label="expected: independent solution")
            error.plot(*thin(time, (angle - expected) / DEG), **curve, label="column − expected")
            table = _part60(time, angle, expected)
            caption += (
                " Part 60 judges the quantities below: times [s], the overshoots and the residual as parts of the "
                "amplitude."
            )
        else:
            caption += " A controller of the user's own ran: what the feel model would have done is not drawn."
        legend(ax, place="upper right" if angle[0] > 0 else "lower right")
        error.set_ylabel("difference [°]")
        error.set_xlabel("time since release [s]")
        legend(error, columns=2, place="upper right")
        room_above(error, 0.35)
        figure.align_ylabels()
        start = float(angle[0]) / DEG
        yield Picture(
            f"free_response_{k}",
            f"Free response from {start:+.1f}°",
            caption,
            figure,
            table,
        )


def _part60(time: Array, angle: Array, expected: Array) -> tuple[tuple[str, ...], ...]:
    rows = [
        (i.name, f"{i.measured:.4g}", f"{i.expected:.4g}", f"± {i.tolerance:.3g}", f"{i.share:.0%}")
        for i in free_response.part60(time, angle, expected)
    ]
    return (("quantity", "measured", "expected", "tolerance", "used"), *rows)


# --- tracking --------------------------------------------------------------------------------------------------------

PERIODS = 4
"""Periods of a fast motion that are drawn."""


def tracking(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis figure 4.5: the column against the feel model in a fast motion, and the error."""
    for k, span in enumerate(spans, start=1):
        w = run.window(span)
        frequency = next(
            c.arguments["frequency"]
            for c in run.scenario.checks
            if Span(*c.window) == span and "frequency" in c.arguments and metrics.axis_of(c) == run.axis
        )
        rows = slice(0, min(len(w.time), int(PERIODS / frequency * w.rate)))
        try:
            lag = 1e-3 * metrics.tracking_lag_ms(w)
        except metrics.Unmeasured:
            lag = math.nan
        time, angle, model = w.time[rows], w["/column.angle"][rows] / DEG, w["/feel.angle"] / DEG
        figure, (ax, error) = new_figure(2, height=5.2, shares=(3, 2))
        ax.plot(*thin(time, model[rows]), color=COLOR["model"], label=run.set_label)
        ax.plot(*thin(time, angle), color=COLOR["measured"], ls=(0, (4, 3)), label="column (measured)")
        ax.set_ylabel("angle φ [°]")
        legend(ax, columns=2, place="upper right")
        room_above(ax, 0.15)
        error.plot(*thin(time, angle - model[rows]), color=COLOR["error"], label="column − set")
        if math.isfinite(lag):
            settled = time > time[0] + lag
            left = thin(time[settled], (angle - np.interp(time - lag, w.time, model))[settled])
            error.plot(*left, color=COLOR["expected"], ls=":", label=f"less the lag of {1e3 * lag:.1f} ms")
        error.set_ylabel("error [°]")
        error.set_xlabel("time [s]")
        legend(error, columns=2, place="upper right")
        room_above(error, 0.3)
        figure.align_ylabels()
        yield Picture(
            f"tracking_{k}" if len(spans) > 1 else "tracking",
            f"Tracking of a motion of {frequency:g} Hz",
            "The column follows its set angle while the hand moves it fast. Nearly all of the error is the time by "
            "which the column is late.",
            figure,
        )


# --- squeezing -------------------------------------------------------------------------------------------------------

CLOSE_UP = 0.25
"""Length of the close-up of an oscillation [s]."""


def squeezing(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis figures 4.6 and 4.7: angle and torque while the grip tightens, and a close-up of what follows."""
    whole = Span(max(spans[0].start - 0.5, 0.0), min(max(span.end for span in spans), run.duration))
    end = whole.end
    grip = run.window(whole)["/pilot.squeeze"]
    if np.max(grip) > np.median(grip[: max(len(grip) // 4, 1)]) + TIGHTENS:
        title, caption = "Angle and torque while the grip tightens", (
            "The hand moves the column gently and then squeezes it: its mass, now firmly on the column, takes the "
            "outer loop's stability margin."
        )  # fmt: skip
    else:
        title, caption = "Angle and torque in a steady grip", (
            "The hand moves the column in a grip that does not tighten. Where the outer loop is stable, the column "
            "follows without vibration."
        )  # fmt: skip
    yield _shaking(run, whole, "squeezing", title, caption)
    yield _shaking(run, Span(end - CLOSE_UP, end), "squeezing_close", "Close-up of the last quarter of a second", (
        "The same signals magnified: column against set angle, load cell against pilot."
    ))  # fmt: skip


TIGHTENS = 0.1
"""Squeeze by which a grip tightens that is more than unsteady [1]."""


def _shaking(run: RecordedRun, span: Span, name: str, title: str, caption: str) -> Picture:
    w = run.window(span)
    figure, (angle, torque, squeeze) = new_figure(3, height=5.8, shares=(3, 3, 1))
    angle.plot(*thin(w.time, w["/feel.angle"] / DEG), color=COLOR["model"], label=run.set_label)
    dashed: dict[str, Any] = {"color": COLOR["measured"], "ls": (0, (4, 3))}  # on what it mostly covers
    angle.plot(*thin(w.time, w["/column.angle"] / DEG), **dashed, label="column (measured)")
    angle.set_ylabel("angle φ [°]")
    torque.plot(*thin(w.time, w["/column.torque"]), color=COLOR["pilot"], lw=2.2, label="pilot on the column")
    torque.plot(*thin(w.time, w["/load_cell.torque"]), **dashed, label="load cell T_meas")
    torque.set_ylabel("torque [N·m]")
    squeeze.plot(*thin(w.time, np.maximum(w["/pilot.squeeze"], 0.0)), color=COLOR["pilot"])
    squeeze.set_ylim(-0.1, 1.1)
    squeeze.set_yticks([0.0, 1.0], ["loose", "tight"])
    squeeze.set_xlabel("time [s]")
    for ax in (angle, torque):
        legend(ax, columns=2, place="upper right")
        room_above(ax, 0.22)
    figure.align_ylabels()
    return Picture(name, title, caption, figure)


# --- gearbox imperfections -------------------------------------------------------------------------------------------

HIGHEST_ORDER = 36.0
"""Orders that are drawn [cycles per motor revolution]."""


SWEEP_DEG = 1.0
"""Travel from which on a column that moves is swept [deg]."""


def evenness(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """How evenly the column moves under the hand: its velocity over its angle."""
    spans = [span for span in spans if np.ptp(run.window(span)["/column.angle"]) > SWEEP_DEG * DEG]
    if not spans:  # the column shakes, or rests
        return
    figure, axes = new_figure(len(spans), height=1.2 + 2.0 * len(spans))
    for ax, span in zip(axes, spans, strict=True):
        w = run.window(span)
        color, label = _power_look(run, span)
        ax.plot(*thin_path(w["/column.angle"] / DEG, w["/column.velocity"] / DEG), color=color, lw=1.0, label=label)
        ax.set_ylabel("velocity [°/s]")
        legend(ax, place="upper left")
        room_above(ax, 0.25)
    axes[-1].set_xlabel("column angle φ [°]")
    figure.align_ylabels()
    yield Picture(
        "evenness",
        "How evenly the column moves",
        "Velocity over the angle of the column while the hand moves it steadily. Meshing gears and friction make it "
        "jerk; a smooth curve is what a hand expects.",
        figure,
    )


def imperfections(run: RecordedRun, spans: Sequence[Span]) -> Iterator[Picture]:
    """Thesis 4.5: the tracking error that the gearbox leaves, over the column's angle and by its orders."""
    for k, span in enumerate(spans, start=1):
        suffix = f"_{k}" if len(spans) > 1 else ""
        w = run.window(span)
        sweeps = _sweeps(w["/column.angle"])
        figure, (ax, spectrum) = new_pair(height=6.2, shares=(1, 1))
        orders = np.arange(0.0, HIGHEST_ORDER, 0.05)
        power = np.zeros_like(orders)
        for sweep, color, label in zip(sweeps, ("measured", "model"), ("forward", "backward"), strict=True):
            if sweep is None:
                continue
            angle = w["/column.angle"][sweep]
            error = (angle - w["/feel.angle"][sweep]) / DEG * 60.0
            ax.plot(*thin_path(angle / DEG, error), color=COLOR[color], lw=1.0, label=label)
            power += _order_amplitudes(w["/drive.position"][sweep], error, orders) ** 2
        ax.set_ylabel("column − set [arcmin]")
        ax.set_xlabel("column angle φ [°]")
        legend(ax, columns=2, place="upper right")
        room_above(ax, 0.15)
        count = sum(sweep is not None for sweep in sweeps)
        spectrum.plot(orders, np.sqrt(power / max(count, 1)), color=COLOR["error"])
        _mark_orders(spectrum, w.parameters.gearbox)
        spectrum.set_xlim(0.0, HIGHEST_ORDER)
        spectrum.set_ylim(bottom=0.0)
        spectrum.set_ylabel("amplitude [arcmin]")
        spectrum.set_xlabel("order [cycles per motor revolution]")
        figure.align_ylabels()
        yield Picture(
            f"imperfections{suffix}",
            "What the gearbox leaves: tracking error and its orders",
            "Above, the error of the column over its angle while the hand moves it steadily; below, its order "
            "spectrum. Lines at the stages' mesh orders come from the teeth passing each other; what is broad comes "
            "from friction.",
            figure,
        )


def _sweeps(angle: Array) -> tuple[slice | None, slice | None]:
    """Rows of the forward and of the backward sweep in a motion that turns round once; None where there is none."""
    turn = int(np.argmax(angle))
    least = len(angle) // 10
    forward = slice(int(np.argmin(angle[: turn + 1])), turn) if turn > least else None
    backward = slice(turn, turn + int(np.argmin(angle[turn:]))) if len(angle) - turn > least else None
    return forward, backward


def _order_amplitudes(motor_angle: Array, error: Array, orders: Array) -> Array:
    """Amplitude of ``error`` at ``orders`` [1/rev] of the motor: Fourier integral over its angle, Hann window."""
    way = np.sign(motor_angle[-1] - motor_angle[0])
    turns = np.maximum.accumulate(way * motor_angle) / (2.0 * np.pi)
    grid = np.linspace(turns[0], turns[-1], max(int((turns[-1] - turns[0]) * 4.0 * HIGHEST_ORDER), 16))
    rising = np.append(True, np.diff(turns) > 0.0)
    even = np.interp(grid, turns[rising], error[rising])
    x = np.linspace(-1.0, 1.0, len(grid))
    even -= np.polynomial.Polynomial.fit(x, even, 3)(x)  # the slow part, which is no order
    weight = np.hanning(len(grid))
    waves = np.exp(-2j * np.pi * np.outer(orders, grid - grid[0]))
    return np.asarray(2.0 * np.abs(waves @ (weight * even)) / weight.sum())


def _mark_orders(ax: Axes, box: Gearbox) -> None:
    """Lines at the mesh orders of the stages there are, and at twice each."""
    marks = [(order, f"stage {number}") for number, order in mesh_orders(box)]
    marks += [(2.0 * order, "2×") for order, _ in marks]
    for order, label in sorted(marks):
        ax.axvline(order, color=COLOR["muted"], lw=0.9, ls=(0, (2, 2)))
        ax.annotate(
            f" {label}", (order, 0.98), xycoords=("data", "axes fraction"), va="top", fontsize=9, color=COLOR["ink"]
        )


def mesh_orders(box: Gearbox) -> list[tuple[int, float]]:
    """Stage, and mesh order [cycles per motor revolution], of all stages with teeth.

    Each is the rate at which the input wheel's teeth pass: of a planetary stage the sun's, relative to its carrier.
    """
    found, turns = [], 1.0
    for number, stage in enumerate(box.in_use, start=1):
        passing = 1.0 - 1.0 / stage.ratio if stage.carried else 1.0
        if stage.teeth:
            found.append((number, stage.teeth * passing * turns))
        turns /= stage.ratio
    return found


# --- aft side --------------------------------------------------------------------------------------------------------


FLIGHT_POINTS = 200
"""Times at which a flight is read for a figure."""


def aft_side(run: RecordedRun) -> Picture:
    """Where surface and trim are, and what pulls at the column from behind, over the whole run."""
    w = run.whole
    times = np.linspace(w.time[0], w.time[-1], FLIGHT_POINTS)
    flown = [run.scenario.parameters_at(at).feel.flight for at in times.tolist()]
    airspeed, attack = np.array([f.airspeed for f in flown]), np.array([f.angle_of_attack for f in flown])
    faster = np.ptp(airspeed) > 0.0
    figure, (angle, torque, *below) = new_figure(
        3 if faster else 2, height=6.6 if faster else 5.6, shares=(1, 1.1, 0.45) if faster else (1, 1.1)
    )
    column, surface, trim = w["/feel.angle"] / DEG, w["/surface.deflection"] / DEG, w["/surface.trim"] / DEG
    together = bool(np.allclose(column, surface, rtol=0.0, atol=1e-6))
    if not together:
        angle.plot(*thin(w.time, surface), color=COLOR["third"], label="surface δ")
    label = "column and surface (model)" if together else "column (model)"
    angle.plot(*thin(w.time, column), "--", color=COLOR["model"], label=label)
    if np.ptp(trim) > 0.0:
        angle.plot(*thin(w.time, trim), ":", color=COLOR["expected"], label="trim")
    if np.ptp(attack) > 0.0:
        angle.plot(times, attack / DEG, "-.", color=COLOR["error"], lw=1.0, label="angle of attack α")
    angle.set_ylabel("angle [°]")
    drawn = []
    for signal, color, label, style in (
        ("/column.torque", "pilot", "pilot", "-"), ("/surface.cable_torque", "measured", "linkage", (0, (4, 3))),
        ("/surface.feel_torque", "model", "feel unit", "--"), ("/surface.autopilot_torque", "error", "autopilot", "-."),
        ("/surface.hinge_moment", "third", "hinge moment at the surface", (0, (1, 1))),
        ("/feel.own_torque", "expected", "the model's own", "-"),
    ):  # fmt: skip
        values = w[signal]
        if np.any(values != 0.0):  # an element that is not there has no curve
            width = 2.2 if color == "pilot" else 1.4  # what lies on it leaves its edges free
            torque.plot(*thin(w.time, values), ls=style, color=COLOR[color], lw=width, label=label)
            drawn.append(label)
    torque.set_ylabel("torque [N·m]")
    for ax in below:
        ax.plot(times, airspeed / KNOT, color=COLOR["third"])
        ax.set_ylabel("true airspeed\n[kt]")
    (below or [torque])[-1].set_xlabel("time [s]")
    for ax, room in ((angle, 0.15), (torque, 0.30)):
        legend(ax, columns=3, place="upper right")
        room_above(ax, room)
    _mark_changes(run, [angle, torque, *below])
    figure.align_ylabels()
    caption = (
        f"Angles, and the torques of {', '.join(drawn)}. Positive is forward; of feel unit and linkage it is what a "
        "hand has to push forward with."
    )
    if "the model's own" in drawn:
        caption += " The model's own are those of shaker, pusher, gusts, disturbances and weights."
    caption += " Upright lines are the changes of the run." if run.scenario.changes else ""
    return Picture("aft_side", "Behind the column", caption, figure)


# --- overview --------------------------------------------------------------------------------------------------------


def overview(run: RecordedRun) -> Picture:
    """The whole run at a glance."""
    w = run.whole
    figure, (angle, torque, drive, state) = new_figure(4, height=6.6, shares=(3, 3, 2.4, 1.1))
    for signal, color, label, style in (
        ("/column.angle", "measured", "column", "-"),
        ("/feel.angle", "model", run.set_label.removesuffix(" (set)"), "--"),
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
        room_above(ax, 0.12)
    _mark_changes(run, [angle, torque, drive])
    figure.align_ylabels()
    caption = "The whole run: what the hand did, what the column did, what the motor did; below, when power was on and "
    caption += "how tightly the hand gripped."
    caption += " Upright lines are the changes of the run." if run.scenario.changes else ""
    return Picture("overview", "The whole run", caption, figure)


MOST_LABELLED = 8
"""Changes that a figure says in words."""


def _mark_changes(run: RecordedRun, axes: Sequence[Axes]) -> None:
    """An upright line at each change of the run, with its number; above the first plot what changes."""
    changes = run.scenario.changes
    for number, change in enumerate(changes, start=1):
        for ax in axes:
            ax.axvline(change.at, ymax=0.86, color=COLOR["muted"], lw=0.8, ls=":")
        if len(changes) <= MOST_LABELLED:
            axes[0].annotate(
                f" {number}", (change.at, 0.86), xycoords=("data", "axes fraction"), va="top", fontsize=9,
                color=COLOR["ink"],
            )  # fmt: skip
    if 0 < len(changes) <= MOST_LABELLED:
        said = (f"{number} {_changed(change)}" for number, change in enumerate(changes, start=1))
        whole = "     ".join(change.replace(" ", "\N{NO-BREAK SPACE}") for change in said)
        title = "\n".join(textwrap.wrap(whole, 105, break_long_words=False))
        axes[0].set_title(title, fontsize=8.5, fontweight="normal", loc="left")


def _changed(change: Change) -> str:
    """A change in a few words."""
    units = numbers()
    said = [
        f"{key.removeprefix('feel.')} " + (f"{value:.3g} {units[key]}" if key in units else str(value).lower())
        for key, value in flat(change.parameters)
    ]
    said += [f"{what} {value}" for what, value in (("power", change.power), ("mode", change.mode)) if value]
    said += [f"{change.parameter.removeprefix('feel.')} as in {change.file}"] if change.parameter else []
    return printable(", ".join(said) + (f" over {change.over:g} s" if change.over else ""), 100)


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


Draw = Callable[[RecordedRun, Sequence[Span]], Iterator[Picture]]

_FIGURES: tuple[tuple[tuple[str, ...], str | None, Draw], ...] = (
    (("breakout_torque",), None, friction),
    (("hysteresis", "static_friction", "grip_force", "grip_friction", "grip_play_mm"), None, static),
    (("part60_tolerance_used",), None, released),
    (("tracking_amplitude_ratio", "tracking_phase_lag_ms"), None, tracking),
    (("oscillation_amplitude_deg", "oscillation_frequency_hz"), None, squeezing),
    (("tracking_ripple_deg",), None, imperfections),
    (("ripple",), "/column.velocity", evenness),
)
"""Metrics, the signal they are taken of if that matters, and the figure that shows what they measure."""
