"""The MuJoCo model that is stepped: the hinges of every axis with their inertias and weights, and nothing else.

What acts between them are the laws of this package (:mod:`cls_bench.plant.mechanism`); there is no constraint, so
MuJoCo has nothing to solve. The same mechanism with all that is to be seen of it, and with MuJoCo's own elements in
place of our laws, is :mod:`cls_bench.plant.mjcf`; a test holds the two together.
"""

import math
from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from cls_bench.parameters import GRAVITY, Parameters
from cls_bench.parameters.inertias import column_inertia, limb_inertia, shaft_inertias

_LIGHT = 1e-6
"""Mass [kg] of bodies that have an inertia alone; MuJoCo wants it positive."""


def prefixed(axis: str, name: str) -> str:
    """Name of a joint or body of an axis: as it is for the only one, ``pitch/column`` for one of several."""
    return f"{axis}/{name}" if axis else name


def shaft_names(stages: int) -> list[str]:
    """Joints from the motor to the crank; without a stage the motor sits on the crank."""
    return ["motor", *(f"carrier{k}" for k in range(1, stages)), "crank"] if stages else ["crank"]


def crank_inertia(p: Parameters) -> float:
    """Inertia [kg·m²] of the crank's shaft with what is at its pin, without the rod's far mass."""
    return shaft_inertias(p)[-1] + p.linkage.masses[0] * p.linkage.four_bar.crank ** 2


def _weights(p: Parameters) -> dict[str, tuple[float, float, float, float]]:
    """Of each joint's body: inertia about the joint [kg·m²], mass [kg], and its centre of mass (x, z) [m]."""
    shafts = shaft_inertias(p)
    at_crank, _, end = p.linkage.masses
    bar = p.linkage.four_bar
    bodies = {name: (j, 0.0, 0.0, 0.0) for name, j in zip(shaft_names(p.gearbox.stages), shafts, strict=True)}
    pin = bar.crank * math.sin(bar.crank_angle), bar.crank * math.cos(bar.crank_angle)
    bodies["crank"] = (crank_inertia(p), at_crank, *pin)
    mass = p.column.mass + end
    x = end * bar.arm * math.sin(bar.arm_angle) / mass
    z = (p.column.mass * p.column.mass_height + end * bar.arm * math.cos(bar.arm_angle)) / mass
    bodies["column"] = (column_inertia(p), mass, x, z)
    bodies["limb"] = (limb_inertia(p), 0.0, 0.0, 0.0)
    return bodies


def build(axes: Mapping[str, Parameters]) -> mujoco.MjModel:
    """The compiled model of ``axes``, parameters by name; the only one may be called "". Raises ValueError."""
    spec = mujoco.MjSpec()
    first = next(iter(axes.values()))
    option, off = spec.option, mujoco.mjtDisableBit
    option.timestep = first.rates.clock.tick_s / first.simulation.substeps
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.gravity = [0.0, 0.0, -GRAVITY]
    # All that the model has not, so that MuJoCo does not look for it; and no fresh start in silence when it diverges.
    option.disableflags = int(
        off.mjDSBL_CONSTRAINT | off.mjDSBL_CONTACT | off.mjDSBL_SPRING | off.mjDSBL_DAMPER | off.mjDSBL_ACTUATION
        | off.mjDSBL_SENSOR | off.mjDSBL_EULERDAMP | off.mjDSBL_WARMSTART | off.mjDSBL_ISLAND | off.mjDSBL_AUTORESET
    )  # fmt: skip
    for axis, p in axes.items():
        order = ["column", "limb", *shaft_names(p.gearbox.stages)]
        weights = _weights(p)
        for name in order:
            body = spec.worldbody.add_body(name=prefixed(axis, name))
            body.add_joint(name=prefixed(axis, name), type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
            body.explicitinertial = True
            # Inertias that change from step to step, and weights that may come to lie off the axis, are no constants.
            body.simple = name not in ("column", "crank")
            body.mass, body.ipos, body.inertia = _inertial(*weights[name])
    return spec.compile()


def _inertial(inertia: float, mass: float, x: float, z: float) -> tuple[float, list[float], list[float]]:
    about_centre = inertia - mass * (x * x + z * z)
    return max(mass, _LIGHT), [x, 0.0, z] if mass else [0.0] * 3, [about_centre] * 3


def set_weights(model: Any, axis: str, p: Parameters) -> None:
    """Give the bodies of an axis other inertias and weights in the compiled model, also between two steps of a run."""
    changed = False
    for name, (inertia, mass, x, z) in _weights(p).items():
        body = model.body(prefixed(axis, name))
        new = _inertial(inertia, mass, x, z)
        if body.mass[0] != new[0] or not np.array_equal(body.ipos, new[1]) or not np.array_equal(body.inertia, new[2]):
            body.mass[0], body.ipos[:], body.inertia[:] = new
            changed = True
    if changed:  # MuJoCo keeps the mass matrix of unbranched joints as a constant
        mujoco.mj_setConst(model, mujoco.MjData(model))


def find_joints(model: Any, axis: str, stages: int, joints: Any) -> None:
    """Put the places of an axis's joints into the record ``joints``."""

    def place(name: str) -> int:
        return int(model.joint(prefixed(axis, name)).qposadr[0])

    names = shaft_names(stages)
    joints.column, joints.limb = place("column"), place("limb")
    joints.motor, joints.crank = place(names[0]), place("crank")
    joints.shafts[:] = [place(name) for name in names] + [place("crank")] * (len(joints.shafts) - len(names))
