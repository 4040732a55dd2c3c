"""run, list, validate, schema."""

import dataclasses
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cls_bench.cli.failures import say
from cls_bench.cli.options import SEED, FiniteRange, GivenController, controller_options, rig_option
from cls_bench.cli.output import (
    print_json,
    print_notes,
    print_result,
    print_table,
    print_term,
    progress_bar,
    warn_of_drive,
)
from cls_bench.errors import BenchError, one_line

if TYPE_CHECKING:
    from cls_bench.cli.worker import Limits
    from cls_bench.controllers import Place
    from cls_bench.experiment import Progress, Result
    from cls_bench.scenario import Scenario


@click.command()
@click.argument("scenario", metavar="NAME_OR_FILE")
@click.option("--out", type=click.Path(path_type=Path), default=Path("recordings"), show_default=True,
              help="Folder for the recordings.")  # fmt: skip
@click.option("--seed", type=SEED, help="Seed of the sensors' noise, instead of the scenario's.")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True,
              help="Override a parameter, such as feel.inertia=0.25; may be given again.")  # fmt: skip
@rig_option
@controller_options
@click.option("--rerun/--no-rerun", default=True, help="Also write a Rerun file (.rrd).  [default: rerun]")
@click.option("--signals", metavar="/TOPIC.NAME,…", multiple=True,
              help="Record these signals only, such as /column.angle,/load_cell.*; checks are measured all the same.")
@click.option("--rate", type=FiniteRange(1, 1e5), metavar="HZ",
              help="Record them at this rate at most, such as 1000.")  # fmt: skip
@click.option("--poses/--no-poses", default=None, help="Also record the bench in motion.  [default: poses]")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
@click.option("--view", is_flag=True, help="Open the recording in the Rerun viewer afterwards.")
@click.pass_context
def run(
    ctx: click.Context,
    scenario: str,
    out: Path,
    seed: int | None,
    overrides: tuple[str, ...],
    rig: str | None,
    controller: GivenController,
    rerun: bool,
    signals: tuple[str, ...],
    rate: float | None,
    poses: bool | None,
    as_json: bool,
    view: bool,
) -> None:
    """Run a scenario, record it, and judge it by its checks."""
    from cls_bench import experiment
    from cls_bench.scenario import load_scenario

    loaded = load_scenario(scenario, seed=seed, set=(*overrides, *_record(signals, rate, poses)), rig=rig)
    print_notes(loaded)
    warn_of_drive(loaded.parameters_at_start())
    place = controller.of(loaded)
    if view:
        from cls_bench.cli.view import require_display, view_recordings

        require_display(f"cls-bench run {scenario}, then cls-bench view --serve with its recording")
    with progress_bar(loaded.duration, quiet=as_json) as progress:
        if place is None:
            result = experiment.run(loaded, out=out, rerun=rerun or view, progress=progress)
        else:
            result = _run_with_controller(loaded, place, controller.limits, out, rerun or view, progress)
    if result.status == experiment.CONTROLLER_FAILED:
        say(f"error: {one_line(result.message)}")
    if as_json:
        print_json(result.to_json())
    else:
        print_result(result)
    if view:
        try:
            view_recordings([result.rrd or result.mcap])
        except BenchError as error:  # the run's own code says more
            say(f"error: {one_line(error)}")
    ctx.exit(result.exit_code)


def _record(signals: tuple[str, ...], rate: float | None, poses: bool | None) -> list[str]:
    """Options of what is recorded as overrides of the scenario, which travel in the recording."""
    names = [name.strip() for entry in signals for name in entry.split(",")]
    given = {"signals": names or None, "rate_hz": rate, "poses": poses}
    return [f"record.{key}={json.dumps(value)}" for key, value in given.items() if value is not None]


