"""What follows from data sheets: each rule by its closed form, each contradiction in one line."""

import math

import pytest

from cls_bench.errors import InputError
from cls_bench.parameters import ARCMIN, GRAVITY, RPM, Parameters, mesh_efficiency
from cls_bench.rigs import Rig, parse_rig
from cls_bench.rigs.figures import driven_torque

THESIS = Parameters()

MOTOR = {
    "torque_constant_Nm_per_A": 0.5, "stall_torque_Nm": 2.0, "resistance_ohm": 4.0, "rotor_inertia_kgcm2": 0.8,
}  # fmt: skip

GEARBOX = {
    "ratio": 10.0, "efficiency": 0.95, "idle_torque_Nm": 0.04, "stiffness_Nm_per_arcmin": 5.0, "inertia_kgcm2": 0.4,
}  # fmt: skip


def rig(*, stated: str = "", gearbox: list[dict[str, object]] | None = None, **sheets: dict[str, object]) -> Rig:
    """A rig of data sheets, and of TOML that states parameters."""

    def lines(table: dict[str, object]) -> str:
        return "".join(f"{k} = {v if not isinstance(v, str) else repr(v)}\n" for k, v in table.items())

    text = "".join(f"[data_sheet.{name}]\n{lines(sheet)}" for name, sheet in sheets.items())
    text += "".join(f"[[data_sheet.gearbox]]\n{lines(unit)}" for unit in gearbox or [])
    return parse_rig(f'title = "x"\n{text}{stated}', name="my")


def value(found: Rig, key: str) -> float:
    """A parameter, said to be derived."""
    assert key in [d.key for d in found.derived]
    section: object = found.parameters
    for name in key.split("."):
        section = getattr(section, name)
    assert isinstance(section, int | float)
    return float(section)


K = 0.5
R = 6.0  # 3/2 of 4 Ω


