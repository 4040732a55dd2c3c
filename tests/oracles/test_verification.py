"""Every case of `cls-bench verify` is a test; those that take long are marked slow."""

import json

import numpy as np
import pytest

from cls_bench.verification import CASES, Row, outer_loop, page, random_trials, render, verify, whole_plant
from cls_bench.verification.runner import Case

SLOW = (whole_plant.agreement, whole_plant.shipped_rigs_agree, outer_loop.shaking, random_trials.trials)
QUICK = [case for case in CASES if case not in SLOW]


def named(case: Case) -> str:
    return f"{case.__module__.rpartition('.')[2]}.{case.__name__}"


def check(case: Case) -> None:
    rows = verify(cases=[case], workers=1)
    assert rows
    short = [f"{row.quantity}: {row.obtained:g}, expected {row.expected:g}" for row in rows if not row.passed]
    assert not short


@pytest.mark.parametrize("case", QUICK, ids=named)
def test_quick_case(case: Case) -> None:
    check(case)


@pytest.mark.slow
@pytest.mark.parametrize("case", SLOW, ids=named)
def test_slow_case(case: Case) -> None:
    check(case)


@pytest.mark.slow
def test_whole_table_in_processes() -> None:
    told = []
    rows = verify(lambda done, total: told.append((done, total)))
    assert len(rows) >= 240
    assert all(row.passed for row in rows)
    assert len({row.quantity for row in rows}) == len(rows)
    assert told == [(k, len(CASES)) for k in range(1, len(CASES) + 1)]
    text = render(rows)
    assert all(f"| {row.quantity} |" in text for row in rows)
    groups = {row.group for row in rows}
    assert groups == set(page.NOTES)
    assert text.count("\n## ") == len(groups)  # each in one place


def row(obtained: float, *, expected: float = 2.0, limit: float = 0.1, relative: bool = True) -> Row:
    return Row("group", "quantity", "m", expected, "source", obtained, limit, relative)


def test_row_judges_by_relative_or_absolute_limit() -> None:
    assert row(2.19).passed
    assert not row(2.21).passed
    assert not row(1.79).passed
    assert row(2.09, relative=False).passed
    assert not row(2.19, relative=False).passed
    assert row(-2.1, expected=-2.0).deviation == pytest.approx(-0.05)
    assert row(0.0, expected=0.0, limit=0.0, relative=False).passed


def test_row_without_a_number_never_passes() -> None:
    lost = row(float("nan"))
    assert not lost.passed
    assert json.loads(json.dumps(lost.to_json(), allow_nan=False))["obtained"] is None


def test_row_of_numpy_numbers_is_json() -> None:
    table = json.dumps(row(np.float32(2.0), expected=np.float64(2.0)).to_json())
    assert json.loads(table)["passed"] is True


def test_page_says_what_falls_short() -> None:
    text = render([row(2.0), row(3.0)])
    assert "**2 rows, 1 of which fall short.**" in text
    assert text.count("| passed |") == 1
    assert text.count("| FALLS SHORT |") == 1


def test_a_case_that_cannot_be_run_falls_short() -> None:
    def broken(_: object) -> object:
        raise ValueError("no such plant")

    (only,) = verify(cases=[broken], workers=1)  # type: ignore[list-item]
    assert not only.passed
    assert "no such plant" in only.quantity
