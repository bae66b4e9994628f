"""What a traversal is about from moment to moment: the interface of its planners, and the one that only drives on.

``ImuSample, TrackReading, ArmReading, StairMap, HeadingEstimate -> Plan``. ``ascent`` goes up, ``descent`` comes down; both end in
``arrived``, in ``refused`` after backing off, or in a plan that asks the guard to hold.
"""

from typing import Protocol, runtime_checkable

from treadline.signals import ArmReading, HeadingEstimate, ImuSample, Plan, StairMap, TrackReading

Felt = ImuSample | TrackReading | ArmReading | StairMap
"""What a planner listens to."""


@runtime_checkable
class Planner(Protocol):
    """Decides the phase; called at each tick, after what was read."""

    def feel(self, signal: Felt) -> None:
        """Take one signal."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> Plan:
        """Return what to do now."""


class Cruise:
    """On the flight and nowhere else: the heading controller, or an experiment's own driver, at one speed."""

    def __init__(self, speed_m_s: float) -> None:
        self._speed_m_s = speed_m_s

    def feel(self, signal: Felt) -> None:
        """Need nothing."""

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> Plan:
        """Return the same plan again."""
        del estimate
        return Plan(t_s=t_s, phase="drive", speed_m_s=self._speed_m_s)