@pytest.mark.parametrize(
    ("change", "key", "wanted"),
    [
        ({}, "motor.torque_constant", 0.5),
        ({"torque_constant_Nm_per_A": None, "voltage_constant_V_per_krpm": 30.0}, "motor.torque_constant",
         math.sqrt(3) * 30.0 / (1000 * 2 * math.pi / 60)),
        ({"torque_constant_Nm_per_A": None, "voltage_constant_Vs_per_rad": 0.3}, "motor.torque_constant",
         math.sqrt(3) * 0.3),
        ({"torque_constant_Nm_per_A": None, "voltage_constant_peak_V_per_krpm": 42.0}, "motor.torque_constant",
         math.sqrt(1.5) * 42.0 * 60 / (2000 * math.pi)),
        ({"torque_constant_Nm_per_A": None, "stall_current_A": 4.2}, "motor.torque_constant", 2.0 / 4.2),
        ({"torque_constant_Nm_per_A": None, "rated_torque_Nm": 1.5, "rated_current_A": 3.2}, "motor.torque_constant",
         1.5 / 3.2),
        ({"torque_constant_Nm_per_A": None, "peak_torque_Nm": 6.0, "peak_current_A": 15.0}, "motor.torque_constant",
         6.0 / 15.0),
        ({}, "motor.resistance", 1.5 * 4.0),
        ({"resistance_ohm": None, "motor_constant_Nm_per_sqrtW": 0.2}, "motor.resistance", (0.5 / 0.2) ** 2),
        ({"resistance_ohm": None, "thermal_resistance_K_per_W": 1.1}, "motor.resistance",
         100.0 / 1.1 / (2.0 / 0.5) ** 2),
        ({"inductance_mH": 8.0}, "motor.inductance", 12e-3),
        ({"electrical_time_constant_ms": 2.0}, "motor.inductance", 2e-3 * R),
        ({}, "motor.inductance", 3e-3 * R),
        ({}, "motor.rotor_inertia", 0.8e-4),
        ({"rotor_inertia_kgcm2": None, "rotor_inertia_kgm2": 3e-4}, "motor.rotor_inertia", 3e-4),
        ({}, "motor.thermal_resistance", 100.0 / (R * 4.0**2)),
        ({"thermal_resistance_K_per_W": 0.9}, "motor.thermal_resistance", 0.9),
        ({"thermal_time_constant_s": 400.0}, "motor.thermal_time_constant", 400.0),
        ({"thermal_time_constant_min": 9.0}, "motor.thermal_time_constant", 540.0),
        ({"cogging_Nm": 0.03}, "motor.cogging_amplitude", 0.03),
        ({"cogging_peak_to_peak_Nm": 0.03}, "motor.cogging_amplitude", 0.015),
        ({"cogging_Nm": 0.03, "poles": 8, "slots": 12}, "motor.cogging_periods", 24),
        ({"cogging_Nm": 0.03, "poles": 10}, "motor.cogging_periods", 60),
        ({}, "drive.continuous_current", 2.0 / 0.5),
        ({"stall_current_A": 4.1}, "drive.continuous_current", 4.1),
        ({"stall_torque_Nm": None, "rated_torque_Nm": 1.6}, "drive.continuous_current", 1.6 / 0.5),
        ({}, "drive.peak_current", 3 * 4.0),
        ({"peak_torque_Nm": 5.0}, "drive.peak_current", 5.0 / 0.5),
        ({"peak_torque_Nm": 5.0, "peak_current_A": 11.0}, "drive.peak_current", 11.0),
        ({"peak_torque_Nm": 5.0, "peak_current_A": 11.0}, "drive.torque_limit", 5.0),
        ({}, "drive.torque_limit", 0.5 * 12.0),
        ({"no_load_speed_rpm": 3000.0}, "drive.speed_limit", 3000.0 * RPM),
        ({}, "drive.speed_limit", math.sqrt(1.5) * 0.883 * 325.0 / 0.5),
        ({"no_load_speed_rpm": 30000.0}, "drive.speed_limit", math.sqrt(1.5) * 0.883 * 325.0 / 0.5),
    ],
)  # fmt: skip
def test_motor(change: dict[str, float | None], key: str, wanted: float) -> None:
    sheet = {name: entry for name, entry in {**MOTOR, **change}.items() if entry is not None}
    assert value(rig(motor=sheet), key) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(
    ("sheet", "key", "wanted"),
    [
        ({"supply_Vac": 230.0}, "drive.dc_bus_voltage", 230.0 * math.sqrt(2)),
        ({"dc_bus_V": 48.0}, "drive.dc_bus_voltage", 48.0),
        ({"dc_bus_V": 48.0}, "drive.speed_limit", math.sqrt(1.5) * 0.883 * 48.0 / THESIS.motor.torque_constant),
        ({"continuous_current_A": 3.0}, "drive.continuous_current", 3.0),
        ({"peak_current_A": 15.0}, "drive.peak_current", 15.0),
        ({"velocity_cycle_us": 100.0}, "rates.velocity_cycle", 1e-4),
        ({"velocity_cycle_us": 100.0}, "drive.speed_filter_time", 2e-4),
        ({"current_cycle_us": 62.5, "velocity_cycle_us": 125, "position_cycle_us": 250},
         "rates.current_cycle", 62.5e-6),
    ],
)  # fmt: skip
def test_drive(sheet: dict[str, float], key: str, wanted: float) -> None:
    bus: dict[str, object] = {"cycle_us": 500} if "current_cycle_us" in sheet else {"cycle_us": 400}
    assert value(rig(drive={**sheet}, bus=bus), key) == pytest.approx(wanted, rel=1e-9)


