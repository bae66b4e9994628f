"""Progress on stderr: a bar with the time left where a person watches, plain lines elsewhere."""

import sys
import time
from types import TracebackType


class Progress:
    """Counts finished parts of a long job."""

    def __init__(self, title: str, total: int) -> None:
        self._title = title
        self._total = total
        self._done = 0
        self._started = time.monotonic()
        self._bar = None
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import (
                BarColumn,
                MofNCompleteColumn,
                TextColumn,
                TimeElapsedColumn,
                TimeRemainingColumn,
            )
            from rich.progress import Progress as Bar

            self._bar = Bar(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("left"),
                TimeRemainingColumn(),
                console=Console(stderr=True),
            )
            self._task = self._bar.add_task(title, total=total)

    def __enter__(self) -> "Progress":
        if self._bar is not None:
            self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._bar is not None:
            self._bar.stop()

    def done(self, name: str) -> None:
        """Count one part."""
        self._done += 1
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done, description=f"{self._title}: {name}")
            return
        spent = time.monotonic() - self._started
        sys.stderr.write(f"[{spent:6.1f} s] {self._done}/{self._total} {name}\n")
        sys.stderr.flush()


class SimulatedTime:
    """Shows how far a simulated run has come."""

    STEP_S = 10.0
    """Simulated seconds between plain lines."""

    def __init__(self, title: str, duration_s: float) -> None:
        self._progress = Progress(title, max(1, round(duration_s / self.STEP_S)))
        self._next_s = self.STEP_S

    def __enter__(self) -> "SimulatedTime":
        self._progress.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._progress.__exit__(kind, error, trace)

    def at(self, t_s: float) -> None:
        """Note the simulated time."""
        if t_s >= self._next_s:
            self._progress.done(f"{t_s:.0f} s simulated")
            self._next_s += self.STEP_S
