"""The bench a second time: minimal coordinates, written down by hand, integrated by SciPy.

The shafts from the motor to the crank turn by θ_0 … θ_N, the last of which is the crank's ψ, the column by φ; these
angles are the only coordinates. The connecting rod follows from the two joints it lies between, so the linkage needs no
constraint::

    C1 = A1 + a e(ψ + γ),  C2 = b e(φ + α),  e(x) = (sin x, cos x),  e'(x) = t(x) = (cos x, −sin x)     plane x – z
    d = C2 − C1,  ρ = |d|,  u = d/ρ,  n = u turned by 90°,  ω = n·ḋ/ρ                                rod
    stretch of the load cell  s = ρ − L,   its force  S = c s + k ṡ
    far mass (rod's share on the crank's side of the strain gauge, at the column joint)  P = C1 + L u

    stage k between θ_k−1 (before) and θ_k (behind):
        x = before/r − behind − e sin N,   T = mesh(x),   friction F on the shaft before (LuGre)
        J before̋ = … − F − T ∂x/∂before,   J behind̋ = … − T ∂x/∂behind
    ψ, φ:  Lagrange's equations of crank, far mass, rod end and column with S, gravity and bearing

Without a linkage s = b (φ − ψ). The model shares the parameters with the bench and nothing else: no MuJoCo, no law of
``cls_bench.plant``. The tests' records of motor and hand torque drive both.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cls_bench.compiled import compiled
from cls_bench.parameters import GRAVITY, Parameters

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Everything the equations need; of the stages an entry each, of the shafts one more."""

    inertias: Array  # of the shafts, the crank's with the rod's share at its joint
    ratio: Array
    stiffness: Array
    damping: Array
    half: Array  # half the backlash [rad]
    error: Array  # amplitude of the transmission error [rad]
    teeth: Array
    with_output: Array  # 1 where the teeth's phase counts from the output, as in a planetary stage
    drag: Array  # motor driving, and back-driven
    drag_back: Array
    loss: Array
    loss_back: Array
    ripple: Array
    cogging: float  # amplitude [N·m]
    cogging_periods: float  # in a revolution
    breakaway: float
    mesh_stribeck: float
    mesh_bristle: float
    mesh_bristle_damping: float
    column_inertia: float  # with the rod end
    crank: float
    rod: float  # 0: none
    arm: float
    crank_angle: float
    arm_angle: float
    axis_x: float  # of the crank, from the column's
    axis_z: float
    far_mass: float
    crank_weight: float  # m g a [N·m]
    end_weight: float  # m g b [N·m]
    column_weight: float  # m g h [N·m]
    cell_stiffness: float
    cell_damping: float
    viscous: float
    coulomb: float
    bearing_bristle: float
    bearing_bristle_damping: float
    bearing_stribeck: float
    stop: float
    stop_stiffness: float
    stop_damping: float


