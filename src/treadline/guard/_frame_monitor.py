"""Quality of camera frames: frozen, without depth, dark or glaring frames are rejected (rows 2, 3 and 4)."""

import math

from treadline.core.signals import FrameQuality
from treadline.guard._guard_config import GuardConfig


class FrameMonitor:
    """Judges frames by their quality, and measurements of a camera without images by whether they change."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._fingerprint: int | None = None
        self._values: dict[str, tuple[object, float]] = {}
        self._blind = False
        self.refused = ""
        """Why the last frame was rejected; empty if it was accepted."""
        self.is_alive = False
        """Whether the camera delivers new images, even if too poor to detect a stair."""
        self.is_dark = False
        """Whether the last frame was too dark, glaring or flat for its colours to be used."""

    def accept_frame(self, quality: FrameQuality) -> bool:
        """Return whether a stair can be detected in a frame."""
        before, self._fingerprint = self._fingerprint, quality.fingerprint
        frozen = quality.fingerprint == before
        self.refused = self._fault(quality, frozen=frozen)
        # Across a landing and out into a wide room a frame has no depth at all, but it has colours.
        self.is_alive = not frozen and (quality.valid_share >= self._config.alive_least or not self.is_dark)
        self._blind = bool(self.refused)
        return not self._blind

    def accept_measurement(self, kind: str, value: object, travel_m: float) -> bool:
        """Return whether a measurement has changed, or the chair has hardly moved since; False after a rejected frame."""
        if self._blind:
            return False
        before, since_m = self._values.get(kind, (None, 0.0))
        if value != before:
            self._values[kind] = (value, travel_m)
            since_m = travel_m
        frozen = abs(travel_m - since_m) > self._config.frozen_travel_m
        self.refused = "is frozen" if frozen else ""
        return not frozen

    def _fault(self, quality: FrameQuality, *, frozen: bool) -> str:
        limits = self._config
        if not all(math.isfinite(value) for value in (quality.brightness, quality.contrast, quality.valid_share)):
            self.is_dark = True
            return "is no image"
        self.is_dark = abs(quality.brightness - 0.5) > 0.5 - limits.dark or quality.contrast < limits.contrast_least
        if frozen:
            return "is frozen"
        if quality.valid_share < limits.valid_least:
            return f"has {quality.valid_share:.0%} of its depth"
        if self.is_dark and quality.valid_share < limits.valid_least_dark:
            return f"is dark or glaring and has {quality.valid_share:.0%} of its depth"
        return ""
