"""Where points are evaluated: on threads of this process, or on Dask.

An engine takes numbered points and gives back a row for each, in the order in which they are done. What a point is
evaluated to depends on the point alone, so every engine gives the same rows on any number of workers. A point that
fails is a row with its error.
"""

import hashlib
import logging
import os
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, Protocol

from cls_bench.errors import BenchError, InputError, OutputError
from cls_bench.resources import model_folder

Value = float | int | bool | str | None
"""What a table's cell can hold."""

Point = Mapping[str, Value]
"""Where to evaluate: name -> value."""

Evaluate = Callable[[Point], Mapping[str, Value]]
"""From a point to its results. On Dask it travels to the workers: a function of a module, or an object with
``__call__`` that can be pickled."""


@dataclass(frozen=True)
class Row:
    """What became of a point."""

    index: int
    """number of the point, from 0"""
    point: Point
    values: Mapping[str, Value] = field(default_factory=dict)
    """results by name; empty if it failed"""
    error: str = ""
    """one line that says why it failed"""


Numbered = tuple[int, Point]


class Engine(Protocol):
    """Evaluates points in parallel."""

    @property
    def threads(self) -> int:
        """Threads of this process that evaluate"""
        ...

    @property
    def processes(self) -> int:
        """Processes started for the run that evaluate"""
        ...

    def run(self, evaluate: Evaluate, points: Iterable[Numbered]) -> Generator[Row, None, None]:
        """Rows as they are done; when the iterator is closed, points not yet begun are dropped."""
        ...


def make_engine(scheduler: str = "threads") -> Engine:
    """The engine that ``scheduler`` names.

    ``threads`` and ``threads:N`` run in this process, N defaulting to the number of cores; ``local-cluster:N`` starts
    N Dask workers on this machine; an address such as ``tcp://host:8786`` is that of a running Dask scheduler. Raises
    InputError.
    """
    kind, _, number = scheduler.partition(":")
    if kind in ("threads", "local-cluster"):
        if number and not (number.isdecimal() and int(number) > 0):
            raise InputError(f'--scheduler {scheduler}: "{number}" is not a number of workers')
        count = int(number) if number else cores()
        return Threads(count) if kind == "threads" else Dask(workers=count)
    if "://" in scheduler:
        return Dask(address=scheduler)
    raise InputError(f"--scheduler {scheduler}: valid are threads, threads:N, local-cluster:N, tcp://HOST:PORT")


def cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def sources() -> str:
    """Hash of what results depend on: the package without command line and report, the models and the rigs."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256()
    models = model_folder()
    for path in sorted([*package.rglob("*.py"), *models.glob("*.xml"), *models.glob("rigs/*.toml")]):
        if path.parent.name not in ("cli", "report"):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def row_of(evaluate: Evaluate, number: int, point: Point) -> Row:
    """Evaluate a point; an exception becomes the row's error."""
    try:
        return Row(number, point, dict(evaluate(point)))
    except BenchError as error:
        return Row(number, point, error=str(error))
    except Exception as error:
        return Row(number, point, error=f"{type(error).__name__}: {error}".splitlines()[0])


@dataclass(frozen=True)
class Threads:
    """Threads of this process: the compiled loop runs without the interpreter's lock."""

    workers: int
    processes: ClassVar[int] = 0

    @property
    def threads(self) -> int:
        """As :attr:`Engine.threads`."""
        return self.workers

    def run(self, evaluate: Evaluate, points: Iterable[Numbered]) -> Generator[Row, None, None]:
        """As :meth:`Engine.run`; on closing it waits for the points that are being evaluated."""
        from threadpoolctl import threadpool_limits

        queue = iter(points)
        # Each worker is a core of its own: linear algebra must not start threads besides.
        with threadpool_limits(1, user_api="blas"), ThreadPoolExecutor(self.workers, "sweep") as pool:
            # Two points a worker: none waits for the other side of this loop, and few are begun in vain.
            running: set[Future[Row]] = {pool.submit(row_of, evaluate, *p) for p in islice(queue, 2 * self.workers)}
            try:
                while running:
                    done, running = wait(running, return_when=FIRST_COMPLETED)
                    running |= {pool.submit(row_of, evaluate, *p) for p in islice(queue, len(done))}
                    yield from sorted((future.result() for future in done), key=lambda row: row.index)
            finally:
                pool.shutdown(wait=False, cancel_futures=True)


class _OtherSourcesError(Exception):
    """A worker runs other sources than this process."""


def _on_worker(evaluate: Evaluate, number: int, point: Point, wanted: str) -> Row:
    if sources() != wanted:
        raise _OtherSourcesError
    return row_of(evaluate, number, point)


AHEAD = 4
"""Points handed to Dask for each thread it has: enough that none waits for this process."""


@dataclass(frozen=True)
class Dask:
    """Dask distributed: a running scheduler, or workers started on this machine for the time of the run.

    Dask evaluates the points of a lost worker again, elsewhere, and a point's row comes back once. A point with which
    several workers were lost (Dask's ``allowed-failures``) is a row with that error.
    """

    address: str | None = None
    """of the scheduler; None to start one here"""
    workers: int = 1
    """worker processes to start here"""
    threads: ClassVar[int] = 0

    @property
    def processes(self) -> int:
        """As :attr:`Engine.processes`."""
        return self.workers if self.address is None else 0

    def run(self, evaluate: Evaluate, points: Iterable[Numbered]) -> Generator[Row, None, None]:
        """As :meth:`Engine.run`. Raises InputError without Dask, scheduler or workers, or if sources differ."""
        try:
            from distributed import KilledWorker, as_completed
        except ImportError:
            raise InputError("Dask is not installed; pip install 'cls-bench[cluster]'") from None
        queue, own, waiting = iter(points), sources(), dict[str, Numbered]()
        with self._client() as client:

            def submit() -> list[Any]:
                wanted = AHEAD * sum(client.nthreads().values()) - len(waiting)
                futures = []
                for number, point in islice(queue, max(wanted, 0 if waiting else 1)):
                    futures.append(client.submit(_on_worker, evaluate, number, point, own, pure=False))
                    waiting[futures[-1].key] = number, point
                return futures

            try:
                done = as_completed(submit())
                for future in done:
                    number, point = waiting.pop(future.key)
                    try:
                        row = future.result()
                    except KilledWorker:
                        row = Row(number, point, error="workers were lost with this point each time it was tried")
                    done.update(submit())
                    yield row
            except _OtherSourcesError:
                raise InputError("a Dask worker has other sources of cls-bench than this process") from None
            except (CancelledError, OSError):
                raise OutputError("the Dask scheduler was lost") from None

    @contextmanager
    def _client(self) -> Iterator[Any]:
        from distributed import Client, LocalCluster

        with ExitStack() as stack:
            at: Any = self.address
            if at is None:
                at = stack.enter_context(
                    LocalCluster(
                        n_workers=self.workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None,
                        silence_logs=logging.CRITICAL,
                    )
                )  # fmt: skip
            try:
                client = stack.enter_context(Client(at, timeout=CONNECT_S))
            except (OSError, ValueError) as error:
                raise InputError(f"--scheduler {self.address}: no scheduler answers ({error})") from None
            try:
                client.wait_for_workers(1, timeout=CONNECT_S)
            except TimeoutError:
                raise InputError(f"--scheduler {self.address}: no worker joined within {CONNECT_S} s") from None
            yield client


CONNECT_S = 20
"""How long to wait for a scheduler, and for its first worker [s]."""
