"""Silence of what must speak: drives, plans, processes, the operator's link, and other blocks (rows 7, 13, 21, 22 and 25)."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from treadline.core.signals import (
    ROUNDING_S,
    FlipperReading,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    MotionPlan,
    OperatorInput,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.guard._guard_config import GuardConfig
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Known, Monitor


class Heartbeat(NamedTuple):
    """Sign of life of a process."""

    t_s: float
    process: str


class Silence(Monitor):
    """Time since each of several sources last spoke. A source that has spoken once is awaited from then on."""

    names: ClassVar[Mapping[type, str]] = {}
    """Name of the source of each type of message."""
    after: ClassVar[type | None] = None
    """Type of message after which all are awaited, accepted or not; None: from the first tick on."""
    timeout: ClassVar[str] = "silence_s"
    """Name of the limit of the longest silence."""

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._timeout_s: float = getattr(config, self.timeout)
        self._heard_s = dict.fromkeys(self.names.values() if self.after is None else (), math.inf)
        self._faults: dict[str, str] = {}

    def hear(self, message: Any, known: Known) -> None:
        """Record what a source says."""
        self.reject(message, known, "")
        name = self._name(message)
        if name is not None:
            self._heard_s[name] = max(message.t_s, self._heard_s.get(name, message.t_s))

    def reject(self, message: Any, known: Known, fault: str) -> None:
        """Record why a message was rejected, which ends no silence; an empty fault is none."""
        if self.after is not None and isinstance(message, self.after):
            self._heard_s = dict.fromkeys(self.names.values(), math.inf) | self._heard_s
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

    def _name(self, message: Any) -> str | None:
        return self.names.get(type(message))


class LinkSilence(Silence):
    """The operator's handset is silent once heard, also one whose stamps are rejected: an operator's stop.

    Time: 0.3 s.
    Not covered: a handset that was never connected.
    """

    rows, hears, names, after = "21", (OperatorInput,), {OperatorInput: "operator link"}, OperatorInput


class ProcessSilence(Silence):
    """A process of the graph that has sent heartbeats ends.

    Time: 0.75 s.
    Not covered: a process that is no node of the graph; nobody awaits it.
    """

    rows, hears, timeout = "22", (Heartbeat,), "heartbeat_timeout_s"

    def _name(self, message: Any) -> str | None:
        return f"process {message.process}" if message.process in self._config.processes else None


class PlanSilence(Silence):
    """The plan is silent, from the first tick; an old plan leaves time for a ramp.

    Time: 0.3 s.
    """

    rows, stop, hears, needs = "22", Stop.RAMP, (MotionPlan,), ("has_planner",)
    names: ClassVar[Mapping[type, str]] = {MotionPlan: "plan"}


class DriveSilence(Silence):
    """Belts, seat or flipper are silent, from the first tick; time in which the guard itself did not run counts up to 0.3 s.

    Time: 0.3 s.
    """

    rows, hears, needs = "13", (TrackReading, SeatReading, FlipperReading), ("watches_motion",)
    names: ClassVar[Mapping[type, str]] = {
        TrackReading: "readings of the belts",
        SeatReading: "readings of the seat",
        FlipperReading: "readings of the flipper",
    }

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        rates = (config.belt_limit_m_s, config.seat_rate_m_s, config.flipper_rate_rad_s)
        self._heard_s = {
            name: heard_s for (name, heard_s), rate in zip(self._heard_s.items(), rates, strict=True) if rate is not None
        }


class EstimateSilence(Silence):
    """The heading estimate is silent, from the first measured heading; belts 0.1 m/s apart turn the chair by 0.3° more over a ramp.

    Time: 0.3 s.
    """

    rows, stop, needs = "7", Stop.RAMP, ("needs_heading",)
    hears: ClassVar[tuple[type, ...]] = (HeadingEstimate, HeadingMeasurement)
    names: ClassVar[Mapping[type, str]] = {HeadingEstimate: "heading estimate"}
    after = HeadingMeasurement

    def cause(self, known: Known) -> str | None:
        """Return the silence, and what is missing of the senses from which the estimate is made, or None."""
        silent = super().cause(known)
        return f"{silent}: {known.missing}" if silent is not None and known.missing else silent


class HealthSilence(EstimateSilence):
    """The estimator's health is silent, from the first measured heading, if the estimator declares it.

    Time: 0.3 s.
    """

    hears: ClassVar[tuple[type, ...]] = (HeadingHealth, HeadingMeasurement)
    declared = "awaits_health"
    names: ClassVar[Mapping[type, str]] = {HeadingHealth: "health of the heading"}
    unwatched = ("health_unwatched", "the estimator does not report its health: no hold for a gyro that errs")


class MapMonitor(Monitor):
    """Headings without a stair map, if the detector declares maps: nothing watches the flight for obstacles and gaps.

    Time: 3 s.
    """

    rows, stop, hears, needs, declared = "25", Stop.RAMP, (HeadingMeasurement, StairMap), ("needs_heading",), "awaits_map"
    unwatched = ("map_unwatched", "the detector sends no maps: no stop before what stands on the flight, or a gap")

    def __init__(self, config: GuardConfig) -> None:
        super().__init__(config)
        self._since_s: float | None = None

    def hear(self, message: Any, known: Known) -> None:
        """Update with a measured heading, or a map."""
        if isinstance(message, StairMap):
            self.restart(known)
        else:
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
