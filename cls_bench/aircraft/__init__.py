"""Aircraft: files with the feel of real controls in units of the grip, put on any rig; their forces and its reach."""

from cls_bench.aircraft.aircraft import Aircraft, find_aircraft, load_aircraft, parse_aircraft
from cls_bench.aircraft.file import AxisFile, Band, ConditionFile, Number
from cls_bench.aircraft.reach import Reach, reach
from cls_bench.aircraft.setting import Limits, Setting

__all__ = [
    "Aircraft", "AxisFile", "Band", "ConditionFile", "Limits", "Number", "Reach", "Setting", "find_aircraft",
    "load_aircraft", "parse_aircraft", "reach",
]  # fmt: skip
