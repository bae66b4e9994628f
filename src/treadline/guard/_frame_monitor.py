"""Frames and measurements that may be used: not frozen, not dark, glaring or empty (rows 2, 3 and 4)."""

from collections import deque

from treadline.core.signals import FrameQuality
from treadline.guard._guard_config import GuardConfig


class Repeats:
    """Values of the last seconds; a camera whose values were all there before delivers nothing new.

    Args:
        window_s: Time for which a value is remembered [s].
        most: Number of remembered values; None for all of that time. Measurements may be rounded, and come again soon.
    """

    def __init__(self, window_s: float, most: int | None = None) -> None:
        self._window_s = window_s
        self._values: deque[tuple[float, object]] = deque(maxlen=most)

    def is_new(self, t_s: float, value: object) -> bool:
        """Return whether a value was not there before; a repeated value is remembered anew."""
        while self._values and t_s - self._values[0][0] > self._window_s:
            self._values.popleft()
        new = all(before != value for _, before in self._values)
        self._values.append((t_s, value))
        return new


class FrameMonitor:
    """Judges frames by their quality, and measurements of a camera without images by whether they change."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._images = Repeats(config.blind_timeout_s)
        self._values: dict[str, Repeats] = {}
        self._changed_m: dict[str, float] = {}
        self._blind = False
        self.refused = ""
        """Why the last frame was rejected; empty if it was accepted."""
        self.is_alive = False
        """Whether the camera delivers new images, even if too poor to detect a stair."""
        self.is_dark = False
        """Whether the last frame was too dark, glaring or flat for its colours to be used."""

    def accept_frame(self, quality: FrameQuality) -> bool:
        """Return whether a stair can be detected in a frame."""
        limits = self._config
        frozen = not self._images.is_new(quality.t_s, quality.fingerprint)
        self.is_dark = abs(quality.brightness - 0.5) > 0.5 - limits.dark or quality.contrast < limits.contrast_least
        self.refused = "is frozen" if frozen else self._fault(quality)
        # Across a landing and out into a wide room a frame has no depth at all, but it has colours.
        self.is_alive = not frozen and (quality.valid_share >= limits.alive_least or not self.is_dark)
        self._blind = bool(self.refused)
        return not self._blind

    def reject_frame(self, fault: str) -> None:
        """Record a frame that is no image."""
        self.refused, self.is_alive, self._blind = fault, False, True

    def accept_measurement(self, kind: str, t_s: float, value: object, travel_m: float) -> bool:
        """Return whether a measurement has changed, or the chair has hardly moved since; False after a rejected frame."""
        if self._blind:
            return False
        if self._values.setdefault(kind, Repeats(self._config.blind_timeout_s, 2)).is_new(t_s, value):
            self._changed_m[kind] = travel_m
        frozen = abs(travel_m - self._changed_m.setdefault(kind, travel_m)) > self._config.frozen_travel_m
        self.refused = "is frozen" if frozen else ""
        return not frozen

    def _fault(self, quality: FrameQuality) -> str:
        limits = self._config
        if quality.valid_share < limits.valid_least:
            return f"has {quality.valid_share:.0%} of its depth"
        if self.is_dark and quality.valid_share < limits.valid_least_dark:
            return f"is dark or glaring and has {quality.valid_share:.0%} of its depth"
        return ""
