"""What the commands print: tables, results, progress."""

import json
import math
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cls_bench.text import printable

if TYPE_CHECKING:
    from cls_bench.experiment import Progress, Result
    from cls_bench.parameters import Parameters
    from cls_bench.scenario import Scenario


def print_json(found: Any) -> None:
    """One JSON object, whole or not at all; in ASCII where the terminal takes no more."""
    from cls_bench import interrupts

    text = json.dumps(found, indent=2, ensure_ascii=False, allow_nan=False)
    try:
        text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(found, indent=2, allow_nan=False)
    with interrupts.held():
        click.echo(text)


def make_console() -> Any:
    """Standard output for tables; colour on a terminal only."""
    from rich.console import Console

    return Console(highlight=False, soft_wrap=False)


def print_table(header: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> None:
    """A table that fits the terminal, or 80 columns."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for k, title in enumerate(header):  # brackets are units, no markup
        table.add_column(Text(title), overflow="fold", no_wrap=k == 0)
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))
    make_console().print(table)


def print_term(term: str, unit: str, meaning: str) -> None:
    """A term with its unit, and what it means on the lines below."""
    click.echo(f"{term} [{unit}]")
    click.echo(click.wrap_text(meaning, width=78, initial_indent="    ", subsequent_indent="    "))


def number(value: float) -> str:
    """Four significant digits."""
    return f"{value:.4g}"


def print_notes(scenario: "Scenario") -> None:
    """On standard error: what was understood of the scenario's sample files."""
    for note in scenario.notes:
        click.echo(note, err=True)


def warn_of_drive(p: "Parameters", name: str = "") -> str:
    """Say, on standard error, if the drive oscillates by itself by the linear model; returns what was said."""
    from threadpoolctl import threadpool_limits

    from cls_bench.linear.alone import drive_alone

    with threadpool_limits(1):
        wrong = drive_alone(p)
    if wrong:
        click.echo(f"warning: {name}{wrong}", err=True)
    return wrong


def print_result(result: "Result") -> None:
    """What a run measured, its verdict, and where its recordings lie."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    console = make_console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=Text(result.scenario.title), title_justify="left")
    for title in ("measured", "value", "unit", "limits", ""):
        table.add_column(title, justify="right" if title == "value" else "left")
    for r in result.checks:
        low, high = r.check.min, r.check.max
        limits = " and ".join(f"{sign} {number(x)}" for sign, x in (("≥", low), ("≤", high)) if x is not None)
        verdict = Text("") if not r.judged else Text("passed", "green") if r.passed else Text("FAILED", "bold red")
        table.add_row(Text(r.check.name), number(r.value), r.unit, limits, verdict)
    console.print(table if result.checks else Text(result.scenario.title), soft_wrap=not result.checks)
    for r in result.checks:
        if r.note:
            what = "not measured: " if math.isnan(r.value) else ""
            console.print(Text(f"{r.check.name}: {what}{r.note}"), soft_wrap=True)
    _print_events(result)
    style = "green" if result.status == "passed" else "bold red"
    status = result.status.upper().replace("_", " ")
    line = Text.assemble((status, style), f" {result.message}" if result.message else "")
    t = result.timing
    line.append(f"  {t.simulated_s:g} s simulated in {t.wall_s:.1f} s: {t.real_time_factor:.1f} times real time")
    console.print(line)
    for path in (result.mcap, result.rrd):
        if path is not None:
            click.echo(f"  {path}")


MOST_EVENTS = 8
"""Warnings and errors of a run that are printed; --json and the report have all."""


def _print_events(result: "Result") -> None:
    """What the log holds of level warning and error, and how often."""
    from rich.text import Text

    if not result.events:
        return
    console = make_console()
    for event in result.events[:MOST_EVENTS]:
        style = "bold red" if event.level == "error" else "yellow"
        line = f" {event.source} at t = {event.time:.4f} s: {event.message}"
        console.print(Text.assemble((f"{event.level}:", style), line))
    levels = [event.level for event in result.events]
    left = len(levels) - MOST_EVENTS
    console.print(
        f"{levels.count('warning')} warnings, {levels.count('error')} errors"
        + (f"; {left} more in the recording" if left > 0 else "")
    )


def results_folder(folder: Path, began: float, *, resume: bool = False) -> Path:
    """``folder``, or another where one is in use, for the results of the running command alone; says so.

    ``began`` is the wall-clock time [s] at which the command started. Raises OutputError.
    """
    from cls_bench.claims import claimed_folder, named

    wanted = named(folder)
    claimed = click.get_current_context().with_resource(claimed_folder(wanted, began, resume=resume))
    if claimed != wanted:
        click.echo(f"{wanted} is in use by another cls-bench; the results go to {claimed}", err=True)
    return claimed


@contextmanager
def progress_bar(duration: float, quiet: bool) -> Iterator["Progress"]:
    """A progress bar on a terminal's standard error; nothing in logs but the line about compilation."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    from cls_bench import experiment

    console = Console(stderr=True, highlight=False)

    class Reporter(experiment.Progress):
        def compiling(self) -> None:
            if not quiet:
                console.print("compiling the simulation, once after each installation: about half a minute")

        def advanced(self, simulated_s: float, real_time_factor: float) -> None:
            bar.update(task, completed=simulated_s, factor=f"{real_time_factor:.1f} × real time")

    bar = Progress(
        TextColumn("{task.completed:6.1f} of {task.total:g} s"), BarColumn(), TextColumn("{task.fields[factor]}"),
        console=console, transient=True, disable=quiet or not console.is_terminal,
    )  # fmt: skip
    with bar:
        task = bar.add_task("", total=duration, factor="")
        yield Reporter()
