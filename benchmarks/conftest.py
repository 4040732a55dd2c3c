"""Interleaved measurement, and the table of ratios that ``make bench`` prints."""

import os
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from cls_bench.text import between_marks

PAGE = Path(__file__).parents[1] / "docs" / "performance.md"
TABLE_STARTS, TABLE_ENDS = "<!-- ratios: begin -->\n", "<!-- ratios: end -->\n"

Action = Callable[[], Any]


class Figure(NamedTuple):
    """A line of the table."""

    key: str
    meaning: str
    value: float
    unit: str
    target: str
    met: bool
    detail: str

    @property
    def cells(self) -> tuple[str, ...]:
        verdict = "" if not self.target else "met" if self.met else "missed"
        return self.key, self.meaning, f"{self.value:.3g}{self.unit}", self.target, verdict, self.detail


FIGURES: list[Figure] = []


FOREIGN = 0.08
"""Share of one core that other processes may take in a round that counts."""


WORKERS: set[int] = set()
"""Process numbers of our own workers that run."""


def _of_workers() -> float:
    """Seconds of processor time that our own workers have taken."""
    ticks = 0
    for number in WORKERS:
        fields = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return ticks / os.sysconf("SC_CLK_TCK")


def _foreign_cpu() -> float:
    """Seconds of processor time that others have taken so far; 0 where the system does not say."""
    stat = Path("/proc/stat")
    if not stat.exists():
        return 0.0
    user, nice, system, _, _, irq, soft, steal = map(int, stat.read_text().split()[1:9])
    busy = (user + nice + system + irq + soft + steal) / os.sysconf("SC_CLK_TCK")
    return busy - sum(os.times()[:4]) - _of_workers()


class Comparison:
    """Runs actions in turn, again and again, so that whatever else the machine does falls on all of them alike."""

    def __init__(self, benchmark: Any):
        self._benchmark = benchmark
        self._note = ""

    def times(self, actions: Mapping[str, Action], rounds: int, *, warm_up: int = 1) -> dict[str, list[float]]:
        """Seconds of each action in each round; an action may return its own measurement instead.

        Rounds in which other processes took more than :data:`FOREIGN` of a core are left out, if three are left.
        """
        found: dict[str, list[float]] = {name: [] for name in actions}
        calm: list[bool] = []

        def one_round() -> None:
            before = _foreign_cpu(), time.perf_counter()
            for name, action in actions.items():
                start = time.perf_counter()
                answer = action()
                found[name].append(answer if isinstance(answer, float) else time.perf_counter() - start)
            calm.append(_foreign_cpu() - before[0] < FOREIGN * (time.perf_counter() - before[1]))

        self._benchmark.pedantic(one_round, rounds=rounds, iterations=1, warmup_rounds=warm_up)
        chosen = [k for k in range(warm_up, len(calm)) if calm[k]]
        if len(chosen) < min(3, rounds):
            chosen = list(range(warm_up, len(calm)))
            self._note = "on a busy machine"
        return {name: [values[k] for k in chosen] for name, values in found.items()}

    def record(
        self, key: str, meaning: str, value: float, *, unit: str = "", most: float | None = None,
        least: float | None = None, detail: str = "",
    ) -> None:  # fmt: skip
        """Put a figure into the table. A missed target is said there; it fails no one's build on a busy machine."""
        target = f"≤ {most:g}{unit}" if most is not None else f"≥ {least:g}{unit}" if least is not None else ""
        met = (most is None or value <= most) and (least is None or value >= least)
        FIGURES.append(Figure(key, meaning, value, unit, target, met, ", ".join(filter(None, (detail, self._note)))))
        self._benchmark.extra_info[meaning] = value


@pytest.fixture
def comparison(benchmark: Any) -> Comparison:
    return Comparison(benchmark)


def ratio(times: Mapping[str, list[float]], over: str, under: str) -> float:
    """Median over the rounds of one action's time over another's in the same round."""
    return statistics.median(a / b for a, b in zip(times[over], times[under], strict=True))


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--write-page", action="store_true", help="put the table into docs/performance.md")


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    if not FIGURES:
        return
    rows = [("", "what", "measured", "target", "", "detail"), *(figure.cells for figure in FIGURES)]
    widths = [max(len(row[k]) for row in rows) for k in range(5)]
    terminalreporter.section("ratios")
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        terminalreporter.write_line("  ".join((*cells, row[5])).rstrip())
    if config.getoption("--write-page"):
        lines = ["| " + " | ".join(row) + " |" for row in rows]
        lines.insert(1, "|---" * 6 + "|")
        table = "\n" + "\n".join(lines) + "\n\n"
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(between_marks(page, TABLE_STARTS, table, TABLE_ENDS), encoding="utf-8")
