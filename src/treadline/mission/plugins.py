"""Plug-ins: a user's own controller, detector or estimator in place of the shipped block.

A plug-in is a class (or a function) that takes the ``MissionConfig`` and returns the block. Its source is ``module:Class``,
``path/to/file.py:Class`` or the name of an installed entry point. The attributes that the mission reads before it builds a block
belong to the class, so that they are known without an instance.
"""

import ast
import sys
from importlib import util
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from treadline.core.errors import SettingsError, did_you_mean
from treadline.core.files import own_module, text_of
from treadline.mission.mission_config import FILE_PREFIX

ATTRIBUTES = {"controller": ("follows_plan",), "detector": ("maps_stair",), "estimator": (), "policy": ()}
"""Attributes that each kind of plug-in must have, see the protocols; a policy is of ``treadline bench``."""


def checked_plugin(kind: str, plugin: Any, where: str) -> Any:
    """Return a plug-in that can be called and has the attributes of its kind.

    Args:
        kind: ``controller``, ``detector`` or ``estimator``.
        plugin: Class or function.
        where: Source, for the error message.

    Raises:
        SettingsError: If it cannot be called, or an attribute is missing or not a bool.
    """
    if not callable(plugin):
        raise SettingsError(
            f"{where}: a {type(plugin).__name__}, not a class; a {kind} plug-in is a class that takes "
            f"{'Spaces' if kind == 'policy' else 'MissionConfig'}"
        )
    for name in ATTRIBUTES[kind]:
        if not isinstance(getattr(plugin, name, None), bool):
            raise SettingsError(
                f"{where}: the {kind} plug-in has no attribute '{name}'; set {name} = True or {name} = False in the class "
                f"(treadline.mission.mission_config.{kind.capitalize()}Plugin says what it means)"
            )
    return plugin


def load_plugin(kind: str, source: str) -> Any:
    """Return the plug-in behind ``module:Class``, ``file.py:Class`` or the name of an entry point.

    Args:
        kind: ``controller``, ``detector`` or ``estimator``.
        source: What the user gave to the option of that name.

    Raises:
        SettingsError: If there is no such module, class or entry point, or the class is no plug-in of that kind.
    """
    where = f"--{kind} {source}"
    module_name, colon, attribute = source.rpartition(":")
    if not colon and source.endswith(".py"):
        raise SettingsError(f"{where}: names a file, not a class of it; {_classes_in(Path(source), kind, where)}")
    if not colon:
        return checked_plugin(kind, _entry_point(kind, source, where), where)
    module = _module_of(module_name, where)
    if not hasattr(module, attribute):
        public = [name for name in vars(module) if not name.startswith("_")]
        raise SettingsError(f"{where}: no '{attribute}' in '{module_name}'{did_you_mean(attribute, public)}")
    return checked_plugin(kind, getattr(module, attribute), where)


def _module_of(name: str, where: str) -> ModuleType:
    """Return a module by its name, sought in the working directory first, or a file that ends in ``.py``."""
    if name.endswith(".py"):
        return _module_in(Path(name), where)
    try:
        return own_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and (name == error.name or name.startswith(error.name + ".")):
            raise SettingsError(f"{where}: no module '{error.name}' here or among the installed packages") from None
        raise SettingsError(f"{where}: '{name}' cannot be imported: {error}") from error
    except (Exception, SystemExit) as error:
        raise SettingsError(f"{where}: '{name}' cannot be imported: {type(error).__name__}: {error}") from error


def _module_in(path: Path, where: str) -> ModuleType:
    _check_is_there(path, where)
    name = f"{FILE_PREFIX}{path.stem}"
    known = sys.modules.get(name)
    if known is not None and Path(str(known.__file__)) == path.resolve():
        return known
    spec = util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise SettingsError(f"{where}: '{path}' is no Python file")
    module = util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses of the file look their module up
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise SettingsError(f"{where}: '{path}' cannot be imported: {type(error).__name__}: {error}") from error
    return module


def _classes_in(path: Path, kind: str, where: str) -> str:
    """Return how to name a class of a file, which is parsed and not run: one with the attributes of its kind, if there is one."""
    _check_is_there(path, where)
    try:
        tree = ast.parse(text_of(path, "a Python file"))
    except SyntaxError as error:
        raise SettingsError(f"{where}: {path}:{error.lineno}: not Python: {error.msg}") from None
    classes = [item for item in tree.body if isinstance(item, ast.ClassDef)]
    fitting = [
        item for item in classes if {*ATTRIBUTES[kind]} <= {name.id for name in ast.walk(item) if isinstance(name, ast.Name)}
    ]
    names = [f"{path}:{item.name}" for item in fitting or classes]
    return f"give --{kind} {' or '.join(names)}" if names else f"it defines none: write the {kind} as a class"


def _check_is_there(path: Path, where: str) -> None:
    if not path.is_file():
        raise SettingsError(f"{where}: no file '{path}'; correct the path")


def _entry_point(kind: str, name: str, where: str) -> Any:
    found = {entry.name: entry for entry in entry_points(group=f"treadline.{kind}s")}
    if name not in found:
        listed = f"installed: {', '.join(sorted(found))}" if found else "none is installed"
        raise SettingsError(
            f"{where}: neither a file, nor module:Class, nor an entry point of the group treadline.{kind}s ({listed})"
            f"{did_you_mean(name, list(found))}"
        )
    try:
        return found[name].load()
    except Exception as error:
        raise SettingsError(f"{where}: the entry point cannot be loaded: {type(error).__name__}: {error}") from error
