"""Friction by its law alone: bounded by the level, passive, and the bristle as a fine integration bends it."""

import math

import numpy as np
import pytest

from cls_bench.plant import friction

STIFFNESS, DAMPING, STRIBECK = 800.0, 0.15, 1.0
RNG = np.random.default_rng(3)


def cases(count: int) -> list[tuple[float, float, float, float, float]]:
    """Bristle [rad], velocity [rad/s], level [N·m], breakaway ratio and step [s], over many orders of magnitude."""
    found = []
    for _ in range(count):
        level = float(10.0 ** RNG.uniform(-4, 1))
        bristle = float(RNG.choice([-1.0, 1.0]) * 10.0 ** RNG.uniform(-8, -1))
        velocity = float(RNG.choice([-1.0, 0.0, 1.0], p=[0.45, 0.1, 0.45]) * 10.0 ** RNG.uniform(-8, 3))
        found.append((bristle, velocity, level, float(RNG.uniform(1.0, 2.0)), float(10.0 ** RNG.uniform(-6.5, -4))))
    return found


def after(bristle: float, velocity: float, level: float, ratio: float, step: float) -> tuple[float, float]:
    return friction.advance(bristle, velocity, level, ratio, STIFFNESS, DAMPING, STRIBECK, step)


def test_no_bristle_is_bent_further_than_it_can_hold():
    """Whatever it was bent before: a level that has fallen cuts it back at once, at rest and in motion."""
    for case in cases(5000):
        _, _, level, ratio, _ = case
        torque, bristle = after(*case)
        assert STIFFNESS * abs(bristle) <= level * ratio * (1 + 1e-9) + DAMPING * 1e-9
        assert abs(torque) <= 2.0 * level * ratio * (1 + 1e-9)


def test_friction_gives_back_no_more_than_its_bristles_hold():
    """Work that it takes in a step is at least what the bristles gained; what is cut off is lost."""
    for case in cases(5000):
        bristle, velocity, level, ratio, step = case
        torque, bent = after(*case)
        held = min(abs(bristle), level * ratio / STIFFNESS)
        gained = 0.5 * STIFFNESS * (bent**2 - held**2)
        assert torque * velocity * step >= gained - 1e-9 * max(abs(gained), 1e-12)


@pytest.mark.parametrize("velocity", [1e-4, 0.02, 0.9, 5.0, 80.0])
@pytest.mark.parametrize("ratio", [1.0, 1.4])
def test_the_bristle_bends_as_a_fine_integration_says(velocity, ratio):
    """LuGre's ż = v − σ0 |v| z / g(v) for a speed that is held: a step of 1 ms against 10 000 of 0.1 µs."""
    level, start = 0.2, -1e-4
    g = level * (1.0 + (ratio - 1.0) * math.exp(-((velocity / STRIBECK) ** 2)))
    fine = start
    for _ in range(10_000):
        middle = fine + 0.5e-7 * (velocity - STIFFNESS * velocity * fine / g)
        fine += 1e-7 * (velocity - STIFFNESS * velocity * middle / g)
    _, bristle = after(start, velocity, level, ratio, 1e-3)
    assert bristle == pytest.approx(fine, rel=1e-4, abs=1e-10)


@pytest.mark.parametrize("speed", [1e-3, 0.1, 0.5, 1.0, 3.0, 50.0])
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_steady_sliding_is_stribecks_curve(speed, way):
    """F_C + (F_S − F_C) exp(−(v/v_S)²), from static to Coulomb friction, both ways."""
    bristle, level, ratio = 0.0, 0.3, 1.5
    for _ in range(int(2e-2 / speed / 5e-5) + 200):
        torque, bristle = after(bristle, way * speed, level, ratio, 5e-5)
    assert torque == pytest.approx(way * level * (1.0 + 0.5 * math.exp(-(speed**2))), rel=1e-6)


def test_at_rest_it_is_a_spring():
    """Far below breakaway: as much torque as the bristle is bent, and back without a loss."""
    torque, bristle = after(0.0, 1e-3, 10.0, 1.1, 5e-5)
    assert bristle == pytest.approx(5e-8, rel=1e-4)
    assert torque == pytest.approx(STIFFNESS * 5e-8 + DAMPING * 1e-3, rel=1e-3)
    torque, back = after(bristle, -1e-3, 10.0, 1.1, 5e-5)
    assert back == pytest.approx(0.0, abs=1e-12)


def test_without_a_level_there_is_as_good_as_none():
    torque, bristle = after(1e-3, 3.0, 0.0, 1.1, 5e-5)
    assert abs(torque) <= 2.2e-9 and abs(bristle) < 1e-11
