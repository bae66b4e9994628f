"""Demonstration: the shipped recording of a climb, and the offer to run it live. ``-> Session``, ``compilation -> status``."""

import subprocess
import sys
import threading
import time

from treadline.core.processes import killed_with_starter
from treadline.scenario.shipped_files import DATA
from treadline.view._session import Session
from treadline.view.opening import open_live, open_recorded

SCENARIO = "up-28"
"""Scenario of the recording."""
RECORDING = DATA / "recordings" / SCENARIO
"""Run folder without images, which ``docs/tools/demo_recording.py`` makes of a run of ``treadline climb``."""
FIRST_PHASE = "mount"
"""Phase at whose beginning the demonstration starts: the chair begins to climb."""

FIRST_PICTURE_S = 5.0
"""Time from the first page to the start of compiling [s]: the browser draws its first picture with the whole processor."""


def open_demonstration() -> Session:
    """Return a session of the shipped recording, which begins anew at its end; the first page lets it play.

    Raises:
        LogFormatError: If the recording is damaged.
    """
    session = open_recorded(str(RECORDING))
    session.title = f"recorded run of the scenario {SCENARIO}"
    session.repeats = True
    session.cursor_s = next(span.start_s for span in session.run.phases if span.name == FIRST_PHASE)
    return session


class LiveOffer:
    """Offer to run the scenario live, as soon as ``treadline compile`` has ended in a process of its own."""

    def __init__(self) -> None:
        self._timer = threading.Timer(FIRST_PICTURE_S, self._compile)
        self._timer.daemon = True
        self._process: subprocess.Popen[bytes] | None = None
        self._began_s = 0.0
        self._ended: str | None = None

    def begin(self) -> None:
        """Begin to compile, after the first picture of the first page."""
        self._timer.start()

    def _compile(self) -> None:
        """Compile, and wait for the end: the process ends with the thread that started it."""
        self._began_s = time.monotonic()
        command = [sys.executable, "-m", "treadline", "compile"]
        nothing, with_this = subprocess.DEVNULL, killed_with_starter()
        self._process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing, preexec_fn=with_this)  # noqa: S603, PLW1509 - prctl alone
        self._process.wait()
        self._ended = f"{time.monotonic() - self._began_s:.0f} s"

    @property
    def is_ready(self) -> bool:
        """Whether the kernels are compiled, or compiling has failed, so that the run itself would say why."""
        return self._ended is not None

    @property
    def status(self) -> str:
        """State of the compilation in a sentence."""
        if self.is_ready:
            return f"The simulator is ready (compiled in {self._ended})."
        said = f": {time.monotonic() - self._began_s:.0f} s so far" if self._process is not None else ""
        return f"The recording plays; meanwhile the simulator is compiled for this machine, once, which takes about a minute{said}."

    def open(self) -> Session:
        """Return the live session, whose simulation starts at once."""
        return open_live(SCENARIO, seed=0)

    def close(self) -> None:
        """End the process."""
        self._timer.cancel()
        if self._process is not None:
            self._process.terminate()
