"""What is missing on a bare machine is said and counted, and where it is meant to be there, its lack is a failure."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import needs

PROJECT = Path(__file__).parent.parent
TESTS = ("tests/test_report.py", "tests/test_rerun_view.py")


def run_tests(**environment: str) -> "subprocess.CompletedProcess[str]":
    """The tests that need something, on a machine that has nothing of it."""
    environment = {**os.environ, "CLS_BENCH_TESTS_WITHOUT": ",".join(needs.NAMES), **environment}
    marked = " or ".join(f"needs_{need}" for need in needs.NAMES)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", marked, *TESTS]
    return subprocess.run(command, cwd=PROJECT, env=environment, capture_output=True, text=True, check=False)


def test_a_bare_machine_skips_them_and_says_how_many_and_what_would_install_it() -> None:
    done = run_tests(CLS_BENCH_TESTS_NEED_ALL="0")
    assert done.returncode == 0, done.stdout
    skipped = done.stdout.splitlines()[-1].split()[0]
    assert int(skipped) >= 8
    expected = (
        f"{skipped} tests skipped for lack of a browser, OpenGL, Vulkan; on Debian: "
        "apt-get install chromium chromium-driver libegl1 libgl1-mesa-dri mesa-vulkan-drivers"
    )
    assert expected in done.stdout.splitlines()


@pytest.mark.parametrize("environment", [{"CLS_BENCH_TESTS_NEED_ALL": "1"}, {"CI": "true"}])
def test_where_all_is_meant_to_be_there_a_skip_is_a_failure(
    environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CLS_BENCH_TESTS_NEED_ALL", raising=False)
    done = run_tests(**environment)
    assert done.returncode == 1
    assert "skipped" not in done.stdout.splitlines()[-1]


@pytest.mark.parametrize("need", sorted(needs.WITHOUT))
def test_what_is_to_be_out_of_reach_is_out_of_reach(need: str) -> None:
    assert not needs.is_there(need)
