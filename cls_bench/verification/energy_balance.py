"""Energy audit of whole runs: the bench as it is used, with drive, hand and stop blocks."""

from collections.abc import Iterator

from cls_bench.analysis import energy
from cls_bench.bench import Bench
from cls_bench.scenario import parse_scenario
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

GROUP = "energy"

RUNS = {
    "hand sweeps ±10°, drive on": """
        duration = 3.0
        [[hand]]
        at = 0.0
        kind = "sine"
        amplitude_deg = 10.0
        frequency = 0.7
        fade = 0.5
    """,
    "back-driven, drive off": """
        duration = 3.0
        [drive]
        power = "off"
        [[hand]]
        at = 0.0
        kind = "sine"
        amplitude_deg = 10.0
        frequency = 0.7
        fade = 0.5
    """,
    "thrown against the stop blocks, drive off": """
        duration = 1.5
        [drive]
        power = "off"
        [[hand]]
        at = 0.0
        kind = "step"
        to_N = 120.0
        [[hand]]
        at = 0.7
        kind = "step"
        to_N = -120.0
    """,
    "unstable, tight grip": """
        duration = 2.0
        [parameters.feel]
        inertia = 0.15
        [[hand]]
        at = 0.0
        kind = "sine"
        amplitude_deg = 5.0
        frequency = 1.0
        fade = 0.3
        [[squeeze]]
        at = 0.5
        value = 1.0
    """,
    "let go at 8°": """
        duration = 2.0
        [[hand]]
        at = 0.0
        kind = "ramp"
        to_deg = 8.0
        over = 0.4
        smooth = true
        [[hand]]
        at = 0.6
        kind = "release"
    """,
}
"""Runs that between them use every element that stores or loses energy."""


def balance(subject: Subject) -> Iterator[Row]:
    """Work in less stored energy and losses, and what a loss ever gave back, both as parts of the throughput."""
    for name, text in RUNS.items():
        scenario = parse_scenario(f'title = "{name}"\nseed = 1\n{text}')
        p = scenario.parameters_at_start()
        audit = energy.audit(Bench(subject.alter(p), seed=scenario.seed).run(scenario), p)
        yield Row(GROUP, f"{name}: energy not accounted for, of the throughput", "1", 0.0, "first law",
                  audit.relative_residual, 0.005, relative=False)  # fmt: skip
        given_back = max(*audit.returned.values(), -min(audit.losses.values())) / audit.throughput
        yield Row(GROUP, f"{name}: most that a loss gave back, of the throughput", "1", 0.0, "second law",
                  given_back, 1e-4, relative=False)  # fmt: skip
