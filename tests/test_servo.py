"""The drive: each controller alone against a load written down here, then on the bench."""

import math

import numpy as np
import pytest

from cls_bench.control import latch, servo, tuning
from cls_bench.control.outer_loop import Command
from cls_bench.kinematics import FourBar, crank_from_column, crank_ratio
from cls_bench.parameters import Drive, Motor, Parameters, record_of
from cls_bench.signals import CLOCK
from tests.running import run

BAR = FourBar(0.100, 0.209, 0.175)

PLC_S, TICK_S, VELOCITY_S = CLOCK.plc_s, CLOCK.tick_s, CLOCK.velocity_s


def parts(load_inertia=9.27e-5, **drive):
    """Parameter record, gains, state; of the plant nothing is asked."""
    plate = Parameters().nameplate.model_copy(update={"load_inertia": load_inertia})
    p = record_of(Parameters(drive=Drive(**drive), nameplate=plate))
    return p, tuning.design(p.drive, p.nameplate, VELOCITY_S), np.zeros(1, dtype=servo.STATE).view(np.recarray)[0]


class Winding:
    """Resistance and inductance, exact for a voltage held over a tick, which comes a tick late."""

    def __init__(self, motor: Motor):
        self.current, self.pending = 0.0, 0.0
        self.pole = math.exp(-motor.resistance / motor.inductance * TICK_S)
        self.resistance = motor.resistance

    def step(self, voltage: float) -> None:
        self.current = self.pole * self.current + (1 - self.pole) * self.pending / self.resistance
        self.pending = voltage


def current_step(torque, ticks, voltage_limit=351.0, **drive):
    p, gains, s = parts(**drive)
    winding, currents = Winding(Motor()), []
    s.torque_command = torque
    for _ in range(ticks):
        servo.current_controller(p.drive, p.nameplate, gains, s, winding.current, voltage_limit, TICK_S)
        winding.step(s.voltage)
        currents.append(winding.current)
    return np.array(currents), s


def test_current_loop_steps_within_its_bandwidth():
    current, _ = current_step(1.0, 200)
    wanted = 1.0 / Motor().torque_constant
    reached = np.argmax(current > (1 - math.exp(-1)) * wanted) * TICK_S
    assert reached == pytest.approx(1 / (2 * math.pi * 1000), abs=1.5 * TICK_S)
    assert current.max() < 1.1 * wanted
    np.testing.assert_allclose(current[40:], wanted, rtol=2e-3)


def test_current_loop_bandwidth_is_a_parameter():
    fast, slow = (current_step(1.0, 400, current_bandwidth=f)[0] for f in (1000.0, 100.0))
    half = 0.5 / Motor().torque_constant
    assert np.argmax(slow > half) > 6 * np.argmax(fast > half)


def test_current_stays_at_the_peak_limit():
    current, _ = current_step(60.0, 400)
    assert current[-1] == pytest.approx(20.38, rel=1e-3)


def test_current_controller_does_not_wind_up_at_the_voltage_limit():
    """Held at the voltage limit for long, it comes back within a few time constants of the winding."""
    p, gains, s = parts()
    winding = Winding(Motor())
    s.torque_command = 5.0
    for k in range(4000):
        servo.current_controller(p.drive, p.nameplate, gains, s, winding.current, 30.0, TICK_S)
        assert abs(s.voltage) <= 30.0
        winding.step(s.voltage)
        if k == 1999:
            s.torque_command = 1.0
        if k == 2100:
            assert winding.current == pytest.approx(1.0 / Motor().torque_constant, rel=0.02)


def test_i2t_monitor_falls_back_to_the_continuous_current():
    current, s = current_step(6.0, 60_000)
    peak, rated = 20.38, 3.397
    # Time at which (i/i_c)² through the winding's 60 s low pass reaches 1.
    until = -60.0 * math.log(1 - (rated / peak) ** 2)
    over = np.argmax((current < 0.98 * peak) & (np.arange(60_000) > 100)) * TICK_S
    assert 0.85 * until < over <= 1.01 * until
    assert current[-20_000:].max() < 1.2 * rated
    assert current[-1] == pytest.approx(rated, rel=0.15)
    assert s.thermal_load <= 1.0 + 1e-3
    assert np.abs(np.diff(current[-20_000:])).max() < 0.05  # it does not flutter about the limit


