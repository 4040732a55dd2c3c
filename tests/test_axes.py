"""Several axes in one bench: each is what it is alone, and whatever is said names the one it is of."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from cls_bench.bench import Bench, DivergedError
from cls_bench.control.outer_loop import Command
from cls_bench.errors import ControllerError, InputError
from cls_bench.parameters import Parameters
from cls_bench.rigs import find_rig, load_rig
from cls_bench.run_log import trip_of
from cls_bench.signals import topics
from tests.running import advanced, collected, hold, off, parameters, swaying

YOUR_RIG = Path(__file__).parent.parent / "docs" / "your_rig.md"


def rig(name, **values):
    return parameters({key.replace("__", "."): value for key, value in values.items()}, find_rig(name).parameters)


AXES = {
    "pitch": rig("thesis", load_cell__spike_rate=200.0, load_cell__spike=4.0),
    "roll": rig("one_stage", plc__frame_loss=0.05, feel__shaker__torque=1.0),
    "yaw": rig("direct_drive"),
    "tab": rig("rudder"),
}


def motion(first, ticks, a):
    """A hand of its own for each axis."""
    return swaying(first, ticks, 0.04 + 0.03 * a, 3.0 + 2.0 * a)


def run(axes, *, numbers=None, seed=6, duration=0.12, blocks=(800,), controller=None):
    bench = Bench(axes, seed=seed, controller=controller)
    bench.start()

    def steps():
        end, k = bench.clock.tick_of(duration), 0
        while bench.next_tick < end:
            ticks = min(blocks[k % len(blocks)], end - bench.next_tick)
            k += 1
            yield bench.advance([motion(bench.next_tick, ticks, a) for a in numbers or range(len(axes))])
            if bench.failure is not None:
                raise bench.failure

    return collected(bench, steps())


@pytest.fixture(scope="module")
def alone():
    return {name: run({name: p}, numbers=[a]) for a, (name, p) in enumerate(AXES.items())}


@pytest.mark.parametrize(
    "names", [("pitch", "roll"), ("yaw", "pitch"), ("roll", "tab", "pitch"), tuple(AXES)], ids="-".join
)
def test_each_is_what_it_is_alone(alone, names):
    """Bit for bit: another rig beside it, in any place, is not felt."""
    numbers = [list(AXES).index(name) for name in names]
    together = run({name: AXES[name] for name in names}, numbers=numbers)
    assert together.signals.keys() == {signal for name in names for signal in alone[name].signals}
    for name in names:
        for signal, values in alone[name].signals.items():
            np.testing.assert_array_equal(together[signal], values, err_msg=signal)
        assert np.ptp(together[f"/{name}/column.angle"]) > 0.005
        own = [(e.tick, e.source, e.message) for e in together.events if e.source.startswith(f"{name} ")]
        assert own == [(e.tick, e.source, e.message) for e in alone[name].events]


def test_two_alike_move_alike_but_for_their_noise():
    quiet = {key: 0.0 for key in ("encoder.noise", "load_cell.noise", "potentiometer.noise")}
    r = run({"left": parameters(quiet), "right": parameters(quiet)}, numbers=[0, 0])
    for signal, values in r.signals.items():
        if signal.startswith("/left/"):
            np.testing.assert_array_equal(values, r[signal.replace("/left/", "/right/")], err_msg=signal)
    noisy = run({"left": Parameters(), "right": Parameters()}, numbers=[0, 0])
    assert not np.array_equal(noisy["/left/load_cell.counts"], noisy["/right/load_cell.counts"])


def test_one_axis_keeps_its_names_and_samples():
    """Without a name as ever; a name goes before the topics and gives the sensors other noise, and changes no more."""
    quiet = parameters({key: 0.0 for key in ("encoder.noise", "load_cell.noise", "potentiometer.noise")})
    one, named = run({"": quiet}), run({"pitch": quiet})
    assert [t.path for t in one.bench.topics] == [t.path for t in topics()]
    assert [t.path for t in named.bench.topics] == [f"/pitch{t.path}" for t in topics()]
    for signal, values in one.signals.items():
        np.testing.assert_array_equal(named[f"/pitch{signal}"], values, err_msg=signal)
    plain = Bench(quiet, seed=6)
    assert [t.path for t in plain.topics] == [t.path for t in topics()]
    assert plain.body_names == one.bench.body_names
    assert named.bench.body_names[1:] == tuple(f"pitch/{name}" for name in one.bench.body_names[1:])


def test_topics_are_those_of_each_rig():
    bench = Bench(AXES)
    paths = {t.path for t in bench.topics}
    assert "/roll/gearbox" in paths and "/yaw/gearbox" not in paths
    by_path = {t.path: t for t in bench.topics}
    for name, p in AXES.items():
        stages = p.gearbox.stages
        if stages:
            assert len(by_path[f"/{name}/gearbox"].signals) == 3 * stages
        assert by_path[f"/{name}/column"].axis == name
    assert [axis.name for axis in bench.axes] == list(AXES)
    assert bench.parameters_of == AXES


def test_an_axis_is_changed_by_its_name():
    bench = Bench({"pitch": Parameters(), "roll": Parameters()})
    other = Bench({"pitch": Parameters(), "roll": Parameters()})
    for b in (bench, other):
        b.start()
        b.advance([hold(80)] * 2)
    bench.change(parameters({"feel.inertia": 0.6}), mode="torque", axis="roll")
    hand = [motion(80, 800, 0)] * 2
    block, same = bench.advance(hand), other.advance(hand)
    assert [(e.source, e.message) for e in block.events] == [
        ("roll scenario", "feel.inertia = 0.6 kg·m²"), ("roll scenario", "drive mode torque"),
    ]  # fmt: skip
    np.testing.assert_array_equal(block["/pitch/column.angle"], same["/pitch/column.angle"])
    assert not np.array_equal(block["/roll/column.angle"], same["/roll/column.angle"])
    with pytest.raises(InputError, match="axis 'yaw': there is 'pitch', 'roll'"):
        bench.change(mode="off", axis="yaw")
    with pytest.raises(InputError, match="axis '': there is"):
        bench.change(mode="off")


def test_a_trip_is_of_one_axis_and_leaves_the_other():
    bench = Bench({"pitch": Parameters(), "roll": Parameters()})
    bench.start()
    push = off(4000)
    push.force[:], push.attached[:], push.squeeze[:] = 900.0, True, 1.0
    block = bench.advance([hold(4000), push])
    (found,) = bench.trips
    assert (found.axis, found.reason) == ("roll", "limit_switch")
    (event,) = [e for e in block.events if e.level == "error"]
    assert (event.source, event.message) == ("roll safety", "safe torque off: limit switch open")
    assert trip_of(event) == found
    after = found.tick // 4 + 2
    assert not block["/roll/drive.voltage"][after:].any()
    assert block["/pitch/drive.voltage"][after:].any()
    warned = {e.source for e in block.events if e.level == "warning"}
    assert warned and all(source.startswith("roll ") for source in warned)


@pytest.mark.parametrize("what", ["motion", "memory"])
def test_a_failure_names_its_axis(what):
    bench = Bench({"pitch": Parameters(), "roll": rig("one_stage")})
    bench.start()
    bench.advance([hold(80)] * 2)
    record = bench.axes[1].record
    if what == "motion":
        bench.plant.qvel[record.truth.joints.motor] = math.nan
        cause = "velocity of joint roll/motor is not finite"
    else:
        record.truth.body.temperature = math.nan
        cause = "roll/temperature in the plant is not finite"
    block = bench.advance([hold(800)] * 2)
    assert isinstance(bench.failure, DivergedError)
    assert cause in bench.failure.cause
    assert cause in block.events[-1].message


def test_a_number_that_is_none_trips_its_own_drive():
    bench = Bench({"pitch": Parameters(), "roll": rig("one_stage")})
    bench.start()
    bench.advance([hold(80)] * 2)
    bench.axes[1].record.controller.state.feel.angle = math.nan
    block = bench.advance([hold(800)] * 2)
    assert [(t.axis, t.reason) for t in bench.trips] == [("roll", "invalid_value")]
    assert [(e.source, e.message) for e in block.events] == [
        ("roll safety", "safe torque off: feel.angle is not a finite number")
    ]


# --- outer loops ------------------------------------------------------------------------------------------------------


class Asks:
    """Asks for a sway; remembers what it saw."""

    def __init__(self, amplitude, fails=math.inf):
        self.amplitude, self.fails, self.seen = amplitude, fails, []

    def step(self, inputs):
        self.seen.append(inputs)
        if inputs.time >= self.fails:
            raise RuntimeError("enough")
        return Command(self.amplitude * math.sin(20.0 * inputs.time))


def test_each_axis_may_have_an_outer_loop_of_its_own(alone):
    loops = {"roll": Asks(0.02), "pitch": Asks(0.05)}
    r = run({name: AXES[name] for name in ("pitch", "roll", "yaw")}, controller=loops)
    for name, loop in loops.items():
        np.testing.assert_allclose(
            r[f"/{name}/feel.angle"], [loop.amplitude * math.sin(20.0 * i.time) for i in loop.seen], atol=1e-15
        )
        np.testing.assert_array_equal([i.torque for i in loop.seen], r[f"/{name}/load_cell.torque"][::8])
    for signal, values in alone["yaw"].signals.items():
        np.testing.assert_array_equal(r[signal], values, err_msg=signal)


def test_a_single_loop_is_that_of_the_first_axis():
    loop = Asks(0.03)
    run({"pitch": Parameters(), "roll": Parameters()}, controller=loop, duration=0.02)
    assert len(loop.seen) == 50


def test_a_loop_that_fails_ends_the_run_of_all():
    r = run({"pitch": Parameters(), "roll": Parameters()}, controller={"roll": Asks(0.0, fails=0.05)})
    assert isinstance(r.error, ControllerError)
    assert len(r["/pitch/column.angle"]) == len(r["/roll/column.angle"]) == 1000


# --- steps -----------------------------------------------------------------------------------------------------------


def test_axes_of_different_steps_take_the_finer(tmp_path):
    """Each is what it is alone with that many steps; what the parameters say stays."""
    path = tmp_path / "my_rig.toml"
    path.write_text(re.search(r"^```toml my_rig.toml\n(.*?)^```", YOUR_RIG.read_text(), re.M | re.S)[1])
    light = load_rig(path).parameters
    assert light.simulation.substeps == 2 and AXES["roll"].simulation.substeps == 1
    bench = run({"roll": AXES["roll"], "stick": light}, numbers=[1, 2])
    fine = {"roll": parameters({"simulation.substeps": 2}, AXES["roll"]), "stick": light}
    for (name, p), number in zip(fine.items(), (1, 2), strict=True):
        for signal, values in run({name: p}, numbers=[number]).signals.items():
            np.testing.assert_array_equal(bench[signal], values, err_msg=signal)
    assert bench.bench.parameters_of == {"roll": AXES["roll"], "stick": light}
    mixed = Bench({"thesis": Parameters(), "stick": light}, seed=6)
    mixed.reset({"thesis": parameters({"simulation.substeps": 2}), "stick": light})  # the steps are the same
    with pytest.raises(ValueError, match="substeps"):
        mixed.reset({"thesis": Parameters(), "stick": parameters({"simulation.substeps": 3}, light)})


# --- mistakes ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("axes", "says"), [
    ({}, "a bench has at least one axis"),
    ({"pitch": Parameters(), "": Parameters()}, "of several axes each has a name"),
    ({"Pitch": Parameters(), "roll": Parameters()}, "axis 'Pitch': a name is up to 20 of a–z, 0–9 and _"),
    ({"a/b": Parameters()}, "axis 'a/b': a name is up to 20"),
    ({"pitch": Parameters(), "roll": parameters({"rates.plc_cycle": 800e-6})},
     "axis 'roll': parameters.rates differs from that of 'pitch'; one clock runs all"),
])  # fmt: skip
def test_axes_that_cannot_be_together_are_one_line(axes, says):
    with pytest.raises(InputError) as refused:
        Bench(axes)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_loop_for_an_axis_that_is_not_there_is_refused():
    with pytest.raises(InputError, match="controller of axis 'yaw': there is 'pitch', 'roll'"):
        Bench({"pitch": Parameters(), "roll": Parameters()}, controller={"yaw": Asks(0.0)})


@pytest.mark.parametrize("hands", [1, 3])
def test_a_hand_too_few_or_too_many_is_refused(hands):
    bench = Bench({"pitch": Parameters(), "roll": Parameters()})
    bench.start()
    with pytest.raises(ValueError, match=f"a hand for each axis: there are 2, and {hands} hands"):
        bench.advance([hold(80)] * hands)


def test_blocks_and_resets_of_several_axes():
    two = {"pitch": AXES["pitch"], "roll": AXES["roll"]}
    bench = Bench(two, seed=6)
    one = collected(bench, advanced(bench, 0.1))
    bench.reset(seed=6)
    other = collected(bench, advanced(bench, 0.1, blocks=[8, 800, 56]))
    assert one.same_samples(other)
    assert [axis.name for axis in bench.axes] == ["pitch", "roll"]
