"""Sensors: resolution, range, noise, filter and faults of all that control may know."""

import math
from collections.abc import Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cls_bench.bench import Bench
from cls_bench.parameters import DEG, GRAVITY, Parameters
from cls_bench.plant import mechanism, sensors
from cls_bench.verification.subject import Specimen
from tests.running import Run, off, parameters, run

P = Parameters()
TICK = 5e-5
NO_NOISE = {"load_cell.noise": 0.0, "encoder.noise": 0.0, "potentiometer.noise": 0.0}
QUIET = parameters(NO_NOISE)


def quiet(values: Mapping[str, Any] = MappingProxyType({}), **cell: Any) -> Parameters:
    return parameters({**NO_NOISE, **values, **{f"load_cell.{name}": value for name, value in cell.items()}})


class Amplifier:
    """The load cell and its amplifier alone, under a force that is given."""

    def __init__(self, p: Parameters):
        self.truth = Specimen(p).truth
        mechanism.configure(self.truth.mechanism, p)
        self.count = float(self.truth.mechanism.count)

    def weigh(self, force: float, noise: float = 0.0, spike: float = 1.0) -> float:
        """Counts of one sample."""
        t = self.truth
        return sensors.weigh(t.parameters.load_cell, t.mechanism, t.body, force, noise, spike)

    def settled(self, force: float) -> float:
        """Counts after a constant force [N] has passed the filter."""
        return [self.weigh(force) for _ in range(50)][-1]


def test_load_cell_range_is_50_kg_both_ways_in_24_bit():
    cell = Amplifier(QUIET)
    assert cell.count == pytest.approx(2 * 50 * GRAVITY / 2**24)
    assert cell.settled(100.0) * cell.count == pytest.approx(100.0, abs=cell.count)
    assert cell.settled(400.0) == -cell.settled(-400.0)
    assert cell.settled(5000.0) == 2**23 - 1
    assert cell.settled(-5000.0) == -(2**23)


def test_load_cell_resolves_one_count():
    coarse = Amplifier(quiet(adc_bits=12))
    assert coarse.count == pytest.approx(0.239, rel=0.01)
    assert coarse.settled(10.4 * coarse.count) == 10
    assert coarse.settled(10.6 * coarse.count) == 11


