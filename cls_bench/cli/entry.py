"""Where a process of the command line begins and ends.

Nothing is imported before the signals are taken over: Ctrl-C is one line even while the first modules are being read.
And the process ends here, without the interpreter's own ending, in which threads are waited for and half-written
streams raise again.
"""

import os
import signal
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


class Entry:
    """The command line as an object: called without arguments it carries out ``sys.argv`` and ends the process.

    In all else it is the click group of :mod:`cls_bench.cli.commands`.
    """

    @property
    def group(self) -> "Any":
        """The click group."""
        from cls_bench.cli.commands import group

        return group

    def __getattr__(self, name: str) -> "Any":
        return getattr(self.group, name)

    def __call__(self, *arguments: "Any", **options: "Any") -> "Any":
        """Carry out the process's command line; with arguments, what click's own ``main`` does."""
        if arguments or options:
            return self.group.main(*arguments, **options)
        _guard()
        _run(self)
        return None


def _guard() -> None:
    """Until :mod:`cls_bench.interrupts` is imported: nothing has begun, so end at once."""

    def end(number: int, frame: object) -> None:
        os.write(2, b"interrupted\n")
        os._exit(130)

    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, end)


def _run(entry: Entry) -> None:
    from cls_bench import interrupts
    from cls_bench.cli import streams
    from cls_bench.cli.failures import report

    code: int
    try:
        interrupts.install()
        streams.install()
        code = entry.group.carry_out()
    except BaseException as error:
        code = report(error)
    try:
        sys.stdout.flush()
    except BaseException as error:
        code = report(error)
    interrupts.finish(code)
    import atexit

    try:
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:  # what is left to be done at the end cannot change the outcome
        pass
    os._exit(code)
