"""Compilation of the hot path: one decorator, one source hash, one doorway to ``mj_step``.

With ``NUMBA_DISABLE_JIT=1`` the same functions run as plain Python; a test holds both together.

Machine code is kept on disk, in a folder whose name is a hash of all it depends on: the source files that end up in
machine code (their syntax trees: a changed comment changes nothing), the versions of what compiles them, and numba's
settings. So a changed law is never run from a stale cache, and a change elsewhere compiles nothing. Numba's own cache
knows only the file a function stands in, not the files it calls, and goes elsewhere where it cannot write; so it is not
used. Where nothing can be kept, all is compiled anew in each process.

Each entry carries its checksum: what is damaged is compiled again. And before anything is compiled, the byte code that
Python loaded is held against the source it should come from: Python takes a file of the same time and size for
unchanged.
"""

import ast
import ctypes
import hashlib
import importlib.util
import os
import pickle
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.metadata import version
from pathlib import Path
from types import CodeType
from typing import Any, NamedTuple, TypeVar, cast

import llvmlite.binding
import llvmlite.ir
import mujoco
import numba
import numba.extending
import numpy as np
import platformdirs
from numba import types
from numba.core import caching, compiler
from numba.core.serialize import dumps

from cls_bench.errors import BenchError, one_line

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent

SOURCES = ("control/*.py", "feel/*.py", "feel/elements/*.py", "plant/*.py", "course.py", "kinematics.py",
           "tick.py")  # fmt: skip
"""Where the loop's functions stand: of these files those that mark one as :func:`compiled`."""

CONSTANTS = ("compiled.py", "feel/model.py", "quantity.py")
"""Other files that such functions take a constant from; a test compares both lists with what they use.

How a record is laid out (parameters, signals) is part of a function's signature, and so of each entry's name.
"""


def _source_files() -> list[Path]:
    marked = (path for pattern in SOURCES for path in _PACKAGE.glob(pattern) if b"@compiled" in path.read_bytes())
    return sorted([*marked, *(_PACKAGE / name for name in CONSTANTS)])


def source_hash() -> str:
    """Hash of what the files mean that end up in machine code: two installations with the same one run the same loop.

    Comments, docstrings and layout do not count.
    """
    digest = hashlib.sha256()
    for path in _source_files():
        digest.update(path.relative_to(_PACKAGE).as_posix().encode())
        digest.update(_source(str(path)).meaning.encode())
    return digest.hexdigest()[:16]


# --- sources and byte code -------------------------------------------------------------------------------------------


class _Source(NamedTuple):
    """A source file as it was when it was first asked about."""

    meaning: str
    """hash of its syntax tree, without docstrings"""
    code: CodeType


@cache
def _source(path: str) -> _Source:
    content = Path(path).read_bytes()
    tree = ast.parse(content)
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
            node.body = [entry for entry in node.body if not _is_text(entry)]
    meaning = hashlib.sha256(ast.dump(tree).encode()).hexdigest()
    return _Source(meaning, compile(content, path, "exec", dont_inherit=True))


