"""From data sheets to parameters: what is printed is converted, what is missing is derived, and each is said."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cls_bench.input.faults import FaultError
from cls_bench.parameters import ARCMIN, GRAVITY, MOST_STAGES, RPM, Parameters, mesh_efficiency
from cls_bench.parameters.plant import TOOTHLESS
from cls_bench.rigs.data_sheet import (
    AmplifierSheet,
    BusSheet,
    DataSheet,
    DriveSheet,
    EncoderSheet,
    GearboxSheet,
    LoadCellSheet,
    MotorSheet,
)

KRPM = 1000.0 * RPM
"""A thousand revolutions per minute [rad/s]."""

HOT = 100.0
"""Rise of a winding at continuous stall torque [K]: class F at 40 °C ambient, as motor makers rate."""


class Derived(NamedTuple):
    """A parameter that follows from data sheets."""

    key: str
    value: Any
    how: str
    """from what, in one line"""


class _Sheet:
    """Collects what follows; the first of several ways that the sheet has the values for is taken."""

    def __init__(self, key: str):
        self.key = key
        self.found: list[Derived] = []

    def say(self, key: str, value: Any, how: str) -> Any:
        self.found.append(Derived(key, value, how))
        return value

    def first(self, key: str, *ways: tuple[float | None, str]) -> float | None:
        for value, how in ways:
            if value is not None:
                return float(self.say(key, value, how))
        return None

    def missing(self, name: str, wanted: str) -> FaultError:
        return FaultError(f"data_sheet.{self.key}.{name}", f"missing; give {wanted}")


def derived(sheet: DataSheet, given: Mapping[str, Any]) -> list[Derived]:
    """All that follows from a rig's data sheets; ``given`` are parameters that its file states itself.

    Raises FaultError with the key of the sheet that is missing or contradicts another.
    """
    found: list[Derived] = []
    if sheet.motor is not None:
        found += _motor(sheet.motor, sheet.drive or DriveSheet())
    elif sheet.drive is not None:
        found += _currents_of_drive(sheet.drive)
    if sheet.drive is not None:
        found += _drive(sheet.drive)
    if sheet.gearbox is not None:
        thesis = Parameters()
        torque = _stall_torque(sheet.motor) or thesis.drive.continuous_current * thesis.motor.torque_constant
        found += _gearbox(sheet.gearbox, torque)
    if sheet.encoder is not None:
        found += _encoder(sheet.encoder)
    if sheet.bus is not None:
        found += _bus(sheet.bus)
    if sheet.load_cell is not None or sheet.amplifier is not None:
        arm = float(given.get("linkage.arm", Parameters().linkage.arm))
        found += _load_cell(sheet.load_cell or LoadCellSheet(), sheet.amplifier or AmplifierSheet(), arm)
    return found


def _product(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a * b


def _ratio(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a / b


def _stall_torque(motor: MotorSheet | None) -> float | None:
    if motor is None:
        return None
    return motor.stall_torque_Nm or _product(motor.torque_constant_Nm_per_A, motor.stall_current_A)


def _motor(m: MotorSheet, drive: DriveSheet) -> list[Derived]:
    """Power-invariant DC equivalent: K = √3 · K_e = K_t, R and L are 3/2 of what lies between two terminals."""
    s = _Sheet("motor")
    peak = m.voltage_constant_peak_V_per_krpm
    voltage = (
        m.voltage_constant_Vs_per_rad
        or _ratio(m.voltage_constant_V_per_krpm, KRPM)
        or _ratio(peak, KRPM * math.sqrt(2.0))
    )
    k = s.first(
        "motor.torque_constant",
        (m.torque_constant_Nm_per_A, "as printed"),
        (_product(math.sqrt(3.0), voltage), "√3 × voltage constant between two terminals"),
        (_ratio(m.stall_torque_Nm, m.stall_current_A), "stall torque over stall current"),
        (_ratio(m.rated_torque_Nm, m.rated_current_A), "rated torque over rated current"),
        (_ratio(m.peak_torque_Nm, m.peak_current_A), "peak torque over peak current; saturation makes it small"),
    )
    if k is None:
        raise s.missing("torque_constant_Nm_per_A", "it, a voltage constant, or a torque with its current")
    if voltage is not None and not 0.7 < k / (math.sqrt(3.0) * voltage) < 1.4:
        raise FaultError(
            f"data_sheet.{s.key}",
            f"torque constant {k:g} N·m/A and √3 × voltage constant = {math.sqrt(3.0) * voltage:.3g} V·s/rad should be "
            "about equal; a voltage constant is r.m.s. between two terminals, its amplitude has a key of its own "
            "(voltage_constant_peak_V_per_krpm)",
        )
    stall = m.stall_current_A or _ratio(m.stall_torque_Nm, k) or m.rated_current_A or _ratio(m.rated_torque_Nm, k)
    if stall is None:
        raise s.missing("stall_torque_Nm", "it, or the stall current: what the motor can give for good")
    constant = m.motor_constant_Nm_per_sqrtW
    r = s.first(
        "motor.resistance",
        (_product(1.5, m.resistance_ohm), "3/2 of the resistance between two terminals"),
        (None if constant is None else (k / constant) ** 2, "(torque constant / motor constant)²"),
        (
            None if m.thermal_resistance_K_per_W is None else HOT / m.thermal_resistance_K_per_W / stall**2,
            f"{HOT:g} K of rise by the copper loss at stall",
        ),
    )
    if r is None:
        raise s.missing("resistance_ohm", "it, the motor constant, or the thermal resistance")
    inductance = s.first(
        "motor.inductance",
        (_product(1.5e-3, m.inductance_mH), "3/2 of the inductance between two terminals"),
        (_product(m.electrical_time_constant_ms, 1e-3 * r), "electrical time constant × resistance"),
        (3e-3 * r, "assumed: an electrical time constant of 3 ms, usual with iron teeth"),
    )
    assert inductance is not None
    if s.first(
        "motor.rotor_inertia",
        (_product(m.rotor_inertia_kgcm2, 1e-4), "as printed"), (m.rotor_inertia_kgm2, "as printed"),
    ) is None:  # fmt: skip
        raise s.missing("rotor_inertia_kgcm2", "it, or rotor_inertia_kgm2")
    s.first(
        "motor.thermal_resistance",
        (m.thermal_resistance_K_per_W, "as printed"),
        (HOT / (r * stall**2), f"assumed: {HOT:g} K of rise by the copper loss at stall, {r * stall**2:.0f} W"),
    )
    s.first(
        "motor.thermal_time_constant",
        (m.thermal_time_constant_s, "as printed"), (_product(m.thermal_time_constant_min, 60.0), "as printed"),
    )  # fmt: skip
    _cogging(s, m)
    _limits(s, m, drive, k, stall)
    return s.found


def _cogging(s: _Sheet, m: MotorSheet) -> None:
    amplitude = m.cogging_Nm if m.cogging_Nm is not None else _product(0.5, m.cogging_peak_to_peak_Nm)
    s.first(
        "motor.cogging_amplitude", (amplitude, "as printed" if m.cogging_Nm is not None else "half the peak to peak")
    )
    if amplitude and m.poles is not None:
        if m.slots is not None:
            how = f"least multiple of {m.poles} poles and {m.slots} slots"
            s.say("motor.cogging_periods", math.lcm(m.poles, m.slots), how)
        else:
            s.say("motor.cogging_periods", 6 * m.poles, "assumed: six in a pole, as slots are not printed")


def _limits(s: _Sheet, m: MotorSheet, drive: DriveSheet, k: float, stall: float) -> None:
    """What the drive may ask of the motor: the lesser of what both can."""

    def least(key: str, of_motor: float, how: str, of_drive: float | None) -> float:
        if of_drive is not None and of_drive < of_motor:
            return float(s.say(key, of_drive, f"the drive's; the motor could take {of_motor:.4g} A"))
        return float(s.say(key, of_motor, how))

    continuous = least(
        "drive.continuous_current", stall,
        "stall current" if m.stall_current_A else "continuous torque over torque constant", drive.continuous_current_A,
    )  # fmt: skip
    if m.peak_current_A is not None:
        top, how = m.peak_current_A, "peak current"
    elif m.peak_torque_Nm is not None:
        top, how = m.peak_torque_Nm / k, "peak torque over torque constant"
    else:
        top, how = 3.0 * stall, "assumed: three times the stall current, which most servo motors bear"
    top = least("drive.peak_current", max(top, continuous), how, drive.peak_current_A)
    if m.peak_torque_Nm is not None and m.peak_torque_Nm <= k * top:
        s.say("drive.torque_limit", m.peak_torque_Nm, "peak torque")
    else:
        s.say("drive.torque_limit", k * top, "torque constant × peak current")
    default = Parameters().drive
    bus = drive.dc_bus_V or _product(math.sqrt(2.0), drive.supply_Vac) or default.dc_bus_voltage
    reached = math.sqrt(1.5) * default.modulation * bus / k
    if m.no_load_speed_rpm is not None and m.no_load_speed_rpm * RPM <= reached:
        s.say("drive.speed_limit", m.no_load_speed_rpm * RPM, "no-load speed")
    else:
        s.say("drive.speed_limit", reached, f"where its back EMF reaches what {bus:.0f} V of DC bus give")


def _currents_of_drive(drive: DriveSheet) -> list[Derived]:
    s, default = _Sheet("drive"), Parameters().drive
    for name, value in (("continuous_current", drive.continuous_current_A), ("peak_current", drive.peak_current_A)):
        if value is not None and value < getattr(default, name):
            s.say(f"drive.{name}", value, "the drive's, less than the motor's")
    return s.found


def _drive(drive: DriveSheet) -> list[Derived]:
    s = _Sheet("drive")
    s.first(
        "drive.dc_bus_voltage",
        (drive.dc_bus_V, "as printed"), (_product(math.sqrt(2.0), drive.supply_Vac), "√2 × mains voltage, rectified"),
    )  # fmt: skip
    for name in ("current", "velocity", "position"):
        s.first(f"rates.{name}_cycle", (_seconds(getattr(drive, f"{name}_cycle_us")), "as printed"))
    if drive.velocity_cycle_us is not None:
        s.say("drive.speed_filter_time", 2.0 * _some(_seconds(drive.velocity_cycle_us)), "two velocity cycles")
    return s.found


def _some(value: float | None) -> float:
    assert value is not None
    return value


def _seconds(microseconds: float | None) -> float | None:
    return None if microseconds is None else round(microseconds * 1e3) / 1e9  # whole nanoseconds


def _bus(bus: BusSheet) -> list[Derived]:
    s = _Sheet("bus")
    s.first("rates.bus_cycle", (_seconds(bus.cycle_us), "as printed"))
    s.first("rates.plc_cycle", (_seconds(bus.plc_cycle_us), "as printed"), (_seconds(bus.cycle_us), "the bus's"))
    for name in ("command_latency", "feedback_latency"):
        if (cycles := getattr(bus, f"{name}_cycles")) is not None:
            s.say(f"plc.{name}", cycles, "as printed")
    return s.found


def _encoder(encoder: EncoderSheet) -> list[Derived]:
    s, default = _Sheet("encoder"), Parameters().encoder
    if encoder.lines is None and encoder.bits is None:
        raise s.missing("bits", "lines, bits, or both")
    lines = encoder.lines or min(2 ** (encoder.bits or 0), default.counts)
    if encoder.bits is None:
        steps, how = default.interpolation, "assumed: the drive interpolates as on the thesis's rig"
    else:
        steps, how = max(round(2**encoder.bits / lines), 1), f"2^{encoder.bits} steps in a revolution"
    s.say("encoder.counts", lines, "as printed" if encoder.lines else f"of its 2^{encoder.bits} steps")
    s.say("encoder.interpolation", steps, how)
    step = 2.0 * math.pi / (lines * steps)
    s.say("encoder.noise", 0.83 * step, "assumed: about one interpolated step, as on the thesis's rig")
    return s.found


def _load_cell(cell: LoadCellSheet, amplifier: AmplifierSheet, arm: float) -> list[Derived]:
    s, default = _Sheet("load_cell"), Parameters().load_cell
    capacity = s.first(
        "load_cell.capacity",
        (cell.capacity_N, "as printed"), (_product(cell.capacity_kg, GRAVITY), "its kilograms × standard gravity"),
        (_ratio(cell.capacity_Nm, arm), f"its torque over linkage.arm = {arm:g} m"),
    ) or default.capacity  # fmt: skip
    s.first(
        "load_cell.stiffness",
        (_ratio(capacity, _product(cell.deflection_mm, 1e-3)), "capacity over deflection"),
        (_ratio(cell.stiffness_Nm_per_rad, arm**2), f"its stiffness over linkage.arm² = {arm**2:.4g} m²"),
        (
            None if capacity == default.capacity else default.stiffness * capacity / default.capacity,
            "assumed: gives 0.16 mm at full load, usual for S-beams",
        ),
    )
    s.first("load_cell.creep", (_product(cell.creep_percent, 0.01), "as printed"))
    if amplifier.bits is not None:
        s.say("load_cell.adc_bits", amplifier.bits, "as printed")
    s.first("load_cell.filter_bandwidth", (amplifier.filter_Hz, "as printed"))
    effective, rate = amplifier.effective_bits or 16.4, amplifier.effective_rate_Hz or 100.0
    if amplifier.effective_bits is not None or capacity != default.capacity:
        noise = 2.0 * capacity / 2.0**effective * math.sqrt(20e3 / rate)
        of = "" if amplifier.effective_bits else ", the thesis's amplifier"
        how = f"{effective:g} effective bits of the range at {rate:g} Hz, white up to 20 kHz{of}"
        s.say("load_cell.noise", noise, how)
    return s.found


_LAST = 0.75
"""Share of the play that is the last stage's; assumed, as on the thesis's gearbox, for every stage but the first."""

_STIFF = 5.0 / 6.0
"""Share of the give that is the last stage's; likewise."""

