"""Linear theory against computations of one's own: the plant as an eigenvalue problem, the sampled side by brute force.

Nothing of ``cls_bench.linear`` but its results is used in them: the plant is written down from energies that are
differentiated numerically, and the sampled system is run tick by tick with numbers.
"""

import math

import numpy as np
import pytest

from cls_bench.analysis.quasi_static import balanced
from cls_bench.errors import InputError
from cls_bench.feel_laws import Laws
from cls_bench.linear.bench import LinearBench, winding
from cls_bench.linear.cycle import Compensation, _answer
from cls_bench.linear.hand import Hand, forward_inertia
from cls_bench.linear.least import GRIPS, least_inertia
from cls_bench.linear.linkage import levers, weight
from cls_bench.linear.plant import plant, resonances
from cls_bench.linear.prediction import predict
from cls_bench.linear.variation import Setup, changed, ideal
from cls_bench.parameters import Parameters
from tests.feel_solver import Model

GRAVITY = 9.80665


def rig(**values):
    """The default rig with other values, and with the nameplate that they give; keys with __ for a dot."""
    table = Parameters().model_dump()
    for key, value in values.items():
        *path, name = key.split("__")
        section = table
        for part in path:
            section = section[part]
        section[name] = value
    return Parameters.model_validate(table).with_nameplate()


SKEW = {"linkage__crank": 0.12, "linkage__rod": 0.5, "linkage__crank_angle": -0.2, "linkage__rod_angle": 0.1,
        "linkage__arm_angle": 0.3}  # fmt: skip
BELT = {"gearbox__stages": 1, "gearbox__stage1__kind": "belt", "gearbox__stage1__teeth": 0,
        "gearbox__stage1__ratio": 3.5, "gearbox__stage1__stiffness": 900.0}  # fmt: skip
RIGS = {
    "thesis": {},
    "one_stage": {"gearbox__stages": 1, "gearbox__stage1__ratio": 10.0, "gearbox__stage1__stiffness": 8e3},
    "three_stages": {"gearbox__stages": 3, "gearbox__stage3__ratio": 2.5, "gearbox__stage3__inertia": 6e-4,
                     "gearbox__stage3__stiffness": 6e4},
    "direct_drive": {"gearbox__stages": 0, "motor__rotor_inertia": 4e-3, "gearbox__input_inertia": 1e-4},
    "belt": BELT,
    "worm": {"gearbox__stages": 1, "gearbox__stage1__kind": "worm", "gearbox__stage1__ratio": 40.0,
             "gearbox__stage1__teeth": 1, "gearbox__stage1__backdrive_efficiency": -0.2},
    "skew": SKEW,
    "no_linkage": {"linkage__kind": "none"},
    "no_linkage_direct": {"linkage__kind": "none", "gearbox__stages": 0},
}  # fmt: skip


# The plant


