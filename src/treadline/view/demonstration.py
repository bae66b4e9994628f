"""Demonstration: the shipped recording of a climb, and the offer to run it live. ``-> Session``, ``compilation -> status``."""

import threading
import time
from pathlib import Path

from treadline.scenario.scenario import Start, read_scenario
from treadline.view._feed import FASTEST
from treadline.view._messages import Order
from treadline.view._process import Worker
from treadline.view._session import Session
from treadline.view.opening import open_live, open_recorded

SCENARIO = "up-28"
"""Scenario of the recording."""
RECORDING = Path(__file__).parents[1] / "data" / "recordings" / SCENARIO
"""Run folder without images, which ``docs/tools/demo_recording.py`` makes of a run of ``treadline climb``."""
FIRST_PHASE = "mount"
"""Phase at whose beginning the demonstration starts: the chair begins to climb."""

FIRST_PICTURE_S = 5.0
"""Time from the first page to the start of compiling [s]: the browser draws its first picture with the whole processor."""
WARM_UP_S = 6.0
"""Duration of the run that compiles [s], as of the job of ``treadline compile``: the chair turns, climbs and tracks nosings."""


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
    """Offer to run the scenario live, as soon as a short run in a process of its own has compiled the kernels."""

    def __init__(self) -> None:
        self._timer = threading.Timer(FIRST_PICTURE_S, self._compile)
        self._timer.daemon = True
        self._worker: Worker | None = None
        self._began_s = 0.0
        self._ended: str | None = None

    def begin(self) -> None:
        """Begin to compile, after the first picture of the first page."""
        self._timer.start()

    def _compile(self) -> None:
        scenario = read_scenario(SCENARIO)
        update = {"start": Start(place="flight", step=4), "drive": scenario.drive.model_copy(update={"duration_s": WARM_UP_S})}
        self._began_s = time.monotonic()
        self._worker = Worker(Order(scenario=scenario.model_copy(update=update), seed=0, speed=FASTEST))

    @property
    def is_ready(self) -> bool:
        """Whether the kernels are compiled, or compiling has failed, so that the run itself would say why."""
        if self._worker is not None and self._ended is None:
            ends = [value for kind, value in self._worker.receive() if kind in ("end", "error")]
            if ends or not self._worker.is_alive:
                self._ended = f"{time.monotonic() - self._began_s:.0f} s"
        return self._ended is not None

    @property
    def status(self) -> str:
        """State of the compilation in a sentence."""
        if self.is_ready:
            return f"The simulator is ready (compiled in {self._ended})."
        said = f": {time.monotonic() - self._began_s:.0f} s so far" if self._worker is not None else ""
        return (
            f"The recording plays; meanwhile the simulator is compiled for this machine, once, which takes a minute or two{said}."
        )

    def open(self) -> Session:
        """Return the live session, whose simulation starts at once."""
        return open_live(SCENARIO, seed=0)

    def close(self) -> None:
        """End the process."""
        self._timer.cancel()
        if self._worker is not None:
            self._worker.close()
