"""Aircraft files: those that come with the bench, and a user's own."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from cls_bench.aircraft.file import AxisFile, read_table
from cls_bench.aircraft.setting import Setting, chosen
from cls_bench.aircraft.units import Scale
from cls_bench.errors import InputError
from cls_bench.input.faults import FaultError, nearest, shown
from cls_bench.input.files import read_file
from cls_bench.input.tables import LONGEST_LINE
from cls_bench.input.toml_file import MOST_BYTES, parse_toml
from cls_bench.parameters import Parameters
from cls_bench.resources import shipped_aircraft
from cls_bench.text import escaped


@dataclass(frozen=True)
class Aircraft:
    """An aircraft, ready to be put on a rig."""

    name: str
    title: str
    description: str
    axes: Mapping[str, AxisFile]
    source: bytes = field(repr=False)
    """the text of its file"""
    file: str
    """name of the file as an attachment of a recording"""

    @property
    def is_file(self) -> bool:
        """Whether it is a user's own file, not one that comes with the bench."""
        return self.file != _attachment(self.name)

    @property
    def metadata(self) -> dict[str, str]:
        """What a recording says of it."""
        sha = hashlib.sha256(self.source).hexdigest()
        return {"aircraft": self.name, "aircraft.title": self.title, "aircraft.sha256": sha}

    def setting(
        self, axis: str | None = None, condition: str | None = None, *, force_scale: float | None = None,
        angle_scale: float | None = None,
    ) -> Setting:  # fmt: skip
        """One of its axes in a condition. Raises FaultError with ``axis`` or ``condition`` as the key."""
        try:
            name = chosen("axis", axis, list(self.axes))
        except InputError as error:
            raise FaultError("axis", str(error)) from None
        about = self.axes[name]
        differs = None
        if about.conditions or condition is not None:
            try:
                condition = chosen("condition", condition, list(about.conditions))
            except InputError as error:
                raise FaultError("condition", str(error)) from None
            differs = about.conditions[condition]
        force = about.force_scale if differs is None or differs.force_scale is None else differs.force_scale
        scale = Scale(
            force if force_scale is None else force_scale, about.angle_scale if angle_scale is None else angle_scale
        )
        return Setting(name, condition or "", about, differs, scale)

    @property
    def settings(self) -> Iterator[Setting]:
        """Every axis in every condition."""
        for name, axis in self.axes.items():
            for condition in axis.conditions or (None,):
                yield self.setting(name, condition)


def load_aircraft(name_or_path: str | Path) -> Aircraft:
    """The aircraft of that name, or of that file. Raises InputError with one line that says what is wrong."""
    return find_aircraft(str(name_or_path))


def find_aircraft(name: str, folder: Path = Path(), given: Mapping[str, bytes] | None = None) -> Aircraft:
    """The aircraft that a scenario in ``folder`` names: one that comes with the bench, or a file beside it.

    ``given`` are the contents of files by name; they are taken before those on the disk, and instead of files that are
    not shipped. Raises InputError.
    """
    shipped = shipped_aircraft().get(name)
    if shipped is not None:
        file = _attachment(name)
        source = given[file] if given is not None and file in given else _read(shipped, name)
        return _parsed(source, name, file)
    if given is not None and name not in given:
        raise InputError(f"{shown(name)} is not among the recording's attachments")
    source = _read(folder / name, name) if given is None else given[name]
    return _parsed(source, Path(name).stem, name)


def parse_aircraft(toml: str | bytes, *, name: str = "aircraft") -> Aircraft:
    """Make an aircraft of the text of its file. Raises InputError."""
    source = toml.encode(errors="surrogatepass") if isinstance(toml, str) else toml
    return _parsed(source, name, f"{name}.toml")


def _attachment(name: str) -> str:
    """Name of a shipped aircraft's file in a recording."""
    return f"{name}.aircraft.toml"


def _read(path: Path, said: str) -> bytes:
    try:
        return read_file(path, MOST_BYTES)
    except FileNotFoundError:
        plain = len(Path(said).parts) == 1
        problem = "no such aircraft or file; " + nearest(said, shipped_aircraft()) if plain else "no such file"
        raise InputError(f"{escaped(said, 500)}: {problem}") from None
    except OSError as error:
        raise InputError(f"{escaped(said, 500)}: cannot be read: {error.strerror}") from None


@lru_cache(maxsize=32)
def _parsed(source: bytes, name: str, file: str) -> Aircraft:
    said = escaped(file, 500)
    table = parse_toml(source, said)
    try:
        found = read_table(table)
        aircraft = Aircraft(name, found.title, found.description, found.axes, source, file)
        _check(aircraft)
    except FaultError as fault:
        raise InputError(f"{said}: {escaped(str(fault), LONGEST_LINE)}") from None
    return aircraft


def _check(aircraft: Aircraft) -> None:
    """Every setting is a feel model that there can be, on the thesis's rig. Raises FaultError."""
    rig = Parameters()
    for setting in aircraft.settings:
        try:
            setting.on(rig)
        except FaultError as fault:
            key = fault.key.removeprefix("feel.")
            differs = setting.differs is not None and key in setting.differs.feel
            place = f"{setting.axis}.conditions.{setting.condition}" if differs else setting.axis
            raise FaultError(f"{place}.feel.{key}".rstrip("."), fault.problem) from None
