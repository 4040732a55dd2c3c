"""A controller of the user's own: where it stands, how it is made, and what a recording says of it.

``FILE.py:NAME`` or ``package.module:NAME``, with arguments. NAME is called with the arguments and gives the object with
``step(inputs)``, a fresh one for every run. If NAME takes an argument called ``parameters`` that was not given, it gets
what a controller may know of the parameters at the start of the run (ControlParameters).

Modules beside the file are found, and come first, but for the user's modules alone: a file called ``control.py`` or
``json.py`` hides nothing from anyone else, and is not hidden by what is installed. So the file's folder is made a
package of its own, and its modules' ``import`` looks there first.
"""

import builtins
import hashlib
import importlib
import importlib.util
import inspect
import itertools
import json
import re
import sys
import threading
import time
import tomllib
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any, ClassVar

from cls_bench.errors import BenchError, ControllerError, InputError, one_line
from cls_bench.interrupts import is_ctrl_c

_PACKAGE = "cls_bench_user_"
_numbers = itertools.count(1)


@dataclass(frozen=True)
class Place:
    """Where a controller is to be found, and with what it is made. Can be pickled."""

    place: str
    """``FILE.py:NAME`` or ``package.module:NAME``"""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    folder: Path = field(default_factory=Path)
    """where a relative file is looked for"""
    key: str = "--controller"
    """how the user gave it, for messages"""

    @property
    def module(self) -> str:
        """File or module."""
        return self.place.rpartition(":")[0]

    @property
    def name(self) -> str:
        """NAME."""
        return self.place.rpartition(":")[2]

    @property
    def file(self) -> Path | None:
        """The file, if a file was named; whether it is there is not asked."""
        named = self.module
        return self.folder / named if named.endswith(".py") or "/" in named else None

    def check(self) -> None:
        """InputError unless it reads like a place and a named file is there; runs nothing."""
        said = f"{self.key} {one_line(self.place)}"
        if not self.module or not self.name.isidentifier():
            raise InputError(f"{said}: give FILE.py:NAME or package.module:NAME")
        if self.file is not None and not self.file.is_file():
            raise InputError(f"{said}: no such file: {one_line(str(self.file))}; give FILE.py:NAME")
        if self.file is None and not re.fullmatch(r"[^\W\d]\w*(\.[^\W\d]\w*)*", self.module):
            raise InputError(f"{said}: no such file; give FILE.py:NAME or package.module:NAME")


def parse_arguments(entries: Sequence[str]) -> dict[str, Any]:
    """Arguments from ``KEY=VALUE`` with TOML values; a bare word is a text. InputError if one cannot be read."""
    found: dict[str, Any] = {}
    for entry in entries:
        key, equals, text = (part.strip() for part in entry.partition("="))
        if not equals or not key.isidentifier() or not text:
            raise InputError(f"--controller-arg {one_line(entry)}: not of the form KEY=VALUE, such as stiffness=35.0")
        try:
            parsed = tomllib.loads(f"value = {text}")
        except (tomllib.TOMLDecodeError, RecursionError, ValueError):
            parsed = {"value": text} if re.fullmatch(r"[\w./-]+", text) else {}
        if list(parsed) != ["value"]:
            raise InputError(f'--controller-arg {one_line(entry)}: not a TOML value, such as 0.25, true or "text"')
        if key in found:
            raise InputError(f"--controller-arg {one_line(entry)}: {key} was given before")
        found[key] = parsed["value"]
    return found


MOST_FILES = 1000
"""Files that :func:`fingerprint` looks at."""


def fingerprint(place: Place) -> str:
    """Hash of all that a controller may be made of: its arguments, its file and the modules beside it; runs nothing."""
    digest = hashlib.sha256(repr((place.place, sorted(place.arguments.items()))).encode())
    folder = place.file.parent if place.file is not None else None
    if folder is None:
        top = place.module.partition(".")[0]
        here = place.folder.absolute()
        spec = None if _stands_in(here, top) else importlib.util.find_spec(top)
        folder = here if spec is None or spec.origin is None else Path(spec.origin).parent
    for path in sorted(itertools.islice((*folder.glob("*.py"), *folder.glob("*/*.py")), MOST_FILES)):
        digest.update(path.name.encode(errors="surrogateescape"))
        with suppress(OSError):
            digest.update(path.read_bytes())
    return digest.hexdigest()


