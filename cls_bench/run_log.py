"""What the log of a run says of limits and trips, from what the tick noted."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cls_bench.control.limits import LIMITS
from cls_bench.control.plc import TRIPS
from cls_bench.signals import TOPIC, Clock, Event

QUIET = 0.1
"""Time [s] without the limit after which its next occurrence is a new one."""

DEGREES, SI = 180.0 / math.pi, 1.0


class _Words(NamedTuple):
    source: str
    begins: str
    """with the amount asked for and the limit"""
    over: str
    scale: float
    unit: str


_WORDS = {
    "load_cell": _Words("load cell", "saturated: {} on a range of {}", "saturated", SI, "N"),
    "set_angle": _Words("plc", "set angle held at the software limit: {} asked for, {} allowed",
                        "set angle held at the software limit", DEGREES, "°"),
    "speed": _Words("drive", "speed limit: {} asked for, {} allowed", "at the speed limit", SI, "rad/s"),
    "torque": _Words("drive", "torque limit: {} asked for, {} allowed", "at the torque limit", SI, "N·m"),
    "current": _Words("drive", "current limit: {} asked for, {} allowed", "at the current limit", SI, "A"),
    "voltage": _Words("drive", "voltage limit: {} asked for, {} there", "at the voltage limit", SI, "V"),
    "travel": _Words("column", "beyond its travel: {}, travel {}", "beyond its travel", DEGREES, "°"),
    "bus": _Words("field bus", "a frame was lost", "", SI, ""),
}  # fmt: skip


class Trip(NamedTuple):
    """The PLC switched the drive off."""

    tick: int
    reason: str
    """one of :data:`cls_bench.control.plc.TRIPS`"""
    message: str
    tick_ns: int
    """length of a tick [ns]"""
    axis: str = ""
    """whose drive; empty if there is one alone"""

    @property
    def time(self) -> float:
        """Time since the start of the run [s]."""
        return self.tick * self.tick_ns / 1e9

    @property
    def event(self) -> Event:
        """What the log says of it."""
        return Event(self.tick, "error", source_of(self.axis, _SAFETY), self.message, self.tick_ns)


_SAFETY = "safety"


def source_of(axis: str, source: str) -> str:
    """Who an event is from: of several axes it says which."""
    return f"{axis} {source}" if axis else source


_TRIPPED = "safe torque off: "
_TRIP_TEXTS = {
    "limit_switch": "limit switch open",
    "following_error": "following error too large",
    "invalid_value": "{} is not a finite number",
}


def trip(clock: Clock, axis: str, tick: int, reason: int, invalid: str) -> Trip:
    """The trip of number ``reason`` in the PLC; ``invalid`` names the number that was not finite, if that was why."""
    text = _TRIPPED + _TRIP_TEXTS[TRIPS[reason]].format(invalid)
    return Trip(tick, TRIPS[reason], text, clock.tick_ns, axis)


def trip_of(event: Event) -> Trip | None:
    """The trip back from its event; None if the event is none."""
    axis, _, source = event.source.rpartition(" ")
    if (event.level, source) != ("error", _SAFETY) or not event.message.startswith(_TRIPPED):
        return None
    for reason, text in _TRIP_TEXTS.items():
        if event.message.endswith(text.removeprefix("{}")):
            return Trip(event.tick, reason, event.message, event.tick_ns, axis)
    return None


class _Episode(NamedTuple):
    first: int
    last: int
    ticks: float
    peak: float


class LimitLog:
    """Makes events of the rows of an axis's ``/limits``: a warning when one is reached, a line when that is over."""

    def __init__(self, clock: Clock, axis: str = "") -> None:
        self._clock, self._axis = clock, axis
        self.path = f"/{axis}/limits" if axis else "/limits"
        """of the topic"""
        self._quiet = round(QUIET / clock.plc_s) * clock.plc_ticks
        self._open: dict[str, _Episode] = {}

    def reset(self) -> None:
        """Forget what is open, as before a run."""
        self._open.clear()

    def read(self, first_tick: int, end_tick: int, rows: NDArray[np.float64], watch: Any) -> list[Event]:
        """Events of the block whose ``/limits`` are ``rows``; clears the amounts that no row is to come of.

        Of limits that are reached several times within a block, the greatest amount of the block is told each time.
        """
        events: list[Event] = []
        if self._open or rows.any():
            start = -(-first_tick // self._clock.plc_ticks) * self._clock.plc_ticks
            for number, name in enumerate(LIMITS):
                peak, limit = float(watch.peak[number]), float(watch.limit[number])
                self._read(name, start, rows[:, number], peak, limit, events)
                if name in self._open and self._open[name].last + self._quiet < end_tick:
                    events.append(self._end(name, self._open[name].last + self._quiet))
            watch.peak[np.asarray(watch.ticks) == 0.0] = 0.0
        return events

    def finish(self, last_tick: int) -> list[Event]:
        """Events of what goes on when the run ends."""
        return [self._end(name, last_tick) for name in tuple(self._open)]

    def _event(self, tick: int, level: str, name: str, text: str) -> Event:
        return Event(tick, level, source_of(self._axis, _WORDS[name].source), text, self._clock.tick_ns)

    def _read(
        self, name: str, start: int, shares: NDArray[np.float64], peak: float, limit: float, events: list[Event]
    ) -> None:
        for row in np.flatnonzero(shares).tolist():
            cycle = self._clock.plc_ticks
            tick, ticks = start + row * cycle, float(shares[row]) * cycle
            going_on = self._open.get(name)
            if going_on is not None and tick - going_on.last > self._quiet:
                events.append(self._end(name, going_on.last + self._quiet))
                going_on = None
            if going_on is None:
                words = _WORDS[name]
                amounts = _amount(peak, words), _amount(limit, words)
                events.append(self._event(tick, "warning", name, words.begins.format(*amounts)))
                going_on = _Episode(tick, tick, 0.0, 0.0)
            self._open[name] = _Episode(going_on.first, tick, going_on.ticks + ticks, max(peak, going_on.peak))

    def _end(self, name: str, tick: int) -> Event:
        episode, words, clock = self._open.pop(name), _WORDS[name], self._clock
        since = f"since t = {clock.time(episode.first):.4f} s"
        if name == "bus":  # two frames a cycle
            lost = round(2.0 * episode.ticks / clock.bus_ticks)
            return self._event(tick, "info", name, f"{lost} {'frames' if lost > 1 else 'frame'} lost {since}")
        text = f"{words.over} for {episode.ticks * clock.tick_s:.4g} s {since}, at most {_amount(episode.peak, words)}"
        return self._event(tick, "info", name, text)


def _amount(value: float, words: _Words) -> str:
    return f"{value * words.scale:.4g}{'' if words.unit == '°' else ' '}{words.unit}"


assert TOPIC["/limits"].names == LIMITS
