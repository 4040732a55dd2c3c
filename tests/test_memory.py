"""Memory does not grow with a run's duration: what was recorded is on disk, not in memory."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from Linux's /proc")

ROOT = Path(__file__).parents[1]

PEAK = """
import sys
from pathlib import Path
from cls_bench.experiment import run
from cls_bench.scenario import parse_scenario
scenario = parse_scenario('''
title = "Sway"
duration = %s
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 8.0
frequency = 1.0
[[checks]]
name = "tracking"
metric = "tracking_error_rms_deg"
window = [0.0, 2.0]
''')
run(scenario, out=Path(sys.argv[1]), rerun=%s)
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) / 1024)  # not ru_maxrss, which starts from the parent's
"""


def peak_mb(folder: Path, duration: float, *, rerun: bool = False) -> float:
    """Peak resident memory of a process that runs and records ``duration`` [s]."""
    command = [sys.executable, "-c", PEAK % (float(duration), rerun), str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


@pytest.mark.parametrize("rerun", [False, True])
def test_memory_does_not_follow_the_duration(tmp_path: Path, rerun: bool) -> None:
    """20 s more are 43 MB of samples."""
    short, long = (peak_mb(tmp_path, duration, rerun=rerun) for duration in (5.0, 25.0))
    assert long - short < 12.0


@pytest.mark.slow
def test_ten_minutes_stay_under_500_mb(tmp_path: Path) -> None:
    assert peak_mb(tmp_path, 600.0) < 500.0