_CARRIER = 0.13
"""Share of the inertia at the input that a stage's output shaft has, seen from its own input; likewise."""

_IDLE = 0.55 / 0.8
"""Share of the idle torque at the input that is the first stage's; likewise."""


def _shares(last: float, stages: int) -> list[float]:
    """Shares of what each stage, the motor's first, has of the whole at the output."""
    rest, shares = 1.0, []
    for _ in range(stages - 1):
        shares.append(rest * last)
        rest *= 1.0 - last
    return [rest, *reversed(shares)]


def _gearbox(units: Sequence[GearboxSheet], torque: float) -> list[Derived]:
    """Stages of all units in series; ``torque`` [N·m] is what the motor can give for good."""
    s = _Sheet("gearbox")
    count = sum(unit.stages for unit in units)
    if count > MOST_STAGES:
        raise FaultError("data_sheet.gearbox", f"{count} stages are more than the {MOST_STAGES} a gearbox can have")
    s.say("gearbox.stages", count, "those of all units" if count else "none: the motor drives the crank")
    number, ratio_before = 0, 1.0
    for k, unit in enumerate(units):
        number = _unit(s, f"data_sheet.gearbox[{k}]", unit, number, torque * ratio_before, first=k == 0)
        ratio_before *= unit.ratio
    if not units:
        s.say("gearbox.input_inertia", 0.0, "no gearbox")
    return s.found