def energies(p, hand):
    """Kinetic energy over velocities at neutral, and potential energy over (shafts…, column, limb), without linear
    terms: what is written down here is where each mass is and how far each spring is stretched."""
    link, col = p.linkage, p.column
    stages = p.gearbox.in_use
    n = len(stages)
    four_bar = link.kind == "four_bar"
    at_crank, far, end = (
        (link.rod_crank_mass, link.rod_column_mass - link.rod_end_mass, link.rod_end_mass) if four_bar else (0, 0, 0)
    )
    gamma, rho, alpha = link.crank_angle, link.rod_angle, link.arm_angle
    axis = np.array([
        link.arm * math.sin(alpha) - link.rod * math.cos(rho) - link.crank * math.sin(gamma),
        link.arm * math.cos(alpha) + link.rod * math.sin(rho) - link.crank * math.cos(gamma),
    ])

    def pins(q):
        c, f = q[n] + link.crank_angle, q[n + 1] + link.arm_angle
        return axis + link.crank * np.array([math.sin(c), math.cos(c)]), link.arm * np.array([math.sin(f), math.cos(f)])

    def points(q):
        c1, c2 = pins(q)
        rod = (c2 - c1) / np.linalg.norm(c2 - c1)
        return (at_crank, c1), (far, c1 + link.rod * rod), (end, c2)

    def potential(q):
        v = GRAVITY * col.mass * col.mass_height * math.cos(q[n + 1])
        if four_bar:
            v += GRAVITY * sum(m * x[1] for m, x in points(q))
            c1, c2 = pins(q)
            v += 0.5 * p.load_cell.stiffness * (np.linalg.norm(c2 - c1) - link.rod) ** 2
        else:
            v += 0.5 * p.load_cell.stiffness * (link.arm * (q[n + 1] - q[n])) ** 2
        for k, stage in enumerate(stages):
            v += 0.5 * stage.stiffness * (q[k] / stage.ratio - q[k + 1]) ** 2
        if hand.squeeze is not None:
            grip = {1.0: p.limb.tight_stiffness, 0.0: p.limb.loose_stiffness}[hand.squeeze]
            v += 0.5 * grip * (col.grip_height * (q[n + 2] - q[n + 1])) ** 2
            v += 0.5 * p.limb.arm_stiffness * (col.grip_height * q[n + 2]) ** 2 if hand.arm else 0.0
        return v

    def kinetic(rate):
        inertias = [p.motor.rotor_inertia + p.gearbox.input_inertia, *(stage.inertia for stage in stages)]
        inertias[-1] += link.crank_inertia
        t = 0.5 * np.dot(inertias, rate[: n + 1] ** 2) + 0.5 * col.inertia * rate[n + 1] ** 2
        if four_bar:
            h = 1e-6
            for (m, a), (_, b) in zip(points(h * rate), points(-h * rate), strict=True):
                t += 0.5 * m * np.sum(((a - b) / (2 * h)) ** 2)
        if hand.squeeze is not None:
            t += 0.5 * p.limb.mass * (col.grip_height * rate[n + 2]) ** 2
        return t

    return n + 2 + (hand.squeeze is not None), potential, kinetic


def hessian(function, n, h):
    zero, unit = function(np.zeros(n)), np.eye(n) * h
    found = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            a, b = unit[i], unit[j]
            found[i, j] = (function(a + b) - function(a - b) - function(b - a) + function(-a - b)) / (4 * h * h)
    assert math.isfinite(zero)
    return found


