"""Reports as self-contained HTML pages: nothing in them comes from the network."""

import datetime as dt
import json
import math
import shlex
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from cls_bench.analysis import energy
from cls_bench.claims import cannot_write, claimed_page, page_mark, write_text
from cls_bench.errors import InputError, one_line
from cls_bench.experiment import CheckResult
from cls_bench.parameters.override import flat
from cls_bench.report import style
from cls_bench.report.figures import CANNOT_DRAW, Picture, pictures
from cls_bench.report.recorded_run import RecordedRun
from cls_bench.resources import shipped_scenarios
from cls_bench.text import printable

Rows = Sequence[Sequence[str]]


@dataclass(frozen=True)
class Section:
    """A heading with text and a table, the table's header first."""

    title: str
    text: str = ""
    rows: Rows = ()


@dataclass(frozen=True)
class Shown:
    """A picture as the page takes it."""

    title: str
    caption: str
    svg: Markup
    table: Rows
    files: Sequence[tuple[str, str]]


def write_report(runs: Sequence[RecordedRun], folder: Path) -> Path:
    """Write one page about all of ``runs`` into ``folder``, and its figures beside it; returns the page's path.

    Raises OutputError if it cannot be written.
    """
    name = runs[0].path.stem if len(runs) == 1 else "report"
    owner = _owner(runs)
    try:
        with claimed_page(folder, name, owner) as page:
            shown = [_run(run, page, number if len(runs) > 1 else 0) for number, run in enumerate(runs, start=1)]
            _write(page, owner, _render("report.html", runs=shown))
    except OSError as error:
        raise cannot_write(Path(error.filename or folder), error) from None
    return page


def write_gallery(runs: Sequence[RecordedRun], folder: Path) -> Path:
    """Write a page that shows all of ``runs`` and links to a report of each; returns its path. Raises OutputError."""
    page = folder / "index.html"
    cards = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for run in runs:
            report = folder / f"{run.name}.html"
            shown = _run(run, report, 0)
            _write(report, _owner([run]), _render("report.html", runs=[shown]))
            cards.append({**shown, "name": run.name, "page": report.name, "picture": shown["pictures"][0]})
        _write(page, _owner(runs), _render("gallery.html", runs=cards))
    except OSError as error:
        raise cannot_write(Path(error.filename or page), error) from None
    return page


def write_comparison(
    first: RecordedRun, second: RecordedRun, pictures: Sequence[Picture], left_out: Sequence[str],
    sections: Sequence[Section], folder: Path,
) -> Path:  # fmt: skip
    """Write a page that lays two runs over each other; returns its path. Raises OutputError.

    ``left_out`` says which signals are not drawn, and why.
    """
    owner = _owner((first, second))
    named = (("A", first), ("B", second))
    runs = [("", "recording", "scenario", "verdict")]
    runs += [(name, run.path.name, run.scenario.title, run.verdict) for name, run in named]
    doubts = [f"{name}: {doubt}" for name, run in named for doubt in run.doubts]
    shown = [Shown(p.title, p.caption, _inline(p, style.svg(p.figure, p.name)), p.table, ()) for p in pictures]
    title = "Two runs compared"
    text = _render(
        "compare.html", title=title, runs=runs, doubts=doubts, sections=sections, left_out=left_out, pictures=shown
    )
    try:
        with claimed_page(folder, f"{first.path.stem}--{second.path.stem}", owner) as page:
            _write(page, owner, text)
    except OSError as error:
        raise cannot_write(Path(error.filename or folder), error) from None
    return page


def _owner(runs: Sequence[RecordedRun]) -> str:
    """Whose a page is: it is replaced by another about the same recordings, and by no other."""
    return "\n".join(str(run.path.resolve()) for run in runs)


def _write(page: Path, owner: str, text: str) -> None:
    write_text(page, text.replace("<head>", f"<head>\n{page_mark(owner)}", 1))


@cache
def _templates() -> jinja2.Environment:
    return jinja2.Environment(
        loader=jinja2.PackageLoader("cls_bench.report"), autoescape=jinja2.select_autoescape(("html",)),
        undefined=jinja2.StrictUndefined, trim_blocks=True,
    )  # fmt: skip


def _render(template: str, **values: Any) -> str:
    def variables(dark: bool) -> Markup:
        return Markup(
            " ".join(f"--{name}: {shade.dark if dark else shade.light};" for name, shade in style.SHADES.items())
        )

    css = Markup(_templates().get_template("style.css").render(light=variables(False), dark=variables(True)))
    return _templates().get_template(template).render(style=css, version=version("cls-bench"), **values)


