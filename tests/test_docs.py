"""What the documentation shows is run: Python examples, scenario files, commands, links."""

import re
import shlex
from pathlib import Path

import click
import pytest

from cls_bench.analysis.metrics import METRICS
from cls_bench.cli import main
from cls_bench.experiment import validate
from cls_bench.scenario import parse_scenario

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "models").glob("*.md"))]


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def examples(language: str) -> list[object]:
    return [
        pytest.param(text, id=f"{page.relative_to(ROOT)}-{number}")
        for page in PAGES
        for number, text in enumerate(blocks(page, language))
    ]


@pytest.mark.parametrize("text", examples("python"))
def test_python_examples_run(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    exec(compile(text, "example", "exec"), {"__name__": "example"})


@pytest.mark.parametrize("text", examples("toml"))
def test_scenario_examples_are_valid(text: str) -> None:
    validate(parse_scenario(text))


def test_links_lead_somewhere() -> None:
    for page in PAGES:
        for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", page.read_text()):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_commands_in_the_pages_exist() -> None:
    found = 0
    for page in PAGES:
        shown = "".join(blocks(page, ""))
        for line in re.findall(r"^(?:\$ )?cls-bench (.+?)(?:\s+#.*)?$", shown, re.MULTILINE):
            words = shlex.split(line.split(">")[0])
            command = main.get_command(click.Context(main), words[0])
            assert command is not None, f"{page.name}: {line}"
            options = {name for parameter in command.params for name in [*parameter.opts, *parameter.secondary_opts]}
            assert {word for word in words if word.startswith("--")} <= options, f"{page.name}: {line}"
            found += 1
    assert found >= 4


def test_the_guide_names_every_metric() -> None:
    guide = (ROOT / "docs" / "scenarios.md").read_text()
    assert [name for name in METRICS if f"`{name}`" not in guide] == []


def test_no_page_names_a_private_path() -> None:
    for page in PAGES:
        assert not re.search(r"(?<![\w.])/(work|root|home|tmp)/", page.read_text()), page.name