def _is_text(node: ast.stmt) -> bool:
    """Whether it is a text that stands alone: a docstring, of whatever it follows."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _refuse_stale_byte_code() -> None:
    """Delete byte code of the hot path that is not of its source; BenchError if some of it is loaded already."""
    for path in map(str, _source_files()):
        name = ".".join(("cls_bench", *Path(path).relative_to(_PACKAGE).with_suffix("").parts))
        try:
            kept = Path(importlib.util.cache_from_source(path))
            if not kept.is_file() or SourceFileLoader(name, path).get_code(name) == _source(path).code:
                continue
        except (OSError, ValueError, EOFError, TypeError, ImportError, NotImplementedError):
            continue  # no byte code that Python could have taken
        try:
            kept.unlink()
        except OSError:
            raise BenchError(f"{kept} is not the byte code of its source, and Python takes it: delete it") from None
        if name in sys.modules:
            raise BenchError(f"{path} changed, and Python did not notice; that is mended now: run again")


def _check_loaded(function: Callable[..., Any], path: str) -> None:
    """BenchError if ``function`` is not what its file says; byte code that Python took for it is deleted."""
    if function.__code__ not in _codes(_source(path).code):
        with suppress(OSError, NotImplementedError):
            Path(importlib.util.cache_from_source(path)).unlink()
        raise BenchError(f"{path} changed while it was being loaded; run again")


def _codes(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _codes(constant)


_refuse_stale_byte_code()

# --- where machine code is kept --------------------------------------------------------------------------------------

_config: Any = numba.config  # its settings are set at run time

JIT = not _config.DISABLE_JIT
"""Whether functions marked :func:`compiled` are machine code."""


def _key() -> str:
    """Hash of all that machine code depends on; the processor is part of each entry's name."""
    packages = [f"{name} {version(name)}" for name in ("numba", "llvmlite", "mujoco", "numpy")]
    apart = ("NUMBA_CACHE_DIR", "NUMBA_DISABLE_JIT", "NUMBA_NUM_THREADS")
    settings = sorted(f"{k}={v}" for k, v in os.environ.items() if k.startswith("NUMBA_") and k not in apart)
    python = sys.implementation.cache_tag, sys.version, sys.platform
    return hashlib.sha256(repr((source_hash(), packages, settings, python)).encode()).hexdigest()[:16]


def _folder() -> Path:
    """The folder; relative where there is no home, and then not used."""
    return Path(_config.CACHE_DIR or platformdirs.user_cache_path("cls-bench")) / _key()


_CACHE = _folder()


_rebuild: Any = compiler.CompileResult._rebuild
_dumps: Any = dumps
_types: Any = types


class _Unkept:
    """Whether it was said that machine code cannot be kept."""

    said = False


class _Cache(caching.NullCache):
    """Keeps the machine code of one function, an entry for each of its signatures."""

    def __init__(self, function: Callable[..., Any], path: str):
        self._name = f"{Path(path).stem}.{function.__qualname__}".replace("<", "").replace(">", "")
        self._function = path, _source(path).meaning, function.__qualname__

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(_CACHE)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, or None if it is to be compiled."""
        target_context.refresh()
        entry = self._entry(sig, target_context.codegen())
        try:
            content = entry.read_bytes()
            if hashlib.sha256(content[32:]).digest() != content[:32]:
                return None
            return _rebuild(target_context, *pickle.loads(content[32:]))
        except Exception:  # whatever is wrong with it, it can be made anew
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it; where that cannot be done, say so once."""
        if data.lifted or data.library.has_dynamic_globals:
            return
        try:
            if not _CACHE.is_absolute():
                raise OSError(None, "there is no home folder")
            payload: bytes = _dumps(data._reduce())
            _CACHE.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=_CACHE, suffix=".tmp", delete=False) as file:
                try:
                    file.write(hashlib.sha256(payload).digest() + payload)
                    file.close()
                    Path(file.name).replace(self._entry(sig, data.codegen))
                except BaseException:
                    Path(file.name).unlink(missing_ok=True)
                    raise
        except OSError as error:
            if not _Unkept.said:
                _Unkept.said = True
                warnings.warn(
                    f"machine code cannot be kept in {_CACHE} ({one_line(error.strerror or error)}): it is compiled "
                    "anew in each run", stacklevel=2,
                )  # fmt: skip

    def _entry(self, sig: Any, codegen: Any) -> Path:
        about = repr((self._function, sig, [*_fields(sig)], codegen.magic_tuple()))
        return _CACHE / f"{self._name}-{hashlib.sha256(about.encode()).hexdigest()[:32]}.bin"


