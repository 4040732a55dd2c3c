"""Runs of a laboratory: a hand in closed form and a few changes, on a bench, without a scenario file."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from cls_bench.bench import Bench
from cls_bench.drivers import timed
from cls_bench.hand import HandSamples
from cls_bench.linear.hand import Hand
from cls_bench.pilot import Profile
from cls_bench.signals import Block, Clock


@dataclass(frozen=True)
class Part:
    """What the hand does from a time on."""

    at: float
    """start [s]"""
    profile: Profile
    """angle [rad] or force [N] over the time since then"""


@dataclass(frozen=True)
class Script:
    """A hand that grips as ``hand`` says, does its ``parts`` one after the other, and the ``changes`` meanwhile."""

    hand: Hand
    duration: float
    """[s]"""
    parts: Sequence[Part]
    """an angle where the arm holds its place, a force where it does not; the first at 0, none if the hand is off"""
    changes: Sequence[timed.Change] = ()

    def samples(self, clock: Clock, first: int, ticks: int) -> HandSamples:
        """The hand in ``ticks`` from ``first`` on."""
        value, rate = np.zeros(ticks), np.zeros(ticks)
        starts = [clock.tick_of(part.at) for part in self.parts]
        for part, start, end in zip(self.parts, starts, [*starts[1:], first + ticks], strict=False):
            low, high = max(start, first), min(end, first + ticks)
            if low < high:
                time = np.arange(low - start, high - start, dtype=np.float64) * clock.tick_s
                value[low - first : high - first], rate[low - first : high - first] = part.profile(time)
        arm, none = self.hand.arm, np.zeros(ticks)
        return HandSamples(
            angle=value if arm else none, velocity=rate if arm else none, force=none if arm else value,
            motion=np.full(ticks, arm), attached=np.full(ticks, self.hand.squeeze is not None),
            squeeze=np.full(ticks, self.hand.squeeze or 0.0),
        )  # fmt: skip


def run(bench: Bench, script: Script) -> Iterator[Block]:
    """Run ``script`` on a fresh ``bench`` of one axis; yields and raises as :func:`cls_bench.drivers.timed.run`."""
    return timed.run(bench, partial(script.samples, bench.clock), script.changes, script.duration)
