"""Progress on stderr: a bar with the time left where a person watches, plain lines elsewhere."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from types import TracebackType
from typing import TypeVar

Item = TypeVar("Item")


class Progress:
    """Counts finished parts of a long job."""

    LINES = 20
    """Largest number of progress lines where stderr is no terminal."""

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
        if self._done <= self._total and self._done * self.LINES // self._total == (self._done - 1) * self.LINES // self._total:
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


class Status:
    """One line that says what is being done, where a person watches; nothing elsewhere."""

    def __init__(self, first: str) -> None:
        self._status = None
        if sys.stderr.isatty():
            from rich.console import Console

            self._status = Console(stderr=True).status(first)

    def __enter__(self) -> "Status":
        if self._status is not None:
            self._status.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if self._status is not None:
            self._status.stop()

    def say(self, what: str) -> None:
        """Say what is done now."""
        if self._status is not None:
            self._status.update(what)


class Share:
    """Shows what share of a stream has been read."""

    PARTS = 20
    """Steps of the bar; as many lines where no person watches."""

    def __init__(self, title: str, fraction: Callable[[], float]) -> None:
        self._progress = Progress(title, self.PARTS)
        self._fraction = fraction
        self._shown = 0

    def __enter__(self) -> "Share":
        self._progress.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._progress.__exit__(kind, error, trace)

    def of(self, stream: Iterable[Item]) -> Iterator[Item]:
        """Yield the stream's items, and show how far it has come after each."""
        for item in stream:
            yield item
            while self._shown < int(self._fraction() * self.PARTS):
                self._shown += 1
                self._progress.done(f"{100 * self._shown // self.PARTS} %")
