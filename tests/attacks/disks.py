"""Disks that are full, or become so, in a dozen ways."""

import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from tests.attacks import kills, reference
from tests.attacks.trials import PASSED, REFUSED, Attack, Ended, LostError, Trial, UntriedError, call, judge

TIME_LIMIT = 90.0


class Kind(NamedTuple):
    """A kind of full disk."""

    what: str
    arguments: Callable[[Path, Path], Sequence[str | Path]]
    """command, from the stage and the disk"""
    disk: str
    """options of the tmpfs that is the disk"""
    before: str = ""
    """shell commands before it, in the folder of the disk"""
    codes: Collection[int] = (REFUSED,)
    environment: tuple[tuple[str, str], ...] = ()


def _run(stage: Path, disk: Path) -> Sequence[str | Path]:
    return "run", stage / "attacked.toml", "--out", disk / "out"


def _run_mcap(stage: Path, disk: Path) -> Sequence[str | Path]:
    return *_run(stage, disk), "--no-rerun"


KINDS = (
    Kind("a disk of 1 MB", _run, "size=1m"),
    Kind("a disk of 3 MB", _run, "size=3m"),
    Kind("a disk of 12 MB", _run, "size=12m"),
    Kind("a disk of 1 MB, .mcap only", _run_mcap, "size=1m"),
    Kind("a disk of 40 kB: the head of a file has no room", _run, "size=40k"),
    Kind("a disk without a byte left", _run, "size=40k", "head -c 1M /dev/zero > rest 2> /dev/null"),
    Kind("a disk without a file left", _run, "size=50m,nr_inodes=2"),
    Kind("a disk that another process fills meanwhile", _run, "size=30m",
         "(sleep 1.5; head -c 40M /dev/zero > rest 2> /dev/null) < /dev/null > /dev/null 2>&1 &"),
    Kind("a disk that cannot be written", _run, "size=8m", "mount -o remount,ro ."),
    Kind("a report that has no room", lambda stage, disk: ("report", stage / "alone.mcap", "--out", disk), "size=100k"),
    Kind("a comparison that has no room",
         lambda stage, disk: ("compare", stage / "alone.mcap", stage / "alone.mcap", "--out", disk), "size=20k"),
    Kind("a sweep that has no room", lambda stage, disk: ("sweep", stage / "sweep.toml", "--out", disk), "size=4k"),
    Kind("a view without room for its temporary files", lambda stage, disk: ("view", "--serve", stage / "only.mcap"),
         "size=1m", environment=(("TMPDIR", "DISK"),)),
    Kind("a run without room for temporary files", _run_mcap, "size=40m",
         "mkdir tmp; mount -t tmpfs -o size=4k tmpfs tmp; head -c 9k /dev/zero > tmp/rest 2> /dev/null",
         (PASSED,), (("TMPDIR", "DISK/tmp"),)),
    Kind("a run without room for machine code", _run_mcap, "size=40m",
         "mkdir cache; mount -t tmpfs -o size=4k tmpfs cache; head -c 9k /dev/zero > cache/rest 2> /dev/null",
         (PASSED,), (("XDG_CACHE_HOME", "DISK/cache"), ("NUMBA_CACHE_DIR", ""))),
)  # fmt: skip


def prepare(stage: Path) -> None:
    reference.make(stage)
    (stage / "sweep.toml").write_text(kills.SWEEP)
    shutil.copy(stage / "alone.mcap", stage / "only.mcap")


def fill(trial: Trial) -> str:
    """Carry out a command on a full disk; what was written until then must be right."""
    ways = (*(lambda kind=kind: _tmpfs(trial, kind) for kind in KINDS), lambda: _limited(trial), *(
        lambda name=name: _full_output(trial, name) for name in ("list", "run", "report", "schema")
    ))  # fmt: skip
    return ways[trial.number % len(ways)]()


def _tmpfs(trial: Trial, kind: Kind) -> str:
    disk, kept = trial.folder / "disk", trial.folder / "kept"
    disk.mkdir()
    script = "\n".join([
        f"mount -t tmpfs -o {kind.disk} tmpfs {disk} && cd {disk} || exit 99", kind.before, "cd /", '"$@"', "code=$?",
        f"cp -r {disk} {kept}", "exit $code",
    ])  # fmt: skip
    wrapper = (*_own_mounts(), "sh", "-c", script, "sh")
    environment = {name: value.replace("DISK", str(disk)) for name, value in kind.environment}
    ended = call(*kind.arguments(trial.stage, disk), wrapper=wrapper, environment=environment, timeout=TIME_LIMIT)
    return _judged(trial, kind.what, ended, kind.codes, kept / "out")


def _own_mounts() -> list[str]:
    """A command that gives another one mounts of its own."""
    for options in (["--mount"], ["--user", "--map-root-user", "--mount"]):
        command = ["unshare", *options, "--propagation", "private"]
        probe = [*command, "mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", "/mnt"]
        try:
            if not subprocess.run(probe, capture_output=True, check=False).returncode:
                return command
        except OSError:
            break
    raise UntriedError("no file system may be mounted here")


def _limited(trial: Trial) -> str:
    """A limit to the size of a file is a full disk to who writes it."""
    most = int(trial.rng.integers(200_000, 4_000_000))

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    out = trial.folder / "out"
    ended = call(*_run(trial.stage, trial.folder), before=limit, timeout=TIME_LIMIT)
    return _judged(trial, f"files of {most / 1e6:.1f} MB at most", ended, (REFUSED,), out)


def _full_output(trial: Trial, name: str) -> str:
    """Standard output into a full device."""
    if not Path("/dev/full").exists():
        raise UntriedError("no /dev/full")
    arguments = {
        "list": ["list", "--parameters"], "schema": ["schema"],
        "run": ["run", trial.stage / "attacked.toml", "--out", trial.folder / "out", "--json"],
        "report": ["report", trial.stage / "alone.mcap", "--out", trial.folder / "pages"],
    }[name]  # fmt: skip
    with Path("/dev/full").open("wb") as full:
        ended = call(*arguments, stdout=full, timeout=TIME_LIMIT)  # type: ignore[arg-type]
    return _judged(trial, f"{name} into a full device", ended, (REFUSED,), trial.folder / "out")


def _judged(trial: Trial, what: str, ended: Ended, codes: Collection[int], out: Path) -> str:
    """Recordings in ``out`` must be readable, as far as there is anything in them."""
    from cls_bench.errors import InputError

    try:
        judge(ended, codes)
        for path in out.glob("*.mcap") if out.exists() else ():
            try:
                saved = reference.compare(trial.stage, path)
            except InputError as error:
                if path.stat().st_size >= 100_000:
                    raise LostError(f"what was written cannot be read: {error}") from None
                saved = 0.0
            what += f", {saved:.2f} s kept"
            rrd = path.with_suffix(".rrd")
            if rrd.exists() and rrd.stat().st_size > 200_000:
                what += f" ({reference.compare_rrd(trial.stage, rrd):.2f} s in the .rrd)"
    except LostError as error:
        raise LostError(f"{what}: {error}") from None
    return what


COUNT = len(KINDS) + 5

DISKS = Attack("disk", "full disks", COUNT, (1, 5, 9, 15, 17), fill, prepare)
