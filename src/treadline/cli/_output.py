"""Output of commands: the answer on stdout; on stderr the first line of a long command, and its progress."""

import errno
import json
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self, TypeVar

from treadline.core.printing import plain, say

Item = TypeVar("Item")

AFTER_S = 1.5
"""Time after which the first line is written [s]: two seconds, less the start of Python and of the command line (0.3 s)."""
PARTS = 20
"""Largest number of progress lines where stderr is no terminal."""
STEP_S = 10.0
"""Simulated seconds between two progress lines, at least."""
SILENCE_S = 8.0
"""Longest time without a line [s]: ten seconds, less the delay of a busy machine."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A verb's result: JSON values, a summary for people, and an exit code."""

    values: Mapping[str, Any]
    summary: Sequence[str]
    code: int = 0
    """0: done; 1: the job ran and the answer is no."""

    def write(self, *, as_json: bool) -> None:
        """Write the answer to stdout.

        Raises:
            OSError: If stdout is closed, or cannot be written.
        """
        if sys.stdout is None:
            raise OSError(errno.EBADF, "it is closed")
        text = json.dumps(plain(self.values), allow_nan=False) if as_json else "\n".join(self.summary)
        sys.stdout.write(text + "\n")
        sys.stdout.flush()


@contextmanager
def start_line(tokens: Sequence[str]) -> Iterator[None]:
    """Write that a command runs, unless the command ends before ``AFTER_S``.

    Progress begins later, after the import of libraries and the compilation of kernels.
    """
    name = next((token for token in tokens if not token.startswith("-")), "")
    line = f"treadline {name}".strip() + f": {_activity(tokens)}; Ctrl-C stops it"
    timer = threading.Timer(AFTER_S, say, [line])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _activity(tokens: Sequence[str]) -> str:
    """Return what the command does: a command with ``--export FILE`` writes a file and ends."""
    words = [word for item in tokens for word in (item.split("=", 1) if item.startswith("--export=") else [item])]
    if "--export" not in words[:-1]:
        return "running"
    return f"writing {words[words.index('--export') + 1]}"


class Progress:
    """Finished parts of a long job: a bar with the time left on a terminal, a few plain lines elsewhere.

    A job that is silent for ``SILENCE_S`` gets a line that says what runs.

    Args:
        title: Name of the job.
        total: Number of parts; None if ``begin`` sets it.
    """

    def __init__(self, title: str, total: int | None = None) -> None:
        self._title = self._activity = title
        self._done = 0
        self._bar: Any = None
        self._ended = threading.Event()
        if total is not None:
            self.begin(total)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        if self._bar is not None:
            self._bar.stop()

    def begin(self, total: int) -> None:
        """Start the clock of a job of ``total`` parts."""
        self._total, self._started = total, time.monotonic()
        self._said = self._started
        self._stream = sys.stderr  # not that of a moment at which a part redirects it
        if sys.stderr.isatty() and total:
            self._bar = _bar()
            self._task = self._bar.add_task(self._title, total=total)
            self._bar.start()
        else:
            threading.Thread(target=self._break_silence, daemon=True).start()

    def running(self, activity: str) -> None:
        """Note what runs now, for the bar and for a line that breaks a silence."""
        self._activity = activity
        if self._bar is not None:
            self._bar.update(self._task, description=f"{self._title}: {activity}")

    @property
    def part_s(self) -> float:
        """Mean time of a finished part [s]."""
        return (time.monotonic() - self._started) / max(self._done, 1)

    def done(self, name: str) -> None:
        """Count one part."""
        self._done += 1
        if self._bar is not None:
            self._bar.update(self._task, completed=self._done, description=f"{self._title}: {name}")
        elif self._done > self._total or self._done * PARTS // self._total != (self._done - 1) * PARTS // self._total:
            self._say(name)

    def _say(self, text: str) -> None:
        self._said = time.monotonic()
        say(f"[{self._said - self._started:6.1f} s] {self._done} of {self._total}: {text}", self._stream)

    def _break_silence(self) -> None:
        """Write a line whenever none was written for ``SILENCE_S``."""
        while not self._ended.wait(max(self._said + SILENCE_S - time.monotonic(), 0.0)):
            if time.monotonic() - self._said >= SILENCE_S:
                self._say(f"running {self._activity}")


def _bar() -> Any:
    """Return the bar of a job on stderr."""
    from rich import progress
    from rich.console import Console

    return progress.Progress(
        progress.TextColumn("{task.description}"),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TextColumn("left"),
        progress.TimeRemainingColumn(),
        console=Console(stderr=True),
    )


class SimulatedTime(Progress):
    """Progress of a run: a part every ten seconds of mission time, or every twentieth of a long run."""

    _step_s = _next_s = 0.0

    def at(self, t_s: float, duration_s: float) -> None:
        """Note the mission time of a run of a known duration."""
        if not self._step_s:
            self._step_s = self._next_s = max(STEP_S, duration_s / PARTS)
            self.begin(max(1, round(duration_s / self._step_s)))
        if t_s >= self._next_s:
            self.done(f"{t_s:.0f} s of {duration_s:.0f} s")
            self._next_s += self._step_s


class Share(Progress):
    """Progress of reading a stream.

    Args:
        fraction: Function that returns the fraction that has been read.
    """

    def __init__(self, title: str, fraction: Callable[[], float]) -> None:
        super().__init__(title, PARTS)
        self._fraction = fraction

    def of(self, stream: Iterable[Item]) -> Iterator[Item]:
        """Yield the stream's items, and show the progress after each."""
        for item in stream:
            yield item
            while self._done < int(self._fraction() * PARTS):
                self.done(f"{100 * (self._done + 1) // PARTS} %")


def status(first: str) -> Any:
    """Return a line on a terminal that names the present activity, until ``update`` replaces it; nothing elsewhere."""
    from rich.console import Console

    return Console(stderr=True, force_terminal=sys.stderr.isatty()).status(first)
