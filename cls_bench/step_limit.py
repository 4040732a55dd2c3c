"""Whether the plant's step can carry a set of parameters: the stability of its own integrator, checked before a run.

Semi-implicit Euler is stable only up to a stiffness of about 4 inertia/step², and less where dampers act, as all forces
are those of the step's start. The check writes one step of the small motions as a matrix and looks at its spectral
radius, at neutral and at both stops, with every contact closed or open and the hand off, loose or tight, each element
as stiff as it can get::

    v⁺ = v + h M⁻¹ (K i e_θ − Σ a (c gᵀq + d gᵀv) − Σ (σ0 z⁺ + σ1 v)),   q⁺ = q + h v⁺,   z⁺ = z + h v
    i⁺ = E i − (1 − E) K/R ω⁺,   E = exp(−h R/L)

a = g, but in a mesh that is driven: its friction follows its torque, and adds its loss to what the input shaft feels,
and half the torque where a drag that is less when back-driven grows to that when driving.
q are the angles of the shafts from motor to crank, of column and limb, z the bristle deflections of the stages and of
the bearing, i the motor current. The rod is a spring c = load_cell.stiffness between crank and column, g its levers.
"""

import itertools
import json
import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.kinematics import crank_from_column, rod_angle
from cls_bench.parameters import MOST_STAGES, PLANT, Parameters, leaves
from cls_bench.parameters.inertias import (
    bearing_damping,
    cell_damping,
    column_inertia,
    limb_inertia,
    mesh_damping,
    shaft_inertias,
)

Array = NDArray[np.float64]

MARGIN = 2.0
"""The step has to be stable at this multiple of its length, which leaves six steps to a period: ratios change with
position, and contacts open and close. Measured on 248 random rigs, many with undamped meshes, lossy up to self-locking,
and shaken from stop to stop: one diverges at 0.95 of the limit and none at 0.8; at half of it three vibrate up to twice
as much as with fine steps, undamped resonances that are shaken."""

MOST_SUBSTEPS = 64
"""Substeps that are tried."""

MOTOR = 0

_STAGE_SUSPECTS: tuple[tuple[str, float], ...] = (
    ("stiffness", 0.25), ("damping_ratio", 0.25), ("transmission_error", 0.25), ("inertia", 4.0), ("ratio", 0.5),
    ("efficiency", 1.25),
)  # fmt: skip

_SUSPECTS: tuple[tuple[str, float], ...] = (
    *((f"gearbox.stage{k}.{name}", factor) for k in range(1, MOST_STAGES + 1) for name, factor in _STAGE_SUSPECTS),
    ("gearbox.bristle_stiffness", 0.25), ("gearbox.bristle_damping", 0.25),
    ("load_cell.stiffness", 0.25), ("load_cell.damping_ratio", 0.25),
    ("column.bristle_stiffness", 0.25), ("column.viscous_friction", 0.25),
    ("column.stop_stiffness", 0.25), ("column.stop_damping", 0.25),
    *((f"limb.{name}", 0.25) for name in ("loose_stiffness", "tight_stiffness", "loose_damping", "tight_damping",
                                          "arm_stiffness", "arm_damping")),
    ("motor.torque_constant", 0.25), ("motor.resistance", 4.0), ("motor.rotor_inertia", 4.0),
    ("gearbox.input_inertia", 4.0), ("linkage.crank_inertia", 4.0), ("column.inertia", 4.0), ("limb.mass", 4.0),
    ("linkage.arm", 0.5), ("linkage.crank", 0.5), ("column.grip_height", 0.5), ("rates.current_cycle", 0.5),
)  # fmt: skip
"""Parameters that can be to blame, and the factor that would ease them."""


def unstable_parameter(p: Parameters) -> tuple[str, str] | None:
    """Key of the parameter to blame, and what is wrong with it, if the plant's step cannot carry ``p``; else None."""
    return _unstable_parameter(json.dumps(p.model_dump(include={*PLANT, "rates", "simulation"})))


@lru_cache(maxsize=256)  # file, sweep and bench all ask; what drive and PLC are like makes no difference
def _unstable_parameter(parameters: str) -> tuple[str, str] | None:
    p = Parameters.model_construct(**{
        name: type(getattr(_DEFAULT, name)).model_validate(values) for name, values in json.loads(parameters).items()
    })  # fmt: skip
    step = p.rates.current_cycle / p.simulation.substeps
    if _spectral_radius(p, step) <= _STABLE:
        return None
    key, factor = _blame(p, step)
    section, _, rest = key.partition(".")
    value, unit = next(
        (value, about["unit"]) for name, value, about in leaves(getattr(p, section)) if name == rest
    )
    enough = enough_substeps(p)
    return key, (
        f"{value:g}{'' if unit == '1' else ' ' + unit} is too {'high' if factor < 1.0 else 'low'} for a plant step of "
        f"{step * 1e6:g} µs, which would be unstable; "
        + (f"simulation.substeps = {enough} carries it" if enough else "no number of substeps carries it")
    )


