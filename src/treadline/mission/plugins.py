"""Plug-ins: a user's own controller, detector or estimator in place of the shipped block.

A plug-in is a class (or a function) that takes the ``MissionConfig`` and returns the block. Its source is ``module:Class``,
``path/to/file.py:Class`` or the name of an installed entry point. The attributes that the mission reads before it builds a block
belong to the class, so that they are known without an instance.
"""

import importlib
import sys
from difflib import get_close_matches
from importlib import util
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from treadline.core.errors import SettingsError
from treadline.mission.mission_config import FILE_PREFIX

ATTRIBUTES = {"controller": ("follows_plan",), "detector": ("maps_stair",), "estimator": ()}
"""Attributes that each kind of plug-in must have, see the protocols."""


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
            f"{where}: a {type(plugin).__name__}, not a class; a {kind} plug-in is a class that takes MissionConfig"
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
    if not colon:
        return checked_plugin(kind, _entry_point(kind, source, where), where)
    module = _module_of(module_name, where)
    if not hasattr(module, attribute):
        public = [name for name in vars(module) if not name.startswith("_")]
        raise SettingsError(f"{where}: no '{attribute}' in '{module_name}'{_meant(attribute, public)}")
    return checked_plugin(kind, getattr(module, attribute), where)


def _module_of(name: str, where: str) -> ModuleType:
    """Return a module by its name, sought in the working directory first, or a file that ends in ``.py``."""
    if name.endswith(".py"):
        return _module_in(Path(name), where)
    here = str(Path.cwd())
    added = here not in sys.path
    if added:
        sys.path.insert(0, here)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and (name == error.name or name.startswith(error.name + ".")):
            raise SettingsError(f"{where}: no module '{error.name}' here or among the installed packages") from None
        raise SettingsError(f"{where}: '{name}' cannot be imported: {error}") from error
    except Exception as error:
        raise SettingsError(f"{where}: '{name}' cannot be imported: {type(error).__name__}: {error}") from error
    finally:
        if added:
            sys.path.remove(here)


def _module_in(path: Path, where: str) -> ModuleType:
    if not path.is_file():
        raise SettingsError(f"{where}: no file '{path}'; correct the path")
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
    except Exception as error:
        del sys.modules[name]
        raise SettingsError(f"{where}: '{path}' cannot be imported: {type(error).__name__}: {error}") from error
    return module


def _entry_point(kind: str, name: str, where: str) -> Any:
    found = {entry.name: entry for entry in entry_points(group=f"treadline.{kind}s")}
    if name not in found:
        listed = f"installed: {', '.join(sorted(found))}" if found else "none is installed"
        raise SettingsError(
            f"{where}: neither a file, nor module:Class, nor an entry point of the group treadline.{kind}s ({listed})"
            f"{_meant(name, list(found))}"
        )
    try:
        return found[name].load()
    except Exception as error:
        raise SettingsError(f"{where}: the entry point cannot be loaded: {type(error).__name__}: {error}") from error


def _meant(name: str, known: list[str]) -> str:
    close = get_close_matches(name, known, 1)
    return f"; did you mean '{close[0]}'?" if close else ""
