"""Reports: what the figures show, and what a real browser makes of the pages."""

import html
import json
import re
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from cls_bench import experiment
from cls_bench.cli import main
from cls_bench.errors import InputError
from cls_bench.parameters import DEG, Parameters
from cls_bench.recording import Recording
from cls_bench.report import comparison, figures, opengl, page, style
from cls_bench.report.recorded_run import RecordedRun, Span, held_on
from cls_bench.resources import shipped_scenarios
from cls_bench.scenario import parse_scenario
from cls_bench.signals import TOPIC
from tests import needs

Runner = Callable[..., experiment.Result]

FIGURES = {
    "friction_masking": ["torque_over_displacement", "evenness", "overview"],
    "fcs_validation_1": ["static", "free_response_1", "free_response_2", "overview"],
    "fcs_validation_2": ["static", "free_response_1", "free_response_2", "overview"],
    "fcs_validation_3": ["static", "free_response_1", "free_response_2", "overview"],
    "motion_tracking": ["tracking", "overview"],
    "stability_moderate": ["squeezing", "squeezing_close", "overview"],
    "stability_severe": ["squeezing", "squeezing_close", "overview"],
    "gearbox_imperfections": ["imperfections", "evenness", "overview"],
    "feel_two_body": ["static", "free_response_1", "free_response_2", "aft_side", "overview"],
    "feel_detents": ["static", "overview"],
    "feel_autopilot": ["aft_side", "overview"],
    "feel_malfunctions": ["aft_side", "overview"],
    "feel_shaker_pusher": ["aft_side", "overview"],
    "feel_trim": ["aft_side", "overview"],
    "feel_q": ["aft_side", "overview"],
    "feel_gusts": ["aft_side", "overview"],
    "aircraft_bell412": ["static", "free_response_1", "squeezing", "squeezing_close", "overview"],
    "aircraft_cyclic": ["static", "overview"],
    "aircraft_engine_lever": ["static", "overview"],
    "aircraft_light_aircraft_locked": ["static", "overview"],
}
OTHERS = ["static", "squeezing", "squeezing_close", "overview"]
"""Of the other aircraft: the sweep by which a manual's bands are judged, and how calm it is."""


def invoke(*arguments: object) -> Any:
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


# ---------------------------------------------------------------------------------------------------------------------
# Figures


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_has_the_thesis_figures(name: str, recorded: Runner) -> None:
    run = RecordedRun(recorded(name).mcap)
    drawn = list(figures.pictures(run))
    assert [picture.name for picture in drawn] == FIGURES.get(name, OTHERS)
    for picture in drawn:
        assert picture.title and len(picture.caption) > 40
        for ax in picture.figure.axes:
            labelled = [line for line in ax.lines if len(line.get_xdata()) > 2]
            assert labelled or ax.collections, f"{picture.name}: an empty plot"
            for line in labelled:
                assert np.isfinite(np.asarray(line.get_ydata(), float)).all()
            if ax.get_ylabel():
                assert re.search(r"\[.+\]", ax.get_ylabel()), f"{picture.name}: no unit in {ax.get_ylabel()!r}"
        assert re.search(r"\[.+\]", picture.figure.axes[-1].get_xlabel())


def curves(picture: figures.Picture, axes: int = 0) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    lines = picture.figure.axes[axes].lines
    return {str(line.get_label()): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in lines}


def test_friction_figure_shows_what_the_checks_measure(recorded: Runner) -> None:
    result = recorded("friction_masking")
    run = RecordedRun(result.mcap)
    off, on = run.spans("breakout_torque")
    assert (run.power_in(off), run.power_in(on)) == ("off", "on")
    assert run.power_in(Span(off.start, on.end)) == "changing"
    shown = curves(next(figures.pictures(run)))
    recording = result.recording()
    for label, span in (("drive power off", off), ("drive on, feel model running", on)):
        angle, torque = shown[label]
        measured = recording.read("/load_cell", ["torque"], *span, every=8)["torque"]
        assert (torque.min(), torque.max()) == (measured.min(), measured.max())  # thinning keeps the peaks
        column = recording.read("/column", ["angle"], *span, every=8)["angle"] / DEG
        assert angle.min() == pytest.approx(column.min(), abs=0.03)
    assert np.ptp(shown["drive power off"][1]) > 10 * np.ptp(shown["drive on, feel model running"][1])


