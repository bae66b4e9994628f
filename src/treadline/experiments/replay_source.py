"""Source of a replay: the log, and the manifest of the run that wrote it."""

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from treadline.core.errors import LogFormatError, SettingsError
from treadline.core.models import read_json
from treadline.core.settings import settings_of
from treadline.io.runs import FORMER_RUN_CONTROLLER, LOG, MANIFEST, RUN_CONTROLLER
from treadline.mission.mission_config import MissionConfig
from treadline.run.resolve import mission_config
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario

CHAIR = "wheelchair"
"""Chair of a log without a manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Log to replay, with the settings of the run that wrote it."""

    log: Path
    base: MissionConfig
    sealed: bool = False
    """Whether the log belongs to a run folder and has checksums throughout."""
    seed: int = 0
    scenario: dict[str, Any] | None = None
    changed: tuple[str, ...] = ()
    """Keys that were changed, if the recorded run was itself a replay."""
    controller: str | None = None
    """Controller file of the recorded run; None if unknown."""
    plugins: dict[str, str] = field(default_factory=dict)
    """Plug-ins of the recorded run by kind. They are listed, never loaded, because a log may come from an untrusted source."""


def source_of(log: Path) -> Source:
    """Return a log with the settings in the manifest of its run folder.

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
    run_controller = folder / RUN_CONTROLLER
    if not run_controller.is_file():
        run_controller = folder / FORMER_RUN_CONTROLLER
    if run_controller.is_file():  # the file that the key named may have changed since
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
        controller=str(run_controller)
        if run_controller.is_file()
        else None
        if "replay" in settings or "controller" in plugins
        else _controller(where, str(command)),
        plugins=plugins,
    )


def kind_of(reason: str) -> str:
    """Return a rejection reason without its numbers, so that equal reasons count as one; a number in brackets is an equation's."""
    return re.sub(r"(?<!\()[+-]?\d+(\.\d+)?", "#", reason)


def _controller(where: Path, command: str) -> str | None:
    """Return the controller file named by the command of a run whose folder does not hold the controller."""
    words = _words(command)
    if words[1:2] == ["reproduce"]:
        made = where.resolve().parent.parent.parent / "controller.json"  # next to runs/, which holds the run folder
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
    except ValueError:  # not valid shell syntax, so not written by this package
        return command.split()