class Controller:
    """A controller that was found and imported; :meth:`make` gives an object for a run.

    A file is imported anew for each, so what its modules keep is shared by the objects of one Controller alone. Once
    neither it nor an object that it made is left, they are forgotten. Raises InputError if there is no such file,
    module or name, and ControllerError if the import fails.
    """

    def __init__(self, place: Place):
        place.check()
        self.place = place
        self._loaded: dict[Path, bytes] = {}
        self._modules: weakref.finalize[Any, Any] | None = None
        module = self._import()
        made = vars(module).get(place.name)
        if made is None:
            here = [k for k, v in vars(module).items() if isinstance(v, type) and v.__module__ == module.__name__]
            raise InputError(f"{self._said}: defines no {place.name}; it has {', '.join(here) or 'no class'}")
        if not callable(made):
            raise InputError(f"{self._said}: is not callable; it must make an object with step(inputs)")
        self._make = made

    @property
    def _said(self) -> str:
        return f"{self.place.key} {self.place.place}"

    def make(self, parameters: Any) -> Any:
        """A fresh object for a run that begins with ``parameters``. InputError without step, else ControllerError."""
        arguments = dict(self.place.arguments)
        if "parameters" not in arguments and _takes_parameters(self._make):
            arguments["parameters"] = parameters
        with user_code(f"{self.place.name}({', '.join(arguments)})"):
            loop = self._make(**arguments)
        if not callable(getattr(type(loop), "step", None) or getattr(loop, "step", None)):
            raise InputError(f"{self._said}: what {self.place.name}() gives has no method step(inputs)")
        self._live_as_long_as(loop)
        return loop

    def _live_as_long_as(self, loop: Any) -> None:
        """It may import, pickle or look up its modules at any time."""
        try:
            weakref.finalize(loop, _forget, self).atexit = False
        except TypeError:  # an object of which nobody can say when it goes: its modules stay
            if self._modules is not None:
                self._modules.detach()

    @property
    def metadata(self) -> dict[str, str]:
        """What a recording says of it."""
        about = {"controller.name": self.place.name, "controller.source": self.place.module}
        about["controller.arguments"] = json.dumps(dict(self.place.arguments), default=str, sort_keys=True)
        files = list(self._loaded.items())
        if files:
            about["controller.sha256"] = hashlib.sha256(files[0][1]).hexdigest()
            beside = {path.name: hashlib.sha256(content).hexdigest() for path, content in files[1:]}
            about["controller.modules"] = json.dumps(beside, sort_keys=True)
        return about

    @property
    def text(self) -> bytes:
        """Its source as it was run; empty if there is none."""
        return next(iter(self._loaded.values()), b"")

    def _import(self) -> ModuleType:
        place = self.place
        file = place.file.resolve() if place.file is not None else None
        if file is not None:
            name = re.sub(r"\W", "_", file.stem)
            return self._import_beside(file.parent, name, file)
        folder = place.folder.absolute()
        top = place.module.partition(".")[0]
        if _stands_in(folder, top):
            return self._import_beside(folder, place.module, None)
        if top not in sys.modules and importlib.util.find_spec(top) is None:
            raise InputError(f"{self._said}: there is no module {top}, neither here nor installed")
        with self._user_import():
            module = importlib.import_module(place.module)
        path = Path(getattr(module, "__file__", None) or "")
        if path.suffix == ".py" and path.is_file():
            self._loaded[path] = path.read_bytes()
        return module

    def _import_beside(self, folder: Path, name: str, file: Path | None) -> ModuleType:
        package = ModuleType(f"{_PACKAGE}{next(_numbers)}")
        package.__path__ = [str(folder)]
        sys.modules[package.__name__] = package
        full = f"{package.__name__}.{name}"
        _Beside(package.__name__, folder, self._loaded, {full: file} if file is not None else {})
        self._modules = weakref.finalize(self, _Beside.drop, package.__name__)
        self._modules.atexit = False
        with self._user_import():
            return importlib.import_module(full)

    @contextmanager
    def _user_import(self) -> Iterator[None]:
        try:
            with user_code(f"import of {self.place.module}"):
                yield
        except ControllerError as error:
            cause = error.__cause__
            missing = cause.name if isinstance(cause, ModuleNotFoundError) else None
            # The module that was asked for is not there: bad input; one that it asks for: its own failure.
            if (missing and missing.endswith(f".{self.place.module}")) or missing == self.place.module:
                raise InputError(f"{self._said}: there is no module {self.place.module}") from None
            raise


def _takes_parameters(made: Any) -> bool:
    try:
        taken = inspect.signature(made).parameters
    except (ValueError, TypeError):
        return False
    return "parameters" in taken and taken["parameters"].kind not in (
        inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.POSITIONAL_ONLY,
    )  # fmt: skip


