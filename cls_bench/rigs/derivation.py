"""From data sheets to parameters: what is printed is converted, what is missing is derived, and each is said."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import ValidationError

from cls_bench.input.faults import FaultError, problem_of
from cls_bench.parameters import ARCMIN, GRAVITY, MOST_STAGES, RPM, GearStage, Parameters, mesh_efficiency
from cls_bench.parameters.plant import BACKWARDS, TOOTHLESS
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


ALIKE = 0.8
"""Two ways to the same value have to agree that well, the lesser over the greater."""


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

    def agree(self, what: str, *ways: tuple[str, float | None], hint: str = "") -> None:
        """Raise FaultError if two of the ways that the sheet gives to ``what`` lead to values that differ."""
        (first, value), *others = [(way, value) for way, value in ways if value is not None] or [("", 1.0)]
        for way, other in others:
            if min(value, other) < ALIKE * max(value, other):
                raise FaultError(
                    f"data_sheet.{self.key}",
                    f"{first} and {way} contradict each other: {what} would be {value:.4g} and {other:.4g}{hint}",
                )

    def least(self, lesser: str, greater: str, low: float | None, high: float | None) -> None:
        """Raise FaultError unless what is to be at most as large as something else is so."""
        if low is not None and high is not None and high < low:
            raise FaultError(
                f"data_sheet.{self.key}", f"{greater} = {high:g} is less than {lesser} = {low:g}; one of them is wrong"
            )

    def missing(self, name: str, wanted: str) -> FaultError:
        return FaultError(f"data_sheet.{self.key}.{name}", f"missing; give {wanted}")


def derived(sheet: DataSheet, given: Mapping[str, Any]) -> list[Derived]:
    """All that follows from a rig's data sheets; ``given`` are parameters that its file states itself.

    Raises FaultError with the key of the sheet that is missing or contradicts another.
    """
    found: list[Derived] = []
    torque = _stated(given, "drive.continuous_current") * _stated(given, "motor.torque_constant")
    if sheet.motor is not None:
        of_motor, torque = _motor(sheet.motor, sheet.drive or DriveSheet())
        found += of_motor
    elif sheet.drive is not None:
        found += _limits_of_drive(sheet.drive, _stated(given, "motor.torque_constant"))
    if sheet.drive is not None:
        found += _drive(sheet.drive)
    if sheet.gearbox is not None:
        found += _gearbox(sheet.gearbox, torque)
    if sheet.encoder is not None:
        found += _encoder(sheet.encoder)
    if sheet.bus is not None:
        found += _bus(sheet.bus)
    if sheet.load_cell is not None or sheet.amplifier is not None:
        arm = _stated(given, "linkage.arm")
        found += _load_cell(sheet.load_cell or LoadCellSheet(), sheet.amplifier or AmplifierSheet(), arm)
    return found


def _stated(given: Mapping[str, Any], key: str) -> float:
    """A number that a rig's file states as a parameter, checked; the thesis's if it does not."""
    section, _, name = key.partition(".")
    there = getattr(Parameters(), section)
    if key not in given:
        return float(getattr(there, name))
    try:
        return float(getattr(type(there).model_validate({**there.model_dump(), name: given[key]}), name))
    except ValidationError as failure:
        problem = problem_of(failure.errors(include_url=False)[0], type(there))
        raise FaultError(f"parameters.{key}", problem) from None


def _product(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a * b


def _ratio(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else a / b


def _motor(m: MotorSheet, drive: DriveSheet) -> tuple[list[Derived], float]:
    """Power-invariant DC equivalent: K = √3 · K_e = K_t, R and L are 3/2 of what lies between two terminals.

    With it the torque that the motor can give for good at standstill [N·m].
    """
    s, root = _Sheet("motor"), math.sqrt(3.0)
    voltages = (
        ("voltage_constant_Vs_per_rad", m.voltage_constant_Vs_per_rad),
        ("voltage_constant_V_per_krpm", _ratio(m.voltage_constant_V_per_krpm, KRPM)),
        ("voltage_constant_peak_V_per_krpm", _ratio(m.voltage_constant_peak_V_per_krpm, KRPM * math.sqrt(2.0))),
    )
    voltage = next((value for _, value in voltages if value is not None), None)
    of_stall, of_rated = _ratio(m.stall_torque_Nm, m.stall_current_A), _ratio(m.rated_torque_Nm, m.rated_current_A)
    s.agree(
        "the torque constant [N·m/A]", ("torque_constant_Nm_per_A", m.torque_constant_Nm_per_A),
        *((name, _product(root, value)) for name, value in voltages),
        ("stall_torque_Nm over stall_current_A", of_stall), ("rated_torque_Nm over rated_current_A", of_rated),
        hint="; currents and voltages are r.m.s., of one line and between two terminals; the amplitude of a voltage "
        "constant has a key of its own, voltage_constant_peak_V_per_krpm",
    )  # fmt: skip
    s.least("stall_torque_Nm", "peak_torque_Nm", m.stall_torque_Nm, m.peak_torque_Nm)
    s.least("stall_current_A", "peak_current_A", m.stall_current_A, m.peak_current_A)
    s.least("rated_torque_Nm", "peak_torque_Nm", m.rated_torque_Nm, m.peak_torque_Nm)
    s.least("rated_current_A", "peak_current_A", m.rated_current_A, m.peak_current_A)
    s.least("rated_speed_rpm", "no_load_speed_rpm", m.rated_speed_rpm, m.no_load_speed_rpm)
    k = s.first(
        "motor.torque_constant",
        (m.torque_constant_Nm_per_A, "as printed"),
        (_product(root, voltage), "√3 × voltage constant between two terminals"),
        (of_stall, "stall torque over stall current"),
        (of_rated, "rated torque over rated current"),
        (_ratio(m.peak_torque_Nm, m.peak_current_A), "peak torque over peak current; saturation makes it small"),
    )
    if k is None:
        raise s.missing("torque_constant_Nm_per_A", "it, a voltage constant, or a torque with its current")
    stall = m.stall_current_A or _ratio(m.stall_torque_Nm, k) or m.rated_current_A or _ratio(m.rated_torque_Nm, k)
    if stall is None:
        raise s.missing("stall_torque_Nm", "it, or the stall current: what the motor can give for good")
    constant, printed = m.motor_constant_Nm_per_sqrtW, _product(1.5, m.resistance_ohm)
    s.agree(
        "the motor constant [N·m/√W]", ("motor_constant_Nm_per_sqrtW", constant),
        ("resistance_ohm", None if printed is None else k / math.sqrt(printed)),
    )  # fmt: skip
    r = s.first(
        "motor.resistance",
        (printed, "3/2 of the resistance between two terminals"),
        (None if constant is None else (k / constant) ** 2, "(torque constant / motor constant)²"),
        (
            None if m.thermal_resistance_K_per_W is None else HOT / m.thermal_resistance_K_per_W / stall**2,
            f"{HOT:g} K of rise by the copper loss at stall",
        ),
    )
    if r is None:
        raise s.missing("resistance_ohm", "it, the motor constant, or the thermal resistance")
    inductance, by_time = _product(1.5e-3, m.inductance_mH), _product(m.electrical_time_constant_ms, 1e-3 * r)
    s.agree("the inductance [H]", ("inductance_mH", inductance), ("electrical_time_constant_ms", by_time))
    s.first(
        "motor.inductance",
        (inductance, "3/2 of the inductance between two terminals"),
        (by_time, "electrical time constant × resistance"),
        (3e-3 * r, "assumed: an electrical time constant of 3 ms, usual with iron teeth"),
    )
    inertias = _product(m.rotor_inertia_kgcm2, 1e-4), m.rotor_inertia_kgm2
    s.agree(
        "the rotor's inertia [kg·m²]", ("rotor_inertia_kgcm2", inertias[0]), ("rotor_inertia_kgm2", inertias[1])
    )
    if s.first("motor.rotor_inertia", *((value, "as printed") for value in inertias)) is None:
        raise s.missing("rotor_inertia_kgcm2", "it, or rotor_inertia_kgm2")
    s.first(
        "motor.thermal_resistance",
        (m.thermal_resistance_K_per_W, "as printed"),
        (HOT / (r * stall**2), f"assumed: {HOT:g} K of rise by the copper loss at stall, {r * stall**2:.0f} W"),
    )
    times = m.thermal_time_constant_s, _product(m.thermal_time_constant_min, 60.0)
    s.agree(
        "the time constant [s]", ("thermal_time_constant_s", times[0]), ("thermal_time_constant_min", times[1])
    )
    s.first("motor.thermal_time_constant", *((value, "as printed") for value in times))
    _cogging(s, m)
    _limits(s, m, drive, k, stall)
    return s.found, m.stall_torque_Nm or k * stall


def _cogging(s: _Sheet, m: MotorSheet) -> None:
    half = _product(0.5, m.cogging_peak_to_peak_Nm)
    s.agree("the cogging amplitude [N·m]", ("cogging_Nm", m.cogging_Nm), ("cogging_peak_to_peak_Nm", half))
    amplitude = m.cogging_Nm if m.cogging_Nm is not None else half
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
    reached = _speed_on(bus, k)
    if m.no_load_speed_rpm is not None and m.no_load_speed_rpm * RPM <= reached:
        s.say("drive.speed_limit", m.no_load_speed_rpm * RPM, "no-load speed")
    else:
        s.say("drive.speed_limit", reached, f"where its back EMF reaches what {bus:.0f} V of DC bus give")


def _speed_on(bus: float, k: float) -> float:
    """Speed [rad/s] at which the back EMF of a motor of torque constant ``k`` reaches what ``bus`` [V] can give."""
    return math.sqrt(1.5) * Parameters().drive.modulation * bus / k


def _limits_of_drive(drive: DriveSheet, k: float) -> list[Derived]:
    """What a drive leaves of the thesis's motor, of torque constant ``k``."""
    s, default = _Sheet("drive"), Parameters().drive
    for name, value in (("continuous_current", drive.continuous_current_A), ("peak_current", drive.peak_current_A)):
        if value is not None and value < getattr(default, name):
            s.say(f"drive.{name}", value, "the drive's, less than the motor's")
    bus = drive.dc_bus_V or _product(math.sqrt(2.0), drive.supply_Vac)
    if bus is not None and _speed_on(bus, k) < default.speed_limit:
        s.say("drive.speed_limit", _speed_on(bus, k), f"where its back EMF reaches what {bus:.0f} V of DC bus give")
    return s.found


