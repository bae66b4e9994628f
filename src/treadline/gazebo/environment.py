"""Where Gazebo 11 lives: a Debian bullseye in a folder (``ros/gazebo/environment.sh``), or this very system in a container."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from treadline.errors import GazeboError

VARIABLE = "TREADLINE_GAZEBO"
"""Moves the folder; ``/`` says that Gazebo is installed here."""
PLUGIN = "opt/treadline/build/libtreadline_lockstep.so"
LIBRARIES = "usr/lib/x86_64-linux-gnu/gazebo-11/plugins"
BUILD = "build it with ros/gazebo/environment.sh (root, once), or take the Dockerfile"


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """A root folder with gzserver and the plugin in it."""

    root: Path

    @property
    def is_here(self) -> bool:
        """Whether Gazebo is installed on this system itself."""
        return self.root == Path("/")

    def inside(self, path: Path) -> str:
        """Return the name that a file has for a program in there."""
        return "/" + str(path.relative_to(self.root))

    def command(self, *words: str) -> list[str]:
        """Return what runs a program in there."""
        return list(words) if self.is_here else [shutil.which("chroot") or "chroot", str(self.root), *words]


def find_environment() -> Environment:
    """Return the environment that was built.

    Raises:
        GazeboError: If there is none, or it cannot be entered.
    """
    named = os.environ.get(VARIABLE)
    cache = Path(named) if named else Path.home() / ".cache" / "treadline" / "gazebo"
    root = cache if cache == Path("/") else cache / "root"
    if not (root / "usr/bin/gzserver").exists():
        raise GazeboError(f"no Gazebo 11 in {root}; {BUILD}")
    if not (root / PLUGIN).exists():
        raise GazeboError(f"{root / PLUGIN} is missing; {BUILD}")
    if root != Path("/"):
        if os.geteuid() != 0:
            raise GazeboError(f"only root may enter {root} (chroot); run as root, or take the Dockerfile")
        if shutil.which("chroot") is None:
            raise GazeboError("there is no chroot on this system; take the Dockerfile")
    return Environment(root=root)
