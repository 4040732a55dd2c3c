"""The machine code's cache: its key covers what is compiled, and nothing that is only imported along with it."""

import os
import shutil
import subprocess
import sys

import grimp
import pytest

from cls_bench import compiled

NEVER_COMPILED = {"cls_bench.errors", "cls_bench.pilot", "cls_bench.resources", "cls_bench.scenario"}
"""What ``tick`` and ``plant`` import for types and for building the model: no function of theirs is compiled."""


def _hashed() -> set[str]:
    folder = compiled.Path(compiled.__file__).parent
    paths = [path for pattern in compiled.SOURCES for path in folder.glob(pattern)]
    dotted = [".".join(("cls_bench", *path.relative_to(folder).with_suffix("").parts)) for path in paths]
    return {name.removesuffix(".__init__") for name in dotted}


def test_key_covers_all_that_the_tick_imports() -> None:
    graph = grimp.build_graph("cls_bench")
    for name in NEVER_COMPILED:
        graph.remove_module(name)
    imported = graph.find_upstream_modules("cls_bench.tick") | {"cls_bench.tick"}
    assert "cls_bench.control.servo" in imported
    assert imported - {"cls_bench"} <= _hashed()


def test_nothing_compiled_is_left_out() -> None:
    folder = compiled.Path(compiled.__file__).parent
    for name in NEVER_COMPILED:
        place = folder / name.removeprefix("cls_bench.").replace(".", "/")
        files = list(place.glob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
        assert files
        for source in (file.read_text() for file in files):
            assert "@compiled" not in source and "njit" not in source


def test_key_follows_the_sources(tmp_path, monkeypatch) -> None:
    for pattern in compiled.SOURCES:
        for path in compiled._PACKAGE.glob(pattern):
            copy = tmp_path / path.relative_to(compiled._PACKAGE)
            copy.parent.mkdir(exist_ok=True)
            copy.write_bytes(path.read_bytes())
    (tmp_path / "bench.py").write_text("")
    before = compiled.source_hash()
    monkeypatch.setattr(compiled, "_PACKAGE", tmp_path)
    assert compiled.source_hash() == before
    (tmp_path / "bench.py").write_text("# not compiled")
    assert compiled.source_hash() == before
    law = tmp_path / "control" / "servo.py"
    law.write_bytes(law.read_bytes() + b"\n# changed\n")
    assert compiled.source_hash() != before


# --- the cache on disk ------------------------------------------------------------------------------------------------

LAW = """
from cls_bench.compiled import compiled


@compiled
def law(x: float) -> float:
    return {factor} * x
"""

CALL = "import sys; sys.path.insert(0, {folder!r}); import law; print(law.law(1.5))"


def _law(folder, cache, factor=2.0, **environment):
    """What the law gives in a process of its own, and what that says."""
    path = folder / "law.py"
    if factor is not None:
        path.write_text(LAW.format(factor=factor))
        # A second later than the one before: Python takes a file of the same time and size for unchanged.
        os.utime(path, (path.stat().st_mtime + factor,) * 2)
    done = subprocess.run(
        [sys.executable, "-c", CALL.format(folder=str(folder))], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", "NUMBA_CACHE_DIR": str(cache), **environment},
    )  # fmt: skip
    return float(done.stdout), done.stderr


def _entries(cache):
    return sorted(cache.rglob("law.law-*.bin"))


def test_machine_code_is_kept_and_follows_its_file(tmp_path):
    cache = tmp_path / "cache"
    assert _law(tmp_path, cache)[0] == 3.0
    (entry,) = _entries(cache)
    stamp = entry.stat().st_mtime_ns
    assert _law(tmp_path, cache)[0] == 3.0
    assert entry.stat().st_mtime_ns == stamp
    assert _law(tmp_path, cache, factor=4.0)[0] == 6.0
    assert len(_entries(cache)) == 2


def test_damaged_machine_code_is_made_anew(tmp_path):
    cache = tmp_path / "cache"
    _law(tmp_path, cache)
    (entry,) = _entries(cache)
    whole = entry.read_bytes()
    middle = len(whole) // 2
    flipped = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    for damaged in (whole[:20], whole[:middle], flipped):
        entry.write_bytes(damaged)
        value, said = _law(tmp_path, cache)
        assert (value, said) == (3.0, "")
        assert len(entry.read_bytes()) > middle


def test_without_a_cache_it_is_compiled_each_time_and_said(tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("")
    value, said = _law(tmp_path, taken)
    assert value == 3.0
    assert "machine code cannot be kept" in said
    assert _law(tmp_path, taken, factor=4.0)[0] == 6.0
    assert not list(tmp_path.rglob("*.nbi")) and not list(tmp_path.rglob("*.nbc"))


def test_numba_s_own_settings_do_not_bring_its_own_cache_back(tmp_path):
    cache = tmp_path / "cache"
    assert _law(tmp_path, cache, NUMBA_CACHE_LOCATOR_CLASSES="InTreeCacheLocator")[0] == 3.0
    assert not list(tmp_path.rglob("*.nbi"))


def test_byte_code_of_another_source_is_not_run(tmp_path):
    """Same time, same size: Python takes the old byte code for the new source."""
    cache = tmp_path / "cache"
    assert _law(tmp_path, cache)[0] == 3.0
    path = tmp_path / "law.py"
    stamp = path.stat()
    path.write_text(LAW.format(factor=4.0))
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    done = subprocess.run(
        [sys.executable, "-c", CALL.format(folder=str(tmp_path))], capture_output=True, text=True,
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "", "NUMBA_CACHE_DIR": str(cache)}, check=False,
    )  # fmt: skip
    assert done.returncode != 0
    assert "changed while it was being loaded" in done.stderr


def test_stale_byte_code_of_the_hot_path_is_deleted(tmp_path):
    package = tmp_path / "cls_bench"
    shutil.copytree(compiled._PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("models", "scenarios"):
        shutil.copytree(compiled._PACKAGE.parent / name, tmp_path / name)
    code = "import cls_bench; from cls_bench.control import latch; print(latch.DEPTH, cls_bench.__file__)"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": ""}

    def depth():
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False, cwd=tmp_path
        )
        return done.stdout.split(), done.stderr

    before, _ = depth()
    assert before[1].startswith(str(tmp_path))
    path = package / "control" / "latch.py"
    stamp, text = path.stat(), path.read_text()
    number = int(before[0])
    other = str(number)[:-1] + str((number + 1) % 10)
    assert f"DEPTH = {number}" in text
    path.write_text(text.replace(f"DEPTH = {number}", f"DEPTH = {other}"))
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    shown, said = depth()
    assert not shown or shown[0] == other
    assert shown or "run again" in said
    assert depth()[0][0] == other


def test_byte_code_of_an_edit_within_the_same_second_is_refused_once(tmp_path):
    cache = tmp_path / "cache"
    assert _law(tmp_path, cache)[0] == 3.0
    stamp = (tmp_path / "law.py").stat()
    (tmp_path / "law.py").write_text(LAW.format(factor=4.0))
    os.utime(tmp_path / "law.py", (stamp.st_atime, stamp.st_mtime))
    with pytest.raises(subprocess.CalledProcessError) as refused:
        _law(tmp_path, cache, factor=None)
    assert "changed while it was being loaded; run again" in refused.value.stderr
    assert _law(tmp_path, cache, factor=None)[0] == 6.0
