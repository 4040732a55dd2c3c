"""The whole rig as a MuJoCo model: for viewers and pictures, and as an independent twin of what is stepped.

``models/cls_bench.xml`` gives the structure, the parameters give every number, and what a rig has more or less than the
thesis's is added and removed. The linkage is closed by a constraint here, meshes are tendons with a dead zone, friction
is MuJoCo's LuGre element, the motor its ``dcmotor``; no compiled law of ``cls_bench.plant`` takes part.
"""

import math
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from cls_bench.parameters import GRAVITY, Parameters
from cls_bench.parameters.inertias import bearing_damping, cell_damping, shaft_inertias
from cls_bench.plant.column import STRIBECK
from cls_bench.plant.shapes import Frame, Layout, Vector, layout
from cls_bench.resources import model_folder

Array = NDArray[np.float64]

GAP = 0.15
"""Between rigs that stand side by side [m]."""

_POINT = 1e-6
"""Rotational inertia [kg·m²] of bodies meant as point masses; MuJoCo wants it positive. Under 3e-5 of any other."""

_FEATHER = 1e-6
"""Mass [kg] of bodies that have none."""

_AMBIENT = 20.0  # °C; without a temperature coefficient of resistance it is only a reference


class Rest(NamedTuple):
    """A body at neutral, and what turns it.

    Its quaternion at another time is that of rest times (cos q/2, 0, sin q/2, 0): it turns about its own y axis by
    the angle q of ``turned_by``. Its place stays, but for the rod's two ends, which are C1 and C2 of
    :func:`cls_bench.kinematics.joints`, seen from the column's axis; their q is the rod's inclination less that at
    neutral. Without a stage the crank is ``turned_by`` the motor.
    """

    name: str
    position: Vector  # of the body's origin in the world [m]
    turned_by: str  # a joint, or the rod
    quaternion: tuple[float, float, float, float]  # w, x, y, z


def rest(p: Parameters, axis: str = "", across: float = 0.0) -> tuple[Rest, ...]:
    """All bodies but the world, in the order in which :func:`build_spec` has them.

    ``axis`` is the rig's name where there are several, and ``across`` where it stands among them [m].
    """
    frames = layout(p).bodies
    prefix = f"{axis}/" if axis else ""
    named: Iterable[tuple[str, str]] = _bodies(p)

    def body(name: str, turned_by: str) -> Rest:
        x, y, z = (float(value) for value in frames[name].origin)
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, frames[name].turn.ravel())
        w, i, j, k = (float(value) + 0.0 for value in quaternion)
        return Rest(prefix + name, (x, y + across, z), turned_by, (w, i, j, k))

    return tuple(body(*entry) for entry in named)


def body_names(rigs: Mapping[str, Parameters]) -> tuple[str, ...]:
    """Names of all bodies of :func:`build_bench`, world first."""
    named = ((axis, name) for axis, p in rigs.items() for name, _ in _bodies(p))
    return ("world", *(f"{axis}/{name}" if axis else name for axis, name in named))


def _bodies(p: Parameters) -> list[tuple[str, str]]:
    """Bodies of a rig in the model's order, and what turns each."""
    stages = p.gearbox.stages
    bodies: list[tuple[str, str]] = [("rotor", "motor"), ("crank", "crank")] if stages else [("crank", "motor")]
    if p.linkage.kind == "four_bar":
        bodies += [("rod", "rod"), ("rod_end", "rod")]
    bodies += [("column", "column"), ("limb", "limb")]
    return bodies + [(f"carrier{number}", f"carrier{number}") for number in range(1, stages)]


def places(rigs: Mapping[str, Parameters]) -> dict[str, float]:
    """Where each of several rigs stands: its column's plane along y [m], the first at 0, each behind the one before."""
    found: dict[str, float] = {}
    free = -math.inf
    for name, p in rigs.items():
        low, high = layout(p).bounds
        found[name] = 0.0 if not found else free + GAP - float(low[1])
        free = found[name] + float(high[1])
    return found


