"""What several test files share."""

import functools
import signal
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from cls_bench.experiment import Result, run
from tests import needs

needs.put_out_of_reach()

# A shell starts what runs behind it with these ignored, and so would be all that the tests start and interrupt.
for _number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(_number, signal.default_int_handler if _number == signal.SIGINT else signal.SIG_DFL)

Runner = Callable[..., Result]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Runs a scenario, each combination of name and overrides once in a session: ``recorded("name", "key=value")``."""
    folder: Path = tmp_path_factory.mktemp("recordings")

    @functools.cache
    def runner(name: str, *overrides: str) -> Result:
        return run(name, out=folder, set=overrides, rerun=False)

    return runner


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    for need in needs.NAMES:
        if item.get_closest_marker(f"needs_{need}") and not needs.is_there(need):
            (pytest.fail if needs.all_needed() else pytest.skip)(needs.reason(need))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Count the tests that skipped for lack of something, and say how to get it."""
    reasons = Counter(
        report.longrepr[2].removeprefix("Skipped: ") for report in terminalreporter.stats.get("skipped", [])
    )
    lacking = [need for need in needs.NAMES if reasons[needs.reason(need)]]
    if lacking:
        count = sum(reasons[needs.reason(need)] for need in lacking)
        names = ", ".join(needs.NAMES[need] for need in lacking)
        terminalreporter.write_line(
            f"{count} tests skipped for lack of {names}; on Debian: {needs.installs(lacking)}", yellow=True
        )
