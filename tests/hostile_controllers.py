"""Controllers that do what no controller should; for tests only. Each is the text of a file that makes a ``Loop``."""

_STEP = """
import ctypes, os, signal, sys, threading, time
import numpy as np
from cls_bench import Command
class Loop:
    n = 0
    def step(self, inputs):
        self.n += 1
        if self.n < 300:
            return Command(0.0)
        {}
"""

_CLASS = "from cls_bench import Command\n"


def _in_step(*lines: str) -> str:
    return _STEP.format("\n        ".join(lines))


EVIL_ERROR = """
class Evil(Exception):
    def __str__(self): raise RuntimeError("no text")
    __repr__ = __str__
"""

FAILING = {
    "raises at import": "raise ValueError('first\\nsecond\\x1b[31m')",
    "is no Python": "def (",
    "ends at import": "import sys; sys.exit(0)",
    "exits at import": "import os; os._exit(0)",
    "raises when made": _CLASS + "class Loop:\n    def __init__(self): raise KeyError('gains')",
    "ends when made": _CLASS + "class Loop:\n    def __init__(self): raise SystemExit(0)",
    "wants arguments": _CLASS + "class Loop:\n    def __init__(self, gain): pass\n    def step(self, inputs): pass",
    "raises": _in_step("raise ValueError('x')"),
    "raises without text": EVIL_ERROR + _in_step("raise Evil"),
    "raises a long text": _in_step("raise ValueError('long ' * 10**7)"),
    "raises a group": _in_step("raise BaseExceptionGroup('several', [ValueError(), KeyboardInterrupt()])"),
    "raises SystemExit": _in_step("sys.exit(0)"),
    "raises KeyboardInterrupt": _in_step("raise KeyboardInterrupt"),
    "raises GeneratorExit": _in_step("raise GeneratorExit"),
    "raises InputError": _in_step("from cls_bench.errors import InputError", "raise InputError('mine')"),
    "returns None": _in_step("return None"),
    "returns text": _in_step("return '12'"),
    "returns bytes": _in_step("return b'ab'"),
    "returns NaN": _in_step("return Command(float('nan'))"),
    "returns infinity": _in_step("return Command(0.0, float('inf'))"),
    "returns too many": _in_step("return (0.0,) * 5"),
    "returns nothing in it": _in_step("return ()"),
    "returns complex": _in_step("return Command(1j)"),
    "returns a text in it": _in_step("return Command('0')"),
    "returns a truth": _in_step("return Command(True)"),
    "returns a huge whole number": _in_step("return Command(10**400)"),
    "returns a matrix": _in_step("return np.zeros((2, 2))"),
    "returns without end": _in_step("import itertools", "return itertools.count()"),
    "returns what has no text": "class Odd:\n    def __repr__(self): raise OSError\n" + _in_step("return Odd()"),
    "calls itself": _in_step("return self.step(inputs)"),
}
"""Failures that Python itself survives: caught in the process as well."""

DEADLY = {
    "exits": _in_step("os._exit(0)"),
    "kills itself": _in_step("os.kill(os.getpid(), signal.SIGKILL)"),
    "reads from nowhere": _in_step("ctypes.string_at(0)"),
    "aborts": _in_step("os.abort()"),
    "closes everything": _in_step("os.closerange(0, 256)", "return Command(0.0)"),
    "loops": _in_step("while True: pass"),
    "loops whatever comes": _in_step(
        "while True:", "    try:", "        while True: pass", "    except BaseException: pass"
    ),
    "computes for ever, holding the interpreter": _in_step("return Command(float(len(str(9 ** (9 ** 9)))))"),
    "sleeps": _in_step("time.sleep(1e9)"),
    "loops at import": "while True: pass",
    "loops when made": _CLASS + "class Loop:\n    def __init__(self):\n        while True: pass",
    "prints without end": _in_step("while True: print('again and again')"),
    "writes without end": _in_step("while True: os.write(1, b'again and again' * 100)"),
    "allocates without end": _in_step("kept = []", "while True: kept.append(bytearray(b'x' * 1000000))"),
    "allocates at once": _in_step("self.kept = b'x' * 10**11", "return Command(0.0)"),
    "waits for a lock": _in_step("lock = threading.Lock()", "lock.acquire()", "lock.acquire()"),
    "forks without end of memory": _in_step(
        "for _ in range(4):", "    if os.fork() == 0:",
        "        kept = bytearray(b'x' * 300_000_000)", "        time.sleep(1e9)", "time.sleep(1e9)",
    ),
}  # fmt: skip
"""Failures that end or hang the process in which they happen."""

STRANGE = {
    "prints": _in_step("print('said')", "return Command(0.0)"),
    "closes standard output": _in_step("if self.n == 300: os.close(1)", "return Command(0.0)"),
    "writes to standard output": _in_step("os.write(1, b'{}')", "return Command(0.0)"),
    "leaves threads behind": _in_step(
        "if self.n < 305: threading.Thread(target=time.sleep, args=(1e9,)).start()", "return Command(0.0)"
    ),
    "leaves processes behind": _in_step(
        "if self.n == 300 and os.fork() == 0: time.sleep(1e9)", "return Command(0.0)"
    ),
    "goes on in a fork": _in_step("if self.n == 300: os.fork()", "return Command(0.0)"),
    "goes elsewhere": _in_step("os.chdir('/')", "return Command(0.0)"),
    "takes over the signals": _in_step(
        "for s in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT): signal.signal(s, signal.SIG_IGN)",
        "return Command(0.0)",
    ),
    "has a thread that fails": _in_step(
        "if self.n == 300: threading.Thread(target=lambda: 1 / 0).start()", "return Command(0.0)"
    ),
    "changes its inputs": _in_step("inputs = inputs._replace(torque=1e9)", "return Command(0.0)"),
    "answers with an array": _in_step("return np.array([0.0, 0.0])"),
    "warns": _in_step("import warnings", "warnings.warn('careful\\nnow')", "return Command(0.0)"),
}  # fmt: skip
"""Odd, but no failure: the run ends as it would without."""

TAMPERING = {
    "changes the metrics": _in_step(
        "import cls_bench.analysis.metrics as m, cls_bench.experiment as e",
        "from dataclasses import replace",
        "if self.n == 300:",
        "    was = e.measure",
        "    e.measure = lambda *a, **k: tuple(replace(c, value=0.0) for c in was(*a, **k))",
        "return Command(0.0)",
    ),
    "changes numpy": _in_step("np.max = np.mean = np.zeros = np.concatenate = None", "return Command(0.0)"),
    "deletes its recording": _in_step(
        "import pathlib", "[p.unlink() for p in pathlib.Path('OUT').glob('*')]", "return Command(0.0)"
    ),
}
"""Must never be called passed with a value that is not the recording's."""