def _drive(drive: DriveSheet) -> list[Derived]:
    s, rectified = _Sheet("drive"), _product(math.sqrt(2.0), drive.supply_Vac)
    s.agree("the DC bus [V]", ("dc_bus_V", drive.dc_bus_V), ("supply_Vac", rectified))
    s.least("continuous_current_A", "peak_current_A", drive.continuous_current_A, drive.peak_current_A)
    s.first("drive.dc_bus_voltage", (drive.dc_bus_V, "as printed"), (rectified, "√2 × mains voltage, rectified"))
    for name in ("current", "velocity", "position"):
        s.first(f"rates.{name}_cycle", (_seconds(getattr(drive, f"{name}_cycle_us")), "as printed"))
    if (cycle := _seconds(drive.velocity_cycle_us)) is not None:
        s.say("drive.speed_filter_time", 2.0 * cycle, "two velocity cycles")
    return s.found


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
        s.least("lines", f"2^bits, bits = {encoder.bits},", lines, 2**encoder.bits)
        steps, how = round(2**encoder.bits / lines), f"2^{encoder.bits} steps in a revolution"
    s.say("encoder.counts", lines, "as printed" if encoder.lines else f"of its 2^{encoder.bits} steps")
    s.say("encoder.interpolation", steps, how)
    step = 2.0 * math.pi / (lines * steps)
    s.say("encoder.noise", 0.83 * step, "assumed: about one interpolated step, as on the thesis's rig")
    return s.found


