"""The built wheel works outside of the checkout: models and scenarios travel inside it."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel's content."""
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder), str(ROOT)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def python(installed: Path, cwd: Path, *arguments: str) -> str:
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_holds_models_scenarios_and_licence_and_no_tests(installed: Path) -> None:
    names = {path.relative_to(installed).as_posix() for path in installed.rglob("*") if path.is_file()}
    assert {"cls_bench/_data/models/cls_bench.xml", "cls_bench/_data/models/scene.xml", "cls_bench/py.typed"} <= names
    scenarios = {path.name for path in (ROOT / "scenarios").glob("*.toml")}
    assert {f"cls_bench/_data/scenarios/{name}" for name in scenarios} <= names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert not any(name.startswith(("tests", "benchmarks")) for name in names)


def test_a_scenario_runs_from_any_folder(installed: Path, tmp_path: Path) -> None:
    where = python(installed, tmp_path, "-c", "import cls_bench; print(cls_bench.__file__)")
    assert where.startswith(str(installed))
    command = "from cls_bench.cli import main; main()"
    output = python(
        installed, tmp_path, "-c", command, "run", "motion_tracking", "--set", "duration=8.0", "--no-rerun"
    )
    assert "PASSED" in output
    assert list((tmp_path / "recordings").glob("motion_tracking-*.mcap"))
