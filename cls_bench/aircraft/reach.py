"""What an aircraft's control asks of a rig, and whether the rig can give it."""

from typing import NamedTuple

import numpy as np

from cls_bench.aircraft.setting import Setting
from cls_bench.feel_laws import AFT, COLUMN, Laws
from cls_bench.parameters import DEG, Feel, Parameters
from cls_bench.rigs import figures


class Reach(NamedTuple):
    """Forces at the rig's grip [N], scales applied, and what the rig can do there."""

    largest: float
    """greatest force of the springs and friction within the travel"""
    lasting: float
    """what the rig's motor holds for good"""
    measured: float
    """what its load cell measures"""
    peak: float
    """what its motor can push with"""
    travel: float
    """farthest travel of the feel model, to the stop of the column [deg]"""
    room: float
    """travel of the rig to its limit switches [deg]"""

    @property
    def verdict(self) -> str:
        """Whether the rig can give it for good, for a short time, or not: "lasting", "short", "too weak", "too far"."""
        if self.travel > self.room:
            return "too far"
        if self.largest > min(self.measured, self.peak):
            return "too weak"
        return "lasting" if self.largest <= self.lasting else "short"


def reach(setting: Setting, rig: Parameters) -> Reach:
    """What ``setting`` asks of ``rig``. Raises FaultError if they cannot be put together."""
    p, can = setting.on(rig), figures(rig)
    feel = p.feel
    travel = max(feel.forward_limit.angle, feel.forward_limit.back) / DEG
    return Reach(
        largest_torque(feel) / p.column.grip_height, can.continuous_force, can.measurable_force, can.peak_force,
        travel, rig.column.switch_angle / DEG,
    )  # fmt: skip


def largest_torque(feel: Feel) -> float:
    """Greatest torque [N·m] at the control at rest within the travel before any stop: springs and friction.

    Of a jammed control it is the override's; where there is none the pilot decides.
    """
    laws = Laws(feel)
    friction = laws.at_rest(COLUMN)
    if laws.two and (feel.jam.of == "aft" or not feel.linkage.connected):
        return friction + (feel.linkage.override if feel.linkage.connected else 0.0)
    if laws.two:
        friction += laws.at_rest(AFT)
    ends = np.linspace(-feel.aft_limit.back, feel.aft_limit.angle, 201)
    return max(abs(_held(laws, angle)) for angle in ends.tolist()) + friction


def spring_torque(feel: Feel, angle: float) -> float:
    """Torque [N·m] that holds the control at ``angle`` [rad], as if it were of one piece; without friction."""
    return _held(Laws(feel), angle)


def _held(laws: Laws, angle: float) -> float:
    return laws.column(angle) + (laws.aft(angle) if laws.two else 0.0)
