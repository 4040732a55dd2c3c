"""The flight of a scenario: standard atmosphere, airspeeds, and what the feel model is told of them."""

import numpy as np
import pytest

from cls_bench import atmosphere
from cls_bench.atmosphere import FOOT, KNOT
from cls_bench.bench import Bench
from cls_bench.drivers import scripted
from cls_bench.errors import InputError
from cls_bench.parameters.moving import HOST_CYCLE
from cls_bench.scenario import Flight, Scenario, parse_scenario
from tests.running import run

PLC_S = 4e-4

# --- atmosphere -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("altitude", "temperature", "pressure", "density", "sound"),
    [
        # ISO 2533 and ICAO Doc 7488, by geopotential altitude
        (0.0, 288.150, 1.01325e5, 1.22500, 340.294),
        (1000.0, 281.650, 8.98746e4, 1.11164, 336.434),
        (5000.0, 255.650, 5.40199e4, 0.736116, 320.529),
        (10000.0, 223.150, 2.64363e4, 0.412707, 299.463),
        (11000.0, 216.650, 2.26321e4, 0.363918, 295.069),
        (15000.0, 216.650, 1.20446e4, 0.193674, 295.069),
        (20000.0, 216.650, 5.47489e3, 0.0880349, 295.069),
    ],
)
def test_the_published_table(altitude, temperature, pressure, density, sound):
    found = [float(value) for value in atmosphere.air(altitude)]
    assert found == pytest.approx([temperature, pressure, density, sound], rel=5e-6)


def test_calibrated_airspeed():
    at_sea_level = atmosphere.of_calibrated(250.0 * KNOT, 0.0)
    assert float(at_sea_level.true) == pytest.approx(250.0 * KNOT, rel=1e-12)
    assert float(at_sea_level.dynamic_pressure) == pytest.approx(0.5 * 1.225 * (250.0 * KNOT) ** 2, rel=1e-6)
    # Definition, the other way round: the impact pressure in flight is that of the indicated speed at sea level.
    found, around = atmosphere.of_calibrated(280.0 * KNOT, 35_000.0 * FOOT), atmosphere.air(35_000.0 * FOOT)
    impact = around.pressure * ((1.0 + 0.2 * found.mach**2) ** 3.5 - 1.0)
    indicated = 101325.0 * ((1.0 + 0.2 * (280.0 * KNOT / 340.294) ** 2) ** 3.5 - 1.0)
    assert float(impact) == pytest.approx(indicated, rel=2e-6)
    assert float(found.mach) == pytest.approx(0.82, abs=0.005)  # where airliners that climb at 280 kt go over to M 0.82
    assert float(found.dynamic_pressure) == pytest.approx(0.5 * around.density * found.true**2, rel=1e-12)
    back = atmosphere.of_true(float(found.true), 35_000.0 * FOOT)
    assert float(back.mach) == pytest.approx(float(found.mach), rel=1e-12)
    # Slow and low it is the equivalent airspeed.
    slow = atmosphere.of_calibrated(60.0 * KNOT, 3000.0)
    assert float(slow.dynamic_pressure) == pytest.approx(0.5 * 1.225 * (60.0 * KNOT) ** 2, rel=2e-3)
    assert float(slow.true) == pytest.approx(60.0 * KNOT * np.sqrt(1.225 / 0.909122), rel=2e-3)


def test_beyond_the_atmosphere_and_beyond_sound():
    for altitude in (20_001.0, -5_001.0, float("nan")):
        with pytest.raises(ValueError, match="-5000 to 20000 m"):
            atmosphere.air(altitude)
    with pytest.raises(ValueError, match=r"Mach 1\."):
        atmosphere.of_calibrated([100.0, 250.0], [0.0, 15_000.0])


# --- the feel model's parameters --------------------------------------------------------------------------------------


def flight_of(scenario, time):
    return scenario.parameters_at(time).feel.flight


