"""Ctrl-C, SIGTERM and SIGHUP end a command at any moment with one line, code 130, and what was recorded."""

import random
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

from cls_bench.recording import Recording

LONG = 'title = "long"\nduration = 3000.0\n[[hand]]\nat = 0.0\nkind = "hold"\nangle_deg = 3.0\n'
STILL = "from cls_bench import Command\nclass Loop:\n    def step(self, inputs): return Command(0.0)\n"


def start(*arguments: object, ignored: int | None = None) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "cls_bench", *map(str, arguments)]
    return subprocess.Popen(
        command, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        preexec_fn=(lambda: signal.signal(ignored, signal.SIG_IGN)) if ignored else None,  # noqa: PLW1509
    )  # fmt: skip


def wait_for(folder: Path, size: int) -> None:
    deadline = time.monotonic() + 120.0
    while time.monotonic() < deadline:
        if any(path.stat().st_size > size for path in folder.glob("*.mcap")):
            return
        time.sleep(0.02)
    raise TimeoutError


def kept(folder: Path) -> Recording:
    (path,) = folder.glob("*.mcap")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Recording(path)


@pytest.fixture
def long(tmp_path: Path) -> Path:
    (tmp_path / "long.toml").write_text(LONG)
    (tmp_path / "loop.py").write_text(STILL)
    return tmp_path / "long.toml"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("own", [False, True], ids=["feel model", "own controller"])
def test_a_signal_ends_a_run_and_says_what_is_kept(long, tmp_path, number, own):
    more = ["--controller", f"{tmp_path}/loop.py:Loop"] if own else []
    process = start("run", long, "--out", tmp_path / "out", "--no-rerun", *more)
    wait_for(tmp_path / "out", 900_000)
    process.send_signal(number)
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (130, "")
    line = errors.strip().splitlines()[-1]
    recording = kept(tmp_path / "out")
    assert line == f"interrupted at t = {recording.duration:g} s; kept: {recording.path}"
    assert recording.status == "interrupted"
    assert recording.duration > 0.2


def test_an_ignored_signal_stays_ignored(long, tmp_path):
    process = start("run", long, "--out", tmp_path / "out", "--no-rerun", ignored=signal.SIGHUP)
    wait_for(tmp_path / "out", 200_000)
    process.send_signal(signal.SIGHUP)
    time.sleep(0.5)
    assert process.poll() is None
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=60)
    assert process.returncode == 130


def test_a_signal_that_comes_twice_is_heard_once(long, tmp_path):
    process = start("run", long, "--out", tmp_path / "out", "--no-rerun")
    wait_for(tmp_path / "out", 500_000)
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGTERM)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert kept(tmp_path / "out").status == "interrupted"


IMPORTING = 0.15
"""Time after which the interpreter has begun to run the command line's own code [s]."""


@pytest.mark.parametrize("phase", range(4))
def test_a_signal_while_things_are_imported_is_one_line(long, tmp_path, phase):
    process = start("run", long, "--out", tmp_path / "out", "--no-rerun")
    time.sleep(IMPORTING + 0.15 * phase)
    process.send_signal((signal.SIGINT, signal.SIGTERM, signal.SIGHUP)[phase % 3])
    output, errors = process.communicate(timeout=60)
    assert (process.returncode, output) == (130, "")
    assert errors.strip().splitlines()[-1].startswith("interrupted")
    assert "Traceback" not in errors


@pytest.mark.slow
@pytest.mark.parametrize("command", ["run", "run with controller", "sweep", "onset", "verify", "gallery", "check"])
def test_signals_at_random_phases(long, tmp_path, command):
    (tmp_path / "s.toml").write_text(
        LONG.replace("3000.0", "1.0") + '[[checks]]\nname = "p"\nmetric = "maximum"\nsignal = "/column.angle"\n'
        "window = [0.0, 1.0]\n"
    )
    (tmp_path / "sweep.toml").write_text(
        'title = "s"\nscenario = "s.toml"\n[[axes]]\nkey = "feel.inertia"\nkind = "range"\n'
        "from = 0.2\nto = 0.6\ncount = 999\n"
    )
    rng = random.Random(command)
    for k in range(9):
        out = tmp_path / f"out{k}"
        arguments = {
            "run": ["run", long, "--out", out], "run with controller": [
                "run", long, "--out", out, "--controller", f"{tmp_path}/loop.py:Loop"
            ],
            "sweep": ["sweep", tmp_path / "sweep.toml", "--out", out], "onset": ["onset"],
            "verify": ["verify"], "gallery": ["gallery", "--out", out],
            "check": ["check", "onset", "--min-ratio", "0.5"],
        }[command]  # fmt: skip
        process = start(*arguments)
        time.sleep(rng.uniform(IMPORTING, 6.0))
        process.send_signal((signal.SIGINT, signal.SIGTERM, signal.SIGHUP)[k % 3])
        _, errors = process.communicate(timeout=60)
        ends = command in ("check", "onset")  # by itself, before a late signal
        assert process.returncode in ((0, 130) if ends else (130,)), errors
        assert "Traceback" not in errors
        assert process.returncode == 0 or errors.strip().splitlines()[-1].startswith("interrupted")
