"""Every parameter of the bench: one definition each, with unit, default, bounds and source.

SI and radians throughout. The sections are pydantic models, strict about unknown keys, wrong types and impossible
values; :func:`record_of` turns them into the NumPy record that the compiled tick reads, so a value is written down
here and nowhere else. "assumed" as a source always says why.

Parameters marked *live* may change while a run goes on (scenario ``[[changes]]``); all others shape the MuJoCo model
or the wiring of the loops and hold for the whole run.
"""

import math
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.config import JsonDict
from pydantic.fields import FieldInfo

from cls_bench.kinematics import FourBar, crank_from_column, crank_ratio, fit_polynomials, polynomial

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

ARCMIN = math.pi / 180.0 / 60.0
"""One minute of arc [rad]."""

RPM = 2.0 * math.pi / 60.0
"""One revolution per minute [rad/s]."""

DEG = math.pi / 180.0
"""One degree [rad]."""


def quantity(default: Any, unit: str, meaning: str, source: str, *, live: bool = False, **bounds: Any) -> Any:
    """Declare a parameter; ``bounds`` are pydantic's ``gt``, ``ge``, ``lt``, ``le``."""
    extra: JsonDict = {"unit": unit, "source": source, "live": live}
    if isinstance(default, float):
        bounds["allow_inf_nan"] = False
    return Field(default=default, description=meaning, json_schema_extra=extra, **bounds)


def part(default: Any, meaning: str, **sources: str) -> Any:
    """Declare a section that is used more than once, with the sources of the values that differ from place to place."""
    extra: JsonDict = {"sources": {**sources}}
    return Field(default=default, description=meaning, json_schema_extra=extra)


class Section(BaseModel):
    """Base of all parameter sections: strict, no unknown keys, checked on assignment too."""

    model_config = ConfigDict(extra="forbid", strict=True, validate_assignment=True, use_attribute_docstrings=True)


class Motor(Section):
    """Infranor XtraforsPrime FP0105 as a power-invariant DC equivalent: current in A r.m.s. per phase.

    With that choice of current the equivalent back-EMF constant equals the torque constant, √3 times the line-to-line
    EMF constant, and resistance and inductance are 3/2 of the terminal-to-terminal values.
    """

    rotor_inertia: float = quantity(4.0e-5, "kg·m²", "rotor inertia", "thesis table 3.2", ge=1e-8, le=1)
    torque_constant: float = quantity(
        0.2944, "N·m/A", "torque constant, and equivalent back-EMF constant",
        "thesis table 3.2: 6.00 N·m / 20.38 A, which is √3 · 0.17 V·s/rad; the printed 0.29 is rounded",
        ge=1e-3, le=100,
    )  # fmt: skip
    resistance: float = quantity(
        6.0, "Ω", "equivalent resistance",
        "assumed: 4 Ω terminal to terminal gives 69 W copper loss at stall torque, usual for a 1 N·m motor",
        ge=1e-3, le=1e4,
    )  # fmt: skip
    inductance: float = quantity(
        6.0e-3, "H", "equivalent inductance",
        "assumed: electrical time constant 1 ms, at the low end of servo motors because the stator is slotless",
        ge=1e-6, le=10,
    )  # fmt: skip
    thermal_resistance: float = quantity(
        1.444, "K/W", "winding to ambient",
        "assumed: 100 K rise (class F winding) at the stall torque of 1.0 N·m",
        ge=1e-3, le=1e3,
    )  # fmt: skip
    thermal_time_constant: float = quantity(
        60.0, "s", "time constant of the winding temperature", "assumed: windings of this size take about a minute",
        ge=0.1, le=1e5,
    )
    cogging_amplitude: float = quantity(
        0.0, "N·m", "amplitude of the cogging torque", "thesis table 3.2: none", ge=0, le=1
    )
    cogging_periods: int = quantity(
        24, "1", "periods of the cogging torque in a revolution",
        "assumed: least common multiple of 8 poles and 6 coil sides; no matter at amplitude 0",
        ge=1, le=1000,
    )  # fmt: skip


