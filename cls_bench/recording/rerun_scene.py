"""The bench in three dimensions for Rerun: shapes of the bodies, and the forces on the column as arrows."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cls_bench.geometry import Geom, plane_box
from cls_bench.geometry import along_z as point_along_z

Array = NDArray[np.float64]

METRES_PER_NEWTON = 0.002
"""Length of a force's arrow."""

LONGEST_ARROW = 0.4
"""Length at which an arrow stops growing [m]."""

ARROWS = ("hand on the column", "connecting rod on the column")
"""What the arrows show."""

_GRIP = (0.0, -0.022, 0.30)
"""The site "grip" in the column's frame [m]."""

_ASIDE = np.array([0.0, -0.065, 0.0])
"""How far before the bench the arrows are drawn, to be seen [m]."""


def archetypes(kind: str, geoms: Sequence[Geom]) -> list[rr.AsComponents]:
    """Shapes of one kind and body in Rerun's terms. ValueError if Rerun cannot draw the kind."""
    sizes = np.array([geom.size for geom in geoms])
    look: dict[str, Any] = {
        "quaternions": np.array([geom.quaternion for geom in geoms])[:, [1, 2, 3, 0]],
        "colors": np.round(255 * np.array([geom.rgba for geom in geoms])).astype(np.uint8),
    }
    solid = {**look, "fill_mode": rr.components.FillMode.Solid}
    centers = np.array([geom.position for geom in geoms])
    match kind:
        case "box":
            return [rr.Boxes3D(half_sizes=sizes, centers=centers, **solid)]
        case "plane":
            half_sizes, centers = (np.array(part) for part in zip(*map(plane_box, geoms), strict=True))
            return [rr.Boxes3D(half_sizes=half_sizes, centers=centers, **solid)]
        case "sphere":
            return [rr.Ellipsoids3D(radii=sizes[:, 0], centers=centers, **solid)]
        case "ellipsoid":
            return [rr.Ellipsoids3D(half_sizes=sizes, centers=centers, **solid)]
        case "cylinder":
            return [rr.Cylinders3D(lengths=2.0 * sizes[:, 1], radii=sizes[:, 0], centers=centers, **solid)]
        case "capsule":  # Rerun's start at the origin and point along z
            starts = np.array([point_along_z(geom, -geom.size[1]) for geom in geoms])
            return [rr.Capsules3D(lengths=2.0 * sizes[:, 1], radii=sizes[:, 0], translations=starts, **solid)]
        case "mesh":
            return [_mesh(geom) for geom in geoms]
        case _:
            raise ValueError(f"cannot draw a geom of kind {kind!r}")


def _mesh(geom: Geom) -> rr.Mesh3D:
    vertices = np.zeros((0, 3)) if geom.vertices is None else geom.vertices.astype(np.float64)
    turned = _turned(np.array(geom.quaternion), vertices)
    return rr.Mesh3D(vertex_positions=turned + geom.position, triangle_indices=geom.faces, albedo_factor=geom.rgba)


def _turned(quaternion: Array, vectors: Array) -> Array:
    """``vectors`` (…, 3) turned by quaternions w, x, y, z of shape (…, 4)."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    doubled = 2.0 * np.cross(axis, vectors)
    return np.asarray(vectors + w * doubled + np.cross(axis, doubled))


def force_arrows(column: Array, rod_end: Array, hand_force: Array, rod_force: Array) -> tuple[Array, Array]:
    """Origins and vectors [m] of both arrows of :data:`ARROWS`, shape (rows, 2, 3).

    ``column`` and ``rod_end`` are poses, shape (rows, 7); forces [N], shape (rows,): the hand's positive forward, the
    rod's positive in tension, when it pulls the column back towards the crank.
    """
    x = np.array([1.0, 0.0, 0.0])
    grip = column[:, :3] + _turned(column[:, 3:], np.broadcast_to(_GRIP, (len(column), 3)))
    joint = rod_end[:, :3]
    forward = _turned(column[:, 3:], np.broadcast_to(x, (len(column), 3)))
    along_rod = _turned(rod_end[:, 3:], np.broadcast_to(x, (len(rod_end), 3)))

    def length(force: Array) -> Array:
        return np.clip(METRES_PER_NEWTON * force, -LONGEST_ARROW, LONGEST_ARROW)[:, None]

    origins = np.stack([grip, joint], axis=1) + _ASIDE
    return origins, np.stack([length(hand_force) * forward, -length(rod_force) * along_rod], axis=1)
