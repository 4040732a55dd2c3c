import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from cls_bench import verification
from cls_bench.cli import main
from cls_bench.verification import Row


@pytest.fixture
def rows(monkeypatch: pytest.MonkeyPatch) -> list[Row]:
    """The table that the command is given, to be filled by the test."""
    table = [Row("gear", "ratio of the gear", "1", 5.0, "catalogue", 5.01, 0.01)]

    def verify(progress: object) -> list[Row]:
        return table

    monkeypatch.setattr(verification, "verify", verify)
    return table


def run(*arguments: str) -> tuple[int, str]:
    result = CliRunner(env={"COLUMNS": "160"}).invoke(main, ["verify", *arguments])
    return result.exit_code, result.output


def test_table_and_exit_code(rows: list[Row]) -> None:
    code, output = run()
    assert code == 0
    assert "ratio of the gear" in output
    assert "1 rows, none of which fall short" in output
    rows.append(Row("gear", "drag", "N·m", 1.0, "catalogue", 2.0, 0.1, relative=False))
    code, output = run()
    assert code == 1
    assert "FALLS SHORT" in output
    assert "2 rows, 1 of which fall short" in output


def test_json(rows: list[Row]) -> None:
    rows.append(Row("gear", "drag", "N·m", 1.0, "catalogue", float("nan"), 0.1, relative=False))
    code, output = run("--json")
    assert code == 1
    table = json.loads(output)
    assert table["passed"] is False
    assert [row["passed"] for row in table["rows"]] == [True, False]
    assert table["rows"][0]["deviation"] == pytest.approx(0.002)
    assert table["rows"][1]["obtained"] is None


def test_page(rows: list[Row], tmp_path: Path) -> None:
    page = tmp_path / "verification.md"
    code, _ = run("--page", str(page))
    assert code == 0
    assert "| ratio of the gear | 1 | 5 | catalogue | 5.01 | +0.2 % | ±1 % | passed |" in page.read_text()


def test_page_that_cannot_be_written(rows: list[Row], tmp_path: Path) -> None:
    code, output = run("--page", str(tmp_path / "missing" / "page.md"))
    assert code == 2
    assert output.splitlines()[-1].startswith("error: cannot write ")
