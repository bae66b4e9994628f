"""A log to replay, and what its run folder's manifest says of the run that wrote it."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from treadline.errors import LogFormatError, SettingsError
from treadline.io.runs import LOG, MANIFEST, RUN_CONTROLLER
from treadline.mechanics.chair import read_chair
from treadline.mission.config import MissionConfig
from treadline.models import read_json
from treadline.scenario import Scenario
from treadline.settings import settings_of
from treadline.setup import mission_config

CHAIR = "wheelchair"
"""Of a log that comes without a run's manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A log, and what is known of the run that wrote it."""

    log: Path
    base: MissionConfig
    sealed: bool = False
    """Whether it is a run's own log, with checksums everywhere."""
    seed: int = 0
    scenario: dict[str, Any] | None = None
    changed: tuple[str, ...] = ()
    """Keys that the run had changed, where it was itself a replay."""
    controller: str | None = None
    """The file of the one that drove; None where nothing tells."""
    plugins: dict[str, str] = field(default_factory=dict)
    """Plug-ins of the recorded run by kind. They are named, never loaded: a log may come from elsewhere."""


def source_of(log: Path) -> Source:
    """Return a log with what its run folder's manifest says of it.

    Raises:
        SettingsError: If the manifest cannot be used.
        LogFormatError: If a run folder holds no log.
    """
    folder = log.parent if log.name == LOG and log.is_file() else log
    if not (folder / MANIFEST).is_file():
        return Source(log=log, base=MissionConfig(chair=read_chair(CHAIR)))
    if not (folder / LOG).is_file():
        raise LogFormatError(f"{folder}: no {LOG} in this run folder; only runs that kept their log can be replayed")
    where = folder / MANIFEST
    manifest = read_json(where)
    settings, seed, command = manifest.get("settings"), manifest.get("seed"), manifest.get("command")
    if not isinstance(settings, dict) or type(seed) is not int:
        raise SettingsError(f"{where}: no 'settings' and 'seed'; replay its {LOG} from a folder without {MANIFEST}")
    scenario: dict[str, Any] | None = settings
    changed: tuple[str, ...] = ()
    base = MissionConfig(chair=read_chair(CHAIR))
    if "replay" in settings:
        scenario, changed = settings.get("scenario"), tuple(str(item) for item in settings.get("set") or ())
    named = manifest.get("plugins")
    plugins = {str(kind): str(name) for kind, name in named.items()} if isinstance(named, dict) else {}
    flown = folder / RUN_CONTROLLER
    if flown.is_file():  # what a key named then, may be another one now
        changed = tuple(item for item in changed if item.partition("=")[0].strip() != "controller")
    if scenario is not None:
        base = mission_config(settings_of(scenario, Scenario, where=f"{where}: settings"), None)
    return Source(
        log=folder / LOG,
        base=base,
        sealed=True,
        seed=seed,
        scenario=scenario,
        changed=changed,
        controller=str(flown)
        if flown.is_file()
        else None
        if "replay" in settings or "controller" in plugins
        else _controller(where, str(command)),
        plugins=plugins,
    )


def _controller(where: Path, command: str) -> str | None:
    """Return the controller that drove a run whose folder does not hold it, as its command tells."""
    words = _words(command)
    if words[1:2] == ["reproduce"]:
        made = where.resolve().parent.parent.parent / "controller.json"  # beside runs/, in which the run's folder lies
        return str(made) if made.is_file() else None
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, sign, value = word.partition("=")
        if option == "--controller":
            name = value if sign else following
            places = [Path(name), where.parent / name, where.parent.parent / name]
            return str(next((place for place in places if place.is_file()), places[0]))
    return None


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command)
    except ValueError:  # not a shell's: somebody else wrote it
        return command.split()
