"""Recordings damaged, rewritten or made to do harm, through the reader, ``report``, ``compare`` and ``view``."""

import html
import json
import re
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tests.attacks import reference
from tests.attacks.in_process import call_here, fake_viewer, guarded
from tests.attacks.mcap_mutations import MARK, mutate
from tests.attacks.trials import PASSED, REFUSED, Attack, LostError, Trial, as_json, call, judge, judge_output

SECONDS = 0.5
TIME_LIMIT = 120.0

SCENARIO = f"""
title = "Attacked"
duration = {SECONDS}
seed = 3

[[hand]]
at = 0.0
kind = "samples"
file = "hand.csv"
unit = "deg"

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
window = [0.1, 0.3]
"""


def prepare(stage: Path) -> None:
    (stage / "attacked.toml").write_text(SCENARIO)
    (stage / "hand.csv").write_text("time,value\n" + "".join(f"{k / 100},{3 * np.sin(k / 8):.4f}\n" for k in range(50)))
    ended = call("run", stage / "attacked.toml", "--out", stage / "alone", "--json", timeout=300)
    judge(ended, {PASSED})
    found = as_json(ended)
    Path(found["recordings"]["mcap"]).rename(stage / "alone.mcap")
    (stage / "alone.json").write_text(json.dumps(found))
    (stage / "canary.csv").write_text((stage / "hand.csv").read_text())


class _Known:
    """The recording as it was, read once a process."""

    stage: Path | None = None
    data = b""
    samples: dict[str, Any]


def _known(stage: Path) -> type[_Known]:
    from cls_bench.recording import Recording

    if _Known.stage != stage:
        _Known.data = (stage / "alone.mcap").read_bytes()
        _Known.samples = Recording(stage / "alone.mcap").read_all()
        _Known.stage = stage
    return _Known


