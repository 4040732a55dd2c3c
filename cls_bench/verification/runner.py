"""Runs the cases and gathers their rows."""

import math
import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context, parent_process

from cls_bench.errors import BenchError
from cls_bench.parameters import Parameters
from cls_bench.verification import (
    axes,
    backlash,
    energy_balance,
    four_bar,
    gear,
    limb,
    linearisation,
    load_cell,
    motor,
    outer_loop,
    random_trials,
    stiction,
    whole_plant,
)
from cls_bench.verification.row import Row
from cls_bench.verification.subject import Subject

Case = Callable[[Subject], Iterator[Row]]

CASES: tuple[Case, ...] = (
    gear.lossy_gear_demo, gear.drag_per_direction, gear.efficiency, gear.efficiency_of_rigs, gear.self_locking,
    backlash.gear_demo, backlash.stop_block_demo, backlash.dead_zone,
    stiction.breakaway, stiction.creep, stiction.stick_slip,
    motor.current_step, motor.acts_when_it_flows, motor.envelope, motor.power_balance, motor.temperature,
    load_cell.static, load_cell.filter_step, load_cell.ringing, load_cell.torque_cell,
    limb.resonance, limb.rigid,
    four_bar.free,
    linearisation.frequency_response, linearisation.rigs_in_frequency,
    whole_plant.agreement, whole_plant.closed_loop,
    whole_plant.rigs_agree, whole_plant.shipped_rigs_agree, whole_plant.twins_agree,
    outer_loop.shaking, outer_loop.growing,
    axes.apart,
    energy_balance.balance,
    random_trials.trials,
)  # fmt: skip
"""All cases, in the order of the table."""

_LONG = (
    whole_plant.agreement, random_trials.trials, outer_loop.shaking, whole_plant.rigs_agree,
    whole_plant.shipped_rigs_agree, energy_balance.balance,
)  # fmt: skip
"""Started first, so that no long one is left over at the end."""


def _rows(case: Case, subject: Subject) -> list[Row]:
    """The rows of a case; a single one that falls short if the plant cannot be built or run at all."""
    try:
        return list(case(subject))
    except (BenchError, ValueError, RuntimeError) as error:
        name = f"{case.__module__.rpartition('.')[2]}.{case.__name__}"
        return [Row(name.partition(".")[0], f"{name}: {error}", "", math.nan, "", math.nan, 0.0)]


def _end_with_parent() -> None:
    """In a worker: end when the process that started it is gone, whatever ended it."""

    def wait() -> None:
        parent = parent_process()
        if parent is not None:
            parent.join()
        os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def _signals_blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def verify(
    progress: Callable[[int, int], None] | None = None,
    *,
    cases: Sequence[Case] = CASES,
    alter: Callable[[Parameters], Parameters] | None = None,
    workers: int = 2,
) -> list[Row]:
    """Hold the plant against everything it can be held against; returns the rows of all ``cases`` in their order.

    ``progress(done, total)`` is told of every case that is done. ``alter`` changes the parameters of the plant behind
    the cases' back, to show that they notice. Up to ``workers`` processes share the work; with 1 all is done in this
    one.
    """
    subject = Subject(alter) if alter is not None else Subject()
    report = progress or (lambda done, total: None)
    if workers <= 1:
        rows = []
        for done, case in enumerate(cases, start=1):
            rows += _rows(case, subject)
            report(done, len(cases))
        return rows
    # A fresh interpreter each: forks would share the state of compiled code and of threads.
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_end_with_parent) as pool:
        long_first = sorted(range(len(cases)), key=lambda k: cases[k] not in _LONG)
        with _signals_blocked():  # the workers inherit it: Ctrl-C is this process's
            started: dict[Future[list[Row]], int] = {pool.submit(_rows, cases[k], subject): k for k in long_first}
        found: dict[int, list[Row]] = {}
        try:
            for done, future in enumerate(as_completed(started), start=1):
                found[started[future]] = future.result()
                report(done, len(cases))
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return [row for k in range(len(cases)) for row in found[k]]
