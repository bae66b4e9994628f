"""Install with pip and report every five seconds how far it is: ``install.py [OPTION OF PIP INSTALL]...``.

pip itself is silent for minutes on a slow line. Bytecode is written when a module is first imported: most modules never are.
"""

import contextlib
import subprocess
import sys
import sysconfig
import threading
import time
from pathlib import Path

EVERY_S = 5.0
"""Seconds between two lines."""
INSTALLING = "Installing collected packages: "


class Installation:
    """pip's progress, from the lines that it writes and from the packages in the environment."""

    def __init__(self) -> None:
        self._started_s = time.monotonic()
        self._folder = Path(sysconfig.get_path("purelib"))
        self._before = self._installed()
        self._found, self._total = 0, 0
        self._now = "starting pip"

    def read(self, line: str) -> None:
        """Take a line of pip's."""
        words = line.split()
        if line.startswith(INSTALLING):
            self._total = line.count(",") + 1
        elif words[:1] == ["Collecting"]:
            self._found += 1
            self._now = f"{self._found} packages found, now {words[1]}"
        elif words[:1] == ["Downloading"]:
            self._now = f"{self._found} packages found, now downloading {' '.join(words[1:]).rpartition('/')[2]}"

    def report(self) -> None:
        """Print what pip does and for how long it has run."""
        installed = f"{min(len(self._installed() - self._before), self._total)} of {self._total} packages installed"
        self.say(installed if self._total else self._now)

    def say(self, text: str) -> None:
        """Print a line with the time since the start."""
        print(f"[{time.monotonic() - self._started_s:6.1f} s] {text}", flush=True)

    def _installed(self) -> set[str]:
        return {path.name for path in self._folder.glob("*.dist-info")}


def main() -> int:
    """Run pip; return its exit code."""
    installation, ended = Installation(), threading.Event()
    options = ["install", "--no-compile", "--disable-pip-version-check", "--progress-bar", "off", *sys.argv[1:]]

    def report() -> None:
        while not ended.wait(EVERY_S):
            installation.report()

    threading.Thread(target=report, daemon=True).start()
    command = [sys.executable, "-u", "-m", "pip", *options]
    with contextlib.suppress(KeyboardInterrupt), subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as pip:  # noqa: S603
        for line in pip.stdout or ():
            installation.read(line)
    ended.set()
    failed = "pip failed; if a version is not to be had, make setup LOCK=/dev/null takes another"
    installation.say(failed if pip.returncode else "installed")
    return pip.returncode


if __name__ == "__main__":
    sys.exit(main())
