"""Whether the plant's step can carry a set of parameters: the stability of its own integrator, checked before a run.

Semi-implicit Euler is stable only up to a stiffness of about 4 inertia/step², and less where dampers act. The check
writes one step of the small motions about neutral as a matrix and looks at its spectral radius, with every contact
closed or open and the hand off, loose or tight, each element as stiff as it can get::

    v⁺ = v + h M⁻¹ (K i e_θ − Σ g (c gᵀq + d gᵀv) − Σ (σ0 z + σ1 v)),   q⁺ = q + h v⁺,   z⁺ = z + h v
    i⁺ = E i − (1 − E) K/R ω,   E = exp(−h R/L)

q are the angles of motor, carrier 1, crank, column and limb, z the three bristle deflections, i the motor current.
"""

import itertools
import math
from collections.abc import Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.errors import InputError
from cls_bench.parameters import Parameters, leaves
from cls_bench.signals import TICK_S

Array = NDArray[np.float64]

MARGIN = 2.5
"""The step has to be stable at this multiple of its length, which leaves eight steps to a period: ratios change with
position, and contacts that open and close pump energy into an undamped mode of fewer steps (measured: seven)."""

ROD_END = 0.7
"""Greatest stiffness · step² / mass of the rod end on the load cell. The joint that closes the linkage is two steps
soft, so within a step the rod end swings on the cell alone; measured: runs diverge above 1.0, none does at 0.8."""

MOTOR, CARRIER1, CRANK, COLUMN, LIMB = range(5)

_SUSPECTS: tuple[tuple[str, float], ...] = (
    *((f"gearbox.{stage}.{name}", 0.25) for stage in ("stage1", "stage2")
      for name in ("stiffness", "damping_ratio", "transmission_error")),
    ("gearbox.bristle_stiffness", 0.25), ("gearbox.bristle_damping", 0.25),
    ("load_cell.stiffness", 0.25), ("load_cell.damping_ratio", 0.25),
    ("column.bristle_stiffness", 0.25), ("column.viscous_friction", 0.25),
    ("column.stop_stiffness", 0.25), ("column.stop_damping", 0.25),
    *((f"limb.{name}", 0.25) for name in ("loose_stiffness", "tight_stiffness", "loose_damping", "tight_damping",
                                          "arm_stiffness", "arm_damping")),
    ("motor.torque_constant", 0.25), ("motor.resistance", 4.0),
    ("motor.rotor_inertia", 4.0), ("gearbox.input_inertia", 4.0), ("gearbox.carrier1_inertia", 4.0),
    ("gearbox.carrier2_inertia", 4.0), ("linkage.crank_inertia", 4.0), ("column.inertia", 4.0), ("limb.mass", 4.0),
    ("linkage.rod_end_mass", 4.0),
    ("linkage.arm", 0.5), ("linkage.crank", 0.5), ("gearbox.ratio", 0.5), ("column.grip_height", 0.5),
)  # fmt: skip
"""Parameters that can be to blame, and the factor that would ease them."""


class _Spring(NamedTuple):
    lever: Array  # (5,)
    stiffness: float
    damping: float


def unstable_parameter(p: Parameters) -> tuple[str, str] | None:
    """Key of the parameter to blame, and what is wrong with it, if the plant's step cannot carry ``p``; else None."""
    return _unstable_parameter(p.model_dump_json())


@lru_cache(maxsize=64)  # file, sweep and bench all ask
def _unstable_parameter(parameters: str) -> tuple[str, str] | None:
    p = Parameters.model_validate_json(parameters)
    step = TICK_S / p.simulation.substeps
    if _spectral_radius(p, step) <= _STABLE:
        return None
    key, factor = _blame(p, step)
    value, unit = next((value, about["unit"]) for name, value, about in leaves(p) if name == key)
    enough = next((n for n in range(p.simulation.substeps + 1, 65) if _spectral_radius(p, TICK_S / n) <= _STABLE), None)
    return key, (
        f"{value:g}{'' if unit == '1' else ' ' + unit} is too {'high' if factor < 1.0 else 'low'} for a plant step of "
        f"{step * 1e6:g} µs, which would be unstable; "
        + (f"simulation.substeps = {enough} carries it" if enough else "no number of substeps carries it")
    )


def check_step(p: Parameters) -> None:
    """Raise :class:`InputError` with the parameter to blame if the plant's step cannot carry ``p``."""
    if (found := unstable_parameter(p)) is not None:
        raise InputError(f"parameters.{found[0]}: {found[1]}")


_STABLE = 1.0 + 1e-6
"""Spectral radius that passes: 1 is a free rotation, a double eigenvalue that rounding splits."""


def _spectral_radius(p: Parameters, step: float) -> float:
    """Largest magnitude of the one-step map's eigenvalues over all states of contacts and hand.

    Or the rod end's stiffness over what is allowed, if that is greater and above 1.
    """
    worst = p.load_cell.stiffness * step**2 / (ROD_END * p.linkage.rod_end_mass)
    for springs in _configurations(p):
        matrix = _one_step(p, springs, MARGIN * step)
        if not np.all(np.isfinite(matrix)):
            return math.inf
        worst = max(worst, float(np.max(np.abs(np.linalg.eigvals(matrix)))))
    return worst