def read(trial: Trial) -> str:
    """Mutate the recording; read it, and carry out one of the commands on it."""
    known = _known(trial.stage)
    canary = trial.stage / "canary.csv"
    kind, name, data = mutate(trial.number, known.data, trial.rng, canary)
    path = trial.folder / "input" / "mutated.mcap"
    path.parent.mkdir()
    path.write_bytes(data)
    del data
    what = f"{kind}: {name}"
    command = ("report", "compare", "view", "reader")[trial.number // 41 % 4]
    try:
        with guarded(trial.folder, canary):
            doubted = _read(path, kind, known.samples)
        if command != "reader":
            with guarded(trial.folder, canary):
                _command(trial, command, path, kind, doubted)
    except LostError as error:
        raise LostError(f"{what}, {command}: {error}") from None
    return f"{what}, {command}"


def _read(path: Path, kind: str, expected: dict[str, Any]) -> bool:
    """Read all there is. Lost if a sample is wrong, or missing without a word; returns whether anything was said."""
    from cls_bench.errors import InputError
    from cls_bench.recording import Recording

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            recording = Recording(path)
            found = recording.read_all()
            recording.events(), recording.poses(), recording.run_info(), recording.duration
            for _ in recording.blocks():
                pass
        except InputError as error:
            if "\n" in str(error) or str(path) not in str(error):
                raise LostError(f"an error that is not one line with the file's name: {str(error)[:200]!r}") from None
            if kind == "rewrite":
                raise LostError(f"refused: {error}") from None
            return True
    doubted = bool(said) or recording.truncated or recording.status != "complete"
    doubted = doubted or bool(getattr(recording, "doubts", ()))
    if kind == "edit":
        return doubted
    if kind == "rewrite" and doubted:
        raise LostError(f"doubted: {[str(warning.message) for warning in said] or recording.status}")
    rows = {topic: _rows(topic, expected[topic], series) for topic, series in found.items() if topic in expected}
    complete = rows == {topic: len(series) for topic, series in expected.items()}
    if not complete and (kind == "rewrite" or not doubted):
        raise LostError(f"samples are missing without a word: {sum(rows.values())} rows in {len(rows)} topics")
    return doubted


def _rows(topic: str, expected: Any, found: Any) -> int:
    """Number of rows, each of which must be one of those that were recorded."""
    time = found.time
    places = np.searchsorted(expected.time, time)
    if len(time) and (np.diff(time) <= 0).any():
        raise LostError(f"{topic}: times do not grow")
    if (places >= len(expected.time)).any() or not np.array_equal(expected.time[places], time):
        raise LostError(f"{topic}: times that were not recorded")
    for name, values in found.values.items():
        if name not in expected.values:
            raise LostError(f"{topic}: signal {name!r} was not recorded")
        if not np.array_equal(values, expected[name][places]):
            raise LostError(f"{topic}.{name}: values that were not recorded")
    return len(time)


def _command(trial: Trial, command: str, path: Path, kind: str, doubted: bool) -> None:
    out, alone = trial.folder / "out", trial.stage / "alone.mcap"
    codes = {PASSED} if kind == "rewrite" else {PASSED, REFUSED}
    with fake_viewer(trial.folder) as shown:
        arguments: list[str | Path] = {
            "report": ["report", path, "--out", out],
            "view": ["view", path],
            "compare": ["compare", alone, path, "--out", out],
        }[command]  # type: ignore[assignment]
        code, text, errors = call_here(*arguments, folder=trial.folder)
    judge_output(code, text, errors, codes)
    if kind == "rewrite" and errors:
        raise LostError(f"said of a recording that is whole: {errors[:200]}")
    if code == REFUSED:
        return
    if command == "view":
        if not shown.exists() or not shown.stat().st_size:
            raise LostError("nothing was shown")
        if kind != "edit" and trial.number % 3 == 0:
            _check_rrd(trial, shown)
        return
    (page,) = out.glob("*.html")
    content = page.read_text(encoding="utf-8")
    if "</html>" not in content:
        raise LostError("the page has no end")
    if re.search(r"<script|<img src=x|<[^>]*onerror=", re.sub(r"<svg.*?</svg>", "", content, flags=re.S)):
        raise LostError("the page carries out what the recording says")
    if command == "report":
        _check_commands(trial, content)
    if kind != "edit" and not doubted and not errors:
        _check_values(trial, command, content if command == "report" else text)


def _check_rrd(trial: Trial, shown: Path) -> None:
    times, values = reference.rrd_table(shown, "/column")
    expected = _known(trial.stage).samples["/column"]
    ticks = np.round(expected.time * 1e9).astype(np.int64)
    places = np.searchsorted(ticks, times)
    table = np.stack(list(expected.values.values()), axis=1)
    if (places >= len(ticks)).any() or not np.array_equal(ticks[places], times) or (
        len(times) and not np.array_equal(values, table[places])
    ):  # fmt: skip
        raise LostError("the .rrd shows values that were not recorded")


def _check_values(trial: Trial, command: str, text: str) -> None:
    """What is shown without a doubt is what the run alone measured."""
    from cls_bench.report.page import number

    text = html.unescape(text).replace("-", "−")
    for name, value in reference.measured(trial.stage).items():
        if number(value) not in text:
            raise LostError(f"{command} shows another value of {name} than {number(value)}, and has no doubt")


def _check_commands(trial: Trial, page: str) -> None:
    """The command that a page offers for copying does nothing but call cls-bench."""
    for block in re.findall(r"<h2>How to run it again</h2>\s*<pre>(.*?)</pre>", page, flags=re.S):
        folder = trial.folder / "copied"
        folder.mkdir(exist_ok=True)
        (folder / "cls-bench").write_text("#!/bin/sh\nexit 0\n")
        (folder / "cls-bench").chmod(0o755)
        subprocess.run(
            ["/bin/sh", "-s"], input=html.unescape(block).encode("utf-8", "replace"), cwd=folder, capture_output=True,
            env={"PATH": f"{folder}:/usr/bin:/bin"}, timeout=20, check=False,
        )  # fmt: skip
        strays = [path.name for path in folder.iterdir() if path.name != "cls-bench"]
        if strays or (trial.folder / MARK).exists():
            raise LostError(f"the command on the page does more than call cls-bench: {html.unescape(block)[:200]!r}")


RECORDINGS = Attack(
    "recording", "mutated recordings", 5000, [k + 41 * (k % 4) for k in range(41)], read, prepare, TIME_LIMIT
)
