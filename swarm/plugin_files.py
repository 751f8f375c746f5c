"""Plug-ins as a scenario names them: a class in a Python file, or an entry point of an installed package.

    navigator = "ukf.py:Ukf"       a file of the user: it is executed, and may import whatever is installed
    navigator = "my-ukf"           an entry point of the group lighthouse_swarm.navigators

A file is a module by itself: the folder that it is in is not searched for others, so that the copy in a run's folder is
all that the run was flown with.
"""

import hashlib
import inspect
import sys
import traceback
from collections.abc import Callable
from importlib.metadata import entry_points
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from swarm.errors import SwarmError, did_you_mean

PLUG_INS = {"navigator": "step", "controller": "steer"}
"""Keys of a craft's table that name a plug-in, and the method that each one needs."""


class PlugIn(NamedTuple):
    """A class of a user. kind: the class. file: the file that it is in. said: file and class, as messages name them."""

    kind: Callable[..., Any]
    file: Path
    said: str


def of_file(value: str) -> tuple[Path, str] | None:
    """Return file and class of a plug-in that a scenario names by its file, None for an entry point."""
    file, colon, name = value.rpartition(":")
    return (Path(file), name) if colon else None


def plug_in(key: str, value: str) -> PlugIn:
    """Return a plug-in's class. Its file is executed.

    Args:
        key: "navigator" or "controller".
        value: as the scenario names it.

    Raises:
        SwarmError: there is no such file, class or entry point, or the class has not the methods of a plug-in.
    """
    named = of_file(value)
    found = _installed(key, value) if named is None else _in_file(key, *named)
    _check(key, found)
    return found


def digest(file: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits. Raises SwarmError if it cannot be read."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise SwarmError(f"{file}: cannot be read: {error.strerror or error}") from None


def provenance(key: str, value: str) -> str:
    """Return what a plug-in was, for the head of a run's scenario: class, package and version, hash of the file."""
    named = of_file(value)
    if named is not None:
        return f"{key} {named[0].name}:{named[1]}, SHA-256 {digest(named[0])}"
    found = plug_in(key, value)
    (point,) = entry_points(group=_group(key), name=value)
    package = "" if point.dist is None else f" of {point.dist.name} {point.dist.version}"
    return f"{key} {value}{package}, SHA-256 {digest(found.file)}"


def line_of(error: BaseException, file: Path) -> str:
    """Return ", line 14" for the last line of the file that an exception went through, or an empty string."""
    if isinstance(error, SyntaxError) and error.filename == str(file):
        return f", line {error.lineno}"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f.filename == str(file)]
    return f", line {frames[-1].lineno}" if frames else ""


def told(error: BaseException) -> str:
    """Return an exception as one line."""
    text = error.msg if isinstance(error, SyntaxError) else str(error)
    return f"{type(error).__name__}: {text}".removesuffix(": ").replace("\n", " ")


def _group(key: str) -> str:
    return f"lighthouse_swarm.{key}s"


def _installed(key: str, value: str) -> PlugIn:
    points = entry_points(group=_group(key))
    if value not in points.names:
        near = did_you_mean(value, points.names)
        raise SwarmError(
            f"{key} = {value!r}: no installed package has an entry point of this name in {_group(key)}{near}; for a "
            f"class in a file write FILE.py:CLASS"
        )
    try:
        kind = points[value].load()
        file = Path(inspect.getfile(kind)).resolve()
    except (Exception, SystemExit) as error:
        raise SwarmError(f"{key} = {value!r}: the entry point {points[value].value}: {told(error)}") from error
    return PlugIn(kind, file, f"{key} {value!r}")


def _in_file(key: str, file: Path, name: str) -> PlugIn:
    module = _executed(key, file)
    own = {n: each for n, each in vars(module).items() if inspect.isclass(each) and each.__module__ == module.__name__}
    if name not in own:
        near = did_you_mean(name, own) or "; it has no class"
        raise SwarmError(f"{file}: {key} = {file.name}:{name}: there is no class {name!r} in it{near}")
    return PlugIn(own[name], file, str(file))


def _executed(key: str, file: Path) -> ModuleType:
    """Return the module of a file, which is executed once per content."""
    name = f"lighthouse_swarm_plug_in_{digest(file)[:16]}_{file.stem}"
    if name in sys.modules and getattr(sys.modules[name], "__file__", None) == str(file):
        return sys.modules[name]
    spec = spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise SwarmError(f"{file}: {key}: not a Python file: its name must end with .py")
    module = module_from_spec(spec)
    sys.modules[name] = module  # dataclasses of the file look for it there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        hint = ""
        if isinstance(error, ModuleNotFoundError) and error.name and (file.parent / f"{error.name}.py").is_file():
            hint = f" (a plug-in is one file: {error.name}.py beside it is not searched; install it as a package)"
        raise SwarmError(f"{file}{line_of(error, file)}: {key}: {told(error)}{hint}") from error
    return module


def _check(key: str, found: PlugIn) -> None:
    """Require a class that is called with one argument, and its method, with one more. Raises SwarmError."""
    if not inspect.isclass(found.kind):
        raise SwarmError(f"{found.said}: {key}: {found.kind!r} is not a class")
    method, name = PLUG_INS[key], found.kind.__name__
    step = getattr(found.kind, method, None)
    argument = "light" if key == "navigator" else "now"
    if not callable(step):
        near = [each for each in vars(found.kind) if callable(getattr(found.kind, each)) and not each.startswith("_")]
        hint = did_you_mean(method, near).replace("; known: ", "; it has ")
        raise SwarmError(f"{found.said}: {key}: class {name} has no method {method}(self, {argument}){hint}")
    for function, given, wanted in (
        (found.kind, (None,), "__init__(self, craft)"),
        (step, (None, None), f"{method}(self, {argument})"),
    ):
        try:
            inspect.signature(function).bind(*given)
        except TypeError as error:
            is_static = isinstance(inspect.getattr_static(found.kind, method), staticmethod | classmethod)
            hint = ", not static" if function is step and is_static else ""
            raise SwarmError(f"{found.said}: {key}: class {name} must have {wanted}{hint}: {error}") from None
        except ValueError:
            continue  # a class of C code tells no signature
