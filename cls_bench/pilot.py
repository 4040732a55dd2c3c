"""The pilot's hand over time: where the arm wants to be, or with which force it pushes, and how tightly it grips.

Every segment of a scenario becomes a closed form over the time since its start, evaluated at tick numbers counted from
the start of the run: the samples do not depend on how the run is cut into blocks.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.hand import HandSamples
from cls_bench.scenario import Chirp, Hold, Ramp, Release, Samples, Scenario, Segment, Sine, Step
from cls_bench.signals import Clock

Array = NDArray[np.float64]

Profile = Callable[[Array], tuple[Array, Array]]
"""Value and time derivative over the time since a segment's start [s]."""


def constant(value: float) -> Profile:
    """``value`` for good."""
    return lambda t: (np.full_like(t, value), np.zeros_like(t))


def ramp(start: float, end: float, over: float, *, smooth: bool = False) -> Profile:
    """From ``start`` to ``end`` within ``over`` [s], straight or with least jerk, then ``end``."""
    if over <= 0.0:
        return constant(end)

    def profile(t: Array) -> tuple[Array, Array]:
        x = np.minimum(t / over, 1.0)
        if smooth:
            share, rate = x**3 * (10.0 - 15.0 * x + 6.0 * x**2), 30.0 * (x * (1.0 - x)) ** 2
        else:
            share, rate = x, np.where(x < 1.0, 1.0, 0.0)
        return start + (end - start) * share, (end - start) / over * rate

    return profile


def sine(amplitude: float, frequency: float, phase: float, offset: float) -> Profile:
    """offset + amplitude · sin(2π frequency t + phase); frequency [Hz], phase [rad]."""
    omega = 2.0 * math.pi * frequency
    return lambda t: (
        offset + amplitude * np.sin(omega * t + phase),
        amplitude * omega * np.cos(omega * t + phase),
    )


def chirp(amplitude: float, start: float, end: float, over: float, offset: float, *, log: bool = False) -> Profile:
    """offset + amplitude · sin ∫ 2π f dt while f goes from ``start`` to ``end`` [Hz], linearly or exponentially."""
    growth = math.log(end / start) / over

    def profile(t: Array) -> tuple[Array, Array]:
        if log and growth != 0.0:
            frequency, turns = start * np.exp(growth * t), start * np.expm1(growth * t) / growth
        else:
            frequency = start + (end - start) / over * t
            turns = 0.5 * (start + frequency) * t
        phase = 2.0 * math.pi * turns
        return offset + amplitude * np.sin(phase), amplitude * 2.0 * math.pi * frequency * np.cos(phase)

    return profile


def interpolated(times: Array, values: Array) -> Profile:
    """Straight lines between samples; the first and the last value outside."""
    slopes = np.append(np.diff(values) / np.diff(times), 0.0)

    def profile(t: Array) -> tuple[Array, Array]:
        k = np.maximum(np.searchsorted(times, t, side="right") - 1, 0)
        inside = t >= times[0]
        return values[k] + slopes[k] * np.where(inside, t - times[k], 0.0), np.where(inside, slopes[k], 0.0)

    return profile


def stopped(profile: Profile, end: float) -> Profile:
    """``profile`` until ``end`` [s], then the value reached."""

    def held(t: Array) -> tuple[Array, Array]:
        value, rate = profile(np.minimum(t, end))
        return value, np.where(t < end, rate, 0.0)

    return held


def faded(profile: Profile, start: float, over: float) -> Profile:
    """``profile`` taking over smoothly from the constant ``start`` within ``over`` [s]."""
    if over <= 0.0:
        return profile
    weight = ramp(0.0, 1.0, over, smooth=True)

    def blend(t: Array) -> tuple[Array, Array]:
        value, rate = profile(t)
        share, share_rate = weight(t)
        return start + share * (value - start), share_rate * (value - start) + share * rate

    return blend


