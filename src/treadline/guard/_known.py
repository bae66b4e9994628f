"""What the guard knows at a tick, the monitor that judges it, and the time for which a fault lasts.

``messages, Known -> cause of a hold, speed restriction``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

from treadline.core.signals import ROUNDING_S, CommandSource, HeadingEstimate, MotionPlan, TrackCommand
from treadline.guard._belt_travel import BeltTravel
from treadline.guard._frame_monitor import FrameMonitor
from treadline.guard._guard_config import GuardConfig
from treadline.guard._half_cosine_stop import Stop


@dataclass(slots=True, kw_only=True)
class Known:
    """Common knowledge of all monitors; the guard updates it, and no monitor changes it."""

    frames: FrameMonitor
    """Judgement of the newest frame."""
    travel: BeltTravel
    report: Callable[[str, str], None]
    """Reports an event: its name and its cause."""
    t_s: float
    """Time of the tick."""
    passed_s: float
    """Time since the previous tick."""
    commanded_s: float
    """Time of the latest command of the belts' source."""
    is_reading: bool = False
    """Whether the message that is heard comes from a sensor, not from another block."""
    passed: TrackCommand
    """Command that the belts have; within a tick, before its causes are asked for, the one that they would get."""
    plan: MotionPlan | None = None
    """Newest plan."""
    source: CommandSource = "driver"
    """Whose commands move the belts."""
    estimate: HeadingEstimate | None = None
    rearmed_s: float = -math.inf
    missing: str = ""
    """What is missing of the senses and slows the chair; empty if nothing is."""

    @property
    def followed(self) -> MotionPlan | None:
        """The plan that the belts follow; None while velocity commands move them."""
        return self.plan if self.source == "driver" else None

    @property
    def heading_rad(self) -> float:
        """Heading; infinite if unknown."""
        return math.inf if self.estimate is None else self.estimate.heading_rad

    @property
    def mean_m_s(self) -> float:
        """Mean speed of the belts' command."""
        return 0.5 * (self.passed.left_m_s + self.passed.right_m_s)


class Monitor:
    """One rule of the guard. Its docstring is its row in the table of hazards: what holds, its time, and what it does not cover."""

    rows: ClassVar[str] = ""
    """Rows in the table of hazards."""
    stop: ClassVar[Stop] = Stop.BRAKE
    """How the chair stops for it."""
    hears: ClassVar[tuple[type, ...]] = ()
    """Types of the messages that it hears."""
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of the limits that must be set for the rule to apply to a run."""
    declared: ClassVar[str] = ""
    """Name of the limit by which blocks declare what the rule needs; empty if it needs nothing of the kind."""
    unwatched: ClassVar[tuple[str, str]] = ("", "")
    """Event at the first tick where it is not declared: its name, and what is not watched."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._cause: str | None = None

    @classmethod
    def applies(cls, limits: GuardConfig) -> bool:
        """Return whether the rule applies to a run with these limits, whatever is declared."""
        return all(getattr(limits, name) for name in cls.needs)

    @classmethod
    def is_watched(cls, limits: GuardConfig) -> bool:
        """Return whether the rule applies, and blocks send what it needs."""
        return cls.applies(limits) and (not cls.declared or bool(getattr(limits, cls.declared)))

    def hear(self, message: Any, known: Known) -> None:
        """Update with an accepted message of its types; a frame is also heard if it shows too little, see ``Known.frames``."""

    def reject(self, message: Any, known: Known, fault: str) -> None:
        """Note a message of its types that was rejected, and why."""

    def cause(self, known: Known) -> str | None:
        """Return why the chair must be held; None if it need not. Most causes stay until a re-arm."""
        return self._cause

    def restriction(self, known: Known) -> tuple[str, str] | None:
        """Return a speed restriction, as a word and a reason; None without one."""
        return None

    def restart(self, known: Known) -> None:
        """Start again, after a re-arm."""
        self._cause = None


class Lasting:
    """Time beyond a limit minus time within it, never below zero: a shock is soon over, a flickering fault is not.

    Each interval counts by the sample that ends it. A fault that is there for a share p of the time lasts after the limit divided
    by 2p - 1.

    Args:
        limit_s: Time beyond the limit after which a fault lasts [s].
        gap_s: Longest interval between two samples that counts [s].
    """

    def __init__(self, limit_s: float, gap_s: float) -> None:
        self._limit_s, self._gap_s = limit_s, gap_s
        self._t_s, self._over_s = math.inf, 0.0

    def update(self, t_s: float, *, beyond: bool) -> bool:
        """Return whether the fault lasts, after one more sample."""
        dt_s = min(max(t_s - self._t_s, 0.0), self._gap_s)
        before_s, self._t_s = self._over_s, t_s
        self._over_s = max(before_s + (dt_s if beyond else -dt_s), 0.0)
        return beyond and before_s >= self._limit_s - ROUNDING_S

    def forget(self, t_s: float) -> None:
        """Start again with a sample within the limit."""
        self._t_s, self._over_s = t_s, 0.0
