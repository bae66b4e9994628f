"""Location of Gazebo 11: a Debian bullseye root folder (``ros/gazebo/environment.sh``), or the system itself in a container."""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from treadline.core.errors import GazeboError

VARIABLE = "TREADLINE_GAZEBO"
"""Environment variable for another folder; ``/``: Gazebo is installed on this system."""
PLUGIN = "opt/treadline/build/libtreadline_lockstep.so"
"""Path of the lock-step plugin in the root folder."""
LIBRARIES = "usr/lib/x86_64-linux-gnu/gazebo-11/plugins"
"""Path of Gazebo's plugins in the root folder."""
BUILD = "build it with ros/gazebo/environment.sh (root, once), or take the Dockerfile"
"""Remedy in error messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """Root folder with gzserver and the plugin."""

    root: Path

    @property
    def is_here(self) -> bool:
        """Whether Gazebo is installed on this system itself."""
        return self.root == Path("/")

    def inside(self, path: Path) -> str:
        """Return the path of a file as seen by a program inside the root folder."""
        return "/" + str(path.relative_to(self.root))

    def command(self, *words: str) -> list[str]:
        """Return the command line that runs a program inside the root folder."""
        return list(words) if self.is_here else [shutil.which("chroot") or "chroot", str(self.root), *words]


def find_environment() -> Environment:
    """Return the installed environment.

    Raises:
        GazeboError: If Gazebo is not installed, or the root folder cannot be entered.
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
