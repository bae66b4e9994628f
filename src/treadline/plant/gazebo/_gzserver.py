"""gzserver process and the plugin's socket: command in, state out, in lock-step.

Gazebo 11 is in a Debian bullseye root folder (``legacy/gazebo/environment.sh``), or in the system itself in a container.

Each run uses a new process: a second run in the same process would differ in the last bits.
"""

import os
import re
import select
import shutil
import socket
import struct
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.core.errors import GazeboError
from treadline.core.processes import killed_with_starter

VARIABLE = "TREADLINE_GAZEBO"
"""Environment variable for another folder; ``/``: Gazebo is installed on this system."""
PLUGIN = "opt/treadline/build/libtreadline_lockstep.so"
NO_TURN_RULE = "opt/treadline/build/libtreadline_lockstep_no_turn_rule.so"
"""Paths of the lock-step plugin in the root folder: with the turn rules of Gazebo's own plugin, and without."""
LIBRARIES = "usr/lib/x86_64-linux-gnu/gazebo-11/plugins"
"""Path of Gazebo's plugins in the root folder."""
BUILD = "build it with legacy/gazebo/environment.sh (root, once), or take the Dockerfile"
"""Remedy in error messages."""
PROTOCOL, MAJOR = 1, 11
ORDERS = 8
"""Number of doubles in a command, as in ``legacy/gazebo/lockstep.cc``."""
_MOTION = [("position", float, 3), ("orientation", float, 4), ("velocity", float, 3), ("rate", float, 3)]
_JOINTS = [(name, float) for name in ("seat", "flipper", "flipper_torque", "contacts")]
ANSWER = np.dtype([("t_s", float), *_MOTION, *_JOINTS, ("reach", float, 4)])
"""Answer to a command, likewise."""
Process = subprocess.Popen[bytes]
COLOURS = re.compile(r"\x1b\[[0-9;]*m")
START_S = 180.0
"""Timeout for a display, for loading a world, and of an answer [s], on a machine with other load."""
TRIES = 3
"""Number of attempts to start: another process can take a free port before gzserver does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Environment:
    """Root folder with gzserver and the plugin."""

    root: Path

    def inside(self, path: Path) -> str:
        """Return the path of a file as seen by a program inside the root folder."""
        return "/" + str(path.relative_to(self.root))

    def command(self, *words: str) -> list[str]:
        """Return the command line that runs a program inside the root folder."""
        return list(words) if self.root == Path("/") else [shutil.which("chroot") or "chroot", str(self.root), *words]


class GazeboServer:
    """Process of gzserver with one world, from start to end."""

    def __init__(self, environment: Environment, world: Callable[[int, str], str], files: Mapping[str, bytes]) -> None:
        """Load a world.

        Args:
            world: Function from the plugin's port and the run's folder, as gzserver sees it, to the world's SDF.
            files: Contents of the run's files by name; without any, Gazebo draws nothing and needs no display.

        Raises:
            GazeboError: If gzserver or the plugin does not start.
        """
        self._environment = environment
        base = environment.root / "tmp"
        base.mkdir(exist_ok=True)
        self._folder = Path(tempfile.mkdtemp(prefix="treadline-", dir=base))
        self._process: Process | None = None
        self._display: Process | None = None
        self._socket: socket.socket | None = None
        for attempt in range(TRIES):
            try:
                self._launch(world, free_port(), files)
            except GazeboError as error:
                self.close()
                if attempt == TRIES - 1 or "taken" not in str(error):
                    raise
            else:
                return

    def step(self, order: Float[np.ndarray, " 8"]) -> np.void:
        """Send a command, run its steps and return the state after them.

        Raises:
            GazeboError: If gzserver has exited or hangs.
        """
        assert self._socket is not None  # noqa: S101 - launched
        try:
            self._socket.sendall(order.tobytes())
            return np.frombuffer(self._received(ANSWER.itemsize), ANSWER)[0]
        except OSError as error:
            raise self._died(error) from None

    def close(self) -> dict[float, bytes]:
        """Stop gzserver, delete its files and return the film's images by time, without the last, which may be half written."""
        if self._socket is not None:
            self._socket.close()
        for process in (self._process, self._display):
            if process is not None:
                process.kill()
                process.wait()
        self._socket = self._process = self._display = None
        taken = sorted((float(file.stem), file) for file in self._folder.glob("*.jpg"))
        images = {t_s: file.read_bytes() for t_s, file in taken[:-1]}
        shutil.rmtree(self._folder, ignore_errors=True)
        return images

    def _launch(self, world: Callable[[int, str], str], port: int, files: Mapping[str, bytes]) -> None:
        self._folder.mkdir(exist_ok=True)
        for name, data in files.items():
            (self._folder / name).write_bytes(data)
        file = self._folder / "chair.world"
        file.write_text(world(port, self._environment.inside(self._folder)), encoding="utf-8")
        variables = {
            "HOME": self._environment.inside(self._folder),
            "PATH": "/usr/bin:/bin",
            "LD_LIBRARY_PATH": f"/{LIBRARIES}",
            "GAZEBO_PLUGIN_PATH": f"/{LIBRARIES}",
            "GAZEBO_RESOURCE_PATH": "/usr/share/gazebo-11",
            "GAZEBO_MODEL_PATH": "",
            "GAZEBO_MODEL_DATABASE_URI": "",
            "ALSOFT_DRIVERS": "null",  # no sound, and no files of a sound server
            "GAZEBO_IP": "127.0.0.1",
            "GAZEBO_MASTER_URI": f"http://127.0.0.1:{free_port()}",
        }
        if files:
            variables["DISPLAY"] = self._screen()
        words = ("/usr/bin/gzserver", "--lockstep", "-e", "ode", "--verbose", self._environment.inside(file))
        self._process = self._started(*words, variables=variables)
        self._connect(port)
        self._greet()

    def _screen(self) -> str:
        """Start a display in memory for Gazebo's camera, and return its name."""
        words = ("/usr/bin/Xvfb", "-displayfd", "1", "-screen", "0", "640x480x24", "-nolisten", "tcp")
        self._display = self._started(*words, stdout=subprocess.PIPE)
        assert self._display.stdout is not None  # noqa: S101 - a pipe
        with self._display.stdout as written:
            is_written, _, _ = select.select([written], [], [], START_S)
            number = written.readline().strip() if is_written else b""
        if not number:
            raise GazeboError(f"Xvfb does not start, which Gazebo's camera needs: {self._reason()}; {BUILD}")
        return f":{number.decode()}"

    def _started(self, *words: str, stdout: int | None = None, variables: Mapping[str, str] | None = None) -> Process:
        """Return a new process in the root folder, which ends with this one."""
        with self._log.open("wb") as log:
            return subprocess.Popen(  # noqa: S603 - our own words
                self._environment.command(*words),
                env={**os.environ, **(variables or {})},
                stdin=subprocess.DEVNULL,
                stdout=log if stdout is None else stdout,
                stderr=log,
                preexec_fn=killed_with_starter(),  # noqa: PLW1509 - it only calls prctl
            )

    @property
    def _log(self) -> Path:
        return self._folder / "gzserver.log"

    def _connect(self, port: int) -> None:
        assert self._process is not None  # noqa: S101 - just started
        until = time.monotonic() + START_S
        while time.monotonic() < until:
            if self._process.poll() is not None:
                raise GazeboError(f"gzserver ended before the chair was in it: {self._reason()}")
            reason = next((line for line in self._lines() if "Failed to load plugin" in line), None)
            if reason is not None:
                raise GazeboError(f"gzserver does not load the plugin: {reason}; {BUILD}")
            try:
                self._socket = socket.create_connection(("127.0.0.1", port), timeout=START_S)
            except OSError:
                time.sleep(0.05)
                continue
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return
        raise GazeboError(f"gzserver did not load the world within {START_S:.0f} s: {self._reason()}")

    def _greet(self) -> None:
        """Check protocol and version of the plugin before using its data."""
        try:
            protocol, major, orders, columns = struct.unpack("<4d", self._received(32))
        except OSError as error:
            raise self._died(error) from None
        if (protocol, major, orders, columns) != (PROTOCOL, MAJOR, ORDERS, ANSWER.itemsize // 8):
            what = f"the plugin speaks protocol {protocol:g} of Gazebo {major:g}, this program {PROTOCOL} of Gazebo {MAJOR}"
            raise GazeboError(f"{what}; {BUILD}")

    def _received(self, size: int) -> bytes:
        assert self._socket is not None  # noqa: S101 - connected
        data = bytearray()
        while len(data) < size:
            part = self._socket.recv(size - len(data))
            if not part:
                raise ConnectionResetError("the connection ended")
            data += part
        return bytes(data)

    def _died(self, error: OSError) -> GazeboError:
        code = None
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                code = self._process.wait(timeout=1.0)
        what = f"gzserver hangs ({error})" if code is None else f"gzserver died (exit code {code})"
        return GazeboError(f"{what}: {self._reason()}; run it again")

    def _reason(self) -> str:
        """Return the last error message in the log."""
        lines = self._lines()
        complaints = [line for line in lines if "[Err]" in line or "rror" in line or "taken" in line or "in use" in line]
        if any("in use" in line for line in complaints):
            return "a port is taken"
        return (complaints or lines or ["it said nothing"])[-1]

    def _lines(self) -> list[str]:
        text = self._log.read_text(encoding="utf-8", errors="replace")
        return [line.strip() for line in COLOURS.sub("", text).splitlines() if line.strip()]


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
    if missing := [path for path in (PLUGIN, NO_TURN_RULE) if not (root / path).exists()]:
        raise GazeboError(f"{root / missing[0]} is missing; {BUILD}")
    if root != Path("/"):
        if os.geteuid() != 0:
            raise GazeboError(f"only root may enter {root} (chroot); run as root, or take the Dockerfile")
        if shutil.which("chroot") is None:
            raise GazeboError("there is no chroot on this system; take the Dockerfile")
    return Environment(root=root)


def free_port() -> int:
    """Return an unused port of the loopback interface."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