def test_a_constant_flight_is_set_from_the_start_on():
    scenario = parse_scenario(
        'title = "t"\nduration = 1.0\n[flight]\nairspeed_kt = 120\naltitude_ft = 8000.0\nangle_of_attack_deg = 3\n'
        "load_factor = 1.5\ntab_deg = -2.0"
    )
    found = atmosphere.of_calibrated(120.0 * KNOT, 8000.0 * FOOT)
    start = scenario.parameters_at_start().feel.flight
    assert start.dynamic_pressure == float(found.dynamic_pressure)
    assert start.airspeed == float(found.true)
    assert (start.angle_of_attack, start.load_factor, start.tab) == pytest.approx([np.radians(3), 1.5, np.radians(-2)])
    assert not scenario.courses
    assert flight_of(scenario, 0.9) == start
    other = scenario.on(scenario.parameters_at_start())
    assert parse_scenario(other.source).parameters_at_start() == scenario.parameters_at_start()
    true = Scenario(title="t", duration=1.0, flight=Flight(true_airspeed_kt=float(found.true) / KNOT, altitude_ft=8000))
    assert true.parameters_at_start().feel.flight.dynamic_pressure == pytest.approx(start.dynamic_pressure, rel=1e-12)


MOVING = """
[flight]
airspeed_kt = [[0.0, 80.0], [0.05, 80.0], [0.105, 140.0], [0.25, 100.0]]
altitude_ft = [[0.0, 5000.0], [0.3, 6000.0]]
tab_deg = [[0.1, 0.0], [0.2, 5.0]]
load_factor = 1.2
"""


def told(time):
    """Dynamic pressure, true airspeed and tab that a host would work out at times of its cycle."""
    v = np.interp(time, [0.0, 0.05, 0.105, 0.25], [80.0, 80.0, 140.0, 100.0]) * KNOT
    height = np.interp(time, [0.0, 0.3], [5000.0, 6000.0]) * FOOT
    found = atmosphere.of_calibrated(v, height)
    return found.dynamic_pressure, found.true, np.radians(np.interp(time, [0.1, 0.2], [0.0, 5.0]))


def test_a_flight_comes_one_host_cycle_late_and_without_stairs():
    scenario = parse_scenario(f'title = "t"\nduration = 0.3\n{MOVING}')
    bench = Bench(scenario.parameters_at_start())
    bench.block_ticks = bench.clock.plc_ticks
    rows = []
    for _ in scripted.run(bench, scenario):
        f = bench.parameters.feel.flight
        assert f == flight_of(scenario, bench.time - PLC_S)
        assert (f.load_factor, f.angle_of_attack) == (1.2, 0.0)
        rows.append((f.dynamic_pressure, f.airspeed, f.tab))
    time = np.arange(len(rows)) * PLC_S
    host = np.arange(0.0, 0.31, HOST_CYCLE)
    for values, at_host in zip(np.array(rows).T, told(host), strict=True):
        late = np.interp(time - HOST_CYCLE, host, at_host)
        np.testing.assert_allclose(values, late, rtol=1e-12, atol=1e-15)
        biggest = np.max(np.abs(np.diff(at_host)))
        assert np.max(np.abs(np.diff(values))) < 1.001 * biggest * PLC_S / HOST_CYCLE


def test_one_line_in_the_log():
    assert [(e.tick, e.level, e.message) for e in run(MOVING, duration=0.1).events] == [
        (0, "info", "flight: airspeed 80 to 134.5 kt, altitude 5000 to 5333 ft, load factor 1.2, tab 0°")
    ]
    assert not run("[flight]\nairspeed_kt = 100.0", duration=0.05).events


