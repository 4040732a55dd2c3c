"""How a rig looks: where its shafts lie, and the simple shapes that stand for its parts.

Nothing here has mass. All follows from the parameters: lengths and angles of the linkage, the height of the grip, where
the stops stand, the stages of the gearbox from the crank back to the motor, and the motor's size. A shaft is a
:class:`Frame` whose y axis is its axis, towards the motor; a worm turns the frame by 90°, a spur stage or a belt moves
it aside. Wheels have the radii of their ratio as far as that can be drawn.

A spur stage has an idler, as input and output turn the same way in this bench.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.kinematics import crank_axis
from cls_bench.parameters import GearStage, Motor, Parameters

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Point = Sequence[float] | Array

PLATE = 0.02
"""Upper face of the base plate [m]."""

LOWEST_AXIS = 0.35
"""Least height of the column's axis [m]; more where something would touch the base plate."""

SIDE = 0.022
"""Column and its arm lie so far to either side of the rod's plane [m]."""

_TORQUE, _INERTIA, _RISE = 1.0, 4.0e-5, 100.0
"""The thesis's motor, by whose torque [N·m] and inertia [kg·m²] others are drawn, and its winding's rise at it [K]."""

_OUTPUT_TORQUE = 25.0
"""[N·m] for which gears are drawn as large as the thesis's."""


def about(axis: int, angle: float) -> Array:
    """Rotation matrix about x, y or z (0, 1, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    turn[j, j], turn[k, k], turn[j, k], turn[k, j] = c, c, -s, s
    return turn


ALONG_Y = about(0, math.pi / 2)
"""Turns a cylinder's axis from z to y."""


@dataclass(frozen=True)
class Frame:
    """A place in the world."""

    origin: Array
    turn: Array = field(default_factory=lambda: np.eye(3))

    def __call__(self, x: float, y: float, z: float) -> Array:
        """The world's coordinates of a point of this frame."""
        return np.asarray(self.origin + self.turn @ np.array([x, y, z]))

    def moved(self, x: float, y: float, z: float) -> "Frame":
        """The same, elsewhere; in its own directions [m]."""
        return Frame(self(x, y, z), self.turn)


class Shape(NamedTuple):
    """A geom: sizes as MuJoCo defines them, in the frame of its body."""

    name: str
    body: str  # empty: the world
    look: str  # default class of models/cls_bench.xml
    kind: str
    size: Vector
    place: Frame


@dataclass
class Layout:
    """Where all parts of a rig are at neutral, and how they look."""

    bodies: dict[str, Frame]
    """frames of the bodies; in the world"""
    shapes: list[Shape] = field(default_factory=list)

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and greatest coordinates of what is drawn [m], a little generous."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for shape in self.shapes:
            frame = self.bodies[shape.body] if shape.body else Frame(np.zeros(3))
            centre = frame(*shape.place.origin)
            half = np.abs(frame.turn @ shape.place.turn) @ np.array(_half_lengths(shape))
            low, high = np.minimum(low, centre - half), np.maximum(high, centre + half)
        return low, high


def _half_lengths(shape: Shape) -> Vector:
    a, b, c = shape.size
    return {"box": (a, b, c), "ellipsoid": (a, b, c), "cylinder": (a, a, b)}.get(shape.kind, (a, a, a + b))


def layout(p: Parameters) -> Layout:
    """The rig at neutral."""
    drawing = _Drawing(p)
    drawing.column()
    drawing.linkage()
    drawing.drive_train()
    return drawing.on_its_feet()


class Size(NamedTuple):
    """A motor against the thesis's."""

    across: float
    along: float


def motor_size(motor: Motor) -> Size:
    """How much wider and longer a motor is drawn: its volume r² l grows with its torque, its inertia with r⁴ l.

    The torque is what the winding bears for good; of large motors more for their volume. None is drawn slimmer than
    the thesis's.
    """
    lasting = motor.torque_constant * math.sqrt(_RISE / (motor.resistance * motor.thermal_resistance))
    volume, inertia = (lasting / _TORQUE) ** 0.8, motor.rotor_inertia / _INERTIA
    even = volume ** (1.0 / 3.0)
    across = even * min(max(math.sqrt(inertia / volume) / even, 1.0), 1.6)
    across = round(min(max(across, 0.5), 5.0), 2)
    return Size(across, round(min(max(volume / across**2, 0.4), 4.0), 2))


