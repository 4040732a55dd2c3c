"""Makes the pictures of the README and the page docs/gallery.md from fresh runs.

``python -m cls_bench.report.readme_pictures docs`` needs OpenGL and a Vulkan driver (on Debian: libegl1,
libgl1-mesa-dri, mesa-vulkan-drivers).
"""

import sys
import tempfile
from pathlib import Path

from cls_bench.report import opengl

SHOWN = "friction_masking"
"""Scenario of the README's pictures."""

BREAKS_AWAY_S = 2.2
"""Time at which it shows most: power is off and the hand pulls the gearbox loose [s]."""

_HEAD = """<!-- made by `make pictures` -->
# Gallery

What the shipped scenarios show, each drawn from the recording of one run. `cls-bench gallery` builds the same as web
pages with a whole report of every run: verdict, all figures, energy audit, parameters, how to run it again.

![The bench in the Rerun viewer](pictures/rerun.png)
"""


def main(docs: Path) -> None:
    """Write ``pictures/*.png`` and ``gallery.md`` into ``docs``."""
    opengl.choose()
    from cls_bench import experiment
    from cls_bench.recording import Recording
    from cls_bench.recording.rerun_screenshot import screenshot
    from cls_bench.report import figures, rendering, style
    from cls_bench.report.recorded_run import RecordedRun
    from cls_bench.resources import shipped_scenarios

    folder = docs / "pictures"
    folder.mkdir(parents=True, exist_ok=True)
    page = [_HEAD]
    with tempfile.TemporaryDirectory() as recordings:
        for name in shipped_scenarios():
            result = experiment.run(name, out=Path(recordings), rerun=name == SHOWN)
            run = RecordedRun(result.mcap)
            picture = next(figures.pictures(run))
            style.save_png(picture.figure, folder / f"{name}.png")
            about = " ".join(run.scenario.description.split())
            page.append(f"## {run.scenario.title}\n\n![{picture.title}](pictures/{name}.png)\n\n{about}\n")
            page.append(f"`cls-bench run {name}`\n")
            if result.rrd is not None:
                (folder / "rerun.png").write_bytes(screenshot([result.rrd], BREAKS_AWAY_S))
                rendering.save_still(Recording(result.mcap), BREAKS_AWAY_S, folder / "bench.png", (1280, 960))
            print(name, result.status, flush=True)
    (docs / "gallery.md").write_text("\n".join(page), encoding="utf-8")
    feel(folder / "feel.png")
    rigs(folder / "rigs.png")


def feel(path: Path) -> None:
    """What `cls-bench feel` draws of the two bodies."""
    from cls_bench.report import style
    from cls_bench.report.feel_figure import feel_figure, felt
    from cls_bench.scenario import load_scenario

    scenario = load_scenario("feel_two_body")
    p = scenario.parameters_at_start()
    style.save_png(feel_figure(p, felt(p), scenario.title), path)


def rigs(path: Path) -> None:
    """One picture of all rigs that come with the bench."""
    opengl.choose()
    import matplotlib.image
    from matplotlib.figure import Figure

    from cls_bench import experiment
    from cls_bench.recording import Recording
    from cls_bench.report import rendering, style
    from cls_bench.resources import shipped_rigs
    from cls_bench.scenario import Hold, Scenario

    names = list(shipped_rigs())
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    with tempfile.TemporaryDirectory() as folder:
        for number, name in enumerate(names):
            held = Scenario(title=name, duration=0.1, rig=name, hand=[Hold(at=0.0, angle_deg=0.0)])
            result = experiment.run(held, out=Path(folder), rerun=False)
            still = Path(folder) / f"{name}.png"
            rendering.save_still(Recording(result.mcap), 0.1, still, (900, 740))
            axes = figure.add_subplot(2, -(-len(names) // 2), number + 1)
            axes.imshow(matplotlib.image.imread(still))
            axes.set_title(name, fontsize=9)
            axes.set_axis_off()
    style.save_png(figure, path)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
