"""The machine code's cache: its key covers what is compiled, and nothing that is only imported along with it."""

import ast
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from numba import types

from cls_bench import compiled

PACKAGE = Path(compiled.__file__).parent


# --- what is compiled, read from the sources alone --------------------------------------------------------------------


class Module:
    """A source file: what it defines at its top, and where its imported names come from."""

    def __init__(self, path: Path):
        self.path = path
        self.defined: dict[str, ast.AST] = {}
        self.imported: dict[str, tuple[Path, str | None]] = {}
        """file, and the name in it; None for the file itself"""
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "cls_bench":
                for alias in node.names:
                    name = alias.asname or alias.name
                    inner = _file(f"{node.module}.{alias.name}")
                    self.imported[name] = (inner, None) if inner else (_file(node.module), alias.name)
        self._define(ast.parse(path.read_text(encoding="utf-8")).body)

    def _define(self, body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                self.defined[node.name] = node
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    self.defined |= {n.id: node for n in ast.walk(target) if isinstance(n, ast.Name)}
            elif isinstance(node, ast.If):
                self._define([*node.body, *node.orelse])

    @property
    def marked(self) -> list[str]:
        """Functions that are compiled."""
        return [
            name for name, node in self.defined.items()
            if isinstance(node, ast.FunctionDef) and "compiled" in map(ast.unparse, node.decorator_list)
        ]  # fmt: skip


def _file(dotted: str) -> Path | None:
    """The file of a module of the package."""
    base = PACKAGE.parent.joinpath(*dotted.split("."))
    return next((path for path in (base.with_suffix(".py"), base / "__init__.py") if path.is_file()), None)


module = cache(Module)


COMPILED, FEEL = PACKAGE / "compiled.py", PACKAGE / "feel"


def _used(path: Path, name: str) -> Iterator[tuple[Path, str]]:
    """What the definition of ``name`` takes from the top of its own or another file: (file, name)."""
    own, node = module(path), module(path).defined.get(name)
    if name in own.imported and node is None:  # handed on, as by a package
        where, other = own.imported[name]
        if other is not None:
            yield where, other
        return
    if node is None or path == COMPILED or (isinstance(node, ast.ClassDef) and FEEL not in path.parents):
        return
    if isinstance(node, ast.ClassDef):  # the list of elements, and an element with its laws
        for field in node.body:
            if isinstance(field, ast.AnnAssign) and isinstance(field.annotation, ast.Name):
                yield own.imported.get(field.annotation.id, (path, ""))
            elif isinstance(field, ast.Assign) and isinstance(field.value, ast.Call):
                yield from ((path, law.id) for law in field.value.args if isinstance(law, ast.Name))
        return
    parts = node.body if isinstance(node, ast.FunctionDef) else [node.value]
    whole = [n for part in parts if part is not None for n in ast.walk(part)]
    for n in whole:
        if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name):
            where, other = own.imported.get(n.value.id, (None, ""))
            if where is not None and other is None:
                yield where, n.attr
        elif isinstance(n, ast.Name) and n.id in own.imported and own.imported[n.id][1] is not None:
            yield own.imported[n.id]
        elif isinstance(n, ast.Name) and n.id in own.defined and n.id != name:
            yield path, n.id


def needed(path: Path) -> set[Path]:
    """Files on which the machine code of the functions of ``path`` depends, wherever a name is handed on."""
    open_ = [(path, name) for name in module(path).marked]
    seen = set(open_)
    while open_:
        for item in _used(*open_.pop()):
            if item not in seen:
                seen.add(item)
                open_.append(item)
    made = {item: module(item[0]).defined.get(item[1]) for item in seen}
    return {where for (where, _), node in made.items() if node is not None and not _is_element(where, node)}


def _is_element(path: Path, node: ast.AST) -> bool:
    """Its laws are compiled, it is not: one without any stands in no machine code."""
    return FEEL in path.parents and isinstance(node, ast.ClassDef)


COMPILING = [path for path in sorted(PACKAGE.rglob("*.py")) if module(path).marked]


def test_the_sources_are_read_right():
    """What the analysis must see: functions, constants by name and by module, and those that a package hands on."""
    found = {path.relative_to(PACKAGE).as_posix() for path in needed(PACKAGE / "tick.py")}
    for file in ("compiled", "control/plc", "feel/solver", "feel/elements/trim", "kinematics", "quantity"):
        assert f"{file}.py" in found
    assert not found & {"parameters/__init__.py", "plant/mjcf.py", "plant/shapes.py", "plant/model.py", "hand.py"}
    assert sum(len(module(PACKAGE / file).marked) for file in ("tick.py", "control/controller.py")) > 15


def test_the_key_covers_what_the_loop_is_compiled_from_and_nothing_else():
    hashed = set(compiled._source_files())
    loop = {path for pattern in compiled.SOURCES for path in PACKAGE.glob(pattern)} & set(COMPILING)
    assert set().union(*(needed(path) for path in loop)) == hashed