def test_load_cell_noise_is_that_of_16_4_effective_bits_at_100_hz():
    rng, cell = np.random.default_rng(1), Amplifier(P)
    force = np.array([cell.weigh(20.0, n) for n in rng.standard_normal(40_000)])[200:] * cell.count
    assert force.mean() == pytest.approx(20.0, abs=0.01)
    assert force.std() == pytest.approx(0.16, rel=0.03)
    at_100_hz = force[: len(force) // 200 * 200].reshape(-1, 200).mean(axis=1)
    assert math.log2(981 / at_100_hz.std()) == pytest.approx(16.4, abs=0.2)


@pytest.mark.parametrize("corner", [500.0, 5000.0])
def test_load_cell_filter_is_a_low_pass_of_first_order(corner):
    cell = Amplifier(quiet(filter_bandwidth=corner))
    for k in range(1, 21):
        exact = 100.0 * (1 - math.exp(-2 * math.pi * corner * k * TICK))
        assert cell.weigh(100.0) * cell.count == pytest.approx(exact, abs=1e-3)


def sampled(p: Parameters, *, motor: float = 0.0, column: float = 0.0, noise: float = 0.0) -> Any:
    """One sample of every sensor with the shafts at these angles [rad], and every random number ``noise``."""
    rig = Specimen(p)
    rig.place(motor=motor, column=column)
    samples = np.zeros(1, sensors.SAMPLES).view(np.recarray)[0]
    drawn = sensors.Noise(*[np.full((1, 1), noise)] * len(sensors.Noise._fields))
    sensors.sample(rig.plant, rig.truth, drawn, 0, 0, samples)
    return SimpleNamespace(**{name: float(samples[name]) for name in sensors.SAMPLES.names})


@pytest.mark.parametrize(("interpolation", "steps"), [(1, 4096), (64, 4096 * 64)])
def test_encoder_counts_4096_a_revolution_interpolated(interpolation, steps):
    p = quiet({"encoder.interpolation": interpolation})
    step = 2 * math.pi / steps
    assert sampled(p, motor=10.4 * step).encoder == pytest.approx(10 * step)
    assert sampled(p, motor=10.6 * step).encoder == pytest.approx(11 * step)
    assert sampled(p, motor=-1000.0).encoder == pytest.approx(-1000.0, abs=step)  # many revolutions


def test_encoder_noise_comes_before_the_quantiser():
    p = parameters({"encoder.interpolation": 65536, "encoder.noise": 1e-4})
    assert sampled(p, motor=1.0, noise=2.0).encoder == pytest.approx(1.0002, abs=1e-7)


def test_potentiometer_has_16_bit_over_30_degrees_and_saturates():
    step = 2 * 30 * DEG / 2**16
    assert sampled(QUIET, column=7.4 * step).potentiometer == pytest.approx(7 * step)
    assert sampled(QUIET, column=40 * DEG).potentiometer == pytest.approx(30 * DEG)
    assert sampled(QUIET, column=-40 * DEG).potentiometer == pytest.approx(-30 * DEG)


@pytest.mark.parametrize(
    ("degrees", "forward", "aft"), [(0, 1, 1), (20.9, 1, 1), (21.1, 0, 1), (-20.9, 1, 1), (-21.1, 1, 0)]
)
def test_limit_switches_open_beyond_the_travel(degrees, forward, aft):
    """Normally closed: open beyond 21°, so a broken wire reads like a reached limit."""
    samples = sampled(QUIET, column=degrees * DEG)
    assert (samples.switch_forward, samples.switch_aft) == (forward, aft)


def test_the_motors_current_is_sampled_as_it_is():
    rig = Specimen(QUIET)
    rig.truth.body.current = 3.21
    samples = np.zeros(1, sensors.SAMPLES).view(np.recarray)[0]
    none = sensors.Noise(*[np.zeros((1, 1))] * len(sensors.Noise._fields))
    sensors.sample(rig.plant, rig.truth, none, 0, 0, samples)
    assert float(samples.current) == 3.21


# --- what may be wrong with the load cell ---


def test_a_gain_error_shows_more_and_an_offset_shifts():
    cell = Amplifier(quiet(gain_error=0.05, offset=-3.0))
    for force in (-200.0, 0.0, 80.0):
        assert cell.settled(force) * cell.count == pytest.approx(1.05 * force - 3.0, abs=cell.count)


def test_a_drift_moves_the_zero_at_its_rate():
    """By what it has moved, not by what the load is; and it stays where it is when the drift ends."""
    p = quiet(drift=20.0)
    cell = Amplifier(p)
    shown = [cell.weigh(50.0) * cell.count for _ in range(2001)]
    assert shown[2000] - shown[1000] == pytest.approx(20.0 * 1000 * TICK, abs=2 * cell.count)
    cell.truth.parameters.load_cell.drift = 0.0
    moved = float(cell.truth.body.zero)
    assert moved == pytest.approx(20.0 * 2001 * TICK)
    assert cell.settled(0.0) * cell.count == pytest.approx(moved, abs=cell.count)


def test_creep_comes_with_its_time_constant_and_goes_with_it():
    cell = Amplifier(quiet(creep=0.02, creep_time=0.05))
    shown = np.array([cell.weigh(100.0) for _ in range(4000)]) * cell.count
    time = (np.arange(4000) + 1) * TICK
    late = time > 2e-3  # the filter has settled
    np.testing.assert_allclose(shown[late], 100.0 + 2.0 * -np.expm1(-time[late] / 0.05), atol=2e-3)
    left = np.array([cell.weigh(0.0) for _ in range(4000)]) * cell.count
    np.testing.assert_allclose(left[late], shown[-1] - 100.0 - 2.0 * -np.expm1(-time[late] / 0.05) + 0.0, atol=0.05)
    assert left[-1] == pytest.approx(2.0 * math.exp(-0.2 / 0.05), rel=0.1)


@pytest.mark.parametrize(("drawn", "sign"), [(0.0, 1), (0.024, 1), (0.026, -1), (0.049, -1), (0.051, 0), (0.9, 0)])
def test_a_spike_is_one_sample_high_of_either_sign(drawn, sign):
    """A thousand in a second are a chance of 0.05 in a tick; the filter rounds it, and the next sample has less."""
    cell = Amplifier(quiet(spike=40.0, spike_rate=1000.0, filter_bandwidth=2000.0))
    blend = 1 - math.exp(-2 * math.pi * 2000.0 * TICK)
    assert cell.weigh(0.0, spike=drawn) * cell.count == pytest.approx(sign * 40.0 * blend, abs=cell.count)
    assert cell.weigh(0.0) * cell.count == pytest.approx(sign * 40.0 * blend * (1 - blend), abs=cell.count)


@pytest.mark.parametrize(
    ("wire", "counts"), [("whole", 200.0), ("supply_broken", 0.0), ("signal_broken", 50 * GRAVITY)]
)
def test_a_broken_wire(wire, counts):
    cell = Amplifier(quiet(wire=wire))
    assert cell.settled(200.0) * cell.count == pytest.approx(counts, abs=2e-4)


@pytest.mark.parametrize("bits", [8, 24, 32])
def test_saturated_is_at_either_end_of_the_converter(bits):
    p = quiet(adc_bits=bits)
    cell = Amplifier(p)
    record = cell.truth.parameters.load_cell
    for force, expected in ((0.0, False), (0.9 * 50 * GRAVITY, False), (600.0, True), (-600.0, True)):
        assert sensors.is_saturated(record, cell.settled(force)) is expected
    assert sensors.is_saturated(record, Amplifier(quiet(adc_bits=bits, wire="signal_broken")).settled(0.0))


# --- on the bench ---

SWAY = 'hand = [{at = 0.0, kind = "sine", amplitude_deg = 6.0, frequency = 3.0, fade = 0.05}]\n'
RESTING = 'drive.power = "off"\n'


def changed_at_half(key: str, value: str) -> str:
    return f"changes = [{{at = 0.1, parameters = {{\"{key}\" = {value}}}}}]\n"


def counts_to_newtons(ran: Run) -> Any:
    return ran["/load_cell.counts"] * 2 * 50 * GRAVITY / 2**24


@pytest.mark.parametrize(
    ("key", "value", "effect"),
    [("offset", "30.0", lambda f: f + 30.0), ("gain_error", "0.2", lambda f: 1.2 * f),
     ("wire", '"supply_broken"', lambda f: 0.0 * f)],
)  # fmt: skip
def test_a_fault_of_the_load_cell_comes_in_mid_run(key, value, effect):
    """The drive off, so that nobody acts on it: the counts are what the same run without the fault shows, altered."""
    fault = run(RESTING + SWAY + changed_at_half(f"load_cell.{key}", value), set=["load_cell.noise=0.0"])
    sound = run(RESTING + SWAY, set=["load_cell.noise=0.0"])
    assert fault.error is None
    np.testing.assert_array_equal(fault["/load_cell.force"], sound["/load_cell.force"])
    before, after = slice(0, 2000), slice(2020, None)
    np.testing.assert_array_equal(fault["/load_cell.counts"][before], sound["/load_cell.counts"][before])
    np.testing.assert_allclose(counts_to_newtons(fault)[after], effect(counts_to_newtons(sound)[after]), atol=1e-3)


def test_drift_on_the_bench_pushes_the_control_away():
    """Case of a warming cell: no hand, and the model gives way to a force that is not there; the column follows."""
    ran = run(set=["load_cell.drift=40.0", "feel.friction=0.0"], duration=1.0)
    assert ran.error is None
    shown = counts_to_newtons(ran)[-200:].mean() - ran["/load_cell.force"][-200:].mean()
    assert shown == pytest.approx(40.0, rel=0.02)
    assert abs(ran["/column.angle"][-1]) > 5 * DEG


def test_spikes_come_at_their_rate_and_are_seen_in_the_counts_alone():
    set_ = ["load_cell.noise=0.0", "load_cell.spike=50.0", "load_cell.spike_rate=200.0"]
    ran = run(RESTING, set=set_, duration=1.0)
    sound = run(RESTING, set=set_[:1], duration=1.0)
    np.testing.assert_array_equal(ran["/load_cell.force"], sound["/load_cell.force"])
    off = counts_to_newtons(ran) - counts_to_newtons(sound)
    decay = math.exp(-2 * math.pi * 5000.0 * TICK)
    spikes = (off - decay * np.append(0.0, off[:-1])) / (1 - decay)  # before the filter
    came = np.abs(spikes) > 1.0
    np.testing.assert_allclose(np.abs(spikes[came]), 50.0, atol=1e-3)
    assert came.sum() == pytest.approx(200, abs=5 * math.sqrt(200))
    assert (spikes > 1.0).sum() == pytest.approx(100, abs=50)


def test_a_slipped_encoder_is_off_by_that_angle():
    slipped = run(RESTING + changed_at_half("encoder.slip", "0.3"), set=["encoder.noise=0.0"])
    moved = slipped.between("/drive.position", 0.11, 0.2) - slipped.between("/drive.position", 0.0, 0.09).mean()
    assert moved == pytest.approx(0.3, abs=3e-3)
    assert np.ptp(slipped["/column.angle"]) < 0.1 * DEG  # nothing moved


def test_a_lost_frame_repeats_the_one_before():
    """Where all are lost the drive keeps the command it had, until the PLC notices that nothing follows."""
    lossy = run(SWAY, set=["plc.frame_loss=0.5", "feel.friction=0.0"])
    sound = run(SWAY, set=["feel.friction=0.0"])
    assert lossy.error is None

    def repeats(ran: Run) -> float:
        """Share of the bus cycles in which the drive's set position stays to the last digit."""
        commands = ran["/drive.set_position"][::2]  # a row every 200 µs, a frame every 400
        return float(np.mean(np.diff(commands[50:]) == 0.0))

    assert repeats(sound) < 0.02
    assert repeats(lossy) == pytest.approx(0.5, abs=0.1)


# --- saturation ---

HARD = 'hand = [{at = 0.0, kind = "ramp", to_N = 400.0, over = 0.1}]\nsqueeze = [{at = 0.0, value = 1.0}]\n'


def test_a_load_cell_beyond_its_range_says_so():
    """400 N at the grip are 690 N in the rod: the counts stop at full scale, and the log has the event and how far."""
    ran = run(HARD, set=["feel.stiffness=5000.0", "feel.inertia=5.0", "feel.damping=50.0"], duration=0.3)
    force, counts = ran["/load_cell.force"], ran["/load_cell.counts"]
    assert np.abs(force).max() > 50 * GRAVITY
    assert np.abs(counts).max() in (2**23 - 1, 2**23)
    full = (counts >= 2**23 - 1) | (counts <= -(2**23))
    begins, over = (event for event in ran.events if event.source == "load cell")
    peak = np.abs(force).max()
    assert begins.level == "warning"
    assert 0 <= begins.tick - np.argmax(full) <= ran.bench.clock.plc_ticks
    assert begins.message == f"saturated: {peak:.4g} N on a range of 490.3 N"
    known = np.count_nonzero(full[: -ran.bench.clock.plc_ticks + 1])  # up to the last row of /limits
    assert over.message.startswith(f"saturated for {known * TICK:.4g} s since")
    share = ran["/limits.load_cell"]
    assert share.max() == 1.0 and share[0] == 0.0
    assert share.sum() * ran.bench.clock.plc_ticks == pytest.approx(known)
    assert not [event for event in run(SWAY).events if event.source == "load cell"]


def test_a_faulty_cell_says_what_it_shows_and_not_what_is_there():
    """A hand at rest on a cell whose zero has gone far off: full scale, by the 600 N it shows."""
    ran = run(RESTING + changed_at_half("load_cell.offset", "600.0"), set=["load_cell.noise=0.0"])
    begins, over = (event for event in ran.events if event.source == "load cell")
    assert np.abs(ran["/load_cell.force"]).max() < 5.0
    told = begins.message.removeprefix("saturated: ").removesuffix(" N on a range of 490.3 N")
    assert float(told) == pytest.approx(600.0, abs=5.0)
    assert over.message.endswith(f"at most {told} N")


# --- one random stream each ---


def test_noise_is_seeded():
    first, same, other = (run(RESTING, seed=seed) for seed in (3, 3, 4))
    assert first.same_samples(same)
    assert not np.array_equal(first["/load_cell.counts"], other["/load_cell.counts"])


SOURCES = {
    "encoder": ("encoder.noise=1e-3", "/drive.position"),
    "load_cell": ("load_cell.noise=5.0", "/load_cell.counts"),
    "potentiometer": ("potentiometer.noise=1e-2", "/column.potentiometer"),
    "spike": ("load_cell.spike_rate=2000.0", "/load_cell.counts"),
    "frames": ("plc.frame_loss=0.5", "/load_cell.torque"),
}


@pytest.mark.parametrize("source", SOURCES)
def test_more_noise_of_one_source_leaves_the_others_to_the_last_bit(source):
    """The drive off, so that nothing but the sensor itself sees its noise."""
    key, noisy = SOURCES[source]
    surface = "/surface.deflection", "/surface.velocity", "/surface.feel_torque"
    more = run(RESTING + SWAY, set=[key, "load_cell.spike=10.0"])
    less = run(RESTING + SWAY, set=["load_cell.spike=10.0"])
    follow = {"/drive.position": {"/drive.velocity", "/drive.set_position", "/drive.set_velocity", "/load_cell.torque",
                                  "/feel.angle", "/feel.velocity", "/feel.torque", *surface},
              "/load_cell.counts": {"/load_cell.torque", "/feel.torque"},
              "/column.potentiometer": set(),  # nobody uses it
              "/load_cell.torque": {"/feel.angle", "/feel.velocity", "/feel.torque", "/limits.bus",
                                    *surface}}  # fmt: skip
    differ = {name for name in more.signals if not np.array_equal(more[name], less[name])}
    assert noisy in differ
    assert differ <= {noisy} | follow[noisy]


def correlation(one: Any, other: Any) -> float:
    """Between two noises, once what is slow is taken away."""
    return float(np.corrcoef(np.diff(one), np.diff(other))[0, 1])


def test_no_source_is_another_ones_noise_again():
    """Two sensors of an axis, and the same sensor of two axes, have nothing to do with each other."""
    ran = run(RESTING, duration=1.0, set=["encoder.noise=1e-3"])
    assert abs(correlation(ran["/drive.position"], ran["/load_cell.counts"][::4])) < 5 / math.sqrt(5000)
    bench = Bench({"pitch": P, "roll": P}, seed=3)
    bench.start(power=False)
    block = bench.advance([off(4000), off(4000)])
    pitch, roll = (block[f"/{axis}/load_cell.counts"] for axis in ("pitch", "roll"))
    assert pitch.std() == pytest.approx(roll.std(), rel=0.1)
    assert abs(correlation(pitch, roll)) < 5 / math.sqrt(4000)


def test_load_cell_carries_what_the_hand_pushes():
    """Held at rest by the drive, 40 N at the grip: 40 N · 0.300 / 0.175 in the rod, tension positive for a push."""
    ran = run(
        'hand = [{at = 0.0, kind = "ramp", to_N = 40.0, over = 0.5}]', duration=1.5, seed=3,
        set=["feel.stiffness=500.0", "feel.damping=10.0", "feel.friction=0.0"],
    )  # fmt: skip
    angle = ran.between("/column.angle", 1.4, 1.5).mean()
    assert 0.0 < angle < 2 * DEG
    hand = ran.between("/pilot.hand_force", 1.4, 1.5).mean()
    assert hand == pytest.approx(40.0, rel=0.01)
    friction = P.column.coulomb_friction / P.linkage.arm
    expected = hand * 0.300 / 0.175
    assert ran.between("/load_cell.force", 1.4, 1.5).mean() == pytest.approx(expected, abs=friction + 0.2)
    assert ran.between("/load_cell.torque", 1.4, 1.5).mean() == pytest.approx(hand * 0.300, abs=0.06)
