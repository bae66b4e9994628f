"""How readings reach the mission: camera frames late, unevenly or never; belt speeds as encoder counts.

Readings keep the stamp of their exposure; only the tick of their delivery is later.
"""

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from treadline.core.ports import Reading
from treadline.core.signals import TICK_S
from treadline.scenario.scenario import Realism


class CameraLink:
    """Delay line of the camera's readings, first in, first out."""

    def __init__(self, realism: Realism, rng: np.random.Generator) -> None:
        self._realism = realism
        self._rng = rng
        self._queue: deque[tuple[int, Sequence[Reading]]] = deque()
        self._last_due = 0

    def clear(self) -> None:
        """Forget what is under way."""
        self._queue.clear()
        self._last_due = 0

    def is_dropped(self) -> bool:
        """Decide whether the next frame is lost."""
        return bool(self._rng.random() < self._realism.camera_drop_rate)

    def send(self, tick: int, readings: Sequence[Reading]) -> None:
        """Accept the readings of a frame exposed at a tick.

        The first frame, of ``t = 0``, arrives at once: the chair has stood at its start before, and its camera has run.
        """
        latency_s = self._realism.camera_latency_s + self._realism.camera_jitter_s * float(self._rng.standard_normal())
        if tick == 0:
            latency_s = 0.0
        # A frame cannot arrive before its exposure, nor overtake the frame before it.
        self._last_due = max(tick + math.ceil(latency_s / TICK_S - 1e-9), tick, self._last_due)
        self._queue.append((self._last_due, readings))

    def arrived(self, tick: int) -> list[Reading]:
        """Return the readings that arrive until a tick."""
        readings: list[Reading] = []
        while self._queue and self._queue[0][0] <= tick:
            readings.extend(self._queue.popleft()[1])
        return readings


class Encoder:
    """Belt speed from the counts of an incremental encoder in one tick."""

    def __init__(self, counts_m: float) -> None:
        self._counts_m = counts_m
        self._travel_counts = 0.0

    def speed_m_s(self, actual_m_s: float) -> float:
        """Return the measured speed of a belt that ran at ``actual_m_s`` since the last tick; the rest of a count carries over."""
        if self._counts_m == 0.0:
            return actual_m_s
        before = math.floor(self._travel_counts)
        self._travel_counts += actual_m_s * TICK_S * self._counts_m
        return (math.floor(self._travel_counts) - before) / (self._counts_m * TICK_S)