inside: dict[int, tuple[str, float]] = {}
"""By thread, which part of a user's code runs that is no step, and since when; for whoever watches it."""


@contextmanager
def user_code(what: str) -> Iterator[None]:
    """Whatever the user's code raises inside becomes a ControllerError of one line; only Ctrl-C passes."""
    thread = threading.get_ident()
    inside[thread] = what, time.monotonic()
    try:
        yield
    except BaseException as error:
        raise failure_of(f"{what} failed", error) from error
    finally:
        inside.pop(thread, None)


on_failure: list[Callable[[], None]] = []
"""Called when a user's code has failed, before that is told."""


class TookTooLongError(BaseException):
    """Raised in the midst of a user's code that does not come back."""


def failure_of(what: str, error: BaseException) -> BaseException:
    """The ControllerError of what a user's code raised; ``error`` itself if it is a real Ctrl-C."""
    if is_ctrl_c(error):
        return error
    for act in on_failure:
        act()
    said = one_line(error)
    if isinstance(error, TookTooLongError):
        said = str(error)
    elif isinstance(error, BenchError):  # raised by the user's own hand
        said = f"{type(error).__name__}: {said}"
    return ControllerError(f"{what}: {said}")


# --- modules beside the file -----------------------------------------------------------------------------------------


def _stands_in(folder: Path, name: str) -> bool:
    return (folder / f"{name}.py").is_file() or (folder / name / "__init__.py").is_file()


def _forget(controller: Controller) -> None:
    """Nothing is left to do: being called with it kept it alive."""


class _Beside:
    """Finds the modules of one user's folder, under the package made for it.

    The class itself is the one finder of the import system, for the folders of all.
    """

    _alive: ClassVar[dict[str, "_Beside"]] = {}
    _installing: ClassVar[threading.Lock] = threading.Lock()

    def __init__(self, package: str, folder: Path, loaded: dict[Path, bytes], files: Mapping[str, Path]):
        self._package, self._folder, self._loaded, self._files = package, folder, loaded, files
        self._builtins = {**vars(builtins), "__import__": self._import}
        self._alive[package] = self
        with self._installing:
            if _Beside not in sys.meta_path:
                sys.meta_path.insert(0, _Beside)

    @classmethod
    def drop(cls, package: str) -> None:
        """Forget a folder's package and its modules."""
        cls._alive.pop(package, None)
        for name in list(sys.modules):
            if name.partition(".")[0] == package:
                sys.modules.pop(name, None)

    @classmethod
    def find_spec(cls, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """As the import system asks."""
        beside = cls._alive.get(name.partition(".")[0])
        return None if beside is None else beside._find(name, path)

    def _find(self, name: str, path: Any) -> ModuleSpec | None:
        if name in self._files:
            file = str(self._files[name])
            return importlib.util.spec_from_file_location(name, file, loader=self._loader(name, file))
        spec = PathFinder.find_spec(name, path)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = self._loader(name, spec.loader.path)
        return spec

    def _comes_first(self, name: str, importer: Mapping[str, Any]) -> bool:
        """Whether what lies beside is meant by ``name``, and not what is installed."""
        own = importer.get("__name__") == f"{self._package}.{name}" and "__path__" not in importer
        if own or name == "cls_bench":  # no file means itself
            return False
        if f"{self._package}.{name}" in self._files:  # the controller's own: only if there is nothing else it could be
            return name not in sys.modules and importlib.util.find_spec(name) is None
        return _stands_in(self._folder, name)

    def _loader(self, name: str, file: str) -> "_Loader":
        return _Loader(name, file, self._builtins, self._loaded)

    def _import(self, name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:
        top = name.partition(".")[0]
        if level == 0 and self._comes_first(top, globals or {}):
            inside = builtins.__import__(f"{self._package}.{name}", globals, locals, fromlist or (), 0)
            return inside if fromlist else sys.modules[f"{self._package}.{top}"]
        return builtins.__import__(name, globals, locals, fromlist or (), level)


class _Loader(SourceFileLoader):
    """Runs a user's module from its source, never from byte code, and keeps what was run."""

    def __init__(self, name: str, path: str, names: Mapping[str, Any], loaded: dict[Path, bytes]):
        super().__init__(name, path)
        self._names, self._loaded = names, loaded

    def get_code(self, fullname: str) -> CodeType:
        content = self.get_data(self.path)
        self._loaded[Path(self.path)] = content
        code: CodeType = self.source_to_code(content, self.path)
        return code

    def exec_module(self, module: ModuleType) -> None:
        module.__dict__["__builtins__"] = self._names
        super().exec_module(module)
