"""The machine code's cache: its key covers what is compiled, and nothing that is only imported along with it."""

import grimp

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
        for module in {name, *graph.find_descendants(name)}:
            graph.remove_module(module)
    imported = graph.find_upstream_modules("cls_bench.tick") | {"cls_bench.tick"}
    assert "cls_bench.control.servo" in imported
    assert imported - {"cls_bench"} <= _hashed()


def test_nothing_compiled_is_left_out() -> None:
    folder = compiled.Path(compiled.__file__).parent
    for name in NEVER_COMPILED:
        place = folder / name.removeprefix("cls_bench.")
        sources = [*place.glob("*.py")] if place.is_dir() else [place.with_suffix(".py")]
        assert sources
        for source in (path.read_text() for path in sources):
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
