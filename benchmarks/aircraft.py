"""The aircraft's bands, measured: ``python -m benchmarks.aircraft docs/aircraft.md`` runs the scenarios, 50 s.

It replaces what stands between the page's two marks.
"""

import sys
import tempfile
from pathlib import Path

from cls_bench.aircraft import load_aircraft
from cls_bench.aircraft.page import between
from cls_bench.experiment import run
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import load_scenario
from cls_bench.text import between_marks

STARTS, ENDS = "<!-- measured: begin -->\n", "<!-- measured: end -->\n"


def table() -> str:
    """Every band of every shipped aircraft's scenario with what the bench measures."""
    lines = ["| scenario | band | limits | measured |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder:
        for name in shipped_scenarios():
            scenario = load_scenario(name)
            choice = scenario.aircraft
            if choice is None:
                continue
            result = run(scenario, out=Path(folder), rerun=False)
            setting = load_aircraft(choice.name).setting(choice.axis, choice.condition)
            for limits in setting.limits(scenario.the_rig.parameters):
                value = f"{result[limits.name]:.4g} {limits.unit}".replace("deg", "°")
                lines.append(f"| `{name}` | {limits.name} | {between(limits)} | {value} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    target = Path(sys.argv[1])
    page = target.read_text(encoding="utf-8")
    target.write_text(between_marks(page, STARTS, f"\n{table()}\n", ENDS), encoding="utf-8")