def test_the_lesser_of_motor_and_drive() -> None:
    found = rig(motor={**MOTOR}, drive={"continuous_current_A": 3.5, "peak_current_A": 8.0, "dc_bus_V": 100.0})
    assert value(found, "drive.continuous_current") == 3.5
    assert value(found, "drive.peak_current") == 8.0
    assert value(found, "drive.torque_limit") == 0.5 * 8.0
    assert value(found, "drive.speed_limit") == pytest.approx(math.sqrt(1.5) * 0.883 * 100.0 / 0.5)
    strong = rig(motor={**MOTOR}, drive={"continuous_current_A": 30.0, "peak_current_A": 80.0})
    assert value(strong, "drive.continuous_current") == 4.0
    assert value(strong, "drive.peak_current") == 12.0
    unbothered = rig(drive={"continuous_current_A": 30.0, "dc_bus_V": 400.0}).parameters.drive
    assert (unbothered.continuous_current, unbothered.speed_limit) == (3.397, THESIS.drive.speed_limit)


def test_bus() -> None:
    found = rig(bus={"cycle_us": 200, "command_latency_cycles": 2, "feedback_latency_cycles": 0})
    assert (value(found, "rates.bus_cycle"), value(found, "rates.plc_cycle")) == (2e-4, 2e-4)
    assert (value(found, "plc.command_latency"), value(found, "plc.feedback_latency")) == (2, 0)
    assert value(rig(bus={"cycle_us": 200, "plc_cycle_us": 1000}), "rates.plc_cycle") == 1e-3


@pytest.mark.parametrize(
    ("sheet", "counts", "interpolation"),
    [
        ({"lines": 2048}, 2048, 64), ({"lines": 2048, "bits": 17}, 2048, 64), ({"bits": 20}, 4096, 256),
        ({"bits": 10}, 1024, 1), ({"bits": 32}, 4096, 2**20), ({"lines": 10000, "bits": 24}, 10000, 1678),
    ],
)  # fmt: skip
def test_encoder(sheet: dict[str, object], counts: int, interpolation: int) -> None:
    found = rig(encoder=sheet)
    assert (value(found, "encoder.counts"), value(found, "encoder.interpolation")) == (counts, interpolation)
    assert value(found, "encoder.noise") == pytest.approx(0.83 * 2 * math.pi / (counts * interpolation))


@pytest.mark.parametrize(
    ("cell", "amplifier", "key", "wanted"),
    [
        ({"capacity_kg": 20.0}, {}, "load_cell.capacity", 20.0 * GRAVITY),
        ({"capacity_N": 300.0}, {}, "load_cell.capacity", 300.0),
        ({"capacity_Nm": 70.0}, {}, "load_cell.capacity", 70.0 / 0.2),
        ({"capacity_N": 300.0, "deflection_mm": 0.2}, {}, "load_cell.stiffness", 1.5e6),
        ({"stiffness_Nm_per_rad": 2e4}, {}, "load_cell.stiffness", 2e4 / 0.2**2),
        ({"capacity_N": 300.0}, {}, "load_cell.stiffness", 3e6 * 300.0 / (50.0 * GRAVITY)),
        ({"creep_percent": 2.0}, {}, "load_cell.creep", 0.02),
        ({}, {"bits": 16}, "load_cell.adc_bits", 16),
        ({}, {"filter_Hz": 900.0}, "load_cell.filter_bandwidth", 900.0),
        ({}, {"effective_bits": 15.0}, "load_cell.noise", 100 * GRAVITY / 2**15 * math.sqrt(200)),
        ({"capacity_N": 300.0}, {"effective_bits": 18.0, "effective_rate_Hz": 1000.0}, "load_cell.noise",
         600 / 2**18 * math.sqrt(20)),
        ({"capacity_N": 300.0}, {}, "load_cell.noise", 600 / 2**16.4 * math.sqrt(200)),
    ],
)  # fmt: skip
def test_load_cell(cell: dict[str, object], amplifier: dict[str, object], key: str, wanted: float) -> None:
    found = rig(load_cell=cell, amplifier=amplifier, stated="[parameters.linkage]\narm = 0.2\n")
    assert value(found, key) == pytest.approx(wanted, rel=1e-9)


