"""The closed loop as a user would write it in plain Python: MuJoCo's bindings, and the same laws on plain objects.

Run without numba's compiler. For each line on standard input it runs some ticks and prints the seconds one took.
"""

import json
import sys
import time
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.scenarios import sway
from cls_bench import tick
from cls_bench.bench import Bench
from cls_bench.compiled import JIT
from cls_bench.pilot import HandTimeline
from cls_bench.plant import sensors

TICKS = 400


def plain(record: Any) -> Any:
    """A NumPy record as a plain object with plain numbers; arrays stay."""
    if getattr(record, "dtype", None) is not None and record.dtype.names:
        return SimpleNamespace(**{name: plain(record[name]) for name in record.dtype.names})
    return record if np.ndim(record) else record.item() if hasattr(record, "item") else record


def main() -> None:
    assert not JIT
    scenario = sway(3600)
    bench = Bench(scenario.parameters_at_start(), seed=1)
    bench._start(scenario)
    parameters, state = plain(bench._record), plain(bench._state)
    timeline, first = HandTimeline(scenario), 0
    for _ in sys.stdin:
        hand = tick.Hand.of(timeline.sample(first, TICKS))
        noise = bench._rng.standard_normal((TICKS, sensors.NOISES)).tolist()
        _, trace = bench._buffers(first, TICKS)
        start = time.perf_counter()
        tick.advance(
            bench.plant,
            parameters,
            bench._constants,
            state,
            hand,
            noise,
            trace,
            first,
            TICKS,
            False,
            bench._outer_loop.ask,
        )
        print(json.dumps((time.perf_counter() - start) / TICKS), flush=True)
        first += TICKS


if __name__ == "__main__":
    main()