def constants(p: Parameters) -> Constants:
    """The equations' constants from the parameters of the bench."""
    box, link, column, cell = p.gearbox, p.linkage, p.column, p.load_cell
    stages = (box.stage1, box.stage2, box.stage3)[: box.stages]
    linked = link.kind == "four_bar"
    shafts = [p.motor.rotor_inertia + box.input_inertia] + [stage.inertia for stage in stages]
    shafts[-1] += link.crank_inertia
    damping = []
    for before, behind, stage in zip(shafts, shafts[1:], stages, strict=False):
        reduced = 1.0 / (1.0 / (before * stage.ratio**2) + 1.0 / behind)
        damping.append(2.0 * stage.damping_ratio * math.sqrt(stage.stiffness * reduced))
    end = link.rod_end_mass if linked else 0.0
    if linked:
        shafts[-1] += link.rod_crank_mass * link.crank**2
    column_inertia = column.inertia + end * link.arm**2
    carried = end + column.inertia / link.arm**2
    rod = link.rod if linked else 0.0
    reach_x = link.crank * math.sin(link.crank_angle) + rod * math.cos(link.rod_angle)
    reach_z = link.crank * math.cos(link.crank_angle) - rod * math.sin(link.rod_angle)

    def each(values: list[float]) -> Array:
        return np.array(values, dtype=np.float64)

    return Constants(
        inertias=each(shafts),
        ratio=each([stage.ratio for stage in stages]),
        stiffness=each([stage.stiffness for stage in stages]),
        damping=each(damping),
        half=each([stage.backlash / 2.0 for stage in stages]),
        error=each([stage.transmission_error if stage.teeth else 0.0 for stage in stages]),
        teeth=each([stage.teeth for stage in stages]),
        with_output=each([stage.kind == "planetary" for stage in stages]),
        drag=each([stage.drag for stage in stages]),
        drag_back=each([stage.drag * stage.drag_ratio for stage in stages]),
        loss=each([(1.0 - stage.efficiency) / stage.efficiency for stage in stages]),
        loss_back=each([1.0 - stage.backdrive_efficiency for stage in stages]),
        ripple=each([stage.ripple if stage.teeth else 0.0 for stage in stages]),
        cogging=p.motor.cogging_amplitude,
        cogging_periods=float(p.motor.cogging_periods),
        breakaway=box.breakaway_ratio,
        mesh_stribeck=box.stribeck_velocity,
        mesh_bristle=box.bristle_stiffness,
        mesh_bristle_damping=box.bristle_damping,
        column_inertia=column_inertia,
        crank=link.crank,
        rod=rod,
        arm=link.arm,
        crank_angle=link.crank_angle,
        arm_angle=link.arm_angle,
        axis_x=link.arm * math.sin(link.arm_angle) - reach_x,
        axis_z=link.arm * math.cos(link.arm_angle) - reach_z,
        far_mass=link.rod_column_mass - link.rod_end_mass if linked else 0.0,
        crank_weight=link.rod_crank_mass * GRAVITY * link.crank if linked else 0.0,
        end_weight=GRAVITY * end * link.arm,
        column_weight=GRAVITY * column.mass * column.mass_height,
        cell_stiffness=cell.stiffness,
        cell_damping=2.0 * cell.damping_ratio * math.sqrt(cell.stiffness * carried),
        viscous=column.viscous_friction,
        coulomb=column.coulomb_friction,
        bearing_bristle=column.bristle_stiffness,
        bearing_bristle_damping=0.2 * math.sqrt(column.bristle_stiffness * column_inertia),
        bearing_stribeck=0.01,
        stop=column.stop_angle,
        stop_stiffness=column.stop_stiffness,
        stop_damping=column.stop_damping,
    )


@compiled
def _contact(displacement: float, rate: float, half: float, stiffness: float, damping: float) -> float:
    """Spring and damper beyond a play; the damper never exceeds the spring."""
    if abs(displacement) <= half:
        return 0.0
    spring = stiffness * (displacement - math.copysign(half, displacement))
    damper = damping * rate
    return spring + math.copysign(min(abs(damper), abs(spring)), damper)


@compiled
def _lugre(
    z: float, speed: float, coulomb: float, static: float, stribeck: float, bristle: float, damping: float
) -> tuple[float, float]:
    """Friction torque and rate of the bristles' deflection."""
    if coulomb <= 0.0:
        return 0.0, -1e5 * z
    fade = math.exp(-((speed / stribeck) ** 2))
    limit = static / bristle
    bent = min(max(z, -limit), limit)
    rate = speed - bristle * abs(speed) * bent / (coulomb + (static - coulomb) * fade)
    faded = min(damping * fade, coulomb / max(abs(speed), 1e-30))
    return bristle * bent + faded * rate, rate - 1e5 * (z - bent)


