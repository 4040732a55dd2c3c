"""Parameters of the plant: what has mass, friction or a data sheet."""

import math
from collections.abc import Sequence
from typing import Literal

from pydantic import model_validator

from cls_bench.kinematics import FourBar
from cls_bench.parameters.bars import Levers, four_bar_of, levers_of
from cls_bench.quantity import ARCMIN, DEG, GRAVITY, WIDEST, Section, part, quantity
from cls_bench.signals import MOST_STAGES


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


StageKind = Literal["planetary", "spur", "belt", "worm"]
"""What a gear stage can be. A further kind stands here, in the two tuples below if it is like that, and has a way of
being drawn in :mod:`cls_bench.plant.shapes`; a law of its own would be in :mod:`cls_bench.plant.gearbox`."""

CARRIED: tuple[StageKind, ...] = ("planetary",)
"""Kinds whose mesh turns with the output, as planets with their carrier, so that its teeth pass at the difference."""

TOOTHLESS: tuple[StageKind, ...] = ("belt",)
"""Kinds whose teeth, if any, do not ripple."""


BACKWARDS = 0.5
"""Slope of the transmission error over the ratio's own, error · teeth · ratio, that is refused: at 1 the output would
stand still once a tooth, beyond that turn backwards."""


class GearStage(Section):
    """One gear stage: elastic mesh with backlash, transmission error, and friction that follows the load.

    Torque, stiffness, backlash and transmission error are measured at the stage's output shaft, drag at its input.
    """

    kind: StageKind = quantity(
        "planetary", "1", "what it is: decides how its teeth pass, and how it is drawn",
        "thesis 3.2.2: planetary",
    )  # fmt: skip
    ratio: float = quantity(
        5.0, "1", "turns of the input for one of the output",
        "thesis 3.2.2: 25 in two stages; 5 × 5 is the usual split",
        ge=0.1, le=1000,
    )  # fmt: skip
    teeth: int = quantity(
        18, "1", "teeth of the input wheel, starts of a worm; 0: none, as of a belt, so that nothing ripples",
        "assumed: 18, 27 and 72 teeth are a usual planetary set for ratio 5",
        ge=0, le=1000,
    )  # fmt: skip
    inertia: float = quantity(
        1.0e-4, "kg·m²", "of the output shaft with all that turns with it, the next stage's input wheel too", "",
        ge=1e-9, le=100,
    )  # fmt: skip
    stiffness: float = quantity(
        1.0e4, "N·m/rad", "torsional stiffness once the backlash is taken up", "", ge=1, le=1e9
    )
    damping_ratio: float = quantity(
        0.05, "1", "damping of the mesh as a fraction of critical for the two inertias it lies between",
        "assumed: lubricated steel teeth lose some per cent a cycle", ge=0, le=1,
    )  # fmt: skip
    backlash: float = quantity(0.0, "rad", "total play", "", ge=0, le=0.05)
    drag: float = quantity(
        0.0, "N·m", "load-independent friction of meshes, bearings and seals when the motor drives", "", ge=0, le=1000
    )
    drag_ratio: float = quantity(
        1.0, "1", "load-independent friction when back-driven over that when driving",
        "assumed: seals and oil do not know who drives", ge=0, le=10,
    )  # fmt: skip
    efficiency: float = quantity(
        1.0, "1", "share of the torque, drag apart, that the mesh hands on when the motor drives", "", ge=0.1, le=1
    )
    backdrive_efficiency: float = quantity(
        1.0, "1", "share that it hands back when the load drives; 0 or less: self-locking", "", ge=-10, le=1
    )
    ripple: float = quantity(
        0.25, "1", "modulation of drag and mesh loss with the tooth-passing frequency",
        "assumed: makes back-driving jerky, as felt in thesis 4.1 and 4.5", ge=0, le=1,
    )  # fmt: skip
    transmission_error: float = quantity(
        0.0, "rad", "amplitude of the transmission error at the tooth-passing frequency", "", ge=0, le=0.01
    )

    @model_validator(mode="after")
    def _forwards(self) -> "GearStage":
        slope = self.transmission_error * self.teeth * self.ratio
        if slope >= BACKWARDS and self.kind not in TOOTHLESS:
            raise ValueError(
                f"transmission_error × teeth × ratio = {slope:.3g} must be less than {BACKWARDS:g}: the output would "
                "nearly turn backwards at every tooth"
            )
        return self

    @property
    def carried(self) -> bool:
        """Whether its mesh turns with the output."""
        return self.kind in CARRIED