def test_free_response_figure_compares_with_the_independent_solution(recorded: Runner) -> None:
    run = RecordedRun(recorded("fcs_validation_2").mcap)
    response = next(picture for picture in figures.pictures(run) if picture.name == "free_response_1")
    shown = curves(response)
    for label in ("column (measured)", "feel model (set)", "expected: independent solution"):
        assert shown[label][1][0] == pytest.approx(shown["column (measured)"][1][0], abs=0.1)
        assert shown[label][1][-1] > 2.5  # it does not come back
    header, *rows = response.table
    assert header[0] == "quantity" and any(row[0].startswith("time from 0.9") for row in rows)
    check = next(r for r in run.checks if r.check.name == "forward_part60")
    assert max(int(row[-1].rstrip("%")) for row in rows) == round(100 * check.value)


def test_orders_of_the_gearbox_stand_at_its_mesh_orders(recorded: Runner) -> None:
    run = RecordedRun(recorded("gearbox_imperfections").mcap)
    spectrum = next(p for p in figures.pictures(run) if p.name == "imperfections").figure.axes[1]
    orders, amplitude = (np.asarray(data) for data in spectrum.lines[0].get_data())
    box = Parameters().gearbox
    for stage, driven_by in ((box.stage2, box.stage1.ratio), (box.stage1, 1.0)):
        mesh = stage.teeth * (1 - 1 / stage.ratio) / driven_by
        near = np.abs(orders - mesh) < 1.0
        assert orders[near][np.argmax(amplitude[near])] == pytest.approx(mesh, abs=0.15)
        assert amplitude[near].max() > 5 * np.median(amplitude)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_order_amplitudes_of_a_known_wave(way: float) -> None:
    motor = way * (np.linspace(0.0, 2 * np.pi * 4.0, 5000) + 0.3 * np.sin(np.linspace(0.0, 9.0, 5000)))
    error = 0.2 * np.sin(14.4 * motor + 1.0) + 0.05 * np.cos(2.88 * motor) + 3.0 + 0.1 * motor
    orders = np.arange(0.0, 36.0, 0.05)
    amplitude = figures._order_amplitudes(motor, error, orders)
    for order, expected in ((14.4, 0.2), (2.88, 0.05)):
        assert amplitude[np.argmin(np.abs(orders - order))] == pytest.approx(expected, rel=0.05)
    assert amplitude[np.abs(orders - 25.0) < 3.0].max() < 0.002


def test_thinned_curves_keep_their_extremes_and_ends() -> None:
    rng = np.random.default_rng(1)
    time = np.linspace(0.0, 10.0, 123_457)
    wave = np.sin(time) + rng.standard_normal(len(time))
    for thinner in (style.thin, style.thin_path):
        x, y = thinner(time, wave)
        assert len(x) < 8 * style.PIXELS and (np.diff(x) > 0).all()
        assert (y.min(), y.max(), x[0], x[-1]) == (wave.min(), wave.max(), time[0], time[-1])
    short = np.arange(5.0)
    assert style.thin_path(short, short)[0] is short


def test_power_stays_on_while_a_signal_passes_through_zero() -> None:
    driven = np.zeros(400, np.bool_)
    driven[100:200] = True
    driven[120:140] = False  # 8 ms
    driven[300:] = True
    assert np.flatnonzero(np.diff(held_on(driven, 25))).tolist() == [99, 199, 299]


# ---------------------------------------------------------------------------------------------------------------------
# Pages in a browser


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    found = needs.browser()
    assert found is not None
    binary, driver = found
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for flag in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chrome = webdriver.Chrome(options=options, service=Service(driver))
    yield chrome
    chrome.quit()


def show(browser: Any, path: Path, width: int = 1280, height: int = 800, scheme: str = "light") -> None:
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    browser.get(path.as_uri())


@pytest.fixture(scope="module")
def two_runs(recorded: Runner, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[RecordedRun]]:
    runs = [RecordedRun(recorded(name).mcap) for name in ("stability_severe", "motion_tracking")]
    return page.write_report(runs, tmp_path_factory.mktemp("report")), runs


