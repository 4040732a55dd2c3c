"""Random streams: each sensor of each axis has its own, and none knows of the others or of the blocks."""

import itertools

import numpy as np
import pytest

from cls_bench.bench import Bench, _Streams
from cls_bench.plant import sensors
from tests.running import advanced, collected, parameters

WOKEN = len(sensors.UNIFORM) + len(sensors.TURBULENCE)


def drawn(axes, seed=1, ticks=600, blocks=(600,)):
    """All numbers by source, (ticks, axes)."""
    streams, found, left = _Streams(axes, seed), [], ticks
    for length in itertools.cycle(blocks):
        if left <= 0:
            break
        noise = streams.draw(min(length, left), [[True] * len(axes)] * WOKEN)
        found.append([np.array(values) for values in noise])
        left -= length
    return {
        name: np.concatenate([part[k] for part in found]) for k, name in enumerate(sensors.Noise._fields)
    }  # fmt: skip


def test_each_stream_is_another():
    found = drawn(("pitch", "roll"), ticks=5000)
    columns = [values[:, a] for values in found.values() for a in (0, 1)]
    assert len(columns) == 2 * (len(sensors.NORMAL) + WOKEN)
    for one, other in itertools.combinations(columns, 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.06  # four standard deviations of 1/√5000


def test_they_are_normal_and_uniform():
    found = drawn(("",), ticks=20_000)
    for name in (*sensors.NORMAL, *sensors.TURBULENCE):
        assert found[name].mean() == pytest.approx(0.0, abs=0.03)
        assert found[name].std() == pytest.approx(1.0, abs=0.02)
    for name in sensors.UNIFORM:
        assert found[name].min() >= 0.0 and found[name].max() < 1.0
        assert found[name].mean() == pytest.approx(0.5, abs=0.01)


def test_another_seed_changes_all():
    one, other = drawn(("",), seed=1), drawn(("",), seed=2)
    for name in one:
        assert not (one[name] == other[name]).any()


def test_a_seed_may_be_as_large_as_a_scenario_allows():
    assert np.isfinite(drawn(("",), seed=2**63 - 1)["encoder"]).all()


@pytest.mark.parametrize("blocks", [(8,), (1, 599), (16, 4, 100), (4500, 8)])
def test_the_length_of_blocks_changes_none(blocks):
    """Also across the ends of what is drawn at once."""
    one, other = drawn(("a", "b"), ticks=9500, blocks=(9500,)), drawn(("a", "b"), ticks=9500, blocks=blocks)
    for name in one:
        np.testing.assert_array_equal(one[name], other[name])


def test_another_axis_changes_none():
    alone, both = drawn(("roll",)), drawn(("pitch", "roll"))
    for name in alone:
        np.testing.assert_array_equal(alone[name][:, 0], both[name][:, 1])


@pytest.mark.parametrize("kind", ["NORMAL", "UNIFORM", "TURBULENCE"])
def test_another_source_changes_none(monkeypatch, kind):
    """A sensor that is added, in front of all others: what they get stays the same."""
    sources = ("NORMAL", "UNIFORM", "TURBULENCE")

    def numbers():
        streams = _Streams(("",), 3)
        names = [name for of in sources for name in getattr(sensors, of)]
        draws = [*([s.standard_normal for s in each] for each in streams._normal), *streams._woken]
        return {name: each[0](100) for name, each in zip(names, draws, strict=True)}

    before = numbers()
    monkeypatch.setattr(sensors, kind, ("tachometer", *getattr(sensors, kind)))
    after = numbers()
    assert after.keys() - before.keys() == {"tachometer"}
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values, err_msg=name)


def test_chance_is_drawn_only_where_something_depends_on_it():
    """So what is by chance on another axis moves nothing here, whenever it is switched on."""
    assert sensors.UNIFORM[0] == "spike"
    streams, alone = _Streams(("pitch", "roll"), 1), _Streams(("roll",), 1)
    quiet = streams.draw(80, [[False, False]] * WOKEN)
    assert all(values.size == 0 for values in quiet[len(sensors.NORMAL) :])
    one = streams.draw(80, [[True, False], *[[False, False]] * (WOKEN - 1)])
    assert (one.spike[:, 0] < 1.0).all() and (one.spike[:, 1] == 1.0).all()  # 1: by no chance
    assert one.command_frame.size == 0
    for _ in range(2):
        alone.draw(80, [[False]] * WOKEN)
    both = streams.draw(80, [[True, True]] * WOKEN)
    np.testing.assert_array_equal(both.spike[:, 1], alone.draw(80, [[True]] * WOKEN).spike[:, 0])


# --- on the bench -----------------------------------------------------------------------------------------------------


def run(values):
    bench = Bench(parameters(values), seed=7)
    return collected(bench, advanced(bench, 0.05, power=False))


@pytest.mark.parametrize(("values", "own"), [
    ({"encoder.noise": 1e-3}, {"/drive.position", "/drive.velocity"}),
    ({"load_cell.noise": 3.0}, {"/load_cell.counts"}),
    ({"potentiometer.noise": 1e-3}, {"/column.potentiometer"}),
    ({"load_cell.spike_rate": 500.0, "load_cell.spike": 50.0}, {"/load_cell.counts"}),
])  # fmt: skip
def test_a_sensors_noise_changes_no_other_sensor(values, own):
    """The drive off, so that no sample acts on the plant: only what follows from that sensor is another."""
    base, noisy = run({}), run(values)
    follows = {  # of the load cell; of the encoder, over the bus: the column's angle in the PLC, and the torque with it
        "/load_cell.counts": {"/load_cell.torque", "/feel.torque", "/limits.load_cell"},
        "/drive.position": {
            "/drive.set_position", "/load_cell.torque", "/feel.torque", "/feel.angle", "/feel.velocity",
            "/surface.deflection", "/surface.velocity", "/surface.feel_torque",
        },
    }  # fmt: skip
    allowed = own.union(*(follows.get(name, set()) for name in own))
    differ = {name for name in base.signals if not np.array_equal(base[name], noisy[name])}
    assert own <= differ <= allowed, differ ^ own
    assert np.array_equal(base["/column.angle"], noisy["/column.angle"])