def build_bench(rigs: Mapping[str, Parameters], *, scene: bool = True) -> mujoco.MjSpec:
    """One rig, or several side by side whose names begin with ``NAME/``."""
    if list(rigs) == [""]:
        return build_spec(rigs[""], scene=scene)
    spec = _template(scene)
    for item in (*spec.equalities, *spec.tendons, *spec.actuators, *spec.worldbody.bodies):
        spec.delete(item)
    for geom in [geom for geom in spec.worldbody.geoms if geom.name != "floor"]:
        spec.delete(geom)
    spec.option.timestep = min(_step(p) for p in rigs.values())
    layouts = {name: layout(p) for name, p in rigs.items()}
    bounds = []
    for name, across in places(rigs).items():
        aside = np.array([0.0, across, 0.0])
        rig = build_spec(rigs[name], scene=False)
        spec.attach(rig, prefix=f"{name}/", frame=spec.worldbody.add_frame(pos=aside))
        bounds.append([corner + aside for corner in layouts[name].bounds])
    if scene:
        _frame_view(spec, np.min([low for low, _ in bounds], axis=0), np.max([high for _, high in bounds], axis=0))
    return spec


def build_spec(p: Parameters, axis: str = "", *, scene: bool = True) -> mujoco.MjSpec:
    """The rig of ``p``; with or without floor, light and cameras. ``axis`` is a name that goes before all others."""
    if axis:
        return build_bench({axis: p}, scene=scene)
    drawn = layout(p)
    spec = _template(scene)
    spec.option.timestep = _step(p)
    # As stiff as the step allows: two steps' time constant. Softer, the rod end would swing on the load cell alone.
    spec.equality("linkage_closure").solref = [2.0 * spec.option.timestep, 1.0]
    spec.option.gravity = [0.0, 0.0, -GRAVITY]
    _fit_structure(spec, p)
    for name, frame in drawn.bodies.items():
        _place(spec, name, frame, drawn)
    _weigh(spec, p)
    _set_motor(spec, p)
    _set_gearbox(spec, p)
    _set_linkage(spec, p)
    _set_column_and_limb(spec, p)
    _draw(spec, drawn, p)
    if scene:
        _frame_view(spec, *drawn.bounds)
    return spec


def _step(p: Parameters) -> float:
    return p.rates.current_cycle / p.simulation.substeps


def _template(scene: bool) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_file(str(model_folder() / ("scene.xml" if scene else "cls_bench.xml")))


# --- structure ---


def _fit_structure(spec: mujoco.MjSpec, p: Parameters) -> None:
    """Bodies and joints as many as the rig has."""
    stages = p.gearbox.stages
    for item in [*spec.tendons, *spec.actuators]:
        if item.name.startswith("stage"):
            spec.delete(item)
    spec.delete(spec.body("carrier1"))
    for number in range(1, stages):
        carrier = spec.worldbody.add_body(name=f"carrier{number}", mass=0.25, inertia=[_POINT] * 3)
        carrier.explicitinertial, carrier.ipos = True, [0.0, 0.0, 0.0]
        carrier.add_joint(spec.find_default("main"), name=f"carrier{number}")
    if not stages:  # the motor sits on the crank
        spec.joint("motor").name = "unused"
        spec.joint("crank").name = "motor"  # first, or what drives the motor would go with the rotor
        spec.delete(spec.body("rotor"))
    if p.linkage.kind == "none":
        spec.delete(spec.equality("linkage_closure"))
        spec.delete(spec.body("rod"))


def _place(spec: mujoco.MjSpec, name: str, frame: Frame, drawn: Layout) -> None:
    """Put a body where it is drawn; those of the rod are given in the frame of what carries them."""
    body = spec.body(name)
    carrier = {"rod": "crank", "rod_end": "rod"}.get(name)
    origin, turn = frame.origin, frame.turn
    if carrier is not None:
        base = drawn.bodies[carrier]
        origin, turn = base.turn.T @ (origin - base.origin), base.turn.T @ turn
    body.pos, body.quat = _exact(origin), _quaternion(turn)


