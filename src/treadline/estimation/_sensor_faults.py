"""Sensor faults detected by the heading filter, and the detectors' building blocks."""

from collections import deque
from dataclasses import dataclass
from typing import get_args

from treadline.core.angles import wrap
from treadline.core.signals import HeadingFault, ImuSample, TrackReading

PRIOR_FRAMES, SCATTER_FRAMES = 10, 300
"""Prior weight of fully correlated frame errors, and largest weight of the measured scatter, in frames (30 s)."""
NEIGHBOURS_S = 0.35
SCATTER_GATE = 9.0
SCATTER_ALL = 0.8
"""Measured share from which the variance counts as fully independent; 300 frames determine the share to 10 %."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectedFault:
    """Active fault."""

    kind: HeadingFault
    since_s: float
    until_s: float
    """Time after which the fault is no longer reported [s]; infinite for a fault that must be cleared."""
    cause: str


class ActiveFaults:
    """All active faults; simultaneous faults are kept separately."""

    def __init__(self) -> None:
        self._found: dict[HeadingFault, DetectedFault] = {}

    def report(self, kind: HeadingFault, t_s: float, until_s: float, cause: str) -> None:
        """Report a fault; a continuing fault keeps its time of detection."""
        before = self._found.get(kind)
        since_s = before.since_s if before is not None and t_s <= before.until_s else t_s
        self._found[kind] = DetectedFault(kind=kind, since_s=since_s, until_s=until_s, cause=cause)

    def clear(self, kind: HeadingFault) -> None:
        """Clear a fault."""
        self._found.pop(kind, None)

    def is_active(self, kind: HeadingFault, t_s: float) -> bool:
        """Whether a fault of this kind is active."""
        return kind in self._found and t_s <= self._found[kind].until_s

    def most_severe(self, t_s: float) -> DetectedFault | None:
        """Return the most severe active fault."""
        return next((self._found[kind] for kind in get_args(HeadingFault) if self.is_active(kind, t_s)), None)


@dataclass(frozen=True, slots=True, kw_only=True)
class StuckRule:
    """Thresholds of the stuck-gyro detector."""

    for_s: float = 0.2
    same_rad_s: float = 1e-9
    """Largest change of the rates that counts as a repetition [rad/s]; noise exceeds it on all three axes."""
    moving_m_s: float = 0.02
    belts_s: float = 0.3
    """Largest age of a belt reading as evidence of motion [s]."""
    late_s: float = 0.05
    """Time after a belt reading for which the chair is assumed to move [s]."""


class StuckGyroDetector:
    """Distinguishes a stuck gyro from a standing chair."""

    def __init__(self, rule: StuckRule) -> None:
        self._rule = rule
        self._rates: list[float] = []
        self._since_s = 0.0
        self._moved_s: float | None = None
        self._moves_since_s = 0.0
        self._stuck_since_s: float | None = None

    def belts(self, reading: TrackReading) -> None:
        """Take a belt reading and note whether the belts move."""
        if max(abs(reading.left_m_s), abs(reading.right_m_s)) > self._rule.moving_m_s:
            if self._moved_s is None or reading.t_s - self._moved_s > self._rule.belts_s:
                self._moves_since_s = reading.t_s
            self._moved_s = reading.t_s

    def stuck_s(self, sample: ImuSample) -> float:
        """Return how long the gyro has repeated its reading while the chair moves [s]; zero for a plausible reading.

        A detected fault persists after the chair stops, until the gyro reading changes.
        """
        rates = sample.angular_velocity_rad_s.tolist()
        if not self._rates or max(abs(a - b) for a, b in zip(rates, self._rates, strict=True)) > self._rule.same_rad_s:
            self._rates, self._since_s, self._stuck_since_s = rates, sample.t_s, None
        moved_s = self._moved_s
        if self._stuck_since_s is None and moved_s is not None and abs(sample.t_s - moved_s) <= self._rule.belts_s:
            # Repetitions before the belts started or after they stopped are not evidence.
            since_s = max(self._since_s, self._moves_since_s)
            if min(sample.t_s, moved_s + self._rule.late_s) - since_s >= self._rule.for_s - 1e-6:
                self._stuck_since_s = since_s
        return 0.0 if self._stuck_since_s is None else sample.t_s - self._stuck_since_s


class IndependentShare:
    """Independent share of vision's declared variance, estimated from the difference of neighbouring frames minus the gyro turn.

    The remaining share is common to neighbouring frames (skewed nosings, calibration, gravity) and not reduced by averaging.
    """

    def __init__(self) -> None:
        self._count = PRIOR_FRAMES
        self._own = 0.0
        self._last: tuple[float, float] | None = None

    def own(self, t_s: float, still_rad: float, sigma_rad: float) -> float:
        """Take a heading with the turn removed; return the independent share of its variance, from 0 to 1."""
        if self._last is not None and t_s - self._last[0] <= NEIGHBOURS_S:
            squared = 0.5 * (wrap(still_rad - self._last[1]) / sigma_rad) ** 2
            if squared <= SCATTER_GATE:
                self._count = min(self._count + 1, SCATTER_FRAMES)
                self._own += (squared - self._own) / self._count
        self._last = (t_s, still_rad)
        return min(self._own / SCATTER_ALL, 1.0)

    def restart(self) -> None:
        """Compare the next heading with none before, whose reference differs."""
        self._last = None


class TurnHistory:
    """Recent history of the integrated gyro turn, for late frames."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._turned: deque[tuple[float, float]] = deque()

    def remember(self, t_s: float, turned_rad: float) -> None:
        """Add one sample."""
        self._turned.append((t_s, turned_rad))
        while t_s - self._turned[0][0] > self._seconds:
            self._turned.popleft()

    def at(self, t_s: float) -> tuple[float, float] | None:
        """Return the last sample at or before a time, or the oldest sample; None if the history is empty."""
        if not self._turned:
            return None
        then = self._turned[0]
        for sample in self._turned:
            if sample[0] > t_s + 1e-9:
                break
            then = sample
        return then