def mesh_efficiency(overall: float, torque: float, drags: Sequence[float], ratios: Sequence[float]) -> float:
    """Efficiency η of each mesh, equal in all stages, with which a gearbox reaches a data sheet's overall one.

    Solves ((T − D₁) r₁ η − D₂) r₂ η … = ``overall`` · T Π r for the input ``torque`` T [N·m]. Raises ValueError if the
    drags D [N·m] alone cost more.
    """

    def output(efficiency: float) -> float:
        carried = torque
        for drag, ratio in zip(drags, ratios, strict=True):
            carried = (carried - drag) * ratio * efficiency
        return carried / math.prod(ratios) / torque

    if output(1.0) < overall:
        raise ValueError(f"efficiency {overall:g} cannot be reached: the drag alone costs more at {torque:g} N·m")
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if output(middle) > overall else (middle, high)
    return 0.5 * (low + high)


_EFFICIENCY = mesh_efficiency(0.85, 1.0, (0.055, 0.125), (5.0, 5.0))
_BACKDRIVE = 1.0 - 1.5 * (1.0 / _EFFICIENCY - 1.0)
_DRIVING = "thesis 3.2.2: 85 % overall at the stall torque of 1 N·m, both stages alike, their drag taken apart"
_BACKDRIVEN = "assumed: half as much again is lost as when driving, sliding on the approach side of the teeth rubs more"


class Gearbox(Section):
    """Gearbox between motor and crank: none to three stages. Neugart PLN070: two planetary stages of ratio 5."""

    stages: int = quantity(
        2, "1", "number of stages in use, from the motor on; 0: the motor sits on the crank", "thesis 3.2.2",
        ge=0, le=MOST_STAGES,
    )  # fmt: skip
    input_inertia: float = quantity(
        2.13e-5, "kg·m²", "what turns with the motor shaft: coupling, input wheel of stage 1, its share of the planets",
        "thesis table 3.3: 2.49e-5 in all, less the two carriers below as seen from the motor",
        ge=0, le=1,
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
        GearStage(
            stiffness=1.2 / ARCMIN, backlash=5.0 * ARCMIN, drag=0.055, transmission_error=0.4 * ARCMIN,
            inertia=8.25e-5, efficiency=_EFFICIENCY, backdrive_efficiency=_BACKDRIVE,
        ),
        "stage next to the motor",
        inertia="assumed: carrier with the sun of stage 2 and its planets, 0.25 kg of steel, 50 mm across",
        stiffness="assumed: 30 N·m/arcmin at the gearbox output, so that it adds a sixth to the second stage's give",
        backlash="assumed: 1 arcmin at the gearbox output",
        drag="assumed: class's range of idle torque is 0.05 to 0.3 N·m at the input, both stages together",
        transmission_error="assumed: a tenth of the play",
        efficiency=_DRIVING, backdrive_efficiency=_BACKDRIVEN,
    )  # fmt: skip
    stage2: GearStage = part(
        GearStage(
            stiffness=6.0 / ARCMIN, backlash=3.0 * ARCMIN, drag=0.125, transmission_error=0.3 * ARCMIN,
            inertia=1.875e-4, efficiency=_EFFICIENCY, backdrive_efficiency=_BACKDRIVE,
        ),
        "second stage",
        inertia="assumed: carrier with the output shaft, 0.6 kg of steel, 50 mm across",
        stiffness="assumed: gearboxes of this class have 2 to 8 N·m/arcmin at their output",
        backlash="assumed: 4 arcmin with the first stage's; thesis 3.2.2: under 5",
        drag="assumed: 0.025 N·m at the motor",
        transmission_error="assumed: a tenth of the play",
        efficiency=_DRIVING, backdrive_efficiency=_BACKDRIVEN,
    )  # fmt: skip
    stage3: GearStage = part(
        GearStage(),
        "third stage, not in use on the thesis's rig",
        **dict.fromkeys(("inertia", "stiffness", "backlash", "drag", "transmission_error", "efficiency",
                         "backdrive_efficiency"), "not in use: a plain value for whoever adds one"),
    )  # fmt: skip

    @property
    def in_use(self) -> tuple[GearStage, ...]:
        """The stages there are, from the motor on."""
        return tuple(getattr(self, f"stage{k}") for k in range(1, self.stages + 1))

    @property
    def ratio(self) -> float:
        """Turns of the motor for one of the crank."""
        return math.prod(stage.ratio for stage in self.in_use)

    @property
    def inertia_at_motor(self) -> float:
        """Inertia of the whole gearbox at the motor shaft [kg·m²] (thesis table 3.3)."""
        total, ratio = self.input_inertia, 1.0
        for stage in self.in_use:
            ratio *= stage.ratio
            total += stage.inertia / ratio**2
        return total


