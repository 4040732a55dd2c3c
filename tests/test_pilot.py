"""The hand over time: every segment against its formula, and what a run makes of it."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import chirp as scipy_chirp

from cls_bench.parameters import DEG
from cls_bench.pilot import HandTimeline
from cls_bench.scenario import parse_scenario
from cls_bench.signals import CLOCK
from tests.running import run


def hand(toml, duration=2.0, first=0, ticks=None):
    timeline = HandTimeline(parse_scenario(f'title = "test"\nduration = {duration}\n{toml}'))
    return timeline.sample(first, ticks or round(duration / CLOCK.tick_s))


T = np.arange(40_000) * CLOCK.tick_s
"""Times of the ticks of a run of 2 s."""


def test_before_the_first_segment_it_does_not_grip():
    h = hand('hand = [{at = 0.5, kind = "hold", angle_deg = 3.0}]')
    np.testing.assert_array_equal(h.attached, T >= 0.5)
    np.testing.assert_allclose(h.angle, np.where(T >= 0.5, 3.0 * DEG, 0.0))
    assert not hand("").attached.any()


def test_ramp_goes_on_from_the_value_reached():
    h = hand(
        """
        hand = [{at = 0.0, kind = "hold", angle_deg = 2.0}, {at = 0.5, kind = "ramp", to_deg = 10.0, over = 0.4},
                {at = 0.7, kind = "ramp", to_deg = 0.0, over = 0.3}, {at = 1.5, kind = "hold"}]
        """
    )
    expected = np.interp(T, [0.0, 0.5, 0.7, 1.0], [2.0, 2.0, 6.0, 0.0]) * DEG
    np.testing.assert_allclose(h.angle, expected, atol=1e-12)
    assert h.velocity[10_001] == pytest.approx(20.0 * DEG)
    assert h.velocity[-1] == 0.0
    assert h.motion.all()


def test_smooth_ramp_has_least_jerk():
    """Minimum jerk: rest at both ends, also in acceleration; peak speed 15/8 of the mean, in the middle."""
    h = hand('hand = [{at = 0.0, kind = "ramp", to_deg = 8.0, over = 1.0, smooth = true}]')
    assert h.angle[20_000] == pytest.approx(8.0 * DEG)
    assert h.velocity.max() == pytest.approx(8.0 * DEG * 15 / 8, rel=1e-6)
    assert np.argmax(h.velocity) == 10_000
    np.testing.assert_allclose(np.gradient(h.angle, CLOCK.tick_s)[1:-1], h.velocity[1:-1], atol=1e-6)
    assert np.abs(np.gradient(h.velocity, CLOCK.tick_s)[[1, 19_998, 30_000]]).max() < 0.01


def test_hold_and_step():
    h = hand('hand = [{at = 0.0, kind = "hold", force_N = 5.0}, {at = 1.0, kind = "step", to_N = -12.0}, '
             '{at = 1.5, kind = "hold"}]')  # fmt: skip
    np.testing.assert_array_equal(h.force, np.where(T < 1.0, 5.0, -12.0))
    assert not h.motion.any()
    assert not h.velocity.any()


def test_sine_with_phase_offset_and_cycles():
    h = hand(
        """
        [[hand]]
        at = 0.25
        kind = "sine"
        amplitude_deg = 4.0
        offset_deg = 1.0
        frequency = 2.0
        phase_deg = 90.0
        cycles = 1.5
        """
    )
    t = np.clip(T - 0.25, 0.0, 0.75)
    expected = np.where(T < 0.25, 0.0, 1.0 + 4.0 * np.sin(2 * np.pi * 2.0 * t + np.pi / 2)) * DEG
    np.testing.assert_allclose(h.angle, expected, atol=1e-12)
    assert h.angle[-1] == pytest.approx(-3.0 * DEG)
    assert h.velocity[-1] == 0.0


def test_fade_takes_over_smoothly():
    h = hand(
        """
        hand = [{at = 0.0, kind = "hold", angle_deg = 5.0},
                {at = 0.5, kind = "sine", amplitude_deg = 4.0, frequency = 2.0, phase_deg = 90.0, fade = 1.0}]
        """
    )
    assert np.abs(np.diff(h.angle)).max() < 1e-4
    assert h.angle[10_000] == pytest.approx(5.0 * DEG)
    later = T >= 1.5
    np.testing.assert_allclose(
        h.angle[later], 4.0 * DEG * np.cos(2 * np.pi * 2.0 * (T[later] - 0.5)), atol=1e-12
    )
    np.testing.assert_allclose(np.gradient(h.angle, CLOCK.tick_s)[10_002:-1], h.velocity[10_002:-1], atol=1e-4)


@pytest.mark.parametrize(("sweep", "method"), [("linear", "linear"), ("log", "logarithmic")])
def test_chirp_is_scipys(sweep, method):
    h = hand(f'hand = [{{at = 0.0, kind = "chirp", amplitude_N = 7.0, from_hz = 0.5, to_hz = 20.0, over = 1.6, '
             f'sweep = "{sweep}"}}]')  # fmt: skip
    during = T < 1.6
    expected = 7.0 * scipy_chirp(T[during], 0.5, 1.6, 20.0, method=method, phi=-90)
    np.testing.assert_allclose(h.force[during], expected, atol=1e-9)
    np.testing.assert_allclose(h.force[~during], h.force[-1])


def test_recorded_samples(tmp_path):
    (tmp_path / "hand.csv").write_text("time, push ,value\n0.1,0,0\n0.3,40,1\n0.4,-20,2\n")
    file = tmp_path / "s.toml"
    text = 'hand = [{at = 0.2, kind = "samples", file = "hand.csv", unit = "N", column = "push"}]\n'
    text = f'title = "t"\nduration = 1.0\n{text}'
    scenario = parse_scenario(text, path=file)
    h = HandTimeline(scenario).sample(0, 20_000)
    expected = np.interp(T[:20_000] - 0.2, [0.1, 0.3, 0.4], [0.0, 40.0, -20.0])
    np.testing.assert_allclose(h.force, np.where(T[:20_000] >= 0.2, expected, 0.0), atol=1e-9)
    assert scenario.sample_files == {"hand.csv": (tmp_path / "hand.csv").read_bytes()}
    degrees = parse_scenario(text.replace('"N"', '"deg"'), path=file)
    h = HandTimeline(degrees).sample(0, 20_000)
    np.testing.assert_allclose(h.angle, np.where(T[:20_000] >= 0.2, expected, 0.0) * DEG, atol=1e-9)


ALL = """
hand = [
  {at = 0.0, kind = "hold", angle_deg = 2.0},
  {at = 0.2, kind = "ramp", to_deg = -4.0, over = 0.3, smooth = true},
  {at = 0.6, kind = "chirp", amplitude_deg = 2.0, from_hz = 1.0, to_hz = 9.0, over = 0.3, fade = 0.1},
  {at = 1.0, kind = "step", to_N = 9.0},
  {at = 1.2, kind = "release"},
  {at = 1.4, kind = "sine", amplitude_N = 9.0, frequency = 3.0},
]
squeeze = [{at = 0.3, value = 0.8, over = 0.2}, {at = 0.4, value = 0.1}]
"""


def test_the_samples_do_not_depend_on_how_the_run_is_cut():
    whole = hand(ALL)
    timeline = HandTimeline(parse_scenario(f'title = "t"\nduration = 2.0\n{ALL}'))
    edges = [0, 1, 17, 4000, 4001, 12_345, 20_000, 28_001, 40_000]
    parts = [timeline.sample(a, b - a) for a, b in pairwise(edges)]
    for field in ("angle", "velocity", "force", "motion", "attached", "squeeze"):
        np.testing.assert_array_equal(np.concatenate([getattr(p, field) for p in parts]), getattr(whole, field))
    np.testing.assert_array_equal(whole.attached, (T < 1.2) | (T >= 1.4))
    np.testing.assert_allclose(whole.squeeze, np.interp(T, [0.3, 0.4, 0.45], [0.0, 0.4, 0.1]), atol=1e-12)


def test_a_moving_hand_moves_the_column():
    """The model is a weak spring here; the column goes where the forearm's spring balances it."""
    r = run(
        'hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}, '
        '{at = 0.1, kind = "ramp", to_deg = 10.0, over = 0.8, smooth = true}]',
        duration=2.5, set=["feel.stiffness=10.0", "feel.friction=0.0"],
    )  # fmt: skip
    column, limb = r["/column.angle"][-1], r["/pilot.limb_angle"][-1]
    force = r.between("/pilot.hand_force", 2.3, 2.5).mean()
    # Arm 2000 N/m and grip 800 N/m in series, at 0.3 m: stretch times stiffness is the force.
    assert force == pytest.approx((10.0 * DEG - limb) * 0.3 * 2000.0, rel=0.01)
    assert force == pytest.approx((limb - column) * 0.3 * 800.0, rel=0.01)
    assert force * 0.3 == pytest.approx(10.0 * column, rel=0.05)


