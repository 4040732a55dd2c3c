"""A share of the attacks on files, in the ordinary tests; ``make attack`` carries out all."""

from pathlib import Path

import pytest

from tests.attacks.kinds import ATTACKS
from tests.attacks.workers import carry_out


@pytest.mark.parametrize("kind", ["scenario", "recording", "disk"])
def test_nothing_is_lost(kind: str, tmp_path: Path) -> None:
    attack = ATTACKS[kind]
    outcomes = carry_out(attack, attack.quick, seed=1, jobs=1, stage=tmp_path, report=lambda outcome: None)
    lost = [
        f"python -m tests.attacks {kind} --seed 1 --only {outcome.number}: {outcome.what}"
        for outcome in outcomes if outcome.state == "lost"
    ]  # fmt: skip
    assert not lost, "\n".join(lost)
    assert {outcome.state for outcome in outcomes} >= {"survived"}
