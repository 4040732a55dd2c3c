"""docs/your_rig.md, rigs.md, feel.md: files are written, commands run, and what they print is what the pages show."""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from cls_bench.cli import main

DOCS = Path(__file__).parent.parent / "docs"
PAGE = DOCS / "your_rig.md"
BLOCK = re.compile(r"^```(\w*) ?(\S*)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def lines(text: str) -> list[str]:
    """What is read: words of the lines that are not empty; how long a rule is follows the terminal."""
    return [" ".join(line.replace("─", "").split()) for line in text.splitlines() if line.strip(" ─")]


@pytest.mark.parametrize(("page", "count"), [("your_rig.md", 5), ("rigs.md", 1), ("feel.md", 4)])
def test_the_page_does_what_it_shows(page: str, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    commands = 0
    for language, file, text in BLOCK.findall((DOCS / page).read_text()):
        if language == "toml":
            Path(file).write_text(text)
        elif language == "python":
            exec(compile(text, "example", "exec"), {"__name__": "example"})
        else:
            for command, shown in re.findall(r"^\$ cls-bench (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
                answer = CliRunner().invoke(main, shlex.split(command))
                assert answer.exit_code == 0, answer.output
                printed = lines(answer.stdout)
                missing = [line for line in lines(shown) if line not in printed]
                assert not missing, f"{command} prints\n{answer.stdout}"
                commands += 1
    assert commands == count


def test_the_page_has_the_figures_of_the_derivation(tmp_path: Path) -> None:
    """What the text says beside the tables."""
    from cls_bench.rigs import figures, load_rig

    path = tmp_path / "my_rig.toml"
    path.write_text(next(text for language, _, text in BLOCK.findall(PAGE.read_text()) if language == "toml"))
    rig = load_rig(path)
    assert [(d.key, d.value) for d in rig.derived if d.key.startswith("simulation")] == [("simulation.substeps", 2)]
    found = figures(rig.parameters)
    assert found.peak_force > found.measurable_force
    assert found.breakout_force == pytest.approx(3.03, abs=0.005)
