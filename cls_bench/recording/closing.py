"""Ends a recording whose process was killed: what is complete stays, and the file says how the run ended."""

import os
import struct
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import DataEnd, Footer, Metadata
from mcap.writer import MCAP0_MAGIC

from cls_bench.errors import OutputError
from cls_bench.recording.mcap_writer import RESULT_METADATA

_HEAD = struct.Struct("<BQ")  # opcode and length of a record


def close_cut(path: Path, status: str) -> bool:
    """Take a torn record off the end of ``path`` and close the file with ``status``, without a summary.

    Does nothing if the file was closed already, or is none of ours; returns whether it was closed here. Raises
    OutputError.
    """
    try:
        with path.open("r+b") as file:
            end = file.seek(0, os.SEEK_END)
            file.seek(0)
            if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                return False
            at = len(MCAP0_MAGIC)
            while at + _HEAD.size <= end:
                file.seek(at)
                opcode, length = _HEAD.unpack(file.read(_HEAD.size))
                if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                    return False
                if opcode == 0 or at + _HEAD.size + length > end:
                    break
                at += _HEAD.size + length
            builder = RecordBuilder()
            for record in (
                Metadata(name=RESULT_METADATA, metadata={"status": status}),
                DataEnd(data_section_crc=0),
                Footer(summary_start=0, summary_offset_start=0, summary_crc=0),
            ):
                record.write(builder)
            file.seek(at)
            file.truncate()
            file.write(bytes(builder.end()) + MCAP0_MAGIC)  # type: ignore[no-untyped-call]
            return True
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}") from None
