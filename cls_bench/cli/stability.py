"""frequency-response, predict, onset, stability-map, stabilisers, check onset."""

import csv
import dataclasses
import functools
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cls_bench.cli.failures import say
from cls_bench.cli.options import FINITE, SEED, FiniteRange, GivenController, controller_options, rig_option
from cls_bench.cli.output import number, print_json, print_table, results_folder, warn_of_drive
from cls_bench.cli.sweep import points_progress
from cls_bench.errors import ExitCode, InputError, Interrupted, OutputError

if TYPE_CHECKING:
    from cls_bench.analysis.frequency import FrequencyResponse
    from cls_bench.controllers import Place
    from cls_bench.linear.variation import Setup, Variation
    from cls_bench.stability.onset import Onset
    from cls_bench.stability.trial import Standard

HERTZ = FiniteRange(0, 1e4, min_open=True)
"""A frequency [Hz]."""

_LOOPS = ("velocity-loop", "position-loop", "outer-loop", "rendered-admittance")


@dataclasses.dataclass(frozen=True)
class GivenSetup:
    """What the command line says of the bench and of the hand on it."""

    rig: str | None
    overrides: tuple[str, ...]
    grip: str
    by_force: bool
    ideal: bool

    def of(self) -> "Setup":
        """The operating point. Raises InputError."""
        from cls_bench.linear.hand import Hand
        from cls_bench.linear.variation import Setup
        from cls_bench.linear.variation import ideal as idealised
        from cls_bench.scenario import parameters_of

        p = parameters_of(self.rig, self.overrides)
        squeeze: float | None = None
        if self.grip != "off":
            try:
                squeeze = float(self.grip)
            except ValueError:
                squeeze = math.nan
            if not 0.0 <= squeeze <= 1.0:
                raise InputError(f"--grip {self.grip}: must be a number from 0 (loose) to 1 (tight), or off")
        elif self.by_force:
            raise InputError("--by-force: a hand that is off pushes with no force; give it a --grip from 0 to 1")
        return Setup(idealised(p) if self.ideal else p, Hand(squeeze, arm=not self.by_force))


def _setup_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options of the bench and the hand; passed on as ``given``."""

    @functools.wraps(function)
    def command(
        *arguments: Any, rig: str | None, overrides: tuple[str, ...], ideal: bool, grip: str = "1",
        by_force: bool = False, **options: Any,
    ) -> Any:  # fmt: skip
        return function(*arguments, given=GivenSetup(rig, overrides, grip, by_force, ideal), **options)

    wrapped: Callable[..., Any] = command
    for option in (
        click.option("--set", "overrides", metavar="KEY=VALUE", multiple=True,
                     help="Override a parameter, such as feel.inertia=0.25; may be given again."),
        rig_option,
        click.option("--ideal", is_flag=True, help="Without friction, backlash, noise and coarse counts."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped


def _grip_options(function: Callable[..., Any]) -> Callable[..., Any]:
    for option in (
        click.option("--by-force", is_flag=True, help="The hand pushes with a force; no arm holds its place."),
        click.option("--grip", default="1", show_default=True, metavar="0…1|off",
                     help="How tightly the hand grips, 0 loose to 1 tight, or off."),
    ):  # fmt: skip
        function = option(function)
    return function


@dataclasses.dataclass(frozen=True)
class GivenTrial:
    """What the command line says of a trial."""

    rate_deg: float | None
    pulse: float | None
    slowest_hz: float
    seed: int

    def of(self, given: GivenSetup) -> "Standard":
        """The trial of that bench. Raises InputError."""
        from cls_bench.stability.trial import STILL, Standard

        standard = STILL if given.ideal else Standard()
        return dataclasses.replace(
            standard, rate_deg=standard.rate_deg if self.rate_deg is None else self.rate_deg,
            pulse=standard.pulse if self.pulse is None else self.pulse, seed=self.seed, slowest=self.slowest_hz,
        )  # fmt: skip


def _trial_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Options of a trial; passed on as ``trial``."""

    @functools.wraps(function)
    def command(
        *arguments: Any, rate_deg: float | None, pulse: float | None, slowest_hz: float, seed: int, **options: Any
    ) -> Any:
        return function(*arguments, trial=GivenTrial(rate_deg, pulse, slowest_hz, seed), **options)

    wrapped: Callable[..., Any] = command
    for option in (
        click.option("--rate-deg", type=FiniteRange(0), metavar="DEG/S",
                     help="Rate at which the hand moves the column during a trial; 0 holds still.  [default: 20, "
                          "with --ideal 0]"),
        click.option("--pulse", type=FiniteRange(0, min_open=True), metavar="RAD/S²",
                     help="Acceleration that the disturbing pulse gives the feel model for 10 ms.  [default: 35, "
                          "with --ideal 5]"),
        click.option("--slowest-hz", type=FiniteRange(1, 10), default=10.0, show_default=True, metavar="HZ",
                     help="Slowest oscillation that a trial sees; slower ones need longer trials."),
        click.option("--seed", type=SEED, default=0, show_default=True, help="Seed of the noise."),
    ):  # fmt: skip
        wrapped = option(wrapped)
    return wrapped


