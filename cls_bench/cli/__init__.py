"""The command line: ``cls-bench``.

One module for each group of commands. They import what they need when they run, so that ``--help`` waits for nothing.
"""

import sys
from typing import Any

import click

from cls_bench.cli import basics, report, stability
from cls_bench.cli.sweep import sweep
from cls_bench.cli.verify import verify
from cls_bench.cli.view import view
from cls_bench.errors import BenchError

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
            sys.stdout = None
            ctx.exit(0)


@click.group(cls=_Group, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="cls-bench")
def main() -> None:
    """A control loading system test bench without the hardware.

    Exit codes: 0 passed, 1 a check failed, 2 bad input or output, 3 diverged, 130 interrupted.
    """


for _command in (basics.run, basics.list_, basics.validate, basics.schema):
    main.add_command(_command)
main.add_command(sweep)
main.add_command(view)
main.add_command(verify)
for _command in (report.report, report.compare, report.gallery, report.render):
    main.add_command(_command)
for _command in (
    stability.frequency_response, stability.predict, stability.onset, stability.stability_map, stability.stabilisers,
    stability.check,
):  # fmt: skip
    main.add_command(_command)
