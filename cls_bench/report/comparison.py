"""Two runs beside each other: their metrics, their parameters, and chosen signals laid over each other."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cls_bench.analysis.window import Array, Window, on_axis, split_signal, unit_of
from cls_bench.errors import InputError, one_line
from cls_bench.parameters import DEG, leaves
from cls_bench.report.figures import Picture
from cls_bench.report.recorded_run import RecordedRun, Span
from cls_bench.report.style import COLOR, legend, new_figure, room_above, thin
from cls_bench.text import printable

SIGNALS = ("/column.angle", "/load_cell.torque", "/drive.torque")
"""Signals of an axis that are compared unless others are named."""


def signals_of(run: RecordedRun) -> list[str]:
    """:data:`SIGNALS` of all axes of a run."""
    return [on_axis(signal, axis) for axis in run.axes for signal in SIGNALS]


@dataclass(frozen=True)
class Difference:
    """A metric of two runs."""

    name: str
    unit: str
    first: float
    second: float

    @property
    def change(self) -> float:
        """Second less first."""
        return self.second - self.first

    @property
    def relative(self) -> float:
        """Change as a part of the first value; NaN if that is 0."""
        return self.change / abs(self.first) if self.first else math.nan


def differences(first: RecordedRun, second: RecordedRun) -> list[Difference]:
    """The metrics that both runs measure under one name and in one unit, in the first's order."""
    others = {result.check.name: result for result in second.checks}
    return [
        Difference(result.check.name, result.unit, result.value, others[result.check.name].value)
        for result in first.checks
        if result.check.name in others and others[result.check.name].unit == result.unit
    ]


def parameter_differences(first: RecordedRun, second: RecordedRun) -> list[tuple[str, Any, Any, str]]:
    """Key, both values at the start and unit of all parameters that differ."""
    others = {key: value for key, value, _ in leaves(second.scenario.parameters_at_start())}
    found = leaves(first.scenario.parameters_at_start())
    return [(key, value, others[key], about["unit"]) for key, value, about in found if value != others[key]]


def controller_differences(first: RecordedRun, second: RecordedRun) -> list[tuple[str, str, str]]:
    """What both recordings say of the controller that ran, where they differ: name, source, hash, arguments."""
    a, b = first.recording.metadata, second.recording.metadata
    keys = sorted(key for key in {*a, *b} if key.startswith("controller."))
    names = {"controller.name": (first.controller, second.controller)}
    pairs = [(key, *names.get(key, (a.get(key, "–"), b.get(key, "–")))) for key in keys]
    return [(key.partition(".")[2], one_line(x), one_line(y)) for key, x, y in pairs if x != y]


def overlays(
    first: RecordedRun, second: RecordedRun, signals: Sequence[str], span: Span | None, left_out: list[str]
) -> Iterator[Picture]:
    """Each of ``signals`` of both runs over time, and their difference. InputError for an unknown signal.

    ``span`` limits the time [s]; by default it is what both runs recorded. Signals that one of the runs does not hold,
    or not at the PLC's rate, are named in ``left_out`` with the file and the reason.
    """
    common = Span(0.0, min(first.duration, second.duration))
    span = common if span is None else Span(max(span.start, 0.0), min(span.end, common.end))
    if not span.start < span.end:
        raise InputError(f"both runs last {common.end:g} s; there is nothing from {span.start:g} to {span.end:g} s")
    for signal in signals:
        topic, name = split_signal(signal)
        scale, unit = _shown(unit_of(signal))
        windows = first.window(span), second.window(span)
        missing = [line for run in (first, second) if (line := _missing(run, signal, span))]
        if missing:
            left_out.append(f"{signal}: {'; '.join(dict.fromkeys(missing))}")
            continue
        time, a, b = _together(*windows, signal)
        a, b, rows = a / scale, b / scale, len(time)
        figure, (ax, below) = new_figure(2, height=4.8, shares=(3, 1.4))
        ax.plot(*thin(time, a), color=COLOR["measured"], lw=2.4, label="A")
        ax.plot(*thin(time, b), color=COLOR["model"], lw=1.0, label="B")
        ax.set_ylabel(f"{name.replace('_', ' ')} [{unit}]")
        legend(ax, columns=2, place="upper right")
        room_above(ax, 0.15)
        below.plot(*thin(time, b - a), color=COLOR["error"])
        below.set_ylabel(f"B − A [{unit}]")
        below.set_xlabel("time [s]")
        figure.align_ylabels()
        both = ~np.isnan(b - a)
        r_m_s = float(np.sqrt(np.mean((b - a)[both] ** 2))) if both.any() else math.nan
        caption = f"A and B over each other; below, their difference, {r_m_s:.3g} {unit} r.m.s."
        if windows[0].rate != windows[1].rate:
            fast = max(window.rate for window in windows)
            caption += f" The one with {fast:g} samples a second is interpolated at the other's times."
        if not both.all():
            caption += f" {np.count_nonzero(~both)} of {rows} samples are missing and left out."
        yield Picture(f"{topic.strip('/').replace('/', '_')}_{name}", signal, caption, figure)


def _together(first: Window, second: Window, signal: str) -> tuple[Array, Array, Array]:
    """Times, and a signal of both windows at them: those of the one that has fewer samples a second."""
    if first.clock.time(first.clock.plc_ticks) == second.clock.time(second.clock.plc_ticks):
        rows = min(first.rows, second.rows)
        return first.time[:rows], first[signal][:rows], second[signal][:rows]
    slow, fast = (first, second) if first.rate < second.rate else (second, first)
    time = slow.time[slow.time <= fast.time[-1]] if fast.rows else slow.time[:0]
    own, other = slow[signal][: len(time)], np.interp(time, fast.time, fast[signal])
    return (time, own, other) if slow is first else (time, other, own)


def _missing(run: RecordedRun, signal: str, span: Span) -> str:
    """Why ``signal`` of ``run`` cannot be drawn, with the file's name; empty if it can."""
    try:
        run.window(span)[signal]
    except InputError as error:
        file, reason = str(run.path), printable(str(error), 300)
        return reason if reason.startswith(file) else f"{file}: {reason}"
    return ""


def _shown(unit: str) -> tuple[float, str]:
    """What a unit is shown in: SI value of that, and its name."""
    return {"rad": (DEG, "°"), "rad/s": (DEG, "°/s")}.get(unit, (1.0, unit))
