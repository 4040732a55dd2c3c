"""Scenarios: what the hand does, what changes while a run goes on, and what is checked afterwards."""

from cls_bench.scenario.entries import Change, Check, Controller, DriveStart, ExpectedTrip
from cls_bench.scenario.flight import Flight
from cls_bench.scenario.reading import load_scenario, parameters_of, parse_scenario
from cls_bench.scenario.record import Record
from cls_bench.scenario.scenario import Scenario
from cls_bench.scenario.schema import scenario_schema
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
    "Aim", "Change", "Check", "Chirp", "Controller", "DriveStart", "ExpectedTrip", "Flight", "Hold", "Ramp", "Record",
    "Release", "Samples", "Scenario", "Segment", "Sine", "Squeeze", "Step", "load_scenario", "parameters_of",
    "parse_scenario", "scenario_schema",
]  # fmt: skip