def _run_with_controller(
    scenario: "Scenario", place: "Place", limits: "Limits", out: Path, rerun: bool, progress: "Progress"
) -> "Result":
    """As :func:`experiment.run`, the controller in a process of its own."""
    from cls_bench import experiment
    from cls_bench.analysis.window import holds_all
    from cls_bench.cli.supervisor import ControllerEndedError, supervised
    from cls_bench.errors import ControllerError, Interrupted
    from cls_bench.recording import Recording
    from cls_bench.recording.closing import close_cut

    began: list[Path] = []
    simulated, start = 0.0, time.perf_counter()

    def tell(what: str, *values: Any) -> None:
        nonlocal simulated, start
        if what == "recording":
            began.append(values[0])
            start = time.perf_counter()
        elif what == "advanced":
            simulated = values[0]
        getattr(progress, what)(*values)

    try:
        result: Result = supervised(_run_job, scenario, place, out.absolute(), rerun, limits=limits, tell=tell)
    except ControllerEndedError as error:
        if not began:
            raise
        close_cut(began[0], experiment.CONTROLLER_FAILED)
        kept = Recording(began[0])
        checks = experiment.measure(scenario, kept, own_loop=True)
        events = tuple(event for event in kept.events() if event.level != "info")
        timing = experiment.Timing(simulated, time.perf_counter() - start)
        rrd = began[0].with_suffix(".rrd")
        message = f"{error}; what it did after t = {simulated:g} s is lost"
        result = experiment.Result(
            scenario, experiment.CONTROLLER_FAILED, checks, began[0], rrd if rrd.exists() else None, timing, message,
            events,
        )
    except Interrupted as error:
        if began and close_cut(began[0], "interrupted"):  # it had to be killed
            raise Interrupted(f"interrupted at t = {simulated:g} s; kept: {began[0]}") from None
        raise error
    else:
        whole = holds_all(scenario.recorded_topics, scenario.topics, scenario.clock)
        measured = experiment.measure(scenario, Recording(result.mcap), own_loop=True) if whole else result.checks
        if repr([check.value for check in measured]) != repr([check.value for check in result.checks]):
            raise ControllerError(f"the controller changed cls-bench itself: its values are not those of {result.mcap}")
    if out.is_absolute():
        return result
    rrd_shown = out / result.rrd.name if result.rrd else None
    return dataclasses.replace(result, mcap=out / result.mcap.name, rrd=rrd_shown)


def _run_job(tell: Callable[..., None], scenario: "Scenario", place: "Place", out: Path, rerun: bool) -> "Result":
    """In the worker: the run, telling how far it is."""
    from cls_bench import experiment

    class Told(experiment.Progress):
        def recording(self, mcap: Path) -> None:
            tell("recording", mcap)

        def advanced(self, simulated_s: float, real_time_factor: float) -> None:
            tell("advanced", simulated_s, real_time_factor)

    return experiment.run(scenario, out=out, rerun=rerun, controller=place, progress=Told())


@click.command(name="list")
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
            print_term(m.name, m.unit or "the signal's", "; ".join([m.meaning, *needs]))
    elif what == "signals":
        from cls_bench.signals import CLOCK, MOST_STAGES, topics

        every = topics(CLOCK, MOST_STAGES)
        rows = [(f"{t.path}.{s.name}", s.unit, f"{t.rate:g}", s.meaning) for t in every for s in t.signals]
        print_table(("signal", "unit", "Hz", "meaning"), rows)
    elif what == "parameters":
        from cls_bench.parameters import Parameters, leaves
        from cls_bench.parameters.page import about_part, shown

        part = ""
        for key, value, info in leaves(Parameters()):
            if (of := key.rpartition(".")[0]) != part and of.count("."):
                click.echo(f"\n{of}: {about_part(of).replace('``', '')}")
            part = of
            print_term(f"{key} = {shown(value)}", info["unit"], info["meaning"])
    else:
        from cls_bench.resources import shipped_scenarios
        from cls_bench.scenario import load_scenario

        scenarios = [load_scenario(path) for path in shipped_scenarios().values()]
        print_table(("scenario", "s", "title"), [(s.name, f"{s.duration:g}", s.title) for s in scenarios])


@click.command()
@click.argument("scenarios", metavar="NAME_OR_FILE...", nargs=-1, required=True)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a parameter.")
@rig_option
def validate(scenarios: tuple[str, ...], overrides: tuple[str, ...], rig: str | None) -> None:
    """Check scenario files without running them."""
    from cls_bench import experiment
    from cls_bench.scenario import load_scenario

    for scenario in scenarios:
        loaded = load_scenario(scenario, set=overrides, rig=rig)
        experiment.validate(loaded)
        print_notes(loaded)
        click.echo(f"{scenario}: valid")


@click.command()
def schema() -> None:
    """Print the JSON schema of the scenario file, for editors."""
    from cls_bench.scenario import scenario_schema

    print_json(scenario_schema())
