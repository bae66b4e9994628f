"""A real chair as a ``Plant`` on the wall clock: readings from the guard process and frames from a camera thread.

The guard process commands the drives by itself, so ``write`` has nothing to do.
"""

import time
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from statistics import median
from threading import Event as Flag
from threading import Thread
from typing import Any

from treadline.core.camera_images import NamedFrame, RgbdFrame
from treadline.core.errors import CameraError, TreadlineError
from treadline.core.ports import Reading
from treadline.core.signals import TICK_S, FlipperCommand, SeatCommand, TrackCommand
from treadline.hardware._guard_client import GuardClient

WAIT_S = 0.2 * TICK_S
"""Longest sleep before reports are read again [s]."""
FRAMES = 2
"""Frames that wait for the loop; older ones are dropped, because a frame that waits longer than a period has a successor."""
DELAYS = 10
"""Frames over which the smallest delay is taken: a second at 10 Hz, in which a quartz of 100 ppm drifts by 0.1 ms."""


class CameraThread:
    """Thread that reads a live camera; it stamps frames on the host's monotonic clock.

    The device's clock, which drifts, is mapped by the smallest delay between exposure and arrival within ``DELAYS`` frames. A
    constant delay of the device is unknown to the host.

    Args:
        frames: Frames of a live camera, stamped on the device's clock.
    """

    def __init__(self, frames: Iterable[NamedFrame]) -> None:
        self._frames = frames
        self._waiting: deque[RgbdFrame] = deque(maxlen=FRAMES)
        self._is_over = Flag()
        self.error: str | None = None
        """Why the camera stopped; None while it runs."""
        self.count = 0
        """Number of frames so far."""
        self._stamps_s = deque[float](maxlen=DELAYS + 1)
        self._offsets_s = deque[float](maxlen=DELAYS)
        self._thread = Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def take(self, start_s: float) -> list[RgbdFrame]:
        """Return the frames since the last call, on a clock that is zero at ``start_s`` of the monotonic one; none from before."""
        taken = [self._waiting.popleft() for _ in range(len(self._waiting))]
        return [replace(frame, t_s=frame.t_s - start_s) for frame in taken if frame.t_s >= start_s]

    @property
    def is_measured(self) -> bool:
        """Whether enough frames have come for ``period_s`` and ``lateness_s``."""
        return self.count > DELAYS

    @property
    def period_s(self) -> float:
        """Median of the last frames' periods [s]."""
        return median(after - before for before, after in pairwise(tuple(self._stamps_s)))

    @property
    def lateness_s(self) -> float:
        """Largest delay of the last frames above their smallest [s]."""
        offsets_s = tuple(self._offsets_s)
        return max(offsets_s) - min(offsets_s)

    def close(self) -> None:
        """End the thread after its next frame; a camera that is stuck is left behind."""
        self._is_over.set()
        self._thread.join(1.0)

    def _run(self) -> None:
        try:
            for named in self._frames:
                if named.frame is not None:
                    self._check_clock(named.frame.t_s)
                    self._stamps_s.append(named.frame.t_s)
                    self._offsets_s.append(time.monotonic() - named.frame.t_s)
                    self._waiting.append(replace(named.frame, t_s=named.frame.t_s + min(self._offsets_s)))
                    self.count += 1
                if self._is_over.is_set():
                    return
        except TreadlineError as error:
            self.error = str(error)
        except Exception as error:  # noqa: BLE001 - a driver of the user may raise anything
            self.error = f"the camera's driver failed: {type(error).__name__}: {error}"

    def _check_clock(self, t_s: float) -> None:
        """Raise where the device's clock went back: the offset of its stamps is unknown then."""
        if self._stamps_s and t_s < self._stamps_s[-1]:
            raise CameraError(f"its clock went back by {self._stamps_s[-1] - t_s:.2f} s; connect it anew and start again")


class RobotPlant:
    """Chair behind the guard process.

    Args:
        client: The guard process.
        start_s: Monotonic time at which the mission clock is zero [s].
        camera: Camera; None on the bench.
    """

    reports_ground = True
    """Whether frames show the ground."""

    def __init__(self, client: GuardClient, start_s: float, camera: CameraThread | None = None) -> None:
        self._client, self._start_s, self._camera = client, start_s, camera
        self._until_s = 0.0

    def start(self) -> None:
        """Do nothing: the chair stands where it stands."""

    def advance(self, until_s: float) -> None:
        """Wait until the mission clock reaches ``until_s``."""
        self._until_s = until_s
        while (left_s := self._start_s + until_s - time.monotonic()) > 0.0:
            time.sleep(min(left_s, WAIT_S))
        self._client.receive()

    def read(self) -> list[Reading]:
        """Return the readings up to now; a stopped camera holds the chair."""
        frames: list[Any] = []
        if self._camera is not None:
            frames = self._camera.take(self._start_s)
            if self._camera.error is not None and self._client.holding is None:
                self._client.hold(f"camera: {self._camera.error}")
        return [*self._client.readings(self._until_s), *frames]

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Do nothing: the guard process has commanded the drives."""

    def brake(self) -> None:
        """Brake at once, from any thread; waits for no lock."""
        self._client.hold("the loop stood still")

    def close(self) -> None:
        """Stop the chair, and release camera and links."""
        self._client.close()
        if self._camera is not None:
            self._camera.close()
