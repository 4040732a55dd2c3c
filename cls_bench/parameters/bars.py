"""A linkage's lengths and angles: of the linkage there is, and of the one that drive and PLC believe in."""

import math
from typing import Any, NamedTuple

from cls_bench.kinematics import FourBar


class Levers(NamedTuple):
    """Levers of a linkage at neutral [m]."""

    crank: float
    """of the rod's force about the crank's axis"""
    column: float
    """of the rod's force about the control's axis"""
    across: float
    """of a force across the rod, at the control's joint, about the control's axis"""

    @property
    def ratio(self) -> float:
        """Linkage ratio dφc/dφ at neutral."""
        return self.column / self.crank


def four_bar_of(kind: str, bars: Any) -> FourBar:
    """Lengths and angles for :mod:`cls_bench.kinematics`; a shaft is a linkage without a rod."""
    if kind == "none":
        return FourBar(bars.arm, 0.0, bars.arm, bars.arm_angle, 0.0, bars.arm_angle)
    return FourBar(bars.crank, bars.rod, bars.arm, bars.crank_angle, bars.rod_angle, bars.arm_angle)


def levers_of(kind: str, bars: Any) -> Levers:
    """Levers at neutral; a shaft's torque cell is a force at ``arm`` on either side."""
    if kind == "none":
        return Levers(bars.arm, bars.arm, 0.0)
    of_crank, of_arm = bars.crank_angle - bars.rod_angle, bars.arm_angle - bars.rod_angle
    return Levers(bars.crank * math.cos(of_crank), bars.arm * math.cos(of_arm), -bars.arm * math.sin(of_arm))
