"""Figures of the laboratory: Bode and Nyquist, the map, what helps."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from cls_bench.analysis.frequency import FrequencyResponse
from cls_bench.linear.hand import forward_inertia
from cls_bench.linear.variation import Variation
from cls_bench.report.style import COLOR, legend, new_figure
from cls_bench.stability.map import THESIS, StabilityMap, is_thesis
from cls_bench.stability.response import Measured
from cls_bench.stability.stabilisers import Least
from cls_bench.sweep.engine import Row

_TITLES = {
    "velocity-loop": "Velocity loop", "position-loop": "Position loop P", "outer-loop": "Outer loop G = M F P",
    "rendered-admittance": "Rendered admittance",
}  # fmt: skip


def _title(ax: Axes, text: str) -> None:
    ax.set_title(text, loc="left", fontsize=10.5, fontweight="bold")


def bode(measured: Measured, *, closed: bool) -> Figure:
    """Magnitude, phase and coherence of the closed response, or of the open loop; the linear model beside them."""
    response = measured.closed if closed else measured.open
    predicted = measured.predicted_closed if closed else measured.predicted_open
    if response is None:
        raise ValueError(f"{measured.loop} has no {'closed' if closed else 'open'} response")
    figure, (magnitude, phase, coherence) = new_figure(3, height=6.4, shares=(3, 3, 1))
    drawn = [(response, "measured", "-", "measured")]
    if predicted is not None:
        drawn.append((predicted, "expected", "--", "linear model"))
    for r, color, dashes, label in drawn:
        style: dict[str, Any] = {"color": COLOR[color], "linestyle": dashes, "label": label}
        if color == "measured":
            style |= {"marker": ".", "markersize": 5}
        magnitude.semilogx(r.frequency, r.decibel, **style)
        phase.semilogx(r.frequency, np.degrees(r.phase), **style)
    coherence.semilogx(response.frequency, response.coherence, color=COLOR["measured"], marker=".", markersize=4)
    coherence.set_ylim(-0.05, 1.05)
    kind = "closed" if closed else "open"
    _title(magnitude, f"{_TITLES[measured.loop]}, {kind}")
    magnitude.set_ylabel("magnitude [dB]")
    phase.set_ylabel("phase [°]")
    coherence.set_ylabel("coherence")
    coherence.set_xlabel("frequency [Hz]")
    crossover, _ = response.phase_crossover()
    if math.isfinite(crossover) and measured.loop != "rendered-admittance":
        for ax in (magnitude, phase):
            ax.axvline(crossover, color=COLOR["error"], linestyle=":", linewidth=1.2)
        phase.axhline(-180.0, color=COLOR["muted"], linewidth=0.8)
        magnitude.annotate(
            f"f₁₈₀ = {crossover:.0f} Hz", (crossover, 0.04), xycoords=("data", "axes fraction"),
            textcoords="offset points", xytext=(4, 0), color=COLOR["error"],
        )  # fmt: skip
    ticks = [f for f in (1, 2, 5, 10, 20, 50, 100, 200, 500) if response.frequency[0] <= f <= response.frequency[-1]]
    coherence.set_xticks(ticks, [str(f) for f in ticks])
    coherence.minorticks_off()
    legend(magnitude)
    return figure


def nyquist(measured: Measured) -> Figure:
    """The open loop in the complex plane, with the critical point and frequencies along the curve."""
    if measured.open is None:
        raise ValueError(f"{measured.loop} has no open loop")
    figure, (ax,) = new_figure(height=5.6)
    curves: list[tuple[FrequencyResponse, str, str, str]] = [(measured.open, "measured", "-", "measured")]
    if measured.predicted_open is not None:
        curves.append((measured.predicted_open, "expected", "--", "linear model"))
    for r, color, dashes, label in curves:
        ax.plot(r.value.real, r.value.imag, color=COLOR[color], linestyle=dashes, label=label)
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    ax.plot(np.cos(turn), np.sin(turn), color=COLOR["muted"], linewidth=0.8)
    ax.plot(-1.0, 0.0, "+", color=COLOR["error"], markersize=12, markeredgewidth=2, label="critical point −1")
    values = measured.open.value
    shown = np.flatnonzero((np.abs(values) > 0.25) & (np.abs(values) < 2.5))
    for k in shown[:: max(1, len(shown) // 7)]:
        ax.plot(values[k].real, values[k].imag, ".", color=COLOR["measured"], markersize=7)
        ax.annotate(
            f"{measured.open.frequency[k]:.0f} Hz", (values[k].real, values[k].imag), fontsize=8.5,
            textcoords="offset points", xytext=(5, 4), color=COLOR["muted"],
        )  # fmt: skip
    reach = 1.1 * min(max(1.0, float(np.abs(values).max())), 2.5)
    ax.set_xlim(-reach, reach)
    ax.set_ylim(-reach, reach)
    ax.set_aspect("equal", adjustable="box")
    _title(ax, f"{_TITLES[measured.loop]}, Nyquist plot")
    ax.set_xlabel("real part")
    ax.set_ylabel("imaginary part")
    legend(ax, place="upper right")
    return figure


def stability_map(result: StabilityMap) -> Figure:
    """Trials as points, the linear model's boundary, the line of Eq. 3.16 and the thesis's experiments."""
    grid = result.grid
    figure, (ax,) = new_figure(height=5.4)

    def along(axis: Variation, rows: list[Row]) -> list[float]:
        return [float(row.point[axis.name] or 0.0) for row in rows]

    count = len(grid.xs) * len(grid.ys)
    for stable, marker, color, label in ((True, "o", "third", "calms down"), (False, "s", "model", "oscillates")):
        rows = [row for row in result.rows[:count] if not row.error and row.values["stable"] == stable]
        style: dict[str, Any] = {"facecolors": "none"} if stable else {"color": COLOR[color]}
        ax.scatter(
            along(grid.x, rows), along(grid.y, rows),
            s=16, marker=marker, edgecolors=COLOR[color], linewidths=1.0, label=f"simulation {label}", **style,
        )  # fmt: skip
    failed = [row for row in result.rows[:count] if row.error]
    if failed:
        ax.scatter(
            along(grid.x, failed), along(grid.y, failed),
            s=16, marker="x", color=COLOR["muted"], label="not possible",
        )  # fmt: skip
    if result.growth.min() < 0.0 < result.growth.max():
        ax.contour(result.x_fine, result.y_fine, result.growth, levels=[0.0], colors=COLOR["ink"], linewidths=1.8)
        ax.plot([], [], color=COLOR["ink"], linewidth=1.8, label="boundary of the linear model")
    if result.rule_ratio is not None:
        ax.plot(
            grid.xs, result.rule_ratio * grid.xs, color=COLOR["error"], linestyle="--",
            label=f"Eq. 3.16: I_fwd / I_fcs = {result.rule_ratio:.2f}",
        )  # fmt: skip
    if grid.inertias and is_thesis(result.setup):
        here = forward_inertia(result.setup.parameters, result.setup.hand)
        for k, (inertia, seen) in enumerate(THESIS):
            ax.plot(
                inertia, here, "*", color=COLOR["pilot"], markersize=15, markeredgecolor=COLOR["ink"],
                markeredgewidth=0.8, label="thesis's experiments, squeezed grip" if k == 0 else None, zorder=5,
            )  # fmt: skip
            ax.annotate(
                seen, (inertia, here), textcoords="offset points", xytext=(0, 9), fontsize=8, ha="center",
                bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5}, zorder=6,
            )  # fmt: skip
    labels = {"feel.inertia": "simulated inertia I_fcs", "forward_inertia": "inertia forward of the load cell I_fwd"}
    for axis, variation, set_label, set_scale, set_limits in (
        (ax.xaxis, grid.x, ax.set_xlabel, ax.set_xscale, ax.set_xlim),
        (ax.yaxis, grid.y, ax.set_ylabel, ax.set_yscale, ax.set_ylim),
    ):
        set_label(f"{labels.get(variation.name, variation.name)} [{variation.unit}]")
        if variation.low > 0 and not variation.whole:
            set_scale("log")
            ticks = [t for t in (0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 1, 2, 5, 10, 20, 50)
                     if variation.low <= t <= variation.high]  # fmt: skip
            axis.set_ticks(ticks, [f"{t:g}" for t in ticks])
            axis.set_minor_locator(NullLocator())
            set_limits(variation.low / 1.05, variation.high * 1.05)
    _title(ax, "Stability of the outer loop")
    figure.legend(loc="outside lower center", ncols=2, fontsize=8.5, frameon=False)
    return figure


def stabilisers(found: list[Least], high: float) -> Figure:
    """Least stable inertia with each measure, simulated and predicted."""
    figure, (ax,) = new_figure(height=0.36 * len(found) + 1.6)
    place = np.arange(len(found))[::-1]
    base = found[0].simulated
    for row, y in zip(found, place, strict=True):
        ends = min(row.simulated, high)
        same = abs(row.simulated - base) <= 0.03 * base
        color = COLOR["expected" if same else "third" if row.simulated < base else "model"]
        ax.barh(y, ends, height=0.55, color=color)
        if math.isfinite(row.simulated):
            beyond = max(ends, row.predicted) if math.isfinite(row.predicted) else ends
            ax.annotate(
                f"{row.simulated:.3f}", (beyond, y), textcoords="offset points", xytext=(7, 0), va="center",
                fontsize=8.5,
            )  # fmt: skip
        else:
            ax.annotate(
                "unstable throughout", (0.0, y), textcoords="offset points", xytext=(7, 0), va="center",
                fontsize=8.5, color="white",
            )  # fmt: skip
        if math.isfinite(row.predicted) and row.predicted > 0:
            ax.plot(row.predicted, y, "D", color="white", markeredgecolor=COLOR["ink"], markersize=5.5)
    ax.plot([], [], "D", color="white", markeredgecolor=COLOR["ink"], markersize=5.5, label="linear model")
    ax.axvline(base, color=COLOR["muted"], linestyle=":", linewidth=1.2)
    ax.set_yticks(place, [row.name for row in found])
    ax.set_ylim(-0.7, len(found) - 0.3)
    ax.grid(visible=False, axis="y")
    finite = [value for row in found for value in (row.simulated, row.predicted) if math.isfinite(value)]
    ax.set_xlim(0.0, min(1.15 * high, 1.25 * max(finite)))
    ax.set_xlabel("least stable simulated inertia I_fcs, tight grip [kg·m²]")
    _title(ax, "What helps")
    legend(ax, place="upper right")
    return figure
