"""Errors whose message is one line for a person."""


class BenchError(Exception):
    """Something the user can mend; the message says what, where and what would be valid."""

    exit_code = 2


class InputError(BenchError):
    """Bad input: a scenario, a parameter, an option or a file."""


class OutputError(BenchError):
    """The output folder cannot take the recording."""


class ControllerError(BenchError):
    """A user's own outer loop raised, or returned something that is not a command."""

    exit_code = 5


class TrippedError(BenchError):
    """The drive was switched off by a safety function where nothing can be measured without it."""

    exit_code = 4
