"""The bench as a stepper: start, advance, change, reset; after a reset it is as if made anew, without being made."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cls_bench import tick
from cls_bench.bench import Bench, DivergedError
from cls_bench.compiled import JIT
from cls_bench.control.outer_loop import Command
from cls_bench.drivers import timed
from cls_bench.errors import InputError
from cls_bench.hand import HandSamples
from cls_bench.parameters import Parameters
from cls_bench.plant import model as plant_model
from cls_bench.rigs import find_rig
from cls_bench.scenario import parse_scenario
from cls_bench.sweep.runs import ScenarioAt
from tests.running import advanced, collected, hold, off, parameters, swaying

FAULTY = {"load_cell.spike_rate": 300.0, "load_cell.spike": 5.0, "plc.frame_loss": 0.1, "load_cell.drift": 0.5}


class Still:
    """An outer loop that asks for neutral."""

    def step(self, inputs):
        return Command(0.0)


class Fails:
    def step(self, inputs):
        if inputs.time > 0.05:
            raise ValueError("no")
        return Command(0.0)


def whole(bench, duration=0.1, **how):
    """All that a run gives: signals, poses and what the log says."""
    return all_of(bench, list(advanced(bench, duration, **how)))


def all_of(bench, blocks):
    run = collected(bench, blocks)
    return run.signals, np.concatenate([block.poses for block in blocks]), [(e.tick, e.message) for e in run.events]


def same(one, other):
    for name in one[0]:
        np.testing.assert_array_equal(one[0][name], other[0][name], err_msg=name)
    np.testing.assert_array_equal(one[1], other[1])
    assert one[2] == other[2]
    assert len(one[0]) > 20


def weights(model):
    """What a model was given; its armatures, and what MuJoCo makes of them, are the laws' to write in each step."""
    return [array.tolist() for array in (model.body_mass, model.body_inertia, model.body_ipos)]


# --- what a bench may have been through -------------------------------------------------------------------------------


def a_run(bench):
    whole(bench, 0.25)


def one_short_block(bench):
    bench.start()
    bench.advance(swaying(0, 8, 0.3, 20.0))


def a_last_block_within_a_cycle(bench):
    bench.start()
    bench.advance(swaying(0, 803, 0.3, 20.0), last=True)


def a_trip(bench):
    bench.start()
    push = off(4000)
    push.force[:], push.attached[:], push.squeeze[:] = 900.0, True, 1.0
    bench.advance(push)
    assert [trip.reason for trip in bench.trips] == ["limit_switch"]


def changes(bench):
    bench.start(power=False)
    bench.advance(hold(800))
    bench.change(parameters({
        "feel.inertia": 0.5, "limb.mass": 4.0, "load_cell.offset": 20.0, "drive.velocity_bandwidth": 40.0,
        "load_cell.spike_rate": 1000.0, "load_cell.spike": 30.0, "plc.frame_loss": 0.5,
    }, bench.parameters), mode="torque", power="on")  # fmt: skip
    bench.advance(swaying(800, 800, 0.2, 5.0))
    bench.change(mode="off")  # never told


def a_divergence(bench):
    bench.start()
    bench.advance(hold(800))
    bench.data.qvel[:] = math.nan
    bench.advance(hold(800))
    assert isinstance(bench.failure, DivergedError)


def a_warning(bench):
    """MuJoCo counts its warnings, and warns but once of a kind."""
    bench.start()
    bench.advance(hold(800))
    bench.data.qpos[:] = 1e30
    bench.advance(hold(800))
    assert isinstance(bench.failure, DivergedError)


def other_parameters(bench):
    bench.reset(parameters({
        "column.inertia": 0.08, "gearbox.stage1.ratio": 4.0, "linkage.crank": 0.11, "motor.rotor_inertia": 9e-5,
        "column.grip_height": 0.4, "load_cell.adc_bits": 16, "nameplate.gear_ratio": 20.0,
    }), seed=9)  # fmt: skip
    whole(bench, 0.05)
    bench.reset(Parameters())


