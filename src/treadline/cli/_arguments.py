"""Arguments of commands: lists, choices and times, the option ``--force``, and the check of ``--out``."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from cyclopts import App, ArgumentCollection, Parameter

from treadline.core.errors import SettingsError

List = Annotated[str | None, Parameter(allow_leading_hyphen=True)]
"""A list that may begin with a minus: -35,35."""
PlantName = Literal["mujoco", "gazebo"]
Force = Annotated[bool, Parameter(help="Overwrite an existing result; without it an existing, non-empty --out is refused.")]
"""The option ``--force`` of a verb."""
Set = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        help="Value in place of the scenario's, as stair.slope_deg=30; may be repeated. treadline check --keys lists the keys.",
    ),
]
"""The option ``--set`` of a verb that reads a scenario."""


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class BlockOptions:
    """Options of a verb that runs the mission: blocks in place of the shipped ones.

    Attributes:
        controller: Controller file that treadline tune wrote, module:Class, file.py:Class, or entry point name; shipped names the
            shipped one. Default: the controller shipped for the vehicle; of a recorded run, the one that it had.
        detector: Stair detector plug-in, likewise. Default: the shipped detector.
        estimator: Heading estimator plug-in, likewise. Default: the shipped Kalman filter.
    """

    controller: str | None = None
    detector: str | None = None
    estimator: str | None = None


@Parameter(name="*")
@dataclass(frozen=True, slots=True, kw_only=True)
class PageOptions:
    """Options of a verb that serves a page.

    Attributes:
        host: Address to listen on. Any other than the default exposes the page to the network, in plain HTTP.
        port: Port to listen on; 0 takes any free one. Default: the first free one from 8350 on.
        no_browser: Print the address and open no browser.
        seconds: Time after which the page ends [s]. Default: until Ctrl-C.
    """

    host: str = "127.0.0.1"
    port: int | None = None
    no_browser: bool = False
    seconds: float | None = None


BLOCKS, PAGE = BlockOptions(), PageOptions()
"""The defaults of both."""
LEAST = {"--seed": 0, "--workers": 1}
"""Least values of whole numbers."""
_WHOLE = re.compile(r"[+-]?[0-9]+")


def set_values(changes: Iterable[str] | None) -> dict[str, object]:
    """Return the values of the option ``--set`` by key.

    Raises:
        SettingsError: If one is not KEY=VALUE.
    """
    if not changes:
        return {}
    from treadline.core.overrides import parse_items

    return parse_items(changes)


def check_whole_numbers(_app: App, _verb: tuple[str, ...], arguments: ArgumentCollection) -> None:
    """Refuse what stands where a whole number belongs and is none, before it is rounded, and one below its least value.

    Raises:
        SettingsError: If there is one.
    """
    for argument in arguments:
        if argument.hint is not int and int not in get_args(argument.hint):
            continue
        for token in argument.tokens:
            if _WHOLE.fullmatch(token.value) is None:
                raise SettingsError(f"{argument.name}: '{token.value}' is not a whole number; write for example {argument.name} 3")
            least = LEAST.get(argument.name)
            if least is not None and int(token.value) < least:
                raise SettingsError(f"{argument.name} is {token.value}; at least {least}")


def check_times(**options: float | None) -> None:
    """Refuse durations and paces that are not above zero.

    Raises:
        SettingsError: If one is not.
    """
    for name, value in options.items():
        if value is not None and not (math.isfinite(value) and value > 0.0):
            raise SettingsError(f"--{name} is {value:g}; it must be above 0")


def numbers(option: str, text: str | None) -> list[float] | None:
    """Return the numbers of a comma-separated list.

    Raises:
        SettingsError: If one is not a finite number.
    """
    if text is None:
        return None
    values = []
    for part in text.split(","):
        try:
            value = float(part)
        except ValueError:
            raise SettingsError(f"{option}: '{part}' is not a number; write for example {option} 1,1") from None
        if not math.isfinite(value):
            raise SettingsError(f"{option}: '{part}' is not finite")
        values.append(value)
    return values


def choice(option: str, word: str, allowed: Iterable[str]) -> Any:
    """Return a word that is among those allowed.

    Raises:
        SettingsError: If it is not.
    """
    allowed = tuple(allowed)
    if word not in allowed:
        raise SettingsError(f"{option} is '{word}'; allowed: {', '.join(allowed)}")
    return word


def words(option: str, text: str) -> tuple[str, ...]:
    """Return the words of a comma-separated list.

    Raises:
        SettingsError: If one is empty or stands twice.
    """
    parts = tuple(part.strip() for part in text.split(","))
    if not all(parts):
        raise SettingsError(f"{option}: '{text}' has an empty name; write for example {option} left_m_s,right_m_s")
    if len(set(parts)) < len(parts):
        raise SettingsError(f"{option}: '{text}' names a column twice")
    return parts


def make_way(out: Path, *, force: bool) -> None:
    """Remove a file that ``--force`` replaces, for bag formats whose writers only create new files."""
    if force and out.is_file():
        out.unlink()


def claim(
    out: Path,
    *,
    force: bool,
    kind: Literal["file", "folder", "either"] = "folder",
    resume: bool = False,
    option: str = "--out",
) -> None:
    """Check that a result may be written to a path; nothing is written or removed.

    Args:
        out: Value of the option.
        force: Whether the user allows an existing result to be overwritten.
        kind: What the verb writes there.
        resume: Whether the verb continues the result that is there.
        option: Option that names the path.

    Raises:
        SettingsError: If the path is of the other kind, or holds something and neither ``force`` nor ``resume`` is set.
    """
    if kind == "folder" and out.exists() and not out.is_dir():
        raise SettingsError(f"{option} {out}: is a file; give a folder")
    if kind == "file" and out.is_dir():
        raise SettingsError(f"{option} {out}: is a folder; give a file")
    if force or resume or not out.exists():
        return
    if out.is_dir() and any(out.iterdir()):
        raise SettingsError(
            f"{option} {out}: the folder exists and is not empty; give another, or --force to overwrite its results"
        )
    if out.is_file() and out.stat().st_size > 0:
        raise SettingsError(f"{option} {out}: the file exists; give another, or --force to overwrite it")