def test_a_pushing_hand_pushes_with_its_force():
    r = run('hand = [{at = 0.0, kind = "ramp", to_N = 10.0, over = 0.3}]', duration=2.0)
    assert r.between("/pilot.hand_force", 1.8, 2.0).mean() == pytest.approx(10.0, rel=0.01)
    assert r["/column.angle"][-1] == pytest.approx(3.0 / 35.0, rel=0.1)


def test_release_and_grip_again():
    r = run(
        """
        hand = [{at = 0.0, kind = "hold", angle_deg = 0.0}, {at = 0.1, kind = "ramp", to_deg = 8.0, over = 0.5},
                {at = 0.8, kind = "release"}, {at = 2.0, kind = "hold"}]
        squeeze = [{at = 1.0, value = 0.5}]
        """,
        duration=2.5,
    )
    t = r.time("/pilot")
    free = (t >= 0.8) & (t < 2.0 - 1e-9)
    assert not r["/pilot.hand_force"][free].any()
    assert not r.between("/column.torque", 0.8, 2.0).any()
    np.testing.assert_array_equal(r["/pilot.squeeze"][free], -1.0)
    assert r["/pilot.squeeze"][0] == 0.0
    assert r["/pilot.squeeze"][-1] == 0.5
    assert np.abs(r.between("/column.angle", 1.8, 2.0)).max() < 1.0 * DEG  # back near neutral
    assert r.between("/pilot.limb_angle", 1.9, 2.0) == pytest.approx(8.0 * DEG, abs=0.2 * DEG)  # forearm stays
    # The grip closes where the column is: no force at first, although forearm and column are 8° apart.
    assert np.abs(r.between("/pilot.hand_force", 2.0, 2.01)).max() < 2.0


