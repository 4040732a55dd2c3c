"""What some tests need beside Python: a browser, OpenGL, a Vulkan driver. Here it is decided what is there.

A test that needs one says so with a marker (``needs_browser``, ``needs_opengl``, ``needs_vulkan``) and skips where that
is missing; the end of a test run counts them and names the one line that installs it. Two environment variables:

* ``CLS_BENCH_TESTS_WITHOUT=browser,opengl,vulkan`` puts them out of reach of the tests and of the processes they start;
* ``CLS_BENCH_TESTS_NEED_ALL=1`` makes such a skip a failure, for machines where all is meant to be there. So does
  ``CI=true``, unless it is 0.

``python tests/needs.py`` prints the Debian packages; it needs nothing but Python.
"""

import os
import runpy
import shutil
import subprocess
import sys
from collections.abc import Iterable
from functools import cache
from pathlib import Path

NAMES = {"browser": "a browser", "opengl": "OpenGL", "vulkan": "Vulkan"}
PACKAGES = {
    "browser": ("chromium", "chromium-driver"),
    "opengl": ("libegl1", "libgl1-mesa-dri"),
    "vulkan": ("mesa-vulkan-drivers",),
}

WITHOUT = frozenset(filter(None, os.environ.get("CLS_BENCH_TESTS_WITHOUT", "").split(",")))
if not set(NAMES) >= WITHOUT:
    raise ValueError(f"CLS_BENCH_TESTS_WITHOUT={','.join(WITHOUT)}: valid are {', '.join(NAMES)}")

_OUT_OF_REACH = Path(__file__).parent / "out_of_reach"  # holds a sitecustomize for the processes that tests start


def all_needed() -> bool:
    """Whether everything is meant to be there."""
    return os.environ.get("CLS_BENCH_TESTS_NEED_ALL", os.environ.get("CI", "")).lower() in ("1", "true")


def reason(need: str) -> str:
    """Why a test skips."""
    return f"needs {NAMES[need]}"


def installs(needs: Iterable[str]) -> str:
    """The line that installs ``needs``."""
    return " ".join(["apt-get install", *(package for need in NAMES if need in needs for package in PACKAGES[need])])


@cache
def is_there(need: str) -> bool:
    """Whether ``need`` is there and works."""
    if need == "browser":
        return browser() is not None
    return _succeeds(_DRAWS if need == "opengl" else f"{_HAS_DEVICES}\nsys.exit(not has_devices())")


def browser() -> tuple[str, str] | None:
    """Paths of a browser and of its driver."""
    found = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    return None if "browser" in WITHOUT or None in found else found  # type: ignore[return-value]


# Each in a process of its own: a driver may crash, and MuJoCo settles on its OpenGL when it is imported.
def _succeeds(code: str) -> bool:
    return not subprocess.run([sys.executable, "-c", code], capture_output=True, check=False, timeout=120).returncode


_DRAWS = """
from cls_bench.report import opengl
opengl.choose()
import mujoco
mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
"""

_HAS_DEVICES = """
import ctypes, sys

def has_devices():
    vulkan = ctypes.CDLL("libvulkan.so.1")
    info = (ctypes.c_uint64 * 8)(1)  # VkInstanceCreateInfo: its type, all else empty
    instance, count = ctypes.c_void_p(), ctypes.c_uint32()
    return vulkan.vkCreateInstance(info, None, ctypes.byref(instance)) == 0 and (
        vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None) == 0 and count.value > 0
    )
"""


def put_out_of_reach() -> None:
    """Hide :data:`WITHOUT` from this process and from those it starts; does so once."""
    if "opengl" in WITHOUT:
        os.environ.pop("MUJOCO_GL", None)
        os.environ["__EGL_VENDOR_LIBRARY_FILENAMES"] = os.devnull
    if "vulkan" in WITHOUT:
        os.environ.update(VK_DRIVER_FILES=os.devnull, VK_ICD_FILENAMES=os.devnull, WGPU_BACKEND="vulkan")
    paths = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    if WITHOUT and str(_OUT_OF_REACH) not in paths:
        os.environ["PYTHONPATH"] = os.pathsep.join([str(_OUT_OF_REACH), *filter(None, paths)])
        runpy.run_path(str(_OUT_OF_REACH / "sitecustomize.py"))


if __name__ == "__main__":
    print(*(package for packages in PACKAGES.values() for package in packages))
