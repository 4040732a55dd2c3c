"""Reading TOML text, and placing overrides ``KEY=VALUE`` in what was read."""

import re
import tomllib
from typing import Any

from cls_bench.errors import InputError

ENTRIES = ("hand", "squeeze", "changes", "checks", "expected_trips")
"""Arrays of tables, whose entries an override can name."""


def parse_toml(source: bytes, file: str) -> dict[str, Any]:
    """The table in ``source``. Raises InputError with the line that is broken."""
    try:
        return tomllib.loads(source.decode())
    except UnicodeDecodeError as error:
        line = source.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}: line {line}: not UTF-8 text") from None
    except tomllib.TOMLDecodeError as error:
        problem, place = re.match(r"(.*) \(at (.*)\)$", str(error), re.DOTALL).groups()  # type: ignore[union-attr]
        if place == "end of document":
            lines = source.decode().split("\n")
            place = f"line {len(lines)}, column {len(lines[-1]) + 1}"
        raise InputError(f"{file}: {place}: broken TOML: {problem}") from None


def place_override(table: dict[str, Any], entry: str) -> str:
    """Put the override ``KEY=VALUE`` into ``table``; returns its full key. InputError if it cannot be read."""
    key, equals, text = entry.partition("=")
    key, text = key.strip(), text.strip()
    entry, shown = " ".join(entry.split()), " ".join(text.split())
    if not equals or not key or not text:
        raise InputError(f"--set {entry}: not of the form KEY=VALUE, such as feel.inertia=0.25")
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        parsed = {"value": text} if re.fullmatch(r"[A-Za-z_]\w*", text) else {}
    if list(parsed) != ["value"]:
        raise InputError(f'--set {entry}: {shown} is not a TOML value, such as 0.25, true or "velocity"')
    if match := re.fullmatch(r"(\w+)\[(\d+)\]\.(.+)", key):
        table = _entry(table, match[1], int(match[2]))
        *parents, last = match[3].split(".")
    else:
        if key not in ("duration", "seed") and not key.startswith("record."):
            key = "parameters." + key.removeprefix("parameters.")
        *parents, last = key.split(".")
    for parent in parents:
        inner = table.setdefault(parent, {})
        if not isinstance(inner, dict):  # left as it is: the check of the table says what is wrong with it
            return key
        table = inner
    table[last] = parsed["value"]
    return key


def _entry(table: dict[str, Any], name: str, number: int) -> dict[str, Any]:
    """An entry of an array of tables, such as ``squeeze[0]``. Raises InputError unless it is there."""
    if name not in ENTRIES:
        raise InputError(f"--set {name}[{number}]: {name} has no entries; valid: {', '.join(ENTRIES)}")
    entries = table.get(name, [])
    count = len(entries) if isinstance(entries, list) else 0
    entry = entries[number] if number < count else None
    if not isinstance(entry, dict):
        raise InputError(f"--set {name}[{number}]: the scenario has {count} entries of {name}, counted from 0")
    return entry
