"""Opening of a target: a scenario that is run live, a recorded run, or the demonstration. ``name or path -> Session``.

The demonstration is the shipped recording of a climb, with the offer to run it live: ``compilation -> status``.
"""

import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from treadline.core.errors import LogFormatError
from treadline.core.files import DATA, json_of
from treadline.core.models import BAG_SUFFIXES, ControllerDesign
from treadline.core.processes import killed_with_starter
from treadline.io.mcap_read import has_arrivals, run_metadata
from treadline.io.runs import LOG, RUN_CONTROLLER, read_walk
from treadline.playback import manifest_of, read_recording, run_folder_of
from treadline.scenario.scenario import Scenario, read_scenario
from treadline.view._feed import Feed
from treadline.view._messages import ImageOrder, Order
from treadline.view._process import Worker
from treadline.view._session import Session

SCENARIO = "up-28"
"""Scenario of the recording."""
RECORDING = DATA / "recordings" / SCENARIO
"""Run folder without images, which ``docs/tools/demo_recording.py`` makes of a run of ``treadline climb``."""
FIRST_PHASE = "mount"
"""Phase at whose beginning the demonstration starts: the chair begins to climb."""

FIRST_PICTURE_S = 5.0
"""Time from the first page to the start of compiling [s]: the browser draws its first picture with the whole processor."""


def is_recorded(target: str) -> bool:
    """Return whether a target is a recorded run: a folder, or a file with the name of a log; every other file is a scenario."""
    path = Path(target)
    return path.is_dir() or path.suffix in BAG_SUFFIXES


def open_live(
    target: str,
    values: Mapping[str, object] | None = None,
    *,
    seed: int,
    controller: Any = None,
    detector: str | None = None,
    estimator: str | None = None,
    attended: bool = False,
) -> Session:
    """Return a session of a scenario, whose simulation starts at once.

    Args:
        values: Values in place of the scenario's, by dotted key.

    Raises:
        SettingsError: If the scenario does not exist, or it or a value is invalid.
    """
    scenario = read_scenario(target, values)
    order = Order(scenario=scenario, seed=seed, controller=controller, detector=detector, estimator=estimator, attended=attended)
    worker = Worker(order)
    feed = Feed.live(order, scenario.read_chair())
    feed.workers["run"] = worker
    return Session(feed=feed, title=f"{target}, seed {seed}", attended=attended)


def open_recorded(target: str) -> Session:
    """Return a session of a recorded run.

    Raises:
        LogFormatError: If the log is missing, damaged, empty, or without poses.
        SettingsError: If the run is of another version, or its ``check.csv`` is damaged.
    """
    path, recording = Path(target), read_recording(target)
    if not recording.has_poses:
        raise LogFormatError(
            f"{target}: no poses of the chair in this log, so there is no scene to show ({recording.missing[0].rstrip('.')}); "
            "treadline climb writes logs with poses, and treadline report draws the signals of any run folder"
        )
    scenario = recording.scenario or Scenario()
    feed = Feed.recorded(recording, Order(scenario=scenario, seed=recording.seed, controller=_controller_of(path)))
    kept = run_folder_of(path)
    walked = None if kept is None or recording.scenario is None else read_walk(kept)
    if walked is not None:
        from treadline.vehicle.ground_profile import ground_profile  # loads numba

        feed.way = ground_profile(feed.staircase), walked
    log = path / LOG if (path / LOG).is_file() else path
    latency_s = recording.chair.mount_of(rear=scenario.drive.direction == "down").device.latency_s
    if len(recording.frames_t_s) or not has_arrivals(log):
        feed.workers["images"] = Worker(
            ImageOrder(
                log=str(log),
                camera=feed.camera,
                vision="paper" if scenario.control.vision == "paper" else "robust",
                swept_half_m=recording.chair.swept_half_m,
                latency_s=scenario.realism.camera_latency_s if latency_s is None else latency_s,
            )
        )
    # Plug-ins are never loaded on behalf of a log.
    can_repeat = recording.scenario is not None and not (manifest_of(path) or {}).get("plugins")
    return Session(feed=feed, title=str(target), playing=False, following=False, can_repeat=can_repeat)


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


def _controller_of(target: Path) -> ControllerDesign | None:
    """Return the controller that a run folder or the metadata of a log keeps."""
    folder = run_folder_of(target)
    if folder is not None:
        found = folder / RUN_CONTROLLER
        return ControllerDesign.load(found) if found.is_file() else None
    kept = run_metadata(target).get("controller") if target.is_file() and has_arrivals(target) else None
    return None if kept is None else ControllerDesign.of_tables(json_of(kept, str(target)), target)
