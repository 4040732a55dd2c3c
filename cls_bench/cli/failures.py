"""What went wrong, in one line, and its exit code. Imports no click: it also reports that click cannot be imported."""

import contextlib
import os
import sys
import traceback

from cls_bench import interrupts
from cls_bench.errors import BenchError, ExitCode, Interrupted, one_line


class Debug:
    """Whether tracebacks are printed."""

    on = False

    @classmethod
    def reset(cls) -> None:
        """As the environment says."""
        cls.on = os.environ.get("CLS_BENCH_DEBUG", "") not in ("", "0")


def report(error: BaseException) -> int:
    """Say what went wrong on standard error, in one line; returns the exit code."""
    if Debug.on:
        say(traceback_of(error))
    code, line = told(error)
    if line:
        say(line)
    return code


def say(text: str) -> None:
    """Print to standard error; a message that cannot be told is no failure of its own."""
    with contextlib.suppress(Exception):
        print(text, file=sys.stderr, flush=True)


def traceback_of(error: BaseException) -> str:
    """The traceback as Python would print it."""
    try:
        return "".join(traceback.format_exception(error)).rstrip("\n")
    except BaseException:  # the exception's text cannot be made
        lines = ["Traceback (most recent call last):\n", *traceback.format_tb(error.__traceback__), one_line(error)]
        return "".join(lines)


def told(error: BaseException) -> tuple[int, str]:
    """Exit code and line."""
    if isinstance(error, KeyboardInterrupt) or interrupts.pending():
        said = one_line(error) if isinstance(error, Interrupted) else ""
        return ExitCode.INTERRUPTED, said or "interrupted"
    if isinstance(error, BenchError):
        return int(error.exit_code), f"error: {one_line(error)}"
    if hasattr(error, "format_message"):  # click's own
        return ExitCode.REFUSED, f"error: {_usage(error)}"
    if isinstance(error, OSError) and error.strerror:
        about = os.fsdecode(error.filename) if isinstance(error.filename, (str, bytes, os.PathLike)) else ""
        return ExitCode.REFUSED, "error: " + one_line(f"{about}: {error.strerror}" if about else error.strerror)
    return ExitCode.INTERNAL, f"error: internal error: {one_line(error)}; run again with --debug for the traceback"


def _usage(error: BaseException) -> str:
    """What is wrong with the command line, and where the options are described."""
    said = one_line(error.format_message())  # type: ignore[attr-defined]
    context = getattr(error, "ctx", None)
    return f"{said.rstrip('.')}; see {context.command_path} --help" if context is not None else said