def test_continuous_current_is_allowed_for_good():
    current, _ = current_step(0.999 * 3.397 * Motor().torque_constant, 60_000)
    np.testing.assert_allclose(current[-100:], 0.999 * 3.397, rtol=1e-3)


def velocity_loop(wanted, cycles, inertia, load=0.0, **drive):
    """Speed of a rigid shaft on which the velocity controller works, torque without delay; also the torque."""
    p, gains, s = parts(**drive)
    angle = speed = 0.0
    speeds, torques = [], []
    for k in range(cycles):
        servo.speed_filter(gains, s, angle, VELOCITY_S)
        s.set_velocity = wanted(k) if callable(wanted) else wanted
        servo.velocity_controller(p.drive, gains, s, VELOCITY_S)
        acceleration = (s.torque_command - load) / inertia
        angle += speed * VELOCITY_S + 0.5 * acceleration * VELOCITY_S**2
        speed += acceleration * VELOCITY_S
        speeds.append(speed)
        torques.append(s.torque_command)
    return np.array(speeds), np.array(torques), s


def test_velocity_loop_follows_from_bandwidth_and_inertia():
    _, gains, _ = parts(velocity_bandwidth=80.0, load_inertia=2e-4, position_bandwidth=20.0)
    assert gains.velocity_proportional == pytest.approx(2e-4 * 2 * math.pi * 80.0)
    assert gains.position_proportional == pytest.approx(2 * math.pi * 20.0)
    one, _, _ = velocity_loop(10.0, 500, 9.27e-5)
    heavy, _, _ = velocity_loop(10.0, 500, 5 * 9.27e-5, load_inertia=5 * 9.27e-5)
    np.testing.assert_allclose(heavy, one, rtol=1e-9)
    half, _, _ = velocity_loop(10.0, 500, 9.27e-5, velocity_bandwidth=50.0)
    assert np.argmax(half > 6.32) > 1.6 * np.argmax(one > 6.32)


def test_velocity_loop_crosses_over_at_its_bandwidth():
    """Open loop |L| = 1 at the design bandwidth, from a sine through controller, shaft and filter."""
    p, gains, s = parts(speed_filter_time=0.0, velocity_integral_time=10.0)
    f, n = 100.0, 5000
    angle = speed = 0.0
    out = []
    for k in range(n):
        t = k * VELOCITY_S
        servo.speed_filter(gains, s, angle, VELOCITY_S)
        s.set_velocity = math.sin(2 * math.pi * f * t) + s.velocity  # the loop is cut: the error is the sine
        servo.velocity_controller(p.drive, gains, s, VELOCITY_S)
        acceleration = s.torque_command / 9.27e-5
        angle += speed * VELOCITY_S + 0.5 * acceleration * VELOCITY_S**2
        speed += acceleration * VELOCITY_S
        out.append(speed)
    t = np.arange(n) * VELOCITY_S
    gain = 2 / n * abs(np.sum(np.array(out) * np.exp(-2j * math.pi * f * t)))
    assert gain == pytest.approx(1.0, rel=0.03)


def test_velocity_loop_has_no_steady_error_under_load():
    speeds, torques, _ = velocity_loop(5.0, 3000, 9.27e-5, load=0.8)
    assert speeds[-1] == pytest.approx(5.0, abs=1e-6)
    assert torques[-1] == pytest.approx(0.8, abs=1e-6)


def test_velocity_controller_does_not_wind_up_at_the_torque_limit():
    """A load above the limit stalls the shaft for 0.2 s; the integral stays put, so the limit is left at once."""
    p, gains, s = parts(torque_limit=2.0)
    s.set_velocity = 50.0
    for _ in range(1000):
        servo.velocity_controller(p.drive, gains, s, VELOCITY_S)  # speed stays 0
        assert s.torque_command <= 2.0
    assert abs(s.velocity_integral) <= 2.0
    s.set_velocity = -1.0
    servo.velocity_controller(p.drive, gains, s, VELOCITY_S)
    assert s.torque_command < 2.0
    for _ in range(400):
        servo.velocity_controller(p.drive, gains, s, VELOCITY_S)
    assert s.torque_command < 0.0