def _exact(values: Array) -> Array:
    """Without the rounding of sines and cosines at nought."""
    return np.asarray(np.where(np.abs(values) < 1e-15, 0.0, values))


def _quaternion(turn: Array) -> Array:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, turn.ravel())
    return _exact(quaternion)


# --- numbers ---


def _weigh(spec: mujoco.MjSpec, p: Parameters) -> None:
    link = p.linkage

    def spin(body: str, inertia: float) -> None:
        spec.body(body).inertia = [inertia] * 3

    motor, *shafts = shaft_inertias(p)
    if shafts:
        spin("rotor", motor)
        for number, inertia in enumerate(shafts[:-1], 1):
            spin(f"carrier{number}", inertia)
    spin("crank", shafts[-1] if shafts else motor)
    at_crank, far, end = link.masses
    if p.linkage.kind == "four_bar":  # the rod as table 3.3 has it: one point mass at either joint
        mass = max(at_crank + far, _FEATHER)
        rod = spec.body("rod")
        rod.mass = mass
        rod.ipos = [far / mass * link.rod, 0.0, 0.0]
        spin("rod", max(at_crank * far / mass * link.rod**2, _POINT))
        spec.body("rod_end").mass = max(end, _FEATHER)
        spin("rod_end", _POINT)
    column = spec.body("column")
    column.mass = p.column.mass
    column.ipos = [0.0, 0.0, p.column.mass_height]
    spin("column", p.column.inertia - p.column.mass * p.column.mass_height**2)
    limb = spec.body("limb")
    limb.mass = p.limb.mass
    limb.ipos = [0.0, limb.ipos[1], p.column.grip_height]


def _set_motor(spec: mujoco.MjSpec, p: Parameters) -> None:
    m = p.motor
    spec.actuator("motor").set_to_dcmotor(
        motorconst=[m.torque_constant, 0.0],
        resistance=m.resistance,
        inductance=[m.inductance, 0.0],
        thermal=[m.thermal_resistance, 0.0, m.thermal_time_constant, 0.0, _AMBIENT, _AMBIENT],
        cogging=[m.cogging_amplitude, float(m.cogging_periods), 0.0],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_VOLTAGE),
    )


def _set_friction(
    actuator: Any, *, stiffness: float, damping: float, coulomb: float, static: float, stribeck: float
) -> None:
    """Make a LuGre element: [N·m/rad], [N·m·s/rad], [N·m], [N·m], [rad/s]."""
    actuator.set_to_dcmotor(
        motorconst=[0.0, 0.0], resistance=1.0, lugre=[stiffness, damping, coulomb, static, stribeck],
        ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE),
    )  # fmt: skip


