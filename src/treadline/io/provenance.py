"""Provenance of a result: software versions, git commit and the command line that reproduces it."""

import platform
import shlex
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

PACKAGES = ("treadline", "numpy", "scipy", "numba", "mujoco", "opencv-python-headless", "matplotlib", "mcap")
"""Packages whose versions are recorded."""

GIT_S = 10.0
"""Timeout of the git command [s]; comparing a source tree on a slow disk takes seconds."""


def provenance() -> dict[str, Any]:
    """Return versions, git commit (``-dirty`` if tracked files are modified; None without git) and command line."""
    return {"versions": versions(), "git_commit": git_commit(), "command": command()}


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that affect results."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def git_commit() -> str | None:
    """Return the commit of the source tree, ``-dirty`` if tracked files are modified; None outside a git repository."""
    git = shutil.which("git")
    if git is None:
        return None
    try:
        # S603: git is found on the path and all arguments are constants. ``--exclude=*`` ignores tags, so the full hash is given.
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
    """Return the command line in shell syntax.

    The command reproduces the run in the same working folder: relative paths are kept. Absolute paths are reduced to their last
    component, because run files must not contain folder names of this machine; to reproduce, put these files into the working
    folder.
    """
    return shlex.join(["treadline", *(_without_folders(word) for word in sys.argv[1:])])


def _without_folders(word: str) -> str:
    option, sign, value = word.partition("=")
    if word.startswith("--") and sign:
        return option + sign + _without_folders(value)
    return Path(word).name if Path(word).is_absolute() else word
