"""Several axes in one bench: each moves exactly as it does alone, whatever the others are and do."""

from collections.abc import Iterator, Mapping

import numpy as np

from cls_bench.bench import Bench
from cls_bench.drivers import timed
from cls_bench.parameters import Parameters
from cls_bench.pilot import HandTimeline
from cls_bench.rigs import load_rig
from cls_bench.scenario import Hold, Release, Scenario, Sine, Squeeze, Step
from cls_bench.scenario.segments import Ramp
from cls_bench.verification.reading import Array
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

GROUP = "several axes"

DURATION = 1.0

HANDS: Mapping[str, Scenario] = {
    "pitch": Scenario(title="pitch", duration=DURATION, hand=[Sine(at=0.0, amplitude_deg=8.0, frequency=1.5, fade=0.2)],
                      squeeze=[Squeeze(at=0.5, value=1.0)]),
    "roll": Scenario(title="roll", duration=DURATION, hand=[Step(at=0.1, to_N=30.0), Release(at=0.6)]),
    "yaw": Scenario(title="yaw", duration=DURATION,
                    hand=[Hold(at=0.0, angle_deg=0.0), Ramp(at=0.3, to_deg=5.0, over=0.2, smooth=True)]),
}  # fmt: skip
"""What the pilot does with each axis."""

BENCHES: Mapping[str, Mapping[str, str]] = {
    "two, column and wheel": {"pitch": "thesis", "roll": "aileron"},
    "three alike": {"pitch": "thesis", "roll": "thesis", "yaw": "thesis"},
    "two stages, one, and none": {"pitch": "thesis", "roll": "one_stage", "yaw": "direct_drive"},
    "wide-body's column, wheel and pedals": {"pitch": "elevator", "roll": "aileron", "yaw": "rudder"},
}
"""Rigs of the axes, of benches by name."""


def _signals(parameters: Mapping[str, Parameters]) -> dict[str, Array]:
    """All that a bench of these axes records, by topic."""
    bench = Bench(parameters, seed=7)
    hands = [HandTimeline(HANDS[axis].on(p)) for axis, p in parameters.items()]
    blocks = list(timed.run(bench, lambda first, ticks: [h.sample(first, ticks) for h in hands], (), DURATION))
    return {topic.path: np.concatenate([block.signals[topic.path] for block in blocks]) for topic in bench.topics}


def apart(subject: Subject) -> Iterator[Row]:
    """Samples of two or three axes in one model that are not, bit for bit, those of each in a bench of its own."""
    for name, rigs in BENCHES.items():
        parameters = {axis: subject.alter(load_rig(rig).parameters) for axis, rig in rigs.items()}
        together = _signals(parameters)
        alone = [_signals({axis: p}) for axis, p in parameters.items()]
        expected = {path: samples for signals in alone for path, samples in signals.items()}
        differing = sum(
            int(np.count_nonzero(samples.view(np.int64) != expected[path].view(np.int64)))
            for path, samples in together.items()
        )
        total = sum(samples.size for samples in together.values())
        yield Row(GROUP, f"{name}: samples, of {total}, that differ from the axis alone", "1", 0.0, "the axis alone",
                  float(differing + abs(len(together) - len(expected))), 0.0, relative=False)  # fmt: skip
