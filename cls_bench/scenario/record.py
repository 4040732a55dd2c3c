"""What of a run is recorded: all signals at their own rates, unless the scenario wants less."""

import math
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Annotated

from pydantic import Field, field_validator

from cls_bench.input.faults import nearest, shown
from cls_bench.input.tables import Strict
from cls_bench.signals import MOST_STAGES, Clock, Topic, topics

SIGNALS = tuple(f"{topic.path}.{name}" for topic in topics(stages=MOST_STAGES) for name in topic.names)
"""Every signal that a bench can record; which of them it does depends on its rig."""

FASTEST = 1e5
"""Greatest rate [Hz]: that of the shortest tick."""


class Record(Strict):
    """Record less than all: fewer signals, or fewer samples of them."""

    signals: list[Annotated[str, Field(max_length=80)]] = Field(default=["*"], min_length=1, max_length=100)
    """signals such as "/column.angle" and patterns such as "/load_cell.*" """
    rate_hz: Annotated[float, Field(ge=1, le=FASTEST)] | None = None
    """greatest sampling rate [Hz], that of the tick over a whole number; slower signals keep their own. That of the
    tick, 20 000 unless the rates say otherwise, if left out"""
    poses: bool = True
    """also the bodies' shapes and motion, which the views of the bench need"""

    @field_validator("signals")
    @classmethod
    def _known(cls, signals: list[str]) -> list[str]:
        for pattern in signals:
            if not any(fnmatchcase(name, pattern) for name in SIGNALS):
                raise ValueError(f"{shown(pattern)} is no signal; {nearest(pattern, SIGNALS)}")
        return signals

    def check(self, clock: Clock) -> None:
        """Raise ValueError unless ``rate_hz`` is one at which a bench of that clock can be sampled."""
        fastest, rate = 1e9 / clock.tick_ns, self.rate_hz
        if rate is None:
            return
        if rate > fastest:
            raise ValueError(f"{rate:g} is not valid; give a number ≤ {fastest:g} [Hz], the rate of the tick")
        ticks = fastest / rate
        if abs(ticks - round(ticks)) > 1e-6 * ticks:
            below, above = fastest / math.ceil(ticks), fastest / math.floor(ticks)
            raise ValueError(
                f"{rate:g} Hz is not {fastest:.6g} Hz over a whole number; the nearest are {below:g} and {above:g} Hz"
            )

    def topics(self, all_of_them: Sequence[Topic]) -> tuple[Topic, ...]:
        """The topics as they are recorded, with the signals and ticks that are left of them.

        A topic whose own ticks do not divide those of the rate is sampled a little faster than asked.
        """
        found = []
        for topic in all_of_them:
            ticks = 1 if self.rate_hz is None else round(1e9 / topic.tick_ns / self.rate_hz)
            kept = tuple(s for s in topic.signals if self._wanted(f"{topic.path}.{s.name}", self.signals))
            if kept:
                every = topic.ticks * max(ticks // topic.ticks, 1)
                found.append(replace(topic, ticks=every, signals=kept))
        return tuple(found)

    @staticmethod
    def _wanted(signal: str, patterns: Sequence[str]) -> bool:
        return any(fnmatchcase(signal, pattern) for pattern in patterns)