def _run(run: RecordedRun, page: Path, number: int) -> dict[str, Any]:
    """All that ``page`` says of a run; its figures are written beside the page, with ``number`` unless it is 0."""
    figures = page.with_name(f"{page.stem}_figures")
    figures.mkdir(exist_ok=True)
    shown: list[Shown] = []
    left_out: list[str] = []
    suffix = f"_{number}" if number else ""
    for picture in pictures(run, left_out):
        try:
            document = style.svg(picture.figure, f"{picture.name}_{number}")
            paths = style.save(picture.figure, figures / f"{picture.name}{suffix}", document)
        except CANNOT_DRAW as error:
            left_out.append(f"{picture.title}: {printable(str(error), 300)}")
            continue
        files = [(path.suffix[1:].upper(), f"{figures.name}/{path.name}") for path in paths]
        shown.append(Shown(picture.title, picture.caption, _inline(picture, document), picture.table, files))
    scenario = run.scenario
    return {
        "anchor": f"run{number}", "title": scenario.title, "verdict": run.verdict,
        "description": " ".join(scenario.description.split()), "facts": _facts(run),
        "doubts": run.doubts, "left_out": left_out,
        "checks": [_check(result) for result in run.checks], "pictures": shown, "sections": list(_sections(run)),
        "command": _command(run), "scenario": scenario.source.decode(),
    }  # fmt: skip


def _inline(picture: Picture, document: str) -> Markup:
    label = Markup.escape(picture.title)
    return Markup(style.inline(document).replace("<svg", f'<svg role="img" aria-label="{label}"', 1))


def _facts(run: RecordedRun) -> str:
    facts = [f"{run.duration:g} s of {run.scenario.duration:g} s"]
    start = run.recording.wall_start
    if start:
        with suppress(ValueError):
            facts.append(f"recorded {dt.datetime.fromisoformat(start):%-d %B %Y, %H:%M} UTC")
    facts += [f"rig {run.scenario.the_rig.name}", f"seed {run.scenario.seed}", run.path.name]
    return " · ".join(facts)


def number(value: float) -> str:
    """Four significant digits; a dash where there is none."""
    return f"{value:.4g}".replace("-", "−") if math.isfinite(value) else "–"


def _check(result: CheckResult) -> dict[str, str]:
    check = result.check
    limits = " and ".join(f"{sign} {number(x)}" for sign, x in (("≥", check.min), ("≤", check.max)) if x is not None)
    metric = check.metric + (f" of {check.signal}" if check.signal else "")
    arguments = ", ".join(f"{name} = {value:g}" for name, value in check.arguments.items())
    verdict = "passed" if result.passed else "not measured" if math.isnan(result.value) else "failed"
    verdict = verdict if result.judged else ""
    return {
        "name": check.name, "metric": metric + (f" ({arguments})" if arguments else ""), "value": number(result.value),
        "unit": "" if result.unit == "1" else result.unit, "limits": limits,
        "window": f"{check.window[0]:g} to {check.window[1]:g}",
        "verdict": verdict, "note": result.note,
    }  # fmt: skip


def _sections(run: RecordedRun) -> list[Section]:
    return [
        section
        for section in (_controller(run), _energy(run), _parameters(run), _changes(run), _events(run), _timing(run))
        if section
    ]


def _controller(run: RecordedRun) -> Section | None:
    """Which controller ran, if it was not the feel model."""
    if run.has_feel_model:
        return None
    said = run.recording.metadata.items()
    about = {key.partition(".")[2]: text for key, text in said if key.startswith("controller.")}
    text = "A controller of the user's own ran in place of the feel model, whose parameters had no effect."
    return Section("Controller", text, (("", "recorded"), *((name, value) for name, value in sorted(about.items()))))


def _energy(run: RecordedRun) -> Section:
    """Where the energy went."""
    title = "Energy"
    topics, losses = run.recording.topics, run.recording.losses
    if len(run.axes) > 1:
        return Section(title, f"Not audited: of several axes, {' and '.join(run.axes)}.")
    for topic in run.simulated:
        here = topics.get(topic.path)
        if topic.path in energy.TOPICS and (here is None or (here.ticks, here.names) != (topic.ticks, topic.names)):
            return Section(title, f"Not audited: {topic.path} was not recorded as it was simulated.")
    if losses:
        return Section(title, f"Not audited: samples from {losses[0].start:g} to {losses[0].end:g} s are lost.")
    try:
        with np.errstate(all="ignore"):
            audit = energy.audit(run.recording.blocks(), run.scenario.parameters_at_start())
    except InputError as error:
        return Section(title, f"{error}.")
    if not math.isfinite(audit.residual):
        return Section(title, "Not audited: some samples are no numbers.")
    entries = [
        *((f"work of the {name}", value) for name, value in audit.work.items()),
        *((f"lost: {name}", value) for name, value in audit.losses.items()),
        ("more stored at the end than at the start", sum(audit.stored.values())),
        ("does not balance", audit.residual),
        ("beside it: electrical input of the motor", audit.electrical),
        ("beside it: heat in the winding", audit.copper_loss),
    ]
    if audit.limb:
        entries += [
            ("beside it: work of the arm", audit.limb["arm"]), ("beside it: lost in the grip", audit.limb["grip lost"])
        ]  # fmt: skip
    rows = [(name, number(value), number(value / audit.duration)) for name, value in entries]
    text = (
        "What motor and hand put into the mechanism, and where it went, from the recorded signals alone. The books "
        f"balance to {abs(audit.relative_residual):.2g} of the {number(audit.throughput)} J that passed through."
    )
    return Section(title, text, (("", "energy [J]", "mean power [W]"), *rows))


