"""Types and options that several commands share."""

import dataclasses
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cls_bench.errors import InputError

if TYPE_CHECKING:
    from cls_bench.cli.worker import Limits
    from cls_bench.controllers import Place
    from cls_bench.scenario import Scenario


class FiniteRange(click.FloatRange):
    """A finite number within bounds: neither NaN nor infinite."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; a usage error if it is none."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


FINITE = FiniteRange()
TIME = FiniteRange(0, 3600)
"""A time of a run [s]."""
SEED = click.IntRange(0, 2**63 - 1)
"""As a scenario's seed."""


@dataclasses.dataclass(frozen=True)
class GivenController:
    """What the command line says of a controller."""

    place: str | None
    arguments: tuple[str, ...]
    limits: "Limits"

    def of(self, scenario: "Scenario | None" = None) -> "Place | None":
        """The controller to run: the command line's, else the scenario's with arguments changed; None for the feel
        model. InputError if there is none to give arguments to, or no such file.
        """
        from cls_bench.controllers import Place, parse_arguments

        given = parse_arguments(self.arguments)
        own = scenario.controller_place if scenario is not None else None
        if self.place is not None:
            place = Place(self.place, given)
        elif own is not None:
            place = dataclasses.replace(own, arguments={**own.arguments, **given})
        elif given:
            raise InputError("--controller-arg: there is no controller to give it to; name one with --controller")
        else:
            return None
        place.check()
        return dataclasses.replace(place, folder=Path(place.folder).absolute())


rig_option = click.option(
    "--rig", metavar="NAME|FILE.toml", help="What it is run on: a rig of `cls-bench rigs`, or a file of your own."
)
"""Passed on as ``rig``."""


def controller_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options that put a controller of the user's own in place of the feel model; passed on as ``controller``."""

    @functools.wraps(function)
    def command(
        *arguments: Any, controller: str | None, controller_arg: tuple[str, ...], limits: "Limits", **options: Any
    ) -> Any:
        return function(*arguments, controller=GivenController(controller, controller_arg, limits), **options)

    wrapped: Callable[..., Any] = limit_options(command)
    for option in (
        click.option("--controller-arg", metavar="KEY=VALUE", multiple=True,
                     help="Argument with which NAME is called; may be given again."),
        click.option("--controller", metavar="FILE.py:NAME",
                     help="Your own controller instead of the feel model, also package.module:NAME; NAME makes it."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped


def limit_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options of what a controller of the user's own may take; passed on as ``limits``."""
    from cls_bench.cli.worker import Limits

    @functools.wraps(function)
    def command(*arguments: Any, controller_timeout: float, controller_memory: int, **options: Any) -> Any:
        return function(*arguments, limits=Limits(controller_timeout, controller_memory), **options)

    wrapped: Callable[..., Any] = command
    default = Limits()
    for option in (
        click.option("--controller-memory", type=click.IntRange(16, 65536), default=default.megabytes,
                     show_default=True, metavar="MB", help="Memory that your controller may take."),
        click.option("--controller-timeout", type=FiniteRange(0.1, 3600), default=default.seconds, show_default=True,
                     metavar="S", help="Longest time for its import, for making it, and for one step [s]."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped
