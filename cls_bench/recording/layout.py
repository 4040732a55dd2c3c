"""Fixed layout of the samples in an MCAP chunk, so that numpy can write and read them.

A protobuf message of n doubles is n times a tag byte and a little-endian double, if no field is left out; with the
MCAP header before it, every Message record of a topic has the same length. The topics' rates divide each other, so the
records of :data:`CYCLE_TICKS` ticks, sorted by time, repeat with the same offsets: they are one row of a numpy array.
"""

import math
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cls_bench.signals import TICK_NS, TOPICS, Block, Topic

CYCLE_TICKS = math.lcm(*(topic.ticks for topic in TOPICS))
"""Ticks after which the pattern of records repeats."""

MAX_SIGNALS = 15
"""Protobuf field numbers up to 15 take one tag byte."""

CHANNEL_IDS = {topic.path: number for number, topic in enumerate(TOPICS, start=1)}
"""MCAP channel (and schema) of each topic of signals."""

Index = NDArray[np.uint64]
"""Content of a MessageIndex record, shape (messages, 2): log time [ns], offset in the uncompressed chunk."""


def message_dtype(signals: int) -> np.dtype[np.void]:
    """Layout of one Message record with ``signals`` doubles."""
    if not 1 <= signals <= MAX_SIGNALS:
        raise ValueError(f"a topic has 1 to {MAX_SIGNALS} signals, not {signals}")
    header = [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4")]
    times = [("log_time", "<u8"), ("publish_time", "<u8")]
    return np.dtype([*header, *times, ("signals", [("tag", "u1"), ("value", "<f8")], (signals,))])


MESSAGE_HEAD_BYTES = message_dtype(1).itemsize - message_dtype(1)["signals"].itemsize
"""Length of a Message record before its data."""


FIELD_BYTES = message_dtype(1)["signals"].itemsize
"""Length of one signal in a Message record: its tag and its double."""


def tags(signals: int) -> NDArray[np.uint8]:
    """Tag bytes of the protobuf fields 1 … ``signals`` of type double (wire type 1)."""
    return np.arange(1, signals + 1, dtype=np.uint8) * np.uint8(8) + np.uint8(1)


def _slot(topic: Topic, tick: int) -> str:
    return f"{topic.path}@{tick}"


def _cycle_dtype() -> np.dtype[np.void]:
    return np.dtype([
        (_slot(topic, tick), message_dtype(len(topic.signals)))
        for tick in range(CYCLE_TICKS) for topic in TOPICS if tick % topic.ticks == 0
    ])  # fmt: skip


def _cycle_template(cycle: np.dtype[np.void]) -> bytes:
    """One cycle with all that does not change from row to row."""
    template: Any = np.zeros((), cycle)
    for topic in TOPICS:
        for tick in range(0, CYCLE_TICKS, topic.ticks):
            record = template[_slot(topic, tick)]
            record["opcode"] = Opcode.MESSAGE
            record["length"] = record.dtype.itemsize - 9  # MCAP does not count opcode and length
            record["channel"] = CHANNEL_IDS[topic.path]
            record["signals"]["tag"] = tags(len(topic.signals))
    return bytes(template.tobytes())


def _offsets(cycle: np.dtype[np.void], topic: Topic) -> NDArray[np.int64]:
    """Offsets of the topic's records in a cycle."""
    fields: Any = cycle.fields
    return np.array([fields[_slot(topic, tick)][1] for tick in range(0, CYCLE_TICKS, topic.ticks)], np.int64)


_CYCLE = _cycle_dtype()
_TEMPLATE = _cycle_template(_CYCLE)
_SLOTS = {topic.path: _offsets(_CYCLE, topic) for topic in TOPICS}
_TICK_STARTS = tuple(
    sum(message_dtype(len(topic.signals)).itemsize * -(-tick // topic.ticks) for topic in TOPICS)
    for tick in range(CYCLE_TICKS)
)


class Samples:
    """The Message records of all samples of a block, sorted by time.

    ``data`` holds the bytes; ``indexes`` maps the channel to the times and offsets of its messages in them.
    """

    def __init__(self, block: Block):
        base = block.first_tick // CYCLE_TICKS
        self._base_tick = base * CYCLE_TICKS
        count = -(-block.end_tick // CYCLE_TICKS) - base
        cycles = np.frombuffer(bytearray(_TEMPLATE * count), _CYCLE)  # np.full takes ten times longer
        starts = self._base_tick + CYCLE_TICKS * np.arange(len(cycles))
        for topic, rows in block:
            self._fill(cycles, starts, topic, rows, block)
        self._front = 0
        self._front, back = self.position(block.first_tick), self.position(block.end_tick)
        self.data = cycles.tobytes()[self._front : back]
        self.indexes = {CHANNEL_IDS[topic.path]: self._index(topic, block) for topic in TOPICS}

    def position(self, tick: int) -> int:
        """Offset in ``data`` at which the records of ``tick`` start."""
        cycle, phase = divmod(tick - self._base_tick, CYCLE_TICKS)
        return cycle * _CYCLE.itemsize + _TICK_STARTS[phase] - self._front

    @staticmethod
    def _fill(
        cycles: NDArray[np.void], starts: NDArray[np.int64], topic: Topic, rows: NDArray[np.float64], block: Block
    ) -> None:
        """Write a topic's rows into whole cycles; what lies outside of the block is cut off later."""
        slots = CYCLE_TICKS // topic.ticks
        padded = np.zeros((len(cycles) * slots, len(topic.signals)))
        if len(padded):
            skipped = -(-block.first_tick // topic.ticks) - int(starts[0]) // topic.ticks
            padded[skipped : skipped + topic.rows(block.first_tick, block.ticks)] = rows
        by_slot = padded.reshape(len(cycles), slots, len(topic.signals))
        for slot in range(slots):
            record = cycles[_slot(topic, slot * topic.ticks)]
            ticks = starts + slot * topic.ticks
            record["sequence"] = ticks // topic.ticks
            record["log_time"] = record["publish_time"] = ticks * TICK_NS
            record["signals"]["value"] = by_slot[:, slot]

    def _index(self, topic: Topic, block: Block) -> Index:
        ticks = block.row_ticks(topic.ticks)
        cycle, phase = np.divmod(ticks - self._base_tick, CYCLE_TICKS)
        offsets = cycle * _CYCLE.itemsize + _SLOTS[topic.path][phase // topic.ticks] - self._front
        return np.stack([ticks * TICK_NS, offsets], axis=1).astype("<u8")
