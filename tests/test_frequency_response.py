"""Frequency responses measured on the running simulation, against the linear model and closed forms."""

import csv
import math

import numpy as np
import pytest

from cls_bench.analysis.frequency import FrequencyResponse, compare
from cls_bench.bench import Bench
from cls_bench.errors import BenchError, InputError
from cls_bench.linear.hand import Hand
from cls_bench.linear.variation import Setup, changed, ideal
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import override
from cls_bench.pilot import constant, ramp
from cls_bench.stability import figures
from cls_bench.stability.driving import Part, Script, run
from cls_bench.stability.loops import BuiltIn
from cls_bench.stability.response import CHIRP, MULTISINE, STEPPED, Excitation, measure
from cls_bench.stability.validation import bench

SMALL = Excitation(MULTISINE, amplitude=0.02, realisations=2)


@pytest.fixture(scope="module")
def position_loops():
    """P without friction and backlash, hand off and squeezed."""
    p = ideal(Parameters())
    return {hand: measure(Setup(p, Hand(hand)), "position-loop", SMALL) for hand in (None, 1.0)}


@pytest.mark.parametrize("hand", [None, 1.0])
def test_measured_p_is_the_predicted_one(position_loops, hand):
    measured = position_loops[hand]
    crossover, _ = measured.closed.phase_crossover()
    assert 40 < crossover < 130
    low = measured.closed.up_to(1.5 * crossover)
    magnitude, phase = compare(low, measured.predicted_closed.up_to(1.5 * crossover))
    assert magnitude < 1.0
    assert phase < math.radians(5.0)
    assert measured.closed.coherence.min() > 0.999
    assert len(low.frequency) > 20


def test_numbers_of_p_are_those_of_the_linear_model(position_loops):
    measured = position_loops[None]
    (crossover, magnitude), (predicted, its_magnitude) = (
        r.phase_crossover() for r in (measured.closed, measured.predicted_closed)
    )
    assert crossover == pytest.approx(predicted, rel=0.03)
    assert magnitude == pytest.approx(its_magnitude, rel=0.06)  # 0.5 dB
    assert measured.closed.bandwidth() == pytest.approx(measured.predicted_closed.bandwidth(), rel=0.03)
    _, _, phase_margin, gain_crossover = measured.open.margins()
    _, _, its_phase_margin, its_gain_crossover = measured.predicted_open.margins()
    assert phase_margin == pytest.approx(its_phase_margin, rel=0.03)
    assert gain_crossover == pytest.approx(its_gain_crossover, rel=0.03)


def test_stepped_sine_and_multisine_agree(position_loops):
    measured = measure(
        Setup(ideal(Parameters()), Hand(None)), "position-loop", Excitation(STEPPED, 0.02, low=20, high=100, points=4)
    )
    reference = position_loops[None].closed
    for frequency, value in zip(measured.closed.frequency, measured.closed.value, strict=True):
        # The multisine's lines are close enough to each other for a straight line between logarithms.
        log = np.interp(np.log(frequency), np.log(reference.frequency), np.log(np.abs(reference.value)))
        assert math.log(abs(value)) == pytest.approx(log, abs=0.02)
    assert measured.closed.coherence.min() > 0.999
    assert measured.closed.amplitude == pytest.approx(math.radians(0.02), rel=1e-3)


@pytest.mark.parametrize("loop", ["velocity-loop", "outer-loop"])
def test_other_loops_are_the_predicted_ones(loop):
    measured = measure(Setup(ideal(Parameters()), Hand(1.0)), loop, SMALL)
    magnitude, phase = compare(measured.open.up_to(100), measured.predicted_open.up_to(100))
    assert magnitude < 1.0
    assert phase < math.radians(5.0)


@pytest.mark.parametrize(
    ("architecture", "linkage"),
    [("position", {}), ("position", {"stiffness": 2e4, "damping": 3.0}), ("velocity", {"damping": 6.0})],
)
def test_loop_gain_with_two_bodies_is_the_predicted_one(linkage, architecture):
    p = ideal(override(Parameters(), {"feel": {"bodies": "two", "linkage": linkage}}))
    p = changed(p, "plc.outer_loop", architecture)
    measured = measure(Setup(p, Hand(1.0)), "outer-loop", SMALL)
    magnitude, phase = compare(measured.open.up_to(100), measured.predicted_open.up_to(100))
    assert magnitude < 0.1
    assert phase < math.radians(1.0)
    # The excitation asks for the column's wanted angle whatever hangs on it: no line of it is lost in the linkage.
    assert measured.open.coherence.min() > 0.99


