"""From parameters to a compiled MuJoCo model: the MJCF gives the structure, the parameters give every number."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco

from cls_bench.compiled import compiled
from cls_bench.parameters import GRAVITY, Parameters
from cls_bench.plant import friction, gearbox, motor
from cls_bench.plant.gearbox import update_stage
from cls_bench.plant.limb import update_grip
from cls_bench.plant.play import set_play
from cls_bench.plant.state import (
    BRISTLE1,
    BRISTLE2,
    BRISTLE_COLUMN,
    CARRIER1,
    COLUMN,
    COLUMN_BEARING,
    CRANK,
    MOTOR,
    STAGE1,
    STAGE1_FRICTION,
    STAGE2,
    STAGE2_FRICTION,
    STOP_BLOCKS,
)  # fmt: skip
from cls_bench.resources import model_folder
from cls_bench.signals import TICK_S

BEARING_STRIBECK = 0.01
"""Stribeck velocity of the column's bearing [rad/s]; without effect on its level, as static and Coulomb friction are
equal, it sets the speed above which the presliding damping fades out (assumed: well below the slowest sweep)."""

_POINT = 1e-6
"""Rotational inertia [kg·m²] of bodies meant as point masses; MuJoCo wants it positive. Under 3e-5 of any other."""


class Dampings(NamedTuple):
    """Damping coefficients that follow from damping ratios."""

    stage1: float  # [N·m·s/rad] at the stage's output
    stage2: float  # [N·m·s/rad] at the stage's output
    load_cell: float  # [N·s/m]
    stop: float  # [N·m·s/rad]
    bearing: float  # presliding [N·m·s/rad]


def dampings(p: Parameters) -> Dampings:
    """Damping coefficients from the parameters' damping ratios."""
    # The cell carries rod end and column, seen at the column joint.
    carried = p.linkage.rod_end_mass + p.column.inertia / p.linkage.arm**2
    bearing_inertia = p.column.inertia + p.linkage.rod_end_mass * p.linkage.arm**2
    return Dampings(
        *gearbox.mesh_dampings(p),
        load_cell=2.0 * p.load_cell.damping_ratio * math.sqrt(p.load_cell.stiffness * carried),
        stop=p.column.stop_damping,
        # A tenth of critical: enough to quiet the bristles, too little to matter in sliding.
        bearing=0.2 * math.sqrt(p.column.bristle_stiffness * bearing_inertia),
    )


def build_spec(p: Parameters, *, scene: bool = True) -> mujoco.MjSpec:
    """The MJCF of ``models/`` with every number from ``p``; with or without floor, light and cameras."""
    spec = mujoco.MjSpec.from_file(str(model_folder() / ("scene.xml" if scene else "cls_bench.xml")))
    spec.option.timestep = TICK_S / p.simulation.substeps
    # As stiff as the step allows: two steps' time constant. Softer, the rod end would swing on the load cell alone.
    spec.equality("linkage_closure").solref = [2.0 * spec.option.timestep, 1.0]
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    damping = dampings(p)
    _place_masses(spec, p)
    motor.configure(spec, p.motor)
    gearbox.configure(spec, p.gearbox)
    cell = spec.joint("load_cell")
    cell.stiffness[0], cell.damping[0] = p.load_cell.stiffness, damping.load_cell
    spec.joint("column").damping[0] = p.column.viscous_friction
    friction.configure(
        spec, "column_bearing", stiffness=p.column.bristle_stiffness, damping=damping.bearing,
        coulomb=p.column.coulomb_friction, static=p.column.coulomb_friction, stribeck=BEARING_STRIBECK,
    )  # fmt: skip
    stops = spec.tendon("stop_blocks")
    stops.stiffness[0] = p.column.stop_stiffness
    stops.springlength = [-p.column.stop_angle, p.column.stop_angle]
    area = p.column.grip_height**2
    grip = spec.tendon("grip")
    grip.stiffness[0], grip.damping[0] = p.limb.loose_stiffness * area, p.limb.loose_damping * area
    inputs = mujoco.mjtCtrlInput
    spec.actuator("arm").set_to_pid(
        kp=p.limb.arm_stiffness * area, kv=p.limb.arm_damping * area,
        ctrlspec=int(inputs.mjINPUT_POS) | int(inputs.mjINPUT_VEL) | int(inputs.mjINPUT_FF),
    )  # fmt: skip
    return spec


def stepped_spec(p: Parameters) -> mujoco.MjSpec:
    """The bench without its looks, as it is stepped.

    Shapes, sites, cameras and lights have neither mass nor contact, but MuJoCo places each of them at every step, which
    is an eighth of its time.
    """
    spec = build_spec(p, scene=False)
    spec.compiler.discardvisual = True
    for item in (*spec.sites, *spec.cameras, *spec.lights):
        spec.delete(item)
    return spec


