"""The tables of a rig file's ``[data_sheet]``: values as data sheets print them, with the unit in the key."""
# ruff: noqa: N815  (keys spell units as SI does: torque_Nm)

from typing import Annotated

from pydantic import Field

from cls_bench.input.tables import Strict
from cls_bench.parameters.plant import StageKind

Positive = Annotated[float, Field(gt=0, le=1e9)]
Share = Annotated[float, Field(gt=0, le=1)]
_Ratio = Annotated[float, Field(ge=0.1, le=1000)]


class MotorSheet(Strict):
    """A three-phase servo or torque motor. Currents and torque constant in A r.m.s. of one line."""

    stall_torque_Nm: Positive | None = None
    """torque that it can give for good at standstill [N·m]"""
    stall_current_A: Positive | None = None
    """current for it [A]"""
    rated_torque_Nm: Positive | None = None
    """torque that it can give for good at rated speed [N·m]"""
    rated_current_A: Positive | None = None
    """current for it [A]"""
    rated_speed_rpm: Positive | None = None
    """speed at which it gives its rated torque [1/min]; only compared with the speed without load"""
    peak_torque_Nm: Positive | None = None
    """largest torque [N·m]"""
    peak_current_A: Positive | None = None
    """current for it [A]"""
    no_load_speed_rpm: Positive | None = None
    """speed without load, or the largest allowed, whichever is less [1/min]"""
    torque_constant_Nm_per_A: Positive | None = None
    """torque for one ampere [N·m/A]"""
    voltage_constant_V_per_krpm: Positive | None = None
    """induced voltage between two terminals, r.m.s. [V per 1000/min]"""
    voltage_constant_Vs_per_rad: Positive | None = None
    """the same [V·s/rad]"""
    voltage_constant_peak_V_per_krpm: Positive | None = None
    """the same, if the sheet prints the amplitude [V per 1000/min]"""
    motor_constant_Nm_per_sqrtW: Positive | None = None
    """torque for the root of one watt of copper loss [N·m/√W]"""
    resistance_ohm: Positive | None = None
    """between two terminals [Ω]"""
    inductance_mH: Positive | None = None
    """between two terminals [mH]"""
    electrical_time_constant_ms: Positive | None = None
    """inductance over resistance [ms]"""
    rotor_inertia_kgcm2: Positive | None = None
    """rotor [kg·cm²]"""
    rotor_inertia_kgm2: Positive | None = None
    """the same [kg·m²]"""
    poles: Annotated[int, Field(ge=2, le=400)] | None = None
    """number of poles, twice that of pole pairs [1]"""
    slots: Annotated[int, Field(ge=3, le=1000)] | None = None
    """number of slots of the stator [1]"""
    cogging_Nm: Annotated[float, Field(ge=0, le=100)] | None = None
    """amplitude of the cogging torque [N·m]"""
    cogging_peak_to_peak_Nm: Annotated[float, Field(ge=0, le=100)] | None = None
    """the same from peak to peak [N·m]"""
    thermal_resistance_K_per_W: Positive | None = None
    """winding to ambient [K/W]"""
    thermal_time_constant_s: Positive | None = None
    """time constant of the winding temperature [s]"""
    thermal_time_constant_min: Positive | None = None
    """the same [min]"""


class GearboxSheet(Strict):
    """A gearbox, or another transmission. Several follow one another from the motor on."""

    kind: StageKind = "planetary"
    """what its stages are"""
    ratio: _Ratio
    """turns of the input for one of the output [1]"""
    stages: Annotated[int, Field(ge=1, le=3)] = 1
    """number of its stages [1]"""
    stage_ratios: Annotated[list[_Ratio], Field(min_length=1, max_length=3)] | None = None
    """ratio of each, from the motor on [1]; the root of the whole if left out"""
    efficiency: Share
    """overall, driving [1]"""
    efficiency_at_Nm: Positive | None = None
    """torque at its input that this belongs to [N·m]"""
    backdrive_efficiency: Annotated[float, Field(ge=-10, le=1)] | None = None
    """of each stage when the load drives [1]; 0 or less: self-locking"""
    idle_torque_Nm: Annotated[float, Field(ge=0, le=1000)] | None = None
    """no-load running torque at its input [N·m]"""
    backlash_arcmin: Annotated[float, Field(ge=0, le=170)] = 0.0
    """at its output [arcmin]"""
    stiffness_Nm_per_arcmin: Positive
    """torsional stiffness at its output, input held [N·m/arcmin]"""
    inertia_kgcm2: Positive
    """at its input [kg·cm²]"""
    teeth: Annotated[int, Field(ge=0, le=1000)] | None = None
    """teeth of each stage's input wheel, starts of a worm [1]"""
    transmission_error_arcmin: Annotated[float, Field(ge=0, le=34)] | None = None
    """amplitude of the transmission error of its last stage, at its output [arcmin]"""


