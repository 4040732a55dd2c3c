"""Which OpenGL MuJoCo draws with; to be settled before MuJoCo is imported."""

import ctypes.util
import os
import sys

from cls_bench.errors import InputError


def choose() -> None:
    """Set ``MUJOCO_GL`` for drawing without a window, unless it is set already.

    InputError if the system has no such library; otherwise MuJoCo takes the one that is there when it is imported.
    """
    if sys.platform != "linux" or os.environ.get("MUJOCO_GL"):
        return
    for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = name
            return
    raise InputError("drawing needs OpenGL without a window: on Debian, apt install libegl1 libgl1-mesa-dri")