def _fields(kinds: Any) -> Iterator[tuple[str, ...]]:
    """Names of the fields of all named tuples among ``kinds``: numba's name of such a type tells their types alone."""
    for kind in getattr(kinds, "args", kinds):
        if isinstance(kind, _types.BaseNamedTuple):
            yield kind.fields
        if isinstance(kind, _types.BaseTuple):
            yield from _fields(kind.types)


def is_cached() -> bool:
    """Whether an earlier run of these very sources left the loop's machine code behind."""
    return not JIT or any(_CACHE.glob("tick.advance-*.bin"))


def compiled(function: F) -> F:
    """Compile ``function`` to machine code (kept, without the GIL); unchanged when numba's JIT is off.

    The function cannot allocate arrays or texts: so nothing is counted when arrays are handed on. And it is always
    inlined: the plant's views of MuJoCo's memory would be copied to the stack at each call. Both together would cost a
    tick three times what its laws do. Raises BenchError if Python loaded it from anything but its source file.
    """
    path = function.__code__.co_filename
    known = Path(path).is_file()
    if known:
        _check_loaded(function, path)
    njit: Any = numba.njit  # its types do not know all of its options
    made = njit(nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function)
    if JIT and known:
        made._cache = _Cache(function, path)
    return cast(F, made)


def in_turn(functions: Sequence[Callable[..., None]]) -> Callable[..., None]:
    """One compiled function that calls all of ``functions``, compiled and of equal arguments, one after the other."""
    first, *others = functions
    if not others:
        return first
    rest = in_turn(others)

    def both(*args: Any) -> None:
        first(*args)
        rest(*args)

    # What is kept of it on the disk goes by its name.
    names = (f"{f.__module__.rpartition('.')[2]}.{f.__qualname__}" for f in functions)
    both.__qualname__ = "in_turn-" + hashlib.sha256(" ".join(names).encode()).hexdigest()[:16]
    return compiled(both)


_ASKED = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)


class Callback:
    """A Python function of an integer, returning an integer, that compiled code can :func:`call`; it must not raise."""

    def __init__(self, function: Callable[[int], int]):
        self._pointer = _ASKED(function)
        self.address: int = ctypes.cast(self._pointer, ctypes.c_void_p).value or 0
        """what :func:`call` takes: a plain number, which is handed on more quickly than numba's own function types"""


def _call(_: Any, address: Any, number: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        word = llvmlite.ir.IntType(64)
        function = builder.inttoptr(values[0], llvmlite.ir.FunctionType(word, [word]).as_pointer())
        return builder.call(function, [values[1]])

    return types.int64(types.int64, types.int64), build


if JIT:
    _intrinsic: Any = numba.extending.intrinsic
    call: Callable[[int, int], int] = _intrinsic(_call)
else:

    def call(address: int, number: int) -> int:
        """What the :class:`Callback` at ``address`` answers to ``number``."""
        return int(_ASKED(address)(number))


def records(array: Any) -> Any:
    """An array of records as compiled code takes it; without JIT its fields are attributes all the same."""
    return array if JIT else array.view(np.recarray)


def _load_mujoco() -> None:
    folder = Path(mujoco.__file__).parent
    for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll"):
        for library in sorted(folder.glob(pattern)):
            llvmlite.binding.load_library_permanently(str(library))
            _stop_timers()
            return
    raise ImportError(f"no MuJoCo library found in {folder}")


def _stop_timers() -> None:
    """Take away the clock that MuJoCo's Python package gives to MuJoCo for the profile in ``MjData.timer``.

    No one here reads that profile, and reading the clock was a seventh of a step's time.
    """
    ctypes.c_void_p.from_address(llvmlite.binding.address_of_symbol("mjcb_time")).value = None


if JIT:
    _load_mujoco()
    mj_step = types.ExternalFunction("mj_step", types.void(types.intp, types.intp))
else:
    mj_step = mujoco.mj_step


def handle(struct: Any) -> Any:
    """What :data:`mj_step` takes for an ``MjModel`` or ``MjData``: its address, or the object itself without JIT."""
    return struct._address if JIT else struct
