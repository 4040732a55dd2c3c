"""Names in the file system, claimed so that no two runs share one.

Any number of processes and threads may write into one folder at once: what one has claimed, no other takes, and
nobody sees a file that is half written.
"""

import fcntl
import hashlib
import itertools
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cls_bench.errors import OutputError

RECORDINGS = Path("recordings")
"""Where recordings and results go unless told otherwise: a folder in the current one."""

LONGEST_NAME = 180
"""Bytes of a name that others are made of; file systems take 255, so there is room for numbers and suffixes."""


def file_name(text: str) -> str:
    """``text`` as a file's name: no separators and control characters, and not longer than :data:`LONGEST_NAME`.

    What is cut off is replaced by a hash of the whole, so that different texts keep different names.
    """
    name = "".join("_" if c in "/\\" or ord(c) < 32 or ord(c) == 127 else c for c in text)
    encoded = os.fsencode(name)
    if len(encoded) > LONGEST_NAME or name in ("", ".", ".."):
        mark = "-" + hashlib.sha256(encoded).hexdigest()[:8]
        name = encoded[: LONGEST_NAME - len(mark)].decode(errors="ignore").strip(".") + mark
    return name


def cannot_write(path: Path, error: OSError) -> OutputError:
    """The system's ``error`` as one line that names the file."""
    return OutputError(f"cannot write {path}: {error.strerror or error}")


def claim_stem(folder: Path, name: str, suffixes: tuple[str, ...], others: tuple[str, ...] = ()) -> Path:
    """Create empty files ``folder/NAME`` + ``suffixes`` that nobody else has; returns ``folder/NAME``.

    NAME is ``name``, with a number behind it if one of the files, or one of those with a suffix of ``others``, exists.
    The first suffix decides between runs that claim at the same moment. Raises OutputError.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from None
    for stem in numbered(folder / file_name(name)):
        paths = [stem.with_name(stem.name + suffix) for suffix in suffixes]
        made: list[Path] = []
        try:
            for path in paths:
                os.close(os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
                made.append(path)
        except FileExistsError:
            pass
        except OSError as error:
            remove(*made)
            raise cannot_write(paths[len(made)], error) from None
        if len(made) == len(paths) and not any(_taken(stem.with_name(stem.name + suffix)) for suffix in others):
            return stem
        remove(*made)
    raise AssertionError("numbers do not end")


def _taken(path: Path) -> bool:
    return path.exists() or path.is_symlink()


def numbered(path: Path) -> Iterator[Path]:
    """``path``, and then the same name with 2, 3, … behind it."""
    yield path
    for number in itertools.count(2):
        yield path.with_name(f"{path.name}-{number}")


def remove(*paths: Path) -> None:
    """Remove files as far as they are there and the system lets us."""
    for path in paths:
        with suppress(OSError):
            path.unlink()


def remove_empty(*paths: Path) -> None:
    """Remove those of the files that hold nothing."""
    for path in paths:
        with suppress(OSError):
            found = path.lstat()
            if stat.S_ISREG(found.st_mode) and found.st_size == 0:
                path.unlink()


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A file beside ``path`` to write to; it takes the place of ``path`` at the end, at once, if nothing was raised.

    A device or pipe is written to as it is. Raises OSError.
    """
    target = path.resolve()
    with suppress(FileNotFoundError):
        if not stat.S_ISREG(target.stat().st_mode):
            yield target
            return
    temporary = target.with_name(f".{secrets.token_hex(8)}{target.suffix[-16:]}")
    try:
        yield temporary
        temporary.replace(target)
    finally:
        remove(temporary)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` as UTF-8, at once: others see the file as it was or as it is now. Raises OSError."""
    with replaced(path) as file:
        file.write_bytes(text.encode(errors="surrogateescape"))


def named(folder: Path) -> Path:
    """``folder`` as it is written to: with a name that the file system takes, also where it was given as ``..``."""
    return folder.with_name(file_name(folder.name)) if folder.name not in ("", "..") else folder.resolve()


@contextmanager
def claimed_folder(folder: Path, began: float, *, resume: bool = False) -> Iterator[Path]:
    """A folder for the results of one command, which no other writes to meanwhile; made if it is not there.

    It is ``folder`` unless another process or thread writes there now, or has done so since ``began`` (wall-clock time
    [s] at which the command started); then it is a new one with a number behind its name. With ``resume`` only
    ``folder`` will do. Raises OutputError.
    """
    folder = named(folder)
    for candidate in numbered(folder):
        try:
            made = _made(candidate)
            if not made and not resume and (candidate != folder or candidate.stat().st_mtime > began):
                continue
            held = _locked(candidate)
        except OSError as error:
            raise cannot_write(candidate, error) from None
        if held is None and resume:
            raise OutputError(f"{folder} is being written by another cls-bench; wait for it, or choose another --out")
        if held is not None:
            try:
                yield candidate
            finally:
                os.close(held)
            return


def _made(folder: Path) -> bool:
    """Make ``folder``; False if it is there already."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    try:
        folder.mkdir()
    except FileExistsError:
        if not folder.is_dir():
            raise
        return False
    return True


def _locked(folder: Path) -> int | None:
    """A descriptor that holds the lock of ``folder`` until it is closed or the process ends; None if another does."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(descriptor)
        if isinstance(error, BlockingIOError):
            return None
        raise
    return descriptor


@contextmanager
def claimed_page(folder: Path, name: str, owner: str) -> Iterator[Path]:
    """Where the page of ``owner`` goes: ``folder/NAME.html``, with a number behind NAME if it is another's.

    Whose a page is stands in its head (:func:`page_mark`). A page that is new and was not written is removed again.
    Raises OSError.
    """
    folder.mkdir(parents=True, exist_ok=True)
    claim = folder / f".{secrets.token_hex(8)}.html"
    mark = page_mark(owner)
    try:
        claim.write_text(mark, encoding="utf-8")
        for stem in numbered(folder / file_name(name)):
            page = stem.with_name(f"{stem.name}.html")
            try:
                os.link(claim, page)
            except FileExistsError:
                if mark not in page.read_text(encoding="utf-8", errors="replace")[:4096]:
                    continue
            break
    finally:
        remove(claim)
    try:
        yield page
    finally:
        with suppress(OSError):
            if page.stat().st_size == len(mark):
                page.unlink()


def page_mark(owner: str) -> str:
    """The line in a page's head that says whose it is."""
    return f'<meta name="cls-bench-owner" content="{hashlib.sha256(os.fsencode(owner)).hexdigest()[:32]}">'
