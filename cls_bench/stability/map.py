"""Stability over two quantities: a trial at every point of a grid, and beside it the linear model's boundary.

The trials run on all cores through the sweep machinery, are kept in a journal as they are done, and are continued
after an interruption.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cls_bench.linear.hand import forward_inertia
from cls_bench.linear.prediction import growth_rate, rule
from cls_bench.linear.variation import Setup, Variation, of_bare, variation
from cls_bench.parameters import Parameters
from cls_bench.stability import trial
from cls_bench.stability.trial import Standard
from cls_bench.sweep.core import Report, evaluate_points
from cls_bench.sweep.engine import Engine, Point, Row, Value

Array = NDArray[np.float64]

INERTIAS = ("feel.inertia", "forward_inertia")
"""The axes on which Eq. 3.16 is a line and the thesis's experiments are points."""

THESIS = ((0.30, "fig. 4.2"), (0.25, "4.6"), (0.15, "4.7"))
"""I_fcs [kg·m²] of the thesis's figures: stable, moderate and severe instability with a squeezed grip."""


@dataclass(frozen=True)
class Grid:
    """Two quantities and how finely they are covered."""

    x: Variation
    y: Variation
    columns: int = 20
    rows: int = 20

    def values(self, axis: Variation, count: int) -> Array:
        """Values of an axis: logarithmic where it does not start at 0, whole numbers where it takes no others."""
        if axis.whole:
            return np.unique(np.round(np.linspace(axis.low, axis.high, count)))
        if axis.low > 0:
            return np.geomspace(axis.low, axis.high, count)
        return np.linspace(axis.low, axis.high, count)

    @property
    def xs(self) -> Array:
        """Values along x."""
        return self.values(self.x, self.columns)

    @property
    def ys(self) -> Array:
        """Values along y."""
        return self.values(self.y, self.rows)

    @property
    def inertias(self) -> bool:
        """Whether the axes are the thesis's, I_fcs and I_fwd."""
        return (self.x.name, self.y.name) == INERTIAS


def default_grid(p: Parameters) -> Grid:
    """I_fcs from 0.1 to 1 and I_fwd from 0.05 to 1 kg·m² on the thesis's rig, in proportion to the column on others."""
    return Grid(
        variation("feel.inertia", of_bare(p, 2.5), of_bare(p, 25.0), of=p),
        variation("forward_inertia", of_bare(p, 1.3), of_bare(p, 25.0), of=p),
    )


def is_thesis(setup: Setup) -> bool:
    """Whether this is the rig of the thesis's experiments, which a change of its plant does not make another."""
    return setup.parameters.nameplate == Parameters().nameplate


@dataclass(frozen=True)
class Evaluate:
    """One trial of a grid's point, for the sweep machinery."""

    setup: Setup
    x: Variation
    y: Variation
    standard: Standard

    def __call__(self, point: Point) -> Mapping[str, Value]:
        """The trial's verdict as a row."""
        setup = self.x.apply(self.setup, float(point[self.x.name] or 0.0))
        verdict = trial.run(self.y.apply(setup, float(point[self.y.name] or 0.0)), self.standard)
        return {  # a table's cell has no NaN
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in asdict(verdict).items()
        }


@dataclass(frozen=True)
class StabilityMap:
    """A computed map."""

    setup: Setup
    grid: Grid
    rows: list[Row]
    """one trial each: the grid's points, x varying fastest, then the thesis's points if its axes are shown"""
    x_fine: Array
    y_fine: Array
    growth: Array
    """the linear model's growth rate [1/s], shape (y_fine, x_fine)"""
    rule_ratio: float | None
    """I_fwd / I_fcs of Eq. 3.16's line; None on other axes"""

    @property
    def agreement(self) -> float:
        """Share of the grid's points on which simulation and linear model agree."""
        right = 0
        judged = [row for row in self.rows[: len(self.grid.xs) * len(self.grid.ys)] if not row.error]
        for row in judged:
            x, y = float(row.point[self.grid.x.name] or 0), float(row.point[self.grid.y.name] or 0)
            setup = self.grid.y.apply(self.grid.x.apply(self.setup, x), y)
            right += (growth_rate(setup) < 0) == row.values["stable"]
        return right / len(judged) if judged else float("nan")


def compute(
    setup: Setup,
    grid: Grid | None = None,
    standard: Standard | None = None,
    *,
    journal: Path | None = None,
    resume: bool = False,
    scheduler: str | Engine = "threads",
    report: Report | None = None,
    say: Callable[[str], None] | None = None,
) -> StabilityMap:
    """Compute the map of ``setup``; ``journal``, ``resume``, ``scheduler``, ``say`` as in :func:`evaluate_points`.

    Raises InputError and OutputError.
    """
    grid, standard = grid or default_grid(setup.parameters), standard or Standard()
    points: list[Point] = [
        {grid.x.name: float(x), grid.y.name: float(y)} for y in grid.ys for x in grid.xs
    ]  # fmt: skip
    if grid.inertias and is_thesis(setup):
        here = forward_inertia(setup.parameters, setup.hand)
        points += [{grid.x.name: x, grid.y.name: here} for x, _ in THESIS]
    identity = repr((setup, standard))
    with threadpool_limits(1):  # the trials' small matrices gain nothing from BLAS threads, and the workers lose
        rows = evaluate_points(
            Evaluate(setup, grid.x, grid.y, standard), points,
            journal=journal, identity=identity, resume=resume, scheduler=scheduler, report=report,
            say=say,
        )  # fmt: skip
        x_fine = grid.values(grid.x, 3 * grid.columns)
        y_fine = grid.values(grid.y, 3 * grid.rows)
        growth = np.array(
            [[growth_rate(grid.y.apply(grid.x.apply(setup, float(x)), float(y))) for x in x_fine] for y in y_fine]
        )
    ratio = rule(setup).critical_ratio if grid.inertias else None
    return StabilityMap(setup, grid, rows, x_fine, y_fine, growth, ratio)


def table(result: StabilityMap) -> list[dict[str, Any]]:
    """The trials as a table: the point, the verdict, the linear model's growth rate there."""
    lines = []
    for row in result.rows:
        x, y = float(row.point[result.grid.x.name] or 0), float(row.point[result.grid.y.name] or 0)
        predicted = growth_rate(result.grid.y.apply(result.grid.x.apply(result.setup, x), y))
        lines.append({**row.point, **row.values, "predicted_growth": predicted, "error": row.error})
    return lines