@compiled
def _stage(c: Constants, k: int, before: float, behind: float, v_before: float, v_behind: float, z: float) -> Any:
    """Torque of a mesh on the shaft before and on the shaft behind, friction on the shaft before, bristle rate."""
    phase = c.teeth[k] * (before - c.with_output[k] * behind)
    wave = math.sin(phase)
    slope = c.error[k] * c.teeth[k] * math.cos(phase)
    d_before, d_behind = 1.0 / c.ratio[k] - slope, c.with_output[k] * slope - 1.0
    stretch = before / c.ratio[k] - behind - c.error[k] * wave
    torque = _contact(stretch, d_before * v_before + d_behind * v_behind, c.half[k], c.stiffness[k], c.damping[k])
    back = z * torque < 0.0
    handed = abs(torque) / c.ratio[k]
    half, middle = 0.5 * (c.drag_back[k] - c.drag[k]), 0.5 * (c.drag_back[k] + c.drag[k])
    # The drag on a straight line through its mean where nothing is handed on, until it is one of the two.
    away = min(0.5 * handed, abs(half)) * (1.0 if half > 0.0 else -1.0)
    drag = middle + away if back else middle - away
    level = drag + (c.loss_back[k] if back else c.loss[k]) * handed
    level *= 1.0 + c.ripple[k] * wave
    friction, z_rate = _lugre(
        z, v_before, level, level * c.breakaway, c.mesh_stribeck, c.mesh_bristle, c.mesh_bristle_damping
    )
    return -torque * d_before, -torque * d_behind, friction, z_rate


@compiled
def derivative(c: Constants, y: Any, motor: float, hand: float, out: Any) -> None:
    """Write the derivative of the state ``y`` under motor and hand torque [N·m] to ``out``.

    The state: angles of the shafts and the column, their speeds, bristles of the stages and of the bearing.
    """
    stages = c.ratio.shape[0]
    n = stages + 2  # coordinates
    for j in range(n):
        out[j] = y[n + j]
        out[n + j] = 0.0
    out[n] += motor + c.cogging * math.sin(c.cogging_periods * y[0])
    for k in range(stages):
        on_before, on_behind, friction, out[2 * n + k] = _stage(
            c, k, y[k], y[k + 1], y[n + k], y[n + k + 1], y[2 * n + k]
        )
        out[n + k] += on_before - friction
        out[n + k + 1] += on_behind
    psi, phi, v_psi, v_phi = y[stages] + c.crank_angle, y[stages + 1], y[n + stages], y[n + stages + 1]
    bearing, out[2 * n + stages] = _lugre(
        y[2 * n + stages], v_phi, c.coulomb, c.coulomb, c.bearing_stribeck, c.bearing_bristle, c.bearing_bristle_damping
    )
    stop = _contact(phi, v_phi, c.stop, c.stop_stiffness, c.stop_damping)
    on_crank = out[n + stages]
    on_column = hand - bearing - c.viscous * v_phi - stop + c.column_weight * math.sin(phi)
    for j in range(stages):
        out[n + j] /= c.inertias[j]
    m11, m12, m22 = c.inertias[stages], 0.0, c.column_inertia
    if c.rod == 0.0:
        pull = c.arm * (c.cell_stiffness * c.arm * (phi - y[stages]) + c.cell_damping * c.arm * (v_phi - v_psi))
        out[n + stages] = (on_crank + pull) / m11
        out[n + stages + 1] = (on_column - pull) / m22
        return

    a, b, length = c.crank, c.arm, c.rod
    s1, c1, s2, c2 = math.sin(psi), math.cos(psi), math.sin(phi + c.arm_angle), math.cos(phi + c.arm_angle)
    dx, dz = b * s2 - (c.axis_x + a * s1), b * c2 - (c.axis_z + a * c1)
    rho = math.hypot(dx, dz)
    ux, uz = dx / rho, dz / rho
    nx, nz = -uz, ux
    along1, along2 = a * (ux * c1 - uz * s1), b * (ux * c2 - uz * s2)  # u·∂C/∂angle
    across1, across2 = a * (nx * c1 - nz * s1), b * (nx * c2 - nz * s2)  # n·∂C/∂angle
    stretch_rate = along2 * v_phi - along1 * v_psi
    turn = (across2 * v_phi - across1 * v_psi) / rho
    pull = c.cell_stiffness * (rho - length) + c.cell_damping * stretch_rate

    # Far mass: P = C1 + L u; Jacobian columns for ψ and φ, and what is left of its acceleration at zero ψ̈, φ̈.
    w1, w2 = -across1 / rho, across2 / rho
    jx1, jz1 = a * c1 + length * w1 * nx, -a * s1 + length * w1 * nz
    jx2, jz2 = length * w2 * nx, length * w2 * nz
    gx = -b * s2 * v_phi * v_phi + a * s1 * v_psi * v_psi  # d̈ at zero ψ̈, φ̈
    gz = -b * c2 * v_phi * v_phi + a * c1 * v_psi * v_psi
    spin = (nx * gx + nz * gz) / rho - 2.0 * turn * stretch_rate / rho
    bx = -a * s1 * v_psi * v_psi + length * (spin * nx - turn * turn * ux)
    bz = -a * c1 * v_psi * v_psi + length * (spin * nz - turn * turn * uz)

    m = c.far_mass
    m11 += m * (jx1 * jx1 + jz1 * jz1)
    m12 += m * (jx1 * jx2 + jz1 * jz2)
    m22 += m * (jx2 * jx2 + jz2 * jz2)
    f1 = on_crank + pull * along1 + c.crank_weight * s1 - m * (jx1 * bx + jz1 * (bz + GRAVITY))
    f2 = on_column - pull * along2 + c.end_weight * s2 - m * (jx2 * bx + jz2 * (bz + GRAVITY))
    determinant = m11 * m22 - m12 * m12
    out[n + stages] = (m22 * f1 - m12 * f2) / determinant
    out[n + stages + 1] = (m11 * f2 - m12 * f1) / determinant


