"""Shapes that viewers define otherwise than MuJoCo does."""

from cls_bench.recording.run_info import GeomInfo

Vector = tuple[float, float, float]

PLANE_HALF_LENGTH = 1.0
"""Drawn half length of a plane that is infinite in the model [m]."""

PLANE_HALF_THICKNESS = 0.0005
"""[m]"""


def along_z(geom: GeomInfo, distance: float) -> Vector:
    """The point ``distance`` [m] from the geom's centre along its own z axis, in the body's frame [m]."""
    w, x, y, z = geom.quaternion
    axis = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    px, py, pz = geom.position
    return (px + distance * axis[0], py + distance * axis[1], pz + distance * axis[2])


def capsule_ends(geom: GeomInfo) -> tuple[Vector, Vector]:
    """Centres of the two half spheres of a capsule, in the body's frame [m]."""
    return along_z(geom, -geom.size[1]), along_z(geom, geom.size[1])


def plane_box(geom: GeomInfo) -> tuple[Vector, Vector]:
    """Half lengths and centre [m] of the thin box whose upper face is the plane."""
    x, y, _ = geom.size
    half = (x or PLANE_HALF_LENGTH, y or PLANE_HALF_LENGTH, PLANE_HALF_THICKNESS)
    return half, along_z(geom, -PLANE_HALF_THICKNESS)
