"""Linkage between column and aft body: a pair of cables, or a rod, where the model has two bodies.

Stiffness, damping and backlash are those of thesis 3.5.1; pretension, override and disconnection go beyond it.

With the bodies' difference u = φ − φ_aft and e = |u| − backlash/2, the linkage pulls the aft body with

    T = min(override, max(0, k(e) + damping · ė)) · sign u     beyond the backlash, else 0
    k(e) = stiffness · e                                        as long as both cables are taut
         = pretension + ½ stiffness · e                         from e = 2 pretension / stiffness on: one is slack

Without backlash nothing can let go: there T is ±override at most, and the damping acts both ways.
``override`` is the preload of a spring strut that gives way, for a jam on the other side. Cables that are disconnected,
or cut, carry nothing.
"""

from typing import Any

from cls_bench.compiled import compiled
from cls_bench.feel.element import MOMENT, Element, condition_apart
from cls_bench.quantity import quantity


@compiled
def _end(piece: Any, at: float) -> bool:
    """End the piece where the bodies' difference passes ``at`` [rad]; whether it is beyond, or on its way there."""
    beyond = bool(piece.apart_ahead >= at)
    if beyond:
        piece.low[2] = max(piece.low[2], at)
    else:
        piece.high[2] = min(piece.high[2], at)
    return beyond


@compiled
def _act(feel: Any, state: Any, piece: Any) -> None:
    c = feel.linkage
    if piece.aft == 0 or not c.connected:
        return
    half = 0.5 * c.backlash
    side = 1.0
    if half > 0.0:
        forward, aft = _end(piece, half), not _end(piece, -half)
        if not forward and not aft:
            return
        side = 1.0 if forward else -1.0
    stiffness, offset = c.stiffness, -c.stiffness * side * half  # of the torque T = stiffness · u + offset
    if c.pretension > 0.0:
        taut = 2.0 * c.pretension / c.stiffness
        if _end(piece, half + taut):
            stiffness, offset = 0.5 * c.stiffness, c.pretension - 0.5 * c.stiffness * half
        elif not _end(piece, -half - taut):
            stiffness, offset = 0.5 * c.stiffness, -c.pretension + 0.5 * c.stiffness * half
    apart, rate = piece.angle[0] - piece.angle[1], piece.velocity[0] - piece.velocity[1]
    ahead = stiffness * (apart + MOMENT * rate) + offset
    ahead += c.damping * (piece.speed_ahead[0] - piece.speed_ahead[1])
    if half > 0.0 and c.damping > 0.0:  # a contact lets go when its torque has come down to zero
        if side * ahead < 0.0:
            condition_apart(piece, -side * stiffness, -side * c.damping, -side * offset)
            return
        condition_apart(piece, side * stiffness, side * c.damping, side * offset)
    if c.override > 0.0:
        if ahead > c.override:
            condition_apart(piece, stiffness, c.damping, offset - c.override)
            piece.link_offset = c.override
            return
        if ahead < -c.override:
            condition_apart(piece, -stiffness, -c.damping, -offset - c.override)
            piece.link_offset = -c.override
            return
        condition_apart(piece, -stiffness, -c.damping, c.override - offset)
        condition_apart(piece, stiffness, c.damping, c.override + offset)
    piece.link_stiffness, piece.link_damping, piece.link_offset = stiffness, c.damping, offset


class Linkage(Element):
    """A pair of cables or a rod."""

    stiffness: float = quantity(900.0, "N·m/rad", "both cables together, or the rod",
                                "assumed: 16 N·m for each degree of stretch", gt=0, le=1e6, live=True)  # fmt: skip
    damping: float = quantity(1.0, "N·m·s/rad", "damping of the stretch", "assumed: a few per cent of critical", ge=0,
                              le=1e4, live=True)  # fmt: skip
    backlash: float = quantity(0.0, "rad", "free play, from one end to the other", "assumed: none", ge=0, le=1,
                               live=True)  # fmt: skip
    pretension: float = quantity(
        0.0, "N·m", "pretension of each cable as a torque; 0 is a rod, or cables that stay taut", "assumed: a rod",
        ge=0, le=1e4, live=True,
    )
    override: float = quantity(0.0, "N·m", "torque at which the override strut gives way; 0 is none",
                               "none unless an aircraft has it", ge=0, le=1e4, live=True)  # fmt: skip
    connected: bool = quantity(True, "1", "whether it connects", "whole unless it fails", live=True)

    act = staticmethod(_act)
