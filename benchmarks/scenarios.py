"""What is simulated in the benchmarks."""

from cls_bench.scenario import Scenario, parse_scenario

SWAY = """
title = "The hand sways the column, the drive is on"
duration = {duration}
[[hand]]
at = 0.0
kind = "sine"
amplitude_deg = 8.0
frequency = 1.0
[[checks]]
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