@pytest.mark.needs_browser
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (390, 844)])
def test_report_in_a_browser(browser: Any, two_runs: tuple[Path, list[RecordedRun]], width: int, height: int) -> None:
    path, runs = two_runs
    show(browser, path, width, height)
    assert browser.get_log("browser") == []
    assert browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)") == []
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    sizes = browser.execute_script(
        "return [...document.querySelectorAll('figure svg')].map(s => [s.getBoundingClientRect().width,"
        "s.getBoundingClientRect().height, s.querySelectorAll('path').length, s.getAttribute('aria-label')])"
    )
    assert len(sizes) == sum(len(FIGURES[run.name]) for run in runs)
    for wide, high, paths, label in sizes:
        assert min(width - 60, 800) < wide <= width and 0.3 < high / wide < 1.0 and paths > 20 and label
    for link in browser.execute_script("return [...document.querySelectorAll('a')].map(a => a.getAttribute('href'))"):
        target = path.parent / link
        exists = browser.execute_script("return !!document.getElementById(arguments[0])", link[1:])
        assert exists if link.startswith("#") else target.stat().st_size > 1000, link
    assert len(list(path.parent.rglob("*.png"))) == len(list(path.parent.rglob("*.svg"))) == len(sizes)


@pytest.mark.needs_browser
def test_report_has_no_id_twice_and_every_reference_has_its_target(
    browser: Any, two_runs: tuple[Path, list[RecordedRun]]
) -> None:
    path, _ = two_runs
    show(browser, path)
    ids = browser.execute_script("return [...document.querySelectorAll('[id]')].map(e => e.id)")
    assert len(set(ids)) == len(ids)
    text = path.read_text()
    used = set(re.findall(r'href="#([^"]+)"', text)) | set(re.findall(r"url\(#([^)]+)\)", text))
    assert used and used <= set(ids)


@pytest.mark.needs_browser
def test_report_in_the_dark_and_in_print(browser: Any, two_runs: tuple[Path, list[RecordedRun]]) -> None:
    path, _ = two_runs
    script = (
        "const s = getComputedStyle(document.querySelector('figure svg text'));"
        "return [getComputedStyle(document.body).backgroundColor, s.fill]"
    )

    def brightness(color: str) -> float:
        return float(np.mean([int(part) for part in re.findall(r"\d+", color)[:3]]))

    seen = {}
    for scheme in ("light", "dark"):
        show(browser, path, scheme=scheme)
        seen[scheme] = [brightness(color) for color in browser.execute_script(script)]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {
        "media": "print", "features": [{"name": "prefers-color-scheme", "value": "dark"}],
    })  # fmt: skip
    seen["print"] = [brightness(color) for color in browser.execute_script(script)]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    for scheme in ("light", "print"):
        paper, ink = seen[scheme]
        assert paper > 200 and ink < 110, scheme
    paper, ink = seen["dark"]
    assert paper < 60 and ink > 200


def test_report_says_what_the_run_measured(two_runs: tuple[Path, list[RecordedRun]]) -> None:
    path, runs = two_runs
    text = html.unescape(path.read_text())
    assert not re.search(r"""(?:src|href)=["'](?:https?:)?//""", text)
    for run in runs:
        assert run.scenario.title in text
        for result in run.checks:
            row = rf"<td>{result.check.name}</td><td class=\"(passed)?\">(passed)?</td><td class=\"number\">"
            assert re.search(row + re.escape(page.number(result.value)), text), result.check.name
    assert "feel.inertia</td><td>0.15</td><td>0.3</td>" in text
    assert "stage 1 friction" in text and "The books balance" in text
    assert "cls-bench run stability_severe" in text


def test_a_failed_run_with_overrides_says_so_and_how_to_repeat_it(tmp_path: Path) -> None:
    toml = 'title = "<b>A & B</b>"\nduration = 0.4\n[[hand]]\nat = 0.0\nkind = "ramp"\nto_deg = 3.0\nover = 0.2\n' + (
        '[[checks]]\nname = "peak"\nmetric = "maximum"\nsignal = "/column.angle"\nwindow = [0.0, 0.4]\nmin = 1.0\n'
    )
    result = experiment.run(parse_scenario(toml, set=["feel.inertia=0.5"]), out=tmp_path, rerun=False)
    moved = tmp_path / "elsewhere" / "run.mcap"
    moved.parent.mkdir()
    result.mcap.rename(moved)
    done = invoke("report", moved, "--out", tmp_path / "pages")
    assert done.exit_code == 0, done.output
    text = Path(done.output.strip()).read_text()
    assert '<span class="verdict failed">failed</span>' in text
    assert "&lt;b&gt;A &amp; B&lt;/b&gt;" in text and "<b>A" not in text
    assert "--set feel.inertia=0.5" in html.unescape(text) and "<td>feel.inertia</td><td>0.5</td>" in text


