"""cls-bench: a control loading system test bench without the hardware."""

TYPE_CHECKING = False  # the command line takes over the signals before it imports anything, even typing
if TYPE_CHECKING:
    from typing import Any

    from cls_bench.bench import Bench
    from cls_bench.control.outer_loop import Command, Inputs, OuterLoop
    from cls_bench.experiment import Result, run
    from cls_bench.parameters import Parameters
    from cls_bench.recording import Recording
    from cls_bench.rigs import Rig, load_rig
    from cls_bench.scenario import Scenario, load_scenario, parse_scenario

_HOMES = {
    "Bench": "bench",
    "Command": "control.outer_loop", "Inputs": "control.outer_loop", "OuterLoop": "control.outer_loop",
    "Parameters": "parameters",
    "Recording": "recording",
    "Rig": "rigs", "load_rig": "rigs",
    "Result": "experiment", "run": "experiment",
    "Scenario": "scenario", "load_scenario": "scenario", "parse_scenario": "scenario",
}  # fmt: skip

__all__ = [
    "Bench", "Command", "Inputs", "OuterLoop", "Parameters", "Recording", "Result", "Rig", "Scenario", "load_rig",
    "load_scenario", "parse_scenario", "run",
]  # fmt: skip


def __getattr__(name: str) -> "Any":
    # On first use: the command line's --help must not wait for MuJoCo and numba.
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"cls_bench.{_HOMES[name]}"), name)
