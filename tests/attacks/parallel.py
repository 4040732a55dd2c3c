"""Ten at once: processes into one folder, threads of one process, sweeps, reports and galleries."""

import json
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.attacks import reference
from tests.attacks.trials import (
    PASSED,
    REFUSED,
    Attack,
    Ended,
    LostError,
    Process,
    Trial,
    as_json,
    call,
    command_line,
    judge,
)

AT_ONCE = 10
INERTIAS = tuple(round(0.30 + 0.01 * k, 2) for k in range(AT_ONCE))
SECONDS = 0.5

SWEEP = """
title = "Attacked"
scenario = "attacked.toml"
[[axes]]
key = "feel.inertia"
kind = "list"
values = [0.30, 0.31, 0.32]
"""


def prepare(stage: Path) -> None:
    """Each of the ten runs alone, and what it measures."""
    (stage / "attacked.toml").write_text(reference.scenario(SECONDS))
    (stage / "sweep.toml").write_text(SWEEP)
    alone = {}
    for k, inertia in enumerate(INERTIAS):
        ended = call(*_run(stage, stage / "alone", inertia), "--json")
        judge(ended, {PASSED})
        found = as_json(ended)
        alone[inertia] = _values(found)
        (stage / f"run{k}").mkdir()
        shutil.move(found["recordings"]["mcap"], stage / f"run{k}" / "same.mcap")
    if len({tuple(values.items()) for values in alone.values()}) != AT_ONCE:
        raise RuntimeError("the ten runs must measure different values")
    (stage / "alone.json").write_text(json.dumps(list(alone.values())))
    judge(call("sweep", stage / "sweep.toml", "--out", stage / "swept"), {PASSED})


def _run(stage: Path, out: Path, inertia: float) -> list[str | Path]:
    return ["run", stage / "attacked.toml", "--out", out, "--set", f"feel.inertia={inertia}"]


def _values(found: dict[str, Any]) -> dict[str, float]:
    return {name: metric["value"] for name, metric in found["metrics"].items()}


def _alone(stage: Path) -> list[dict[str, float]]:
    found: list[dict[str, float]] = json.loads((stage / "alone.json").read_text())
    return found


def _at_once(commands: Sequence[Sequence[str | Path]], trial: Trial) -> list[Ended]:
    """Start all commands at the same moment, as exactly as a shared file can tell them, and wait for all."""
    gate = trial.folder / "gate"
    wait = (
        "import os, sys, time\nimport cls_bench.experiment, cls_bench.cli\n"
        f"open({str(trial.folder)!r} + '/ready' + str(os.getpid()), 'w').close()\n"
        f"while not os.path.exists({str(gate)!r}): time.sleep(0.002)\n"
    )
    processes = []
    for command in commands:
        full = command_line(*command)
        full[2] = wait + full[2].replace("; ", "\n")
        processes.append(Process(full))
    deadline = time.monotonic() + 60.0
    while len(list(trial.folder.glob("ready*"))) < len(commands) and time.monotonic() < deadline:
        time.sleep(0.02)
    gate.touch()
    return [process.wait(180.0) for process in processes]


def _check_recordings(trial: Trial, out: Path, results: Sequence[tuple[dict[str, float], Path]]) -> None:
    """As many recordings as runs, each with the value it has when run alone."""
    from cls_bench.report.recorded_run import RecordedRun

    for (values, path), expected in zip(results, _alone(trial.stage), strict=True):
        if values != expected:
            raise LostError(f"a run reports {values} instead of {expected}")
        recorded = {check.check.name: check.value for check in RecordedRun(path).checks}
        if recorded != expected:
            raise LostError(f"{path.name} holds {recorded} instead of {expected}")
    for suffix in ("mcap", "rrd"):
        there = list(out.glob(f"*.{suffix}"))
        if len(there) != AT_ONCE:
            raise LostError(f"{len(there)} .{suffix} of {AT_ONCE} runs")
    strays = [path.name for path in out.iterdir() if path.suffix not in (".mcap", ".rrd")]
    if strays:
        raise LostError(f"left behind in the folder: {', '.join(strays[:3])}")


def processes(trial: Trial) -> str:
    """Ten processes record into one folder."""
    out = trial.folder / "out"
    ended = _at_once([[*_run(trial.stage, out, inertia), "--json"] for inertia in INERTIAS], trial)
    for one in ended:
        judge(one, {PASSED})
    found = [as_json(one) for one in ended]
    _check_recordings(trial, out, [(_values(one), Path(one["recordings"]["mcap"])) for one in found])
    return "10 processes into one folder"


THREADS = """
import json, sys, threading
from cls_bench import run

stage, out, *inertias = sys.argv[1:]
results = [None] * len(inertias)
together = threading.Barrier(len(inertias))

def one(k):
    together.wait()
    results[k] = run(f"{stage}/attacked.toml", out=out, set=[f"feel.inertia={inertias[k]}"]).to_json()

threads = [threading.Thread(target=one, args=(k,)) for k in range(len(inertias))]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(json.dumps({"results": results}))
"""


def threads(trial: Trial) -> str:
    """Ten threads of one process record into one folder."""
    out = trial.folder / "out"
    ended = Process([sys.executable, "-c", THREADS, str(trial.stage), str(out), *map(str, INERTIAS)]).wait(180.0)
    judge(ended, {PASSED})
    found = as_json(ended)["results"]
    _check_recordings(trial, out, [(_values(one), Path(one["recordings"]["mcap"])) for one in found])
    return "10 threads into one folder"


def sweeps(trial: Trial) -> str:
    """Ten times the same sweep into one folder: the table is right, and who cannot have the folder is refused."""
    out = trial.folder / "out"
    command = ["sweep", trial.stage / "sweep.toml", "--out", out, "--scheduler", "threads:1"]
    ended = _at_once([command] * AT_ONCE, trial)
    for one in ended:
        judge(one, {PASSED, REFUSED})
    if not any(one.code == PASSED for one in ended):
        raise LostError("none of the ten sweeps was carried out")
    (expected,) = (trial.stage / "swept").rglob("table.parquet")
    tables = list(out.rglob("table.parquet"))
    if not tables or any(table.read_bytes() != expected.read_bytes() for table in tables):
        raise LostError(f"of {len(tables)} tables not all are the one of a sweep alone")
    return f"10 sweeps into one folder, {sum(one.code == PASSED for one in ended)} carried out"


def reports(trial: Trial) -> str:
    """Ten reports into one folder, of recordings of the same name: each page that is named shows its own run."""
    out = trial.folder / "out"
    ended = _at_once([["report", trial.stage / f"run{k}" / "same.mcap", "--out", out] for k in range(AT_ONCE)], trial)
    pages = []
    for one in ended:
        judge(one, {PASSED, REFUSED})
        if one.code == PASSED:
            pages.append(Path(one.out.strip().splitlines()[-1]))
    if not pages:
        raise LostError("none of the ten reports was made")
    for k, one in enumerate(ended):
        if one.code == PASSED:
            text = Path(one.out.strip().splitlines()[-1]).read_text(encoding="utf-8")
            if f"feel.inertia={INERTIAS[k]}" not in text or "</html>" not in text:
                raise LostError(f"the page that is named for feel.inertia={INERTIAS[k]} shows another run")
    return f"10 reports into one folder, {len(pages)} made"


KINDS = (processes, threads, sweeps, reports)


def together(trial: Trial) -> str:
    return KINDS[trial.number % len(KINDS)](trial)


PARALLEL = Attack("parallel", "ten at once", 40, (0, 3), together, prepare)