PASTS = [
    a_run, one_short_block, a_last_block_within_a_cycle, a_trip, changes, a_divergence, a_warning, other_parameters,
]  # fmt: skip


@pytest.fixture(scope="module")
def fresh():
    return whole(Bench(Parameters(), seed=3))


@pytest.mark.parametrize("past", PASTS, ids=lambda past: past.__name__)
def test_after_a_reset_it_is_as_if_made_anew(past, fresh, monkeypatch):
    bench = Bench(Parameters(), seed=1)
    model, data, before = bench.model, bench.data, weights(bench.model)
    monkeypatch.setattr(plant_model, "build", lambda *_: pytest.fail("the model is built again"))
    past(bench)
    bench.reset(seed=3)
    assert (bench.time, bench.failure, bench.trips) == (0.0, None, [])
    assert bench.parameters == Parameters()
    assert bench.model is model and bench.data is data and weights(model) == before
    same(whole(bench), fresh)


def test_a_limit_that_was_reached_is_over_with_the_run():
    """What the log had open at the reset is never told of in the run that follows."""
    fresh = whole(Bench(Parameters()), 0.5)
    bench = Bench(Parameters())
    a_trip(bench)
    bench.reset()
    same(whole(bench, 0.5), fresh)


def test_a_reset_is_no_more_than_a_reset(fresh):
    """Twice is once, and right after making it is nothing."""
    bench = Bench(Parameters(), seed=3)
    bench.reset(seed=3)
    bench.reset(seed=3)
    same(whole(bench), fresh)


@pytest.mark.parametrize("past", [a_run, changes, a_trip], ids=lambda past: past.__name__)
def test_the_memory_of_chance_is_gone_too(past):
    p = parameters(FAULTY)
    bench, other = Bench(p, seed=5), Bench(p, seed=5)
    past(bench)
    bench.reset(seed=5)
    same(whole(bench), whole(other))


def test_after_an_outer_loop_it_is_as_if_made_anew():
    def run(bench):
        return whole(bench)

    fresh = run(Bench(Parameters(), controller=Still(), seed=3))
    bench = Bench(Parameters(), controller=Still())
    run(bench)
    bench.reset(seed=3)
    same(run(bench), fresh)


def test_after_an_outer_loop_that_failed_it_runs_until_it_fails_again():
    bench = Bench(Parameters(), controller=Fails())
    found = []
    for _ in range(2):
        bench.start()
        block = bench.advance(hold(2000))
        assert isinstance(bench.failure, Exception)
        found.append((block.ticks, str(bench.failure), block["/column.angle"].tobytes()))
        bench.reset()
        assert bench.failure is None
    assert found[0] == found[1]
    assert 1000 < found[0][0] < 1010


def test_with_other_parameters_it_is_a_bench_of_those(monkeypatch):
    other = parameters({
        "column.inertia": 0.06, "column.grip_height": 0.25, "linkage.rod": 0.22, "gearbox.stage2.ratio": 6.0,
        "gearbox.stage2.kind": "spur", "feel.stiffness": 50.0, "load_cell.noise": 1.0, "limb.mass": 2.5,
    }).with_nameplate()  # fmt: skip
    made = Bench(other, seed=2)
    fresh, geoms, mjcf = whole(made), made.geoms, made.mjcf
    bench = Bench(Parameters())
    whole(bench)
    assert bench.geoms != geoms
    monkeypatch.setattr(plant_model, "build", lambda *_: pytest.fail("the model is built again"))
    bench.reset(other, seed=2)
    same(whole(bench), fresh)
    assert bench.parameters == other
    assert bench.geoms == geoms and bench.mjcf == mjcf
    assert weights(bench.model) == weights(made.model)


@pytest.mark.parametrize("values", [
    {"gearbox.stages": 1}, {"rates.plc_cycle": 800e-6}, {"simulation.substeps": 2}, {"linkage.kind": "none"},
])  # fmt: skip
def test_what_needs_another_model_or_clock_needs_a_new_bench(values, fresh):
    bench = Bench(Parameters(), seed=3)
    with pytest.raises(ValueError, match="need a new bench"):
        bench.reset(parameters(values))
    with pytest.raises(ValueError, match="need a new bench"):
        bench.reset({"pitch": Parameters()})
    same(whole(bench), fresh)  # a refusal leaves it as it was


