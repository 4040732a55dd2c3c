"""(f) start-up, each against Python's own start and the import of MuJoCo and numba, as whole processes."""

import os
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

from benchmarks.conftest import Comparison
from benchmarks.scenarios import OSCILLATION, SWAY

CLS_BENCH = (sys.executable, "-c", "from cls_bench.cli import main; main()")


def _call(*command: str, **environment: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | environment)
    return done.stderr


def test_start_up(comparison: Comparison, tmp_path: Path) -> None:
    plain, filtered = tmp_path / "plain.toml", tmp_path / "filtered.toml"
    plain.write_text(SWAY.format(duration=1.0))
    filtered.write_text((SWAY + OSCILLATION).format(duration=1.0))
    cache = tmp_path / "cache"
    said: list[str] = []

    def again(scenario: Path = plain) -> None:
        run = (*CLS_BENCH, "run", str(scenario), "--out", str(tmp_path / "out"), "--no-rerun")
        said.append(_call(*run, NUMBA_CACHE_DIR=str(cache)))

    def first() -> None:
        shutil.rmtree(cache, ignore_errors=True)
        again()

    times = comparison.times(
        {
            "python": lambda: _call(sys.executable, "-c", "pass"),
            "imports": lambda: _call(sys.executable, "-c", "import mujoco, numba"),
            "help": lambda: _call(*CLS_BENCH, "--help"),
            "first": first,
            "again": again,
            "filtered": lambda: again(filtered),
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
    comparison.record(
        "f", "run of 1 s from warm cache", middle["again"], unit=" s", most=2.0,
        detail=f"{middle['filtered']:.2f} s with a metric that filters, which imports scipy.signal",
    )  # fmt: skip
    comparison.record("f", "compilation, once, announced", middle["first"] - middle["again"], unit=" s", most=15.0)
