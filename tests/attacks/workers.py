"""Carries trials out in processes of their own, which may hang, crash or be killed without harm to the others."""

import contextlib
import multiprocessing
import os
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from tests.attacks.trials import (
    MOST_MB,
    Attack,
    LostError,
    Outcome,
    Process,
    Trial,
    UntriedError,
    forget_peak,
    memory_mb,
    own_folder,
)

RECYCLE_MB = 700.0
"""A worker that has become larger than this is replaced before its next trial: its libraries keep memory."""

_SPAWN = multiprocessing.get_context("spawn")


def carry_out(
    attack: Attack, numbers: Sequence[int], *, seed: int, jobs: int, stage: Path, report: Callable[[Outcome], None]
) -> list[Outcome]:
    """Carry out the trials ``numbers`` of ``attack``, ``jobs`` at once; tells ``report`` of each when it has ended."""
    done: list[Outcome] = []
    waiting = list(reversed(numbers))
    workers: list[_Worker] = []
    prepared = _Worker(attack, seed, stage)
    try:
        outcome = prepared.carry_out_and_wait(-1)
        if outcome.state != "survived":
            raise RuntimeError(f"{attack.name}: cannot be prepared: {outcome.what}")
        workers = [prepared, *(_Worker(attack, seed, stage) for _ in range(min(jobs, len(numbers)) - 1))]
        busy: set[_Worker] = set()
        while waiting or busy:
            for k, idle in enumerate(workers):
                if waiting and idle not in busy:
                    if idle.size_mb() > RECYCLE_MB:
                        idle.end()
                        workers[k] = _Worker(attack, seed, stage)
                    workers[k].start(waiting.pop())
                    busy.add(workers[k])
            wait([worker.connection for worker in busy], timeout=0.2)
            for worker in tuple(busy):
                outcome_now = worker.outcome()
                if outcome_now is None:
                    continue
                busy.remove(worker)
                if not worker.alive:
                    workers[workers.index(worker)] = _Worker(attack, seed, stage)
                done.append(outcome_now)
                report(outcome_now)
    finally:
        for worker in {prepared, *workers}:
            worker.end()
    return sorted(done, key=lambda outcome: outcome.number)


class _Worker:
    """A process that carries out one trial after the other."""

    def __init__(self, attack: Attack, seed: int, stage: Path):
        self.connection, theirs = _SPAWN.Pipe()
        self.alive = True
        self._attack = attack
        self._process: Any = _SPAWN.Process(target=_work, args=(attack.name, seed, stage, theirs))
        self._process.start()
        theirs.close()
        self._number = -1
        self._started = 0.0

    def start(self, number: int) -> None:
        self._number, self._started = number, time.monotonic()
        self.connection.send(number)

    def outcome(self) -> Outcome | None:
        """What became of the trial; None while it goes on."""
        seconds = time.monotonic() - self._started
        with contextlib.suppress(EOFError):
            if self.connection.poll():
                outcome: Outcome = self.connection.recv()
                return outcome
            if seconds < self._attack.time_limit and memory_mb(self._process.pid) < 2 * MOST_MB:
                return None
        what = (
            f"takes more than {2 * MOST_MB:.0f} MB" if memory_mb(self._process.pid) >= 2 * MOST_MB
            else f"hangs for {seconds:.0f} s" if self._process.is_alive()
            else f"ends the interpreter, exit code {self._process.exitcode}"
        )  # fmt: skip
        self.end()
        return Outcome(self._attack.name, self._number, "lost", what, seconds)

    def size_mb(self) -> float:
        return memory_mb(self._process.pid, "VmRSS")

    def carry_out_and_wait(self, number: int) -> Outcome:
        self.start(number)
        while (outcome := self.outcome()) is None:
            time.sleep(0.05)
        return outcome

    def end(self) -> None:
        self.alive = False
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._process.pid, signal.SIGKILL)  # it holds nothing that has to be saved
        self._process.join()
        self.connection.close()


def _work(name: str, seed: int, stage: Path, connection: Connection) -> None:
    """The worker's side: trial -1 prepares the stage."""
    from tests.attacks.kinds import ATTACKS

    attack = ATTACKS[name]
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, who ends the workers
    with contextlib.suppress(EOFError):
        while True:
            connection.send(_outcome(attack, connection.recv(), seed, stage))


def _outcome(attack: Attack, number: int, seed: int, stage: Path) -> Outcome:
    start = time.monotonic()
    forget_peak()
    Process.largest_mb = 0.0
    state, what = "survived", ""
    with own_folder(stage, number) as folder:
        try:
            if number < 0:
                attack.prepare(stage)
            else:
                rng = np.random.default_rng([seed, number])
                what = attack.trial(Trial(number, rng, folder, stage))
        except LostError as error:
            state, what = "lost", str(error)
        except UntriedError as error:
            state, what = "untried", str(error)
        except Exception as error:  # the checks themselves failed: that is no success
            place = traceback.extract_tb(error.__traceback__)[-1]
            state, what = "lost", f"{type(error).__name__} at {Path(place.filename).name}:{place.lineno}: {error}"[:500]
    peak = max(memory_mb(), Process.largest_mb)
    if state == "survived" and peak > MOST_MB:
        state, what = "lost", f"takes {peak:.0f} MB: {what}"
    return Outcome(attack.name, number, state, what, time.monotonic() - start, peak)


@contextlib.contextmanager
def stage_folder() -> Iterator[Path]:
    """A folder for all trials of one attack."""
    folder = Path(tempfile.mkdtemp(prefix="cls-bench-attacks-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
