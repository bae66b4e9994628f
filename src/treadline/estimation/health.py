"""What the heading filter knows to be wrong with its sensors, for whoever must act on it."""

from collections import deque
from dataclasses import dataclass
from typing import Literal, get_args

from treadline.angles import wrap
from treadline.signals import ImuSample, TrackReading

PRIOR_FRAMES, SCATTER_FRAMES = 10, 300
"""Weight, in frames, of the belief that neighbouring frames share their errors, and the most that their scatter may weigh: 30 s."""
NEIGHBOURS_S = 0.35
SCATTER_GATE = 9.0
SCATTER_ALL = 0.8
"""From this share on all of it counts as the frame's own: 300 frames tell it to a tenth."""
FaultKind = Literal["stuck", "disagreement", "drift", "jump"]
"""The gravest first: it is told where several are known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingHealth:
    """The filter's state of mind at one instant."""

    t_s: float
    fault: FaultKind | None
    """``drift``: the gyro's bias has stepped. ``jump``: the gyro has jumped. ``stuck``: it repeats itself since the belts ran.
    These three are found out and mended as far as vision can. ``disagreement``: vision and gyro differ, who errs is open."""
    since_s: float | None
    """When the fault was found."""
    cause: str | None
    """What was seen, with its number."""
    disagreement_rad: float
    """Last heading seen less the one expected, if it was refused; else zero."""
    unseen_s: float
    """Since a heading was last accepted."""
    bias_rad_s: float
    scale: float
    walk_rad_rts: float
    """What the gyro is believed to random-walk in a second."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """A fault that is known."""

    kind: FaultKind
    since_s: float
    until_s: float
    """When it is no longer told, unless it is found again; infinite for one that must be forgiven."""
    cause: str


class Faults:
    """All faults that are known: one that comes and goes hides no other."""

    def __init__(self) -> None:
        self._found: dict[FaultKind, Found] = {}

    def tell(self, kind: FaultKind, t_s: float, until_s: float, cause: str) -> None:
        """Note a fault; one that goes on keeps the time at which it was found."""
        before = self._found.get(kind)
        since_s = before.since_s if before is not None and t_s <= before.until_s else t_s
        self._found[kind] = Found(kind=kind, since_s=since_s, until_s=until_s, cause=cause)

    def forgive(self, kind: FaultKind) -> None:
        """End a fault."""
        self._found.pop(kind, None)

    def knows(self, kind: FaultKind, t_s: float) -> bool:
        """Say whether there is such a fault now."""
        return kind in self._found and t_s <= self._found[kind].until_s

    def gravest(self, t_s: float) -> Found | None:
        """Return the gravest fault that is there now."""
        return next((self._found[kind] for kind in get_args(FaultKind) if self.knows(kind, t_s)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckRule:
    """When a gyro is stuck."""

    for_s: float = 0.2
    same_rad_s: float = 1e-9
    """No sensor with noise repeats all three rates this closely."""
    moving_m_s: float = 0.02
    belts_s: float = 0.3
    """How old a belt's reading may be to tell that the chair moves …"""
    late_s: float = 0.05
    """… and for how long after it the chair does."""


class StuckWatch:
    """Tells a gyro that repeats itself from a chair that stands."""

    def __init__(self, rule: StuckRule) -> None:
        self._rule = rule
        self._rates: list[float] = []
        self._since_s = 0.0
        self._moved_s: float | None = None
        self._moves_since_s = 0.0
        self._stuck_since_s: float | None = None

    def belts(self, reading: TrackReading) -> None:
        """Note whether the belts run."""
        if max(abs(reading.left_m_s), abs(reading.right_m_s)) > self._rule.moving_m_s:
            if self._moved_s is None or reading.t_s - self._moved_s > self._rule.belts_s:
                self._moves_since_s = reading.t_s
            self._moved_s = reading.t_s

    def stuck_s(self, sample: ImuSample) -> float:
        """Return for how long the gyro has repeated itself under a chair that moves; zero where it may be honest.

        Once found it stays so on a chair that stops, until the gyro says something else.
        """
        rates = sample.angular_velocity_rad_s.tolist()
        if not self._rates or max(abs(a - b) for a, b in zip(rates, self._rates, strict=True)) > self._rule.same_rad_s:
            self._rates, self._since_s, self._stuck_since_s = rates, sample.t_s, None
        moved_s = self._moved_s
        if self._stuck_since_s is None and moved_s is not None and abs(sample.t_s - moved_s) <= self._rule.belts_s:
            # What it repeated before the belts ran, or after they had stopped, tells nothing.
            since_s = max(self._since_s, self._moves_since_s)
            if min(sample.t_s, moved_s + self._rule.late_s) - since_s >= self._rule.for_s - 1e-6:
                self._stuck_since_s = since_s
        return 0.0 if self._stuck_since_s is None else sample.t_s - self._stuck_since_s


class Scatter:
    """How much of vision's declared variance is each frame's own: what neighbours differ by, less what the gyro turned.

    The rest they share (nosings that are askew, calibration, gravity), and no number of them averages it out.
    """

    def __init__(self) -> None:
        self._count = PRIOR_FRAMES
        self._own = 0.0
        self._last: tuple[float, float] | None = None

    def own(self, t_s: float, still_rad: float, sigma_rad: float) -> float:
        """Take a heading, the turning since taken out; return the share of its variance that is its own, from 0 to 1."""
        if self._last is not None and t_s - self._last[0] <= NEIGHBOURS_S:
            squared = 0.5 * (wrap(still_rad - self._last[1]) / sigma_rad) ** 2
            if squared <= SCATTER_GATE:
                self._count = min(self._count + 1, SCATTER_FRAMES)
                self._own += (squared - self._own) / self._count
        self._last = (t_s, still_rad)
        return min(self._own / SCATTER_ALL, 1.0)


class Memory:
    """How far the gyro has turned, for the last second or so: late frames are looked up in it."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._turned: deque[tuple[float, float]] = deque()

    def remember(self, t_s: float, turned_rad: float) -> None:
        """Add one sample."""
        self._turned.append((t_s, turned_rad))
        while t_s - self._turned[0][0] > self._seconds:
            self._turned.popleft()

    def at(self, t_s: float) -> tuple[float, float] | None:
        """Return the last sample at or before a time, or the oldest; None if there is none."""
        if not self._turned:
            return None
        then = self._turned[0]
        for sample in self._turned:
            if sample[0] > t_s + 1e-9:
                break
            then = sample
        return then
