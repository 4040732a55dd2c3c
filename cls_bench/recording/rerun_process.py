"""The Rerun viewer as a process of its own, which ends with ours and tells nobody anything."""

import errno
import importlib.util
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_ENDS_WITH_PARENT = """
import ctypes, os, sys
ctypes.CDLL(None).prctl(1, 9)  # PR_SET_PDEATHSIG, SIGKILL: holds for the program that takes the place of this one
if os.getppid() != int(sys.argv[1]):
    sys.exit(1)
os.execv(sys.argv[2], sys.argv[2:])
"""
"""Becomes the program in its arguments, which the kernel kills when the process that started it ends."""


@contextmanager
def viewer(arguments: Sequence[str], **how: Any) -> "Iterator[subprocess.Popen[bytes]]":
    """Run ``rerun`` with ``arguments``; on leaving it is ended. ``how`` goes to Popen. Raises OSError.

    On Linux it also ends when this process is killed. Its analytics are off, and the user's settings of them are
    neither read nor written.
    """
    binary = program()
    if not os.access(binary, os.X_OK):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(binary))
    command = [str(binary), *arguments]
    if sys.platform == "linux":
        command = [sys.executable, "-I", "-c", _ENDS_WITH_PARENT, str(os.getpid()), *command]
    with tempfile.TemporaryDirectory(prefix="cls-bench-") as settings:
        environment = quiet_environment(Path(settings))
        process = subprocess.Popen(command, env=environment, start_new_session=True, **how)
        try:
            yield process
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)  # it holds nothing that has to be saved
            process.wait()


def program() -> Path:
    """The viewer that comes with rerun-sdk; the script that calls it where it cannot be found."""
    found = importlib.util.find_spec("rerun_cli")
    for folder in (found.submodule_search_locations or ()) if found else ():
        if os.access(binary := Path(folder) / "rerun", os.X_OK):
            return binary
    return Path(sys.executable).with_name("rerun")


def quiet_environment(settings: Path) -> Mapping[str, str]:
    """An environment in which Rerun sends nothing; ``settings`` is an empty folder that must stay for the while.

    Rerun sends nothing where its settings say so, and nothing where the variable CI is set. Its settings lie in the
    user's configuration folder; so it is given another, with all that is in the user's but Rerun's own.
    """
    environment = dict(os.environ)
    for name in ("FORCE_RERUN_ANALYTICS", "RERUN_TELEMETRY_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT"):
        environment.pop(name, None)
    users = Path(environment.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    with suppress(OSError):
        for entry in users.iterdir():
            if entry.name != "rerun":
                (settings / entry.name).symlink_to(entry.resolve())
    own = settings / "rerun"
    own.mkdir()
    about = {
        "analytics_enabled": False, "analytics_id": "", "metadata": {},
        "config_file_path": str(own / "analytics.json"), "data_dir_path": str(own / "analytics"),
    }  # fmt: skip
    (own / "analytics.json").write_text(json.dumps(about), encoding="utf-8")
    environment.setdefault("RUST_LOG", "warn")  # it would also offer an address of its own
    return environment | {"CI": "1", "TELEMETRY_ENABLED": "false", "XDG_CONFIG_HOME": str(settings)}