def _configurations(p: Parameters) -> Iterator[list[_Spring]]:
    box, link, column, limb = p.gearbox, p.linkage, p.column, p.limb
    inertia = _inertias(p)

    def lever(**joints: float) -> Array:
        row = np.zeros(5)
        for name, value in joints.items():
            row[{"motor": MOTOR, "carrier1": CARRIER1, "crank": CRANK, "column": COLUMN, "limb": LIMB}[name]] = value
        return row

    def mesh(stage: str, before: str, behind: str, j_before: float, j_behind: float) -> _Spring:
        s = getattr(box, stage)
        j = j_before * box.ratio**2
        damping = 2.0 * s.damping_ratio * math.sqrt(s.stiffness * j * j_behind / (j + j_behind))
        slope = s.transmission_error * s.sun_teeth
        return _Spring(lever(**{before: 1.0 / box.ratio + slope, behind: -1.0 - slope}), s.stiffness, damping)

    crank = link.crank_inertia + box.carrier2_inertia
    stage1 = mesh("stage1", "motor", "carrier1", inertia[MOTOR], inertia[CARRIER1])
    stage2 = mesh("stage2", "carrier1", "crank", inertia[CARRIER1], crank)
    cell = _Spring(
        lever(crank=-link.crank, column=link.arm), p.load_cell.stiffness,
        2.0 * p.load_cell.damping_ratio
        * math.sqrt(p.load_cell.stiffness * (link.rod_end_mass + column.inertia / link.arm**2)),
    )  # fmt: skip
    stops = _Spring(lever(column=1.0), column.stop_stiffness, column.stop_damping)
    bearing = _Spring(lever(column=1.0), 0.0, column.viscous_friction)
    area = column.grip_height**2
    arm = _Spring(lever(limb=1.0), area * limb.arm_stiffness, area * limb.arm_damping)
    grips = [
        _Spring(lever(limb=1.0, column=-1.0), area * stiffness, area * damping)
        for stiffness, damping in (
            (0.0, 0.0), (limb.loose_stiffness, limb.loose_damping), (limb.tight_stiffness, limb.tight_damping),
        )
    ]  # fmt: skip
    for closed1, closed2, stopped, grip in itertools.product((True, False), (True, False), (True, False), grips):
        chosen = [cell, bearing, arm, grip]
        chosen += [stage1] * closed1 + [stage2] * closed2 + [stops] * stopped
        yield chosen


def _inertias(p: Parameters) -> Array:
    """Of motor, carrier 1, crank, column, limb at neutral [kg·m²]; the rod's masses go with the joint they follow."""
    box, link, column = p.gearbox, p.linkage, p.column
    rod = link.rod_crank_mass + link.rod_column_mass - link.rod_end_mass
    return np.array([
        p.motor.rotor_inertia + box.input_inertia,
        box.carrier1_inertia,
        box.carrier2_inertia + link.crank_inertia + rod * link.crank**2,
        column.inertia + link.rod_end_mass * link.arm**2,
        p.limb.mass * column.grip_height**2,
    ])  # fmt: skip


def _one_step(p: Parameters, springs: list[_Spring], step: float) -> Array:
    """Matrix of one step for the state (q, v, z, i)."""
    box, column, motor = p.gearbox, p.column, p.motor
    inertia = _inertias(p)
    bearing_damping = 0.2 * math.sqrt(column.bristle_stiffness * inertia[COLUMN])
    bristles = (
        (MOTOR, box.bristle_stiffness, box.bristle_damping),
        (CARRIER1, box.bristle_stiffness, box.bristle_damping),
        (COLUMN, column.bristle_stiffness, bearing_damping),
    )
    force = np.zeros((5, 14))
    for spring in springs:
        force[:, :5] -= spring.stiffness * np.outer(spring.lever, spring.lever)
        force[:, 5:10] -= spring.damping * np.outer(spring.lever, spring.lever)
    for number, (joint, stiffness, damping) in enumerate(bristles):
        force[joint, 10 + number] -= stiffness
        force[joint, 5 + joint] -= damping
    force[MOTOR, 13] += motor.torque_constant
    matrix = np.eye(14)
    matrix[5:10] += step * force / inertia[:, None]
    matrix[:5] += step * matrix[5:10]
    for number, (joint, _, _) in enumerate(bristles):
        matrix[10 + number, 5 + joint] = step
    decay = math.exp(-step * motor.resistance / motor.inductance)
    matrix[13, 13] = decay
    matrix[13, 5 + MOTOR] = -(1.0 - decay) * motor.torque_constant / motor.resistance
    return matrix


def _blame(p: Parameters, step: float) -> tuple[str, float]:
    """The parameter whose easing calms the step most, and the factor that eased it.

    The defaults are stable, so one of those that differ from them is to blame.
    """
    default = {key: value for key, value, _ in leaves(Parameters())}
    changed = {key for key, value, _ in leaves(p) if value != default[key]}
    suspects = [suspect for suspect in _SUSPECTS if suspect[0] in changed] or _SUSPECTS
    return min(suspects, key=lambda suspect: _spectral_radius(_scaled(p, *suspect), step))


def _scaled(p: Parameters, key: str, factor: float) -> Parameters:
    """A copy of ``p`` with one parameter scaled, unchecked: it is only looked at."""

    def changed(section: Any, path: list[str]) -> Any:
        inner = getattr(section, path[0])
        return section.model_copy(update={path[0]: inner * factor if len(path) == 1 else changed(inner, path[1:])})

    scaled: Parameters = changed(p, key.split("."))
    return scaled
