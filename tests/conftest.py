"""What several test files share."""

import functools
from collections.abc import Callable
from pathlib import Path

import pytest

from cls_bench.experiment import Result, run

Runner = Callable[..., Result]


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Runs a scenario, each combination of name and overrides once in a session: ``recorded("name", "key=value")``."""
    folder: Path = tmp_path_factory.mktemp("recordings")

    @functools.cache
    def runner(name: str, *overrides: str) -> Result:
        return run(name, out=folder, set=overrides, rerun=False)

    return runner
