"""The bench in three dimensions for Rerun: shapes of the bodies, and the forces on the column as arrows."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from cls_bench.geometry import Geom, along_z, plane_box, turned


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
            starts = np.array([along_z(geom, -geom.size[1]) for geom in geoms])
            return [rr.Capsules3D(lengths=2.0 * sizes[:, 1], radii=sizes[:, 0], translations=starts, **solid)]
        case "mesh":
            return [_mesh(geom) for geom in geoms]
        case _:
            raise ValueError(f"cannot draw a geom of kind {kind!r}")


def _mesh(geom: Geom) -> rr.Mesh3D:
    vertices = np.zeros((0, 3)) if geom.vertices is None else geom.vertices.astype(np.float64)
    vertices_turned = turned(np.array(geom.quaternion), vertices)
    return rr.Mesh3D(
        vertex_positions=vertices_turned + geom.position, triangle_indices=geom.faces, albedo_factor=geom.rgba
    )
