"""What an aircraft's control asks of a rig, and whether the rig can give it."""

from typing import NamedTuple

import numpy as np

from cls_bench.aircraft.setting import Setting
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
    friction = max(feel.friction, feel.static_friction)
    if feel.bodies == "two" and (feel.jam.of == "aft" or not feel.linkage.connected):
        return friction + (feel.linkage.override if feel.linkage.connected else 0.0)
    friction += (1.0 - feel.hydraulics.pressure) * feel.hydraulics.off_friction
    if feel.bodies == "two":
        friction += max(feel.aft.friction, feel.aft.static_friction)
    ends = np.linspace(-feel.aft_limit.back, feel.aft_limit.angle, 201)
    return max(abs(spring_torque(feel, float(angle))) for angle in ends) + friction


def spring_torque(feel: Feel, angle: float) -> float:
    """Torque [N·m] at rest at ``angle`` [rad] of a single body, without friction and stops; forward positive."""
    unit = 0.0 if feel.trim.released else 1.0 - feel.hydraulics.feel_share * (1.0 - feel.hydraulics.pressure)
    q = feel.flight.dynamic_pressure
    x = angle - feel.neutral
    held = min(max(feel.centering.stiffness * x, -feel.centering.breakout), feel.centering.breakout)
    torque = unit * ((feel.stiffness + min(feel.q_feel.gradient * q, feel.q_feel.most)) * x + held)
    torque -= _detents(feel, angle)
    s = feel.surface
    if s.area > 0.0:
        borne = 1.0 - s.boost * feel.hydraulics.pressure
        deflection, ratio = _gearing(feel, angle)
        hinge = s.hinge_zero + s.hinge_alpha * feel.flight.angle_of_attack + s.hinge_tab * feel.flight.tab
        hinge += s.hinge_deflection * deflection
        torque -= borne * ratio * q * s.area * s.chord * hinge
    return torque - feel.down_spring.torque - feel.bob_weight.torque * feel.flight.load_factor


def _gearing(feel: Feel, angle: float) -> tuple[float, float]:
    """Deflection of the surface [rad] and its slope at an ``angle`` of the control [rad]; past a table, its end's."""
    x, y = feel.surface.control_angle, feel.surface.deflection
    if not x:
        return feel.surface.gearing * angle, feel.surface.gearing
    k = min(max(int(np.searchsorted(x, angle, side="right")) - 1, 0), len(x) - 2)
    ratio = (y[k + 1] - y[k]) / (x[k + 1] - x[k])
    return y[k] + ratio * (angle - x[k]), ratio


def _detents(feel: Feel, angle: float) -> float:
    """Torque [N·m] of the detents on the control at ``angle`` [rad]."""
    torque, d = 0.0, feel.detents
    for place, width, peak in zip(d.place, d.width, d.torque, strict=True):
        share = (angle - place) / width + 0.5
        if not 0.0 < share < 1.0:
            continue
        if d.profile:
            torque += peak * float(np.interp(share, np.linspace(0.0, 1.0, len(d.profile)), d.profile))
        else:
            torque -= peak * float(np.sin(2.0 * np.pi * (share - 0.5)))
    return torque
