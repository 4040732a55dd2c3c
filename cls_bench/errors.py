"""Errors whose message is one line for a person, and the exit code of each way a command can end."""

from enum import IntEnum


class ExitCode(IntEnum):
    """How a command ended; the same for all of them. ``docs/exit_codes.md`` shows this table."""

    PASSED = 0, "passed", "all checks passed, or there was nothing to judge"
    FAILED = 1, "a check failed", "a check failed, and nothing else went wrong"
    REFUSED = 2, "bad input or output", "an option, a scenario or a file is not valid, or output cannot be written"
    DIVERGED = 3, "diverged", "a run left all bounds"
    TRIPPED = 4, "tripped", "the drive tripped, and the scenario does not expect it"
    CONTROLLER = 5, "controller failed", "a controller of your own raised, ended, hung or gave no command"
    INTERNAL = 70, "internal error", "anything unexpected; `--debug` shows the traceback"
    INTERRUPTED = 130, "interrupted", "Ctrl-C, SIGTERM or SIGHUP; what was recorded is kept"

    title: str
    meaning: str

    def __new__(cls, number: int, title: str, meaning: str) -> "ExitCode":
        """A member with its words."""
        code = int.__new__(cls, number)
        code._value_ = number
        code.title, code.meaning = title, meaning
        return code


class BenchError(Exception):
    """Something the user can mend; the message says what, where and what would be valid."""

    exit_code: int = ExitCode.REFUSED


class InputError(BenchError):
    """Bad input: a scenario, a parameter, an option or a file."""


class OutputError(BenchError):
    """The output folder cannot take the recording."""


class ControllerError(BenchError):
    """A user's own controller raised, or returned something that is not a command."""

    exit_code = ExitCode.CONTROLLER


class TrippedError(BenchError):
    """The drive was switched off by a safety function where nothing can be measured without it."""

    exit_code = ExitCode.TRIPPED


class Interrupted(KeyboardInterrupt):
    """Ctrl-C, SIGTERM or SIGHUP, once what was made until then is safe; the message says what was kept."""


LONGEST_LINE = 600
"""Letters of an error's text that are shown."""


def one_line(error: object) -> str:
    """The text of ``error`` on one line: printable, of bounded length, whatever its ``__str__`` does.

    An exception that is none of this project's is named by its type.
    """
    try:
        text = str(error)
    except BaseException:  # a user's exception may raise anything here
        text = "its text cannot be made"
    line = str.__getitem__(text, slice(0, 4 * LONGEST_LINE))  # of a plain str, even where a subclass was returned
    line = "".join(letter if letter.isprintable() else " " for letter in line)
    if isinstance(error, BaseException) and not isinstance(error, (BenchError, Interrupted)):
        kind = type(error).__name__
        line = f"{kind}: {line}" if line.strip() else kind
    line = " ".join(line.split())
    return line if len(line) <= LONGEST_LINE else f"{line[: LONGEST_LINE - 1]}…"
