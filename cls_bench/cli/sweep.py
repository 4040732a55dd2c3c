"""sweep."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cls_bench.cli.options import limit_options, rig_option
from cls_bench.cli.output import number, print_json, print_table, results_folder
from cls_bench.errors import ControllerError, InputError, Interrupted, OutputError

if TYPE_CHECKING:
    from cls_bench.cli.worker import Limits
    from cls_bench.sweep.core import Report
    from cls_bench.sweep.engine import Engine, Row
    from cls_bench.sweep.plan import Plan


@click.command()
@click.argument("file", metavar="FILE.toml", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the results.  [default: recordings/NAME]")
@click.option("--resume", is_flag=True, help="Continue a sweep that was interrupted.")
@click.option("--scheduler", default="threads", show_default=True, metavar="WHERE",
              help="threads, threads:N, local-cluster:N (N Dask workers here), or the tcp:// address of a Dask "
                   "scheduler.")  # fmt: skip
@rig_option
@limit_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def sweep(
    file: Path, out: Path | None, resume: bool, scheduler: str, rig: str | None, limits: "Limits", as_json: bool
) -> None:
    """Run a scenario at many points and collect its metrics.

    Writes table.parquet, figure.png and figure.svg; points that fail are rows with their error. Ctrl-C keeps the
    points that are done, in points.jsonl; --resume continues from there. The memory of a controller of your own is
    limited for each worker.
    """
    began = time.time()
    from cls_bench.claims import RECORDINGS
    from cls_bench.experiment import CONTROLLER_FAILED
    from cls_bench.report.style import save
    from cls_bench.report.sweep_figure import sweep_figure
    from cls_bench.sweep.engine import make_engine
    from cls_bench.sweep.plan import load_sweep
    from cls_bench.sweep.table import statuses, summarise, to_table, write_table

    plan = load_sweep(file, rig=rig)
    engine = make_engine(scheduler)
    folder = results_folder(out or RECORDINGS / plan.name, began, resume=resume)
    journal = folder / "points.jsonl"
    _compile(plan, quiet=as_json)
    try:
        with points_progress(quiet=as_json) as report:
            if plan.scenario.controller is None:
                rows = _evaluate(report, plan, journal, resume, engine)
            else:
                from cls_bench.cli.supervisor import supervised

                def tell(*what: Any) -> None:
                    if len(what) == 2:
                        report(*what)

                limits = limits._replace(threads=engine.threads, processes=engine.processes)
                rows = supervised(_evaluate, plan, journal.absolute(), resume, engine, limits=limits, tell=tell)
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; kept: {journal}; continue with --resume") from None
    table_path = folder / "table.parquet"
    write_table(to_table(plan, rows), table_path)
    try:
        figures = save(sweep_figure(plan, rows), folder / "figure")
    except OSError as error:
        raise OutputError(f"cannot write {folder / 'figure'}: {error.strerror}") from None
    if as_json:
        summary = {s.name: s.to_json() for s in summarise(plan, rows)}
        found = {"sweep": plan.name, "points": len(rows), "statuses": statuses(rows), "metrics": summary,
                 "table": str(table_path), "figures": [str(path) for path in figures]}  # fmt: skip
        print_json(found)
    else:
        _print(plan, rows)
        for path in (table_path, *figures):
            click.echo(f"  {path}")
    if all(row.error for row in rows):
        raise InputError(f"{file}: no point could be evaluated; the first says: {rows[0].error}")
    if all(row.values.get("status") == CONTROLLER_FAILED for row in rows):
        said = rows[0].values["message"]
        raise ControllerError(f"{file}: the controller failed at every point; at the first: {said}")


def _evaluate(report: "Report", plan: "Plan", journal: Path, resume: bool, engine: "Engine") -> "list[Row]":
    from cls_bench.sweep.core import evaluate_points
    from cls_bench.sweep.runs import ScenarioAt

    return evaluate_points(
        ScenarioAt.of(plan), plan.sweep.points, journal=journal, identity=plan.identity, resume=resume,
        scheduler=engine, report=report, say=lambda line: click.echo(line, err=True),
    )  # fmt: skip


def _cell(value: float | int | None) -> str:
    return "" if value is None else str(value) if isinstance(value, int) else number(value)


MOST_ERRORS = 5
"""Different errors that are printed; the table has all."""


def _print(plan: "Plan", rows: "list[Row]") -> None:
    from cls_bench.sweep.table import statuses, summarise

    click.echo(plan.sweep.title)
    print_table(
        ("metric", "unit", "least", "at point", "median", "greatest", "at point"),
        [
            (
                s.name,
                s.unit,
                _cell(s.least),
                _cell(s.least_at),
                _cell(s.median),
                _cell(s.greatest),
                _cell(s.greatest_at),
            )
            for s in summarise(plan, rows)
        ],
    )
    counts = ", ".join(f"{count} {status}" for status, count in statuses(rows).items())
    click.echo(f"{len(rows)} points: {counts}")
    errors = {row.error: row.index for row in reversed(rows) if row.error}
    for error, index in list(reversed(errors.items()))[:MOST_ERRORS]:
        click.echo(f"  point {index}: {error}")


def _compile(plan: "Plan", quiet: bool) -> None:
    """Have the machine code in the cache before several workers look for it."""
    from cls_bench.bench import Bench
    from cls_bench.cli.output import progress_bar
    from cls_bench.compiled import is_cached

    if not is_cached():
        with progress_bar(0.0, quiet=quiet) as progress:
            progress.compiling()
            Bench(plan.scenario.parameters_at_start()).compile()


@contextmanager
def points_progress(quiet: bool) -> Iterator[Callable[[int, int], None]]:
    """A bar with the remaining time on a terminal's standard error; nothing in logs."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, highlight=False)
    bar = Progress(
        MofNCompleteColumn(), TextColumn("points"), BarColumn(), TimeRemainingColumn(elapsed_when_finished=True),
        TextColumn("left"), console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip
    with bar:
        task = None

        def report(done: int, total: int) -> None:
            nonlocal task
            if task is None:  # those of an earlier sweep say nothing about the speed
                task = bar.add_task("", total=total, completed=done)
            bar.update(task, completed=done)

        yield report
