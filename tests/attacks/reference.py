"""A run that was left alone, and the comparison of others with it."""

import json
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from tests.attacks.trials import LostError, as_json, call, judge

SECONDS = 8.0
"""Length of the run."""

SCENARIO = f"""
title = "Attacked"
duration = {SECONDS}
seed = 3

[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 4.0
frequency = 1.3
fade = 0.5

[[squeeze]]
at = 0.2
value = 0.5

[[checks]]
name = "peak"
metric = "maximum"
signal = "/column.angle"
window = [0.0, {SECONDS}]
max = 0.2

[[checks]]
name = "effort"
metric = "rms"
signal = "/drive.torque"
window = [0.0, {SECONDS}]
"""


def scenario(seconds: float = SECONDS) -> str:
    """The scenario's text, with another length."""
    return SCENARIO.replace(f"{SECONDS}", f"{seconds}")


def make(stage: Path, seconds: float = SECONDS) -> None:
    """Run the scenario alone; its text, its recording and what it measured stay in ``stage``."""
    (stage / "attacked.toml").write_text(scenario(seconds))
    ended = call("run", stage / "attacked.toml", "--out", stage / "alone", "--json", timeout=300)
    judge(ended, {0})
    found = as_json(ended)
    Path(found["recordings"]["mcap"]).rename(stage / "alone.mcap")
    Path(found["recordings"]["rrd"]).rename(stage / "alone.rrd")
    (stage / "alone.json").write_text(json.dumps(found))


def measured(stage: Path) -> dict[str, float]:
    """What the run alone measured."""
    found = json.loads((stage / "alone.json").read_text())
    return {name: metric["value"] for name, metric in found["metrics"].items()}


def compare(stage: Path, path: Path, statuses: set[str] | None = None) -> float:
    """Lost unless all samples in ``path`` are those of the run alone up to its end; returns its duration [s]."""
    from cls_bench.recording import Recording

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        alone, other = Recording(stage / "alone.mcap"), Recording(path)
        if statuses is not None and other.status not in statuses:
            raise LostError(f"the recording says {other.status!r} instead of {' or '.join(sorted(statuses))}")
        duration = other.duration
        if duration > alone.duration:
            raise LostError(f"the recording is longer than the run: {duration} s")
        if other.status == "complete" and duration != alone.duration:
            raise LostError(f"the recording is called complete and ends at {duration} s")
        if duration == 0.0:
            return 0.0
        if set(other.topics) != set(alone.topics):
            raise LostError(f"topics are missing: {set(alone.topics) - set(other.topics)}")
        for topic in other.topics:
            expected, found = alone.read(topic, end=duration), other.read(topic)
            if not np.array_equal(expected.time, found.time):
                raise LostError(
                    f"{topic} has other times than the run alone: {len(found)} rows instead of {len(expected)}"
                )
            for name, values in expected.values.items():
                if not np.array_equal(values, found[name], equal_nan=True):
                    raise LostError(f"{topic}.{name} has other values than the run alone")
    return float(duration)


def compare_rrd(stage: Path, path: Path, topic: str = "/column") -> float:
    """Lost unless a topic's curves in an .rrd are those of the run alone, without a gap; returns their end [s]."""
    from cls_bench.recording import Recording

    times, values = rrd_table(path, topic)
    if not len(times):
        return 0.0
    expected = Recording(stage / "alone.mcap").read(topic, every=8)
    expected_times = np.round(expected.time * 1e9).astype(np.int64)[: len(times)]
    if not np.array_equal(times, expected_times):
        raise LostError(f"the .rrd has other times than the run alone: {len(times)} rows to {times[-1] / 1e9} s")
    table = np.stack(list(expected.values.values()), axis=1)[: len(times)]
    if values.shape != table.shape or not np.array_equal(values, table):
        raise LostError("the .rrd has other values than the run alone")
    return float(times[-1] / 1e9)


def rrd_table(path: Path, topic: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [ns] and values, shape (rows, signals), of a topic in an .rrd."""
    rows: list[tuple[int, list[float]]] = []
    for batch in _batches(path, topic):
        if "Scalars:scalars" in batch.schema.names and "sim_time" in batch.schema.names:
            times = batch.column("sim_time").cast("int64").to_pylist()
            rows += zip(times, batch.column("Scalars:scalars").to_pylist(), strict=True)
    rows.sort(key=lambda row: row[0])
    return np.array([time for time, _ in rows], np.int64), np.array([value for _, value in rows], np.float64)


def _batches(path: Path, entity: str) -> Iterator[object]:
    from rerun.chunk import RrdReader

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file without an end
        for chunk in RrdReader(str(path)).stream().to_chunks():
            if chunk.entity_path == entity:
                yield chunk.to_record_batch()
