"""What helps: the least inertia that can be rendered with a squeezed grip, with and without each stabiliser.

The measures are those a designer of an admittance control has (compare the guidelines of Keemink, van der Kooij &
Stienen, "Admittance control for physical human-robot interaction", Int. J. Robotics Research 37, 2018).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from threadpoolctl import threadpool_limits

from cls_bench.errors import InputError
from cls_bench.linear.cycle import Compensation
from cls_bench.linear.hand import forward_inertia
from cls_bench.linear.prediction import growth_rate
from cls_bench.linear.variation import Setup, changed, of_bare, variation
from cls_bench.parameters import Parameters
from cls_bench.stability import onset
from cls_bench.stability.trial import Standard
from cls_bench.sweep.core import Report, evaluate_points
from cls_bench.sweep.engine import Engine, Point, Value


@dataclass(frozen=True)
class Stabiliser:
    """A change of the controller."""

    name: str
    changes: Mapping[str, Any]
    """parameters by dotted key"""
    compensation: Callable[[Setup], Compensation] | None = None

    def apply(self, setup: Setup) -> Setup:
        """``setup`` with the measure taken."""
        p = setup.parameters
        for key, value in self.changes.items():
            p = changed(p, key, value)
        return Setup(p, setup.hand)


def _half_of_forward(setup: Setup) -> Compensation:
    return Compensation(0.5 * forward_inertia(setup.parameters, setup.hand), 0.002)


def stabilisers(p: Parameters) -> tuple[Stabiliser, ...]:
    """Each measure alone; the sizes are examples a designer would try first, in proportion to the gains of ``p``."""
    position, velocity = p.drive.position_bandwidth, p.drive.velocity_bandwidth

    def bandwidth(which: str, now: float, factor: float) -> Stabiliser:
        value = float(f"{factor * now:.1e}")
        name = f"{which} controller {value:g} instead of {now:g} Hz"
        return Stabiliser(name, {f"drive.{which}_bandwidth": value})

    def damping(factor: float) -> Stabiliser:
        value = float(f"{factor * max(p.feel.damping, 0.1):.1e}")
        return Stabiliser(f"virtual damping {value:g} N·m·s/rad", {"feel.damping": value})

    return (
        Stabiliser("none", {}),
        Stabiliser("feed-forward of the set velocity", {"drive.feed_forward_velocity": True}),
        Stabiliser("feed-forward of the pilot's torque", {"drive.feed_forward_pilot": True}),
        Stabiliser("feed-forward of velocity and inertia", {
            "drive.feed_forward_velocity": True, "drive.feed_forward_inertia": True,
        }),
        Stabiliser("velocity loop instead of position loop", {"plc.outer_loop": "velocity"}),
        Stabiliser("force filter 100 Hz", {"load_cell.filter_bandwidth": 100.0}),
        Stabiliser("force filter 20 Hz", {"load_cell.filter_bandwidth": 20.0}),
        damping(10.0 / 3.0),
        damping(10.0),
        Stabiliser("half of I_fwd compensated, 2 ms filter", {}, _half_of_forward),
        bandwidth("position", position, 0.57),
        bandwidth("position", position, 1.7),
        bandwidth("velocity", velocity, 0.7),
        bandwidth("velocity", velocity, 1.5),
    )  # fmt: skip


def search_range(p: Parameters) -> tuple[float, float]:
    """Range in which the least stable inertia is searched [kg·m²]: 0.02 to 2 on the thesis's rig."""
    return of_bare(p, 0.5), of_bare(p, 50.0)


@dataclass(frozen=True)
class Least:
    """Least inertia that is stable with a measure taken [kg·m²]; 0 if the whole range is stable, inf if none of it."""

    name: str
    simulated: float
    predicted: float
    frequency: float | None
    """of the oscillation at the onset [Hz]"""


@dataclass(frozen=True)
class _Search:
    setup: Setup
    standard: Standard | None

    def __call__(self, point: Point) -> Mapping[str, Value]:
        (chosen,) = (s for s in stabilisers(self.setup.parameters) if s.name == point["measure"])
        setup = chosen.apply(self.setup)
        compensation = chosen.compensation(setup) if chosen.compensation else None
        vary = variation("feel.inertia", *search_range(self.setup.parameters), of=setup.parameters)
        found = onset.find(setup, vary, self.standard, compensation=compensation, follow=False)
        predicted = found.predicted
        if predicted is None:
            predicted = 0.0 if growth_rate(vary.apply(setup, vary.low), compensation) < 0 else math.inf
        simulated = found.value
        if simulated is None:
            simulated = math.inf if found.stable_at is None else 0.0
        last = found.last_unstable
        return {"simulated": simulated, "predicted": predicted, "frequency": last.frequency if last else None}


def compare(
    setup: Setup,
    standard: Standard | None = None,
    *,
    measures: Sequence[Stabiliser] | None = None,
    scheduler: str | Engine = "threads",
    report: Report | None = None,
) -> list[Least]:
    """Least stable I_fcs of ``setup`` with each of ``measures``, a choice of its :func:`stabilisers`; else all."""
    measures = stabilisers(setup.parameters) if measures is None else measures
    with threadpool_limits(1):
        rows = evaluate_points(
            _Search(setup, standard), [{"measure": s.name} for s in measures],
            scheduler=scheduler, report=report,
        )  # fmt: skip
    for row in rows:
        if row.error:
            raise InputError(f"{row.point['measure']}: {row.error}")
    found = []
    for row in rows:
        frequency = row.values["frequency"]
        found.append(
            Least(
                str(row.point["measure"]), float(row.values["simulated"] or 0), float(row.values["predicted"] or 0),
                None if frequency is None else float(frequency),
            )
        )  # fmt: skip
    return found
