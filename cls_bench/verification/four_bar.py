"""A four-bar of any geometry swinging freely on its elastic rod: Lagrange's equations, and its energy."""

import math
from collections.abc import Iterator

import numpy as np

from cls_bench.parameters import DEG, GRAVITY, Column, Gearbox, Linkage, LoadCell, Motor, Parameters
from cls_bench.verification import reduced_model
from cls_bench.verification.reading import Array
from cls_bench.verification.reduced_model import Guide
from cls_bench.verification.rigs import BELOW, TILTED
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Feedback, Record, Subject

GROUP = "four-bar"

GEOMETRIES = {
    "upright": Linkage(),
    "tilted": TILTED,
    "rod below both axes": BELOW,
    "crank longer than the arm, its axis above": Linkage(
        crank=0.22, rod=0.30, arm=0.15, crank_angle=-35.0 * DEG, rod_angle=20.0 * DEG, arm_angle=30.0 * DEG
    ),
    "short and heavy rod": Linkage(
        crank=0.12, rod=0.16, arm=0.14, crank_angle=-8.0 * DEG, rod_angle=-10.0 * DEG, arm_angle=-5.0 * DEG,
        rod_crank_mass=0.3, rod_column_mass=1.5, rod_end_mass=0.2,
    ),
}  # fmt: skip

SPRING = 15.0
"""Stiffness [N·m/rad] that holds the crank, so that no geometry runs into its dead centre."""

PUSH, OVER, DURATION = 5.0, 0.3, 2.0
"""The column is pushed by up to so much [N·m] for so long [s]; what follows is free."""


def _lossless(link: Linkage) -> Parameters:
    """A rotor, a linkage and a column that lose nothing, without stops."""
    column = Column(coulomb_friction=0.0, viscous_friction=0.0).model_copy(update={"stop_angle": 1e6})
    p = Parameters(
        motor=Motor(rotor_inertia=2e-3), gearbox=Gearbox(stages=0, input_inertia=0.0), linkage=link,
        load_cell=LoadCell(damping_ratio=0.0),
    )  # fmt: skip
    return p.model_copy(update={"column": column})


def free(subject: Subject) -> Iterator[Row]:
    """Column angle against the reduced model, and energy, which nothing takes away once the push is over."""
    for name, link in GEOMETRIES.items():
        p = _lossless(link)
        specimen = subject.plant(p)
        time = specimen.times(DURATION)
        push = PUSH * np.where(time < OVER, np.sin(np.pi * time / OVER) ** 2, 0.0)
        record = specimen.run(time, {"column": push}, feedback={"crank": Feedback(SPRING)})
        still = np.zeros(len(time))
        expected = reduced_model.follow(p, time, still, push, guide=Guide(SPRING, 0.0, still, still))[:, 1]
        deviation = record.angle["column"] - expected
        swing = float(np.max(np.abs(expected)))
        yield Row(GROUP, f"{name}, swing of ±{math.degrees(swing):.0f}°: worst deviation of the column angle", "rad",
                  0.0, "Lagrange's equations (solve_ivp)", float(deviation[np.argmax(np.abs(deviation))]),
                  5e-4 * swing, relative=False)  # fmt: skip
        total, kinetic = _energy(p, record)
        after = time[:-1] > OVER
        change = float(np.ptp(total[after]) / np.max(kinetic[after]))
        yield Row(GROUP, f"{name}: change of its energy after the push, of the most in motion", "1", 0.0,
                  "conservation", change, 5e-4, relative=False)  # fmt: skip


def _energy(p: Parameters, record: Record) -> tuple[Array, Array]:
    """All energy and that of motion [J], an entry a step but the last.

    The speeds are those of the middles of the steps, so those about an instant are averaged.
    """
    link, column = p.linkage, p.column
    psi, phi = (record.angle[name][:-1] for name in ("crank", "column"))
    v_psi, v_phi = (0.5 * (record.velocity[name][:-1] + record.velocity[name][1:]) for name in ("crank", "column"))
    crank, arm = psi + link.crank_angle, phi + link.arm_angle

    def joint(radius: float, angle: Array) -> Array:
        return radius * np.array([np.sin(angle), np.cos(angle)])

    rod = link.rod * np.array([math.cos(link.rod_angle), -math.sin(link.rod_angle)])
    axis = joint(link.arm, np.array(link.arm_angle)) - rod - joint(link.crank, np.array(link.crank_angle))
    one, other = axis[:, None] + joint(link.crank, crank), joint(link.arm, arm)
    v_one = link.crank * v_psi * np.array([np.cos(crank), -np.sin(crank)])
    v_other = link.arm * v_phi * np.array([np.cos(arm), -np.sin(arm)])
    between, v_between = other - one, v_other - v_one
    length = np.hypot(*between)
    along = between / length
    # The far mass hangs a rod's length from the crank pin, whatever the load cell's stretch.
    turned = v_between - along * np.sum(along * v_between, axis=0)
    far, v_far = one + link.rod * along, v_one + link.rod * turned / length
    masses = link.rod_crank_mass, link.rod_column_mass - link.rod_end_mass, link.rod_end_mass
    places, speeds = (one, far, other), (v_one, v_far, v_other)
    kinetic = 0.5 * (p.motor.rotor_inertia + link.crank_inertia) * v_psi**2 + 0.5 * column.inertia * v_phi**2
    potential = 0.5 * SPRING * psi**2 + 0.5 * p.load_cell.stiffness * (length - link.rod) ** 2
    potential = potential + GRAVITY * column.mass * column.mass_height * np.cos(phi)
    for mass, place, speed in zip(masses, places, speeds, strict=True):
        kinetic = kinetic + 0.5 * mass * np.sum(speed**2, axis=0)
        potential = potential + GRAVITY * mass * place[1]
    return kinetic + potential, kinetic