def test_a_flight_from_a_file(tmp_path):
    times = np.arange(0.0, 0.31, 0.02)
    kt, ft = 80.0 + 200.0 * times, np.full_like(times, 1000.0)
    rows = "\n".join(f"{t:.3f},{v:.6f},{h:.1f},{2 * t:.4f}" for t, v, h in zip(times, kt, ft, strict=True))
    (tmp_path / "f.csv").write_text(f"time [s],IAS [kt],alt [m],alpha_deg\n{rows}\n")
    text = (
        'title = "t"\nduration = 0.3\n[flight]\nfile = "f.csv"\nairspeed_kt = "IAS"\nangle_of_attack_deg = "alpha"\n'
        "altitude_ft = 3000\n"
    )
    scenario = parse_scenario(text, path=tmp_path / "s.toml")
    expected = atmosphere.of_calibrated((80.0 + 200.0 * 0.19) * KNOT, 3000.0 * FOOT)
    found = flight_of(scenario, 0.2)
    assert found.dynamic_pressure == pytest.approx(float(expected.dynamic_pressure), rel=1e-9)
    assert found.angle_of_attack == pytest.approx(np.radians(2 * 0.19), rel=1e-9)
    assert [note.split(":")[0] for note in scenario.notes] == [
        "flight.airspeed_kt f.csv", "flight.angle_of_attack_deg f.csv"
    ]  # fmt: skip
    again = parse_scenario(scenario.source, sample_files=scenario.sample_files)
    assert flight_of(again, 0.2) == found
    with pytest.raises(InputError, match=r'flight.altitude_ft: file "f.csv" names "m" as the unit .* says ft$'):
        parse_scenario(text.replace("altitude_ft = 3000", 'altitude_ft = "alt"'), path=tmp_path / "s.toml")
    with pytest.raises(InputError, match=r'flight.tab_deg: file "f.csv" has no column "tab"; found: .*alpha_deg$'):
        parse_scenario(f'{text}tab_deg = "tab"', path=tmp_path / "s.toml")


def test_a_file_as_spreadsheets_write_it():
    content = b"logger 3\nt;IAS\n5000,0;80,5\n5500,0;90,5\n"
    text = (
        'title = "t"\nduration = 1.0\n[flight]\nfile = "f.csv"\nairspeed_kt = "IAS"\n'
        'time_column = "t"\ntime_unit = "ms"\ntime_zero = 5000.0\ndelimiter = ";"\ndecimal = ","\nskip = 1\n'
    )
    scenario = parse_scenario(text, sample_files={"f.csv": content})
    assert flight_of(scenario, 0.26).airspeed == pytest.approx(85.5 * KNOT)
    assert flight_of(scenario, 0.9).airspeed == pytest.approx(90.5 * KNOT)


SCHEDULED = """
airspeed_kt = [[0.0, 100], [0.2, 200]]
tab_deg = 1.0
[flight.schedules]
"feel.centering.breakout" = [[100, 0.5], [150, 1.0], [190, 0.8]]
limb.mass = [[100, 1.5], [200, 2.5]]
"""


def test_other_parameters_follow_the_airspeed():
    text = f'title = "t"\nduration = 0.25\n[flight]{SCHEDULED}'
    scenario, bench = parse_scenario(text), Bench(parse_scenario(text).parameters_at_start())
    assert scenario.parameters_at_start().feel.centering.breakout == 0.5
    for block in scripted.run(bench, scenario):
        now = bench.parameters
        knots = np.interp(bench.time - 0.01, [0.0, 0.2], [100.0, 200.0])  # a host cycle late
        # what was written last is that of a PLC cycle ago, of the mass that of its host cycle
        expected = np.interp(knots, [100.0, 150.0, 190.0], [0.5, 1.0, 0.8])
        assert now.feel.centering.breakout == pytest.approx(expected, abs=0.005)
        assert now.limb.mass == pytest.approx(np.interp(knots, [100.0, 200.0], [1.5, 2.5]), abs=0.06)
        assert block.ticks
    assert bench.parameters.feel.centering.breakout == 0.8
    assert bench.parameters.limb.mass == 2.5
    again = parse_scenario(Scenario(**scenario.table).source)
    assert again.parameters_at(0.1) == scenario.parameters_at(0.1)
    assert 0.9 < scenario.parameters_at(0.1).feel.centering.breakout < 1.0


