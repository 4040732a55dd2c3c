"""What a recording says about its run besides the samples."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cls_bench.geometry import Geom
from cls_bench.signals import Clock


@dataclass(frozen=True)
class RunInfo:
    """All that travels in a recording beside the samples. Only ``wall_start`` may differ between equal runs."""

    scenario_name: str
    scenario_toml: bytes
    """the scenario file as read"""
    mjcf: Mapping[str, bytes]
    """files that shaped the run: the model's, and the sample files that the scenario names; name -> content"""
    parameters: Mapping[str, Any]
    """all parameters of the run; must be representable in JSON"""
    metadata: Mapping[str, str]
    """seed, versions, commit, …"""
    wall_start: str
    """wall-clock time of the start, ISO 8601"""
    body_names: tuple[str, ...]
    """bodies of the model in the order of ``Block.poses``, world first"""
    geoms: tuple[Geom, ...] = field(default=())
    clock: Clock = field(kw_only=True)
    """rates of the run"""