def element_spec(p: Parameters, joints: Sequence[str], parts: Sequence[str] = ()) -> mujoco.MjSpec:
    """A part of the bench alone: the bench's own model, cut down to ``joints`` and ``parts``.

    ``joints`` are the joints that stay movable; a body on which none of them bears is left out. ``parts`` are the
    tendons, actuators and equalities that stay. Everything else is removed, so the element is built by the code that
    builds the bench. Raises ValueError if a name is not in the model.
    """
    spec = build_spec(p, scene=False)
    removable = (*spec.equalities, *spec.tendons, *spec.actuators)
    if unknown := {*joints, *parts} - {item.name for item in (*spec.joints, *removable)}:
        raise ValueError(f"the bench has no joint or part named {', '.join(sorted(unknown))}")
    for item in removable:
        if item.name not in parts:
            spec.delete(item)
    kept: set[str] = set()
    for name in joints:
        body = spec.joint(name).parent
        while body.name != "world":
            kept.add(body.name)
            body = body.parent
    for joint in spec.joints:
        if joint.name not in joints and joint.parent.name in kept:
            spec.delete(joint)
    for name in [body.name for body in spec.bodies if body.name != "world" and body.name not in kept]:
        if (body := spec.body(name)) is not None:  # not yet gone with its parent
            spec.delete(body)
    return spec


def _place_masses(spec: mujoco.MjSpec, p: Parameters) -> None:
    link, box = p.linkage, p.gearbox

    def spin(body: str, inertia: float) -> None:
        spec.body(body).inertia = [inertia] * 3

    spin("rotor", p.motor.rotor_inertia + box.input_inertia)
    spin("carrier1", box.carrier1_inertia)
    spin("crank", box.carrier2_inertia + link.crank_inertia)
    # The rod as table 3.3 has it: one point mass at either joint.
    far = link.rod_column_mass - link.rod_end_mass
    mass = link.rod_crank_mass + far
    rod = spec.body("rod")
    rod.mass = mass
    rod.ipos = [far / mass * link.rod, 0.0, 0.0]
    spin("rod", link.rod_crank_mass * far / mass * link.rod**2)
    rod.pos = [0.0, 0.0, link.crank]
    end = spec.body("rod_end")
    end.mass = link.rod_end_mass
    end.pos = [link.rod, 0.0, 0.0]
    spin("rod_end", _POINT)
    axis = spec.body("column").pos
    for body in ("rotor", "carrier1", "crank"):
        y = spec.body(body).pos[1]
        spec.body(body).pos = [axis[0] - link.rod, y, axis[2] + link.arm - link.crank]
    column = spec.body("column")
    column.mass = p.column.mass
    column.ipos = [0.0, 0.0, p.column.mass_height]
    spin("column", p.column.inertia - p.column.mass * p.column.mass_height**2)
    limb = spec.body("limb")
    limb.mass = p.limb.mass
    limb.ipos = [0.0, limb.ipos[1], p.column.grip_height]
    spin("limb", _POINT)


def set_limb_mass(model: mujoco.MjModel, mass: float) -> None:
    """Give the limb another mass [kg] in a compiled model, also between two steps of a run."""
    limb = model.body("limb")
    if limb.mass[0] != mass:
        limb.mass[0] = mass
        mujoco.mj_setConst(model, mujoco.MjData(model))  # the mass matrix of unbranched joints is kept as a constant


@compiled
def update(
    plant: Any, p: Any, mesh_loss: float, damping: Dampings, attached: bool, squeeze: float
) -> tuple[float, float, float, float]:
    """Set all that depends on the state for the coming plant step.

    Returns twist [rad] and torque [N·m] of stage 1, then of stage 2.
    """
    box = p.gearbox
    twist1, torque1 = update_stage(
        plant, box, box.stage1, mesh_loss, damping.stage1, STAGE1, STAGE1_FRICTION, BRISTLE1, MOTOR, CARRIER1
    )
    twist2, torque2 = update_stage(
        plant, box, box.stage2, mesh_loss, damping.stage2, STAGE2, STAGE2_FRICTION, BRISTLE2, CARRIER1, CRANK
    )
    column, velocity = plant.qpos[COLUMN], plant.qvel[COLUMN]
    set_play(plant, STOP_BLOCKS, column, velocity, -p.column.stop_angle, p.column.stop_angle, damping.stop)
    friction.set_level(
        plant, COLUMN_BEARING, BRISTLE_COLUMN, velocity,
        p.column.coulomb_friction, 1.0, damping.bearing, BEARING_STRIBECK,
    )  # fmt: skip
    update_grip(plant, p.limb, p.column.grip_height, attached, squeeze)
    return twist1, torque1, twist2, torque2


def static_unbalance(p: Parameters) -> float:
    """Slope U [N·m/rad] of the unbalance torque U φ: linear fit of (Σ m g h) sin φ over the travel (thesis fig. 3.37).

    The rod's share at the column joint hangs on the column, across the rod, where the load cell does not see it.
    """
    peak = GRAVITY * (p.column.mass * p.column.mass_height + p.linkage.rod_column_mass * p.linkage.arm)
    # Least squares of sin φ by a line through the origin: ∫ φ sin φ / ∫ φ² over the travel a.
    a = p.column.travel
    return peak * 3.0 * (math.sin(a) - a * math.cos(a)) / a**3
