"""(c) recording, (e) sweeps on two workers, (g) memory over duration."""

import subprocess
import sys
from pathlib import Path

from benchmarks.conftest import Comparison, ratio
from benchmarks.scenarios import sway
from benchmarks.versions import BEFORE, HERE, before, processes
from cls_bench.sweep.core import evaluate_points
from cls_bench.sweep.runs import ScenarioAt

DURATION = 4.0  # of a worker's run [s]


def test_recording(comparison: Comparison) -> None:
    kinds = ("none", "mcap", "both")
    with before() as old, processes(
        *((HERE, ("run", kind), {}) for kind in kinds), (old, ("run", "mcap"), {})
    ) as workers:  # fmt: skip
        times = comparison.times({n: w.measure for n, w in zip((*kinds, "before"), workers, strict=True)}, 20)
    for name, meaning, most in (("mcap", "run with MCAP", 1.20), ("both", "run with MCAP and .rrd", 1.35)):
        best = min(times[name])
        comparison.record(
            "c", f"{meaning} ÷ without recording", ratio(times, name, "none"), most=most,
            detail=f"{DURATION:g} s in {best:.2f} s: {DURATION / best:.0f} times real time",
        )  # fmt: skip
    comparison.record(
        "c", f"run with MCAP of {BEFORE} ÷ ours", ratio(times, "before", "mcap"), least=1.5,
        detail=f"{DURATION / min(times['before']):.0f} times real time before",
    )  # fmt: skip


def test_sweep_on_two_workers(comparison: Comparison) -> None:
    scenario = sway(1.0)
    evaluate = ScenarioAt(scenario, {})
    points = [{"feel.inertia": 0.3 + 0.01 * k} for k in range(24)]
    times = comparison.times(
        {f"{n}": lambda n=n: _sweep(evaluate, points, n) for n in (1, 2)},  # type: ignore[misc]
        20,
    )
    best = min(times["2"])
    comparison.record(
        "e", "sweep on 1 worker ÷ on 2", ratio(times, "1", "2"), least=1.9,
        detail=f"{len(points)} runs of 1 s in {best:.2f} s on two threads",
    )  # fmt: skip


def _sweep(evaluate: ScenarioAt, points: list[dict[str, float]], workers: int) -> None:
    rows = evaluate_points(evaluate, points, scheduler=f"threads:{workers}")
    assert not any(row.error for row in rows)


PEAK = """
import sys
from pathlib import Path
from benchmarks.scenarios import sway
from cls_bench.experiment import run
run(sway(float(sys.argv[1])), out=Path(sys.argv[2]), rerun=False)
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) / 1024)  # not ru_maxrss, which starts from the parent's
"""


def test_memory_over_duration(comparison: Comparison, tmp_path: Path) -> None:
    def peak(duration: float) -> float:
        command = [sys.executable, "-c", PEAK, str(duration), str(tmp_path)]
        answer = subprocess.run(command, capture_output=True, text=True, check=True, cwd=Path(__file__).parents[1])
        return float(answer.stdout)

    sizes = {duration: peak(duration) for duration in (10.0, 60.0)}
    times = comparison.times({"long": lambda: peak(600.0)}, 1, warm_up=0)
    comparison.record(
        "g", "peak memory of a ten-minute run with MCAP", max(times["long"]), unit=" MB", most=500,
        detail=", ".join(f"{size:.0f} MB for {duration:g} s" for duration, size in sizes.items()),
    )  # fmt: skip
