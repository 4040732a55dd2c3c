"""Processes of one version or another, that measure when they are told to."""

import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from benchmarks.conftest import WORKERS

HERE = Path(__file__).parents[1]
WORKER = Path(__file__).with_name("worker.py")

BEFORE = "94bef35"
"""Commit of the bench of one rig, whose plant MuJoCo stepped with tendons and a closing constraint."""


class Process:
    """A worker; :meth:`measure` has it measure once."""

    def __init__(self, folder: Path, *what: str, **environment: str):
        self._process = subprocess.Popen(
            [sys.executable, str(WORKER), *what], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONPATH": str(folder)} | environment, cwd=folder,
        )  # fmt: skip
        WORKERS.add(self._process.pid)

    def measure(self) -> float:
        """Seconds, as the worker took them."""
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write("\n")
        stdin.flush()
        return float(stdout.readline())

    def close(self) -> None:
        """End it."""
        WORKERS.discard(self._process.pid)
        self._process.communicate("")


@contextmanager
def processes(*arguments: tuple[Path, tuple[str, ...], dict[str, str]]) -> Iterator[list[Process]]:
    """Workers, ended on leaving."""
    with ExitStack() as stack:
        found = []
        for folder, what, environment in arguments:
            found.append(Process(folder, *what, **environment))
            stack.callback(found[-1].close)
        yield found


@contextmanager
def before() -> Iterator[Path]:
    """A folder with the package as it was at :data:`BEFORE`; skips where the history is not there."""
    with tempfile.TemporaryDirectory() as folder:
        archive = Path(folder) / "before.tar"
        command = ["git", "archive", "--output", str(archive), BEFORE, "cls_bench", "models", "scenarios"]
        if subprocess.run(command, cwd=HERE, capture_output=True, check=False).returncode:
            pytest.skip(f"commit {BEFORE} is not in this checkout's history")
        with tarfile.open(archive) as tar:
            tar.extractall(folder, filter="data")
        yield Path(folder)
