"""Layout of the samples in an MCAP chunk, so that numpy can write and read them.

A protobuf message of n doubles is n times a tag byte and a little-endian double, if no field is left out; with the
MCAP header before it, every Message record of a topic has the same length. So the records of a topic are one numpy
array, and where each of them lies in the chunk follows from the topics' rates.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cls_bench.signals import Block, Topic

MAX_SIGNALS = 15
"""Protobuf field numbers up to 15 take one tag byte."""

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


def rows_of(topic: Topic, block: Block) -> NDArray[np.float64]:
    """The samples of ``topic`` in ``block``: the signals and ticks it has, of those that were simulated.

    KeyError if they were not.
    """
    source = block.topic(topic.path)
    rows = block.signals[topic.path]
    if topic.ticks != source.ticks:
        rows = rows[block.row_ticks(source.ticks) % topic.ticks == 0]
    if topic.names != source.names:
        rows = rows[:, [source.names.index(name) for name in topic.names]]
    return rows


class Samples:
    """The Message records of all samples of ``topics`` in a block, sorted by time.

    Channel k + 1 belongs to topic k. ``data`` holds the bytes; ``indexes`` maps the channel to the times and offsets of
    its messages in them.
    """

    def __init__(self, topics: Sequence[Topic], block: Block):
        ticks = np.arange(block.first_tick, block.end_tick)
        sizes = [message_dtype(len(topic.signals)).itemsize for topic in topics]
        lengths = np.stack([(ticks % topic.ticks == 0) * size for topic, size in zip(topics, sizes, strict=True)])
        ends = np.cumsum(lengths.sum(axis=0))
        self._first_tick = block.first_tick
        self._starts = np.concatenate([[0], ends])  # of each tick, and of the one after the last
        before = np.cumsum(lengths, axis=0) - lengths  # of the other topics at the same tick
        room = np.zeros(int(self._starts[-1]), np.uint8)
        self.indexes: dict[int, Index] = {}
        for channel, (topic, size) in enumerate(zip(topics, sizes, strict=True), start=1):
            at = block.row_ticks(topic.ticks)
            offsets = self._starts[at - block.first_tick] + before[channel - 1, at - block.first_tick]
            self.indexes[channel] = np.stack([at * block.clock.tick_ns, offsets], axis=1).astype("<u8")
            if len(at):
                records = _records(channel, topic, at, rows_of(topic, block))
                anywhere: Any = np.ndarray((len(room) - size + 1,), f"V{size}", room, strides=(1,))
                anywhere[offsets] = records.view(f"V{size}")
        self.data = room.tobytes()

    def position(self, tick: int) -> int:
        """Offset in ``data`` at which the records of ``tick`` start; the end, or 0, for a tick outside of the block."""
        return int(self._starts[min(max(tick - self._first_tick, 0), len(self._starts) - 1)])


def _records(
    channel: int, topic: Topic, ticks: NDArray[np.int64], rows: NDArray[np.float64]
) -> NDArray[np.void]:
    """The Message records of a topic's rows."""
    records = np.zeros(len(ticks), message_dtype(len(topic.signals)))
    records["opcode"] = Opcode.MESSAGE
    records["length"] = records.itemsize - 9  # MCAP does not count opcode and length
    records["channel"] = channel
    records["sequence"] = ticks // topic.ticks
    records["log_time"] = records["publish_time"] = ticks * topic.tick_ns
    records["signals"]["tag"] = tags(len(topic.signals))
    records["signals"]["value"] = rows
    return records