@pytest.mark.parametrize("kind", ["four_bar", "none"])
def test_shapes_and_names_do_not_depend_on_recorded_poses(kind):
    p = parameters({"linkage.kind": kind, "nameplate.linkage": kind})
    with_poses, without = Bench(p), Bench(p, poses=False)
    assert without.geoms == with_poses.geoms
    assert without.body_names == with_poses.body_names
    assert ("rod" in without.body_names) == (kind == "four_bar")
    without.start()
    assert without.advance(hold(8)).poses.shape == (1, 1, 7)  # the world alone


@pytest.mark.parametrize("heights", [(0.0, 0.04, 0.08), (0.08, 0.0, 0.04)])
def test_any_unbalance_in_one_bench_after_another(heights):
    """Without a linkage nothing else turns a body whose weight lies on its axis, which MuJoCo would take for good."""
    rigs = [parameters({
        "linkage.kind": "none", "nameplate.linkage": "none", "column.mass_height": height,
    }) for height in heights]  # fmt: skip
    bench = Bench(rigs[0])
    for p in rigs:
        bench.reset(p, seed=3)
        same(whole(bench, 0.05), whole(Bench(p, seed=3), 0.05))


def test_a_reset_to_parameters_that_cannot_be_stepped_is_refused_and_leaves_it(fresh):
    bench = Bench(Parameters(), seed=3)
    with pytest.raises(InputError):
        bench.reset(parameters({"gearbox.stage1.stiffness": 1e9}))
    same(whole(bench), fresh)


# --- blocks -----------------------------------------------------------------------------------------------------------

RATES = {
    "rates.current_cycle": 62.5e-6, "rates.velocity_cycle": 125e-6, "rates.position_cycle": 500e-6,
    "rates.bus_cycle": 500e-6, "rates.plc_cycle": 1e-3,
}  # fmt: skip


@pytest.mark.parametrize(("values", "cycle"), [({}, 8), (FAULTY, 8), (RATES, 16), ({"simulation.substeps": 3}, 8)])
@pytest.mark.parametrize("cycles", [(1,), (7, 1, 30), (25,), (100, 3)])
def test_the_length_of_blocks_makes_no_difference(values, cycle, cycles):
    p = parameters(values)
    long = whole(Bench(p, seed=8), 0.12)
    short = whole(Bench(p, seed=8), 0.12, blocks=[n * cycle for n in cycles])
    for name in long[0]:
        np.testing.assert_array_equal(long[0][name], short[0][name], err_msg=name)
    np.testing.assert_array_equal(long[1], short[1])


@pytest.mark.parametrize("ticks", [0, 4008])
def test_a_block_has_its_length(ticks):
    bench = Bench(Parameters())
    bench.start()
    with pytest.raises(ValueError, match="a block has whole PLC cycles, and at most 4000 ticks"):
        bench.advance(hold(ticks))
    assert bench.time == 0.0


def test_nothing_comes_after_a_block_that_ends_within_a_cycle():
    bench = Bench(Parameters())
    bench.start()
    bench.advance(hold(803), last=True)
    with pytest.raises(ValueError, match="whole PLC cycles"):
        bench.advance(hold(8))


def test_a_bench_is_started_once():
    bench = Bench(Parameters())
    bench.start()
    bench.advance(hold(8))
    with pytest.raises(RuntimeError, match="run already; reset it"):
        bench.start()


def test_after_a_failure_it_waits_for_a_reset():
    bench = Bench(Parameters())
    a_divergence(bench)
    with pytest.raises(RuntimeError, match="has failed; reset the bench"):
        bench.advance(hold(8))