def test_velocity_architecture_has_its_own_p():
    p = changed(ideal(Parameters()), "plc.outer_loop", "velocity")
    measured = measure(Setup(p, Hand(1.0)), "position-loop", SMALL)
    assert measured.open is None
    magnitude, phase = compare(measured.closed.up_to(100), measured.predicted_closed.up_to(100))
    assert magnitude < 1.0
    assert phase < math.radians(5.0)


def test_rendered_admittance_is_the_predicted_one():
    measured = measure(
        Setup(ideal(Parameters()), Hand(1.0)), "rendered-admittance",
        Excitation(STEPPED, amplitude=1.0, low=6.0, high=60.0, points=5),
    )  # fmt: skip
    magnitude, phase = compare(measured.closed, measured.predicted_closed)
    assert magnitude < 1.0
    assert phase < math.radians(5.0)


def test_rendered_admittance_at_low_frequency_is_equation_3_15():
    p = ideal(Parameters())
    measured = measure(
        Setup(p, Hand(1.0)), "rendered-admittance", Excitation(STEPPED, amplitude=1.0, low=4.0, high=5.0, points=2)
    )
    column = p.column.inertia + p.linkage.rod_end_mass * p.linkage.arm**2
    for frequency, value in zip(measured.closed.frequency, measured.closed.value, strict=True):
        s = 2j * math.pi * frequency
        feel = p.feel
        wanted = s / ((feel.inertia + column) * s**2 + (feel.damping + p.column.viscous_friction) * s + feel.stiffness)
        # The position loop's lag of 5 ms turns a part of the inertia into negative damping.
        assert abs(value / wanted) == pytest.approx(1.0, abs=0.15)


def test_the_bench_as_it_is_answers_each_amplitude_differently():
    small, large = (
        measure(Setup(Parameters(), Hand(None)), "position-loop", Excitation(amplitude=a, realisations=2)).closed
        for a in (0.05, 1.0)
    )
    # Backlash swallows a small motion, friction delays it.
    assert small.coherence.mean() < 0.9 < large.up_to(50).coherence.mean()
    assert np.abs(small.value[-20:]).mean() < 0.5 * np.abs(large.value[-20:]).mean()


@pytest.mark.parametrize("values", [{}, {"plc.outer_loop": "velocity"}, {"rates.plc_cycle": 1.2e-3}])
def test_built_in_loop_as_an_object_runs_the_same_samples(values):
    p = Parameters()
    for key, value in values.items():
        p = changed(p, key, value)
    pull = Script(Hand(0.0), 0.3, [Part(0.0, constant(0.0)), Part(0.02, ramp(0.0, math.radians(6.0), 0.25))])
    one, other = (
        np.concatenate([b.signals["/column"] for b in run(Bench(p, seed=3, controller=c), pull)])
        for c in (None, BuiltIn(p.for_control))
    )
    assert np.array_equal(one, other)
    assert abs(one[-1, 0]) > 0.05


@pytest.mark.parametrize("loop", ["velocity-loop", "position-loop", "outer-loop"])
def test_loops_at_other_rates_are_the_predicted_ones(loop):
    p = bench("direct_drive", "plc 1 kHz, drive 16 kHz")
    measured = measure(Setup(p, Hand(1.0)), loop, SMALL)
    pairs = [(measured.open, measured.predicted_open)]
    if measured.closed is not None:
        pairs.append((measured.closed, measured.predicted_closed))
    for seen, predicted in pairs:
        magnitude, phase = compare(seen.up_to(100), predicted.up_to(100))
        assert magnitude < 1.0
        assert phase < math.radians(5.0)


def test_a_slower_plc_excites_less_far():
    slow = Setup(bench("thesis", "plc 1 kHz, drive 16 kHz"))
    with pytest.raises(InputError, match="below 400 Hz"):
        measure(slow, "position-loop", Excitation(high=450.0))


# Numbers of a response