def enough_substeps(p: Parameters) -> int | None:
    """The least number of substeps, from those of ``p`` on, that carry it; None if none do."""
    counts = range(p.simulation.substeps, MOST_SUBSTEPS + 1)
    return next((n for n in counts if _spectral_radius(p, p.rates.current_cycle / n) <= _STABLE), None)


def check_step(p: Parameters) -> None:
    """Raise :class:`InputError` with the parameter to blame if the plant's step cannot carry ``p``."""
    if (found := unstable_parameter(p)) is not None:
        raise InputError(f"parameters.{found[0]}: {found[1]}")


_DEFAULT = Parameters()

_STABLE = 1.0 + 1e-6
"""Spectral radius that passes: 1 is a free rotation, a double eigenvalue that rounding splits."""


class _Spring(NamedTuple):
    lever: Array  # g, (joints,)
    stiffness: float
    damping: float
    acting: Array | None = None  # a, where it is not g


class _Position(NamedTuple):
    """Where the linkage stands: levers of the rod's force about crank and column, and of a force across it [m]."""

    crank: float
    column: float
    across: float
    stopped: bool  # whether a stop block may act


class _Chain:
    """The inertias and what lies between them, as the plant steps them."""

    def __init__(self, p: Parameters):
        self.p = p
        self.stages = p.gearbox.in_use
        self.crank = len(self.stages)
        self.column, self.limb = self.crank + 1, self.crank + 2
        self.joints = self.crank + 3
        self.shafts = shaft_inertias(p)

    def positions(self) -> Iterator[_Position]:
        link, stop = self.p.linkage, self.p.column.stop_angle
        if link.kind == "none":
            yield from (_Position(link.arm, link.arm, 0.0, stopped) for stopped in (False, True))
            return
        bar = link.four_bar
        for column in (-stop, 0.0, stop):
            crank = crank_from_column(bar, column)
            rod = rod_angle(bar, crank, column)
            of_crank, of_column = crank + bar.crank_angle - rod, column + bar.arm_angle - rod
            yield _Position(
                bar.crank * math.cos(of_crank), bar.arm * math.cos(of_column), bar.arm * math.sin(of_column),
                column != 0.0,
            )  # fmt: skip

    def inertias(self, at: _Position) -> Array:
        p = self.p
        at_crank, far, _ = p.linkage.masses
        inertias = np.array([*self.shafts, column_inertia(p) + far * at.across**2, limb_inertia(p)])
        inertias[self.crank] += at_crank * p.linkage.crank**2 + far * at.crank**2
        return inertias

    def lever(self, places: Mapping[int, float]) -> Array:
        row = np.zeros(self.joints)
        for place, value in places.items():
            row[place] = value
        return row

    def meshes(self) -> list[_Spring]:
        springs = []
        for k, stage in enumerate(self.stages):
            damping = mesh_damping(stage, self.shafts[k], self.shafts[k + 1])
            slope = stage.transmission_error * stage.teeth
            behind = 1.0 + (slope if stage.carried else 0.0)
            lever = self.lever({k: 1.0 / stage.ratio + slope, k + 1: -behind})
            passing = 0.5 if stage.drag > 0.0 and stage.drag_ratio < 1.0 else 0.0  # of one drag into the other
            loss = (1.0 / stage.efficiency - 1.0 + passing) * (1.0 + stage.ripple)
            acting = lever + self.lever({k: loss / stage.ratio})
            springs.append(_Spring(lever, stage.stiffness, damping, acting))
        return springs

    def grips(self) -> list[_Spring]:
        limb, area = self.p.limb, self.p.column.grip_height**2
        between = self.lever({self.limb: 1.0, self.column: -1.0})
        return [
            _Spring(between, area * stiffness, area * damping)
            for stiffness, damping in (
                (0.0, 0.0), (limb.loose_stiffness, limb.loose_damping), (limb.tight_stiffness, limb.tight_damping),
            )
        ]  # fmt: skip

    def configurations(self, at: _Position) -> Iterator[list[_Spring]]:
        """All states of contacts and hand with the linkage as it stands."""
        p, area = self.p, self.p.column.grip_height**2
        between = self.lever({self.crank: -at.crank, self.column: at.column})
        cell = _Spring(between, p.load_cell.stiffness, cell_damping(p))
        on_column = self.lever({self.column: 1.0})
        bearing = _Spring(on_column, 0.0, p.column.viscous_friction)
        stop = _Spring(on_column, p.column.stop_stiffness, p.column.stop_damping)
        arm = _Spring(self.lever({self.limb: 1.0}), area * p.limb.arm_stiffness, area * p.limb.arm_damping)
        meshes = self.meshes()
        stopped = ([], [stop]) if at.stopped else ([],)
        for closed in itertools.product((True, False), repeat=len(meshes)):
            touching = list(itertools.compress(meshes, closed))
            for block, grip in itertools.product(stopped, self.grips()):
                yield [cell, bearing, arm, grip, *touching, *block]

    def one_step(self, at: _Position, springs: list[_Spring], step: float) -> Array:
        """Matrix of one step for the state (q, v, z, i)."""
        p, n = self.p, self.joints
        inertia = self.inertias(at)
        bristles = [(k, p.gearbox.bristle_stiffness, p.gearbox.bristle_damping) for k in range(len(self.stages))]
        bristles.append((self.column, p.column.bristle_stiffness, bearing_damping(p)))
        size = 2 * n + len(bristles) + 1
        current = size - 1
        force = np.zeros((n, size))
        for spring in springs:
            coupling = np.outer(spring.lever if spring.acting is None else spring.acting, spring.lever)
            force[:, :n] -= spring.stiffness * coupling
            force[:, n : 2 * n] -= spring.damping * coupling
        for number, (joint, stiffness, damping) in enumerate(bristles):
            force[joint, 2 * n + number] -= stiffness
            force[joint, n + joint] -= damping + stiffness * step  # the bristle goes on before it pulls
        force[MOTOR, current] += p.motor.torque_constant
        matrix = np.eye(size)
        matrix[n : 2 * n] += step * force / inertia[:, None]
        matrix[:n] += step * matrix[n : 2 * n]
        for number, (joint, _, _) in enumerate(bristles):
            matrix[2 * n + number, n + joint] = step
        decay = math.exp(-step * p.motor.resistance / p.motor.inductance)
        matrix[current] = -(1.0 - decay) * p.motor.torque_constant / p.motor.resistance * matrix[n + MOTOR]
        matrix[current, current] += decay
        return matrix