def _load_cell(cell: LoadCellSheet, amplifier: AmplifierSheet, arm: float) -> list[Derived]:
    s, default = _Sheet("load_cell"), Parameters().load_cell
    by_mass, by_torque = _product(cell.capacity_kg, GRAVITY), _ratio(cell.capacity_Nm, arm)
    s.agree(
        "the capacity [N]", ("capacity_N", cell.capacity_N), ("capacity_kg", by_mass),
        (f"capacity_Nm over linkage.arm = {arm:g} m", by_torque),
    )  # fmt: skip
    capacity = s.first(
        "load_cell.capacity",
        (cell.capacity_N, "as printed"), (by_mass, "its kilograms × standard gravity"),
        (by_torque, f"its torque over linkage.arm = {arm:g} m"),
    ) or default.capacity  # fmt: skip
    by_give = _ratio(capacity, _product(cell.deflection_mm, 1e-3))
    by_twist = _ratio(cell.stiffness_Nm_per_rad, arm**2)
    s.agree("the stiffness [N/m]", ("deflection_mm", by_give), ("stiffness_Nm_per_rad over linkage.arm²", by_twist))
    s.first(
        "load_cell.stiffness",
        (by_give, "capacity over deflection"),
        (by_twist, f"its stiffness over linkage.arm² = {arm**2:.4g} m²"),
        (
            None if capacity == default.capacity else default.stiffness * capacity / default.capacity,
            "assumed: gives 0.16 mm at full load, usual for S-beams",
        ),
    )
    s.first("load_cell.creep", (_product(cell.creep_percent, 0.01), "as printed"))
    if amplifier.bits is not None:
        s.say("load_cell.adc_bits", amplifier.bits, "as printed")
    s.first("load_cell.filter_bandwidth", (amplifier.filter_Hz, "as printed"))
    if amplifier.effective_rate_Hz is not None and amplifier.effective_bits is None:
        raise FaultError("data_sheet.amplifier.effective_bits", "missing; give those that belong to effective_rate_Hz")
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
        teeth, how = _teeth(unit)
        s.say(f"{name}.teeth", teeth, how)
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
        most = BACKWARDS / (teeth * ratio) if teeth else math.inf
        if unit.transmission_error_arcmin is not None and k == stages - 1:
            _check_error(key, unit, teeth, ratio)
            s.say(f"{name}.transmission_error", unit.transmission_error_arcmin * ARCMIN, "as printed")
        elif toothed:
            how = "assumed: a tenth of the play" + (", as far as the teeth allow" if 0.1 * play > 0.4 * most else "")
            s.say(f"{name}.transmission_error", min(0.1 * play, 0.4 * most), how)
        else:
            s.say(f"{name}.transmission_error", 0.0, "a belt has none")
    if first:
        s.say("gearbox.input_inertia", own, "the rest of the inertia at the input")
    else:  # its input side turns with the output shaft of the unit before
        shaft = f"gearbox.stage{before}.inertia"
        there = next(entry for entry in s.found if entry.key == shaft)
        s.found.remove(there)
        s.say(shaft, there.value + own, f"{there.how}, and the input side of the unit behind")
    return before + stages


