"""Ctrl-C, SIGTERM and SIGHUP end a command the same way, at any moment.

Nothing happens here until :func:`install` is called, as the command line does. Then the first of these signals raises
KeyboardInterrupt in the main thread, with three exceptions. While something is imported or compiled there is nothing to
keep, and an exception may be lost in a foreign callback: the process ends at once. While :func:`held`, a recording is
open: the signal is only noted, and :func:`check` raises it where nothing can be torn. And after :func:`finish` the exit
code stands. A signal that was ignored when the process began (nohup) stays ignored.
"""

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from cls_bench.errors import ExitCode, Interrupted

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))

REPEATED_S = 1.0
"""A second signal within this time is taken for the same wish (``timeout`` sends two); a later one ends at once [s]."""

RESCUE_S = 5.0
"""How long the way out may take once KeyboardInterrupt was raised [s]: some library may have lost it."""

_UNSAFE = ("importlib.", "numba.", "llvmlite.")


class _State:
    installed = False
    pending_since = 0.0
    held = 0
    code: int | None = None  # the command's, once it has ended


def install() -> None:
    """Take over the signals for this process; for its main thread only."""
    _State.installed = True
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _handle)
    if hasattr(signal, "SIGALRM"):
        signal.signal(signal.SIGALRM, lambda number, frame: _end())
    hook = sys.unraisablehook
    sys.unraisablehook = lambda what: None if pending() else hook(what)


def pending() -> bool:
    """Whether a signal came."""
    return _State.pending_since > 0.0


def check() -> None:
    """Raise KeyboardInterrupt if a signal came that was held back."""
    if pending():
        raise Interrupted


@contextmanager
def held() -> Iterator[None]:
    """Hold signals back until :func:`check`, or until this ends."""
    _State.held += 1
    try:
        yield
    finally:
        _State.held -= 1
    if not _State.held:
        check()


def finish(code: int) -> None:
    """The command has ended with ``code``: no signal changes that any more."""
    _State.code = code
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def is_ctrl_c(error: BaseException) -> bool:
    """Whether ``error`` is a KeyboardInterrupt that a signal raised, and not a ``raise`` in someone's code."""
    if not isinstance(error, KeyboardInterrupt):
        return False
    if _State.installed:
        return pending()
    import dis

    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is None or dis.opname[trace.tb_frame.f_code.co_code[trace.tb_lasti]] != "RAISE_VARARGS"


def _handle(number: int, frame: FrameType | None) -> None:
    if _State.code is not None:
        os._exit(_State.code)
    if pending():
        if time.monotonic() - _State.pending_since > REPEATED_S:
            _end()
        return
    _State.pending_since = time.monotonic()
    if _State.held:
        return
    if _unsafe(frame):
        _end()
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, RESCUE_S)
    raise Interrupted


def _unsafe(frame: FrameType | None) -> bool:
    """Whether something is being imported or compiled."""
    while frame is not None:
        name = frame.f_globals.get("__name__")
        if isinstance(name, str) and name.startswith(_UNSAFE):
            return True
        frame = frame.f_back
    return False


def _end() -> None:
    """Say so and end, past whatever is under way; processes that were started end too."""
    with suppress(OSError):
        for task in os.listdir("/proc/self/task"):  # noqa: PTH208  (in a hurry)
            children = os.open(f"/proc/self/task/{task}/children", os.O_RDONLY)
            for child in os.read(children, 65536).split():
                os.kill(int(child), signal.SIGKILL)
    with suppress(OSError):
        shown = b"\r\x1b[K\x1b[?25h" if os.isatty(2) else b""  # the progress bar hides the cursor
        os.write(2, shown + b"interrupted\n")
    os._exit(ExitCode.INTERRUPTED)