def _find(
    controller: GivenController, setup: "Setup", vary: "Variation", standard: "Standard", *, quiet: bool,
    tolerance: float | None = None, follow: bool = True,
) -> "Onset":  # fmt: skip
    """Search an onset; with a controller of the user's own in a process of its own."""
    from cls_bench.stability.onset import TOLERANCE

    arguments = controller.of(), setup, vary, standard, tolerance or TOLERANCE, follow
    report = _trial_line(vary.unit, quiet)
    if arguments[0] is None:
        return _find_job(report, *arguments)
    from cls_bench.cli.supervisor import supervised

    def tell(*what: Any) -> None:
        if len(what) == 2:
            report(*what)
        elif not quiet:
            say("compiling the simulation, once after each installation: about half a minute")

    found: Onset = supervised(_find_job, *arguments, limits=controller.limits, tell=tell)
    return found


def _find_job(
    tell: Callable[..., None], place: "Place | None", setup: "Setup", vary: "Variation", standard: "Standard",
    tolerance: float, follow: bool,
) -> "Onset":  # fmt: skip
    """The search, told of every trial; a fresh object of the controller for each."""
    from cls_bench.controllers import Controller
    from cls_bench.stability.onset import find

    make = None if place is None else Controller(place).make
    return find(setup, vary, standard, tolerance=tolerance, make_loop=make, follow=follow, report=tell)


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


@click.command("frequency-response")
@click.argument("loop", type=click.Choice(_LOOPS))
@_setup_options
@_grip_options
@click.option("--excitation", type=click.Choice(["multisine", "stepped-sine", "chirp"]),
              help="How it is excited.  [default: multisine; the rendered admittance: chirp]")  # fmt: skip
@click.option("--amplitude", type=FiniteRange(0, min_open=True),
              help="Peak of the column's set angle [deg]; of the hand's force [N] for the rendered admittance.  "
                   "[default: 1 deg, 20 N]")  # fmt: skip
@click.option("--from-hz", type=HERTZ, default=4.0, show_default=True, help="Lowest frequency.")
@click.option("--to-hz", type=HERTZ, default=250.0, show_default=True, help="Highest frequency.")
@click.option("--points", type=click.IntRange(2, 500), default=24, show_default=True,
              help="Frequencies of a stepped sine.")  # fmt: skip
