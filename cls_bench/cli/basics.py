"""run, list, validate, schema."""

import json
from pathlib import Path
from typing import Any

import click

from cls_bench.cli.output import print_notes, print_result, print_table, print_term, progress_bar
from cls_bench.errors import InputError


@click.command()
@click.argument("scenario", metavar="NAME_OR_FILE")
@click.option("--out", type=click.Path(path_type=Path), default=Path("recordings"), show_default=True,
              help="Folder for the recordings.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), help="Seed of the sensors' noise, instead of the scenario's.")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True,
              help="Override a parameter, such as feel.inertia=0.25; may be given again.")  # fmt: skip
@click.option("--controller", metavar="FILE.py:NAME",
              help="Your own outer loop instead of the feel model: NAME() is called once for the object.")  # fmt: skip
@click.option("--rerun/--no-rerun", default=True, help="Also write a Rerun file (.rrd).  [default: rerun]")
@click.option("--signals", metavar="/TOPIC.NAME,…", multiple=True,
              help="Record these signals only, such as /column.angle,/load_cell.*; checks are measured all the same.")
@click.option("--rate", type=float, metavar="HZ", help="Record them at this rate at most, such as 1000.")
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
    controller: str | None,
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

    loaded = load_scenario(scenario, seed=seed, set=(*overrides, *_record(signals, rate, poses)))
    print_notes(loaded)
    with progress_bar(loaded.duration, quiet=as_json) as progress:
        loop = load_controller(controller) if controller else None
        result = experiment.run(loaded, out=out, rerun=rerun or view, controller=loop, progress=progress)
    if as_json:
        click.echo(json.dumps(result.to_json(), indent=2, ensure_ascii=False, allow_nan=False))
    else:
        print_result(result)
    if view:
        from cls_bench.cli.view import view_recordings

        view_recordings([result.rrd or result.mcap])
    ctx.exit(result.exit_code)


def _record(signals: tuple[str, ...], rate: float | None, poses: bool | None) -> list[str]:
    """Options of what is recorded as overrides of the scenario, which travel in the recording."""
    names = [name.strip() for entry in signals for name in entry.split(",")]
    given = {"signals": names or None, "rate_hz": rate, "poses": poses}
    return [f"record.{key}={json.dumps(value)}" for key, value in given.items() if value is not None]


def load_controller(place: str) -> Any:
    """The object that NAME of ``FILE.py:NAME`` makes; InputError where there is none."""
    import runpy

    file, colon, name = place.rpartition(":")
    if not colon or not Path(file).is_file():
        raise InputError(f"--controller {place}: no such file; give FILE.py:NAME")
    try:
        names = runpy.run_path(file)
        if not callable(names.get(name)):
            made = [key for key, value in names.items() if isinstance(value, type) and value.__module__ == "<run_path>"]
            raise InputError(f"--controller {place}: {file} defines no {name}; it has {', '.join(made) or 'no class'}")
        return names[name]()
    except InputError:
        raise
    except Exception as error:  # whatever a user's file may raise
        raise InputError(f"--controller {place}: {type(error).__name__}: {error}") from None


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
        from cls_bench.signals import TOPICS

        rows = [(f"{t.path}.{s.name}", s.unit, f"{t.rate:g}", s.meaning) for t in TOPICS for s in t.signals]
        print_table(("signal", "unit", "Hz", "meaning"), rows)
    elif what == "parameters":
        from cls_bench.parameters import Parameters, leaves

        for key, value, info in leaves(Parameters()):
            shown = f"{value:g}" if isinstance(value, float) else str(value)
            print_term(f"{key} = {shown}", info["unit"], info["meaning"])
    else:
        from cls_bench.resources import shipped_scenarios
        from cls_bench.scenario import load_scenario

        scenarios = [load_scenario(path) for path in shipped_scenarios().values()]
        print_table(("scenario", "s", "title"), [(s.name, f"{s.duration:g}", s.title) for s in scenarios])


@click.command()
@click.argument("scenarios", metavar="NAME_OR_FILE...", nargs=-1, required=True)
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True, help="Override a parameter.")
def validate(scenarios: tuple[str, ...], overrides: tuple[str, ...]) -> None:
    """Check scenario files without running them."""
    from cls_bench import experiment
    from cls_bench.scenario import load_scenario

    for scenario in scenarios:
        loaded = load_scenario(scenario, set=overrides)
        experiment.validate(loaded)
        print_notes(loaded)
        click.echo(f"{scenario}: valid")


@click.command()
def schema() -> None:
    """Print the JSON schema of the scenario file, for editors."""
    from cls_bench.scenario import scenario_schema

    click.echo(json.dumps(scenario_schema(), indent=2, ensure_ascii=False))