def _profile(segment: Segment, reached: float) -> Profile:
    """The closed form of ``segment``, which starts from the value ``reached`` [rad or N]."""
    match segment:
        case Hold(aim=aim):
            return constant(reached if aim is None else aim.value)
        case Release():
            return constant(reached)
        case Step():
            return constant(segment.aim.value)
        case Ramp():
            return ramp(reached, segment.aim.value, segment.over, smooth=segment.smooth)
        case Samples():
            return interpolated(segment.times, segment.values)
        case Sine():
            wave = sine(segment.aim.value, segment.frequency, math.radians(segment.phase_deg), segment.offset)
            wave = faded(wave, reached, segment.fade)
            return wave if segment.cycles is None else stopped(wave, segment.cycles / segment.frequency)
        case Chirp():
            log = segment.sweep == "log"
            wave = chirp(segment.aim.value, segment.from_hz, segment.to_hz, segment.over, segment.offset, log=log)
            return stopped(faded(wave, reached, segment.fade), segment.over)


class _Piece(NamedTuple):
    """A profile from one tick to another, and what else holds meanwhile."""

    first: int
    end: int
    profile: Profile
    tick_s: float
    """length of a tick [s]"""
    motion: bool = True
    attached: bool = True
    angle: float = 0.0
    """set angle that stays while a force acts [rad]"""

    def at(self, ticks: NDArray[np.int64]) -> tuple[Array, Array]:
        """Value and time derivative at tick numbers of the run."""
        return self.profile((ticks - self.first).astype(np.float64) * self.tick_s)

    def last(self) -> float:
        """The value reached when the next piece starts."""
        return float(self.at(np.array([self.end]))[0][0])


class HandTimeline:
    """The hand of a scenario, sampled tick by tick."""

    def __init__(self, scenario: Scenario):
        clock = scenario.clock
        self._hand = _hand_pieces(scenario.hand, scenario.ticks, clock)
        self._squeeze: list[_Piece] = []
        grip = 0.0
        ends = [*(clock.tick_of(entry.at) for entry in scenario.squeeze[1:]), scenario.ticks]
        for entry, end in zip(scenario.squeeze, ends, strict=False):
            piece = _Piece(clock.tick_of(entry.at), end, ramp(grip, entry.value, entry.over), clock.tick_s)
            self._squeeze.append(piece)
            grip = piece.last()

    def sample(self, first_tick: int, ticks: int) -> HandSamples:
        """The hand in ticks ``first_tick … first_tick + ticks − 1``, the same however a run is cut into blocks.

        Before the first segment the hand does not grip and its set angle is 0; after the end of the scenario its last
        segment goes on.
        """
        hand = HandSamples(
            angle=np.zeros(ticks), velocity=np.zeros(ticks), force=np.zeros(ticks),
            motion=np.ones(ticks, dtype=np.bool_), attached=np.zeros(ticks, dtype=np.bool_), squeeze=np.zeros(ticks),
        )  # fmt: skip
        for piece, part, numbers in _parts(self._hand, first_tick, ticks):
            value, rate = piece.at(numbers)
            hand.attached[part] = piece.attached
            hand.motion[part] = piece.motion
            if piece.motion:
                hand.angle[part], hand.velocity[part] = value, rate
            else:
                hand.angle[part], hand.force[part] = piece.angle, value
        for piece, part, numbers in _parts(self._squeeze, first_tick, ticks):
            hand.squeeze[part] = piece.at(numbers)[0]
        return hand


def _hand_pieces(segments: Sequence[Segment], ticks: int, clock: Clock) -> list[_Piece]:
    pieces: list[_Piece] = []
    angle = force = 0.0
    motion = True
    ends = [*(clock.tick_of(segment.at) for segment in segments[1:]), ticks]
    for segment, end in zip(segments, ends, strict=False):
        attached = not isinstance(segment, Release)
        if segment.aim is not None:
            motion = segment.aim.motion
        elif not attached:
            motion = True
        profile = _profile(segment, angle if motion else force)
        piece = _Piece(clock.tick_of(segment.at), end, profile, clock.tick_s, motion, attached, angle)
        pieces.append(piece)
        if motion:
            angle, force = piece.last(), 0.0
        else:
            force = piece.last()
    return pieces


def _parts(pieces: Sequence[_Piece], first: int, ticks: int) -> list[tuple[_Piece, slice, NDArray[np.int64]]]:
    """The pieces that fall into a block, with their place in it and their tick numbers."""
    parts = []
    for k, piece in enumerate(pieces):
        end = piece.end if k + 1 < len(pieces) else first + ticks
        low, high = max(piece.first, first), min(end, first + ticks)
        if low < high:
            parts.append((piece, slice(low - first, high - first), np.arange(low, high, dtype=np.int64)))
    return parts