@pytest.mark.parametrize(
    ("line", "key", "what"),
    [
        ("feel.stiffness = 3.0", ".feel.stiffness", "3.0 is not valid; give up to 10000 points"),
        ("feel.stiffness = [[100, -3]]", ".feel.stiffness", "-3 is not valid; it must be ≥ 0"),
        ("feel.stiffness = [[100, 3], [100, 4]]", ".feel.stiffness", "do not grow"),
        ("feel.stifness = [[100, 3]]", ".feel.stifness", "did you mean feel.stiffness"),
        ("column.inertia = [[100, 1]]", ".column.inertia", "holds for the whole run"),
        ("feel.flight.airspeed = [[100, 1]]", ".feel.flight.airspeed", "follows from [flight]"),
        ("feel.aft_limit.angle = [[100, 0.2], [200, 0.9]]", ".feel", "must not exceed"),
    ],
)
def test_a_schedule_that_is_not_valid(line, key, what):
    with pytest.raises(InputError) as caught:
        parse_scenario(f'title = "t"\nduration = 0.25\n[flight]{SCHEDULED}{line}\n', name="s.toml")
    assert str(caught.value).startswith(f"s.toml: flight.schedules{key}: ") and what in str(caught.value)


def test_a_schedule_needs_an_airspeed_and_nothing_else_may_give_its_parameter():
    start = 'title = "t"\nduration = 0.25\n[flight]\n'
    with pytest.raises(InputError, match="flight: schedules are over the airspeed; give airspeed_kt"):
        parse_scenario(f"{start}load_factor = 1.0\n[flight.schedules]\nfeel.stiffness = [[1, 2]]")
    with pytest.raises(InputError, match=r"parameters.feel.centering.breakout: follows from \[flight\]"):
        parse_scenario(f"{start}{SCHEDULED}[parameters]\nfeel.centering.breakout = 1.0")


# --- what the pilot feels ---------------------------------------------------------------------------------------------

HELD = """
[[hand]]
at = 0.0
kind = "hold"
angle_deg = 0.0
[[hand]]
at = 0.1
kind = "ramp"
to_deg = 5.0
over = 0.5
smooth = true
[parameters.limb]
arm_stiffness = 2e4
[parameters.feel]
friction = 0.0
stiffness = {stiffness}
"""


def torques(extra, stiffness=0.0):
    """Stiffness at the grip and dynamic pressure at 100, 200 and 300 kt, the column held at about 5°."""
    text = HELD.format(stiffness=stiffness) + extra + (
        "\n[flight]\nairspeed_kt = [[2.0, 100], [2.5, 200], [3.5, 200], [4.0, 300]]\n"
    )
    found = run(text, duration=5.0)
    assert found.error is None
    rows = []
    for start, knots in ((1.55, 100.0), (3.05, 200.0), (4.55, 300.0)):  # 0.4 s: it wanders by 0.01 N·m
        torque = np.mean(found.between("/column.torque", start, start + 0.4))
        angle = np.mean(found.between("/feel.angle", start, start + 0.4))
        rows.append((abs(torque / angle), float(atmosphere.of_calibrated(knots * KNOT, 0.0).dynamic_pressure)))
    return np.array(rows).T


def test_the_feel_unit_stiffens_with_dynamic_pressure():
    gradient = 40.0 / 14_000.0
    found, q = torques(f"q_feel.gradient = {gradient!r}", stiffness=20.0)
    assert found == pytest.approx(20.0 + gradient * q, rel=0.01)
    assert (found[2] - 20.0) / (found[0] - 20.0) == pytest.approx(9.0, rel=0.05)  # with V²


def test_the_hinge_moment_grows_with_dynamic_pressure():
    found, q = torques(
        "surface.area = 0.5\nsurface.chord = 0.3\nsurface.hinge_deflection = -0.03\nsurface.gearing = 1.4\n"
        "surface.boost = 0.25"
    )
    assert found == pytest.approx(0.75 * 1.4**2 * 0.5 * 0.3 * 0.03 * q, rel=0.01)
    assert found[1] / found[0] == pytest.approx(4.0, rel=0.05)