def test_one_stage() -> None:
    found = rig(gearbox=[{**GEARBOX, "backlash_arcmin": 3.0, "teeth": 20, "efficiency_at_Nm": 4.0}])
    stage = found.parameters.gearbox.stage1
    assert (found.parameters.gearbox.stages, stage.kind, stage.ratio, stage.teeth) == (1, "planetary", 10.0, 20)
    assert stage.stiffness == pytest.approx(5.0 / ARCMIN)
    assert stage.backlash == pytest.approx(3.0 * ARCMIN)
    assert stage.transmission_error == pytest.approx(0.3 * ARCMIN)
    assert stage.drag == 0.04
    assert stage.efficiency == pytest.approx(0.95 * 4.0 / (4.0 - 0.04))
    assert stage.backdrive_efficiency == pytest.approx(1.0 - 1.5 * (1.0 / stage.efficiency - 1.0))
    assert stage.inertia / 100.0 + found.parameters.gearbox.input_inertia == pytest.approx(0.4e-4)
    assert stage.inertia / 100.0 == pytest.approx(0.13 * 0.4e-4)


def test_stages_add_up_to_the_unit() -> None:
    """Stiffness, play, inertia, ratio and efficiency of three stages are those that the sheet has of the whole."""
    unit = {**GEARBOX, "ratio": 60.0, "stages": 3, "stage_ratios": [3.0, 4.0, 5.0], "efficiency": 0.85,
            "backlash_arcmin": 6.0, "efficiency_at_Nm": 2.0}  # fmt: skip
    found = rig(gearbox=[unit]).parameters
    give = play = 0.0
    behind = 60.0
    for stage in found.gearbox.in_use:
        behind /= stage.ratio
        give += 1.0 / (stage.stiffness * behind**2)
        play += stage.backlash / behind
    assert 1.0 / give == pytest.approx(5.0 / ARCMIN)
    assert play == pytest.approx(6.0 * ARCMIN)
    assert found.gearbox.inertia_at_motor == pytest.approx(0.4e-4)
    assert found.gearbox.ratio == pytest.approx(60.0)
    assert driven_torque(found, 2.0) == pytest.approx(0.85 * 2.0 * 60.0)
    idle = sum(s.drag / r for s, r in zip(found.gearbox.in_use, (1.0, 3.0, 12.0), strict=True))
    assert idle == pytest.approx(0.04)
    equal = rig(gearbox=[{key: x for key, x in unit.items() if key != "stage_ratios"}]).parameters.gearbox
    assert equal.stage2.ratio == pytest.approx(60.0 ** (1.0 / 3.0))


def test_units_in_series() -> None:
    belt = {**GEARBOX, "kind": "belt", "ratio": 2.0, "inertia_kgcm2": 0.6}
    found = rig(gearbox=[belt, {**GEARBOX}])
    gearbox = found.parameters.gearbox
    assert (gearbox.stages, gearbox.ratio) == (2, 20.0)
    assert (gearbox.stage1.kind, gearbox.stage1.teeth, gearbox.stage1.transmission_error) == ("belt", 0, 0.0)
    assert gearbox.inertia_at_motor == pytest.approx(0.6e-4 + 0.4e-4 / 4.0)
    assert rig(gearbox=[{**GEARBOX, "kind": "worm"}]).parameters.gearbox.stage1.teeth == 1
    teeth = [d for d in rig(gearbox=[{**GEARBOX}]).derived if d.key == "gearbox.stage1.teeth"]
    assert (teeth[0].value, teeth[0].how[:7]) == (18, "assumed")


@pytest.mark.parametrize(
    ("motor", "stated", "torque"),
    [
        ({**MOTOR}, "", 2.0),
        ({"rated_torque_Nm": 8.0, "torque_constant_Nm_per_A": 1.4, "resistance_ohm": 1.5, "rotor_inertia_kgcm2": 6.0},
         "", 8.0),
        (None, "", 3.397 * 0.2944),
        (None, "[parameters.motor]\ntorque_constant = 0.6\n[parameters.drive]\ncontinuous_current = 5.0\n", 3.0),
    ],
)  # fmt: skip
def test_an_efficiency_belongs_to_what_the_motor_gives(
    motor: dict[str, object] | None, stated: str, torque: float
) -> None:
    sheets = {} if motor is None else {"motor": motor}
    found = rig(gearbox=[{**GEARBOX}], stated=stated, **sheets).parameters
    assert found.gearbox.stage1.efficiency == pytest.approx(mesh_efficiency(0.95, torque, [0.04], [10.0]))
    assert driven_torque(found, torque) == pytest.approx(0.95 * 10.0 * torque)