@click.option("--out", type=click.Path(path_type=Path),
              help="Folder for CSV and figures.  [default: recordings/LOOP]")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def frequency_response(
    loop: str, given: GivenSetup, excitation: str | None, amplitude: float | None,
    from_hz: float, to_hz: float, points: int, out: Path | None, as_json: bool,
) -> None:  # fmt: skip
    """Measure a loop's frequency response on the running simulation.

    Writes CSV, Bode and Nyquist figures, with the linear model's response beside the measured one. The bench is not
    linear: each response belongs to its amplitude, and the coherence says how much of the output it explains.
    """
    began = time.time()
    from cls_bench.claims import RECORDINGS
    from cls_bench.report.style import save
    from cls_bench.stability import figures
    from cls_bench.stability.response import Excitation, measure

    setup = given.of()
    through_hand = loop == "rendered-admittance"
    measured = measure(
        setup, loop,
        Excitation(
            excitation or ("chirp" if through_hand else "multisine"), amplitude or (20.0 if through_hand else 1.0),
            from_hz, to_hz, points,
        ),
    )  # fmt: skip
    folder = results_folder(out or RECORDINGS / loop, began)
    written: list[Path] = []
    found: dict[str, dict[str, float]] = {}
    try:
        for kind, response in (("closed", measured.closed), ("open", measured.open)):
            if response is None:
                continue
            path = folder / f"{kind}.csv"
            response.write_csv(path)
            written += [path, *save(figures.bode(measured, closed=kind == "closed"), folder / f"bode_{kind}")]
            found[kind] = _numbers(response, kind, loop)
        if measured.open is not None:
            written += save(figures.nyquist(measured), folder / "nyquist")
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror}") from None
    for line in measured.limited:
        say(f"warning: {line}")
    if as_json:
        numbers = {k: {name: _finite(value) for name, value in v.items()} for k, v in found.items()}
        print_json({
            "loop": loop, "numbers": numbers, "limits_reached": list(measured.limited),
            "files": [str(path) for path in written],
        })  # fmt: skip
        return
    rows = [(kind, name, "—" if math.isnan(v) else number(v)) for kind, values in found.items()
            for name, v in values.items()]  # fmt: skip
    print_table(("response", "quantity", "value"), rows)
    for path in written:
        click.echo(f"  {path}")


def _numbers(response: "FrequencyResponse", kind: str, loop: str) -> dict[str, float]:
    """What is read off a response, with units in the names."""
    crossover, magnitude = response.phase_crossover()
    decibel = 20.0 * math.log10(magnitude) if magnitude > 0 else math.nan
    found = {"lowest_coherence": float(response.coherence.min())}
    if loop == "rendered-admittance":
        return found
    if kind == "closed":
        peak_at, peak = response.resonance()
        return {
            "bandwidth_Hz": response.bandwidth(), "f_180_Hz": crossover, "M_P180_dB": decibel,
            "resonance_dB": 20.0 * math.log10(peak), "resonance_Hz": peak_at, **found,
        }  # fmt: skip
    gain, at_gain, phase, at_phase = response.margins()
    return {
        "gain_margin_dB": 20.0 * math.log10(gain) if 0 < gain < math.inf else gain, "phase_crossover_Hz": at_gain,
        "phase_margin_deg": math.degrees(phase), "gain_crossover_Hz": at_phase, **found,
    }  # fmt: skip


@click.command()
@_setup_options
@_grip_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def predict(given: GivenSetup, as_json: bool) -> None:
    """Predict stability and margins from the linear model, with Eq. 3.16 beside it."""
    from threadpoolctl import threadpool_limits

    from cls_bench.linear.prediction import critical
    from cls_bench.linear.prediction import predict as predicted
    from cls_bench.linear.variation import variation

    setup = given.of()
    alone = warn_of_drive(setup.parameters)

    def unit(name: str) -> str:
        return variation(name, of=setup.parameters).unit

    with threadpool_limits(1):
        p = predicted(setup)
        critical_at = {
            name: critical(setup, variation(name, of=setup.parameters))
            for name in ("feel.inertia", "forward_inertia", "limb_mass", "squeeze", "delay")
            if setup.hand.squeeze is not None or name in ("feel.inertia", "delay")
        }
    if as_json:
        found = {name: _finite(value) for name, value in dataclasses.asdict(p).items() if name != "rule"}
        rule = {**dataclasses.asdict(p.rule), "critical_ratio": p.rule.critical_ratio, "stable": p.rule.stable}
        print_json({
            **found, "rule": {k: _finite(v) for k, v in rule.items()}, "critical": critical_at,
            "drive_alone": alone or None,
        })  # fmt: skip
        return
    rows = [
        ("verdict", "stable" if p.stable else "UNSTABLE"),
        ("oscillation", f"{p.frequency:.1f} Hz, growth rate {p.growth:+.2f} 1/s"),
        ("gain margin", f"factor {p.gain_margin:.3f} at {p.phase_crossover:.1f} Hz"
                        if math.isfinite(p.gain_margin) else "none: no gain makes it unstable"),
        ("phase margin", f"{math.degrees(p.phase_margin):.1f}° at {p.gain_crossover:.1f} Hz"
                         if math.isfinite(p.phase_margin) else "none: the loop's gain stays below 1"),
        ("Eq. 3.16", f"{'stable' if p.rule.stable else 'unstable'}: I_fwd/I_fcs = {p.rule.ratio:.3f}, "
                     f"onset at {p.rule.critical_ratio:.3f}"),
        ("P of the bare column", f"f_180 = {p.rule.crossover:.1f} Hz, "
                                 f"M_P180 = {20 * math.log10(p.rule.magnitude):.1f} dB"),
        *((f"critical {name}", "none in its range" if value is None else f"{value:.4g} {unit(name)}")
          for name, value in critical_at.items()),
    ]  # fmt: skip
    print_table(("predicted", ""), rows)


