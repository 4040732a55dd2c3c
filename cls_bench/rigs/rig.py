"""The rig file: what a bench is built of, as it differs from the thesis's, from data sheets or in SI.

.. code-block:: toml

    title = "…"
    description = "… with the sources"

    [data_sheet.motor]                  # as printed, the unit in the key (cls_bench/rigs/data_sheet.py)
    torque_constant_Nm_per_A = 0.51
    …

    [parameters.column]                 # SI, as in a scenario; whatever no data sheet says
    inertia = 0.05

    [nameplate]                         # where drive and PLC believe something else than the data sheets
    load_inertia = 1.0e-4

Later ones win: data sheets, then parameters. Then what follows from them: bandwidths, stops, the nameplate.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError

from cls_bench.errors import InputError
from cls_bench.input.faults import FaultError, nearest, problem_of, shown
from cls_bench.input.files import read_file
from cls_bench.input.tables import IN_FILE, LONGEST_LINE, Strict, place_of, worst
from cls_bench.input.toml_file import MOST_BYTES, parse_toml
from cls_bench.parameters import Parameters
from cls_bench.parameters.override import flat, override, parameters_with
from cls_bench.resources import shipped_rigs
from cls_bench.rigs import data_sheet
from cls_bench.rigs.data_sheet import DataSheet
from cls_bench.rigs.derivation import Derived, derived
from cls_bench.rigs.tuning import BANDWIDTHS, bandwidths, current_bandwidth, in_proportion
from cls_bench.step_limit import enough_substeps, unstable_parameter
from cls_bench.text import escaped

THESIS = "thesis"
"""The rig that a scenario is run on unless it names another."""


class RigFile(Strict):
    """A rig as its file describes it."""

    title: Annotated[str, Field(min_length=1, max_length=200)]
    """one line that says what it is"""
    description: str = ""
    """what it is for, and the sources of its values"""
    data_sheet: DataSheet = DataSheet()
    """values as data sheets print them"""
    parameters: dict[str, Any] = Field(default_factory=dict)
    """values that differ from the thesis's rig, by dotted key, SI"""
    nameplate: dict[str, Any] = Field(default_factory=dict)
    """what drive and PLC believe where it does not follow from the parameters, SI"""


@dataclass(frozen=True)
class Rig:
    """A rig, ready to be run on."""

    name: str
    title: str
    description: str
    parameters: Parameters
    """the bench as it is delivered, with its nameplate"""
    derived: tuple[Derived, ...] = field(repr=False)
    """what follows from its data sheets and from the rules"""
    source: bytes = field(repr=False)
    """the text of its file"""
    file: str
    """name of the file, as a scenario names it"""
    is_file: bool
    """whether it is a file of the user's, not one of those that come with the bench"""

    @property
    def metadata(self) -> dict[str, str]:
        """What a recording says of it besides its file and all parameters."""
        return {"rig": self.name, "rig.title": self.title, "rig.sha256": hashlib.sha256(self.source).hexdigest()}


def load_rig(name_or_path: str | Path) -> Rig:
    """The rig of that name, or of that file. Raises InputError with one line that says what is wrong."""
    text = str(name_or_path)
    if text in shipped_rigs():
        return find_rig(text)
    path = Path(name_or_path)
    return parse_rig(_read(path, text), name=path.stem, file=path.name)


def find_rig(name: str, folder: Path = Path(), given: Mapping[str, bytes] | None = None) -> Rig:
    """The rig that a file in ``folder`` names: one that comes with the bench, or a file beside it.

    ``given`` are the contents of files by name; they are taken before those on the disk, and instead of files that are
    not shipped. Raises InputError.
    """
    shipped = shipped_rigs().get(name)
    if shipped is not None:
        file = f"{name}.toml"
        source = given[file] if given is not None and file in given else _read(shipped, name)
        return _parsed(source, name, file, False)
    if given is not None and name not in given:
        raise InputError(f"{shown(name)} is not among the recording's attachments")
    source = _read(folder / name, name) if given is None else given[name]
    return _parsed(source, Path(name).stem, name, True)


def parse_rig(toml: str | bytes, *, name: str = "rig", file: str | None = None) -> Rig:
    """Make a rig of the text of its file. Raises InputError."""
    source = toml.encode(errors="surrogatepass") if isinstance(toml, str) else toml
    return _parsed(source, name, file or f"{name}.toml", True)