@pytest.mark.parametrize("hand", [Hand(None), Hand(1.0), Hand(0.0, arm=False)], ids=str)
@pytest.mark.parametrize("name", RIGS)
def test_resonances_are_those_of_energies_written_down_anew(name, hand):
    p = rig(**RIGS[name])
    n, potential, kinetic = energies(p, hand)
    stiffness, mass = hessian(potential, n, 1e-4), hessian(kinetic, n, 1.0)
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    wanted = np.sort(np.sqrt(squares[squares > (2 * math.pi * 0.5) ** 2])) / (2 * math.pi)
    found = plant(p, hand)
    undamped = np.linalg.eigvals(np.linalg.solve(found.mass, found.stiffness)).real
    got = np.sort(np.sqrt(undamped[undamped > (2 * math.pi * 0.5) ** 2])) / (2 * math.pi)
    assert len(wanted) >= n - 2
    assert got == pytest.approx(wanted, rel=1e-5)
    assert np.allclose(found.mass, mass, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize("name", RIGS)
def test_weight_is_the_second_derivative_of_potential_energy(name):
    p = changed(rig(**RIGS[name]), "load_cell.stiffness", 1e3)  # so that weight is not lost in the springs
    n, potential, _ = energies(p, Hand(None))
    k = n - 2
    springs = plant(p, Hand(None)).stiffness - np.pad(weight(p.linkage, p.column), ((k, 0), (k, 0)))
    without = hessian(potential, n, 2e-4) - springs
    assert without[k:, k:] == pytest.approx(weight(p.linkage, p.column), abs=2e-4)


def test_resonances_without_damping_are_what_resonances_says():
    p = changed(rig(), "load_cell.damping_ratio", 0.0)
    for stage in (1, 2):
        p = changed(p, f"gearbox.stage{stage}.damping_ratio", 0.0)
    p = changed(p, "column.viscous_friction", 0.0)
    found = plant(p, Hand(None))
    squares = np.linalg.eigvals(np.linalg.solve(found.mass, found.stiffness)).real
    wanted = np.sort(np.sqrt(squares[squares > 10.0])) / (2 * math.pi)
    assert resonances(p) == pytest.approx(wanted, rel=1e-6)


def test_levers_and_inertia_at_the_motor_are_those_of_the_nameplate():
    for name, values in RIGS.items():
        p = rig(**values)
        ratio = levers(p.linkage).ratio * p.gearbox.ratio
        found = plant(p, Hand(None))
        rigid = [1.0]
        for stage in p.gearbox.in_use:
            rigid.append(rigid[-1] / stage.ratio)
        rigid = np.array([*rigid, 1.0 / ratio])
        assert found.stiffness @ rigid == pytest.approx(0.0, abs=1e-8 * found.stiffness.max() + 5.0), name
        # The nameplate adds the rod's masses up as if all moved across the column's arm, as thesis table 3.3 does.
        assert rigid @ found.mass @ rigid == pytest.approx(p.nameplate.load_inertia, rel=0.05), name


# The sampled side, run with numbers


def brute(p, hand, *, ticks, torque=None, hand_torque=None, start=None):
    """Column angle at every tick: the whole bench as a program with numbers, written from its description.

    ``torque`` is added at the feel model's input, over ticks; ``start`` sets the column and limb off.
    """
    clock, drive, plate, feel = p.rates.clock, p.drive, p.nameplate, p.feel
    body = plant(p, hand)
    n, tick = body.freedoms, clock.tick_s
    # The plant's motion between two ticks, by many small steps of its own (RK4 over the linear equations).
    constant, resistance, inductance = body.motor
    inverse = np.linalg.inv(body.mass)
    a = np.zeros((2 * n + 1, 2 * n + 1))
    a[:n, n : 2 * n] = np.eye(n)
    a[n : 2 * n, :n], a[n : 2 * n, n : 2 * n] = -inverse @ body.stiffness, -inverse @ body.damping
    a[n : 2 * n, -1] = inverse[:, 0] * constant
    a[-1, n], a[-1, -1] = -constant / inductance, -resistance / inductance
    small = 64
    h = tick / small

    def move(x, voltage, pull):
        b = np.zeros(2 * n + 1)
        b[-1] = voltage / inductance
        b[n : 2 * n] += inverse[:, n - 1] * pull
        for _ in range(small):
            k1 = a @ x + b
            k2 = a @ (x + 0.5 * h * k1) + b
            k3 = a @ (x + 0.5 * h * k2) + b
            k4 = a @ (x + h * k3) + b
            x = x + h / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x

    if plate.linkage == "none":
        arm, ratio = plate.arm, plate.gear_ratio
    else:
        arm = plate.arm * math.cos(plate.arm_angle - plate.rod_angle)
        ratio = plate.gear_ratio * arm / (plate.crank * math.cos(plate.crank_angle - plate.rod_angle))
    cell = (1 + p.load_cell.gain_error) * plate.load_cell_gain / (2 * p.load_cell.capacity / 2**p.load_cell.adc_bits)
    smooth = 1 - math.exp(-2 * math.pi * p.load_cell.filter_bandwidth * tick)
    fast = 1 - math.exp(-clock.velocity_s / drive.speed_filter_time) if drive.speed_filter_time else 1.0
    x = np.zeros(2 * n + 1)
    if start is not None:
        x[body.column] = start
        x[body.column + 1 : n] = start
    amplified = before = speed = speed_sum = current_sum = output = last = position_sum = ahead = command = 0.0
    phi, omega, behind = 0.0, 0.0, [0.0, 0.0]
    to_plc, to_drive, volts = [(0.0, 0.0)] * 20, [(0.0,) * 4] * 20, [0.0] * 20
    newest, seen, arrived = (0.0,) * 4, (0.0, 0.0), (0.0,) * 4
    found, since = [], 0
    for k in range(ticks):
        force = body.rod_force @ x[: 2 * n]
        amplified += smooth * (force - amplified)
        encoder = x[0]
        if k % clock.velocity_ticks == 0:
            speed += fast * ((encoder - before) / clock.velocity_s - speed)
            before = encoder
        if k % clock.bus_ticks == 0:
            to_plc = [(encoder, speed), *to_plc[:-1]]
            seen = to_plc[p.plc.feedback_latency]
        if k % clock.plc_ticks == 0:
            measured = arm * cell * amplified - (plate.unbalance * seen[0] / ratio if p.plc.remove_unbalance else 0.0)
            total = measured + (0.0 if torque is None else torque(k))
            if p.plc.outer_loop == "velocity":
                phi = seen[0] / ratio
            # The exact flow by a truncated series.
            c, d, aft, link = feel.stiffness, feel.damping, feel.aft, feel.linkage
            m = np.array([[0.0, 1.0, 0, 0], [-c, -d, 0, 0], [0, 0, 0, 1.0], [0, 0, 0, 0]])
            if feel.bodies == "two":
                m[1] = -link.stiffness, -d - link.damping, link.stiffness, link.damping
                m[3] = link.stiffness, link.damping, -c - link.stiffness, -aft.damping - link.damping
            m[1], m[3] = m[1] / feel.inertia, m[3] / aft.inertia
            drift = np.array([0.0, total / feel.inertia, 0.0, 0.0])
            state = np.array([phi, omega, *behind])
            term, state_new = state.copy(), state.copy()
            for j in range(1, 30):
                term = (m @ term + (drift if j == 1 else 0.0)) * (clock.plc_s / j)
                state_new = state_new + term
            phi, omega, *behind = state_new
            alpha = (m @ state_new + drift)[1]
            newest = ratio * phi, ratio * omega, ratio * alpha, (-measured / ratio if drive.feed_forward_pilot else 0.0)
        if k % clock.bus_ticks == 0:
            to_drive = [newest, *to_drive[:-1]]
            arrived = to_drive[p.plc.command_latency]
        if k % clock.position_ticks == 0:
            since, last = 0, output
            if p.plc.outer_loop == "velocity":
                output = arrived[1]
            else:
                error = arrived[0] - encoder
                gain = 2 * math.pi * drive.position_bandwidth
                if drive.position_integral_time:
                    position_sum += gain * error * clock.position_s / drive.position_integral_time
                output = gain * error + position_sum + (arrived[1] if drive.feed_forward_velocity else 0.0)
            ahead = arrived[3] + (plate.load_inertia * arrived[2] if drive.feed_forward_inertia else 0.0)
        if k % clock.velocity_ticks == 0:
            since += 1
            wanted = last + (output - last) * since / (clock.position_ticks // clock.velocity_ticks)
            gain = 2 * math.pi * drive.velocity_bandwidth * plate.load_inertia
            speed_sum += gain * (wanted - speed) * clock.velocity_s / drive.velocity_integral_time
            command = gain * (wanted - speed) + speed_sum + ahead
        wc = 2 * math.pi * drive.current_bandwidth
        error = command / plate.torque_constant - x[-1]
        current_sum += wc * plate.resistance * error * tick
        volts = [wc * plate.inductance * error + current_sum + plate.torque_constant * speed, *volts[:-1]]
        found.append(x[body.column])
        x = move(x, volts[drive.voltage_latency], 0.0 if hand_torque is None else hand_torque(k))
    return np.array(found)


def ran(p, hand, ticks, torque=None, hand_torque=None):
    """The same by the lifted map."""
    lifted = LinearBench(p, hand).lifted
    x = np.zeros(len(lifted.transition))
    out = []
    for first in range(0, ticks, lifted.ticks):
        u = {
            name: np.array([(f(first + at) if f else 0.0) for at, _ in lifted.inputs[name]])
            for name, f in (("torque", torque), ("hand", hand_torque))
        }
        out += [c @ x + sum(d[name] @ u[name] for name in u) for _, c, d in lifted.signals["column_angle"]]
        x = lifted.transition @ x + sum(
            b * value for name in u for (_, b), value in zip(lifted.inputs[name], u[name], strict=True)
        )
    return np.array(out[:ticks])


RATES = {
    "thesis": {},
    "plc_1kHz_drive_16kHz": {"current_cycle": 62.5e-6, "velocity_cycle": 250e-6, "position_cycle": 500e-6,
                             "bus_cycle": 500e-6, "plc_cycle": 1e-3},
    "plc_fast_position_slow": {"current_cycle": 50e-6, "velocity_cycle": 100e-6, "position_cycle": 400e-6,
                               "bus_cycle": 100e-6, "plc_cycle": 200e-6},
    "no_common_multiple_at_once": {"current_cycle": 50e-6, "velocity_cycle": 150e-6, "position_cycle": 300e-6,
                                   "bus_cycle": 250e-6, "plc_cycle": 500e-6},
    "one_for_all": {name: 100e-6 for name in
                    ("current_cycle", "velocity_cycle", "position_cycle", "bus_cycle", "plc_cycle")},
}  # fmt: skip


def at_rates(p, name):
    return p.model_copy(update={"rates": type(p.rates)(**RATES[name])}) if RATES[name] else p


@pytest.mark.parametrize(
    ("name", "values", "rates", "hand"),
    [
        ("thesis", {}, "thesis", Hand(1.0)),
        ("thesis", {}, "plc_1kHz_drive_16kHz", Hand(1.0)),
        ("direct_drive", {}, "plc_1kHz_drive_16kHz", Hand(None)),
        ("belt", {"drive__feed_forward_velocity": True, "drive__feed_forward_inertia": True},
         "plc_fast_position_slow", Hand(0.0, arm=False)),
        ("skew", {"drive__feed_forward_pilot": True, "drive__position_integral_time": 0.1, "plc__feedback_latency": 2,
                  "plc__command_latency": 3, "drive__voltage_latency": 2}, "no_common_multiple_at_once", Hand(0.0)),
        ("no_linkage", {"plc__outer_loop": "velocity", "load_cell__gain_error": 0.2}, "plc_1kHz_drive_16kHz",
         Hand(None)),
        ("thesis", {"feel__bodies": "two", "drive__feed_forward_inertia": True}, "plc_1kHz_drive_16kHz", Hand(1.0)),
        ("one_stage", {"feel__bodies": "two", "plc__outer_loop": "velocity", "feel__linkage__stiffness": 3e4},
         "plc_fast_position_slow", Hand(0.0)),
        ("three_stages", {"plc__command_latency": 0, "plc__feedback_latency": 0, "drive__voltage_latency": 0},
         "one_for_all", Hand(1.0)),
    ],
)  # fmt: skip
def test_lifted_map_is_the_bench_run_with_numbers(name, values, rates, hand):
    p = at_rates(rig(**RIGS[name]), rates)
    for key, value in values.items():
        p = changed(p, key.replace("__", "."), value)
    p = changed(p, "feel.damping", 6.0)
    count = round(0.03 / p.rates.clock.tick_s)
    random = np.random.default_rng(3).standard_normal((2, count))

    def torque(k):
        return float(random[0, k - k % p.rates.clock.plc_ticks])

    def pull(k):
        return float(random[1, k])

    one, other = brute(p, hand, ticks=count, torque=torque, hand_torque=pull), ran(p, hand, count, torque, pull)
    assert np.abs(one).max() > 1e-6
    assert np.abs(one - other).max() < 1e-7 * np.abs(one).max()


@pytest.mark.parametrize("rates", RATES)
def test_growth_is_that_of_the_bench_run_with_numbers(rates):
    p = changed(at_rates(rig(), rates), "feel.inertia", 0.12)
    bench = LinearBench(p, Hand(1.0))
    lifted, growth = bench.lifted, bench.growth
    # The map itself, run for long with numbers: amplitude and zero crossings of what is left in the end.
    x, seen = np.random.default_rng(0).standard_normal(len(lifted.transition)), []
    for _ in range(round(1.2 / lifted.period)):
        seen += [c @ x for _, c, _ in lifted.signals["column_velocity"]]
        x = lifted.transition @ x
    late = np.array(seen[len(seen) // 2 :])
    crossings = np.flatnonzero((late[:-1] < 0) & (late[1:] >= 0))
    frequency = (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * lifted.tick)
    assert growth.real > 0.0
    assert frequency == pytest.approx(growth.imag / (2 * math.pi), rel=0.01)
    first, last = (np.abs(part).max() for part in (late[: len(late) // 8], late[-len(late) // 8 :]))
    over = 7 / 8 * len(late) * lifted.tick
    assert math.log(last / first) / over == pytest.approx(growth.real, rel=0.15)


def test_frequency_of_an_oscillation_is_told_beyond_half_the_rate_of_the_period():
    slow = type(Parameters().rates)(
        current_cycle=50e-6, velocity_cycle=100e-6, position_cycle=100e-6, bus_cycle=100e-6, plc_cycle=3.2e-3
    )
    p = changed(rig(**RIGS["direct_drive"]).model_copy(update={"rates": slow}), "drive.velocity_bandwidth", 1500.0)
    p = changed(p, "drive.speed_filter_time", 0.001)
    growth = LinearBench(p, Hand(None)).growth
    assert growth.real > 0.0
    assert growth.imag / (2 * math.pi) > 0.5 / 3.2e-3
    short = p.model_copy(update={"rates": p.rates.model_copy(update={"plc_cycle": 100e-6})})
    assert growth.imag == pytest.approx(LinearBench(short, Hand(None)).growth.imag, rel=0.03)


# Nyquist, also with several PLC cycles in a period


@pytest.mark.parametrize("rates", ["thesis", "plc_1kHz_drive_16kHz", "plc_fast_position_slow",
                                   "no_common_multiple_at_once"])  # fmt: skip
@pytest.mark.parametrize("inertia", [0.05, 0.2, 2.0])
def test_encirclements_are_the_unstable_eigenvalues(rates, inertia):
    p = changed(at_rates(rig(), rates), "feel.inertia", inertia)
    opened, closed = (LinearBench(p, Hand(1.0), closed=c) for c in (False, True))
    unstable = [int(np.sum(np.abs(b.lifted.eigenvalues) > 1.0)) for b in (opened, closed)]
    assert unstable[0] == 0
    assert closed.encirclements() == unstable[1]
    assert predict(Setup(p)).encirclements == unstable[1]


def test_winding_of_closed_forms():
    def first_order(pole, gain):
        return np.array([[pole]]), np.array([[1.0]]), np.array([[gain]]), np.array([[0.0]])

    # 1 + g/(z − p): zero at p − g
    assert winding(*first_order(0.5, 0.2)) == 0
    assert winding(*first_order(0.5, 2.0)) == -1  # zero outside: one clockwise turn
    assert winding(*first_order(2.0, 0.5)) == 0  # pole and zero outside
    assert winding(*first_order(2.0, 1.5)) == 1  # pole outside, zero inside


# The controller knows its nameplate, the plant its truth


def test_nameplate_and_plant_are_two_sides():
    p = rig()
    base = LinearBench(p, Hand(None))
    heavier = changed(p, "motor.rotor_inertia", 2.0 * p.motor.rotor_inertia)
    assert heavier.nameplate == p.nameplate
    believed = changed(p, "nameplate.load_inertia", 2.0 * p.nameplate.load_inertia)
    assert not np.allclose(plant(heavier, Hand(None)).mass, base.plant.mass)
    assert np.array_equal(plant(believed, Hand(None)).mass, base.plant.mass)
    growths = [LinearBench(q, Hand(None)).growth for q in (p, heavier, believed)]
    assert len(set(growths)) == 3
    # A cell that shows 25 % more is a column 25 % heavier, as far as the loop is concerned.
    louder = changed(changed(p, "load_cell.gain_error", 0.25), "feel.inertia", 1.25 * 0.3)
    unbalance = 1.25 * p.nameplate.unbalance
    for key, value in (("feel.damping", 1.875), ("feel.stiffness", 43.75), ("nameplate.unbalance", unbalance)):
        louder = changed(louder, key, value)
    assert LinearBench(louder, Hand(None)).growth == pytest.approx(base.growth, rel=1e-6)


def test_what_the_bench_is_called_changes_nothing():
    """A rig in other units of gearing is the same rig: inertia and stiffness referred through a stage of ratio r."""
    r = 4.0
    p = rig(gearbox__stages=1, gearbox__stage1__ratio=r, linkage__kind="none")
    slow = rig(
        gearbox__stages=0, linkage__kind="none",
        motor__rotor_inertia=p.motor.rotor_inertia * r**2 - 0.0, gearbox__input_inertia=p.gearbox.input_inertia * r**2,
    )  # fmt: skip
    stiff = changed(p, "gearbox.stage1.stiffness", 1e9)
    stiff = changed(stiff, "gearbox.stage1.inertia", 1e-9)
    low = resonances(stiff)[0]
    assert low == pytest.approx(resonances(slow)[0], rel=1e-3)


# The feel model's elements

CALM = {
    "friction": 0.0, "aft_limit": {"damping": 0.0}, "forward_limit": {"damping": 0.0},
    "aft": {"friction": 0.0, "damping": 2.0}, "disturbance": {"torque": 0.0}, "neutral": 0.03,
}  # fmt: skip
EVERYTHING = {
    **CALM, "q_feel": {"gradient": 0.01}, "centering": {"stiffness": 60.0, "breakout": 2.0},
    "flight": {"dynamic_pressure": 2000.0, "airspeed": 60.0, "load_factor": 1.5},
    "surface": {"area": 1.0, "chord": 0.3, "hinge_deflection": -0.05, "hinge_rate": -2.0, "gearing": 1.4, "boost": 0.3},
    "detents": {"place": (0.01,), "width": (0.1,), "torque": (0.5,)}, "unbalance": {"gradient": 2.0, "level": 0.03},
    "autopilot": {"engaged": True, "stiffness": 100.0, "damping": 4.0, "clutch": 20.0, "reference": 0.03},
    "hydraulics": {"pressure": 0.6, "off_damping": 1.0, "feel_share": 0.5},
    "linkage": {"damping": 3.0},
}  # fmt: skip


@pytest.mark.parametrize("bodies", ["one", "two"])
@pytest.mark.parametrize(
    "feel",
    [
        CALM, EVERYTHING, {**CALM, "trim": {"released": True}, "linkage": {"connected": False}},
        {**CALM, "jam": {"of": "aft"}}, {**CALM, "linkage": {"pretension": 5.0, "override": 9.0}},
        {**EVERYTHING, "autopilot": {"engaged": True, "clutch": 0.0}},
    ],
    ids=["plain", "everything", "let go", "jammed", "cables", "no clutch"],
)
def test_answer_is_the_compiled_feel_model_s_for_small_motion(feel, bodies):
    """What a small torque does: the difference between the model with and without it, both about the trim."""
    feel = {**feel, "bodies": bodies}
    moved, still = (Model(feel, 0.03, 0.03) for _ in range(2))
    laws = Laws(moved.feel)
    if bodies == "two" and "jam" not in feel:
        for model in (moved, still):
            model.state.aft_angle = balanced(laws, 0.03) + 1e-8
    hold = laws.column(0.03) + laws.link(0.03 - float(still.state.aft_angle))
    answer = _answer(moved.feel, 4e-4)
    x, push = np.zeros(len(answer.response)), 1e-4
    expected, found = [], []
    for _ in range(400):
        x = answer.transition @ x + answer.response * push
        moved.step(hold + push)
        still.step(hold)
        expected.append([x[0], x[1], answer.acceleration @ x + answer.of_torque * push])
        found.append([getattr(moved.state, q) - getattr(still.state, q) for q in ("angle", "velocity", "acceleration")])
    largest = np.abs(expected).max(axis=0)
    jammed = bodies == "one" and "jam" in feel
    assert np.all((largest > 0.0) == (not jammed))
    assert np.all(np.abs(np.array(found) - expected).max(axis=0) <= 1e-5 * largest)


def test_a_linkage_with_backlash_is_taken_as_in_contact():
    def growth(backlash):
        p = changed(changed(rig(), "feel.bodies", "two"), "feel.linkage.backlash", backlash)
        return LinearBench(changed(p, "feel.inertia", 0.2), Hand(1.0)).growth

    assert growth(0.02) == growth(0.0)


def test_with_two_bodies_only_the_column_s_counts_against_the_limb_unless_the_linkage_is_stiff():
    """The onset lies at 55 Hz: a cable swings at 12 Hz and lets the aft body be, a stiff rod takes it along."""
    two = changed(rig(), "feel.bodies", "two")
    one, soft = least_inertia(rig(), [Hand(1.0)])[0], least_inertia(two, [Hand(1.0)])[0]
    assert soft == pytest.approx(one, rel=0.03)
    rod = changed(changed(two, "feel.aft.inertia", 0.1), "feel.linkage.stiffness", 1e6)
    rod = changed(rod, "feel.linkage.damping", 100.0)
    assert least_inertia(rod, [Hand(1.0)])[0] + 0.1 == pytest.approx(one, rel=0.06)


# The least inertia


def test_least_inertia_is_that_of_the_worst_grip():
    p = rig()
    least, which = least_inertia(p)
    assert which in GRIPS
    for hand in GRIPS:
        assert LinearBench(changed(p, "feel.inertia", 1.01 * least), hand).stable, hand
    assert not LinearBench(changed(p, "feel.inertia", 0.99 * least), which).stable
    only, _ = least_inertia(p, [Hand(1.0)])
    assert only == pytest.approx(0.2170, abs=2e-4)
    assert least > only


def test_least_inertia_says_when_all_or_nothing_is_stable():
    calm, _ = least_inertia(changed(rig(), "feel.damping", 200.0), [Hand(1.0)], low=0.2, high=2.0)
    assert calm == 0.0
    late = changed(changed(rig(), "drive.feed_forward_pilot", True), "plc.command_latency", 8)
    worst, which = least_inertia(late, [Hand(None), Hand(1.0)])
    assert math.isinf(worst) and which == Hand(1.0)


def test_compensation_and_least_inertia_work_on_every_rig():
    for name, values in RIGS.items():
        p = rig(**values)
        assert len(resonances(p, Hand())) >= len(p.gearbox.in_use) + 1, name
        bench = LinearBench(p, Hand(1.0), Compensation(0.3 * forward_inertia(p, Hand(1.0)), 0.002))
        assert math.isfinite(bench.growth.real), name
        assert least_inertia(p, GRIPS[:2])[0] > 0.0, name


def test_ideal_takes_away_what_is_not_linear_on_every_stage():
    p = ideal(rig(**RIGS["worm"]))
    for stage in p.gearbox.in_use:
        assert (stage.drag, stage.efficiency, stage.backdrive_efficiency, stage.backlash) == (0.0, 1.0, 1.0, 0.0)
    assert p.motor.cogging_amplitude == 0.0


def test_changed_checks_the_bench_as_a_whole():
    with pytest.raises(InputError, match=r"gearbox\.stage4"):
        changed(Parameters(), "gearbox.stage4.drag", 0.1)
    with pytest.raises(InputError, match=r'gearbox: 0.1 is not valid; it is a section'):
        changed(Parameters(), "gearbox", 0.1)
    with pytest.raises(InputError, match="linkage"):
        changed(Parameters(), "linkage.rod_angle", 1.5)
    with pytest.raises(InputError, match="velocity_cycle must be a multiple"):
        changed(Parameters(), "rates.current_cycle", 60e-6)
