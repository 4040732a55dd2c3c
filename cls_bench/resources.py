"""Where the models, rigs, aircraft and scenarios that come with the package lie.

In a checkout they are the top-level folders ``models/`` and ``scenarios/``; a wheel carries them inside the package.
"""

from pathlib import Path

_PACKAGE = Path(__file__).parent


def _folder(name: str) -> Path:
    packed = _PACKAGE / "_data" / name
    return packed if packed.is_dir() else _PACKAGE.parent / name


def model_folder() -> Path:
    """Folder of the MJCF files."""
    return _folder("models")


def scenario_folder() -> Path:
    """Folder of the shipped scenario files."""
    return _folder("scenarios")


def shipped_scenarios() -> dict[str, Path]:
    """The shipped scenario files by name (the file's stem), in alphabetical order."""
    return {path.stem: path for path in sorted(scenario_folder().glob("*.toml"))}


def shipped_rigs() -> dict[str, Path]:
    """The rig files that come with the package by name (the file's stem), in alphabetical order."""
    return {path.stem: path for path in sorted((model_folder() / "rigs").glob("*.toml"))}


def shipped_aircraft() -> dict[str, Path]:
    """The aircraft files that come with the package by name (the file's stem), in alphabetical order."""
    return {path.stem: path for path in sorted((model_folder() / "aircraft").glob("*.toml"))}