def test_report_of_a_killed_run(recorded: Runner, tmp_path: Path) -> None:
    whole = recorded("motion_tracking").mcap.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: len(whole) // 2])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = RecordedRun(cut)
        text = page.write_report([run], tmp_path).read_text()
    assert 2.0 < run.duration < 6.0
    assert '<span class="verdict incomplete">incomplete</span>' in text and "was cut short" in text


def test_sample_files_travel_in_the_recording(tmp_path: Path) -> None:
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "hand.csv").write_text("time,value\n0,0\n0.2,2\n")
    scenario = tmp_path / "s" / "sampled.toml"
    scenario.write_text(
        'title = "Samples"\nduration = 0.3\n[[hand]]\nat = 0.0\nkind = "samples"\nfile = "hand.csv"\nunit = "deg"\n'
    )
    result = experiment.run(scenario, out=tmp_path, rerun=False)
    shutil.rmtree(tmp_path / "s")
    run = RecordedRun(result.mcap)
    assert run.scenario.sample_files == {"hand.csv": b"time,value\n0,0\n0.2,2\n"}


@pytest.mark.needs_browser
def test_gallery_links_every_report(browser: Any, two_runs: tuple[Path, list[RecordedRun]], tmp_path: Path) -> None:
    _, runs = two_runs
    index = page.write_gallery(runs, tmp_path)
    show(browser, index, 390, 844)
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
    links = browser.execute_script("return [...document.querySelectorAll('.card a')].map(a => a.getAttribute('href'))")
    assert links == ["stability_severe.html", "motion_tracking.html"]
    for link in links:
        assert "<svg" in (tmp_path / link).read_text()


# ---------------------------------------------------------------------------------------------------------------------
# Comparison, command line


def test_comparison_tells_metrics_parameters_and_curves_apart(
    two_runs: tuple[Path, list[RecordedRun]], recorded: Runner, tmp_path: Path
) -> None:
    severe, moderate = two_runs[1][0].path, recorded("stability_moderate").mcap
    done = invoke("compare", moderate, severe, "--signal", "/column.angle", "--window", 1, 5, "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert max(map(len, done.output.splitlines()[:-1])) <= 80
    assert re.search(r"feel\.inertia +0\.25 +0\.15", done.output)
    a, b = RecordedRun(moderate), RecordedRun(severe)
    amplitude = next(d for d in comparison.differences(a, b) if d.name == "squeezed_amplitude")
    expected = (
        recorded("stability_moderate")["squeezed_amplitude"],
        recorded("stability_severe")["squeezed_amplitude"],
    )
    assert (amplitude.first, amplitude.second) == expected
    assert amplitude.relative == pytest.approx(expected[1] / expected[0] - 1)
    (picture,) = comparison.overlays(a, b, ["/column.angle"], Span(1.0, 5.0), [])
    difference = curves(picture, 1)
    ((_, y),) = difference.values()
    angles = [r.recording.read("/column", ["angle"], 1.0, 5.0, every=8)["angle"] / DEG for r in (a, b)]
    assert y.max() == pytest.approx((angles[1] - angles[0]).max(), rel=1e-9)


def test_comparison_of_a_run_with_itself_is_all_zero(two_runs: tuple[Path, list[RecordedRun]]) -> None:
    run = two_runs[1][1]
    assert all(d.change == 0.0 for d in comparison.differences(run, run)) and comparison.differences(run, run)
    assert comparison.parameter_differences(run, run) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("report", "nothing.mcap"), "nothing.mcap"),
        (("compare", "RUN", "RUN", "--signal", "/column.angel"), 'no signal "angel"'),
        (("compare", "RUN", "RUN", "--window", "90", "99"), "there is nothing from 90"),
        (("render", "RUN", "--camera", "moon"), "valid: bench, side, pilot, drive"),
        (("render", "RUN", "--at", "99"), "ends at"),
        (("report", "RUN", "--out", "RUN/x"), "cannot write"),
    ],
)
def test_mistakes_are_one_line(
    arguments: tuple[str, ...], message: str, two_runs: tuple[Path, list[RecordedRun]]
) -> None:
    run = str(two_runs[1][1].path)
    done = invoke(*(argument.replace("RUN", run) for argument in arguments))
    assert done.exit_code == 2
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1 and message in done.stderr


