"""Reading TOML text.

The text is looked over before it is parsed: what a person writes is small and flat, and a parser can be made to take
minutes and gigabytes over a few kilobytes that are not.
"""

import re
import tomllib
from pathlib import Path
from typing import Any

from cls_bench.errors import InputError
from cls_bench.input.files import read_file
from cls_bench.text import escaped

MOST_BYTES = 1_000_000
"""Largest TOML file [B]."""

MOST_PARTS, DEEPEST, LONGEST_WORD = 10, 10, 200
"""Parts of a dotted key, brackets within brackets, and characters of a key or number."""

_TOKEN = re.compile(
    r"""
      (?P<comment> \#[^\n]*)
    | (?P<text> \"{3} (?: [^"\\] | \\. | "{1,2}(?!") )*+ "{3,5} | '{3} (?: [^'] | '{1,2}(?!') )*+ '{3,5}
              | " (?: [^"\\\n] | \\[^\n] )*+ " | ' [^'\n]*+ ')
    | (?P<word> [A-Za-z0-9_+\-]+)
    | (?P<dot> \.) | (?P<open> [\[{]) | (?P<close> [\]}]) | (?P<blank> [ \t]+) | (?P<broken> ["'])
    | (?P<other> .)
    """,
    re.VERBOSE | re.DOTALL,
)


def read_toml(path: Path, file: str) -> tuple[bytes, dict[str, Any]]:
    """Content and table of a TOML file, called ``file`` in messages. Raises InputError and OSError."""
    source = read_file(path, MOST_BYTES)
    return source, parse_toml(source, file)


def parse_toml(source: bytes, file: str) -> dict[str, Any]:
    """The table in ``source``. Raises InputError with the line that is broken."""
    if len(source) > MOST_BYTES:
        raise InputError(f"{file}: {len(source)} bytes are more than the {MOST_BYTES} that are read")
    try:
        text = source.decode("utf-8-sig")  # some editors put a mark at the beginning
    except UnicodeDecodeError as error:
        line = source.count(b"\n", 0, error.start) + 1
        raise InputError(f"{file}: line {line}: not UTF-8 text") from None
    if excess := _excess(text):
        raise InputError(f"{file}: {excess}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        match = re.match(r"(.*) \(at (.*)\)$", str(error), re.DOTALL)
        problem, place = match.groups() if match else (str(error), "end of document")
        if place == "end of document":
            lines = text.split("\n")
            place = f"line {len(lines)}, column {len(lines[-1]) + 1}"
        raise InputError(f"{file}: {place}: broken TOML: {escaped(problem, 200)}") from None
    except ValueError as error:  # such as a time that does not exist
        raise InputError(f"{file}: broken TOML: {escaped(str(error), 200)}") from None


def _excess(text: str) -> str:
    """What is larger in ``text`` than a person would write, with its line; empty if nothing is."""
    parts, depth, dotted = 0, 0, False
    for token in _TOKEN.finditer(text):
        kind = token.lastgroup
        if kind in ("blank", "comment"):
            continue
        if kind == "broken":
            break  # the parser stops here too, and says why
        found = ""
        if kind in ("word", "text"):
            parts = parts + 1 if dotted else 1
            dotted = False
            if parts > MOST_PARTS:
                found = f"a key of more than {MOST_PARTS} parts"
            elif kind == "word" and token.end() - token.start() > LONGEST_WORD:
                found = f"a key or number of {token.end() - token.start()} characters; {LONGEST_WORD} are read at most"
        elif kind == "dot":
            dotted = True
        else:
            parts, dotted = 0, False
            depth += (kind == "open") - (kind == "close" and depth > 0)
            if depth > DEEPEST:
                found = f"more than {DEEPEST} brackets within each other"
        if found:
            return f"line {text.count(chr(10), 0, token.start()) + 1}: {found}"
    return ""
