"""Standard output and standard error that take whatever is printed, wherever it goes.

A reader that has gone, another code page, a closed stream: what is printed is then left out or written otherwise, and
the command ends as it would have. A full device is an OutputError for standard output.
"""

import codecs
import io
import logging
import os
import select
import sys
import unicodedata
import warnings
from typing import Any

from cls_bench.errors import OutputError, one_line

_PLAIN = {
    "·": ".", "×": "x", "≥": ">=", "≤": "<=", "−": "-", "–": "-", "—": "-", "°": " deg", "±": "+/-", "…": "...",
    "φ": "phi", "²": "^2", "³": "^3", "Δ": "Delta", "σ": "sigma", "µ": "u", "μ": "u", "ω": "omega", "→": "->",
    "“": '"', "”": '"', "‘": "'", "’": "'", "√": "sqrt", "∞": "inf",
}  # fmt: skip
"""How signs are written where the encoding has none for them."""


def install() -> None:
    """Make the process's standard streams safe."""
    codecs.register_error("cls_bench.plain", _plain)
    for descriptor in range(3):
        _open(descriptor)
    sys.stdout = _writer(sys.stdout, 1, "standard output", quiet=False)
    sys.stderr = _writer(sys.stderr, 2, "standard error", quiet=True)
    quiet_warnings()


def quiet_warnings() -> None:
    """Warnings become one line each, without source; what numpy says of a metric that has no value shows in its NaN."""
    from cls_bench.cli.failures import say

    def show(message: Any, category: Any, filename: str, lineno: int, file: Any = None, line: Any = None) -> None:
        say(f"warning: {one_line(str(message) if isinstance(message, UserWarning) else message)}")

    warnings.filterwarnings("ignore", category=RuntimeWarning, module=r"cls_bench\.(analysis|report)|numpy|matplotlib")
    warnings.showwarning = show
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # a folder of its own that it cannot write is no news


def _open(descriptor: int) -> None:
    """A closed standard stream becomes the null device: the next file that is opened must not take its number."""
    try:
        os.fstat(descriptor)
    except OSError:
        opened = os.open(os.devnull, os.O_RDWR)
        if opened != descriptor:
            os.dup2(opened, descriptor)
            os.close(opened)


def _writer(stream: Any, descriptor: int, name: str, quiet: bool) -> io.TextIOWrapper:
    encoding = getattr(stream, "encoding", None) or "utf-8"
    interactive = os.isatty(descriptor)
    buffer = io.BufferedWriter(_Stream(descriptor, name, quiet))
    return io.TextIOWrapper(buffer, encoding, "cls_bench.plain", line_buffering=interactive or quiet)


class _Stream(io.FileIO):
    def __init__(self, descriptor: int, label: str, quiet: bool):
        super().__init__(descriptor, "w", closefd=False)
        self._label = label
        self._quiet = quiet

    def write(self, data: Any) -> int:
        while True:
            try:
                written: int | None = super().write(data)
            except BrokenPipeError:  # the reader has seen enough
                return self._leave_out(data)
            except OSError as error:
                left_out = self._leave_out(data)
                if self._quiet:
                    return left_out
                raise OutputError(f"cannot write {self._label}: {error.strerror}") from None
            if written is not None:
                return written
            select.select([], [self.fileno()], [])  # a pipe that does not block and is full

    def _leave_out(self, data: Any) -> int:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, self.fileno())
        os.close(null)
        return len(data)


def _plain(error: UnicodeError) -> tuple[str | bytes, int]:
    """Codec error handler: one sign that the encoding does not have, as others it has."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    letter = error.object[error.start]
    if "\udc80" <= letter <= "\udcff":  # a byte of a file's name that is no text
        return bytes([ord(letter) - 0xDC00]), error.start + 1
    similar = unicodedata.normalize("NFKD", letter).encode("ascii", "ignore").decode()
    return _PLAIN.get(letter) or similar or "?", error.start + 1
