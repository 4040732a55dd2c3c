"""docs/architecture.md is the page of record: its table names what there is, its layers are those that are checked."""

import re
import tomllib
from pathlib import Path

import cls_bench

PACKAGE = Path(cls_bench.__file__).parent
ROOT = PACKAGE.parent
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def section(title: str) -> str:
    return PAGE.split(f"## {title}\n")[1].split("\n## ")[0]


def named(cell: str) -> list[Path]:
    """Files and folders that a cell of the table names; a plain file is in the folder of the one before."""
    found, folder = [], Path()
    for name in re.findall(r"`([\w./*]+(?:\.py|\.toml|\.md|\.xml|/))`", cell):
        path = Path(name)
        if name.endswith("/"):
            folder = path
        elif path.parent != Path():
            folder = path.parent
        elif not (PACKAGE / path).is_file():
            path = folder / path
        found.append(path)
    return found


def test_the_table_names_what_there_is() -> None:
    rows = [line.split("|")[1:-1] for line in section("Where what is, and what to change").splitlines() if "`" in line]
    assert len(rows) > 40
    for row in rows:
        for path in named(row[1]):
            places = [*PACKAGE.glob(str(path)), *ROOT.glob(str(path))]
            assert places, f"{row[0].strip()}: {path} is not there"


def test_the_table_leaves_nothing_out() -> None:
    text = section("Where what is, and what to change")
    for path in PACKAGE.iterdir():
        if path.suffix == ".py" and not path.name.startswith("__"):
            assert f"`{path.name}`" in text, f"{path.name} is in no row"
        elif (path / "__init__.py").is_file():
            assert f"`{path.name}/" in text, f"{path.name}/ is in no row"
    for folder in ("plant", "control"):
        for path in (PACKAGE / folder).glob("[!_]*.py"):
            assert re.search(rf"`({folder}/)?{path.name}`", text), f"{folder}/{path.name} is in no row"


def test_the_layers_are_those_that_are_checked() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = project["tool"]["importlinter"]["contracts"]
    (layers,) = [contract["layers"] for contract in contracts if contract["type"] == "layers"]
    shown = section("Who may import whom").split("```")[1].strip().splitlines()
    assert shown == layers
