"""A screenshot of the Rerun viewer without a screen: for pictures and tests. Needs a Vulkan driver, such as Mesa's."""

import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from rerun.experimental import ViewerClient

from cls_bench.errors import InputError
from cls_bench.recording.rerun_layout import TIMELINE
from cls_bench.recording.rerun_process import viewer

SIZE = (1280, 800)
START_S, SETTLE_S = 60.0, 4.0
"""How long the viewer may take to start, and how long it is given to draw [s]."""


def screenshot(files: Sequence[Path], at: float, size: tuple[int, int] = SIZE, settle: float = SETTLE_S) -> bytes:
    """The viewer showing ``files`` at ``at`` [s], as PNG. InputError if it cannot start, as without a driver."""
    port = _free_port()
    arguments = [
        "--headless", "--bind", "127.0.0.1", "--port", str(port), "--window-size", f"{size[0]}x{size[1]}",
        "--hide-welcome-screen", *map(str, files),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as log, viewer(arguments, stdout=log, stderr=subprocess.STDOUT) as process:
        client = _connect(process, port, log)
        time.sleep(settle)
        client.set_time(TIMELINE, duration=at, play_state="paused")
        time.sleep(settle)
        return bytes(client.take_screenshot())


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _connect(process: "subprocess.Popen[bytes]", port: int, log: IO[bytes]) -> ViewerClient:
    """A client of the viewer once it shows a recording."""
    client: ViewerClient | None = None
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        if process.poll() is not None:
            log.seek(0)
            said = re.search(r"panicked at '([^']*)'", log.read().decode(errors="replace"))
            reason = f" ({said[1]})" if said else ""
            raise InputError(
                f"the Rerun viewer cannot start{reason}; it needs a Vulkan driver: on Debian, "
                "apt install mesa-vulkan-drivers"
            )
        try:
            client = client or ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
            state = client.get_state()
            if state.active_recording and not state.loading:
                return client
        except (ConnectionError, RuntimeError):  # not up yet
            pass
        time.sleep(0.3)
    raise InputError(f"the Rerun viewer showed nothing within {START_S:g} s")