def _unit(s: _Sheet, key: str, unit: GearboxSheet, before: int, torque: float, *, first: bool) -> int:
    """One unit, whose stages follow ``before`` others; returns how many there are with it."""
    stages = unit.stages
    ratios = unit.stage_ratios or [unit.ratio ** (1.0 / stages)] * stages
    if len(ratios) != stages or abs(math.prod(ratios) / unit.ratio - 1.0) > 1e-3:
        raise FaultError(f"{key}.stage_ratios", f"{ratios} are not {stages} ratios whose product is {unit.ratio:g}")
    at = unit.efficiency_at_Nm or torque
    toothed = unit.kind not in TOOTHLESS
    split = "" if stages == 1 else ", shared among the stages as on the thesis's gearbox"
    idle, how_idle = unit.idle_torque_Nm, "as printed"
    if idle is None:
        idle, how_idle = 0.5 * (1.0 - unit.efficiency) * at, "assumed: half of the loss that the efficiency leaves"
    at_input = _idle_shares(stages)
    drags, before_stage = [], 1.0
    for share, ratio in zip(at_input, ratios, strict=True):
        drags.append(idle * share * before_stage)
        before_stage *= ratio
    try:
        efficiency = mesh_efficiency(unit.efficiency, at, drags, ratios)
    except ValueError as error:
        raise FaultError(f"{key}.efficiency", str(error)) from None
    back = unit.backdrive_efficiency
    how_back = "as printed"
    if back is None:
        back = max(1.0 - 1.5 * (1.0 / efficiency - 1.0), -10.0)
        how_back = "assumed: half as much again is lost as when driving" + ("; self-locking" if back <= 0.0 else "")
    inertia = unit.inertia_kgcm2 * 1e-4
    plays, gives = _shares(_LAST, stages), _shares(_STIFF, stages)
    own, behind, passed = inertia, unit.ratio, 1.0
    for k, ratio in enumerate(ratios):
        behind /= ratio
        name = f"gearbox.stage{before + k + 1}"
        s.say(f"{name}.kind", unit.kind, "as printed")
        s.say(f"{name}.ratio", ratio, "as printed" if stages == 1 or unit.stage_ratios else "root of the whole")
        if unit.teeth is not None or not toothed:
            how = "as printed" if unit.teeth is not None else "a belt's do not ripple"
            s.say(f"{name}.teeth", unit.teeth or 0, how)
        share = _CARRIER * inertia * (0.1**k)
        own -= share
        passed *= ratio
        how = f"assumed: {100 * _CARRIER * 0.1**k:.3g} % of the inertia at its unit's input"
        s.say(f"{name}.inertia", share * passed**2, how)
        s.say(f"{name}.stiffness", unit.stiffness_Nm_per_arcmin / ARCMIN / gives[k] / behind**2, f"as printed{split}")
        play = unit.backlash_arcmin * ARCMIN * plays[k] * behind
        s.say(f"{name}.backlash", play, f"as printed{split}")
        s.say(f"{name}.drag", drags[k], f"{how_idle}{split}")
        how = f"{100 * unit.efficiency:g} % overall at {at:.3g} N·m, drag taken apart"
        s.say(f"{name}.efficiency", efficiency, how)
        s.say(f"{name}.backdrive_efficiency", back, how_back)
        if unit.transmission_error_arcmin is not None and k == stages - 1:
            s.say(f"{name}.transmission_error", unit.transmission_error_arcmin * ARCMIN, "as printed")
        else:
            swing = 0.1 * play if toothed else 0.0
            s.say(f"{name}.transmission_error", swing, "assumed: a tenth of the play" if toothed else "a belt has none")
    if first:
        s.say("gearbox.input_inertia", own, "the rest of the inertia at the input")
    else:  # its input side turns with the output shaft of the unit before
        shaft = f"gearbox.stage{before}.inertia"
        there = next(entry for entry in s.found if entry.key == shaft)
        s.found.remove(there)
        s.say(shaft, there.value + own, f"{there.how}, and the input side of the unit behind")
    return before + stages


def _idle_shares(stages: int) -> list[float]:
    """Shares of the idle torque at the input, the motor's stage first."""
    rest, shares = 1.0, []
    for _ in range(stages - 1):
        shares.append(rest * _IDLE)
        rest *= 1.0 - _IDLE
    return [*shares, rest]
