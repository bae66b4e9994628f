"""Silence of what must speak: drives, plans, processes, the operator's link, and other blocks (rows 7, 13, 21, 22 and 25)."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from treadline.core.signals import ROUNDING_S, HeadingMeasurement, StairMap
from treadline.guard._guard_config import GuardConfig
from treadline.guard._known import Known, Monitor
from treadline.guard._stamps import Stamped


class Heartbeat(NamedTuple):
    """Sign of life of a process."""

    t_s: float
    process: str


class Silence(Monitor):
    """Time since each of several sources last spoke. A source that has spoken once is awaited from then on.

    Args:
        config: Limits of the guard.
        names: Name of the source of each type of message.
        awaited: Names of those that are awaited from the first tick on.
        after: Type of message after which all are awaited, accepted or not.
        timeout_s: Longest silence [s]; None for that of the limits.
    """

    def __init__(
        self,
        config: GuardConfig,
        names: Mapping[type, str],
        awaited: Iterable[str] = (),
        after: type | None = None,
        timeout_s: float | None = None,
    ) -> None:
        super().__init__(config)
        self._names, self._after = names, after
        self._timeout_s = config.silence_s if timeout_s is None else timeout_s
        self._heard_s: dict[str, float] = dict.fromkeys(awaited, math.inf)
        self._faults: dict[str, str] = {}

    def hear(self, message: Stamped, known: Known) -> None:
        """Record what a source says."""
        self._expect(message)
        name = self._name(message)
        if name is not None:
            self._heard_s[name] = max(message.t_s, self._heard_s.get(name, message.t_s))
            self._faults.pop(name, None)

    def reject(self, message: Stamped, known: Known, fault: str) -> None:
        """Record why a message was rejected; it ends no silence."""
        self._expect(message)
        name = self._name(message)
        if name is not None:
            self._faults[name] = fault

    def cause(self, known: Known) -> str | None:
        """Return which source has been silent for too long, or None.

        A source that has not spoken yet counts as heard at the first call, and a message from the future as sent now.
        """
        for name, heard_s in self._heard_s.items():
            self._heard_s[name] = min(heard_s, known.t_s)
            if known.t_s - heard_s > self._timeout_s:
                return f"{name} silent for {known.t_s - heard_s:.2f} s{last(self._faults.get(name, ''))}"
        return None

    def excuse(self, passed_s: float) -> None:
        """Leave out of each silence what a guard that did not run for ``passed_s`` could not hear, beyond the timeout."""
        for name in self._heard_s:
            self._heard_s[name] += max(passed_s - self._timeout_s, 0.0) + ROUNDING_S

    def restart(self, known: Known) -> None:
        """Wait for each source anew."""
        self._heard_s = dict.fromkeys(self._heard_s, known.t_s)

    def _name(self, message: Stamped) -> str | None:
        return f"process {message.process}" if isinstance(message, Heartbeat) else self._names.get(type(message))

    def _expect(self, message: Stamped) -> None:
        if self._after is not None and isinstance(message, self._after):
            self._heard_s = dict.fromkeys(self._names.values(), math.inf) | self._heard_s


class BlockSilence(Silence):
    """The same for a block that computes from what the senses say: the cause names what they miss."""

    def cause(self, known: Known) -> str | None:
        """Return which block has been silent for too long, and what is missing of the senses, or None."""
        silent = super().cause(known)
        return f"{silent}: {known.missing}" if silent is not None and known.missing else silent


class MapMonitor(Monitor):
    """Time for which headings have come without a stair map."""

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._since_s: float | None = None

    def hear(self, message: Stamped, known: Known) -> None:
        """Update with a measured heading, or a map."""
        if isinstance(message, StairMap):
            self.restart(known)
        elif isinstance(message, HeadingMeasurement):
            self._since_s = message.t_s if self._since_s is None else self._since_s
            if message.t_s - self._since_s > self._config.blind_timeout_s:
                self._cause = f"headings without a stair map for {message.t_s - self._since_s:.1f} s"

    def restart(self, known: Known) -> None:
        """Start again."""
        super().restart(known)
        self._since_s = None


def last(fault: str) -> str:
    """Return the fault of the last message as the end of a cause; empty if it had none."""
    return f": the last {fault}" if fault else ""