class Linkage(Section):
    """Four-bar linkage: crank on the gearbox, connecting rod with load cell, arm on the column.

    Or none: the gearbox's output, or the motor, drives the column's axle through a torque cell, which is then given as
    the force at ``arm``.
    """

    kind: Literal["four_bar", "none"] = quantity(
        "four_bar", "1", "whether a linkage or a shaft drives the column", "thesis 3.2.1"
    )
    crank: float = quantity(0.100, "m", "crank", "thesis table 3.1", ge=0.01, le=2)
    rod: float = quantity(0.209, "m", "connecting rod", "thesis table 3.1", ge=0.01, le=5)
    arm: float = quantity(0.175, "m", "column axis to rod joint", "thesis table 3.1", ge=0.01, le=2)
    crank_angle: float = quantity(
        0.0, "rad", "crank at neutral, from the vertical towards the pilot's forward", "thesis figure 3.4: vertical",
        ge=-math.pi, le=math.pi,
    )  # fmt: skip
    rod_angle: float = quantity(
        0.0, "rad", "rod at neutral, from the horizontal; positive with the column's end lower",
        "thesis figure 3.4: horizontal", ge=-math.pi, le=math.pi,
    )  # fmt: skip
    arm_angle: float = quantity(
        0.0, "rad", "column arm at neutral, from the vertical towards the pilot's forward",
        "thesis figure 3.4: vertical",
        ge=-math.pi, le=math.pi,
    )  # fmt: skip
    crank_inertia: float = quantity(9.40e-4, "kg·m²", "crank about its axis", "thesis table 3.3", ge=1e-8, le=10)
    rod_crank_mass: float = quantity(
        0.125, "kg", "share of the rod's mass at the crank joint", "thesis table 3.3: 1.25e-3 kg·m² / (0.100 m)²",
        ge=0, le=100,
    )
    rod_column_mass: float = quantity(
        0.3755, "kg", "share of the rod's mass at the column joint, load cell included",
        "thesis table 3.3: 1.15e-2 kg·m² / (0.175 m)²",
        ge=0, le=100,
    )  # fmt: skip
    rod_end_mass: float = quantity(
        0.15, "kg", "part of rod_column_mass on the column's side of the strain gauge",
        "assumed: half of a 0.2 kg load cell and the rod end",
        ge=0, le=100,
    )  # fmt: skip

    @model_validator(mode="after")
    def _masses(self) -> "Linkage":
        if not self.rod_end_mass <= self.rod_column_mass:
            raise ValueError("rod_end_mass is a part of rod_column_mass and must not be more")
        return self

    @property
    def masses(self) -> tuple[float, float, float]:
        """The rod as point masses [kg]: at the crank joint, and at the column joint before and behind the strain gauge.

        A shaft has none of them.
        """
        if self.kind == "none":
            return 0.0, 0.0, 0.0
        return self.rod_crank_mass, self.rod_column_mass - self.rod_end_mass, self.rod_end_mass

    @property
    def levers(self) -> Levers:
        """Levers at neutral."""
        return levers_of(self.kind, self)

    @property
    def four_bar(self) -> FourBar:
        """Lengths and angles for :mod:`cls_bench.kinematics`."""
        return four_bar_of(self.kind, self)


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
    gain_error: float = quantity(
        0.0, "1", "by what share it shows more than its data sheet says", "chosen: as calibrated", ge=-0.5, le=0.5,
        live=True,
    )  # fmt: skip
    offset: float = quantity(0.0, "N", "what it shows unloaded", "chosen: as zeroed", ge=-1e5, le=1e5, live=True)
    drift: float = quantity(
        0.0, "N/s", "rate at which its zero moves, as while it warms", "chosen: warm", ge=-1e4, le=1e4, live=True
    )
    creep: float = quantity(
        0.0, "1", "share of a lasting load that it comes to show in addition",
        "chosen: none; S-beams of class C3 creep by 2e-4 in 30 min", ge=-0.1, le=0.1, live=True,
    )  # fmt: skip
    creep_time: float = quantity(
        300.0, "s", "time constant of the creep", "assumed: most of 30 min within 5", ge=0.01, le=1e5, live=True
    )
    spike: float = quantity(
        0.0, "N", "height of interference spikes, of either sign, each one sample long", "chosen: none",
        ge=0, le=1e5, live=True,
    )  # fmt: skip
    spike_rate: float = quantity(
        0.0, "1/s", "mean number of spikes in a second", "chosen: none", ge=0, le=1e4, live=True
    )
    wire: Literal["whole", "supply_broken", "signal_broken"] = quantity(
        "whole", "1",
        "its cable; without supply it shows 0, with a broken signal wire the amplifier runs to full scale",
        "chosen: whole", live=True,
    )  # fmt: skip

    @property
    def count(self) -> float:
        """Force of one converter count [N], by the data sheets."""
        return 2.0 * self.capacity / (1 << self.adc_bits)


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
    travel: float = quantity(20.0 * DEG, "rad", "travel to either side", "thesis table 3.1", ge=0.01, lt=WIDEST)
    switch_angle: float = quantity(
        21.0 * DEG, "rad", "where the limit switches open", "assumed: between travel and stop blocks",
        ge=0.01, lt=WIDEST,
    )
    stop_angle: float = quantity(
        22.5 * DEG, "rad", "where the stop blocks stand", "assumed: beyond travel and switches",
        ge=0.01, lt=WIDEST,
    )
    stop_stiffness: float = quantity(
        2.0e4, "N·m/rad", "stiffness of a stop block", "assumed: rubber-faced metal, 4.5 mm at the grip per kN there",
        ge=1, le=1e8,
    )  # fmt: skip
    stop_damping: float = quantity(
        20.0, "N·m·s/rad", "damping of a stop block", "assumed: a third of critical for the bare column",
        ge=0, le=1e5,
    )

    @property
    def reach(self) -> float:
        """How far to either side its linkage has to work [rad]: 3° beyond the switches, at least to the stops."""
        return max(self.switch_angle + 3.0 * DEG, self.stop_angle)

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
        "assumed: drives of this class resolve 2^18 steps or more", ge=1, le=2**28,
    )  # fmt: skip
    noise: float = quantity(
        2.0e-5, "rad", "r.m.s. noise of one sample, before quantisation",
        "assumed: about one interpolated step",
        ge=0, le=0.1,
    )  # fmt: skip
    slip: float = quantity(
        0.0, "rad", "how far it has slipped on the motor shaft", "chosen: none", ge=-1e3, le=1e3, live=True
    )


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
