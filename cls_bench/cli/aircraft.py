"""aircraft."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click

from cls_bench.cli.options import rig_option
from cls_bench.cli.output import number, print_json, print_table

if TYPE_CHECKING:
    from cls_bench.aircraft import Aircraft, Band, Limits, Number, Reach, Setting
    from cls_bench.parameters import Parameters


@click.command()
@click.argument("name", metavar="[NAME|FILE.toml]", required=False)
@rig_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def aircraft(name: str | None, rig: str | None, as_json: bool) -> None:
    """List the aircraft that there are with their forces, or show one with its numbers, bands and sources.

    Forces are those at the rig's grip, scales applied: the largest of springs and friction within the travel; of the
    rig what its motor holds for good, what its load cell measures, and its peak. The rig is the one that the
    aircraft's file names for each control, or that of --rig. Reach says whether it is enough: lasting, for a short
    time, too weak, or too far for its travel. Of a named one also whether the outer loop is calm, by the linear model
    in the standard grips. A scenario takes an aircraft by its table [aircraft].
    """
    from cls_bench.aircraft import load_aircraft
    from cls_bench.resources import shipped_aircraft

    found = [load_aircraft(each) for each in ([name] if name else shipped_aircraft())]
    rows = [(craft, _on_rig(setting, rig)) for craft in found for setting in craft.settings]
    if as_json:
        print_json({craft.name: _as_json(craft, rig) for craft in found})
        return
    if name:
        _show(found[0], rig)
        return
    print_table(_HEAD, [_row(on, craft.name) for craft, on in rows])
    _print_rigs(on for _, on in rows)


_HEAD = ("control", "rig", "force\n×", "angle\n×", "largest\n[N]", "reach")
_RIGS = ("rig", "lasting\n[N]", "measured\n[N]", "peak\n[N]", "travel\n[°]")


class _OnRig:
    """A setting with the rig that it is put on."""

    def __init__(self, setting: "Setting", rig: str, parameters: "Parameters", reach: "Reach", limits: "list[Limits]"):
        self.setting, self.rig, self.parameters, self.reach, self.limits = setting, rig, parameters, reach, limits


def _on_rig(setting: "Setting", rig: str | None) -> _OnRig:
    from cls_bench.aircraft import reach
    from cls_bench.errors import InputError
    from cls_bench.input.faults import FaultError
    from cls_bench.rigs import load_rig

    chosen = load_rig(rig or setting.about.rig)
    try:
        can, parameters = reach(setting, chosen.parameters), setting.on(chosen.parameters)
    except FaultError as fault:
        raise InputError(f"{setting.axis} {setting.condition} on {chosen.name}: {fault}") from None
    return _OnRig(setting, chosen.name, parameters, can, setting.limits(chosen.parameters))


def _row(on: _OnRig, prefix: str = "") -> tuple[str, ...]:
    scale = on.setting.scale
    return (
        " ".join(part for part in (prefix, on.setting.axis, on.setting.condition) if part), on.rig,
        "" if scale.force == 1.0 else f"{scale.force:g}", "" if scale.angle == 1.0 else f"{scale.angle:g}",
        f"{on.reach.largest:.0f}", on.reach.verdict,
    )  # fmt: skip


def _print_rigs(found: Iterable[_OnRig]) -> None:
    rigs = {on.rig: on.reach for on in found}
    print_table(_RIGS, [
        (rig, f"{can.lasting:.0f}", f"{can.measured:.0f}", f"{can.peak:.0f}", f"{can.room:.3g}")
        for rig, can in sorted(rigs.items())
    ])  # fmt: skip


def _show(craft: "Aircraft", rig: str | None) -> None:
    click.echo(f"{craft.name}: {craft.title}")
    click.echo(craft.description.strip())
    all_on = [_on_rig(setting, rig) for setting in craft.settings]
    print_table(_HEAD, [_row(on) for on in all_on])
    _print_rigs(all_on)
    for on in all_on:
        click.echo(f"{on.setting.title}: {_calm(on)}")
        if on.setting.scale_reason:
            click.echo(f"{on.setting.title}: scaled, as {on.setting.scale_reason}")
    for name, axis in craft.axes.items():
        click.echo(f"\n{name}: {axis.title}")
        print_table(_NUMBERS, [_number(key, entry) for key, entry in axis.feel.items()])
        for condition, differs in axis.conditions.items():
            if differs.feel:
                click.echo(f"{condition}: {differs.title}")
                print_table(_NUMBERS, [_number(key, entry) for key, entry in differs.feel.items()])
    for on in all_on:
        if on.setting.bands:
            click.echo(f"{on.setting.title}: bands, and the limits on {on.rig}")
            pairs = zip(on.setting.bands, on.limits, strict=True)
            print_table(("band", "of the aircraft", "on the rig", "source"), [_band(*pair) for pair in pairs])


def _calm(on: _OnRig) -> str:
    """How the outer loop is in the standard grips, by the linear model."""
    from threadpoolctl import threadpool_limits

    from cls_bench.linear.least import GRIPS
    from cls_bench.linear.prediction import growth_rate
    from cls_bench.linear.variation import Setup

    with threadpool_limits(1):
        growing = {grip: growth_rate(Setup(on.parameters, grip)) for grip in GRIPS}
    shaking = [grip for grip in GRIPS if growing[grip] > GROWING]
    if not shaking:
        return f"by the linear model calm on {on.rig} in all of {len(GRIPS)} grips"
    worst = max(shaking, key=lambda grip: growing[grip])
    return (
        f"by the linear model {on.rig} shakes in {len(shaking)} of {len(GRIPS)} grips, most at {worst}: growth rate "
        f"{growing[worst]:.2g} 1/s"
    )


GROWING = 0.5
"""Growth rate [1/s] that is not rounding of a control that stays where it is put."""

_NUMBERS = ("number", "value", "unit", "bounds", "source")


def _number(key: str, entry: "Number") -> tuple[str, ...]:
    value = entry.value
    shown = ", ".join(number(v) for v in entry.values) if entry.values else str(value).lower()
    bounds = "" if entry.least is None or entry.greatest is None else f"{entry.least:g} to {entry.greatest:g}"
    return key, shown, entry.unit or "", bounds, entry.source


def _band(band: "Band", limits: "Limits") -> tuple[str, ...]:
    at = "" if band.at is None else f" at {band.at:g} {band.at_unit}"
    where = "".join(f" at {number(value)}" for key, value in limits.arguments.items() if key != "unloading")
    unit = {"force_N": " N"}.get(next(iter(limits.arguments), ""), "°") if where else ""
    return (
        band.name, f"{band.of}{at}: {_between(band.least, band.greatest)} {band.unit}",
        f"{_between(limits.least, limits.greatest)} {limits.unit}{where}{unit}", band.source,
    )  # fmt: skip


def _between(least: float | None, greatest: float | None) -> str:
    if least is None or greatest is None:
        return f"≤ {greatest:.4g}" if greatest is not None else f"≥ {least:.4g}"
    return f"{least:.4g} to {greatest:.4g}"


def _as_json(craft: "Aircraft", rig: str | None) -> dict[str, Any]:
    settings = []
    for setting in craft.settings:
        on = _on_rig(setting, rig)
        settings.append({
            "axis": setting.axis, "condition": setting.condition or None, "title": setting.title, "rig": on.rig,
            "force_scale": setting.scale.force, "angle_scale": setting.scale.angle, **on.reach._asdict(),
            "verdict": on.reach.verdict,
            "numbers": {
                key: entry.model_dump(exclude_none=True) for key, entry in setting.numbers.items()
            },
            "checks": [limits._asdict() for limits in on.limits],
        })  # fmt: skip
    return {"title": craft.title, "description": craft.description, "settings": settings}
