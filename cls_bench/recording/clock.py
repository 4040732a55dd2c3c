"""The clock of a run as each channel of its file says it; what a file says is not believed before it was checked."""

import re
from collections.abc import Iterable, Mapping

from cls_bench.signals import CLOCK, Clock
from cls_bench.text import printable

CLOCK_KEY = "clock"
"""In the metadata of a channel."""


def clock_text(clock: Clock) -> str:
    """``tick_ns=50000 velocity_ticks=4 …``."""
    return " ".join(f"{name}={value}" for name, value in clock._asdict().items())


def parse_clock(text: str) -> Clock:
    """The clock back from :func:`clock_text`. ValueError for one that no bench can have."""
    found = dict(re.findall(r"([a-z_]+)=([0-9]{1,9})(?: |$)", text))
    if tuple(found) != Clock._fields or clock_text(Clock(**{name: int(n) for name, n in found.items()})) != text:
        raise ValueError(f'"{printable(text, 100)}" is none')
    clock = Clock(**{name: int(number) for name, number in found.items()})
    clock.check()
    return clock


def clock_of(channels: Iterable[Mapping[str, str]]) -> Clock:
    """The clock that the metadata of all channels agree on; recordings that say none are of :data:`CLOCK`.

    ValueError if they do not agree, or for a clock that no bench can have.
    """
    said = {metadata.get(CLOCK_KEY) for metadata in channels}
    if len(said) > 1:
        raise ValueError("its topics are of different clocks")
    text = said.pop() if said else None
    return CLOCK if text is None else parse_clock(text)