def test_position_controller_does_not_wind_up_at_the_speed_limit():
    p, gains, s = parts(speed_limit=20.0, position_integral_time=0.05)
    for _ in range(2000):
        servo.position_controller(p.drive, gains, s, 0.0, 5.0, 0.0, PLC_S)
    assert s.position_output == 20.0
    assert abs(s.position_integral) <= 20.0
    servo.position_controller(p.drive, gains, s, 0.0, -0.2, 0.0, PLC_S)
    assert s.position_output < 20.0


def test_position_integral_removes_a_constant_error():
    """With the integral a drift in speed (a velocity loop that is 1 rad/s off) leaves no error; without it does."""
    ends = []
    for integral_time in (0.0, 0.1):
        p, gains, s = parts(position_integral_time=integral_time)
        position = 0.0
        for _ in range(5000):
            servo.position_controller(p.drive, gains, s, position, 1.0, 0.0, PLC_S)
            position += (s.position_output - 1.0) * PLC_S
        ends.append(position)
    assert ends[0] == pytest.approx(1.0 - 1.0 / (2 * math.pi * 35.0), abs=1e-6)
    assert ends[1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(("time", "share"), [(0.0004, 1 - math.exp(-0.5)), (0.0, 1.0), (0.002, 1 - math.exp(-0.1))])
def test_speed_filter(time, share):
    """A ramp in position: the speed comes up as a first-order lag, cycle by cycle."""
    _, gains, s = parts(speed_filter_time=time)
    expected = 0.0
    for k in range(20):
        servo.speed_filter(gains, s, 3.0 * (k + 1) * VELOCITY_S, VELOCITY_S)
        expected += share * (3.0 - expected)
        assert s.velocity == pytest.approx(expected)


def test_feed_forward_of_the_set_velocity_can_be_switched():
    for on in (False, True):
        p, gains, s = parts(feed_forward_velocity=on)
        servo.position_controller(p.drive, gains, s, 1.0, 1.0, 7.0, PLC_S)
        assert s.position_output == (7.0 if on else 0.0)


def test_latch_gives_back_what_was_written_so_many_cycles_ago():
    memory = np.zeros((latch.DEPTH, 1))
    for cycle in range(60):
        latch.write(memory, cycle, 0, 100.0 + cycle)
        for delay in range(latch.DEPTH):
            assert latch.read(memory, cycle, delay, 0) == 100.0 + max(cycle - delay, 0)


# --- on the bench ----------------------------------------------------------------------------------------------------


class Asks:
    """An outer loop that asks for what a function of time says."""

    def __init__(self, command):
        self.command = command

    def step(self, inputs):
        return self.command(inputs.time)


def test_set_values_are_interpolated_between_position_cycles():
    """At 5 kHz the set velocity goes: mean of two position outputs, newest output, mean, newest, …"""
    r = run(controller=Asks(lambda t: Command(0.05 * math.sin(20.0 * t))), duration=0.3)
    v = r["/drive.set_velocity"]
    newest, between = v[1::2], v[2::2]
    np.testing.assert_allclose(between, 0.5 * (newest[:-1] + newest[1:])[: len(between)], atol=1e-12)
    assert np.ptp(v) > 10.0


def test_a_position_step_settles_without_error():
    r = run(controller=Asks(lambda t: Command(0.02 if t >= 0.1 else 0.0)), duration=0.6)
    wanted = 25.0 * crank_from_column(BAR, 0.02)
    after = r.between("/drive.position", 0.1, 0.6)
    assert after[-1] == pytest.approx(wanted, abs=0.01)
    assert after.max() < 1.15 * wanted
    # The position loop is ω/s: 63 % after 1/ω, plus the delays of bus and velocity loop.
    rise = np.argmax(after > 0.632 * wanted) * VELOCITY_S
    assert 1 / (2 * math.pi * 35.0) < rise < 2 / (2 * math.pi * 35.0)


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_the_bus_delays_a_command_by_exactly_its_latency(delay):
    r = run(
        controller=Asks(lambda t: Command(0.01 if t >= 0.0999 else 0.0)), duration=0.12,
        set=[f"plc.command_latency={delay}"],
    )  # fmt: skip
    at = np.flatnonzero(r["/drive.set_position"] > 0.1)[0] * 4
    assert at == 2000 + 8 * delay


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_the_bus_delays_the_feedback_by_exactly_its_latency(delay):
    """With a noiseless motion, what the PLC sees in cycle k is the encoder of cycle k − latency."""
    seen = []

    class Watch:
        def step(self, inputs):
            seen.append(inputs)
            return Command(0.05 * math.sin(15.0 * inputs.time))

    r = run(controller=Watch(), duration=0.2, set=[f"plc.feedback_latency={delay}"])
    encoder, speed = r["/drive.position"][::2], r["/drive.velocity"][::2]
    expected = np.array([crank_from_column(BAR, s.angle) * 25.0 for s in seen])
    np.testing.assert_allclose(expected[20:], encoder[20 - delay : len(seen) - delay], atol=5e-4)
    ratio = np.array([25.0 * crank_ratio(BAR, crank_from_column(BAR, s.angle), s.angle) for s in seen])
    np.testing.assert_allclose(
        ratio[20:] * [s.velocity for s in seen[20:]], speed[20 - delay : len(seen) - delay], atol=1e-2
    )
    assert np.ptp(encoder) > 2.0


def test_the_voltage_comes_exactly_its_latency_late():
    """Rows of /drive are 4 ticks apart; the slow current loop stays stable with 8 ticks of delay."""
    starts = []
    for ticks in (0, 4, 8):
        r = run(
            'changes = [{at = 0.02, mode = "torque"}]', duration=0.03,
            set=[f"drive.voltage_latency={ticks}", "drive.set_torque=1.0", "drive.current_bandwidth=100.0"],
        )  # fmt: skip
        starts.append(np.flatnonzero(r["/drive.voltage"] > 5.0)[0] * 4)
    assert starts == [400, 404, 408]


@pytest.mark.parametrize(
    ("key", "limit", "signal"),
    [("torque_limit", 0.4, "torque_command"), ("speed_limit", 15.0, "set_velocity"), ("peak_current", 1.5, "current")],
)
def test_limits_hold_on_the_bench(key, limit, signal):
    wild = Asks(lambda t: Command(0.25 * math.copysign(1.0, math.sin(12.0 * t)) if t > 0.01 else 0.0))
    hold = ["plc.following_error_limit=10.0"]
    free = run(controller=wild, duration=0.8, set=hold)
    held = run(controller=wild, duration=0.8, set=[*hold, f"drive.{key}={limit}"])
    assert not free.error and not held.error
    assert np.abs(free[f"/drive.{signal}"]).max() > 1.5 * limit
    assert np.abs(held[f"/drive.{signal}"]).max() < limit * (1.1 if key == "peak_current" else 1 + 1e-12)


def torque_before_and_after(command, at, **run_arguments):
    """Torque command [N·m] of two runs that differ in one switch, in the velocity cycle in which they part."""
    off, on = (run(controller=Asks(command), duration=0.15, set=s, **run_arguments) for s in at)
    difference = on["/drive.torque_command"] - off["/drive.torque_command"]
    first = np.flatnonzero(difference)[0]
    return first, difference[first]


def test_feed_forward_of_the_inertia_can_be_switched():
    def command(t):
        return Command(0.0, 0.0, 20.0 if t >= 0.0999 else 0.0)

    first, step = torque_before_and_after(command, ([], ["drive.feed_forward_inertia=true"]))
    assert first * 4 == 2000 + 8  # one bus cycle later
    assert step == pytest.approx(9.27e-5 * 25.0 * 1.75 * 20.0, rel=1e-3)


def test_additional_torque_of_the_outer_loop_is_fed_forward():
    base = run(controller=Asks(lambda t: Command(0.0)), duration=0.15)
    more = run(controller=Asks(lambda t: Command(0.0, torque=5.0 if t >= 0.0999 else 0.0)), duration=0.15)
    difference = more["/drive.torque_command"] - base["/drive.torque_command"]
    first = np.flatnonzero(difference)[0]
    assert first * 4 == 2000 + 8
    assert difference[first] == pytest.approx(5.0 / (25.0 * 1.75), rel=1e-3)


PUSH = """
hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}, {at = 0.1, kind = "step", to_N = 40.0}]
"""


def test_feed_forward_of_the_pilots_torque_makes_the_servo_stiffer():
    """The hand pushes a column that is asked to stand still: compensated, it gives way less than half as much."""
    still = Asks(lambda t: Command(0.0))
    off = run(PUSH, controller=still, duration=0.4)
    on = run(PUSH, controller=still, duration=0.4, set=["drive.feed_forward_pilot=true"])
    moved = [np.abs(r.between("/drive.position", 0.1, 0.4)).max() for r in (off, on)]
    assert moved[1] < 0.5 * moved[0]
    # Both carry the load in the end, but for what the gearbox's friction holds.
    for r in (off, on):
        assert -40.0 * 0.3 / 43.75 < r.between("/drive.torque_command", 0.35, 0.4).mean() < -0.1


def test_torque_mode_gives_the_torque_asked_for():
    r = run('changes = [{at = 0.05, mode = "torque"}]', duration=0.1, set=["drive.set_torque=0.5"])
    np.testing.assert_allclose(r.between("/drive.torque_command", 0.051, 0.1), 0.5)
    np.testing.assert_allclose(r.between("/drive.torque", 0.06, 0.1), 0.5, rtol=0.02)
    assert not [e for e in r.events if e.source == "safety"]


def test_an_outer_loop_may_ask_for_torque_in_torque_mode():
    r = run(
        'changes = [{at = 0.0, mode = "torque"}]', controller=Asks(lambda t: Command(0.0, torque=10.0)), duration=0.05
    )
    np.testing.assert_allclose(r.between("/drive.torque_command", 0.01, 0.012), 10.0 / 43.75, rtol=1e-2)


def test_velocity_mode_follows_the_set_velocity():
    r = run(
        controller=Asks(lambda t: Command(0.0, velocity=0.3)), duration=0.9,
        set=['plc.outer_loop="velocity"'],
    )  # fmt: skip
    assert r.between("/column.velocity", 0.1, 0.9).mean() == pytest.approx(0.3, rel=0.03)
    assert r["/column.angle"][-1] > 0.25  # beyond the limit of the following error, which is for positions only
    assert not r.events


def test_from_torque_mode_the_velocity_controller_takes_over_the_torque():
    """The motor carries 0.2 N·m against the hand; in the cycle after the change it still does."""
    r = run(
        PUSH + 'changes = [{at = 0.1, mode = "torque"}, {at = 0.5, mode = "position"}]',
        duration=0.6, set=["drive.set_torque=-0.2"],
    )  # fmt: skip
    assert not r.events[2:]
    np.testing.assert_allclose(r.between("/drive.torque_command", 0.11, 0.5), -0.2)
    assert r.between("/drive.torque_command", 0.5, 0.502) == pytest.approx(-0.2, abs=0.05)


@pytest.mark.parametrize("off", ['power = "off"', 'mode = "off"'])
def test_off_is_no_torque_at_all_and_a_free_motor(off):
    r = run(
        f"""
        hand = [{{at = 0.0, kind = "hold", angle_deg = 0.0}}, {{at = 0.1, kind = "ramp", to_deg = 15.0, over = 0.4}}]
        changes = [{{at = 0.05, {off}}}]
        """,
        duration=0.6,
    )
    for signal in ("torque", "current", "voltage", "torque_command"):
        assert not r.between(f"/drive.{signal}", 0.0505, 0.6).any()
    assert not [e for e in r.events if e.source == "safety"]
    assert r["/column.angle"][-1] > math.radians(5.0)
    crank = crank_from_column(BAR, r["/column.angle"][-1])
    assert r["/drive.position"][-1] == pytest.approx(25.0 * crank, abs=0.1)  # within the play of the train


@pytest.mark.parametrize(
    "changes",
    [
        'at = 0.7, mode = "velocity"}, {at = 0.9, mode = "position"',
        'at = 0.7, mode = "off"}, {at = 0.9, mode = "position"',
        'at = 0.7, power = "off"}, {at = 0.9, power = "on"',
        'at = 0.7, mode = "torque"}, {at = 0.9, mode = "position"',
    ],
)
def test_changes_of_mode_make_no_jump(changes):
    """The hand holds the column away from neutral; switching back to position control does not throw it."""
    r = run(
        f"""
        hand = [{{at = 0.0, kind = "hold", angle_deg = 0.0}},
                {{at = 0.1, kind = "ramp", to_deg = 10.0, over = 0.4, smooth = true}}]
        changes = [{{{changes}}}]
        """,
        duration=1.2,
    )
    assert not [e for e in r.events if e.source == "safety"]
    before = r.between("/column.angle", 0.85, 0.9).mean()
    after = r.between("/column.angle", 0.9, 0.92)
    assert before > math.radians(2.0)
    assert np.abs(after - before).max() < math.radians(0.15)
