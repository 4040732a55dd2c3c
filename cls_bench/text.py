"""Text that comes from files and users, made fit for a terminal and a page."""

import unicodedata

LONGEST = 10_000
"""Characters of one text that are shown."""


def printable(text: str, longest: int = LONGEST) -> str:
    """``text`` on one line, without what a terminal would obey: control and format characters, lone surrogates.

    White space becomes blanks, all else of that kind U+FFFD; what is longer than ``longest`` is cut.
    """
    shown = "".join(
        " " if char.isspace() else "\N{REPLACEMENT CHARACTER}" if unicodedata.category(char)[0] == "C" else char
        for char in text[: longest + 1]
    )
    return shown if len(shown) <= longest else f"{shown[:longest]}…"


def escaped(text: str, longest: int = 60) -> str:
    """``text`` on one line and cut short, as a message quotes it: what is not printable stands as an escape."""
    text = text if len(text) <= longest else text[: longest - 3] + "..."
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text)


def between_marks(page: str, starts: str, content: str, ends: str) -> str:
    """``page`` with ``content`` in place of what stands between its two marks, which each stand there once."""
    before, rest = page.split(starts)
    return before + starts + content + ends + rest.split(ends)[1]


def utf8(text: str) -> str:
    """``text`` with escapes for what UTF-8 cannot hold: a file's name can be any bytes."""
    return text.encode(errors="backslashreplace").decode()