# ---------------------------------------------------------------------------------------------------------------------
# Drawing the bench


def rendered(*arguments: object) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own: MuJoCo settles on an OpenGL library when it is imported."""
    command = [sys.executable, "-c", "from cls_bench.cli import main; main()", "render", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.needs_opengl
def test_still_shows_the_bench_where_it_was(two_runs: tuple[Path, list[RecordedRun]], tmp_path: Path) -> None:
    from PIL import Image

    recording = two_runs[1][1].recording
    angle = recording.read("/column", ["angle"], every=200)
    images = []
    for at in (angle.time[np.argmin(angle["angle"])], angle.time[np.argmax(angle["angle"])]):
        out = tmp_path / f"{at:.2f}.png"
        done = rendered(recording.path, "--at", at, "--camera", "side", "--size", 400, 300, "--out", out)
        assert done.returncode == 0, done.stderr
        image = np.asarray(Image.open(out), float)
        assert image.shape == (300, 400, 3)
        images.append(image)
    red, green, blue = images[0][..., 0], images[0][..., 1], images[0][..., 2]
    assert ((blue > 1.5 * red) & (blue > 120)).sum() > 100  # the load cell
    assert ((red > 2.5 * green) & (red > 120)).sum() > 30  # the stops
    upper = [image[:90] for image in images]  # the forearm is in the upper third
    sleeves = [np.nonzero((i[..., 2] > i[..., 0] + 25) & (i[..., 0] > 60) & (i[..., 0] < 130))[1] for i in upper]
    assert np.mean(sleeves[1]) > np.mean(sleeves[0]) + 10  # pushed forward, to the right


@pytest.mark.needs_opengl
def test_video_has_a_frame_for_every_step(two_runs: tuple[Path, list[RecordedRun]], tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg")
    out = tmp_path / "run.mp4"
    span = ("--from", 3, "--to", 3.4, "--speed", 0.5)
    done = rendered(two_runs[1][1].path, "--video", *span, "--size", 160, 120, "--out", out)
    assert done.returncode == 0, done.stderr
    frames, duration = ffmpeg.count_frames_and_secs(str(out))
    assert frames == 40 and duration == pytest.approx(0.8)


def test_without_opengl_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr("ctypes.util.find_library", lambda name: None)
    with pytest.raises(InputError, match="apt install libegl1"):
        opengl.choose()


# ---------------------------------------------------------------------------------------------------------------------
# Other viewers and libraries


def test_the_layout_for_lichtblick_names_what_is_recorded() -> None:
    layout = json.loads((Path(__file__).parent.parent / "docs" / "lichtblick.json").read_text())
    paths = [path["value"] for panel in layout["configById"].values() for path in panel.get("paths", [])]
    paths += [p["xAxisPath"]["value"] for p in layout["configById"].values() if "xAxisPath" in p]
    assert len(paths) >= 12
    for path in paths:
        topic, _, name = path.rpartition(".")
        assert name in TOPIC[topic].names, path

    def panels(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
            for tab in layout["configById"][node].get("tabs", []):
                yield from panels(tab["layout"])
        else:
            yield from panels(node["first"])
            yield from panels(node["second"])

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])


def test_signals_as_data_frames(recorded: Runner) -> None:
    pandas = pytest.importorskip("pandas")
    recording = Recording(recorded("motion_tracking").mcap)
    series = recording.read("/feel", start=1.0, end=1.5)
    frame = series.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and list(frame.columns) == list(TOPIC["/feel"].names)
    assert np.array_equal(frame.index, series.time) and np.array_equal(frame["angle"], series["angle"])
    everything = recording.read_all(1.0, 1.5)
    assert list(everything) == list(recording.topics)
    for topic, values in everything.items():
        assert np.array_equal(values.time, recording.read(topic, start=1.0, end=1.5).time)
        for name in values.values:
            assert np.array_equal(values[name], recording.read(topic, [name], 1.0, 1.5)[name])
