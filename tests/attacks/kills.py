"""kill -9 in mid-run, and the signals by which a run is asked to end."""

import os
import signal
import sys
import time
from pathlib import Path

from tests.attacks import reference
from tests.attacks.trials import INTERRUPTED, PASSED, Attack, LostError, Process, Trial, call, command_line, judge

MCAP_LOSS, RRD_LOSS = 0.2, 0.5
"""Of what was announced as simulated, a kill may cost this much [s]."""

DRIVER = """
import sys
from cls_bench.experiment import Progress, run

class Announcer(Progress):
    def advanced(self, simulated_s, real_time_factor):
        print(repr(simulated_s), flush=True)

run(sys.argv[1], out=sys.argv[2], progress=Announcer())
"""


def kill(trial: Trial) -> str:
    """Kill a run by SIGKILL after a random announcement, or at a random moment of its start."""
    out = trial.folder / "out"
    process = Process([sys.executable, "-c", DRIVER, str(trial.stage / "attacked.toml"), str(out)], lines=True)
    pipe = process.process.stdout
    assert pipe is not None
    announced = 0.0
    starting = trial.number % 5 == 4
    awaited = 0 if starting else int(trial.rng.integers(1, reference.SECONDS / 0.2))
    for _ in range(awaited):
        line = pipe.readline()
        if not line:
            break
        announced = float(line)
    time.sleep(trial.rng.uniform(0.0, 2.0 if starting else 0.08))
    process.send(signal.SIGKILL)
    rest = pipe.read().split()  # announced before the kill, read after it
    announced = float(rest[-1]) if rest else announced
    ended = process.wait(60.0)
    if ended.code not in (-signal.SIGKILL, 0):
        raise LostError(f"ended by itself with {ended.code}: {ended.err[-200:]}")
    mcap, rrd = kept = [
        next(iter(out.glob(f"*.{suffix}")), None) if out.exists() else None for suffix in ("mcap", "rrd")
    ]
    if announced and None in kept:
        raise LostError(f"{announced:.2f} s were announced, and there is no recording")
    saved = saved_rrd = 0.0
    if mcap is not None and (announced or mcap.stat().st_size):
        saved = _saved(trial, mcap, ended.code)
    if announced and rrd is not None:
        saved_rrd = reference.compare_rrd(trial.stage, rrd)
    what = f"{announced:.2f} s announced, {saved:.2f} s in the .mcap, {saved_rrd:.2f} s in the .rrd"
    if saved < announced - MCAP_LOSS - 1e-6 or saved_rrd < announced - RRD_LOSS - 1e-3:
        raise LostError(what)
    if mcap is not None and trial.number % 4 == 0:
        judge(call("report", mcap, "--out", trial.folder / "pages"), {PASSED} if saved else {PASSED, 2})
    return what


def _saved(trial: Trial, mcap: Path, code: int) -> float:
    """Duration of what is left, which must be the samples of the run alone; a file without its head is worth 0 s."""
    from cls_bench.errors import InputError

    try:
        # Killed when all was written, and only the process had not yet ended, it may be complete.
        return reference.compare(trial.stage, mcap, {"incomplete", "complete"} if code else {"complete"})
    except InputError as error:
        if mcap.stat().st_size < 100_000:  # killed while the head was written
            return 0.0
        raise LostError(f"the recording cannot be read: {error}") from None


NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

SWEEP = """
title = "Attacked"
scenario = "attacked.toml"
[[axes]]
key = "feel.inertia"
kind = "list"
values = [0.3, 0.35, 0.4]
"""

COMMANDS = ("run", "run", "run", "report", "sweep", "compare", "run", "validate", "run", "list")


def prepare_signals(stage: Path) -> None:
    reference.make(stage)
    (stage / "sweep.toml").write_text(SWEEP)
    for name in set(COMMANDS):
        start = time.monotonic()
        judge(call(*_arguments(name, stage, stage / "timed")), {PASSED})
        (stage / f"{name}.seconds").write_text(f"{time.monotonic() - start}")


def _arguments(name: str, stage: Path, out: Path) -> list[str | Path]:
    return {
        "run": ["run", stage / "attacked.toml", "--out", out],
        "report": ["report", stage / "alone.mcap", "--out", out],
        "compare": ["compare", stage / "alone.mcap", stage / "alone.mcap", "--out", out],
        "sweep": ["sweep", stage / "sweep.toml", "--out", out],
        "validate": ["validate", stage / "attacked.toml"],
        "list": ["list", "--parameters"],
    }[name]  # type: ignore[return-value]


def interrupt(trial: Trial) -> str:
    """Send a command a signal at a random moment from the start of its process to its end."""
    name = COMMANDS[trial.number % len(COMMANDS)]
    number = NUMBERS[trial.number // len(COMMANDS) % len(NUMBERS)]
    out = trial.folder / "out"
    began, begins = os.pipe()
    command = command_line(*_arguments(name, trial.stage, out))
    command[2] = f"import os; os.write({begins}, b'.'); {command[2]}"  # from here on it is our code that runs
    delay = trial.rng.uniform(0.0, 1.05 * float((trial.stage / f"{name}.seconds").read_text()))
    process = Process(command, pass_fds=(begins,))
    os.close(begins)
    os.set_blocking(began, False)
    time.sleep(delay)
    process.send(number)
    try:
        ours = bool(os.read(began, 1))
    except BlockingIOError:
        ours = False
    os.close(began)
    ended = process.wait(60.0)
    what = f"{name}, {number.name} after {delay:.2f} s, exit code {ended.code}"
    if not ours and ended.code not in (INTERRUPTED, PASSED):
        return f"{what}: before Python ran a line of ours"
    try:
        judge(ended, {INTERRUPTED, PASSED})
        for mcap in out.glob("*.mcap") if name == "run" else ():
            saved = reference.compare(trial.stage, mcap, {"interrupted"} if ended.code else {"complete"})
            what += f", {saved:.2f} s kept"
            rrd = mcap.with_suffix(".rrd")
            if rrd.exists() and saved:
                saved_rrd = reference.compare_rrd(trial.stage, rrd)
                if saved_rrd < saved - 0.01:
                    raise LostError(f"the .rrd ends at {saved_rrd:.2f} s, the .mcap at {saved:.2f} s")
    except LostError as error:
        raise LostError(f"{what}: {error}") from None
    return what


KILLS = Attack("kill", "kill -9", 40, (1, 4, 7), kill, reference.make)
SIGNALS = Attack("signal", "signals at random phases", 60, (0, 11, 25, 52), interrupt, prepare_signals)