@click.command()
@click.option("--vary", default="feel.inertia", show_default=True,
              help="feel.inertia, limb_mass, forward_inertia, squeeze, delay, or any numeric parameter.")  # fmt: skip
@click.option("--from", "low", type=FINITE, help="Lower end of the range.")
@click.option("--to", "high", type=FINITE, help="Upper end of the range.")
@click.option("--tolerance", type=FiniteRange(0.0005, 0.2), default=0.02, show_default=True,
              help="Width of the final bracket over its value.")  # fmt: skip
@_setup_options
@_grip_options
@_trial_options
@controller_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of tables.")
def onset(
    vary: str, low: float | None, high: float | None, tolerance: float, given: GivenSetup, trial: GivenTrial,
    controller: GivenController, as_json: bool,
) -> None:  # fmt: skip
    """Search where the running bench turns unstable."""
    from cls_bench.linear.variation import variation

    setup = given.of()
    warn_of_drive(setup.parameters)
    quantity = variation(vary, low, high, of=setup.parameters)
    found = _find(controller, setup, quantity, trial.of(given), quiet=as_json, tolerance=tolerance)
    last = found.last_unstable
    if as_json:
        oscillation = None if last is None else {k: _finite(v) for k, v in dataclasses.asdict(last).items()}
        print_json({
            "vary": vary, "unit": quantity.unit, "onset": found.value, "stable_at": found.stable_at,
            "unstable_at": found.unstable_at, "predicted": found.predicted, "eq_3_16": found.rule,
            "oscillation": oscillation, "trials": found.trials, "simulated_s": round(found.simulated, 4),
        })  # fmt: skip
        return

    def value(x: float | None) -> str:
        return "—" if x is None else f"{number(x)} {quantity.unit}"

    if found.value is None:
        click.echo(
            f"{'stable' if found.stable_at is not None else 'unstable'} at both ends, "
            f"{number(quantity.low)} and {number(quantity.high)} {quantity.unit}"
        )
    rows = [
        ("simulated", value(found.value)), ("linear model", value(found.predicted)), ("Eq. 3.16", value(found.rule))
    ]  # fmt: skip
    if last is not None:
        rows.append(
            (f"at {value(found.unstable_at)}",
             f"{last.reason}: ±{last.amplitude_deg:.3f}° at {last.frequency:.1f} Hz, {last.growth:+.2f} 1/s")
        )  # fmt: skip
    print_table((f"onset over {vary}", ""), rows)


def _trial_line(unit: str, quiet: bool) -> Any:
    def report(value: float, verdict: Any) -> None:
        if not quiet:
            said = "stable  " if verdict.stable else "unstable"
            rate = "" if not math.isfinite(verdict.growth) else f", {verdict.growth:+.2f} 1/s"
            say(f"{number(value):>8} {unit}: {said} ({verdict.reason}{rate})")

    return report


