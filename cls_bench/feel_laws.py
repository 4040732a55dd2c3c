"""The feel model's laws for theory: torques on each body over angles and velocities, written from thesis 2.2 and 3.5.

Nothing here is taken from the feel model that runs (:mod:`cls_bench.feel`) but the names of its parameters: free
response, static curve and linear model follow from these laws, so that their agreement with the bench is evidence::

    I_col φ̈  = T_hand − column(φ, φ̇) − link(φ − φ_aft, φ̇ − φ̇_aft) − friction
    I_aft φ̈_aft =       − aft(φ_aft, φ̇_aft) + link(φ − φ_aft, φ̇ − φ̇_aft) − friction

With one body both restoring torques act on it. The model is taken as settled and calm: trim has arrived, the autopilot
too, a pusher that is engaged pushes with all its torque unless its time is limited; shaker, vibration and gusts, which
have no mean, are left out.
"""

import math
from bisect import bisect_right
from itertools import pairwise
from typing import NamedTuple

from cls_bench.parameters import Feel, TravelLimit

COLUMN, AFT = 0, 1

_SMALL = 1e-6
"""Half of the difference [rad, rad/s] over which slopes are taken: exact for lines, 1e-12 of a detent's sine."""


def clip(value: float, most: float) -> float:
    """``value`` within ±``most``."""
    return max(-most, min(most, value))


def _stop(limit: TravelLimit, angle: float, velocity: float) -> float:
    """A stop presses with c e + d ė while that is positive, e being how far the body is beyond it."""
    if angle > limit.angle:
        return max(0.0, limit.stiffness * (angle - limit.angle) + limit.damping * velocity)
    back = limit.back_angle if limit.back_angle > 0.0 else limit.angle
    if angle < -back:
        return -max(0.0, -limit.stiffness * (angle + back) - limit.damping * velocity)
    return 0.0


class Slopes(NamedTuple):
    """Stiffness [N·m/rad] and damping [N·m·s/rad] of what acts on each body, and of the linkage between them."""

    column: float
    column_damping: float
    aft: float
    aft_damping: float
    link: float
    link_damping: float


