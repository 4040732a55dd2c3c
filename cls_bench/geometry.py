"""Shapes of the bodies, for drawing: what viewers are told, and where they define a shape otherwise than MuJoCo."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Geom:
    """A shape fixed to a body, for drawing: sizes as MuJoCo defines them."""

    body: int
    """index of the body it is fixed to; 0 is the world"""
    kind: str
    """``box``, ``capsule``, ``cylinder``, ``sphere``, ``ellipsoid``, ``plane`` or ``mesh``"""
    size: tuple[float, float, float]
    """half lengths, or radius and half length [m]"""
    position: tuple[float, float, float]
    """in the body's frame [m]"""
    quaternion: tuple[float, float, float, float]
    """w, x, y, z in the body's frame"""
    rgba: tuple[float, float, float, float]
    """0 … 1"""
    vertices: NDArray[np.float32] | None = None
    """of a mesh, shape (n, 3) [m]"""
    faces: NDArray[np.int32] | None = None
    """of a mesh, shape (m, 3): indices of three vertices"""


Vector = tuple[float, float, float]
Array = NDArray[np.float64]

PLANE_HALF_LENGTH = 1.0
"""Drawn half length of a plane that is infinite in the model [m]."""

PLANE_HALF_THICKNESS = 0.0005
"""[m]"""


def along_z(geom: Geom, distance: float) -> Vector:
    """The point ``distance`` [m] from the geom's centre along its own z axis, in the body's frame [m]."""
    w, x, y, z = geom.quaternion
    axis = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    px, py, pz = geom.position
    return (px + distance * axis[0], py + distance * axis[1], pz + distance * axis[2])


def capsule_ends(geom: Geom) -> tuple[Vector, Vector]:
    """Centres of the two half spheres of a capsule, in the body's frame [m]."""
    return along_z(geom, -geom.size[1]), along_z(geom, geom.size[1])


def plane_box(geom: Geom) -> tuple[Vector, Vector]:
    """Half lengths and centre [m] of the thin box whose upper face is the plane."""
    x, y, _ = geom.size
    half = (x or PLANE_HALF_LENGTH, y or PLANE_HALF_LENGTH, PLANE_HALF_THICKNESS)
    return half, along_z(geom, -PLANE_HALF_THICKNESS)


# --- forces on the column as arrows ---

METRES_PER_NEWTON = 0.003
"""Length of a drawn force."""

LONGEST_ARROW = 0.45
"""Length at which an arrow stops growing [m]."""

ARROWS = ("hand on the column", "connecting rod on the column")
"""What the arrows show."""

GRIP_HEIGHT = 0.30
"""Height of the grip on the thesis's rig [m]."""

_GRIP_ASIDE = -0.022
"""How far the grip lies aside of the plane of the linkage [m]."""

_ASIDE = np.array([0.0, -0.065, 0.0])
"""How far before the bench the arrows are drawn, to be seen [m]."""


def turned(quaternion: Array, vectors: Array) -> Array:
    """``vectors`` (…, 3) turned by quaternions w, x, y, z of shape (…, 4)."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    doubled = 2.0 * np.cross(axis, vectors)
    return np.asarray(vectors + w * doubled + np.cross(axis, doubled))


def force_arrows(
    column: Array, rod_end: Array | None, hand_force: Array, rod_force: Array, grip_height: float = GRIP_HEIGHT
) -> tuple[Array, Array]:
    """Origins and vectors [m] of the arrows of :data:`ARROWS`, shape (rows, 2, 3); without a rod of the first alone.

    ``column`` and ``rod_end`` are poses, shape (rows, 7), the grip is ``grip_height`` [m] above the column's axis;
    forces [N], shape (rows,): the hand's positive forward, the rod's positive in tension, when it pulls the column back
    towards the crank.
    """
    x = np.array([1.0, 0.0, 0.0])

    def length(force: Array) -> Array:
        return np.clip(METRES_PER_NEWTON * force, -LONGEST_ARROW, LONGEST_ARROW)[:, None]

    site = np.array([0.0, _GRIP_ASIDE, grip_height])
    origins = [column[:, :3] + turned(column[:, 3:], np.broadcast_to(site, (len(column), 3)))]
    vectors = [length(hand_force) * turned(column[:, 3:], np.broadcast_to(x, (len(column), 3)))]
    if rod_end is not None:
        origins.append(rod_end[:, :3])
        vectors.append(-length(rod_force) * turned(rod_end[:, 3:], np.broadcast_to(x, (len(rod_end), 3))))
    return np.stack(origins, axis=1) + _ASIDE, np.stack(vectors, axis=1)