@pytest.mark.parametrize("path", COMPILING, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_no_function_is_compiled_from_a_file_that_no_key_knows(path):
    """Wherever it stands: an entry's name has the meaning of its own file, its folder that of the loop's files."""
    assert needed(path) <= {*compiled._source_files(), path}


# --- the key ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def copied(tmp_path, monkeypatch):
    """A copy of the package's sources, of which the key is then made."""
    folder = tmp_path / "cls_bench"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__", "_data"))
    monkeypatch.setattr(compiled, "_PACKAGE", folder)
    return folder


def _changed(path: Path, old: str, new: str) -> bool:
    """Whether the key is another one with ``new`` in place of ``old``."""
    text = path.read_text(encoding="utf-8")
    assert old in text and old != new
    before = _key()
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    after = _key()
    path.write_text(text, encoding="utf-8")
    assert _key() == before
    return after != before


def _key() -> str:
    compiled._source.cache_clear()  # a process reads its sources once
    found = compiled.source_hash()
    compiled._source.cache_clear()
    return found


@pytest.mark.parametrize(("file", "old", "new"), [
    ("control/servo.py", "\n@compiled\n", "\n# a comment\n@compiled\n"),
    ("control/servo.py", "Velocity from the encoder", "Speed from the encoder"),
    ("control/plc.py", "Slots of a command frame", "Places in a command frame"),
    ("control/servo.py", "raw = (encoder - state.encoder_before) / cycle",
     "raw = (\n        encoder - state.encoder_before\n    ) / cycle"),
    ("parameters/plant.py", "rotor inertia", "inertia of the rotor"),
    ("parameters/plant.py", "4.0e-5", "4.1e-5"),
    ("parameters/control.py", "assumed: tuned", "assumed: tuned by hand"),
    ("recording/layout.py", "import ", "import  "),
    ("quantity.py", "Standard gravity", "Gravity"),
    ("plant/mjcf.py", "import ", "import  "),
    ("plant/shapes.py", "0.0", "0.1"),
    ("plant/model.py", "1e-6", "1e-5"),
    ("control/tuning.py", "2.0", "3.0"),
    ("bench.py", "0.2", "0.3"),
    ("signals.py", "drive's", "drive"),
])  # fmt: skip
def test_what_is_not_compiled_changes_no_key(copied, file, old, new):
    assert not _changed(copied / file, old, new)


@pytest.mark.parametrize(("file", "old", "new"), [
    ("control/servo.py", "ratio * ratio", "ratio * ratio * ratio"),
    ("control/latch.py", "DEPTH = 17", "DEPTH = 18"),
    ("feel/solver.py", "_REACH = 0.4", "_REACH = 0.3"),
    ("feel/elements/trim.py", "trim.rate * cycle", "2.0 * trim.rate * cycle"),
    ("feel/model.py", "    jam: Jam = Jam()\n", ""),
    ("control/plc.py", "COMMAND_POSITION, COMMAND_VELOCITY", "COMMAND_VELOCITY, COMMAND_POSITION"),
    ("plant/motor.py", "return 0.0", "return 1.0"),
    ("plant/play.py", "@compiled", "@compiled\n@compiled"),
    ("kinematics.py", "0.5", "0.6"),
    ("quantity.py", "9.80665", "9.81"),
    ("compiled.py", 'error_model="numpy"', 'error_model="python"'),
    ("tick.py", "BOUND = 1.0e4", "BOUND = 1.0e5"),
])  # fmt: skip
def test_what_is_compiled_changes_the_key(copied, file, old, new):
    assert _changed(copied / file, old, new)


def test_a_new_law_changes_the_key(copied):
    before = _key()
    (copied / "control" / "force.py").write_text("X = 1.0\n")
    assert _key() == before  # nothing in it is compiled
    (copied / "control" / "force.py").write_text(
        "from cls_bench.compiled import compiled\n\n\n@compiled\ndef f():\n    return 1.0\n"
    )
    assert _key() != before


def test_an_entry_knows_the_fields_of_a_named_tuple():
    """Two places of one type change their names: numba gives the type the same name, and the law reads the other."""
    number = types.float64
    one, other = (types.NamedUniTuple(number, 2, _tuple(names)) for names in ("ab", "ba"))
    assert str(one) == str(other)
    assert [*compiled._fields((number, one))] != [*compiled._fields((number, other))]
    nested = types.Tuple((number, types.UniTuple(one, 2)))
    assert [*compiled._fields((nested,))] == [("a", "b")] * 2


def _tuple(names: str) -> type:
    from collections import namedtuple

    return namedtuple("Pair", [*names])


@pytest.mark.slow
def test_a_parameters_text_compiles_nothing(tmp_path):
    """The whole loop, in processes of their own: another text, another default; then another law."""
    package = tmp_path / "cls_bench"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__", "_data"))
    for name in ("models", "scenarios"):
        shutil.copytree(PACKAGE.parent / name, tmp_path / name)
    code = (
        "import cls_bench; from cls_bench.bench import Bench; from cls_bench.parameters import Parameters\n"
        f"assert cls_bench.__file__.startswith({str(tmp_path)!r})\nBench(Parameters()).compile()"
    )
    kept = tmp_path / "cache"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(kept)}

    def entries() -> set[Path]:
        subprocess.run([sys.executable, "-c", code], check=True, env=environment, cwd=tmp_path)
        return {path for path in kept.rglob("tick.advance-*.bin")}

    def edit(file: str, old: str, new: str) -> None:
        text = (package / file).read_text(encoding="utf-8")
        assert old in text
        (package / file).write_text(text.replace(old, new, 1), encoding="utf-8")

    first = entries()
    assert len(first) == 1
    edit("parameters/plant.py", "rotor inertia", "inertia of the rotor")
    edit("parameters/plant.py", "4.0e-5", "4.1e-5")
    edit("control/servo.py", "Velocity from the encoder", "Speed from the encoder")
    assert entries() == first
    edit("control/servo.py", "state.voltage = 0.0", "state.voltage = 1.0")
    assert len(entries()) == 2


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
