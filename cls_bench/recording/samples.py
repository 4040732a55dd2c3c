"""Samples from protobuf messages of doubles, many at a time."""

import struct
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cls_bench.recording.layout import FIELD_BYTES, MESSAGE_HEAD_BYTES
from cls_bench.recording.mcap_file import taken

LONGEST_MESSAGE = 4096
"""Bytes of a message of samples; what is longer is none."""

_LEFT_OUT: np.uint64 = np.uint64(0x7FF8_DEAD_BEEF_0001)
"""Bits of a NaN that stands for a field that is not in its message; no arithmetic makes it."""

_FIXED64 = 1
_WIRE_BYTES = {_FIXED64: 8, 5: 4}  # wire types of fixed length


def decode(
    data: bytes, offsets: NDArray[np.uint64], rows: Mapping[int, int], signals: int
) -> NDArray[np.float64] | None:
    """Samples from the Message records at ``offsets`` of ``data``, shape (signals, messages); None if they are damaged.

    ``rows`` maps the number of a protobuf field to its row in the result. Fields may be in any order, and one that is
    not in ``rows`` is passed over. One that is left out is 0, as proto3 has it, if the writer leaves zeros out; beside
    messages in which zeros are written it was lost, and is NaN.
    """
    values = np.full((signals, len(offsets)), _LEFT_OUT).view(np.float64)
    lengths = taken(data, offsets, 1, "<u8") - np.uint64(MESSAGE_HEAD_BYTES - 9)
    if not len(offsets):
        return values
    if int(lengths.max()) > LONGEST_MESSAGE:
        return None
    by_tag = {number << 3 | _FIXED64: row for number, row in rows.items() if number < 16}
    odd = np.zeros(len(offsets), np.bool_)
    different = np.unique(lengths)
    for length in different.tolist():
        same = slice(None) if len(different) == 1 else np.flatnonzero(lengths == length)
        if length % FIELD_BYTES:
            odd[same] = True
        else:
            odd[same] = _take_doubles(data, offsets[same], int(length) // FIELD_BYTES, by_tag, values, same)
    for message in np.flatnonzero(odd).tolist():
        at = int(offsets[message]) + MESSAGE_HEAD_BYTES
        values.view(np.uint64)[:, message] = _LEFT_OUT
        if not _take_fields(data[at : at + int(lengths[message])], rows, values[:, message]):
            return None
    if len(different) > 1 or odd.any() or int(different[0]) != FIELD_BYTES * signals:
        bits = values.view(np.uint64)
        left_out = bits == _LEFT_OUT
        values[left_out] = np.nan if (bits == 0).any() else 0.0
    return values


def _take_doubles(
    data: bytes, offsets: NDArray[np.uint64], count: int, by_tag: Mapping[int, int], values: NDArray[np.float64],
    columns: slice | NDArray[np.intp],
) -> NDArray[np.bool_]:  # fmt: skip
    """Take ``count`` doubles, each behind a tag of one byte, from each message; returns which have other fields."""
    odd = np.zeros(len(offsets), np.bool_)
    for slot in range(count):
        at = MESSAGE_HEAD_BYTES + slot * FIELD_BYTES
        tags = taken(data, offsets, at, "u1")
        if (tags == tags[0]).all():
            tag = int(tags[0])
            odd |= tag & 7 != _FIXED64 or not 8 <= tag < 128
            if tag in by_tag:
                values[by_tag[tag], columns] = taken(data, offsets, at + 1, "<f8")
            continue
        odd |= (tags & 7 != _FIXED64) | (tags < 8) | (tags > 127)
        found = taken(data, offsets, at + 1, "<f8")
        places = np.arange(values.shape[1])[columns]
        for tag, row in by_tag.items():
            own = tags == tag
            values[row, places[own]] = found[own]
    return odd


def _take_fields(message: bytes, rows: Mapping[int, int], values: NDArray[np.float64]) -> bool:
    """Take the doubles from one message of any fields; False if it is damaged."""
    at = 0
    while at < len(message):
        tag, at = _varint(message, at)
        number, wire = tag >> 3, tag & 7
        if number < 1:
            return False
        if wire in _WIRE_BYTES:
            end = at + _WIRE_BYTES[wire]
        elif wire in (0, 2):
            length, end = _varint(message, at)
            end += length if wire == 2 else 0
        else:
            return False
        if end > len(message):
            return False
        if number in rows:
            if wire != _FIXED64:
                return False
            (values[rows[number]],) = struct.unpack_from("<d", message, at)
        at = end
    return at == len(message)


def _varint(message: bytes, at: int) -> tuple[int, int]:
    """A number of variable length and the place behind it, which is beyond the message if it is not complete."""
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            break
        value |= (message[at] & 0x7F) << shift
        at += 1
        if message[at - 1] < 0x80:
            return value, at
    return value, len(message) + 1