class GearStage(Section):
    """One planetary stage: elastic mesh with backlash, transmission error, and meshing friction.

    Torque, stiffness, backlash and transmission error are measured at the stage's output shaft, drag at its input.
    """

    stiffness: float = quantity(0.0, "N·m/rad", "torsional stiffness once the backlash is taken up", "", ge=1, le=1e9)
    damping_ratio: float = quantity(
        0.05, "1", "damping of the mesh as a fraction of critical for the two inertias it lies between",
        "assumed: lubricated steel teeth lose some per cent a cycle", ge=0, le=1,
    )  # fmt: skip
    backlash: float = quantity(0.0, "rad", "total play", "", ge=0, le=0.05)
    drag: float = quantity(0.0, "N·m", "load-independent friction of meshes, bearings and seals", "", ge=0, le=100)
    ripple: float = quantity(
        0.25, "1", "modulation of drag and mesh loss with the tooth-passing frequency",
        "assumed: makes back-driving jerky, as felt in thesis 4.1 and 4.5", ge=0, le=1,
    )  # fmt: skip
    transmission_error: float = quantity(
        0.0, "rad", "amplitude of the transmission error at the tooth-passing frequency", "", ge=0, le=0.01
    )
    sun_teeth: int = quantity(
        18, "1", "teeth of the sun; the ring has ratio − 1 times as many",
        "assumed: 18, 27 and 72 teeth are a usual set for ratio 5",
        ge=8, le=500,
    )  # fmt: skip


