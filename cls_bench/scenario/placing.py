"""Placing values in a scenario's table by their key: ``feel.inertia``, ``rates.plc_cycle``, ``squeeze[0].value``.

``--set KEY=VALUE``, the axes of a sweep and :meth:`Scenario.changed` all come here.
"""

import json
import re
from typing import Any

from cls_bench.errors import InputError
from cls_bench.input.toml_file import MOST_PARTS, parse_toml
from cls_bench.text import escaped

ENTRIES = ("hand", "squeeze", "changes", "checks", "expected_trips")
"""Arrays of tables, whose entries a key can name."""

TOP = ("duration", "seed", "rig")
"""Keys of the scenario itself; all others are parameters, or begin with ``record.`` or ``aircraft.``."""

LONGEST_OVERRIDE = 10_000
"""Characters of an override."""

IN_ENTRY = re.compile(r"(\w+)\[(\d{1,6})\]\.(.+)")
"""A key in an entry, such as ``squeeze[0].value``."""


def as_text(key: str, value: Any) -> str:
    """``KEY=VALUE`` as :func:`place_override` takes it; every float comes back as the same one."""
    return f"{key}={json.dumps(value, ensure_ascii=False)}"


def place(table: dict[str, Any], key: str, value: Any) -> str:
    """Put ``value`` into ``table``; returns the full key. InputError if it is that of an entry that is not there."""
    if match := IN_ENTRY.fullmatch(key):
        table = _entry(table, match[1], int(match[2]))
        *parents, last = match[3].split(".")
    else:
        if key not in TOP and not key.startswith(("record.", "aircraft.")):
            key = "parameters." + key.removeprefix("parameters.")
        *parents, last = key.split(".")
    for parent in parents:
        inner = table.setdefault(parent, {})
        if not isinstance(inner, dict):  # left as it is: the check of the table says what is wrong with it
            return key
        table = inner
    table[last] = value
    return key


def place_override(table: dict[str, Any], entry: str) -> str:
    """Put the override ``KEY=VALUE`` into ``table``; returns its full key. InputError if it cannot be read."""
    key, value = _split(entry)
    return place(table, key, value)


def _split(entry: str) -> tuple[str, Any]:
    """Key and value of ``KEY=VALUE``."""
    key, equals, text = entry.partition("=")
    key, text = key.strip(), text.strip()
    entry, value = (escaped(" ".join(part.split())) for part in (entry[:LONGEST_OVERRIDE], text[:LONGEST_OVERRIDE]))
    if not equals or not key or not text:
        raise InputError(f"--set {entry}: not of the form KEY=VALUE, such as feel.inertia=0.25")
    if len(key) + len(text) > LONGEST_OVERRIDE:
        raise InputError(f"--set {entry}: longer than the {LONGEST_OVERRIDE} characters that are read")
    if key.count(".") >= MOST_PARTS:
        raise InputError(f"--set {entry}: a key of more than {MOST_PARTS} parts")
    if re.fullmatch(r"[A-Za-z_]\w*", text) and text not in ("true", "false", "inf", "nan"):
        return key, text
    parsed: dict[str, Any] = {}
    try:
        parsed = parse_toml(f"value = {text}".encode(errors="surrogatepass"), "")
    except InputError as error:
        if "broken TOML" not in str(error) and "not UTF-8" not in str(error):
            raise InputError(f"--set {entry}: {str(error).rpartition(': ')[2]}") from None
    if list(parsed) != ["value"]:
        raise InputError(f'--set {entry}: {value} is not a TOML value, such as 0.25, true or "velocity"')
    return key, parsed["value"]


def _entry(table: dict[str, Any], name: str, number: int) -> dict[str, Any]:
    """An entry of an array of tables, such as ``squeeze[0]``. Raises InputError unless it is there."""
    name = escaped(name)
    if name not in ENTRIES:
        raise InputError(f"--set {name}[{number}]: {name} has no entries; valid: {', '.join(ENTRIES)}")
    entries = table.get(name, [])
    count = len(entries) if isinstance(entries, list) else 0
    entry = entries[number] if number < count else None
    if not isinstance(entry, dict):
        raise InputError(f"--set {name}[{number}]: the scenario has {count} entries of {name}, counted from 0")
    return entry