class _Drawing:
    """A rig being drawn, with the column's axis at the origin, and then put on its feet."""

    def __init__(self, p: Parameters):
        self.p = p
        x, z = crank_axis(p.linkage.four_bar)
        self.axis = Frame(np.array([x, 0.0, z]))
        self.bodies = {"column": Frame(np.zeros(3)), "limb": Frame(np.zeros(3)), "crank": self.axis}
        self.shapes: list[Shape] = []
        self.stands: list[tuple[str, Frame, float]] = []  # name, where a flange is held, half width of its post
        self.lowest = [-0.06]
        self.linked = p.linkage.kind == "four_bar"

    def put(
        self, name: str, body: str, look: str, kind: str, size: Sequence[float], frame: Frame, at: Point,
        turn: Array | None = None,
    ) -> None:  # fmt: skip
        """Add a shape at ``at`` in ``frame``, which is fixed to ``body``."""
        place = Frame(frame(*at), frame.turn if turn is None else frame.turn @ turn)
        if body:
            own = self.bodies[body]
            place = Frame(own.turn.T @ (place.origin - own.origin), own.turn.T @ place.turn)
        a, b, c = (*size, 0.0, 0.0)[:3]
        self.shapes.append(Shape(name, body, look, kind, (a, b, c), place))

    def disc(self, name: str, body: str, look: str, radius: float, half: float, frame: Frame, at: Point,
             turn: Array = ALONG_Y) -> None:  # fmt: skip
        """A cylinder about the frame's y axis."""
        self.put(name, body, look, "cylinder", (radius, half), frame, at, turn)

    def bar(self, name: str, body: str, look: str, radius: float, start: Point, end: Point,
            kind: str = "capsule") -> None:  # fmt: skip
        """A capsule from one point to another, in the body's own frame."""
        frame = self.bodies[body] if body else Frame(np.zeros(3))
        along = np.subtract(end, start)
        length = float(np.linalg.norm(along))
        x, y, z = along / length
        turn = about(2, math.atan2(y, x)) @ about(1, math.atan2(math.hypot(x, y), z))
        self.put(name, body, look, kind, (radius, length / 2), frame, np.add(start, end) / 2, turn)

    # --- column, linkage ---

    def column(self) -> None:
        """Column, arm, grip and stops."""
        c, link = self.p.column, self.p.linkage
        body, h = self.bodies["column"], c.grip_height
        arm = np.array([math.sin(link.arm_angle), 0.0, math.cos(link.arm_angle)])
        aside = np.array([0.0, SIDE, 0.0])
        self.disc("column_axle", "column", "steel", 0.010, 0.06, body, (0, 0, 0))
        self.bar("column", "column", "steel", 0.010, (0, -SIDE, -0.03), (0, -SIDE, max(h - 0.06, 0.02)))
        if self.linked:
            end = (link.arm + 0.015) * arm
            for name, side in (("column_cheek", 1.0), ("column_arm", -1.0)):
                self.bar(name, "column", "steel", 0.008, -0.03 * arm + side * aside, end + side * aside)
            self.disc("column_pin", "column", "dark", 0.006, 0.028, body, link.arm * arm)
        else:
            self.disc("torque_cell", "column", "load_cell", 0.026, 0.009, body, (0, 0.069, 0))
        self.bar("grip", "column", "dark", 0.016, (0, -SIDE, h - 0.055), (0, -SIDE, h + 0.050))
        self.bar("grip_head", "column", "dark", 0.017, (-0.006, -SIDE, h + 0.058), (0.014, -SIDE, h + 0.062))
        self.put("grip_button", "column", "red", "cylinder", (0.005, 0.006), body, (-0.010, -SIDE, h + 0.076))
        # A block's face meets the column's flank at the stop angle.
        radius, s = min(0.35 * h, 0.6 * link.arm), c.stop_angle
        for name, way in (("forward", 1.0), ("aft", -1.0)):
            along, across = np.array([math.sin(s), math.cos(s)]), np.array([math.cos(s), -math.sin(s)])
            x, z = radius * along + 0.020 * across
            self.put(f"stop_block_{name}", "", "red", "box", (0.010, 0.014, 0.012), body, (way * x, -SIDE, z),
                     about(1, way * s))  # fmt: skip
            self.stands.append((f"stop_post_{name}", Frame(np.array([way * (x + 0.010), -SIDE, z])), 0.0))
        self.lowest += [-link.arm - 0.04] if self.linked else []

    def linkage(self) -> None:
        """Crank and connecting rod."""
        link, axis = self.p.linkage, self.axis
        if not self.linked:
            return
        pin = link.crank * np.array([math.sin(link.crank_angle), 0.0, math.cos(link.crank_angle)])
        turn = about(1, link.crank_angle)
        self.put("crank", "crank", "steel", "box", (0.012, 0.006, link.crank / 2 + 0.005), axis,
                 pin / 2 + (0, 0.008, 0), turn)  # fmt: skip
        rod = self.bodies["rod"] = Frame(axis(*pin), about(1, link.rod_angle))
        end = self.bodies["rod_end"] = rod.moved(link.rod, 0, 0)
        f = min(link.rod / 0.12, 1.0)  # a rod that is shorter than the cell with its ends is drawn with a smaller one
        cell, slit = link.rod - 0.051 * f, 0.007 * f
        self.bar("rod", "rod", "steel", 0.007, (0, 0, 0), (cell - 0.028 * f, 0, 0))
        self.disc("rod_joint", "rod", "dark", 0.012, 0.012, rod, (0, 0, 0))
        self.put("load_cell", "rod", "load_cell", "box", (0.025 * f, 0.011, 0.025 * f), rod, (cell, 0, 0))
        slot = (0.018 * f, 0.0115, 0.002)
        self.put("load_cell_slot_upper", "rod", "dark", "box", slot, rod, (cell - slit, 0, 0.009 * f))
        self.put("load_cell_slot_lower", "rod", "dark", "box", slot, rod, (cell + slit, 0, -0.009 * f))
        self.put("load_cell_slot_rise", "rod", "dark", "box", (0.002, 0.0115, 0.009 * f), rod, (cell, 0, 0))
        self.bar("rod_end_bar", "rod_end", "steel", 0.007, (-0.026 * f, 0, 0), (0, 0, 0))
        self.disc("rod_end", "rod_end", "dark", 0.012, 0.012, end, (0, 0, 0))
        self.lowest.append(axis.origin[2] - link.crank - 0.04)

    # --- gearbox and motor, from the crank on ---

    def drive_train(self) -> None:
        """All between the crank and the end of the motor."""
        stages, motor = self.p.gearbox.in_use, motor_size(self.p.motor)
        scales = _scales(self.p)
        frame = self.axis
        away = 1.0 if frame.origin[0] > 0.0 else -1.0
        first = stages[-1].kind if stages else ""
        radius = 0.036 * scales[-1] if first == "planetary" else 0.024
        beside = self.linked and abs(frame.origin[0]) < 0.05 + radius  # the column's own post is in the way
        y = 0.105 if not self.linked else 0.080 if beside else 0.050
        start = 0.079 if not self.linked else -0.003
        self.flange("gearbox" if stages else "motor", frame, y, radius if stages else 0.036 * motor.across, 0.008)
        y += 0.033 if first == "planetary" else 0.014
        end = y
        for number in range(len(stages), 0, -1):
            stage, scale = stages[number - 1], scales[number - 1]
            out = "crank" if number == len(stages) else f"carrier{number}"
            into = "rotor" if number == 1 else f"carrier{number - 1}"
            draw = {"planetary": self.planetary, "spur": self.spur, "belt": self.belt, "worm": self.worm}[stage.kind]
            if number < len(stages) and stages[number].kind != "planetary":  # what comes stands on feet of its own
                self.flange(f"stage{number}", frame, y + 0.008, 0.030 * scale, 0.008)
                y += 0.020
            shaft = y
            frame, y, away = draw(number, stage, scale, out, into, frame, y, away)
            if out == "crank":
                end = shaft + 0.004
        last = stages[0].kind if stages else ""
        name = "rotor" if stages else "crank"
        if not stages:
            end = y
            y -= 0.014
        else:
            y += 0.017 if last == "planetary" else 0.012
            self.flange("motor", frame, y, 0.036 * motor.across, 0.006)
        self.motor(name, frame, y, motor)
        self.disc("output_shaft", "crank", "steel", 0.010, (end - start) / 2, self.axis, (0, (end + start) / 2, 0))

    def motor(self, body: str, frame: Frame, y: float, size: Size) -> None:
        """Housing of glass with the rotor in it, encoder and plug, behind the flange at ``y``."""
        a, half = size.across, 0.050 * size.along
        middle = y + 0.007 + half
        look = "housing"
        self.disc("motor_housing", "", look, 0.034 * a, half, frame, (0, middle, 0))
        self.disc("encoder_cap", "", "dark", 0.026 * math.sqrt(a), 0.014, frame, (0, middle + half + 0.014, 0))
        side = 1.0 if size.along > 0.5 else 0.6
        self.put("motor_plug", "", "dark", "box", (0.010, 0.012 * side, 0.010), frame,
                 (0, middle + half - 0.017 * side, 0.034 * a + 0.006))  # fmt: skip
        self.disc("rotor", body, "steel", 0.018 * a, half + 0.008, frame, (0, middle, 0))
        self.put("rotor_mark", body, "red", "box", (0.003, half + 0.008, 0.003), frame, (0, middle, 0.018 * a))
        self.lowest.append(float(frame.origin[2]) - 0.036 * a - 0.03)

    def flange(self, name: str, frame: Frame, y: float, radius: float, half: float) -> None:
        """A bearing plate on a post."""
        self.disc(f"{name}_flange", "", "frame", radius, half, frame, (0, y, 0))
        self.stands.append((f"{name}_post", frame.moved(0, y, 0), 0.7 * radius))

    def planetary(
        self, n: int, stage: GearStage, scale: float, out: str, into: str, frame: Frame, y: float, away: float
    ) -> tuple[Frame, float, float]:
        """Ring in the housing, three planets on the output's carrier, sun on the input."""
        look, ring = f"gear{n}", 0.0261 * scale
        sun = max(ring / max(stage.ratio - 1.0, 1.6), 0.08 * ring)
        planet, orbit = (ring - sun) / 2, (ring + sun) / 2
        behind = y + 0.036 * scale
        self.bodies[into] = frame.moved(0, behind, 0)
        self.disc(f"ring_gear{n}", "", "housing", 0.031 * scale, 0.017 * scale, frame, (0, y + 0.018 * scale, 0))
        self.disc(f"carrier{n}", out, "steel", 0.026 * scale, 0.004 * scale, frame, (0, y + 0.004 * scale, 0))
        for letter, angle in zip("abc", (90.0, 330.0, 210.0), strict=True):
            at = orbit * math.cos(math.radians(angle)), y + 0.020 * scale, orbit * math.sin(math.radians(angle))
            self.disc(f"planet{n}{letter}", out, look, 0.98 * planet, 0.010 * scale, frame, at)
        self.disc(f"sun{n}", into, look, sun, 0.014 * scale, frame, (0, y + 0.022 * scale, 0))
        return frame, behind, away

    def wheel(self, name: str, body: str, look: str, radius: float, half: float, frame: Frame, y: float) -> None:
        """A wheel with three marks, so that it is seen to turn."""
        self.disc(name, body, look, radius, half, frame, (0, y, 0))
        for letter, angle in zip("abc", (90.0, 330.0, 210.0), strict=True):
            at = 0.62 * radius * math.cos(math.radians(angle)), y, 0.62 * radius * math.sin(math.radians(angle))
            self.disc(f"{name}_mark_{letter}", body, "dark", 0.17 * radius, half + 0.0006, frame, at)

    def spur(
        self, n: int, stage: GearStage, scale: float, out: str, into: str, frame: Frame, y: float, away: float
    ) -> tuple[Frame, float, float]:
        """Wheel, idler and pinion in a case of glass."""
        wheel, pinion = _radii(0.045 * scale, stage.ratio, 0.007)
        idler, half, middle = max(0.7 * pinion, 0.009), 0.009 * scale, y + 0.010 * scale + 0.004
        between = wheel + 2.0 * idler + pinion
        behind, aside = y + 0.020 * scale + 0.008, frame.moved(away * between, 0, 0)
        self.bodies[into] = aside.moved(0, behind, 0)
        self.wheel(f"wheel{n}", out, f"gear{n}", wheel, half, frame, middle)
        self.wheel(f"pinion{n}", into, f"gear{n}", pinion, half, aside, middle)
        at = away * (wheel + idler), middle, 0.0
        self.disc(f"idler{n}", "", "steel", idler, half, frame, at)
        self.disc(f"idler_pin{n}", "", "dark", 0.35 * idler, half + 0.003, frame, at)
        self.disc(f"shaft{n}", into, "steel", min(0.006, 0.8 * pinion), half + 0.012, aside, (0, middle + 0.012, 0))
        reach = max(wheel, pinion) + 0.006
        self.put(f"case{n}", "", "housing", "box", ((wheel + between + pinion) / 2 + 0.006, half + 0.003, reach), frame,
                 (away * (between + pinion - wheel) / 2, middle, 0))  # fmt: skip
        self.lowest.append(float(frame.origin[2]) - reach - 0.02)
        return aside, behind, away

    def belt(
        self, n: int, stage: GearStage, scale: float, out: str, into: str, frame: Frame, y: float, away: float
    ) -> tuple[Frame, float, float]:
        """Two pulleys and the belt about them."""
        large, small = _radii(0.045 * scale, stage.ratio, 0.008)
        half, thick = 0.008 * scale, 0.0015
        middle, between = y + half + 0.006, 1.15 * (large + small) + 0.05
        behind, aside = y + 2.0 * half + 0.012, frame.moved(away * between, 0, 0)
        self.bodies[into] = aside.moved(0, behind, 0)
        for name, body, radius, where in (("wheel", out, large, frame), ("pinion", into, small, aside)):
            self.wheel(f"{name}{n}", body, f"gear{n}", radius, half, where, middle)
            for side, way in (("front", -1.0), ("back", 1.0)):
                self.disc(f"{name}{n}_{side}", body, "steel", radius + 0.004, 0.001, where,
                          (0, middle + way * (half + 0.001), 0))  # fmt: skip
        self.disc(f"shaft{n}", into, "steel", min(0.006, 0.8 * small), half + 0.010, aside, (0, middle + 0.010, 0))
        for k, (x, z, length, turn) in enumerate(_belt(large + thick, small + thick, between)):
            self.put(f"belt{n}_{k}", "", "dark", "box", (length / 2, 0.92 * half, thick), frame, (away * x, middle, z),
                     about(1, turn if away > 0.0 else math.pi - turn))  # fmt: skip
        self.lowest.append(float(frame.origin[2]) - max(large, small) - 0.03)
        return aside, behind, away

    def worm(
        self, n: int, stage: GearStage, scale: float, out: str, into: str, frame: Frame, y: float, away: float
    ) -> tuple[Frame, float, float]:
        """A wheel and the worm below it; all before it lies across."""
        wheel, worm, half = 0.042 * scale, 0.013 * scale, 0.008 * scale
        middle = y + half + 0.006
        # New axes: y along the old x, away from the column; z stays up.
        x_axis, y_axis = away * np.array([0.0, -1.0, 0.0]), away * np.array([1.0, 0.0, 0.0])
        turn = frame.turn @ np.column_stack([x_axis, y_axis, (0.0, 0.0, 1.0)])
        across = Frame(frame(0, middle, -(wheel + worm)), turn)
        reach = 0.80 * wheel
        self.bodies[into] = across.moved(0, reach + 0.012, 0)
        self.wheel(f"wheel{n}", out, f"gear{n}", wheel, half, frame, middle)
        self.disc(f"worm{n}", into, f"gear{n}", 0.72 * worm, reach, across, (0, 0, 0))
        threads = 9
        for k in range(threads):
            at = (0, reach * (2 * k / (threads - 1) - 1) * 0.9, 0)
            self.disc(f"worm{n}_thread{k}", into, "steel", worm, 0.0016 * scale, across, at,
                      about(0, math.radians(-12.0)) @ ALONG_Y)  # fmt: skip
        self.disc(f"shaft{n}", into, "steel", 0.35 * worm, reach + 0.016, across, (0, 0, 0))
        self.flange(f"worm{n}", across, -reach - 0.012, 1.5 * worm, 0.004)
        self.lowest.append(float(across.origin[2]) - 1.5 * worm - 0.03)
        return across, reach + 0.012, -away

    # --- frame ---

    def on_its_feet(self) -> Layout:
        """Lift all so that nothing touches the base plate, and add posts and plate."""
        height = max(LOWEST_AXIS, math.ceil(100.0 * (PLATE - min(self.lowest))) / 100.0)
        up = np.array([0.0, 0.0, height])
        self.bodies = {name: Frame(frame.origin + up, frame.turn) for name, frame in self.bodies.items()}
        self.shapes = [
            shape if shape.body else shape._replace(place=replace(shape.place, origin=shape.place.origin + up))
            for shape in self.shapes
        ]
        world = Frame(np.zeros(3))
        for name, y in (("left", -0.047), ("right", 0.047)):
            self.post(f"column_post_{name}", Frame(np.array([0.0, y, height])), 0.02, 0.010)
            self.disc(f"column_bearing_{name}", "", "frame", 0.019, 0.012, world, (0, y, height))
        for name, at, half in self.stands:
            held = Frame(at.origin + up, at.turn)
            if half:
                self.post(name, held, half, 0.005)
            else:
                x, y, z = held.origin
                self.bar(name, "", "frame", 0.007, (x, y, PLATE), (x, y, max(z, PLATE + 0.01)))
        fixed = Layout({}, [shape for shape in self.shapes if not shape.body])
        low, high = fixed.bounds
        margin = np.array([0.09, 0.06, 0.0])
        low, high = low - margin, high + margin * (1.0, 0.0, 0.0)
        middle, half_size = (low + high) / 2, (high - low) / 2
        self.put("base_plate", "", "dark", "box", (half_size[0], half_size[1], PLATE / 2), world,
                 (middle[0], middle[1], PLATE / 2))  # fmt: skip
        return Layout(self.bodies, self.shapes)

    def post(self, name: str, held: Frame, width: float, depth: float) -> None:
        """A post from the plate up to where something is held; ``depth`` along the shaft."""
        half = (held.origin[2] - PLATE) / 2
        self.put(name, "", "frame", "box", (width, depth, half), held, (0, 0, -half))


