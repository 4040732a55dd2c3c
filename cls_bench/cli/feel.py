"""feel."""

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cls_bench.cli.options import FiniteRange, rig_option
from cls_bench.cli.output import print_json, print_notes, print_table, results_folder
from cls_bench.errors import InputError, OutputError

if TYPE_CHECKING:
    from cls_bench.report.feel_figure import Felt

SHOWN = 4
"""Angles to either side at which the table tells the torque."""

ROUNDING = 1e-9
"""Of an angle in degrees."""


@click.command()
@click.argument("name", metavar="NAME_OR_FILE")
@click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True,
              help="Override a parameter, such as feel.stiffness=50; may be given again.")  # fmt: skip
@click.option("--at", type=FiniteRange(0, 3600), default=0.0, metavar="SECONDS",
              help="Take the parameters that a scenario has then.  [default: its start]")  # fmt: skip
@click.option("--travel-deg", type=FiniteRange(0.1, 170), metavar="DEG",
              help="Sweep to either side.  [default: a little beyond the travel limits]")  # fmt: skip
@click.option("--release-deg", type=FiniteRange(-170, 170), metavar="DEG",
              help="Where the column is let go.  [default: half the way to the nearest limit]")  # fmt: skip
@click.option("--angle-deg", "angles", type=FiniteRange(-170, 170), metavar="DEG", multiple=True,
              help="Tell the torque at this angle; may be given again.  [default: nine over the sweep]")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the figure.  [default: recordings/feel-NAME]")
@rig_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def feel(
    name: str, overrides: tuple[str, ...], at: float, travel_deg: float | None, release_deg: float | None,
    angles: tuple[float, ...], out: Path | None, rig: str | None, as_json: bool,
) -> None:  # fmt: skip
    """Draw what a scenario's feel model is like: torque over displacement, and its free response.

    From the parameters alone, by solutions apart from the controller's own code: the bench is not run. Change the file
    or --set, draw again, and shape a feel that way. Torques are those of a hand that leads the column slowly, forces
    those at the grip.
    """
    began = time.time()
    from cls_bench.claims import RECORDINGS, file_name
    from cls_bench.parameters import DEG
    from cls_bench.report.feel_figure import feel_figure, felt, sweep_ends, swing
    from cls_bench.report.style import save
    from cls_bench.rigs import figures
    from cls_bench.scenario import load_scenario

    scenario = load_scenario(name, set=overrides, rig=rig)
    if at > scenario.duration:
        raise InputError(f"--at {at:g}: {name} ends at {scenario.duration:g} s")
    p = scenario.parameters_at(at)
    if p.feel.jam.of == "forward" or (p.feel.jam.of == "aft" and p.feel.bodies == "one"):
        raise InputError(f"{name}: parameters.feel.jam.of: the column is jammed then, and no torque leads it")
    low, high = (side / DEG for side in sweep_ends(p, travel_deg and travel_deg * DEG))
    for option, angle in (*(("--angle-deg", angle) for angle in angles), ("--release-deg", release_deg)):
        if angle is not None and not low - ROUNDING <= angle <= high + ROUNDING:
            raise InputError(f"{option} {angle:g}: the sweep is from {low:.3g} to {high:.3g}; --travel-deg sets it")
    found = felt(
        p, travel=travel_deg and travel_deg * DEG, release=None if release_deg is None else release_deg * DEG
    )
    folder = results_folder(out or RECORDINGS / f"feel-{file_name(scenario.name)}", began)
    try:
        written = save(feel_figure(p, found, scenario.title), folder / "feel")
    except OSError as error:
        raise OutputError(f"cannot write {folder / 'feel'}: {error.strerror}") from None
    swung = swing(found)
    rows = _rows(found, angles)
    measured = figures(p).measurable_force
    if as_json:
        print_json({
            "scenario": scenario.name, "at_s": at,
            "curve": [{"angle_deg": a, "there_Nm": t, "back_Nm": b, "there_N": t / p.column.grip_height,
                       "back_N": b / p.column.grip_height} for a, t, b in rows],
            "release_deg": found.released[0] / DEG,
            "free_response": {key: value if math.isfinite(value) else None for key, value in swung._asdict().items()},
            "figures": [str(path) for path in written],
        })  # fmt: skip
        return
    print_notes(scenario)
    print_table(
        ("angle\n[deg]", "going on\n[N·m]", "coming back\n[N·m]", "going on\n[N]", "coming back\n[N]"),
        [(f"{a:+.3g}", *(f"{x:.3g}" for x in (t, b, t / p.column.grip_height, b / p.column.grip_height)))
         for a, t, b in rows],
    )  # fmt: skip
    if float(abs(found.torque).max()) > measured * p.column.grip_height:
        click.echo(f"the load cell of the rig {scenario.the_rig.name} ends at {measured:.0f} N at the grip")
    said = f"rests at {found.released[-1] / DEG:+.3g} deg"
    if math.isfinite(swung.crossing):
        said += f", passes it after {swung.crossing:.3g} s, overshoots by {100.0 * swung.overshoot:.2g} %"
    if math.isfinite(swung.frequency):
        said += f", swings at {swung.frequency:.3g} Hz"
    click.echo(f"let go from {found.released[0] / DEG:+.3g} deg: {said}")
    for path in written:
        click.echo(f"  {path}")


def _rows(found: "Felt", angles_deg: tuple[float, ...]) -> list[tuple[float, float, float]]:
    """(angle [deg], torque going away from neutral, torque coming back) at those angles, or some over the sweep."""
    import numpy as np

    from cls_bench.parameters import DEG
    from cls_bench.report.feel_figure import POINTS

    aft = slice(POINTS // 2 - 1, POINTS // 2 - 1 + POINTS)  # from the forward end to the aft one
    forward = slice(aft.stop - 1, aft.stop - 1 + POINTS)
    down = found.angle[aft][::-1], found.torque[aft][::-1]
    up = found.angle[forward], found.torque[forward]
    rows = []
    shares = np.linspace(-1.0, 1.0, 2 * SHOWN + 1)
    spread = [share * float(found.angle.max() if share > 0 else -found.angle.min()) for share in shares.tolist()]
    for at in [angle * DEG for angle in angles_deg] or spread:
        rising, falling = float(np.interp(at, *up)), float(np.interp(at, *down))
        rows.append((at / DEG, rising if at >= 0 else falling, falling if at >= 0 else rising))
    return rows
