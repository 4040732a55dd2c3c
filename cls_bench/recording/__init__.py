"""Recordings: MCAP is the source of truth, Rerun a view derived from the same blocks."""

from cls_bench.recording.mcap_reader import Recording, Series
from cls_bench.recording.mcap_writer import McapRecorder
from cls_bench.recording.recorder import Recorder
from cls_bench.recording.run_info import RunInfo

__all__ = ["McapRecorder", "Recorder", "Recording", "RunInfo", "Series"]
