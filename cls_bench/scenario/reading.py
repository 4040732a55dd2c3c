"""Scenarios from TOML files.

The file is typed and strict: whatever is wrong is an :class:`~cls_bench.errors.InputError` of one line that names the
file, the key, the value and what would be valid.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cls_bench.errors import InputError
from cls_bench.input.faults import nearest
from cls_bench.input.files import read_file
from cls_bench.input.toml_file import MOST_BYTES, parse_toml
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import present_names
from cls_bench.resources import shipped_scenarios
from cls_bench.rigs import THESIS, Rig, load_rig
from cls_bench.scenario.placing import as_text, place, place_override
from cls_bench.scenario.scenario import Origin, Scenario
from cls_bench.text import escaped


def load_scenario(
    name_or_path: str | Path, *, seed: int | None = None, set: Sequence[str] = (), rig: "str | Path | Rig | None" = None
) -> Scenario:
    """Read a shipped scenario by name, or any scenario file by path.

    ``seed`` replaces the file's; ``set`` holds overrides ``KEY=VALUE`` with TOML values, where the key is a parameter
    (``feel.inertia=0.25``), ``duration``, ``seed`` or that of an entry (``squeeze[0].value``). ``rig`` replaces the
    file's: the name of a shipped one, or a file. Raises InputError.
    """
    shipped = shipped_scenarios()
    text = str(name_or_path)
    path = shipped.get(text) or Path(name_or_path)
    try:
        source = read_file(path, MOST_BYTES)
    except FileNotFoundError:
        if path.suffix == ".toml" or len(path.parts) > 1:
            raise InputError(f"{escaped(text, 500)}: no such file") from None
        raise InputError(f"{escaped(text)}: no such scenario or file; {nearest(text, shipped)}") from None
    except OSError as error:
        raise InputError(f"{escaped(text, 500)}: cannot be read: {error.strerror}") from None
    return parse_scenario(source, path=path, seed=seed, set=set, rig=rig)


def parameters_of(rig: "str | Path | Rig | None" = None, set: Sequence[str] = ()) -> Parameters:
    """Parameters of a rig, the thesis's unless given, with overrides ``KEY=VALUE``. Raises InputError."""
    table: dict[str, Any] = {}
    keys = frozenset(place_override(table, entry) for entry in set)
    chosen: Rig | None = None
    if isinstance(rig, Rig):
        chosen = rig
    elif rig is not None or "rig" not in table:
        chosen = load_rig(rig or THESIS)
    setup = {"title": "setup", "duration": 1.0} | table
    return Scenario.model_validate(setup, context=Origin(overridden=keys, rig=chosen)).parameters_at_start()


def parse_scenario(
    toml: str | bytes,
    *,
    name: str = "scenario",
    path: Path | None = None,
    seed: int | None = None,
    set: Sequence[str] = (),
    rig: "str | Path | Rig | None" = None,
    sample_files: Mapping[str, bytes] | None = None,
) -> Scenario:
    """Make a scenario of TOML text and check it as a whole; as :func:`load_scenario` otherwise.

    ``path`` is where the text was read from: it gives the name, and the files that it names are looked for beside it
    (in the current folder without it). If ``sample_files`` is given, name -> content, they are taken from there and
    nothing is read from the disk: so a recording is read, and parameters may have the names of earlier versions. Raises
    InputError.
    """
    source = toml.encode(errors="surrogatepass") if isinstance(toml, str) else toml
    file = escaped(str(path) if path else name, 500)
    table = parse_toml(source, file)
    found = load_rig(rig) if rig is not None and not isinstance(rig, Rig) else rig
    named = table.get("rig", THESIS)
    given: dict[str, Any] = {} if seed is None else {"seed": seed}
    if found is not None:
        given["rig"] = found.file if found.is_file else found.name
    overridden = {place_override(table, entry) for entry in set} | {place(table, k, v) for k, v in given.items()}
    if sample_files is not None:
        _rename(table)
    overrides = (*set, *(as_text(key, value) for key, value in given.items()))
    origin = Origin(
        path.stem if path else name, path, source, overrides, frozenset(overridden), sample_files, found,
        named if found is not None and isinstance(named, str) else "", file,
    )  # fmt: skip
    return Scenario.model_validate(table, context=origin)


def _rename(table: dict[str, Any]) -> None:
    """Give parameters of earlier versions their present names; what is no table is left to the check."""
    changes = table.get("changes")
    for owner in (table, *(changes if isinstance(changes, list) else ())):
        if isinstance(owner, dict) and isinstance(owner.get("parameters"), dict):
            owner["parameters"] = present_names(owner["parameters"])