def _scales(p: Parameters) -> list[float]:
    """Size of each stage against the thesis's, after the torque at its output; planetary ones in a row are alike."""
    motor, ratio = motor_size(p.motor), 1.0
    torque = (motor.across**2 * motor.along) ** 1.25 * _TORQUE
    scales = []
    for stage in p.gearbox.in_use:
        ratio *= stage.ratio
        scales.append(round(min(max((torque * ratio / _OUTPUT_TORQUE) ** (1.0 / 3.0), 0.6), 2.5), 2))
    kinds = [stage.kind for stage in p.gearbox.in_use]
    for kind, run in itertools.groupby(range(len(kinds)), key=kinds.__getitem__):
        members = list(run)
        if kind == "planetary":
            for k in members:
                scales[k] = max(scales[m] for m in members)
    return scales


def _radii(large: float, ratio: float, least: float) -> tuple[float, float]:
    """Radii of output and input wheel, the greater of them ``large``."""
    if ratio >= 1.0:
        return large, max(large / ratio, least)
    return max(large * ratio, least), large


def _belt(large: float, small: float, between: float) -> Iterator[tuple[float, float, float, float]]:
    """Pieces of a belt about pulleys at 0 and ``between``: middle (x, z), length [m], turn about y [rad]."""
    lean = math.asin((large - small) / between)

    def point(pulley: float, radius: float, angle: float) -> tuple[float, float]:
        return pulley + radius * math.cos(angle), radius * math.sin(angle)

    upper = math.pi / 2 - lean  # where the runs touch, from the x axis
    path = [point(between, small, a) for a in np.linspace(-upper, upper, 7)]
    path += [point(0.0, large, a) for a in np.linspace(upper, 2.0 * math.pi - upper, 15)]
    for (x0, z0), (x1, z1) in itertools.pairwise([*path, path[0]]):
        yield (x0 + x1) / 2, (z0 + z1) / 2, math.hypot(x1 - x0, z1 - z0), math.atan2(z0 - z1, x1 - x0)
