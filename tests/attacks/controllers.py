"""Controllers of a user who means harm, or who is merely careless."""

import signal
import textwrap
import time
from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple

from tests.attacks import reference
from tests.attacks.trials import (
    CONTROLLER,
    DIVERGED,
    FAILED,
    INTERNAL,
    INTERRUPTED,
    PASSED,
    REFUSED,
    TRIPPED,
    Attack,
    LostError,
    Process,
    Trial,
    as_json,
    command_line,
    judge,
)  # fmt: skip

TIME_LIMIT = 60.0
SECONDS = 1.0


class Kind(NamedTuple):
    """A controller: what it does from some call on, and how the run may end."""

    what: str
    does: str
    """statements of ``step``; self.calls counts its calls"""
    codes: Collection[int] = (CONTROLLER,)
    made: str = ""
    """statements of ``__init__``"""
    module: str = ""
    """statements of its file"""
    interrupt: float = 0.0
    """after so long it is sent SIGINT [s]"""


KILLED = tuple(-number for number in (signal.SIGKILL, signal.SIGSEGV, signal.SIGABRT, signal.SIGTERM))

# A controller that behaves but for its manners holds the column: that run passes.
KINDS = (
    Kind("raises", "raise ValueError('no\\nsecond line')"),
    Kind("raises what has no text", "raise Mute()",
         module="class Mute(Exception):\n    def __str__(self): raise RuntimeError('mute')\n    __repr__ = __str__"),
    Kind("raises 100 MB of text", "raise ValueError('x' * 100_000_000)"),
    Kind("raises what no one catches", "raise GeneratorExit()"),
    Kind("raises a class of its own below BaseException", "raise Rude('rude')",
         module="class Rude(BaseException): pass"),
    Kind("ends the interpreter with sys.exit(0)", "import sys; sys.exit(0)"),
    Kind("ends the interpreter with os._exit(0)", "import os; os._exit(0)", (CONTROLLER,)),
    Kind("kills its process", "import os, signal; os.kill(os.getpid(), signal.SIGKILL)", (CONTROLLER, *KILLED)),
    Kind("makes the process crash", "import ctypes; ctypes.string_at(0)", (CONTROLLER, *KILLED)),
    Kind("raises KeyboardInterrupt", "raise KeyboardInterrupt", (CONTROLLER, INTERRUPTED)),
    Kind("returns nothing", "return None"),
    Kind("returns NaN", "return Command(float('nan'))"),
    Kind("returns what cannot be shown", "return Mute()",
         module="class Mute:\n    def __iter__(self): raise SystemExit(0)\n    __repr__ = __str__ = __iter__"),
    Kind("returns 1e300", "return Command(1e300)", (CONTROLLER, DIVERGED, TRIPPED)),
    Kind("returns a torque of 1e300", "return Command(0.0, torque=1e300)", (CONTROLLER, DIVERGED, TRIPPED)),
    Kind("prints without end", "while True: print('x' * 1000)", (CONTROLLER, INTERRUPTED), interrupt=15.0),
    Kind("prints a lot at every call", "print('x' * 100_000)", (PASSED, CONTROLLER)),
    Kind("allocates without end", "while True: self.hoard.append(bytearray(10_000_000))",
         (CONTROLLER, REFUSED), "self.hoard = []"),
    Kind("allocates at every call", "self.hoard.append(b'x' * 5_000_000)", (CONTROLLER, REFUSED), "self.hoard = []"),
    Kind("never returns", "while True: pass", (CONTROLLER, INTERRUPTED), interrupt=15.0),
    Kind("sleeps for an hour", "import time; time.sleep(3600)", (CONTROLLER, INTERRUPTED), interrupt=15.0),
    Kind("calls itself without end", "return self.step(inputs)"),
    Kind("ends the interpreter while it is made", "pass", (CONTROLLER, REFUSED), "import sys; sys.exit(0)"),
    Kind("ends the interpreter while it is imported", "pass", (CONTROLLER, REFUSED), module="raise SystemExit(0)"),
    Kind("closes standard output and error", "import os; os.close(1); os.close(2)", (PASSED, CONTROLLER, REFUSED)),
    Kind("leaves a thread behind that never ends", "pass", (PASSED, CONTROLLER),
         "import threading, time; threading.Thread(target=time.sleep, args=(3600,)).start()"),
    Kind("forks", "import os, time\nif not self.child:\n    self.child = os.fork()\n"
         "    if not self.child: time.sleep(0.5); os._exit(0)", (PASSED, CONTROLLER), "self.child = 0"),
    Kind("goes to another folder and deletes the recording",
         "import os, shutil; shutil.rmtree(self.out, True); os.chdir('/')", (REFUSED, CONTROLLER),
         "import os; self.out = os.environ['ATTACKED_OUT']"),
    Kind("ignores Ctrl-C and never returns", "while True: pass", (CONTROLLER, INTERRUPTED), interrupt=15.0,
         made="import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)"),
    Kind("turns warnings into errors and numbers into traps",
         "import warnings, numpy; warnings.simplefilter('error'); numpy.seterr(all='raise')", (PASSED,)),
    Kind("replaces print, open and float", "import builtins; builtins.open = builtins.print = None",
         (PASSED, CONTROLLER)),
    Kind("seeds the random numbers and the clock's place", "import random, numpy; numpy.random.seed(0); random.seed(0)",
         (PASSED,)),
)  # fmt: skip