class EncoderSheet(Strict):
    """The encoder on the motor shaft."""

    lines: Annotated[int, Field(ge=1, le=2**24)] | None = None
    """increments, or sine periods, in a revolution [1]"""
    bits: Annotated[int, Field(ge=4, le=32)] | None = None
    """steps in a revolution after interpolation, as a power of two [bit]"""


class DriveSheet(Strict):
    """The servo drive."""

    supply_Vac: Positive | None = None
    """mains voltage, r.m.s. between two lines [V]"""
    dc_bus_V: Positive | None = None
    """voltage of the DC bus [V]"""
    continuous_current_A: Positive | None = None
    """current for good [A r.m.s.]"""
    peak_current_A: Positive | None = None
    """largest current [A r.m.s.]"""
    current_cycle_us: Positive | None = None
    """cycle of the current controller [µs]"""
    velocity_cycle_us: Positive | None = None
    """cycle of the velocity controller [µs]"""
    position_cycle_us: Positive | None = None
    """cycle of the position controller [µs]"""


class BusSheet(Strict):
    """The field bus, and the task of the PLC."""

    cycle_us: Positive | None = None
    """cycle of the bus [µs]"""
    plc_cycle_us: Positive | None = None
    """cycle of the PLC's task [µs]; the bus's if left out"""
    command_latency_cycles: Annotated[int, Field(ge=0, le=16)] | None = None
    """bus cycles from the PLC's result to the drive [1]"""
    feedback_latency_cycles: Annotated[int, Field(ge=0, le=16)] | None = None
    """bus cycles from the drive's encoder to the PLC [1]"""


class LoadCellSheet(Strict):
    """The load cell in the rod, or the torque cell on the shaft."""

    capacity_kg: Positive | None = None
    """range, tension and compression [kg]"""
    capacity_N: Positive | None = None
    """the same [N]"""
    capacity_Nm: Positive | None = None
    """range of a torque cell [N·m]"""
    deflection_mm: Positive | None = None
    """at full load [mm]"""
    stiffness_Nm_per_rad: Positive | None = None
    """of a torque cell [N·m/rad]"""
    creep_percent: Annotated[float, Field(ge=0, le=10)] | None = None
    """of the load, after 30 min [%]"""


class AmplifierSheet(Strict):
    """The load cell's amplifier and converter."""

    bits: Annotated[int, Field(ge=8, le=32)] | None = None
    """converter resolution over its range [bit]"""
    effective_bits: Annotated[float, Field(ge=4, le=32)] | None = None
    """resolution that noise leaves [bit]"""
    effective_rate_Hz: Positive | None = None
    """output rate that this belongs to [Hz]"""
    filter_Hz: Positive | None = None
    """corner of the input filter [Hz]"""


class DataSheet(Strict):
    """What the parts of a rig are, as their makers print it."""

    motor: MotorSheet | None = None
    """the motor"""
    gearbox: Annotated[list[GearboxSheet], Field(max_length=3)] | None = None
    """what is between motor and crank, from the motor on; an empty list is nothing: direct drive"""
    encoder: EncoderSheet | None = None
    """the encoder"""
    drive: DriveSheet | None = None
    """the servo drive"""
    bus: BusSheet | None = None
    """the field bus"""
    load_cell: LoadCellSheet | None = None
    """the load cell"""
    amplifier: AmplifierSheet | None = None
    """its amplifier"""