def _teeth(unit: GearboxSheet) -> tuple[int, str]:
    """Teeth of a unit's input wheels, and whence."""
    if unit.teeth is not None:
        return unit.teeth, "as printed"
    if unit.kind in TOOTHLESS:
        return 0, "a belt's do not ripple"
    if unit.kind == "worm":
        return 1, "assumed: one start, as self-locking worms have"
    return GearStage().teeth, "assumed: as on the thesis's gearbox"


def _check_error(key: str, unit: GearboxSheet, teeth: int, ratio: float) -> None:
    """Raise FaultError for a transmission error that no gear of this kind can have."""
    error = unit.transmission_error_arcmin
    if unit.kind in TOOTHLESS and error:
        raise FaultError(
            f"{key}.transmission_error_arcmin", f"{error:g} has no effect: the teeth of a {unit.kind} do not ripple"
        )
    if error and error * ARCMIN * teeth * ratio >= BACKWARDS:
        raise FaultError(
            f"{key}.transmission_error_arcmin",
            f"{error:g} is not possible with {teeth} teeth and a ratio of {ratio:g}: it would nearly turn the output "
            f"backwards at every tooth; it must be less than {BACKWARDS / (teeth * ratio) / ARCMIN:.3g}",
        )


def _idle_shares(stages: int) -> list[float]:
    """Shares of the idle torque at the input, the motor's stage first."""
    rest, shares = 1.0, []
    for _ in range(stages - 1):
        shares.append(rest * _IDLE)
        rest *= 1.0 - _IDLE
    return [*shares, rest]
