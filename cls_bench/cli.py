"""The command line: ``cls-bench``."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cls_bench.errors import BenchError, InputError

if TYPE_CHECKING:
    from cls_bench.experiment import Progress, Result

INTERRUPTED_EXIT_CODE = 130


class _Group(click.Group):
    """Turns the project's errors into one line and their exit code."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except BenchError as error:
            click.echo(f"error: {error}", err=True)
            ctx.exit(error.exit_code)
        except KeyboardInterrupt:
            click.echo("interrupted", err=True)
            ctx.exit(INTERRUPTED_EXIT_CODE)
        except BrokenPipeError:  # the reader of our output has gone
            sys.stdout = None  # type: ignore[assignment]
            ctx.exit(0)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="cls-bench")
def main() -> None:
    """A control loading system test bench without the hardware.

    Exit codes: 0 passed, 1 a check failed, 2 bad input or output, 3 diverged, 130 interrupted.
    """


@main.command()
@click.argument("scenario", metavar="NAME_OR_FILE")
@click.option("--out", type=click.Path(path_type=Path), default=Path("recordings"), show_default=True,
              help="Folder for the recordings.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), help="Seed of the sensors' noise, instead of the scenario's.")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True,
              help="Override a parameter, such as feel.inertia=0.25; may be given again.")  # fmt: skip
@click.option("--rerun/--no-rerun", default=True, help="Also write a Rerun file (.rrd).  [default: rerun]")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
@click.option("--view", is_flag=True, help="Open the recording in the Rerun viewer afterwards.")
@click.pass_context
def run(
    ctx: click.Context,
    scenario: str,
    out: Path,
    seed: int | None,
    overrides: tuple[str, ...],
    rerun: bool,
    as_json: bool,
    view: bool,
) -> None:
    """Run a scenario, record it, and judge it by its checks."""
    from cls_bench import experiment
    from cls_bench.scenario import load_scenario

    loaded = load_scenario(scenario, seed=seed, set=overrides)
    with _progress(loaded.duration, quiet=as_json) as progress:
        result = experiment.run(loaded, out=out, rerun=rerun or view, progress=progress)
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=2, ensure_ascii=False, allow_nan=False))
    else:
        _print_result(result)
    if view:
        _view(result.rrd or result.mcap)
    ctx.exit(result.exit_code)


@main.command(name="list")
@click.option("--metrics", "what", flag_value="metrics", help="List the metrics that checks can name.")
@click.option("--signals", "what", flag_value="signals", help="List the recorded signals.")
@click.option("--parameters", "what", flag_value="parameters", help="List all parameters with units and sources.")
def list_(what: str | None) -> None:
    """List the shipped scenarios, or what scenarios are made of."""
    if what == "metrics":
        from cls_bench.analysis.metrics import METRICS

        for m in METRICS.values():
            arguments = (
                f"{name} [{a.unit}]" + ("" if a.default is None else f" = {a.default:g}")
                for name, a in m.arguments.items()
            )
            needs = ["signal", *arguments] if m.of_signal else [*arguments]
            _print_term(m.name, m.unit or "the signal's", "; ".join([m.meaning, *needs]))
    elif what == "signals":
        from cls_bench.signals import TOPICS

        rows = [(f"{t.path}.{s.name}", s.unit, f"{t.rate:g}", s.meaning) for t in TOPICS for s in t.signals]
        _print_table(("signal", "unit", "Hz", "meaning"), rows)
    elif what == "parameters":
        from cls_bench.parameters import Parameters, leaves

        for key, value, info in leaves(Parameters()):
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            _print_term(f"{key} = {shown}", info["unit"], info["meaning"])
    else:
        from cls_bench.resources import shipped_scenarios
        from cls_bench.scenario import load_scenario

        scenarios = [load_scenario(path) for path in shipped_scenarios().values()]
        _print_table(("scenario", "s", "title"), [(s.name, f"{s.duration:g}", s.title) for s in scenarios])


@main.command()
@click.argument("scenarios", metavar="NAME_OR_FILE...", nargs=-1, required=True)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a parameter.")
def validate(scenarios: tuple[str, ...], overrides: tuple[str, ...]) -> None:
    """Check scenario files without running them."""
    from cls_bench import experiment
    from cls_bench.scenario import load_scenario

    for scenario in scenarios:
        experiment.validate(load_scenario(scenario, set=overrides))
        click.echo(f"{scenario}: valid")


@main.command()
def schema() -> None:
    """Print the JSON schema of the scenario file, for editors."""
    from cls_bench.scenario import scenario_schema

    click.echo(json.dumps(scenario_schema(), indent=2, ensure_ascii=False))


@main.command()
@click.argument("recording", type=click.Path(path_type=Path))
def view(recording: Path) -> None:
    """Open a recording (.rrd or .mcap) in the Rerun viewer."""
    _view(recording)


def _view(recording: Path) -> None:
    import subprocess

    if not recording.is_file():
        raise InputError(f"{recording}: no such file")
    rrd = recording.with_suffix(".rrd")
    shown = rrd if rrd.is_file() else recording
    viewer = Path(sys.executable).with_name("rerun")
    try:
        code = subprocess.run([str(viewer), str(shown)], check=False).returncode
    except OSError as error:
        raise InputError(f"the Rerun viewer cannot be started ({error.strerror}); it comes with rerun-sdk") from None
    if code:
        raise InputError(
            f"the Rerun viewer ended with code {code}; without a display, serve it to a browser: "
            f"rerun --serve-web --bind 127.0.0.1 {shown}"
        )


# --- output ----------------------------------------------------------------------------------------------------------


def _console() -> Any:
    from rich.console import Console

    return Console(highlight=False, soft_wrap=False)


def _print_table(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for k, title in enumerate(header):
        table.add_column(title, overflow="fold", no_wrap=k == 0)
    for row in rows:
        table.add_row(*row)
    _console().print(table)


def _print_term(term: str, unit: str, meaning: str) -> None:
    click.echo(f"{term} [{unit}]")
    click.echo(click.wrap_text(meaning, width=78, initial_indent="    ", subsequent_indent="    "))


def _number(value: float) -> str:
    return f"{value:.4g}"


def _print_result(result: "Result") -> None:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    console = _console()
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title=result.scenario.title, title_justify="left")
    for title, justify in (("measured", "left"), ("value", "right"), ("unit", "left"), ("limits", "left"), ("", "left")):
        table.add_column(title, justify=justify)  # type: ignore[arg-type]
    for r in result.checks:
        low, high = r.check.min, r.check.max
        limits = " and ".join(f"{sign} {_number(x)}" for sign, x in (("≥", low), ("≤", high)) if x is not None)
        verdict = Text("") if not r.judged else Text("passed", "green") if r.passed else Text("FAILED", "bold red")
        table.add_row(r.check.name, _number(r.value), r.unit, limits, verdict)
    console.print(table)
    style = {"passed": "green", "failed": "bold red", "diverged": "bold red"}[result.status]
    line = Text.assemble((result.status.upper(), style), f" {result.message}" if result.message else "")
    t = result.timing
    line.append(f"  {t.simulated_s:g} s simulated in {t.wall_s:.1f} s: {t.real_time_factor:.1f} times real time")
    console.print(line)
    for path in (result.mcap, result.rrd):
        if path is not None:
            click.echo(f"  {path}")


@contextmanager
def _progress(duration: float, quiet: bool) -> Iterator["Progress"]:
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
