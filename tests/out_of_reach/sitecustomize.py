"""Python runs this at its start, in the tests' processes when CLS_BENCH_TESTS_WITHOUT hides OpenGL (tests/needs.py)."""

import ctypes.util
import os
from collections.abc import Callable


def _without(found: Callable[[str], str | None]) -> Callable[[str], str | None]:
    return lambda name: None if name in ("EGL", "OSMesa", "GL") else found(name)


if "opengl" in os.environ.get("CLS_BENCH_TESTS_WITHOUT", ""):
    ctypes.util.find_library = _without(ctypes.util.find_library)