def _spectral_radius(p: Parameters, step: float) -> float:
    """Largest magnitude of the one-step map's eigenvalues over all positions and states of contacts and hand."""
    chain = _Chain(p)
    maps = [
        chain.one_step(at, springs, MARGIN * step)
        for at in chain.positions() for springs in chain.configurations(at)
    ]  # fmt: skip
    stacked = np.array(maps)
    if not np.all(np.isfinite(stacked)):
        return math.inf
    return float(np.max(np.abs(np.linalg.eigvals(stacked))))


def _blame(p: Parameters, step: float) -> tuple[str, float]:
    """The parameter whose easing calms the step most, and the factor that eased it.

    The defaults are stable, so one of those that differ from them is to blame.
    """
    sections = (*PLANT, "rates")
    default = {key: value for name in sections for key, value, _ in leaves(getattr(_DEFAULT, name), f"{name}.")}
    present = {key: value for name in sections for key, value, _ in leaves(getattr(p, name), f"{name}.")}
    unused = tuple(f"gearbox.stage{k}." for k in range(p.gearbox.stages + 1, MOST_STAGES + 1))
    known = [suspect for suspect in _SUSPECTS if not suspect[0].startswith(unused or "?")]
    suspects = [suspect for suspect in known if present[suspect[0]] != default[suspect[0]]] or known

    def eased(suspect: tuple[str, float]) -> float:
        scaled = _scaled(p, *suspect)
        shorter = suspect[1] if suspect[0] == "rates.current_cycle" else 1.0
        return _spectral_radius(scaled, shorter * step)

    return min(suspects, key=eased)


def _scaled(p: Parameters, key: str, factor: float) -> Parameters:
    """A copy of ``p`` with one parameter scaled, unchecked: it is only looked at."""

    def changed(section: Any, path: list[str]) -> Any:
        inner = getattr(section, path[0])
        return section.model_copy(update={path[0]: inner * factor if len(path) == 1 else changed(inner, path[1:])})

    scaled: Parameters = changed(p, key.split("."))
    return scaled
