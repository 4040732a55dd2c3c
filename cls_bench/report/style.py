"""How figures look: one set of colours with meanings, in light, in dark and in print.

The colours are Okabe and Ito's, which colour-blind people can tell apart; lines that share a plot also differ in their
dashes. Inline SVG takes its colours from the page's style sheet, so that a dark page gets light ink.
"""

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cls_bench.claims import replaced, write_text

Array = NDArray[np.float64]


class Shade(NamedTuple):
    """A colour on white and on dark paper."""

    light: str
    dark: str


SHADES: Mapping[str, Shade] = {
    "ink": Shade("#1b2026", "#e4e8ec"),
    "muted": Shade("#5a6672", "#9aa6b2"),
    "grid": Shade("#dde2e7", "#333c46"),
    "measured": Shade("#0072b2", "#56b4e9"),  # the column, and what the load cell says
    "model": Shade("#d55e00", "#ff9a57"),  # the feel model: what the controller asks for
    "pilot": Shade("#b97a00", "#e6a520"),  # hand and grip
    "expected": Shade("#3d4751", "#c3ccd4"),  # independent solutions
    "error": Shade("#8e3b76", "#d98ac0"),
    "power_off": Shade("#c44d01", "#f08a4b"),
    "third": Shade("#00805d", "#2fc79d"),
    "band": Shade("#e8edf2", "#232b34"),
}
"""Colours by meaning."""

COLOR: Mapping[str, str] = {name: shade.light for name, shade in SHADES.items()}
"""The colours on white."""

WIDTH, HEIGHT = 7.6, 4.2
"""Size of a figure [in]."""

PIXELS = 1600
"""Samples of a curve are thinned to about so many columns; more cannot be seen."""

_RC: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": COLOR["muted"],
    "axes.labelcolor": COLOR["ink"],
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": COLOR["grid"],
    "grid.linewidth": 0.8,
    "text.color": COLOR["ink"],
    "xtick.color": COLOR["muted"],
    "ytick.color": COLOR["muted"],
    "xtick.labelcolor": COLOR["ink"],
    "ytick.labelcolor": COLOR["ink"],
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "path.simplify": True,
    "path.simplify_threshold": 0.3,
}


def new_figure(
    rows: int = 1, *, height: float = HEIGHT, shares: tuple[float, ...] | None = None
) -> tuple[Figure, list[Axes]]:
    """A figure with plots above each other on one common x axis."""
    with mpl.rc_context(_RC):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        grid = {"height_ratios": shares} if shares else None
        axes = figure.subplots(rows, 1, sharex=True, squeeze=False, gridspec_kw=grid)[:, 0]
        for ax in axes[:-1]:
            ax.tick_params(labelbottom=False)
    return figure, list(axes)


def new_pair(*, height: float = HEIGHT, shares: tuple[float, float] = (1, 1)) -> tuple[Figure, list[Axes]]:
    """A figure with two independent plots above each other."""
    with mpl.rc_context(_RC):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        axes = figure.subplots(2, 1, squeeze=False, gridspec_kw={"height_ratios": shares})[:, 0]
    return figure, list(axes)


def legend(ax: Axes, *, columns: int = 1, place: Any = "best") -> None:
    """The legend of a plot."""
    with mpl.rc_context(_RC):
        ax.legend(ncols=columns, loc=place)


def torque_axes(ax: Axes, height: float, label: str) -> None:
    """Torque over the column's angle, with the force at a grip of ``height`` [m] on the right."""
    ax.set_xlabel("column angle φ [°]")
    ax.set_ylabel(label)
    scales: tuple[Any, Any] = (lambda torque: torque / height, lambda force: force * height)
    side = ax.secondary_yaxis("right", functions=scales)
    side.set_ylabel("as a force at the grip [N]", color=COLOR["ink"])
    side.tick_params(color=COLOR["muted"], labelcolor=COLOR["ink"])
    side.spines["right"].set_color(COLOR["muted"])


def room_above(ax: Axes, share: float) -> None:
    """Extend the y axis upwards by ``share`` of its length, for a legend."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + share * (high - low))


def thin(x: Array, y: Array) -> tuple[Array, Array]:
    """A curve over time by the least and the greatest of each of :data:`PIXELS` stretches: peaks are kept.

    NaN is a gap, and so is a stretch of nothing else.
    """
    size = len(x) // PIXELS
    if size < 3:
        return x, y
    rows = len(x) // size
    parts = y[: rows * size].reshape(rows, size)
    first = np.arange(rows) * size
    gaps = np.isnan(parts)
    extremes = [np.where(gaps, np.inf, parts).argmin(axis=1), np.where(gaps, -np.inf, parts).argmax(axis=1)]
    extremes += [gaps.argmax(axis=1)] if gaps.any() else []
    picks = np.unique(np.concatenate([[0], (first + np.stack(extremes)).ravel(), [len(x) - 1]]))
    return x[picks], y[picks]


def thin_path(x: Array, y: Array) -> tuple[Array, Array]:
    """A curve in the plane: of the points in a column of pixels the first, least, greatest and last; no NaN."""
    there = np.isfinite(x) & np.isfinite(y)
    x, y = (x, y) if there.all() else (x[there], y[there])
    if len(x) <= PIXELS:
        return x, y
    span = float(np.ptp(x)) or 1.0
    column = np.round((x - x.min()) / span * 0.5 * PIXELS).astype(np.int64)
    group = np.append(0, np.cumsum(np.diff(column) != 0))
    ends = np.flatnonzero(np.append(np.diff(group), 1))
    starts = np.append(0, ends[:-1] + 1)
    by_height = np.lexsort((y, group))  # within each group from least to greatest
    picks = np.unique(np.concatenate([starts, ends, by_height[starts], by_height[ends]]))
    return x[picks], y[picks]


def svg(figure: Figure, name: str) -> str:
    """The figure as an SVG document without background; ``name`` is unique on the page that will show it."""
    buffer = io.StringIO()
    with mpl.rc_context({**_RC, "svg.hashsalt": name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def inline(document: str) -> str:
    """An SVG document as an element of a page: as wide as there is room, its colours the page's variables."""
    text = document[document.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*"', "<g", text)  # they repeat from figure to figure, and no one refers to them
    head, rest = text.split(">", 1)
    text = re.sub(r' (width|height)="[^"]*"', "", head) + ">" + rest
    for key, shade in SHADES.items():
        text = text.replace(shade.light, f"var(--{key})")
    return text


def save(figure: Figure, stem: Path, document: str | None = None) -> tuple[Path, Path]:
    """Write ``stem.svg`` and ``stem.png`` on white paper; returns both paths. Raises OSError.

    ``document`` is what :func:`svg` gave for the figure, if that was called already.
    """
    svg_path, png_path = stem.with_name(f"{stem.name}.svg"), stem.with_name(f"{stem.name}.png")
    document = document or svg(figure, stem.name)
    write_text(svg_path, document.replace("<svg ", '<svg style="background: white" ', 1))
    save_png(figure, png_path)
    return svg_path, png_path


def save_png(figure: Figure, path: Path) -> None:
    """Write the figure on white paper. Raises OSError."""
    figure.set_facecolor("white")
    try:
        with mpl.rc_context({**_RC, "savefig.facecolor": "auto"}), replaced(path) as file:
            figure.savefig(file, dpi=160, metadata={"Software": None}, format=path.suffix[1:])
    finally:
        figure.set_facecolor("none")
