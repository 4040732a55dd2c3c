"""(f) start-up, each against Python's own start and the import of MuJoCo and numba, as whole processes."""

import os
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

from benchmarks.conftest import Comparison
from benchmarks.scenarios import SWAY

CLS_BENCH = (sys.executable, "-c", "from cls_bench.cli import main; main()")


def _call(*command: str, **environment: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | environment)
    return done.stderr


def test_start_up(comparison: Comparison, tmp_path: Path) -> None:
    scenario = tmp_path / "second.toml"
    scenario.write_text(SWAY.format(duration=1.0))
    cache, out = tmp_path / "cache", str(tmp_path / "out")
    run = (*CLS_BENCH, "run", str(scenario), "--out", out, "--no-rerun")
    said: list[str] = []

    def first() -> None:
        shutil.rmtree(cache, ignore_errors=True)
        said.append(_call(*run, NUMBA_CACHE_DIR=str(cache)))

    def again() -> None:
        said.append(_call(*run, NUMBA_CACHE_DIR=str(cache)))

    times = comparison.times(
        {
            "python": lambda: _call(sys.executable, "-c", "pass"),
            "imports": lambda: _call(sys.executable, "-c", "import mujoco, numba"),
            "help": lambda: _call(*CLS_BENCH, "--help"),
            "first": first,
            "again": again,
        },
        3,
    )
    assert "compiling" in said[0]
    assert "compiling" not in said[1]
    middle = {name: statistics.median(values) for name, values in times.items()}
    base = f"python {middle['python']:.2f} s, import mujoco, numba {middle['imports']:.2f} s"
    comparison.record(
        "f", "--help beyond Python's start", middle["help"] - middle["python"], unit=" s", most=0.3, detail=base
    )
    comparison.record("f", "run of 1 s from warm cache", middle["again"], unit=" s", most=2.0)
    comparison.record("f", "compilation, once, announced", middle["first"] - middle["again"], unit=" s", most=20.0)
