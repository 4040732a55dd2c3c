"""verify: the plant held against closed forms, references and independent integrations."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cls_bench.cli.output import make_console, print_json
from cls_bench.errors import OutputError

if TYPE_CHECKING:
    from rich.console import Console

    from cls_bench.verification import Row


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
@click.option("--page", type=click.Path(dir_okay=False, path_type=Path), help="Also write the table as Markdown.")
@click.pass_context
def verify(ctx: click.Context, as_json: bool, page: Path | None) -> None:
    """Hold the plant against results that were not made by it.

    Closed forms, published references, independent integrations, energy and convergence, for every kind of rig: one row
    each. Takes less than a minute on two cores. Exit code 1 if a row falls short.
    """
    from cls_bench import verification
    from cls_bench.claims import write_text

    with _progress() as progress:
        rows = verification.verify(progress)
    passed = all(row.passed for row in rows)
    if as_json:
        table = {"passed": passed, "rows": [row.to_json() for row in rows]}
        print_json(table)
    else:
        _print_rows(rows)
    if page is not None:
        try:
            write_text(page, verification.render(rows))
        except OSError as error:
            raise OutputError(f"cannot write {page}: {error.strerror}") from None
    ctx.exit(0 if passed else 1)


TABLE_COLUMNS = 140
"""Narrower terminals get three lines a row instead of nine columns."""


def _print_rows(rows: "list[Row]") -> None:
    console = make_console()
    if console.width >= TABLE_COLUMNS:
        _print_table(console, rows)
    else:
        _print_stacked(console, rows)
    short = sum(not row.passed for row in rows)
    console.print(f"{len(rows)} rows, {short or 'none'} of which fall short")


def _print_stacked(console: "Console", rows: "list[Row]") -> None:
    from rich.padding import Padding
    from rich.text import Text

    from cls_bench.verification import page

    group = ""
    for row in rows:
        if row.group != group:
            group = row.group
            console.print(Text(f"\n{group[0].upper()}{group[1:]}", "bold"))
        unit = "" if row.unit == "1" else f" {row.unit}"
        verdict = Text(f"{page.verdict(row):6}", "green" if row.passed else "bold red")
        console.print(Text.assemble(" ", verdict, " ", row.quantity))
        said = f"{page.number(row.obtained)}{unit}; expected {page.number(row.expected)} ({row.source}); "
        said += f"deviation {page.deviation(row)}, limit {page.limit(row)}"
        console.print(Padding(Text(said, "dim"), (0, 0, 0, 8)))
    console.print()


def _print_table(console: "Console", rows: "list[Row]") -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    from cls_bench.verification import page

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("", "quantity", "unit", "expected", "source", "obtained", "deviation", "limit", "verdict"):
        right = title in ("expected", "obtained", "deviation", "limit")
        table.add_column(title, justify="right" if right else "left", overflow="fold")
    group = ""
    for row in rows:
        style = "green" if row.passed else "bold red"
        table.add_row(
            row.group if row.group != group else "", row.quantity, row.unit, page.number(row.expected), row.source,
            page.number(row.obtained), page.deviation(row), page.limit(row), Text(page.verdict(row), style),
        )  # fmt: skip
        group = row.group
    console.print(table)


@contextmanager
def _progress() -> Iterator[Callable[[int, int], None]]:
    """A progress bar on a terminal's standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(stderr=True)
    with Progress(
        TextColumn("verifying"), BarColumn(), MofNCompleteColumn(), TextColumn("cases"), TimeElapsedColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    ) as bar:  # fmt: skip
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
