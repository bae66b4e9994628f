"""What a frame is worth: not one that is frozen, empty or dark (rows 2, 3 and 4)."""

import math

from treadline.mission.guard.config import GuardConfig
from treadline.signals import FrameQuality


class SightWatch:
    """Judges frames by their quality, and what a camera says without frames by whether it changes."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._fingerprint: int | None = None
        self._said: dict[str, tuple[object, float]] = {}
        self._blind = False
        self.refused = ""
        """Why the last frame was of no use; empty if it was."""
        self.is_alive = False
        """Whether the camera shows something new, even if it is too little to see a stair in."""
        self.is_dark = False
        """Whether the last frame's colours said nothing."""

    def frame(self, quality: FrameQuality) -> bool:
        """Say whether anything can be seen in a frame."""
        before, self._fingerprint = self._fingerprint, quality.fingerprint
        frozen = quality.fingerprint == before
        self.refused = self._fault(quality, frozen=frozen)
        # Across a landing and out into a wide room there is no depth at all, but something to see.
        self.is_alive = not frozen and (quality.valid_share >= self._config.alive_least or not self.is_dark)
        self._blind = bool(self.refused)
        return not self._blind

    def says(self, kind: str, value: object, travel_m: float) -> bool:
        """Say whether what is measured is new, or the chair has hardly moved since it was; of a useless frame nothing is."""
        if self._blind:
            return False
        before, since_m = self._said.get(kind, (None, 0.0))
        if value != before:
            self._said[kind] = (value, travel_m)
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