@compiled
def _entry(records: Any, which: int, row: float) -> float:
    k = min(int(row), records.shape[0] - 2)
    share = row - k
    return float((1.0 - share) * records[k, which] + share * records[k + 1, which])


@compiled
def _right(c: Constants, row: float, y: Any, records: Any, stiffness: float, damping: float, out: Any) -> None:
    """The derivative ``row`` entries into ``records``: torque of motor and hand, angle and rate of the guide."""
    pulled = stiffness * (_entry(records, 2, row) - y[0])
    pulled += damping * (_entry(records, 3, row) - y[c.ratio.shape[0] + 2])
    derivative(c, y, _entry(records, 0, row) + pulled, _entry(records, 1, row), out)


class Guide(NamedTuple):
    """A spring and damper that pull the motor along."""

    stiffness: float  # [N·m/rad]
    damping: float  # [N·m·s/rad]
    angle: Array  # where to, an entry a step [rad]
    rate: Array  # [rad/s]


def follow(
    p: Parameters, time: Array, motor: Array, hand: Array, *, guide: Guide | None = None, tolerance: float = 1e-8
) -> Array:
    """The motion from rest under records of motor and hand torque [N·m]: angles of the shafts from the motor on and of
    the column, then their speeds, (len(time), 2 (stages + 2)) [rad, rad/s]. The motor may have a ``guide`` as well.

    Between the entries of a record it is interpolated linearly: semi-implicit Euler is the leapfrog scheme, in which a
    force taken at t acts from half a step before t to half a step after. Raises RuntimeError if the integration fails.
    """
    c = constants(p)
    coordinates = len(c.ratio) + 2
    states = 2 * coordinates + coordinates - 1
    step = float(time[1] - time[0])
    led = guide or Guide(0.0, 0.0, np.zeros(len(time)), np.zeros(len(time)))
    records = np.stack([motor, hand, led.angle, led.rate], axis=1)

    def right(t: float, y: Array) -> Array:
        out = np.empty(states)
        _right(c, t / step, y, records, led.stiffness, led.damping, out)
        return out

    # Small angles of the meshes decide on torques: the absolute tolerance is far below their elastic twist.
    solution = solve_ivp(
        right, (float(time[0]), float(time[-1])), np.zeros(states), method="LSODA", t_eval=time, rtol=tolerance,
        atol=tolerance * 1e-2, max_step=step * 20,
    )  # fmt: skip
    if not solution.success:
        raise RuntimeError(f"the reduced model could not be integrated: {solution.message}")
    return np.asarray(solution.y[: 2 * coordinates].T, dtype=np.float64)
