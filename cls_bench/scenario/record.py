"""What of a run is recorded: all signals at their own rates, unless the scenario wants less."""

import math
from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Annotated

from pydantic import Field, field_validator

from cls_bench.scenario.faults import nearest, shown
from cls_bench.scenario.segments import Strict
from cls_bench.signals import TICK_S, TOPICS, Topic

SIGNALS = tuple(f"{topic.path}.{name}" for topic in TOPICS for name in topic.names)

_FASTEST = round(1.0 / TICK_S)


class Record(Strict):
    """Record less than all: fewer signals, or fewer samples of them."""

    signals: list[Annotated[str, Field(max_length=80)]] = Field(default=["*"], min_length=1, max_length=100)
    """signals such as "/column.angle" and patterns such as "/load_cell.*" """
    rate_hz: Annotated[float, Field(ge=1, le=_FASTEST)] = float(_FASTEST)
    """greatest sampling rate [Hz], 20 000 over a whole number; slower signals keep their own"""
    poses: bool = True
    """also the bodies' shapes and motion, which the views of the bench need"""

    @field_validator("signals")
    @classmethod
    def _known(cls, signals: list[str]) -> list[str]:
        for pattern in signals:
            if not any(fnmatchcase(name, pattern) for name in SIGNALS):
                raise ValueError(f"{shown(pattern)} is no signal; {nearest(pattern, SIGNALS)}")
        return signals

    @field_validator("rate_hz")
    @classmethod
    def _whole(cls, rate: float) -> float:
        ticks = _FASTEST / rate
        if abs(ticks - round(ticks)) > 1e-6 * ticks:
            below, above = _FASTEST / math.ceil(ticks), _FASTEST / math.floor(ticks)
            raise ValueError(
                f"{rate:g} Hz is not {_FASTEST} Hz over a whole number; the nearest are {below:g} and {above:g} Hz"
            )
        return rate

    def topics(self) -> tuple[Topic, ...]:
        """The topics as they are recorded, with the signals and ticks that are left of them.

        A topic whose own ticks do not divide those of the rate is sampled a little faster than asked.
        """
        ticks = round(_FASTEST / self.rate_hz)
        found = []
        for topic in TOPICS:
            kept = tuple(s for s in topic.signals if self._wanted(f"{topic.path}.{s.name}", self.signals))
            if kept:
                every = topic.ticks * max(ticks // topic.ticks, 1)
                found.append(replace(topic, ticks=every, signals=kept))
        return tuple(found)

    @staticmethod
    def _wanted(signal: str, patterns: Sequence[str]) -> bool:
        return any(fnmatchcase(signal, pattern) for pattern in patterns)