@click.command("stability-map")
@click.option("--x", default="feel.inertia", show_default=True, help="Quantity along x, as for onset --vary.")
@click.option("--y", default="forward_inertia", show_default=True, help="Quantity along y.")
@click.option("--x-range", type=(FINITE, FINITE), help="Its range.  [default: 0.1 1 for feel.inertia]")
@click.option("--y-range", type=(FINITE, FINITE), help="Its range.  [default: 0.05 1 for forward_inertia]")
@click.option("--size", type=(click.IntRange(2, 500), click.IntRange(2, 500)), default=(20, 20), show_default=True,
              help="Columns and rows.")  # fmt: skip
@_setup_options
@_grip_options
@_trial_options
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: recordings/stability-map]")
@click.option("--resume", is_flag=True, help="Continue a map that was interrupted.")
@click.option("--scheduler", default="threads", show_default=True, metavar="WHERE",
              help="threads, threads:N, local-cluster:N, or the tcp:// address of a Dask scheduler.")  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")
def stability_map(
    x: str, y: str, x_range: tuple[float, float] | None, y_range: tuple[float, float] | None, size: tuple[int, int],
    given: GivenSetup, trial: GivenTrial, out: Path | None, resume: bool, scheduler: str, as_json: bool,
) -> None:  # fmt: skip
    """Map stability over two quantities: a trial at each point, beside the linear model and Eq. 3.16.

    Ctrl-C keeps the points that are done, in points.jsonl; --resume continues from there.
    """
    began = time.time()
    from cls_bench.claims import RECORDINGS, replaced
    from cls_bench.linear.variation import variation
    from cls_bench.report.style import save
    from cls_bench.stability import figures
    from cls_bench.stability.map import Grid, compute, default_grid, table

    setup = given.of()
    usual = default_grid(setup.parameters)
    axes = []
    for name, ends, default in ((x, x_range, usual.x), (y, y_range, usual.y)):
        axes.append(default if ends is None and name == default.name else
                    variation(name, *(ends or (None, None)), of=setup.parameters))
    folder = results_folder(out or RECORDINGS / "stability-map", began, resume=resume)
    journal = folder / "points.jsonl"
    try:
        with points_progress(quiet=as_json) as report:
            result = compute(
                setup, Grid(axes[0], axes[1], *size), trial.of(given), journal=journal, resume=resume,
                scheduler=scheduler, report=report, say=lambda line: click.echo(line, err=True),
            )  # fmt: skip
    except KeyboardInterrupt:
        raise Interrupted(f"interrupted; kept: {journal}; continue with --resume") from None
    path = folder / "map.csv"
    rows = table(result)
    columns = list(dict.fromkeys(key for row in rows for key in row))
    try:
        with replaced(path) as whole, whole.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(rows)
        written = [path, *save(figures.stability_map(result), folder / "map")]
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror}") from None
    if as_json:
        print_json({"points": len(rows), "agreement": _finite(result.agreement), "eq_3_16_ratio": result.rule_ratio,
                    "files": [str(path) for path in written]})  # fmt: skip
        return
    stable = sum(bool(row.get("stable")) for row in rows)
    click.echo(f"{len(rows)} trials, {stable} stable; linear model and simulation agree at {result.agreement:.1%}")
    for path in written:
        click.echo(f"  {path}")


@click.command()
@_setup_options
@_grip_options
@_trial_options
@click.option("--out", type=click.Path(path_type=Path), help="Folder.  [default: recordings/stabilisers]")
@click.option("--scheduler", default="threads", show_default=True, metavar="WHERE", help="As for stability-map.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of a table.")
def stabilisers(
    given: GivenSetup, trial: GivenTrial, out: Path | None, scheduler: str, as_json: bool,
) -> None:  # fmt: skip
    """Least stable simulated inertia with and without what a designer can do about it."""
    began = time.time()
    from cls_bench.claims import RECORDINGS
    from cls_bench.report.style import save
    from cls_bench.stability import figures
    from cls_bench.stability.stabilisers import compare, search_range

    setup = given.of()
    with points_progress(quiet=as_json) as report:
        found = compare(setup, trial.of(given), scheduler=scheduler, report=report)
    folder = results_folder(out or RECORDINGS / "stabilisers", began)
    try:
        written = save(figures.stabilisers(found, search_range(setup.parameters)[1]), folder / "stabilisers")
    except OSError as error:
        raise OutputError(f"cannot write {folder}: {error.strerror}") from None
    if as_json:
        rows = [{k: _finite(v) for k, v in dataclasses.asdict(row).items()} for row in found]
        print_json({"least_inertia": rows, "files": [str(path) for path in written]})
        return

    def inertia(value: float) -> str:
        return "unstable" if math.isinf(value) else "stable" if value == 0 else f"{value:.3f}"

    print_table(
        ("measure", "simulated [kg·m²]", "linear model", "onset [Hz]"),
        [(r.name, inertia(r.simulated), inertia(r.predicted), "—" if r.frequency is None else f"{r.frequency:.0f}")
         for r in found],
    )  # fmt: skip
    for path in written:
        click.echo(f"  {path}")


