"""Processing time of each stage of a detection."""

import time


class Stopwatch:
    """Accumulated wall time by stage."""

    def __init__(self) -> None:
        self.laps_ms: dict[str, float] = {}
        """Milliseconds by stage, in the order in which the stages first ended."""
        self._last_s = time.perf_counter()

    def resume(self) -> None:
        """Start the next stage now; the time before is not assigned."""
        self._last_s = time.perf_counter()

    def lap(self, stage: str) -> None:
        """End a stage."""
        now_s = time.perf_counter()
        self.laps_ms[stage] = self.laps_ms.get(stage, 0.0) + 1e3 * (now_s - self._last_s)
        self._last_s = now_s
