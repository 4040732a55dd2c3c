"""The bench a second time: minimal coordinates, written down by hand, integrated by SciPy.

Motor, carrier 1, crank and column turn by θ, α, ψ, φ; these four angles are the only coordinates. The connecting rod
follows from the two joints it lies between, so the linkage needs no constraint::

    C1 = A1 + a e(ψ),  C2 = b e(φ),  e(x) = (sin x, cos x),  e'(x) = t(x) = (cos x, −sin x)     plane x – z
    d = C2 − C1,  ρ = |d|,  u = d/ρ,  n = u turned by 90°,  ω = n·ḋ/ρ                            rod
    stretch of the load cell  s = ρ − L,   its force  S = c s + k ṡ
    far mass (rod's share on the crank's side of the strain gauge, at the column joint)  P = C1 + L u

    J_M θ̈ = τ − F1 − T1 ∂x1/∂θ             x1 = θ/r − α − e1 sin N(θ − α),  T1 = mesh(x1),  F1 = LuGre on θ̇
    J_1 α̈ = −T1 ∂x1/∂α − F2 − T2 ∂x2/∂α    x2 = α/r − ψ − e2 sin N(α − ψ),  T2 = mesh(x2),  F2 = LuGre on α̇
    ψ, φ:  Lagrange's equations of crank, far mass, rod end and column with S, gravity and bearing

It shares the parameters with the bench and nothing else: no MuJoCo, no law of ``cls_bench.plant``. The tests' records
of motor and hand torque drive both.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cls_bench.compiled import compiled
from cls_bench.parameters import GRAVITY, GearStage, Parameters

Array = NDArray[np.float64]

STATES = 11
"""θ, α, ψ, φ, their speeds, and three bristle deflections."""


class Mesh(NamedTuple):
    """A gear stage."""

    stiffness: float
    damping: float
    half: float  # half the backlash [rad]
    error: float  # amplitude of the transmission error [rad]
    teeth: float
    drag: float
    ripple: float


class Constants(NamedTuple):
    """Everything the equations need."""

    ratio: float
    motor_inertia: float
    carrier_inertia: float
    crank_inertia: float  # with the rod's share at the crank joint
    column_inertia: float  # with the rod end
    stage1: Mesh
    stage2: Mesh
    loss: float
    back: float
    breakaway: float
    mesh_stribeck: float
    mesh_bristle: float
    mesh_bristle_damping: float
    crank: float
    rod: float
    arm: float
    far_mass: float
    crank_weight: float  # m g a [N·m]
    column_weight: float  # Σ m g h [N·m]
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
    motor = p.motor.rotor_inertia + box.input_inertia
    crank = link.crank_inertia + box.carrier2_inertia

    def mesh(stage: GearStage, before: float, behind: float) -> Mesh:
        reduced = 1.0 / (1.0 / (before * box.ratio**2) + 1.0 / behind)
        damping = 2.0 * stage.damping_ratio * math.sqrt(stage.stiffness * reduced)
        return Mesh(
            stage.stiffness, damping, stage.backlash / 2.0, stage.transmission_error, float(stage.sun_teeth),
            stage.drag, stage.ripple,
        )  # fmt: skip

    on_cell = link.rod_end_mass + column.inertia / link.arm**2
    column_inertia = column.inertia + link.rod_end_mass * link.arm**2
    return Constants(
        ratio=box.ratio,
        motor_inertia=motor,
        carrier_inertia=box.carrier1_inertia,
        crank_inertia=crank + link.rod_crank_mass * link.crank**2,
        column_inertia=column_inertia,
        stage1=mesh(box.stage1, motor, box.carrier1_inertia),
        stage2=mesh(box.stage2, box.carrier1_inertia, crank),
        loss=mesh_loss(p),
        back=box.backdrive_loss_ratio,
        breakaway=box.breakaway_ratio,
        mesh_stribeck=box.stribeck_velocity,
        mesh_bristle=box.bristle_stiffness,
        mesh_bristle_damping=box.bristle_damping,
        crank=link.crank,
        rod=link.rod,
        arm=link.arm,
        far_mass=link.rod_column_mass - link.rod_end_mass,
        crank_weight=link.rod_crank_mass * GRAVITY * link.crank,
        column_weight=GRAVITY * (column.mass * column.mass_height + link.rod_end_mass * link.arm),
        cell_stiffness=cell.stiffness,
        cell_damping=2.0 * cell.damping_ratio * math.sqrt(cell.stiffness * on_cell),
        viscous=column.viscous_friction,
        coulomb=column.coulomb_friction,
        bearing_bristle=column.bristle_stiffness,
        bearing_bristle_damping=0.2 * math.sqrt(column.bristle_stiffness * column_inertia),
        bearing_stribeck=0.01,
        stop=column.stop_angle,
        stop_stiffness=column.stop_stiffness,
        stop_damping=column.stop_damping,
    )


def mesh_loss(p: Parameters) -> float:
    """The loss of each stage that gives the stated efficiency at rated torque, by bisection of the definition."""
    box = p.gearbox
    low, high = 0.0, 10.0
    for _ in range(80):
        loss, torque = 0.5 * (low + high), box.rated_torque
        for stage in (box.stage1, box.stage2):
            torque = (torque - stage.drag) / (1.0 + loss) * box.ratio
        if torque > box.efficiency * box.rated_torque * box.ratio**2:
            low = loss
        else:
            high = loss
    return 0.5 * (low + high)


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
def _stage(c: Constants, m: Mesh, before: float, behind: float, v_before: float, v_behind: float, z: float) -> Any:
    """Torque of a mesh on the shaft before and on the shaft behind, friction on the shaft before, bristle rate."""
    wave = math.sin(m.teeth * (before - behind))
    slope = m.error * m.teeth * math.cos(m.teeth * (before - behind))
    rate = v_before / c.ratio - v_behind - slope * (v_before - v_behind)
    torque = _contact(before / c.ratio - behind - m.error * wave, rate, m.half, m.stiffness, m.damping)
    loss = c.loss * (c.back if z * torque < 0.0 else 1.0)
    level = (m.drag + loss * abs(torque) / c.ratio) * (1.0 + m.ripple * wave)
    friction, z_rate = _lugre(
        z, v_before, level, level * c.breakaway, c.mesh_stribeck, c.mesh_bristle, c.mesh_bristle_damping
    )
    return torque * (slope - 1.0 / c.ratio), torque * (1.0 - slope), friction, z_rate


@compiled
def derivative(c: Constants, y: Any, motor: float, hand: float, out: Any) -> None:
    """Write the derivative of the state ``y`` under motor and hand torque [N·m] to ``out``."""
    psi, phi, v_psi, v_phi = y[2], y[3], y[6], y[7]
    on_motor, on_carrier, friction1, out[8] = _stage(c, c.stage1, y[0], y[1], y[4], y[5], y[8])
    back_on_carrier, on_crank, friction2, out[9] = _stage(c, c.stage2, y[1], y[2], y[5], y[6], y[9])
    bearing, out[10] = _lugre(
        y[10], v_phi, c.coulomb, c.coulomb, c.bearing_stribeck, c.bearing_bristle, c.bearing_bristle_damping
    )
    stop = _contact(phi, v_phi, c.stop, c.stop_stiffness, c.stop_damping)

    a, b, length = c.crank, c.arm, c.rod
    s1, c1, s2, c2 = math.sin(psi), math.cos(psi), math.sin(phi), math.cos(phi)
    dx, dz = b * s2 - (a * s1 - length), b * c2 - (a * c1 + b - a)
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
    m11 = c.crank_inertia + m * (jx1 * jx1 + jz1 * jz1)
    m12 = m * (jx1 * jx2 + jz1 * jz2)
    m22 = c.column_inertia + m * (jx2 * jx2 + jz2 * jz2)
    f1 = on_crank + pull * along1 + c.crank_weight * s1 - m * (jx1 * bx + jz1 * (bz + GRAVITY))
    f2 = (
        hand - bearing - c.viscous * v_phi - stop - pull * along2 + c.column_weight * s2
        - m * (jx2 * bx + jz2 * (bz + GRAVITY))
    )  # fmt: skip
    determinant = m11 * m22 - m12 * m12
    out[0], out[1], out[2], out[3] = y[4], y[5], y[6], y[7]
    out[4] = (motor - friction1 + on_motor) / c.motor_inertia
    out[5] = (on_carrier - friction2 + back_on_carrier) / c.carrier_inertia
    out[6] = (m22 * f1 - m12 * f2) / determinant
    out[7] = (m11 * f2 - m12 * f1) / determinant


def follow(p: Parameters, time: Array, motor: Array, hand: Array, *, tolerance: float = 1e-8) -> Array:
    """Angles (θ, α, ψ, φ) [rad] at ``time`` [s] from rest under records of motor and hand torque [N·m].

    Between the entries of a record it is interpolated linearly: semi-implicit Euler is the leapfrog scheme, in which a
    force taken at t acts from half a step before t to half a step after. Raises RuntimeError if the integration fails.
    """
    c = constants(p)
    step = float(time[1] - time[0])
    last = len(time) - 1

    def right(t: float, y: Array) -> Array:
        out = np.empty(STATES)
        k = min(int(t / step), last - 1)
        share = t / step - k
        derivative(
            c, y, (1.0 - share) * motor[k] + share * motor[k + 1], (1.0 - share) * hand[k] + share * hand[k + 1], out
        )
        return out

    # Small angles of the meshes decide on torques: the absolute tolerance is far below their elastic twist.
    solution = solve_ivp(
        right, (float(time[0]), float(time[-1])), np.zeros(STATES), method="LSODA", t_eval=time, rtol=tolerance,
        atol=tolerance * 1e-2, max_step=step * 20,
    )  # fmt: skip
    if not solution.success:
        raise RuntimeError(f"the reduced model could not be integrated: {solution.message}")
    return np.asarray(solution.y[:4].T, dtype=np.float64)
