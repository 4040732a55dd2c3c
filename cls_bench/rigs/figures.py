"""What a rig can do at its grip, in closed form from its parameters alone."""

import math
from typing import NamedTuple

from cls_bench.parameters import Parameters
from cls_bench.parameters.nameplate import inertia_at_motor
from cls_bench.rigs.modes import resonances


class Figures(NamedTuple):
    """Figures of a rig at neutral. Forces are those of the hand at the grip."""

    inertia_ratio: float
    """all inertia but the rotor's, as seen from the motor, over the rotor's (thesis 3.2.2) [1]"""
    continuous_force: float
    """what the motor holds for good [N]"""
    peak_force: float
    """what it can push with [N]"""
    measurable_force: float
    """what the load cell can measure [N]"""
    breakout_force: float
    """what moves the control with the power off; infinite if a stage is self-locking [N]"""
    backlash: float
    """play at the grip, motor held [m]"""
    encoder_step: float
    """motion of the grip for one step of the encoder [m]"""
    free_resonance: float
    """lowest one of motor and control against each other [Hz]"""
    held_resonance: float
    """lowest one with the motor held [Hz]"""
    velocity_bandwidth: float
    """of the drive's velocity controller [Hz]"""


def figures(p: Parameters) -> Figures:
    """The figures of a rig."""
    lever, grip = p.linkage.levers, p.column.grip_height
    ratio = lever.ratio
    total = p.gearbox.ratio * ratio
    modes = resonances(p)
    motor = p.motor.rotor_inertia
    constant = p.motor.torque_constant
    strongest = min(p.drive.torque_limit, constant * p.drive.peak_current)
    return Figures(
        inertia_ratio=inertia_at_motor(p.motor, p.gearbox, p.linkage, p.column) / motor - 1.0,
        continuous_force=driven_torque(p, min(constant * p.drive.continuous_current, strongest)) * ratio / grip,
        peak_force=driven_torque(p, strongest) * ratio / grip,
        measurable_force=p.load_cell.capacity * lever.column / grip,
        breakout_force=breakout_torque(p) / grip,
        backlash=grip / ratio * backlash_at_crank(p),
        encoder_step=2.0 * math.pi / (p.encoder.counts * p.encoder.interpolation) / total * grip,
        free_resonance=modes.free, held_resonance=modes.held,
        velocity_bandwidth=p.drive.velocity_bandwidth,
    )  # fmt: skip


def driven_torque(p: Parameters, torque: float) -> float:
    """Torque at the crank for a motor ``torque`` that drives, drag and mesh losses taken off [N·m]."""
    for stage in p.gearbox.in_use:
        torque = max(torque - stage.drag, 0.0) * stage.ratio * stage.efficiency
    return torque


def breakout_torque(p: Parameters) -> float:
    """Torque at the control's axis that back-drives the motor from rest, at the tooth that holds hardest [N·m].

    At each stage's input shaft: mesh/ratio · (1 − b·(1 − η)) = torque behind + b·drag, with b the static over the
    Coulomb friction times what a tooth adds. Infinite where that cannot be.
    """
    held = p.motor.cogging_amplitude
    for stage in p.gearbox.in_use:
        static = p.gearbox.breakaway_ratio * (1.0 + (stage.ripple if stage.teeth else 0.0))
        passed = 1.0 - static * (1.0 - stage.backdrive_efficiency)
        if passed <= 0.0:
            return math.inf
        held = stage.ratio * (held + static * stage.drag * stage.drag_ratio) / passed
    return held * p.linkage.levers.ratio + p.column.coulomb_friction


def backlash_at_crank(p: Parameters) -> float:
    """Play of all stages at the crank [rad]."""
    behind, play = p.gearbox.ratio, 0.0
    for stage in p.gearbox.in_use:
        behind /= stage.ratio
        play += stage.backlash / behind
    return play