def test_blocks_that_were_handed_out_are_not_written_again():
    """What is kept of a block stays, through later blocks and a reset."""
    bench = Bench(Parameters())
    bench.start()
    blocks, copies = [], []
    for _ in range(12):
        blocks.append(bench.advance(swaying(bench.next_tick, 400, 0.2, 4.0)))
        copies.append({path: rows.copy() for path, rows in blocks[-1].signals.items()})
    bench.reset()
    whole(bench)
    for block, copy in zip(blocks, copies, strict=True):
        for path, rows in block.signals.items():
            np.testing.assert_array_equal(rows, copy[path])


def test_without_a_start_the_drive_is_off():
    bench = Bench(Parameters())
    assert not bench.advance(hold(800))["/drive.voltage"].any()
    bench.reset()
    bench.start()
    assert bench.advance(swaying(0, 800, 0.2, 5.0))["/drive.voltage"].any()


@pytest.mark.parametrize("axes", [1, 2])
def test_hands_in_any_layout_run_the_same_machine_code(axes):
    """Strided, read-only or of another type: the loop is not compiled anew for it."""

    def odd(hand):
        values = dict(vars(hand))
        values["angle"] = np.repeat(hand.angle, 2)[::2]
        values["force"] = hand.force.astype(np.float32)
        values["squeeze"] = hand.squeeze.copy()
        values["squeeze"].flags.writeable = False
        values["velocity"] = np.broadcast_to(hand.velocity, (3, len(hand.velocity)))[1]
        values["attached"] = hand.attached.astype(np.int64)
        values["motion"] = np.repeat(hand.motion, 3)[::3]
        return HandSamples(**values)

    found, compiled = [], None
    for change in (lambda hand: hand, odd):
        bench = Bench({f"axis{k}": Parameters() for k in range(axes)}, seed=3)
        bench.start()
        block = bench.advance([change(swaying(0, 800, 0.1, 4.0)) for _ in range(axes)])
        found.append(block["/axis0/column.angle"])
        if JIT:
            assert compiled in (None, len(tick.advance.signatures))
            compiled = len(tick.advance.signatures)
    np.testing.assert_array_equal(*found)


# --- changes ----------------------------------------------------------------------------------------------------------


def test_a_change_of_a_live_parameter_says_what_and_from_when():
    bench = Bench(Parameters())
    bench.start()
    bench.advance(hold(80))
    bench.change(parameters({"limb.mass": 4.0, "load_cell.gain_error": 0.1}), mode="torque")
    events = bench.advance(hold(80)).events
    assert [(e.tick, e.level, e.source, e.message) for e in events] == [
        (80, "info", "scenario", "load_cell.gain_error = 0.1"), (80, "info", "scenario", "limb.mass = 4.0 kg"),
        (80, "info", "scenario", "drive mode torque"),
    ]  # fmt: skip
    limb = bench.model.body("limb")
    height = Parameters().column.grip_height
    assert limb.inertia[1] == pytest.approx(4.0 * height**2)
    assert bench.parameters.limb.mass == 4.0


@pytest.mark.parametrize(("parts", "says"), [
    ({"parameters": {"feel.inertia": 0.5, "gearbox.stages": 1}},
     "parameters.gearbox.stages: holds for the whole run; reset the bench with another"),
    ({"parameters": {"motor.resistance": 5.0}}, "parameters.motor.resistance: holds for the whole run"),
    ({"parameters": {"feel.inertia": 0.5}, "mode": "force"},
     "mode 'force' is not valid; give one of position, velocity, torque, off"),
    ({"parameters": {"feel.inertia": 0.5, "limb.tight_stiffness": 3e8}},
     "parameters.limb.tight_stiffness: 3e+08 N/m is too high for a plant step of 50 µs"),
    ({"mode": "torque", "power": "onn"}, "power 'onn' is not valid; give one of on, off"),
])  # fmt: skip
def test_a_change_that_cannot_be_made_changes_nothing(fresh, parts, says):
    bench = Bench(Parameters(), seed=3)
    given = dict(parts)
    if "parameters" in given:
        given["parameters"] = parameters(given["parameters"])
    with pytest.raises(InputError) as refused:
        bench.change(**given)
    assert says in str(refused.value)
    same(whole(bench), fresh)


