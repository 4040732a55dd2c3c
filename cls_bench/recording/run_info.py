"""What a recording says about its run besides the samples."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class GeomInfo:
    """A shape fixed to a body, for drawing: sizes as MuJoCo defines them."""

    body: int
    """index into :attr:`RunInfo.body_names`"""
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


@dataclass(frozen=True)
class RunInfo:
    """All that travels in a recording beside the samples. Only ``wall_start`` may differ between equal runs."""

    scenario_name: str
    scenario_toml: bytes
    """the scenario file as read"""
    mjcf: Mapping[str, bytes]
    """model files: name -> content"""
    parameters: Mapping[str, Any]
    """all parameters of the run; must be representable in JSON"""
    metadata: Mapping[str, str]
    """seed, versions, commit, …"""
    wall_start: str
    """wall-clock time of the start, ISO 8601"""
    body_names: tuple[str, ...]
    """bodies of the model in the order of ``Block.poses``, world first"""
    geoms: tuple[GeomInfo, ...] = field(default=())