def _parameters(run: RecordedRun) -> Section:
    changed = run.changed_parameters
    if not changed:
        return Section("Parameters", "All parameters have their default values.")
    header = ("parameter", "value", "default", "unit", "meaning")
    rows = [(c.key, *_told_apart(c.value, c.default), c.unit, c.meaning) for c in changed]
    return Section("Parameters that differ from the defaults", "", (header, *rows))


def _told_apart(value: Any, default: Any) -> tuple[str, str]:
    """Both in six digits, or in all of them where six would be the same."""
    short = tuple(f"{x:.6g}" if type(x) is float else str(x) for x in (value, default))
    return (short[0], short[1]) if short[0] != short[1] else (str(value), str(default))


def _changes(run: RecordedRun) -> Section | None:
    rows = [
        (f"{change.at:g}", key, str(value), "at once" if change.over is None else f"over {change.over:g} s")
        for change in run.scenario.changes for key, value in flat(change.parameters)
    ]  # fmt: skip
    rows += [
        (f"{change.at:g}", change.parameter, f"follows {change.file}", "")
        for change in run.scenario.changes if change.parameter is not None
    ]  # fmt: skip
    rows.sort(key=lambda row: float(row[0]))
    rows += [
        ("0", key, f"from {course.low:g} to {course.high:g}", "follows the flight")
        for key, course in run.scenario.courses.items() if run.scenario.flight and key in run.scenario.flight.drives
    ]  # fmt: skip
    header = ("time [s]", "parameter", "value", "how")
    return Section("Parameters that change during the run", "", (header, *rows)) if rows else None


def _events(run: RecordedRun) -> Section | None:
    rows = [(f"{event.time:.4f}", event.level, event.source, event.message) for event in run.events]
    return Section("Events", "", (("time [s]", "level", "source", "what"), *rows)) if rows else None


def _timing(run: RecordedRun) -> Section:
    recording = run.recording
    topics = [(t.path, f"{t.rate:g}", str(len(t.signals)), t.meaning) for t in recording.topics.values()]
    text = ""
    wall = _seconds_between(recording.wall_start, recording.wall_end)
    if wall > 0:
        text = (
            f"{run.duration:g} s were simulated and recorded in {wall:.1f} s, {run.duration / wall:.1f} times as fast "
            "as real time (compilation, if any, included)."
        )
    return Section("Timing", text, (("topic", "samples per second", "signals", "meaning"), *topics))


def _seconds_between(start: str, end: str) -> float:
    """Time between two clocks, ISO 8601 [s]; 0 if one of them is none."""
    try:
        return (dt.datetime.fromisoformat(end) - dt.datetime.fromisoformat(start)).total_seconds()
    except (ValueError, TypeError, OverflowError):
        return 0.0


def _command(run: RecordedRun) -> str:
    """The commands that make the same recording again, and what they depend on; each word quoted for a shell."""
    words = ["cls-bench", "run"]
    rig = run.scenario.the_rig
    for entry in run.scenario.overrides:
        chosen = entry.partition("=")[0].strip() == "rig"
        words += ["--rig", rig.file if rig.is_file else rig.name] if chosen else ["--set", printable(entry, 1000)]
    about = {name: printable(text, 1000) for name, text in run.recording.metadata.items()}
    notes = [f"the rig's file is the attachment {one_line(rig.file)}"] if rig.is_file else []
    place = run.scenario.controller_place
    if not run.has_feel_model:
        source, name = about.get("controller.source", ""), about["controller.name"]
        digest = f" (SHA-256 {about['controller.sha256']})" if "controller.sha256" in about else ""
        if "controller.arguments" not in about:
            notes.append(f"the controller was the object {one_line(name)} of a program{digest}: see the attachment")
        else:
            arguments = _arguments(run.recording.metadata["controller.arguments"])
            if place is None or (place.module, place.name, dict(place.arguments)) != (source, name, arguments):
                words += ["--controller", f"{source}:{name}"]
                for key, value in arguments.items():
                    words += ["--controller-arg", f"{key}={_toml(value)}"]
            notes.append(f"the controller's source{digest} is the attachment controller.py")
    shipped = shipped_scenarios().get(run.name)
    known = shipped is not None and shipped.read_bytes() == run.scenario.source
    words.append(run.name if known else f"{run.name}.toml")  # the text below
    packages = ", ".join(
        f"{name} {about[name]}" for name in ("cls-bench", "mujoco", "numba", "numpy", "python") if name in about
    )
    notes.append(f"{one_line(packages)}; commit {one_line(about.get('commit', 'none'))}")
    if words[-1].startswith("-"):
        words.insert(-1, "--")
    return "\n".join([shlex.join(words), "", *(f"# {one_line(note)}" for note in notes)])


def _arguments(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _toml(value: Any) -> str:
    """A value as TOML writes it on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value, ensure_ascii=False)
