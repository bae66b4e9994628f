"""How long each stage of a look took."""

import time


class Stopwatch:
    """Adds up wall time by stage."""

    def __init__(self) -> None:
        self.laps_ms: dict[str, float] = {}
        """Milliseconds by stage, in the order in which the stages first ended."""
        self._last_s = time.perf_counter()

    def resume(self) -> None:
        """Start the next stage now: what went before it belongs to none."""
        self._last_s = time.perf_counter()

    def lap(self, stage: str) -> None:
        """End a stage."""
        now_s = time.perf_counter()
        self.laps_ms[stage] = self.laps_ms.get(stage, 0.0) + 1e3 * (now_s - self._last_s)
        self._last_s = now_s