def _read(path: Path, said: str) -> bytes:
    try:
        return read_file(path, MOST_BYTES)
    except FileNotFoundError:
        problem = "no such rig or file; " + nearest(said, shipped_rigs()) if len(path.parts) == 1 else "no such file"
        raise InputError(f"{escaped(said, 500)}: {problem}") from None
    except OSError as error:
        raise InputError(f"{escaped(said, 500)}: cannot be read: {error.strerror}") from None


@lru_cache(maxsize=32)  # a sweep's points all ask for the same
def _parsed(source: bytes, name: str, file: str, is_file: bool) -> Rig:
    said = escaped(file, 500)
    table = parse_toml(source, said)
    try:
        try:
            about = RigFile.model_validate(table, context=IN_FILE)
        except ValidationError as failure:
            raise _fault(failure) from None
        parameters, follows = _built(about)
    except FaultError as fault:
        raise InputError(f"{said}: {escaped(str(fault), LONGEST_LINE)}") from None
    return Rig(name, about.title, about.description, parameters, tuple(follows), source, file, is_file)


def _built(about: RigFile) -> tuple[Parameters, list[Derived]]:
    """Parameters of the rig, and what of them was derived."""
    stated = dict(flat(about.parameters))
    for key in stated:
        if key.startswith("nameplate."):
            raise FaultError(f"parameters.{key}", "give it in the table nameplate of the rig file")
    follows = [entry for entry in derived(about.data_sheet, stated) if entry.key not in stated]
    if not (follows or stated or about.nameplate):
        return Parameters(), []
    low = {key: 0.1 for key in BANDWIDTHS if key not in stated}  # until the rules give them: fits any cycle
    try:
        parameters = override(Parameters(), low | {entry.key: entry.value for entry in follows} | stated)
    except FaultError as fault:
        raise FaultError(_origin(fault.key, stated, follows), fault.problem) from None
    parameters = parameters.with_nameplate()
    if about.nameplate:
        parameters = override(parameters, {"nameplate": about.nameplate})
    for rule in (_coupling, current_bandwidth, in_proportion, bandwidths, _substeps):
        found = [entry for entry in rule(parameters) if entry.key not in stated]
        parameters = parameters_with("parameters", parameters, {entry.key: entry.value for entry in found})
        follows += found
    return parameters, follows


def _coupling(p: Parameters) -> list[Derived]:
    """What turns with the gearbox's output where there is no crank."""
    if p.linkage.kind != "none":
        return []
    how = "assumed: coupling and half of the torque cell are as heavy as the thesis's crank"
    return [Derived("linkage.crank_inertia", p.linkage.crank_inertia, how)]


def _substeps(p: Parameters) -> list[Derived]:
    """More steps of the plant in a tick where its fastest motion asks for them."""
    if (found := unstable_parameter(p)) is None:
        return []
    enough = enough_substeps(p)
    if enough is None:
        raise FaultError(f"parameters.{found[0]}", found[1])
    step = p.rates.current_cycle * 1e6 / p.simulation.substeps
    return [Derived("simulation.substeps", enough, f"a plant step of {step:g} µs would be unstable")]


def _origin(key: str, stated: Mapping[str, Any], follows: list[Derived]) -> str:
    """Key of the file at which a fault of ``key`` came about."""
    given = any(name == key or name.startswith(f"{key}.") for name in stated)
    if not given and any(entry.key == key or entry.key.startswith(f"{key}.") for entry in follows):
        section = key.split(".", maxsplit=1)[0]
        sheets = {"rates": "drive and data_sheet.bus", "plc": "bus"}.get(section, section)
        return f"data_sheet.{sheets} (from which {key} {'follows' if '.' in key else 'follow'})"
    return f"parameters.{key}".rstrip(".")


_SHEETS: Mapping[str, type[Strict]] = {
    "motor": data_sheet.MotorSheet, "gearbox": data_sheet.GearboxSheet, "encoder": data_sheet.EncoderSheet,
    "drive": data_sheet.DriveSheet, "bus": data_sheet.BusSheet, "load_cell": data_sheet.LoadCellSheet,
    "amplifier": data_sheet.AmplifierSheet,
}  # fmt: skip


def _fault(failure: ValidationError) -> FaultError:
    error = worst(failure)
    loc = error["loc"]
    model: type[BaseModel] = RigFile
    names = [part for part in loc if isinstance(part, str)]
    owner = names[0] if names else ""
    if len(names) > 1 and names[0] == "data_sheet":
        model, owner = DataSheet, names[1]
        if names[1] in _SHEETS and len(loc) > 2:
            model, owner = _SHEETS[names[1]], names[2] if len(names) > 2 else ""
    return FaultError(place_of(loc), problem_of({**error, "loc": (owner,)}, model))