@pytest.mark.parametrize(
    ("sheets", "names"),
    [
        ({"motor": {**MOTOR, "stall_current_A": 40.0}}, "torque_constant_Nm_per_A and stall_torque_Nm over stall_curr"),
        ({"motor": {**MOTOR, "rated_torque_Nm": 1.0, "rated_current_A": 1.0}}, "torque_constant_Nm_per_A and rated_t"),
        ({"motor": {**MOTOR, "voltage_constant_V_per_krpm": 30.2 * 1.4142}},
         "torque_constant_Nm_per_A and voltage_constant_V_per_krpm contradict each other.*voltage_constant_peak_V_per"),
        ({"motor": {**MOTOR, "voltage_constant_peak_V_per_krpm": 30.2}}, "voltage_constant_peak_V_per_krpm contradict"),
        ({"motor": {**MOTOR, "torque_constant_Nm_per_A": 0.5, "voltage_constant_Vs_per_rad": 0.5}},
         "torque_constant_Nm_per_A and voltage_constant_Vs_per_rad"),
        ({"motor": {"stall_torque_Nm": 2.11, "stall_current_A": 4.04, "voltage_constant_V_per_krpm": 44.7}},
         "voltage_constant_V_per_krpm and stall_torque_Nm over stall_current_A"),
        ({"motor": {**MOTOR, "motor_constant_Nm_per_sqrtW": 3.0}}, "motor_constant_Nm_per_sqrtW and resistance_ohm"),
        ({"motor": {**MOTOR, "rotor_inertia_kgm2": 8.0}}, "rotor_inertia_kgcm2 and rotor_inertia_kgm2"),
        ({"motor": {**MOTOR, "inductance_mH": 8.0, "electrical_time_constant_ms": 20.0}},
         "inductance_mH and electrical_time_constant_ms"),
        ({"motor": {**MOTOR, "thermal_time_constant_s": 20.0, "thermal_time_constant_min": 20.0}},
         "thermal_time_constant_s and thermal_time_constant_min"),
        ({"motor": {**MOTOR, "cogging_Nm": 0.1, "cogging_peak_to_peak_Nm": 0.1}}, "cogging_Nm and cogging_peak_to_pea"),
        ({"motor": {**MOTOR, "peak_torque_Nm": 1.0}}, "peak_torque_Nm = 1 is less than stall_torque_Nm = 2"),
        ({"motor": {**MOTOR, "peak_current_A": 1.0, "stall_current_A": 4.0}}, "peak_current_A = 1 is less than stall"),
        ({"motor": {**MOTOR, "rated_speed_rpm": 4000.0, "no_load_speed_rpm": 3000.0}},
         "no_load_speed_rpm = 3000 is less than rated_speed_rpm = 4000"),
        ({"drive": {"supply_Vac": 230.0, "dc_bus_V": 48.0}}, "dc_bus_V and supply_Vac"),
        ({"drive": {"continuous_current_A": 9.0, "peak_current_A": 8.0}},
         "peak_current_A = 8 is less than continuous_current_A = 9"),
        ({"load_cell": {"capacity_kg": 50.0, "capacity_N": 5000.0}}, "capacity_N and capacity_kg"),
        ({"load_cell": {"capacity_kg": 50.0, "capacity_Nm": 500.0}}, "capacity_kg and capacity_Nm over linkage.arm"),
        ({"load_cell": {"deflection_mm": 0.1, "stiffness_Nm_per_rad": 10.0}},
         "deflection_mm and stiffness_Nm_per_rad over linkage.arm"),
        ({"encoder": {"lines": 8192, "bits": 10}}, "bits = 10, = 1024 is less than lines = 8192"),
        ({"amplifier": {"effective_rate_Hz": 10000.0}}, "amplifier.effective_bits: missing"),
        ({"encoder": {}}, "encoder.bits: missing"),
        ({"motor": {"torque_constant_Nm_per_A": 0.5}}, "motor.stall_torque_Nm: missing"),
        ({"motor": {"stall_torque_Nm": 0.5}}, "motor.torque_constant_Nm_per_A: missing"),
        ({"drive": {"current_cycle_us": 125.0}}, "drive and data_sheet.bus .from which rates follow.: .*multiple of"),
        ({"drive": {"dc_bus_V": 4000.0}}, "drive .from which drive.dc_bus_voltage follows.: 4000.0 is not valid"),
    ],
)  # fmt: skip
def test_what_contradicts_is_one_line(sheets: dict[str, dict[str, object]], names: str) -> None:
    with pytest.raises(InputError, match=rf"^my\.toml: data_sheet\.[\w.]*(: )?.*{names}") as failure:
        rig(**sheets)
    assert "\n" not in str(failure.value)


