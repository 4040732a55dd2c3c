"""What is simulated in the benchmarks."""

from benchmarks import worker
from cls_bench.scenario import Scenario, parse_scenario

SWAY = worker.SWAY + """[[checks]]
name = "tracking"
metric = "tracking_error_rms_deg"
window = [0.0, {duration}]
"""

OSCILLATION = """
[[checks]]
name = "oscillation"
metric = "oscillation_amplitude_deg"
window = [0.0, {duration}]
"""


def sway(duration: float) -> Scenario:
    """The column follows a hand that moves by ±8° at 1 Hz: all friction elements slide and stick, all loops work."""
    return parse_scenario((SWAY + OSCILLATION).format(duration=float(duration)), name="sway")
