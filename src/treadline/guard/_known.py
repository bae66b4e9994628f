"""What the guard knows at a tick, and the monitor that judges it: ``messages, Known -> cause of a hold, speed restriction``."""

import math
from collections.abc import Callable
from dataclasses import dataclass

from treadline.core.signals import CommandSource, HeadingEstimate, MotionPlan, TrackCommand
from treadline.guard._belt_travel import BeltTravel
from treadline.guard._frame_monitor import FrameMonitor
from treadline.guard._guard_config import GuardConfig
from treadline.guard._stamps import Stamped


@dataclass(slots=True, kw_only=True)
class Known:
    """Common knowledge of all monitors; the guard updates it, and no monitor changes it."""

    config: GuardConfig
    frames: FrameMonitor
    """Judgement of the newest frame."""
    travel: BeltTravel
    report: Callable[[str, str], None]
    """Reports an event: its name and its cause."""
    is_reading: bool = False
    """Whether the message that is heard comes from a sensor, not from another block."""
    t_s: float = 0.0
    """Time of the tick."""
    passed_s: float = 0.0
    """Time since the previous tick."""
    same_ticks: int = 0
    """Number of ticks since then at one time."""
    commanded_s: float = 0.0
    """Time of the latest command of the belts' source."""
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
    """Judges one kind of fault. ``_rules.RULES`` names each, with the messages that it hears and how the chair stops for it."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._cause: str | None = None

    def hear(self, message: Stamped, known: Known) -> None:
        """Update with an accepted message of its types; a frame is also heard if it shows too little, see ``Known.frames``."""

    def reject(self, message: Stamped, known: Known, fault: str) -> None:
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