@click.group()
def check() -> None:
    """Gates for continuous integration: exit code 0 if passed, 1 if not."""


@check.command("onset")
@click.option("--min-ratio", type=FiniteRange(0, 1e3, min_open=True), metavar="R",
              help="Least I_fwd / I_fcs at which the bench may turn unstable.")  # fmt: skip
@click.option("--min-margin", type=FiniteRange(0, 1e3), metavar="M",
              help="Least share by which I_fwd may still grow from the present limb and column to the onset: "
                   "onset / present - 1.  [default: 0, the present hand must be stable]")  # fmt: skip
@_setup_options
@_trial_options
@controller_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object instead of text.")
@click.pass_context
def check_onset(
    ctx: click.Context, min_ratio: float | None, min_margin: float | None, given: GivenSetup, trial: GivenTrial,
    controller: GivenController, as_json: bool,
) -> None:  # fmt: skip
    """Pass if a tight grip stays stable up to I_fwd = R · I_fcs, and the present hand is stable by a margin.

    The limb's mass is raised until the running bench turns unstable. I_fcs is feel.inertia, also with a controller of
    your own. The present I_fwd is that of limb and column as the parameters have them. Give at least one of --min-ratio
    and --min-margin.
    """
    from cls_bench.linear.hand import forward_inertia
    from cls_bench.linear.variation import variation

    if min_ratio is None and min_margin is None:
        raise InputError("check onset: give --min-ratio, --min-margin, or both")
    wanted = 0.0 if min_margin is None else min_margin
    setup = given.of()
    vary = variation("forward_inertia", of=setup.parameters)
    found = _find(controller, setup, vary, trial.of(given), quiet=True, follow=False)
    inertia, present = setup.parameters.feel.inertia, forward_inertia(setup.parameters, setup.hand)
    critical = found.value if found.value is not None else 0.0 if found.stable_at is None else math.inf
    ratio, margin = critical / inertia, critical / present - 1.0
    passed = (min_ratio is None or ratio >= min_ratio) and margin >= wanted
    if as_json:
        print_json({
            "status": "passed" if passed else "failed", "ratio": _finite(ratio), "min_ratio": min_ratio,
            "margin": _finite(margin), "min_margin": wanted, "present_forward_inertia": present,
            "present_stable": margin > 0, "critical_forward_inertia": found.value, "feel_inertia": inertia,
            "predicted": found.predicted,
        })  # fmt: skip
    else:
        low, high = found.vary.low, found.vary.high
        at = (f"onset at I_fwd = {found.value:.4g} kg·m²" if found.value is not None else
              f"unstable from I_fwd = {low:g} kg·m² on" if found.stable_at is None else
              f"stable up to I_fwd = {high:g} kg·m²")  # fmt: skip
        least = "" if min_ratio is None else f", wanted at least {min_ratio:g}"
        click.echo(f"{'passed' if passed else 'FAILED'}: {at}, I_fwd / I_fcs = {ratio:.3f}{least}")
        beyond = "" if margin > 0 else ": THE PRESENT HAND IS BEYOND THE ONSET"
        click.echo(f"present I_fwd = {present:.4g} kg·m², margin {margin:+.1%}, wanted at least {wanted:+.1%}{beyond}")
    ctx.exit(ExitCode.PASSED if passed else ExitCode.FAILED)
