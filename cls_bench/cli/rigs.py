"""rigs."""

import math
from typing import TYPE_CHECKING, Any

import click

from cls_bench.cli.output import number, print_json, print_table, warn_of_drive

if TYPE_CHECKING:
    from cls_bench.rigs import Rig

_FIGURES = {
    "continuous_force": ("lasting", "N", 1.0), "peak_force": ("peak", "N", 1.0),
    "measurable_force": ("measured", "N", 1.0), "breakout_force": ("breakout", "N", 1.0),
    "backlash": ("play", "mm", 1e3), "encoder_step": ("encoder", "µm", 1e6),
    "inertia_ratio": ("inertia ratio", "1", 1.0), "free_resonance": ("free", "Hz", 1.0),
    "held_resonance": ("held", "Hz", 1.0), "velocity_bandwidth": ("velocity", "Hz", 1.0),
    "tight_inertia": ("tight I", "kg·m²", 1.0), "least_inertia": ("least I", "kg·m²", 1.0),
}  # fmt: skip
"""Of :class:`~cls_bench.rigs.Figures`, and the two of the linear model: what they are called, their unit and scale."""

_TABLES = {
    "at the grip": ("continuous_force", "peak_force", "measurable_force", "breakout_force", "backlash", "encoder_step"),
    "in motion": (
        "inertia_ratio", "free_resonance", "held_resonance", "velocity_bandwidth", "tight_inertia", "least_inertia",
    ),
}  # fmt: skip
"""Two tables, as one of all figures would fit no terminal."""


@click.command()
@click.argument("names", metavar="[NAME|FILE.toml]...", nargs=-1)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def rigs(names: tuple[str, ...], as_json: bool) -> None:
    """Compare the rigs that there are, or show those named with what was derived from their data sheets.

    Forces are those of the hand at the grip: what the motor holds for good, its peak, what the load cell measures, and
    what moves the control with the power off (locked: nothing does). Play and the encoder's step are those of the grip.
    The ratio is that of all other inertia to the rotor's. Free and held are the lowest resonances of motor and control
    against each other, and of the control with the motor held; velocity is the bandwidth of the drive's velocity loop.
    Tight I is the least simulated inertia at which the outer loop is stable when squeezed
    tightly by the standard arm, least I that which is stable however the pilot grips, both by the linear model. A
    scenario is run on a rig with --rig NAME.
    """
    from cls_bench.resources import shipped_rigs
    from cls_bench.rigs import load_rig

    found = [load_rig(name) for name in names or shipped_rigs()]
    rows = [(rig, _figures(rig)) for rig in found]
    if as_json:
        print_json({
            rig.name: {
                "title": rig.title, **{key: _finite(value) for key, value in values.items()},
                "derived": [
                    {"key": d.key, "value": d.value, "unit": unit, "how": d.how} for d, unit in _derived(rig)
                ],
            }
            for rig, values in rows
        })  # fmt: skip
        return
    if names:
        for rig, values in rows:
            _show(rig, values)
        return
    for title, names_of in _TABLES.items():
        head = [_FIGURES[name] for name in names_of]
        print_table(
            (title, *(f"{name}\n[{unit}]" for name, unit, _ in head)),
            [(rig.name, *(_cell(name, values[name]) for name in names_of)) for rig, values in rows],
        )


def _figures(rig: "Rig") -> dict[str, Any]:
    """Figures of a rig by name, SI."""
    from threadpoolctl import threadpool_limits

    from cls_bench.linear.hand import Hand
    from cls_bench.linear.least import least_inertia
    from cls_bench.rigs import figures

    with threadpool_limits(1):
        tight, _ = least_inertia(rig.parameters, [Hand(1.0)])
        least, hand = least_inertia(rig.parameters)
    found = figures(rig.parameters)._asdict()
    alone = warn_of_drive(rig.parameters, f"{rig.name}: ")
    return {
        **found, "tight_inertia": tight, "least_inertia": least, "least_inertia_at": str(hand),
        "drive_alone": alone or None,
    }  # fmt: skip


def _cell(name: str, value: float) -> str:
    if math.isinf(value):
        return "locked" if name == "breakout_force" else "none"
    return f"{value * _FIGURES[name][2]:.3g}" if abs(value) < 1e3 else f"{value:.0f}"


def _derived(rig: "Rig") -> list[tuple[Any, str]]:
    from cls_bench.parameters.override import known_keys

    return [(entry, known_keys()[entry.key]["unit"]) for entry in rig.derived]


def _show(rig: "Rig", values: dict[str, Any]) -> None:
    click.echo(f"{rig.name}: {rig.title}")
    click.echo(rig.description.strip())
    rows = [(shown, _cell(name, values[name]), unit) for name, (shown, unit, _) in _FIGURES.items()]
    if 0.0 < values["least_inertia"] < math.inf:
        rows[-1] = (rows[-1][0], rows[-1][1], f"{rows[-1][2]}, at {values['least_inertia_at']}")
    print_table(("figure", "value", "unit"), rows)
    if rig.derived:
        print_table(
            ("derived", "value", "unit", "from"),
            [(d.key, number(d.value) if isinstance(d.value, float) else str(d.value), unit, d.how)
             for d, unit in _derived(rig)],
        )  # fmt: skip


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