def _set_gearbox(spec: mujoco.MjSpec, p: Parameters) -> None:
    box = p.gearbox
    shafts = ["motor", *(f"carrier{number}" for number in range(1, box.stages)), "crank"]
    for number, stage in enumerate(box.in_use, 1):
        tendon = spec.add_tendon(name=f"stage{number}", stiffness=[stage.stiffness, 0.0, 0.0])
        tendon.springlength = [-stage.backlash / 2, stage.backlash / 2]
        tendon.wrap_joint(shafts[number - 1], 1.0 / stage.ratio)
        tendon.wrap_joint(shafts[number], -1.0)
        friction = spec.add_actuator(
            name=f"stage{number}_friction", target=shafts[number - 1], trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        _set_friction(
            friction, stiffness=box.bristle_stiffness, damping=box.bristle_damping, coulomb=stage.drag,
            static=stage.drag * box.breakaway_ratio, stribeck=box.stribeck_velocity,
        )  # fmt: skip


def _set_linkage(spec: mujoco.MjSpec, p: Parameters) -> None:
    stiffness, damping = p.load_cell.stiffness, cell_damping(p)
    if p.linkage.kind == "four_bar":
        cell = spec.joint("load_cell")
        cell.stiffness[0], cell.damping[0] = stiffness, damping
        return
    area = p.linkage.arm**2
    shaft = spec.add_tendon(name="torque_cell", stiffness=[stiffness * area, 0.0, 0.0])
    shaft.damping = [damping * area, 0.0, 0.0]
    shaft.springlength = [0.0, 0.0]
    shaft.wrap_joint("column", 1.0)
    shaft.wrap_joint("crank" if p.gearbox.stages else "motor", -1.0)


def _set_column_and_limb(spec: mujoco.MjSpec, p: Parameters) -> None:
    c = p.column
    spec.joint("column").damping[0] = c.viscous_friction
    _set_friction(
        spec.actuator("column_bearing"), stiffness=c.bristle_stiffness, damping=bearing_damping(p),
        coulomb=c.coulomb_friction, static=c.coulomb_friction, stribeck=STRIBECK,
    )  # fmt: skip
    stops = spec.tendon("stop_blocks")
    stops.stiffness[0] = c.stop_stiffness
    stops.springlength = [-c.stop_angle, c.stop_angle]
    area = c.grip_height**2
    grip = spec.tendon("grip")
    grip.stiffness[0], grip.damping[0] = p.limb.loose_stiffness * area, p.limb.loose_damping * area
    inputs = mujoco.mjtCtrlInput
    spec.actuator("arm").set_to_pid(
        kp=p.limb.arm_stiffness * area, kv=p.limb.arm_damping * area,
        ctrlspec=int(inputs.mjINPUT_POS) | int(inputs.mjINPUT_VEL) | int(inputs.mjINPUT_FF),
    )  # fmt: skip


# --- looks ---

_KINDS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX, "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
}  # fmt: skip

_HAND_HEIGHT = 0.30
"""Height of the grip at which the model's file has the hand [m]."""


def _draw(spec: mujoco.MjSpec, drawn: Layout, p: Parameters) -> None:
    """Put the shapes of ``drawn`` in the place of those of the file; the hand goes where the grip is."""
    up = p.column.grip_height - _HAND_HEIGHT
    for geom in list(spec.geoms):
        if geom.parent.name == "limb":
            if np.isfinite(geom.fromto).all():
                geom.fromto = geom.fromto + np.array([0.0, 0.0, up, 0.0, 0.0, up])
            else:
                geom.pos = geom.pos + np.array([0.0, 0.0, up])
        elif geom.name != "floor":
            spec.delete(geom)
    for shape in drawn.shapes:
        body = spec.body(shape.body) if shape.body else spec.worldbody
        geom = body.add_geom(spec.find_default(shape.look), name=shape.name, type=_KINDS[shape.kind])
        geom.size = shape.size
        geom.pos, geom.quat = _exact(shape.place.origin), _quaternion(shape.place.turn)
    site = spec.site("grip")
    site.pos = [0.0, site.pos[1], p.column.grip_height]


@cache
def _thesis_bounds() -> Array:
    """Bounds [m] of the thesis's rig, for which the cameras of the scene stand where they stand."""
    return np.array(layout(Parameters()).bounds)


def _frame_view(spec: mujoco.MjSpec, low: Array, high: Array) -> None:
    """Move cameras and lights such that a rig of these bounds fills the picture as the thesis's does."""
    was = _thesis_bounds().mean(axis=0)
    size, usual = high - low, _thesis_bounds()[1] - _thesis_bounds()[0]
    scale = max(float(np.linalg.norm(size) / np.linalg.norm(usual)), float(size[2] / usual[2]))
    centre = (low + high) / 2
    for camera in spec.cameras:
        camera.pos = centre + scale * (camera.pos - was)
    spec.stat.center = centre + scale * (spec.stat.center - was)
    spec.stat.extent *= scale
    floor = spec.geom("floor")
    floor.pos = [centre[0] - was[0], centre[1] - was[1], 0.0]
    floor.size = [scale * floor.size[0], scale * floor.size[1], floor.size[2]]