# --- what is wrong ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "key", "what"),
    [
        ("airspeed_kt = 700.0", "flight.airspeed_kt", "700 is not valid; it must be ≥ 0 and ≤ 660 [kt]"),
        ("airspeed_kt = -1", "flight.airspeed_kt", "-1 is not valid"),
        ("airspeed_kt = nan", "flight.airspeed_kt", "NaN is not valid; give a number"),
        ("airspeed_kt = true", "flight.airspeed_kt", "true is not valid; give a number, points"),
        ("airspeed_kt = []", "flight.airspeed_kt", "[] is not valid"),
        ("airspeed_kt = [[0.0, 100.0], [1.0]]", "flight.airspeed_kt", "is not valid; give a number, points"),
        ("airspeed_kt = [[0.0, 100.0], [0.0, 90.0]]", "flight.airspeed_kt", "the time 0 s does not come after 0 s"),
        ("airspeed_kt = [[0.0, 100.0], [1.0, 900.0]]", "flight.airspeed_kt", "900 at 1 s is not valid"),
        ("airspeed_kt = 500.0\naltitude_ft = 50000", "flight.airspeed_kt", "500 kt at 50000 ft, 0 s, is not valid"),
        ("airspeed_kt = 100.0\naltitude_ft = 70000", "flight.altitude_ft", "≤ 65616.8 [ft]"),
        ("airspeed_kt = 100.0\ntrue_airspeed_kt = 100.0", "flight", "either airspeed_kt or true_airspeed_kt"),
        ("altitude_ft = 100.0", "flight", "means nothing without airspeed_kt"),
        ("load_factor = 25", "flight.load_factor", "≥ -10 and ≤ 20"),
        ("angle_of_attack_deg = 95.0", "flight.angle_of_attack_deg", "≤ 91.6"),
        ('airspeed_kt = "IAS"', "flight", "is the column of a file; give file"),
        ('airspeed_kt = 100\nfile = "f.csv"', "flight", "no value is taken from file"),
        ('airspeed_kt = "IAS"\nfile = "f.csv"', "flight.file", "cannot be read"),
        ('airspeed_kt = "v"\nfile = "f.csv"\ntime_unit = "qq"', "flight.time_unit", '"qq" is not valid; give one'),
        ('airspeed_kt = 100\nskip = 1', "flight", "skip says how a file is read; give file"),
        ("", "flight", "gives nothing; valid: airspeed_kt"),
        ("airspeed = 100.0", "flight.airspeed", "unknown key; did you mean airspeed_kt"),
        ("airspeed_kt = 100\n[parameters.feel]\nflight.airspeed = 1.0", "parameters.feel.flight.airspeed", "[flight]"),
        (
            "airspeed_kt = 100\n[[changes]]\nat = 0.5\nparameters.feel.flight.dynamic_pressure = 1.0",
            "changes[0].parameters.feel.flight.dynamic_pressure", "follows from [flight]",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_line(text, key, what):
    with pytest.raises(InputError) as caught:
        parse_scenario(f'title = "t"\nduration = 1.0\n[flight]\n{text}', name="s.toml")
    message = str(caught.value)
    assert message.startswith(f"s.toml: {key}: ")
    assert what in message
    assert "\n" not in message and len(message) < 600


def test_what_a_flight_does_not_give_may_still_change():
    text = 'title = "t"\nduration = 1.0\n[flight]\nairspeed_kt = 100\n[[changes]]\nat = 0.5\n'
    scenario = parse_scenario(f"{text}over = 0.1\nparameters.feel.flight.load_factor = 2.0")
    assert flight_of(scenario, 0.55).load_factor == pytest.approx(1.5)
    faster = parse_scenario(f"{text}mode = 'off'", set=["flight.airspeed_kt=200"])
    assert flight_of(faster, 0.0).airspeed == pytest.approx(200.0 * KNOT)
