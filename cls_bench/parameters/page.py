"""The parameters as tables: ``python -m cls_bench.parameters.page models/README.md`` brings the page up to date."""

import sys
from operator import attrgetter
from pathlib import Path
from typing import Any

from cls_bench.parameters import Parameters, leaves
from cls_bench.text import between_marks


def table() -> str:
    """All parameters as Markdown tables, one a section, with default, unit and source."""
    lines: list[str] = []
    for name in Parameters.model_fields:
        section = getattr(Parameters(), name)
        lines += ["", f"### `{name}`", "", " ".join((type(section).__doc__ or "").split()), ""]
        lines += ["| parameter | default | valid | unit | meaning | source |", "|---|---|---|---|---|---|"]
        part = name
        for key, value, about in leaves(section, f"{name}."):
            number = shown(value)
            if (of := key.rpartition(".")[0]) not in (part, name):
                lines.append(f"| **`{of}`** | | | | {about_part(of).replace('``', '`')} | |")
            part = of
            meaning = f"{about['meaning']} *(live)*" if about["live"] else about["meaning"]
            cells = (f"`{key}`", number, about["valid"], about["unit"], meaning, about["source"])
            lines.append("| " + " | ".join(" ".join(cell.split()).replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines).strip() + "\n"


def shown(value: Any) -> str:
    """A parameter's value, written as a scenario has it; a list without numbers is "none"."""
    if value == ():
        return "none"
    return f"{value:.6g}" if isinstance(value, float) else str(value).lower()


def about_part(key: str) -> str:
    """What the part of the parameters at dotted ``key`` is, such as an element of the feel model."""
    return " ".join((type(attrgetter(key)(Parameters())).__doc__ or "").split())


TABLE_STARTS, TABLE_ENDS = "<!-- parameters: begin -->\n", "<!-- parameters: end -->\n"
"""What encloses the table in models/README.md."""


def with_table(page: str) -> str:
    """``page`` with the text between its two marks replaced by :func:`table`."""
    return between_marks(page, TABLE_STARTS, f"\n{table()}\n", TABLE_ENDS)


if __name__ == "__main__":
    readme = Path(sys.argv[1])
    readme.write_text(with_table(readme.read_text(encoding="utf-8")), encoding="utf-8")
