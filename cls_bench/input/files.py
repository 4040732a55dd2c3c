"""Reading files that a person or another file names."""

import os
import stat
from pathlib import Path


def read_file(path: Path, most: int) -> bytes:
    """The content of a regular file of at most ``most`` bytes. Raises OSError for any other.

    A device or a pipe is not opened for reading: it may never end, or never begin.
    """
    if "\0" in str(path):
        raise OSError(0, "a name cannot hold the character NUL")
    # Without waiting: opening a pipe that no one writes to would.
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | getattr(os, "O_NONBLOCK", 0))) as file:
        about = os.fstat(file.fileno())
        if stat.S_ISDIR(about.st_mode):
            raise IsADirectoryError(0, "Is a directory")
        if not stat.S_ISREG(about.st_mode):
            raise OSError(0, "not a regular file")
        content = file.read(most + 1)
    if len(content) > most:
        raise OSError(0, f"larger than the {most / 1e6:g} MB that are read")
    return content
