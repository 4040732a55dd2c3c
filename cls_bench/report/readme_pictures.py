"""Makes the pictures of the README from fresh runs: ``python -m cls_bench.report.readme_pictures docs/pictures``."""

import sys
import tempfile
from pathlib import Path

from cls_bench import experiment
from cls_bench.report import figures, style
from cls_bench.report.recorded_run import RecordedRun


def main(folder: Path) -> None:
    """Write all pictures into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as recordings:
        result = experiment.run("friction_masking", out=Path(recordings), rerun=False)
        run = RecordedRun(result.mcap)
        picture = next(figures.pictures(run))
        picture.figure.axes[0].set_title("The hand moves the column to and fro: mechanism alone, and masked")
        style.save(picture.figure, folder / "friction_masking")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