def source(kind: Kind, at: int) -> str:
    """The controller's file; from its call ``at`` on it does what it is there for."""
    return (
        "from cls_bench import Command\n" + kind.module + "\n\nclass Loop:\n    def __init__(self):\n"
        "        self.calls = 0\n" + textwrap.indent(kind.made or "pass", " " * 8) + "\n\n    def step(self, inputs):\n"
        f"        self.calls += 1\n        if self.calls < {at}:\n            return Command(0.0)\n"
        + textwrap.indent(textwrap.dedent(kind.does), " " * 8) + "\n        return Command(0.0)\n"
    )  # fmt: skip


def prepare(stage: Path) -> None:
    (stage / "attacked.toml").write_text(reference.scenario(SECONDS))


def mistreat(trial: Trial) -> str:
    """Run with a hostile controller; the exit code must tell what happened, and the recording stays readable."""
    kind = KINDS[trial.number % len(KINDS)]
    file, out = trial.folder / "mine.py", trial.folder / "out"
    at = int(trial.rng.integers(2, SECONDS / 400e-6 - 100))
    file.write_text(source(kind, at))
    process = Process(
        command_line("run", trial.stage / "attacked.toml", "--out", out, "--controller", f"{file}:Loop", "--json"),
        environment={"ATTACKED_OUT": str(out)},
    )
    what = f"{kind.what} at call {at}"
    if kind.interrupt:
        deadline = time.monotonic() + kind.interrupt
        while process.process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.1)
        process.send(signal.SIGINT)
    ended = process.wait(TIME_LIMIT)
    try:
        ended.left_behind &= kind.what != "forks"
        if ended.code == INTERNAL:
            raise LostError(f"called an internal error: {ended.err[-300:]}")
        judge(ended, kind.codes)
        if ended.code in (PASSED, FAILED) and not kind.what.startswith(("prints", "closes", "replaces")):
            as_json(ended)
        _readable(trial, what, kind)
    except LostError as error:
        raise LostError(f"{what}: {error}") from None
    return f"{what}: exit code {ended.code}"


def _readable(trial: Trial, what: str, kind: Kind) -> None:
    import warnings

    from cls_bench.recording import Recording

    out = trial.folder / "out"
    for path in out.glob("*.mcap") if out.exists() else ():
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            recording = Recording(path)
            recording.read_all()
        if recording.status in ("complete", "passed") and CONTROLLER in kind.codes and PASSED not in kind.codes:
            raise LostError(f"the recording says {recording.status!r}")


CONTROLLERS = Attack("controller", "hostile controllers", len(KINDS), (1, 5, 6, 8, 12, 18, 21), mistreat, prepare)