def test_ways_that_agree_are_welcome() -> None:
    found = rig(
        motor={
            **MOTOR, "stall_current_A": 4.3, "voltage_constant_V_per_krpm": 31.0, "rotor_inertia_kgm2": 0.8e-4,
            "motor_constant_Nm_per_sqrtW": 0.21, "rated_torque_Nm": 1.5, "rated_current_A": 3.4,
            "peak_torque_Nm": 6.0, "peak_current_A": 18.0, "rated_speed_rpm": 3000.0, "no_load_speed_rpm": 6000.0,
        },
        load_cell={"capacity_kg": 50.0, "capacity_N": 500.0},
    )  # fmt: skip
    assert found.parameters.motor.torque_constant == 0.5
    assert found.parameters.load_cell.capacity == 500.0


@pytest.mark.parametrize(
    ("unit", "problem"),
    [
        ({"teeth": 60, "transmission_error_arcmin": 20.0},
         r"transmission_error_arcmin: 20 is not possible.*than 2.86$"),
        ({"kind": "belt", "transmission_error_arcmin": 5.0}, "transmission_error_arcmin: 5 has no effect"),
        ({"stages": 2, "stage_ratios": [2.0, 4.0]}, r"stage_ratios: .*whose product is 10"),
        ({"idle_torque_Nm": 0.9}, "efficiency: efficiency 0.95 cannot be reached"),
        ({"stages": 4}, "stages: 4 is not valid"),
    ],
)
def test_faults_of_a_gearbox(unit: dict[str, object], problem: str) -> None:
    with pytest.raises(InputError, match=rf"^my\.toml: data_sheet\.gearbox\[0\]\.{problem}"):
        rig(gearbox=[{**GEARBOX, **unit}])


def test_a_transmission_error_never_turns_the_output_backwards() -> None:
    wide = rig(gearbox=[{**GEARBOX, "ratio": 100.0, "backlash_arcmin": 100.0, "teeth": 100}]).parameters.gearbox.stage1
    assert wide.transmission_error * wide.teeth * wide.ratio == pytest.approx(0.2)
    most = 0.5 / (10 * 20) / ARCMIN
    rig(gearbox=[{**GEARBOX, "teeth": 20, "transmission_error_arcmin": 0.99 * most}])
    with pytest.raises(InputError, match=r"^my.toml: parameters.gearbox.stage1: transmission_error × teeth × ratio"):
        rig(stated="[parameters.gearbox.stage1]\ntransmission_error = 0.009\n")


@pytest.mark.parametrize("arm", ["0.0", '"0.2"', "nan", "[1]"])
def test_what_a_derivation_needs_is_checked_first(arm: str) -> None:
    with pytest.raises(InputError, match=r"^my\.toml: parameters\.linkage\.arm: .* is not valid; give a number ≥ 0.01"):
        rig(load_cell={"capacity_Nm": 40.0}, stated=f"[parameters.linkage]\narm = {arm}\n")