def test_a_change_knows_the_steps_that_the_bench_takes():
    stiff = {"limb.tight_stiffness": 3e8}
    with pytest.raises(InputError, match=r"tight_stiffness: 3e\+08 N/m is too high for a plant step of 50 µs"):
        Bench(Parameters()).change(parameters(stiff))
    finer = {"simulation.substeps": 4}
    Bench(parameters(finer)).change(parameters({**finer, **stiff}))
    beside = Bench({"pitch": Parameters(), "roll": parameters(finer)})
    beside.change(parameters(stiff), axis="pitch")  # stepped as the other one needs it
    assert beside.parameters_of["pitch"] == parameters(stiff)


def test_a_change_at_the_start_is_another_start():
    heavy = parameters({"limb.mass": 4.0, "feel.inertia": 0.5, "load_cell.noise": 0.2})
    made, bench = Bench(heavy, seed=3), Bench(parameters({"load_cell.noise": 0.2}), seed=3)
    bench.change(heavy)
    one, other = whole(made), whole(bench)
    for name in one[0]:
        np.testing.assert_array_equal(one[0][name], other[0][name], err_msg=name)


@pytest.mark.parametrize("rig", ["one_stage", "direct_drive", "belt"])
def test_other_rigs_reset_too(rig):
    p = find_rig(rig).parameters
    fresh = whole(Bench(p, seed=3), 0.05)
    bench = Bench(p)
    whole(bench, 0.1)
    bench.reset(seed=3)
    same(whole(bench, 0.05), fresh)


# --- by the clock -----------------------------------------------------------------------------------------------------


def test_changes_by_the_clock_are_made_in_order_each_with_its_plc_cycle():
    bench, made = Bench(Parameters()), []

    def change(at, name):
        return timed.Change(at, lambda b: made.append((name, b.next_tick)))

    changes = [change(0.0302, "d"), change(0.01, "b"), change(0.01, "c"), change(0.0, "a"), change(0.9, "never")]
    hands = []

    def hand(first, ticks):
        hands.append((first, ticks))
        return swaying(first, ticks, 0.1, 3.0)

    blocks = list(timed.run(bench, hand, changes, 0.2501))
    assert made == [("a", 0), ("b", 200), ("c", 200), ("d", 608)]
    assert hands == [(0, 200), (200, 408), (608, 4000), (4608, 400)]  # 5002 ticks, in whole PLC cycles
    assert [(b.first_tick, b.ticks) for b in blocks] == hands
    same(whole(Bench(Parameters()), 0.2501), all_of(bench, blocks))


def test_a_sweep_over_kinds_of_linkage_rigs_and_unbalance_is_right_at_every_point():
    """Points of one thread share a bench where they can: each gives what it gives on a bench of its own."""
    scenario = parse_scenario(
        'title = "t"\nduration = 0.1\nhand = [{at = 0.0, kind = "sine", amplitude_deg = 4.0, frequency = 5.0}]\n'
        '[[checks]]\nname = "torque"\nmetric = "rms"\nsignal = "/column.torque"\nwindow = [0.02, 0.1]\n'
    )
    evaluate = ScenarioAt(scenario, {name: find_rig(name) for name in ("thesis", "aileron")})
    none = {"linkage.kind": "none", "nameplate.linkage": "none"}
    points = [
        {}, none, {"linkage.kind": "four_bar"}, {"linkage.kind": "none"}, {"rig": "aileron"}, {"rig": "thesis"},
        *[{**none, "column.mass_height": height} for height in (0.0, 0.04, 0.08, 0.0)],
    ]  # fmt: skip
    together = [evaluate(point) for point in points]
    alone = []
    for point in points:
        with ThreadPoolExecutor(1) as pool:  # a thread has no bench yet
            alone.append(pool.submit(evaluate, point).result())
    assert together == alone
    assert all(math.isfinite(found["torque"]) for found in together)
    assert len({found["torque"] for found in together}) == 7  # the thesis's rig is there three times, a height twice
