"""The shipped aircraft as tables: ``python -m cls_bench.aircraft.page docs/aircraft.md`` brings the page up to date."""

import sys
from pathlib import Path

from cls_bench.aircraft.aircraft import load_aircraft
from cls_bench.aircraft.reach import reach
from cls_bench.aircraft.setting import Limits
from cls_bench.resources import shipped_aircraft
from cls_bench.rigs import load_rig
from cls_bench.text import between_marks

STARTS, ENDS = "<!-- aircraft: begin -->\n", "<!-- aircraft: end -->\n"
"""What encloses the tables in docs/aircraft.md."""


def tables() -> str:
    """What there is with forces against reach, then what each is judged by, as Markdown."""
    lines = [
        "| aircraft | control | condition | rig | force × | angle × | largest [N] | lasting [N] | measured [N] | reach "
        "|\n|---|---|---|---|---|---|---|---|---|---|",
    ]
    bands = ["| control | band | limits on its rig | source |", "|---|---|---|---|"]
    for name in shipped_aircraft():
        aircraft = load_aircraft(name)
        for setting in aircraft.settings:
            rig = load_rig(setting.about.rig)
            can = reach(setting, rig.parameters)
            cells = (
                f"`{name}`", setting.axis, setting.condition, f"`{rig.name}`", f"{setting.scale.force:g}",
                f"{setting.scale.angle:g}", f"{can.largest:.0f}", f"{can.lasting:.0f}", f"{can.measured:.0f}",
                can.verdict,
            )  # fmt: skip
            lines.append(_line(cells))
            control = " ".join(part for part in (f"`{name}`", setting.axis, setting.condition) if part)
            bands += [
                _line((control, limits.name, between(limits), limits.source))
                for limits in setting.limits(rig.parameters)
            ]
    return "\n".join([*lines, "", "Bands that the scenarios are judged by:", "", *bands]) + "\n"


def between(limits: Limits) -> str:
    """Limits of a band on a rig in words."""
    if limits.least is not None and limits.greatest is not None:
        span = f"{limits.least:.4g} to {limits.greatest:.4g}"
    else:
        span = f"≤ {limits.greatest:.4g}" if limits.least is None else f"≥ {limits.least:.4g}"
    at = [f" at {value:.4g} {'N' if key == 'force_N' else '°'}" for key, value in limits.arguments.items()
          if key != "unloading"]  # fmt: skip
    return f"{span} {limits.unit}{''.join(at)}".replace("deg", "°")


def _line(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |"


def with_tables(page: str) -> str:
    """``page`` with the text between its two marks replaced by :func:`tables`."""
    return between_marks(page, STARTS, f"\n{tables()}\n", ENDS)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    target.write_text(with_tables(target.read_text(encoding="utf-8")), encoding="utf-8")