class Gearbox(Section):
    """Neugart PLN070, two planetary stages of ratio 5."""

    ratio: float = quantity(
        5.0, "1", "ratio of each stage", "thesis 3.2.2: 25 in two stages; 5 × 5 is the maker's usual split",
        ge=2, le=100,
    )  # fmt: skip
    input_inertia: float = quantity(
        2.13e-5, "kg·m²", "sun of stage 1, its planets and the coupling, at the motor shaft",
        "thesis table 3.3: 2.49e-5 in all, less the two carriers below as seen from the motor",
        ge=1e-8, le=1,
    )  # fmt: skip
    carrier1_inertia: float = quantity(
        8.25e-5, "kg·m²", "carrier of stage 1 with the sun of stage 2 and its planets",
        "assumed: 0.25 kg of steel, 50 mm across",
        ge=1e-8, le=10,
    )  # fmt: skip
    carrier2_inertia: float = quantity(
        1.875e-4, "kg·m²", "carrier of stage 2 with the output shaft", "assumed: 0.6 kg of steel, 50 mm across",
        ge=1e-8, le=10,
    )
    efficiency: float = quantity(
        0.85, "1", "overall efficiency when the motor drives at rated_torque; sets the load-dependent mesh loss",
        "thesis 3.2.2", ge=0.25, le=1,
    )  # fmt: skip
    rated_torque: float = quantity(
        1.0, "N·m", "motor torque at which the efficiency holds", "thesis 3.2.2: the stall torque",
        ge=1e-3, le=1e3,
    )
    backdrive_loss_ratio: float = quantity(
        1.5, "1", "mesh loss when back-driven over mesh loss when driving",
        "assumed: sliding on the approach side of the teeth rubs more", ge=0, le=5,
    )  # fmt: skip
    breakaway_ratio: float = quantity(
        1.1, "1", "static over Coulomb friction of the meshes", "assumed: oil-wetted steel", ge=1, le=3
    )
    stribeck_velocity: float = quantity(
        1.0, "rad/s", "Stribeck velocity at a stage's input shaft",
        "assumed: the oil film builds up within some 10 rpm",
        ge=1e-3, le=1e3,
    )  # fmt: skip
    bristle_stiffness: float = quantity(
        800.0, "N·m/rad", "presliding stiffness of the meshing friction at a stage's input shaft",
        "assumed: 0.07 mrad of give at the motor before it slips, far below one encoder count (1.5 mrad)",
        ge=0.1, le=1e7,
    )  # fmt: skip
    bristle_damping: float = quantity(
        0.15, "N·m·s/rad", "presliding damping of the meshing friction",
        "assumed: near-critical for the motor's inertia; fades out above the Stribeck velocity",
        ge=0, le=1e3,
    )  # fmt: skip
    stage1: GearStage = part(
        GearStage(stiffness=1.2 / ARCMIN, backlash=5.0 * ARCMIN, drag=0.055, transmission_error=0.4 * ARCMIN),
        "first stage",
        stiffness="assumed: 30 N·m/arcmin at the gearbox output, so that it adds a sixth to the second stage's give",
        backlash="assumed: 1 arcmin at the gearbox output",
        drag="assumed: class's range of idle torque is 0.05 to 0.3 N·m at the input, both stages together",
        transmission_error="assumed: a tenth of the play",
    )
    stage2: GearStage = part(
        GearStage(stiffness=6.0 / ARCMIN, backlash=3.0 * ARCMIN, drag=0.125, transmission_error=0.3 * ARCMIN),
        "second stage",
        stiffness="assumed: gearboxes of this class have 2 to 8 N·m/arcmin at their output",
        backlash="assumed: 4 arcmin with the first stage's; thesis 3.2.2: under 5",
        drag="assumed: 0.025 N·m at the motor",
        transmission_error="assumed: a tenth of the play",
    )

    @property
    def input_total_inertia(self) -> float:
        """Inertia of the whole gearbox at the motor shaft [kg·m²] (thesis table 3.3)."""
        return self.input_inertia + self.carrier1_inertia / self.ratio**2 + self.carrier2_inertia / self.ratio**4

    @property
    def mesh_loss(self) -> float:
        """Load-dependent loss of each stage when driving: friction over torque carried on, both at the input side.

        Solves T (r − drag)… for the loss μ that gives the overall efficiency at rated torque::

            ((T − D1) r/(1 + μ) − D2) r/(1 + μ) = η T r²
        """
        torque, r = self.rated_torque, self.ratio
        d1, d2 = self.stage1.drag, self.stage2.drag
        # A quadratic in x = 1/(1 + μ): (T − D1) r² x² − D2 r x − η T r² = 0
        a, b, c = (torque - d1) * r * r, -d2 * r, -self.efficiency * torque * r * r
        x = (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
        return 1.0 / x - 1.0

    @model_validator(mode="after")
    def _losses(self) -> "Gearbox":
        if self.stage1.drag >= self.rated_torque or self.mesh_loss < 0:
            raise ValueError(
                f"efficiency {self.efficiency:g} cannot be reached: "
                f"the drag alone costs more at {self.rated_torque:g} N·m"
            )
        return self


class Linkage(Section):
    """Four-bar linkage: crank on the gearbox, connecting rod with load cell, arm on the column."""

    crank: float = quantity(0.100, "m", "crank", "thesis table 3.1", ge=0.01, le=2)
    rod: float = quantity(0.209, "m", "connecting rod", "thesis table 3.1", ge=0.01, le=2)
    arm: float = quantity(0.175, "m", "column axis to rod joint", "thesis table 3.1", ge=0.01, le=2)
    crank_inertia: float = quantity(9.40e-4, "kg·m²", "crank about its axis", "thesis table 3.3", ge=1e-6, le=10)
    rod_crank_mass: float = quantity(
        0.125, "kg", "share of the rod's mass at the crank joint", "thesis table 3.3: 1.25e-3 kg·m² / (0.100 m)²",
        ge=1e-3, le=100,
    )
    rod_column_mass: float = quantity(
        0.3755, "kg", "share of the rod's mass at the column joint, load cell included",
        "thesis table 3.3: 1.15e-2 kg·m² / (0.175 m)²",
        ge=1e-3, le=100,
    )  # fmt: skip
    rod_end_mass: float = quantity(
        0.15, "kg", "part of rod_column_mass on the column's side of the strain gauge",
        "assumed: half of a 0.2 kg load cell and the rod end",
        ge=1e-3, le=100,
    )  # fmt: skip

    @model_validator(mode="after")
    def _masses(self) -> "Linkage":
        if not self.rod_end_mass <= 0.999 * self.rod_column_mass:
            raise ValueError("rod_end_mass is a part of rod_column_mass and must be less")
        return self

    @property
    def four_bar(self) -> FourBar:
        """Lengths for :mod:`cls_bench.kinematics`."""
        return FourBar(self.crank, self.rod, self.arm)


class LoadCell(Section):
    """50 kg S-beam load cell (2 mV/V) and its amplifier X20AI1744."""

    capacity: float = quantity(
        50.0 * GRAVITY, "N", "range, tension and compression", "thesis 3.2.3: 50 kg",
        ge=1, le=1e5,
    )  # fmt: skip
    stiffness: float = quantity(
        3.0e6, "N/m", "stiffness along the rod", "assumed: 0.16 mm at full load, usual for S-beams of this size",
        ge=1e3, le=1e9,
    )
    damping_ratio: float = quantity(
        0.02, "1", "damping of rod end and column arm on the cell, of critical", "assumed: metal spring", ge=0, le=1
    )
    adc_bits: int = quantity(24, "bit", "converter resolution over ± the range", "thesis table 3.4", ge=8, le=32)
    noise: float = quantity(
        0.16, "N", "r.m.s. noise of one sample",
        "X20AI1744: 16.4 effective bits of the range at 100 samples/s, white up to 20 kHz: 981 N / 2^16.4 · √200",
        ge=0, le=1e3,
    )  # fmt: skip
    filter_bandwidth: float = quantity(5000.0, "Hz", "corner of the input filter", "thesis table 3.4", ge=1, le=1e5)


class Column(Section):
    """Control column with its bearing, unbalance, limit switches and stop blocks."""

    inertia: float = quantity(3.51e-2, "kg·m²", "about its axis", "thesis table 3.3", ge=1e-5, le=100)
    mass: float = quantity(0.9, "kg", "mass", "assumed: what a 0.34 m bar of this inertia weighs", ge=1e-3, le=100)
    mass_height: float = quantity(
        0.12, "m", "height of the centre of mass above the axis",
        "assumed: the lower end and the axle balance part of it; gives about 0.6 N·m at full travel with the rod",
        ge=0, le=2,
    )  # fmt: skip
    grip_height: float = quantity(0.300, "m", "height of the grip above the axis", "thesis table 3.1", ge=0.02, le=2)
    viscous_friction: float = quantity(
        0.05, "N·m·s/rad", "bearing, d_fwd", "assumed: small ball bearings, low as thesis 4.2 says",
        ge=0, le=1e3,
    )
    coulomb_friction: float = quantity(
        0.05, "N·m", "bearing, μ_fwd", "assumed: small ball bearings, low as thesis 4.2 says",
        ge=0, le=1e3,
    )
    bristle_stiffness: float = quantity(
        500.0, "N·m/rad", "presliding stiffness of the bearing", "assumed: 0.1 mrad before it slips",
        ge=0.1, le=1e7,
    )
    travel: float = quantity(20.0 * DEG, "rad", "travel to either side", "thesis table 3.1", ge=0.01, lt=0.6)
    switch_angle: float = quantity(
        21.0 * DEG, "rad", "where the limit switches open", "assumed: between travel and stop blocks",
        ge=0.01, lt=0.6,
    )
    stop_angle: float = quantity(
        22.5 * DEG, "rad", "where the stop blocks stand", "assumed: beyond travel and switches",
        ge=0.01, lt=0.6,
    )
    stop_stiffness: float = quantity(
        2.0e4, "N·m/rad", "stiffness of a stop block", "assumed: rubber-faced metal, 4.5 mm at the grip per kN there",
        ge=1, le=1e8,
    )  # fmt: skip
    stop_damping: float = quantity(
        20.0, "N·m·s/rad", "damping of a stop block", "assumed: a third of critical for the bare column",
        ge=0, le=1e5,
    )

    @model_validator(mode="after")
    def _order(self) -> "Column":
        if not self.travel < self.switch_angle < self.stop_angle:
            raise ValueError("travel, switch_angle and stop_angle must grow in this order")
        return self

    @model_validator(mode="after")
    def _masses(self) -> "Column":
        if not self.mass * self.mass_height**2 <= 0.999 * self.inertia:
            raise ValueError("inertia must exceed mass × mass_height²: it is taken about the axis")
        return self


class Limb(Section):
    """The pilot's forearm and hand: a mass behind the spring and damper of the grip (thesis 3.4.4).

    Stiffness and damping run from loose (squeeze 0) to tight (squeeze 1) on a logarithmic scale.
    """

    mass: float = quantity(
        1.8, "kg", "forearm and hand, effective at the grip",
        "Winter 2009: 2.2 % of the body's mass, at 80 kg",
        ge=0.01, le=100, live=True,
    )  # fmt: skip
    loose_stiffness: float = quantity(
        800.0, "N/m", "grip stiffness at squeeze 0", "assumed: soft tissue of a relaxed hand",
        ge=0.1, le=1e9, live=True,
    )
    tight_stiffness: float = quantity(
        2.0e6, "N/m", "grip stiffness at squeeze 1",
        "assumed: rigid (thesis 3.4.4); its resonance is far above the loop's phase crossover",
        ge=0.1, le=1e9, live=True,
    )  # fmt: skip
    loose_damping: float = quantity(
        10.0, "N·s/m", "grip damping at squeeze 0", "assumed: soft tissue, near the 6.5 N·s/m of a relaxed arm",
        ge=0, le=1e6, live=True,
    )  # fmt: skip
    tight_damping: float = quantity(
        150.0, "N·s/m", "grip damping at squeeze 1", "assumed: a few per cent of critical: as good as rigid",
        ge=0, le=1e6, live=True,
    )  # fmt: skip
    arm_stiffness: float = quantity(
        2000.0, "N/m", "stiffness with which the arm follows its intended motion",
        "assumed: strong co-contraction; a relaxed arm has 135 N/m",
        ge=0, le=1e7, live=True,
    )  # fmt: skip
    arm_damping: float = quantity(
        60.0, "N·s/m", "damping with which the arm follows its intended motion",
        "assumed: half of critical for the arm's mass; a relaxed arm has 6.5 N·s/m",
        ge=0, le=1e5, live=True,
    )  # fmt: skip


class Encoder(Section):
    """SKM36 Hiperface encoder on the motor shaft."""

    counts: int = quantity(4096, "1/rev", "increments in a revolution", "thesis 3.2.3", ge=1, le=2**24)
    interpolation: int = quantity(
        64, "1", "sin/cos interpolation: steps in an increment; 1 switches it off",
        "assumed: drives of this class resolve 2^18 steps or more", ge=1, le=65536,
    )  # fmt: skip
    noise: float = quantity(
        2.0e-5, "rad", "r.m.s. noise of one sample, before quantisation",
        "assumed: about one interpolated step",
        ge=0, le=0.1,
    )  # fmt: skip


class Potentiometer(Section):
    """Column potentiometer on AI4632: redundant, for experiments."""

    range: float = quantity(
        30.0 * DEG, "rad", "angle at full scale, to either side", "assumed: a little over the stops",
        ge=0.01, le=10,
    )
    adc_bits: int = quantity(16, "bit", "converter resolution over ± the range", "thesis table 3.4", ge=8, le=32)
    noise: float = quantity(
        5.0e-5, "rad", "r.m.s. noise of one sample", "assumed: a few steps of the converter",
        ge=0, le=0.1,
    )  # fmt: skip


class Drive(Section):
    """B&R ACOPOS servo drive: power stage, limits and cascade (thesis 3.6.1)."""

    dc_bus_voltage: float = quantity(
        325.0, "V", "DC bus", "thesis table 3.2: 230 V mains, rectified (√2)",
        ge=1, le=1000,
    )
    modulation: float = quantity(
        0.883, "1", "usable part of the linear range of space-vector modulation",
        "assumed: with it the no-load speed is the data sheet's 11 400 rpm",
        ge=0.01, le=1,
    )  # fmt: skip
    peak_current: float = quantity(20.38, "A", "current limit", "thesis table 3.2", ge=0.01, le=1e4, live=True)
    continuous_current: float = quantity(
        3.397, "A", "current that the I²t monitor allows for good", "thesis table 3.2: 1.00 N·m at stall",
        ge=0.01, le=1e4, live=True,
    )  # fmt: skip
    torque_limit: float = quantity(6.0, "N·m", "torque limit", "thesis table 3.2", ge=1e-3, le=1e4, live=True)
    speed_limit: float = quantity(11400.0 * RPM, "rad/s", "speed limit", "thesis table 3.2", ge=0.1, le=1e4, live=True)
    load_inertia: float = quantity(
        9.27e-5, "kg·m²", "total inertia at the motor shaft for which the gains are designed",
        "thesis table 3.3: 4.00e-5 + 5.27e-5",
        ge=1e-8, le=1, live=True,
    )  # fmt: skip
    current_bandwidth: float = quantity(
        1000.0, "Hz", "bandwidth of the current controller", "assumed: usual at a 50 µs cycle",
        ge=0.1, le=1e4, live=True,
    )
    velocity_bandwidth: float = quantity(
        100.0, "Hz", "bandwidth of the velocity controller",
        "assumed: tuned, with the two below, so that a squeezed grip is stable at I_fcs 0.30 and not at 0.25 "
        "(thesis 4.4)",
        ge=0.01, le=2500, live=True,
    )  # fmt: skip
    velocity_integral_time: float = quantity(
        0.02, "s", "integral time T_n of the velocity controller", "assumed: tuned",
        ge=1e-4, le=1e6, live=True,
    )
    position_bandwidth: float = quantity(
        35.0, "Hz", "bandwidth of the position controller", "assumed: tuned",
        ge=0.01, le=1250, live=True,
    )
    position_integral_time: float = quantity(
        0.0, "s", "integral time of the position controller; 0 switches the integral off",
        "thesis 3.6.1 names a PI; off by default because the velocity controller already integrates",
        ge=0, le=1e6, live=True,
    )  # fmt: skip
    speed_filter_time: float = quantity(
        0.0004, "s", "time constant of the speed filter", "assumed: two velocity cycles",
        ge=0, le=10, live=True,
    )
    voltage_latency: int = quantity(
        1, "ticks", "ticks of 50 µs from the current sample to the voltage it leads to",
        "assumed: computed in one period, put out in the next", ge=0, le=16,
    )  # fmt: skip
    set_torque: float = quantity(0.0, "N·m", "torque asked for in torque mode", "chosen", ge=-1e4, le=1e4, live=True)
    feed_forward_velocity: bool = quantity(
        False, "1", "feed the set velocity forward to the velocity controller",
        "thesis 3.6.1: a further option; with it the outer loop is stable down to I_fcs 0.11", live=True,
    )
    feed_forward_inertia: bool = quantity(
        False, "1", "feed load_inertia × set acceleration forward to the current controller", "thesis 3.6.1", live=True
    )
    feed_forward_pilot: bool = quantity(
        False, "1", "feed the measured pilot torque forward to the current controller", "thesis 3.6.1", live=True
    )

    @model_validator(mode="after")
    def _integral(self) -> "Drive":
        if 0.0 < self.position_integral_time < 1e-4:
            raise ValueError("position_integral_time: give 0, which switches the integral off, or at least 0.0001 s")
        return self

    @property
    def voltage_limit(self) -> float:
        """Largest equivalent motor voltage [V]: √(3/2) · modulation · DC bus."""
        return math.sqrt(1.5) * self.modulation * self.dc_bus_voltage


class Plc(Section):
    """Outer loop in the PLC, and the field bus (Powerlink, 400 µs)."""

    outer_loop: Literal["position", "velocity"] = quantity(
        "position", "1", "what the outer loop asks of the drive", "thesis 2.5.3, 3.6; velocity: Eq. 3.8"
    )
    command_latency: int = quantity(
        1, "cycles", "field-bus cycles from the PLC's result to the drive", "Powerlink: sent in the following cycle",
        ge=0, le=16,
    )  # fmt: skip
    feedback_latency: int = quantity(
        1, "cycles", "field-bus cycles from the drive's encoder to the PLC", "Powerlink: sent in the following cycle",
        ge=0, le=16,
    )  # fmt: skip
    units_per_revolution: float = quantity(
        3600.0, "1/rev", "PLCopen units in a motor revolution", "thesis table 3.5",
        ge=1, le=1e9,
    )
    polynomial_degree: int = quantity(
        9, "1", "degree of the polynomials that stand for the linkage's kinematics",
        "chosen: the least odd degree under 1e-5 rad over the travel", ge=1, le=15,
    )  # fmt: skip
    remove_unbalance: bool = quantity(
        True, "1", "take the static unbalance out of the measured torque", "thesis 3.6.2, T_stat", live=True
    )
    following_error_limit: float = quantity(
        0.2, "rad", "column angle between set and actual position at which the drive is switched off",
        "thesis 3.6.3 proposes it; value assumed: half the travel to one side",
        ge=1e-4, le=10, live=True,
    )  # fmt: skip


class TravelLimit(Section):
    """A virtual stop: additional stiffness and damping beyond an angle (thesis 3.5.2)."""

    angle: float = quantity(0.0, "rad", "where it begins, to either side", "", ge=1e-3, lt=0.6, live=True)
    stiffness: float = quantity(0.0, "N·m/rad", "additional stiffness c_hs", "", ge=0, le=1e6, live=True)
    damping: float = quantity(0.0, "N·m·s/rad", "additional damping d_hs", "", ge=0, le=1e5, live=True)


class Feel(Section):
    """Single-body model of the flight control system at the column's axis (thesis 3.5.2)."""

    inertia: float = quantity(0.3, "kg·m²", "I_fcs", "thesis figure 4.2", ge=1e-3, le=100, live=True)
    damping: float = quantity(1.5, "N·m·s/rad", "d_fcs", "thesis figure 4.2", ge=0, le=1e4, live=True)
    stiffness: float = quantity(35.0, "N·m/rad", "c_fcs", "thesis figure 4.2", ge=0, le=1e5, live=True)
    friction: float = quantity(
        0.25, "N·m", "Coulomb friction μ_fcs, with stiction", "thesis figure 4.2",
        ge=0, le=1e3, live=True,
    )
    neutral: float = quantity(0.0, "rad", "neutral position φ_0 (trim)", "thesis 3.5.2", gt=-0.6, lt=0.6, live=True)
    aft_limit: TravelLimit = part(
        TravelLimit(angle=14.0 * DEG, stiffness=150.0, damping=2.0),
        "travel limit of the control surface, softened by the cables",
        angle="assumed: within the travel of ±20°, so that both limits of thesis figure 4.2 are reached",
        stiffness="assumed: four times c_fcs, so that the torque bends visibly, as in thesis figure 4.2",
        damping="assumed: a little more than the model's own",
    )
    forward_limit: TravelLimit = part(
        TravelLimit(angle=17.0 * DEG, stiffness=1500.0, damping=15.0),
        "travel limit of the column itself, stiff",
        angle="assumed: 3° beyond the surface's, before the limit switches",
        stiffness="assumed: ten times the cables': thesis 4.2 calls it the stiff one",
        damping="assumed: a third of critical for the model's inertia",
    )
    centering_stiffness: float = quantity(
        0.0, "N·m/rad", "slope of the centering unit about neutral", "thesis 3.5.2",
        ge=0, le=1e5, live=True,
    )
    centering_breakout: float = quantity(
        0.0, "N·m", "torque at which the centering unit saturates", "thesis 3.5.2",
        ge=0, le=1e3, live=True,
    )
    autopilot_torque: float = quantity(0.0, "N·m", "T_ap", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)
    disturbance_torque: float = quantity(0.0, "N·m", "T_dis", "thesis 3.5.2", ge=-1e3, le=1e3, live=True)
    shaker_torque: float = quantity(
        0.0, "N·m", "amplitude of the stick shaker T_sw", "thesis 3.5.2",
        ge=0, le=1e3, live=True,
    )  # fmt: skip
    shaker_frequency: float = quantity(
        20.0, "Hz", "frequency of the stick shaker", "assumed: usual for stick shakers",
        ge=0.1, lt=1000, live=True,
    )

    @model_validator(mode="after")
    def _limits(self) -> "Feel":
        if not self.aft_limit.angle <= self.forward_limit.angle:
            raise ValueError("aft_limit.angle must not exceed forward_limit.angle")
        return self


class Simulation(Section):
    """The numerical side."""

    substeps: int = quantity(
        1, "1", "plant steps in a tick of 50 µs", "1 is converged: see docs/architecture.md", ge=1, le=64
    )


class Parameters(Section):
    """All parameters of the bench."""

    motor: Motor = Motor()
    gearbox: Gearbox = Gearbox()
    linkage: Linkage = Linkage()
    load_cell: LoadCell = LoadCell()
    column: Column = Column()
    limb: Limb = Limb()
    encoder: Encoder = Encoder()
    potentiometer: Potentiometer = Potentiometer()
    drive: Drive = Drive()
    plc: Plc = Plc()
    feel: Feel = Feel()
    simulation: Simulation = Simulation()

    @property
    def kinematic_range(self) -> float:
        """Column angle [rad] to either side over which the PLC's polynomials stand for the linkage."""
        return max(self.column.switch_angle + 3.0 * DEG, self.column.stop_angle)

    @model_validator(mode="after")
    def _linkage(self) -> "Parameters":
        """The linkage moves over the whole range, far from its dead points, and the polynomials follow it there."""
        degree, reach = self.plc.polynomial_degree, self.kinematic_range
        if (self.linkage.four_bar, reach, degree) == _SHIPPED_LINKAGE:
            return self  # without compiling the kinematics
        over, bar = f"over ±{reach / DEG:.3g}°", self.linkage.four_bar
        try:
            polynomials = fit_polynomials(bar, reach, degree)
        except ValueError as error:
            raise ValueError(f"crank, rod and arm: {error}") from None
        for column in np.linspace(-reach, reach, 41):
            crank = crank_from_column(bar, column)
            ratio = crank_ratio(bar, crank, column)
            if not FLATTEST <= ratio <= STEEPEST:
                raise ValueError(
                    f"crank, rod and arm: the linkage comes near a dead point {over}; dφc/dφ must stay from "
                    f"{FLATTEST:g} to {STEEPEST:g}, and is {ratio:.3g} at {column / DEG:.3g}°"
                )
            fitted = polynomial(polynomials.ratio, column), 1.0 / polynomial(polynomials.inverse_ratio, crank)
            if not all(0.5 * ratio <= value <= 2.0 * ratio for value in fitted):
                raise ValueError(
                    f"polynomials of degree {degree} do not follow the linkage {over}; give another "
                    "plc.polynomial_degree"
                )
        return self


FLATTEST, STEEPEST = 0.05, 20.0
"""Least and greatest linkage ratio that a bench can be built with."""

_SHIPPED_LINKAGE = (Linkage().four_bar, max(Column().switch_angle + 3.0 * DEG, Column().stop_angle), 9)


def leaves(
    section: Section, prefix: str = "", sources: Mapping[str, str] | None = None
) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Yield (dotted key, value, {"unit", "source", "live", "meaning", "valid"}) of all parameters below ``section``."""
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        extra: Any = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
        if isinstance(value, Section):
            yield from leaves(value, f"{prefix}{name}.", extra.get("sources"))
        else:
            source = (sources or {}).get(name) or extra["source"]
            about = {**extra, "source": source, "meaning": info.description, "valid": _valid(info)}
            yield f"{prefix}{name}", value, about


def _valid(info: FieldInfo) -> str:
    """What values a parameter may have, in words; empty if any of its type."""
    if get_origin(info.annotation) is Literal:
        return ", ".join(get_args(info.annotation))
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    bounds = [f"{sign} {getattr(m, key):.6g}" for m in info.metadata for key, sign in signs.items() if hasattr(m, key)]
    return ", ".join(bounds)


def _dtype(section: type[Section]) -> np.dtype[Any]:
    fields: list[tuple[str, Any]] = []
    for name, info in section.model_fields.items():
        kind: Any = info.annotation
        if isinstance(kind, type) and issubclass(kind, Section):
            fields.append((name, _dtype(kind)))
        elif kind is float:
            fields.append((name, np.float64))
        else:  # int, bool, or the index of a Literal's choice
            fields.append((name, np.int64))
    return np.dtype(fields)


def _values(section: Section) -> tuple[Any, ...]:
    values: list[Any] = []
    for name, info in type(section).model_fields.items():
        value = getattr(section, name)
        if isinstance(value, Section):
            values.append(_values(value))
        elif get_origin(info.annotation) is Literal:
            values.append(get_args(info.annotation).index(value))
        else:
            values.append(value)
    return tuple(values)


def memory_of(parameters: Parameters) -> np.ndarray[Any, Any]:
    """The parameters as an array of one nested record."""
    return np.array([_values(parameters)], dtype=_dtype(type(parameters)))


def record_of(parameters: Parameters) -> Any:
    """The parameters as one nested NumPy record, readable by attribute in plain and in compiled code."""
    return memory_of(parameters).view(np.recarray)[0]


def table() -> str:
    """All parameters as Markdown tables, one a section, with default, unit and source."""
    lines: list[str] = []
    for name in Parameters.model_fields:
        section = getattr(Parameters(), name)
        lines += ["", f"### `{name}`", "", " ".join((type(section).__doc__ or "").split()), ""]
        lines += ["| parameter | default | valid | unit | meaning | source |", "|---|---|---|---|---|---|"]
        for key, value, about in leaves(section, f"{name}."):
            number = f"{value:.6g}" if isinstance(value, float) else str(value).lower()
            meaning = f"{about['meaning']} *(live)*" if about["live"] else about["meaning"]
            cells = (f"`{key}`", number, about["valid"], about["unit"], meaning, about["source"])
            lines.append("| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines).strip() + "\n"


TABLE_STARTS, TABLE_ENDS = "<!-- parameters: begin -->\n", "<!-- parameters: end -->\n"
"""What encloses the table in models/README.md."""


def with_table(page: str) -> str:
    """``page`` with the text between its two marks replaced by :func:`table`."""
    before, rest = page.split(TABLE_STARTS)
    return before + TABLE_STARTS + "\n" + table() + "\n" + TABLE_ENDS + rest.split(TABLE_ENDS)[1]


if __name__ == "__main__":  # python -m cls_bench.parameters models/README.md: brings the page up to date
    readme = Path(sys.argv[1])
    readme.write_text(with_table(readme.read_text(encoding="utf-8")), encoding="utf-8")