def third_order(frequency):
    s = 2j * np.pi * np.asarray(frequency)
    return 1.0 / (s * (s + 1.0) * (s + 2.0))


def test_margins_of_a_textbook_loop():
    # 1/(s (s+1) (s+2)): gain margin 6 at √2 rad/s; |L| = 1 at 0.4457 rad/s, where the phase margin is 53.4°.
    f = np.geomspace(0.01, 2.0, 200)
    gain, at_gain, phase, at_phase = FrequencyResponse("L", f, third_order(f)).margins()
    assert gain == pytest.approx(6.0, rel=1e-3)
    assert 2 * math.pi * at_gain == pytest.approx(math.sqrt(2.0), rel=1e-3)
    assert math.degrees(phase) == pytest.approx(53.41, abs=0.1)
    assert 2 * math.pi * at_phase == pytest.approx(0.4457, rel=1e-3)


def test_bandwidth_resonance_and_crossover_of_closed_forms():
    f = np.geomspace(0.1, 100.0, 2000)
    w0, damping = 2 * math.pi * 10.0, 0.2
    s = 2j * np.pi * f
    response = FrequencyResponse("T", f, w0**2 / (s**2 + 2 * damping * w0 * s + w0**2))
    at, peak = response.resonance()
    assert at == pytest.approx(10.0 * math.sqrt(1 - 2 * damping**2), rel=5e-3)
    assert peak == pytest.approx(1 / (2 * damping * math.sqrt(1 - damping**2)), rel=1e-3)
    inside = 1 - 2 * damping**2
    assert response.bandwidth() == pytest.approx(10 * math.sqrt(inside + math.sqrt(inside**2 + 1)), rel=2e-3)
    assert math.isnan(response.phase_crossover()[0])
    crossover, magnitude = FrequencyResponse("L", f, third_order(f)).phase_crossover()
    assert crossover == pytest.approx(math.sqrt(2) / 2 / math.pi, rel=1e-3)
    assert magnitude == pytest.approx(1 / 6, rel=1e-2)


def test_csv_has_units_and_the_values(tmp_path):
    response = FrequencyResponse("P", [1.0, 2.0], [1j, -0.5], [1.0, 0.9], [0.1, 0.2])
    response.write_csv(tmp_path / "p.csv")
    with (tmp_path / "p.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[1]["magnitude_dB"] == f"{20 * math.log10(0.5):.9g}"
    assert float(rows[0]["phase_deg"]) == pytest.approx(90.0)
    assert rows[0]["coherence"] == "1"


def test_figures_are_drawn(position_loops, tmp_path):
    from cls_bench.report.style import save

    for name, figure in (
        ("bode", figures.bode(position_loops[None], closed=True)), ("nyquist", figures.nyquist(position_loops[1.0]))
    ):  # fmt: skip
        svg, png = save(figure, tmp_path / name)
        assert svg.stat().st_size > 5000 and png.stat().st_size > 10000
    with pytest.raises(ValueError, match="no open response"):
        measured = measure(
            Setup(ideal(Parameters())), "rendered-admittance", Excitation(STEPPED, 1.0, low=20, high=30, points=2)
        )
        figures.bode(measured, closed=False)


@pytest.mark.parametrize(
    ("loop", "make", "message"),
    [
        ("loop", Excitation, 'loop "loop": must be velocity-loop'),
        ("outer-loop", lambda: Excitation(CHIRP), 'excitation "chirp" of the outer-loop: must be'),
        ("position-loop", lambda: Excitation(low=50, high=20), "frequencies from 50 to 20 Hz"),
        ("position-loop", lambda: Excitation(high=2000), "below 1000 Hz"),
        ("position-loop", lambda: Excitation(amplitude=0.0), "amplitude = 0: must be positive"),
    ],
)
def test_bad_input_is_one_line(loop, make, message):
    with pytest.raises(InputError, match=message):
        measure(Setup(), loop, make())


def test_admittance_needs_a_hand():
    with pytest.raises(InputError, match="must grip"):
        measure(Setup(hand=Hand(None)), "rendered-admittance", Excitation(CHIRP))


def test_a_trip_while_measuring_says_so():
    with pytest.raises(BenchError, match="choose a smaller amplitude"):
        measure(Setup(), "position-loop", Excitation(STEPPED, amplitude=19.0, low=20.0, high=40.0, points=2))