def test_squeezing_stiffens_the_grip_without_a_kick():
    def sway(squeeze):
        return run(
            f"""
            hand = [{{at = 0.0, kind = "hold", angle_deg = 0.0}}, {{at = 0.1, kind = "ramp", to_deg = 8.0, over = 0.5}},
                    {{at = 1.5, kind = "ramp", to_deg = 10.0, over = 0.2}}]
            squeeze = [{{at = 1.0, value = {squeeze}, over = 0.1}}]
            """,
            duration=3.0, set=["feel.inertia=0.5"],
        )  # fmt: skip

    def stiffness(r):
        """Of the grip, from force and twist before and after the second ramp [N/m]."""
        def change(name):
            return r.between(name, 2.9, 3.0).mean() - r.between(name, 1.4, 1.5).mean()

        return change("/pilot.hand_force") / (0.3 * (change("/pilot.limb_angle") - change("/column.angle")))

    loose, tight = sway(0.0), sway(1.0)
    force = tight.between("/pilot.hand_force", 0.9, 1.0).mean()
    assert tight.between("/pilot.hand_force", 1.0, 1.5) == pytest.approx(force, abs=0.1 * abs(force))
    assert stiffness(loose) == pytest.approx(800.0, rel=0.02)
    assert stiffness(tight) == pytest.approx(2.0e6, rel=0.02)


def test_a_tight_grip_carries_the_forearms_mass_along():
    """Squeezed, the forearm's 1.8 kg swing with the column: 0.16 kg·m² at 0.3 m.

    Let go once what the ramp set swinging has died out, which takes seconds.
    """
    r = run(
        """
        hand = [{at = 0.0, kind = "ramp", to_N = 12.0, over = 0.5}, {at = 6.0, kind = "step", to_N = 0.0}]
        squeeze = [{at = 0.0, value = 0.8}]
        """,
        duration=7.0, set=["feel.friction=0.0", "feel.inertia=0.7"],  # with less a hand that only pushes shakes
    )  # fmt: skip
    crossing = np.argmax(r.between("/column.angle", 6.0, 7.0) < 0.0) * r.bench.clock.tick_s
    # Rigidly coupled: model 0.7, column with rod end 0.035 + 0.0046, forearm 0.162 kg·m²; damping 1.5 and 0.05.
    inertia, decay = 0.7 + 0.0397 + 0.162, 1.55 / 2 / (0.7 + 0.0397 + 0.162)
    omega = math.sqrt(35.0 / inertia - decay**2)
    assert crossing == pytest.approx((math.pi / 2 + math.atan(decay / omega)) / omega, rel=0.05)
