"""The click group of all commands: errors become one line and their exit code."""

import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from cls_bench.cli import basics, feel, report, rigs, stability
from cls_bench.cli.aircraft import aircraft
from cls_bench.cli.failures import Debug
from cls_bench.cli.failures import report as report_failure
from cls_bench.cli.sweep import sweep
from cls_bench.cli.verify import verify
from cls_bench.cli.view import view
from cls_bench.errors import ExitCode


class _InterruptedError(Exception):
    """Carries a KeyboardInterrupt past click, which has its own word for it."""


class _Group(click.Group):
    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            raise _InterruptedError from error

    def carry_out(self, args: Sequence[str] | None = None, **options: Any) -> int:
        """Carry out a command line, the process's by default; returns the exit code. Raises nothing."""
        Debug.reset()
        options = {"prog_name": "cls-bench", **options, "standalone_mode": False}
        try:
            # click gives back what the command returned, or the code it was ended with
            code = super().main(None if args is None else list(args), **options)
        except click.exceptions.NoArgsIsHelpError as error:
            error.show()
            return ExitCode.REFUSED
        except (click.Abort, _InterruptedError) as error:
            return report_failure(error.__cause__ or KeyboardInterrupt())
        except BaseException as error:
            return report_failure(error)
        return int(code or 0)

    def main(self, args: Sequence[str] | None = None, *ignored: Any, **options: Any) -> NoReturn:
        """As click's: carry out a command line and raise SystemExit with its exit code."""
        options.pop("standalone_mode", None)
        sys.exit(self.carry_out(args, **options))


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="cls-bench")
def group() -> None:
    """A control loading system test bench without the hardware."""


group.help = f"{group.help}\n\nExit codes: {', '.join(f'{code:d} {code.title}' for code in ExitCode)}."

for _command in (basics.run, basics.list_, basics.validate, basics.schema, rigs.rigs, feel.feel):
    group.add_command(_command)
group.add_command(aircraft)
group.add_command(sweep)
group.add_command(view)
group.add_command(verify)
for _command in (report.report, report.compare, report.gallery, report.render):
    group.add_command(_command)
for _command in (
    stability.frequency_response, stability.predict, stability.onset, stability.stability_map, stability.stabilisers,
    stability.check,
):  # fmt: skip
    group.add_command(_command)


def _debug(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    Debug.on = Debug.on or value


def _add_debug(command: click.Command, hidden: bool = False) -> None:
    command.params.append(
        click.Option(["--debug"], is_flag=True, is_eager=True, expose_value=False, hidden=hidden, callback=_debug,
                     help="Show the traceback of an error. Also: CLS_BENCH_DEBUG=1.")
    )  # fmt: skip
    for inner in getattr(command, "commands", {}).values():
        _add_debug(inner, hidden=True)


_add_debug(group)
