"""Runs some ticks as plain Python and prints what each of them called, in order; run with NUMBA_DISABLE_JIT=1."""

import json
import sys
from types import FrameType
from typing import Any

from cls_bench import tick
from cls_bench.bench import Bench
from cls_bench.compiled import JIT
from cls_bench.parameters import Parameters, Rates, Simulation
from tests.running import advanced

RATES = Rates(
    current_cycle=50e-6, velocity_cycle=100e-6, position_cycle=200e-6, bus_cycle=150e-6, plc_cycle=300e-6
)  # fmt: skip
"""Every cycle another number of ticks: 2, 4, 3 and 6."""

_LATCHES = {4: "commands", 2: "feedback", 1: "voltages"}


def traced(ticks: int, substeps: int) -> list[list[str]]:
    """What each tick called: functions as ``module.name``, of writing to a latch which, MuJoCo's step."""
    p = Parameters(rates=RATES, simulation=Simulation(substeps=substeps))
    bench = Bench(p)
    called: list[list[str]] = []

    def note(name: str) -> None:
        if called:
            called[-1].append(name)

    def watch(frame: FrameType, event: str, argument: Any) -> None:
        if event == "c_call" and argument.__name__ == "mj_step":
            note("mj_step")
        if event != "call" or not frame.f_globals["__name__"].startswith("cls_bench."):
            return
        name = f"{frame.f_globals['__name__'].removeprefix('cls_bench.')}.{frame.f_code.co_name}"
        if name == "control.latch.write":
            name = f"{name} {_LATCHES[frame.f_locals['latch'].shape[1]]}"
        note(name)

    due: Any = tick.Due

    def begins(*cycles: bool) -> Any:
        """What the loop makes first in each tick."""
        called.append([])
        return due(*cycles)

    tick.Due = begins  # type: ignore[assignment, misc]
    blocks = advanced(bench, ticks * bench.clock.tick_s)
    sys.setprofile(watch)
    try:
        list(blocks)
    finally:
        sys.setprofile(None)
    return called


if __name__ == "__main__":
    assert not JIT
    print(json.dumps(traced(int(sys.argv[1]), int(sys.argv[2]))))
