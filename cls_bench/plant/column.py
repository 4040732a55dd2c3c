"""The control column: its bearing and its stop blocks."""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.plant import friction
from cls_bench.plant.play import contact_torque, dead_zone

STRIBECK = 0.01
"""Stribeck velocity of the bearing [rad/s]; without effect on its level, as static and Coulomb friction are equal, it
sets the speed above which the presliding damping fades out (assumed: well below the slowest sweep)."""


@compiled
def act(plant: Any, column: Any, joint: int, mechanism: Any, body: Any) -> None:
    """Put friction of the bearing and, beyond their angle, the stop blocks on the column; its bristle goes on."""
    angle, velocity = plant.qpos[joint], plant.qvel[joint]
    rubbed, body.bearing_bristle = friction.advance(
        body.bearing_bristle, velocity, column.coulomb_friction, 1.0, column.bristle_stiffness,
        mechanism.bearing_damping, STRIBECK, mechanism.step,
    )  # fmt: skip
    plant.force[joint] -= rubbed + column.viscous_friction * velocity
    beyond = dead_zone(angle, -column.stop_angle, column.stop_angle)
    if beyond != 0.0:
        plant.force[joint] -= contact_torque(beyond, velocity, column.stop_stiffness, column.stop_damping)
