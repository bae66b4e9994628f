"""Where a result came from: versions, commit and the command that repeats it."""

import platform
import shlex
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("treadline", "numpy", "scipy", "numba", "mujoco", "opencv-python-headless", "matplotlib", "mcap")

GIT_S = 10.0
"""Longest wait for an answer: on a slow disk a tree takes a while to compare."""


def provenance() -> dict[str, Any]:
    """Return versions, the git commit if there is one (``-dirty`` where it is not quite what ran), and the command line."""
    return {"versions": versions(), "git_commit": git_commit(), "command": command()}


def versions() -> dict[str, str]:
    """Return the versions of Python and of what the results depend on."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def git_commit() -> str | None:
    """Return the commit of the source tree, with ``-dirty`` where tracked files differ from it; None outside a tree."""
    git = shutil.which("git")
    if git is None:
        return None
    try:
        # The program is git, found on the path; the arguments are constants: the whole hash, whatever tags there are.
        done = subprocess.run(  # noqa: S603
            [git, "--no-optional-locks", "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=False,
            timeout=GIT_S,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def command() -> str:
    """Return the command line as a user would type it, for a shell.

    It repeats the run in the same folder: relative paths stand whole. Absolute ones are cut to their last name, for no file of a
    run names this machine's folders; who repeats it puts those files where the command is typed.
    """
    return shlex.join(["treadline", *(_without_folders(word) for word in sys.argv[1:])])


def _without_folders(word: str) -> str:
    option, sign, value = word.partition("=")
    if word.startswith("--") and sign:
        return option + sign + _without_folders(value)
    return Path(word).name if Path(word).is_absolute() else word