class Laws:
    """The laws with the parameters ``feel``: restoring torques [N·m], positive where they drive back."""

    def __init__(self, feel: Feel) -> None:
        self.feel = feel
        self.two = feel.bodies == "two"
        flight, hydraulics, s = feel.flight, feel.hydraulics, feel.surface
        pusher = feel.pusher
        pushes = pusher.torque if pusher.engaged and pusher.longest == 0.0 else 0.0
        self._on_column = feel.bob_weight.torque * flight.load_factor + feel.down_spring.torque + pushes
        self._on_aft = feel.autopilot.torque + feel.disturbance.torque
        left = 0.0 if feel.trim.released else 1.0 - hydraulics.feel_share * (1.0 - hydraulics.pressure)
        self._spring = left * (feel.stiffness + min(feel.q_feel.gradient * flight.dynamic_pressure, feel.q_feel.most))
        self._unit, self._breakout = left * feel.centering.stiffness, left * feel.centering.breakout
        self._linear_damping = (1.0 - hydraulics.pressure) * hydraulics.off_damping
        if feel.trim.released:
            self._linear_damping += feel.trim.release_damping
        self._borne = (1.0 - s.boost * hydraulics.pressure) * flight.dynamic_pressure * s.area * s.chord
        self._at_neutral = s.hinge_zero + s.hinge_alpha * flight.angle_of_attack + s.hinge_tab * flight.tab
        self._rate = s.hinge_rate * s.chord / (2.0 * flight.airspeed) if flight.airspeed > 0.0 else 0.0
        self.fastest_rate = math.inf  # of the aft body's actuator [rad/s]
        if hydraulics.maximum_rate > 0.0 and hydraulics.pressure > 0.0:
            self.fastest_rate = hydraulics.maximum_rate * math.sqrt(hydraulics.pressure)
        self.rate_damping = hydraulics.pressure * hydraulics.rate_damping  # beyond it [N·m·s/rad]
        self._detents = tuple(zip(feel.detents.place, feel.detents.width, feel.detents.torque, strict=True))
        off = (1.0 - hydraulics.pressure) * hydraulics.off_friction
        column = [feel.friction, max(feel.friction, feel.static_friction), feel.stribeck_velocity]
        aft = [feel.aft.friction, max(feel.aft.friction, feel.aft.static_friction), feel.aft.stribeck_velocity]
        for k in range(2):
            (aft if self.two else column)[k] += off
        self._friction = (tuple(column), tuple(aft))
        self.inertia = (feel.inertia, feel.aft.inertia)
        jammed = feel.jam.of
        self.jammed = (jammed == "forward" or (jammed == "aft" and not self.two), jammed == "aft" and self.two)

    # What restores

    def column(self, angle: float, velocity: float = 0.0) -> float:
        """On the body at the column, of all that stands there; with one body, of everything."""
        torque = _stop(self.feel.forward_limit, angle, velocity) + self.feel.damping * velocity - self._on_column
        return torque if self.two else torque + self._seated(angle, velocity)

    def aft(self, angle: float, velocity: float = 0.0) -> float:
        """On the aft body, of all that stands there but the linkage."""
        return self._seated(angle, velocity) + self.feel.aft.damping * velocity

    def _seated(self, angle: float, velocity: float) -> float:
        """Feel unit, surface, autopilot and all else that acts on the aft body, or on the one there is."""
        feel = self.feel
        offset = angle - feel.neutral
        torque = self._spring * offset + clip(self._unit * offset, self._breakout) - self._on_aft
        torque += _stop(feel.aft_limit, angle, velocity) + self._linear_damping * velocity
        if self._borne != 0.0:
            deflection, ratio = self._gearing(angle)
            coefficient = self._at_neutral + feel.surface.hinge_deflection * deflection + self._rate * ratio * velocity
            torque -= self._borne * ratio * coefficient
        for place, width, peak in self._detents:
            if -0.5 * width <= angle - place < 0.5 * width:
                torque += self._detent(angle - place, width, peak)
        unbalance = feel.unbalance
        torque -= feel.flight.load_factor * (unbalance.torque + unbalance.gradient * (angle - unbalance.level))
        servo = feel.autopilot
        if servo.engaged:
            torque += clip(servo.stiffness * (angle - servo.reference) + servo.damping * velocity, servo.clutch)
        if abs(velocity) > self.fastest_rate:
            torque += self.rate_damping * (velocity - math.copysign(self.fastest_rate, velocity))
        return torque

    def _gearing(self, angle: float) -> tuple[float, float]:
        """Deflection of the surface [rad] and dδ/dφ: straight between the table's points, and on beyond its ends."""
        s = self.feel.surface
        if not s.control_angle:
            return s.gearing * angle, s.gearing
        k = min(max(bisect_right(s.control_angle, angle) - 1, 0), len(s.control_angle) - 2)
        ratio = (s.deflection[k + 1] - s.deflection[k]) / (s.control_angle[k + 1] - s.control_angle[k])
        return s.deflection[k] + ratio * (angle - s.control_angle[k]), ratio

    def _detent(self, offset: float, width: float, peak: float) -> float:
        profile = self.feel.detents.profile
        if not profile:
            return peak * math.sin(2.0 * math.pi * offset / width)
        at = (offset / width + 0.5) * (len(profile) - 1)
        k = min(int(at), len(profile) - 2)
        return -peak * (profile[k] + (at - k) * (profile[k + 1] - profile[k]))

    def link(self, apart: float, rate: float = 0.0) -> float:
        """Torque of the linkage on the aft body, over the bodies' difference, column less aft.

        Without backlash it holds both ways, its damper too; with backlash a contact presses, and never pulls.
        """
        c = self.feel.linkage
        if not (self.two and c.connected):
            return 0.0
        half, way = 0.5 * c.backlash, math.copysign(1.0, apart)
        stretch = abs(apart) - half
        if stretch < 0.0:
            return 0.0
        taut = 2.0 * c.pretension / c.stiffness
        spring = c.stiffness * stretch
        if c.pretension > 0.0 and stretch > taut:  # one cable is slack
            spring = c.pretension + 0.5 * c.stiffness * stretch
        torque = spring + c.damping * rate * way
        if half > 0.0:
            torque = max(0.0, torque)
        return way * (clip(torque, c.override) if c.override > 0.0 else torque)

    def net(self, column: float, column_speed: float, aft: float, aft_speed: float) -> tuple[float, float]:
        """Torque that drives each body, friction left out, hand off; with one body the second is nothing."""
        if not self.two:
            return -self.column(column, column_speed), 0.0
        link = self.link(column - aft, column_speed - aft_speed)
        return -self.column(column, column_speed) - link, link - self.aft(aft, aft_speed)

    # Friction

    def at_rest(self, body: int) -> float:
        """Greatest friction of a body at rest [N·m]."""
        return self._friction[body][1]

    def friction(self, body: int, speed: float) -> float:
        """Friction of a body that moves [N·m]: Coulomb's, and above it Stribeck's where it falls with the speed."""
        coulomb, static, falls = self._friction[body]
        return coulomb if falls <= 0.0 else coulomb + (static - coulomb) * math.exp(-abs(speed) / falls)

    def falls(self, body: int) -> float:
        """How steeply friction falls from rest [N·m·s/rad]; infinite where it falls at once."""
        coulomb, static, falls = self._friction[body]
        if static == coulomb:
            return 0.0
        return (static - coulomb) / falls if falls > 0.0 else math.inf

    # Slopes

    def fastest(self) -> tuple[float, float]:
        """Bounds of stiffness [N·m/rad] and damping [N·m·s/rad] on the aft body, off its stop, below its rate limit."""
        feel, s, servo = self.feel, self.feel.surface, self.feel.autopilot
        table = zip(pairwise(s.control_angle), pairwise(s.deflection), strict=True)
        ratios = [(y - x) / (b - a) for (a, b), (x, y) in table]
        ratio = max(map(abs, ratios), default=abs(s.gearing))
        steepest = [peak * 2.0 * math.pi / width for _, width, peak in self._detents]
        steepest += [
            peak * abs(b - a) * (len(feel.detents.profile) - 1) / width
            for _, width, peak in self._detents for a, b in pairwise(feel.detents.profile)
        ]  # fmt: skip
        stiffness = feel.linkage.stiffness + self._spring + self._unit + max(steepest, default=0.0)
        stiffness += abs(self._borne * s.hinge_deflection) * ratio**2
        stiffness += abs(feel.flight.load_factor * feel.unbalance.gradient)
        damping = feel.linkage.damping + feel.aft.damping + self._linear_damping - self._borne * self._rate * ratio**2
        if servo.engaged:
            stiffness, damping = stiffness + servo.stiffness, damping + servo.damping
        falls = self.falls(AFT)
        return stiffness, damping + (falls if falls < math.inf else 0.0)

    def slopes(self, column: float, aft: float) -> Slopes:
        """Stiffness and damping of each part where the bodies are, at rest.

        At a kink it is the mean of both sides. Of the linkage: as if backlash were taken up, which is how the meshes of
        a linear plant are taken; at no stretch both cables are taut.
        """
        c = self.feel.linkage
        stretch = max(abs(column - aft) - 0.5 * c.backlash, 0.0)
        carries = self.two and c.connected and not 0.0 < c.override < abs(self.link(column - aft)) * (1.0 + 1e-9)
        slack = c.pretension > 0.0 and stretch > 2.0 * c.pretension / c.stiffness
        h = _SMALL
        return Slopes(
            (self.column(column + h) - self.column(column - h)) / (2.0 * h),
            (self.column(column, h) - self.column(column, -h)) / (2.0 * h),
            (self.aft(aft + h) - self.aft(aft - h)) / (2.0 * h),
            (self.aft(aft, h) - self.aft(aft, -h)) / (2.0 * h),
            (0.5 if slack else 1.0) * c.stiffness if carries else 0.0,
            c.damping if carries else 0.0,
        )
