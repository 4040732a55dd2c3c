"""Compilation of the hot path: one decorator, one source hash, one doorway to ``mj_step``.

With ``NUMBA_DISABLE_JIT=1`` the same functions run as plain Python; a test holds both together.

Numba's on-disk cache knows only the file a function stands in, not the files it calls. So the cache lives in a
folder whose name carries a hash of the source files that end up in machine code: a changed law is never run from a
stale cache, and a change elsewhere compiles nothing. A compiled function outside of these files (as ``verification``
has them) may call functions of these files and of its own.
"""

import ctypes
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import llvmlite.binding
import mujoco
import numba
import platformdirs
from numba import types

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGE = Path(__file__).parent

SOURCES = ("control/*.py", "plant/*.py", "compiled.py", "kinematics.py", "parameters.py", "signals.py", "tick.py")
"""Files whose functions or constants end up in machine code; a test compares them with what ``tick`` imports."""


def source_hash() -> str:
    """Hash of the files that end up in machine code: two installations with the same one run the same loop."""
    digest = hashlib.sha256()
    for path in sorted(path for pattern in SOURCES for path in _PACKAGE.glob(pattern)):
        digest.update(path.relative_to(_PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


_config: Any = numba.config  # its settings are set at run time

JIT = not _config.DISABLE_JIT
"""Whether functions marked :func:`compiled` are machine code."""

_CACHE = Path(_config.CACHE_DIR or platformdirs.user_cache_path("cls-bench")) / source_hash()
if JIT:
    _config.CACHE_DIR = str(_CACHE)


def is_cached() -> bool:
    """Whether an earlier run of these very sources left the loop's machine code behind."""
    return not JIT or any(_CACHE.rglob("tick.advance-*.nbi"))


def compiled(function: F) -> F:
    """Compile ``function`` to machine code (cached, without the GIL); unchanged when numba's JIT is off.

    The function cannot allocate arrays or texts: so nothing is counted when arrays are handed on. And it is always
    inlined: the plant's views of MuJoCo's memory would be copied to the stack at each call. Both together would cost a
    tick three times what its laws do.
    """
    njit: Any = numba.njit  # its types do not know all of its options
    return cast(F, njit(cache=True, nogil=True, error_model="numpy", forceinline=True, _nrt=False)(function))


class Callback(types.WrapperAddressProtocol):
    """A Python function of an integer, returning an integer, that compiled code can call; it must not raise."""

    def __init__(self, function: Callable[[int], int]):
        self._function = function
        self._pointer = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(function)

    def __wrapper_address__(self) -> int:
        return ctypes.cast(self._pointer, ctypes.c_void_p).value or 0

    def signature(self) -> Any:
        """Its type in compiled code."""
        return types.int64(types.int64)

    def __call__(self, number: int) -> int:
        """Call it from Python."""
        return self._function(number)


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
