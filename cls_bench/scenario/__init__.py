"""Scenarios: what the hand does, what changes while a run goes on, and what is checked afterwards."""

from cls_bench.scenario.record import Record
from cls_bench.scenario.scenario import (
    Change,
    Check,
    DriveStart,
    ExpectedTrip,
    Scenario,
    load_scenario,
    parse_scenario,
    scenario_schema,
    tick_of,
)
from cls_bench.scenario.segments import (
    Aim,
    Chirp,
    Hold,
    Ramp,
    Release,
    Samples,
    Segment,
    Sine,
    Squeeze,
    Step,
)

__all__ = [
    "Aim", "Change", "Check", "Chirp", "DriveStart", "ExpectedTrip", "Hold", "Ramp", "Record", "Release", "Samples",
    "Scenario", "Segment", "Sine", "Squeeze", "Step", "load_scenario", "parse_scenario", "scenario_schema", "tick_of",
]  # fmt: skip
