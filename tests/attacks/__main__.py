"""``python -m tests.attacks [KIND …]``: carry attacks out and print tables of tried, survived and lost."""

import argparse
import json
import os
import re
import sys
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict

from tests.attacks import workers
from tests.attacks.trials import PROJECT, Outcome

PAGE = PROJECT / "docs" / "trust.md"
BEGIN, END = "<!-- attacks -->", "<!-- /attacks -->"


def main() -> int:
    from tests.attacks.kinds import ATTACKS

    parser = argparse.ArgumentParser(prog="python -m tests.attacks", description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(ATTACKS)}; all without")
    parser.add_argument("--count", type=int, help="trials of each kind, instead of its own number")
    parser.add_argument("--quick", action="store_true", help="the share that ordinary tests carry out")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, nargs="+", metavar="N", help="these trials alone, to repeat them")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="trials at once")
    parser.add_argument("--json", action="store_true", help="print outcomes as JSON lines")
    parser.add_argument("--page", action="store_true", help=f"write the table into {PAGE.relative_to(PROJECT)}")
    chosen = parser.parse_args()
    for kind in chosen.kinds:
        if kind not in ATTACKS:
            parser.error(f"{kind} is unknown; valid: {', '.join(ATTACKS)}")
    outcomes: list[Outcome] = []
    with suppress(KeyboardInterrupt):  # what was tried until then is told
        for kind in chosen.kinds or ATTACKS:
            attack = ATTACKS[kind]
            numbers = chosen.only or (attack.quick if chosen.quick else range(chosen.count or attack.whole))
            run(kind, numbers, chosen.seed, chosen.jobs, chosen.json, outcomes)
    rows = table(outcomes)
    if not chosen.json:
        print_table(rows)
        show_lost(outcomes, chosen.seed)
    if chosen.page:
        write_page(rows, chosen.seed)
    return 1 if any(outcome.state == "lost" for outcome in outcomes) else 0


def run(
    kind: str, numbers: Sequence[int], seed: int, jobs: int, as_json: bool, outcomes: list[Outcome]
) -> list[Outcome]:
    """Carry out trials of a kind, with progress on a terminal; each outcome is added to ``outcomes`` as it comes."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    from tests.attacks.kinds import ATTACKS

    attack = ATTACKS[kind]
    console = Console(stderr=True, highlight=False)
    columns = (TextColumn(f"{attack.title:42}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
               TextColumn("{task.fields[lost]} lost"))  # fmt: skip
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        task = progress.add_task("", total=len(numbers), lost=0)
        lost = 0

        def report(outcome: Outcome) -> None:
            nonlocal lost
            outcomes.append(outcome)
            lost += outcome.state == "lost"
            progress.update(task, advance=1, lost=lost)
            if as_json:
                print(json.dumps(asdict(outcome)), flush=True)

        with workers.stage_folder() as stage:
            return workers.carry_out(attack, numbers, seed=seed, jobs=jobs, stage=stage, report=report)


Row = tuple[str, str, str, str, str, str, str]


def table(outcomes: Sequence[Outcome]) -> list[Row]:
    """A row for each kind; its header first."""
    from tests.attacks.kinds import ATTACKS

    rows: list[Row] = [("attack", "tried", "survived", "lost", "not possible here", "longest [s]", "peak [MB]")]
    for kind, attack in ATTACKS.items():
        found = [outcome for outcome in outcomes if outcome.attack == kind]
        states = Counter(outcome.state for outcome in found)
        if found:
            rows.append(
                (attack.title, str(len(found) - states["untried"]), str(states["survived"]), str(states["lost"]),
                 str(states["untried"] or ""), f"{max(o.seconds for o in found):.1f}",
                 f"{max(o.peak_mb for o in found):.0f}")
            )  # fmt: skip
    return rows


def print_table(rows: Sequence[Row]) -> None:
    from rich.console import Console
    from rich.table import Table

    shown = Table(*rows[0])
    for row in rows[1:]:
        shown.add_row(*row)
    Console().print(shown)


def show_lost(outcomes: Sequence[Outcome], seed: int) -> None:
    """Each loss, those of one kind and one reason once, with the command that repeats it."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for outcome in outcomes:
        if outcome.state == "lost":
            groups.setdefault(
                (outcome.attack, re.sub(r"\d+|'[^']*'|\"[^\"]*\"|/\S+", "…", outcome.what)[:120]), []
            ).append(outcome)
    for (attack, _), found in sorted(groups.items(), key=lambda item: -len(item[1])):
        numbers = " ".join(str(outcome.number) for outcome in found[:5])
        print(f"\n{len(found)} × {found[0].what}\n    python -m tests.attacks {attack} --seed {seed} --only {numbers}")


def write_page(rows: Sequence[Row], seed: int) -> None:
    """Put the table between the marks of the page."""
    lines = [f"| {' | '.join(row)} |" for row in rows]
    lines.insert(1, "|---|" + "---:|" * (len(rows[0]) - 1))
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n" + "\n".join(lines) + f"\n\nSeed {seed}.\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
