"""The connecting rod: an elastic member between crank pin C1 and column pin C2, whose spring is the load cell.

    F = c s + d ṡ,   s = |C2 − C1| − rod        tension positive

With u along the rod from C1 to C2 and n across it, F acts on crank and column by the pins' velocities along u.

Its mass lies at three places. What is at the crank pin moves with the crank, the rod end beyond the strain gauge with
the column. The far mass m, at the column's end but before the gauge, moves along the rod with the crank pin and across
it with the column pin, ṗ = (Ċ1·u) u + (Ċ2·n) n. Its acceleration, with u̇ = ω n, is

    p̈·u = C̈1·u − ω² |C2 − C1|,      p̈·n = C̈2·n − ω ṡ

so that crank and column each take a part of it as an armature that changes with the position, and the rest, with its
weight, as a torque. That is exact up to the load cell's stretch (5e-4 of the rod).

A shaft in place of the linkage (rod = 0) is a torque cell: s = arm (φ − φc).
"""

import math
from typing import Any

from cls_bench.compiled import compiled
from cls_bench.kinematics import crank_axis
from cls_bench.parameters import GRAVITY, Parameters
from cls_bench.parameters.inertias import cell_damping


def configure(mechanism: Any, p: Parameters) -> None:
    """Put geometry, masses and load cell into the record ``mechanism``."""
    bar = p.linkage.four_bar
    mechanism.crank, mechanism.rod, mechanism.arm = bar.crank, bar.rod, bar.arm
    mechanism.crank_angle, mechanism.rod_angle, mechanism.arm_angle = bar.crank_angle, bar.rod_angle, bar.arm_angle
    mechanism.axis_x, mechanism.axis_z = crank_axis(bar)
    mechanism.far_mass = p.linkage.masses[1]
    mechanism.cell_stiffness, mechanism.cell_damping = p.load_cell.stiffness, cell_damping(p)


@compiled
def strain(plant: Any, joints: Any, mechanism: Any, body: Any) -> None:
    """Where the rod is and the force in it, in the present state."""
    m = mechanism
    crank, column = joints.crank, joints.column
    crank_speed, column_speed = plant.qvel[crank], plant.qvel[column]
    if m.rod == 0.0:
        stretch = m.arm * (plant.qpos[column] - plant.qpos[crank])
        body.along_crank = body.along_column = m.arm
        body.rod_force = m.cell_stiffness * stretch + m.cell_damping * m.arm * (column_speed - crank_speed)
        return
    # From the axes to the pins; the pins' derivatives by the angles are (z, −x) of these.
    at_crank, at_column = plant.qpos[crank] + m.crank_angle, plant.qpos[column] + m.arm_angle
    r1x, r1z = m.crank * math.sin(at_crank), m.crank * math.cos(at_crank)
    r2x, r2z = m.arm * math.sin(at_column), m.arm * math.cos(at_column)
    dx, dz = r2x - m.axis_x - r1x, r2z - m.axis_z - r1z
    length = math.sqrt(dx * dx + dz * dz)
    ux, uz = dx / length, dz / length
    along1, along2 = r1z * ux - r1x * uz, r2z * ux - r2x * uz
    body.along_crank, body.along_column = along1, along2
    stretching = along2 * column_speed - along1 * crank_speed
    body.rod_force = m.cell_stiffness * (length - m.rod) + m.cell_damping * stretching
    # The far mass, with n = (−uz, ux)
    across1, across2 = -r1z * uz - r1x * ux, -r2z * uz - r2x * ux
    turning = (across2 * column_speed - across1 * crank_speed) / length  # ω
    centripetal1 = -crank_speed * crank_speed * (r1x * ux + r1z * uz)  # C̈1·u without the angular acceleration
    centripetal2 = -column_speed * column_speed * (r2z * ux - r2x * uz)  # C̈2·n likewise
    body.across_column = across2
    body.far_along = centripetal1 - turning * turning * length + GRAVITY * uz
    body.far_across = centripetal2 - turning * stretching + GRAVITY * ux


@compiled
def act(plant: Any, joints: Any, mechanism: Any, body: Any) -> None:
    """Put the force of :func:`strain` on crank and column, and the far mass into their inertias."""
    crank, column = joints.crank, joints.column
    along = body.along_crank
    plant.force[crank] += body.rod_force * along
    plant.force[column] -= body.rod_force * body.along_column
    # Also where there is none: what another rig has left in the model must not stay.
    far, across = mechanism.far_mass, body.across_column
    plant.force[crank] -= far * along * body.far_along
    plant.force[column] -= far * across * body.far_across
    plant.armature[crank], plant.armature[column] = far * along * along, far * across * across
