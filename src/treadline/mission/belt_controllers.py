"""Belt controllers: the interface, constant speed for open-loop runs, and the proposals that mix a controller with the plan.

The plan's own turn counts at each tick, else the belt controller's at its period; plus the pitch feedforward.
``MotionPlan, HeadingEstimate -> TrackCommand``.
"""

from typing import Protocol, runtime_checkable

from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand


@runtime_checkable
class Driver(Protocol):
    """Belt controller: computes a proposal from the heading estimate once per ``period_s``."""

    @property
    def period_s(self) -> float:
        """Control period [s]."""

    @property
    def follows_plan(self) -> bool:
        """Whether ``step`` applies the plan's speed and heading: the condition for a full traversal, and for the slip monitor."""

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        """Return the proposed belt speeds at ``t_s``; the plan gives speed and heading."""


class ConstantSpeed:
    """Open loop: both belts at the climb speed, whatever the heading (Fig. 9, open loop)."""

    follows_plan = False

    def __init__(self, speed_m_s: float, period_s: float) -> None:
        self._speed_m_s = speed_m_s
        self.period_s = period_s

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        """Return the climb speed on both belts."""
        del estimate, plan
        return TrackCommand(t_s=t_s, left_m_s=self._speed_m_s, right_m_s=self._speed_m_s)


class Proposals:
    """Mixes plan and belt controller; the pitch feedforward acts at each tick on the controller's last command."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self._steered: TrackCommand | None = None
        self._late_s = 0.0
        """Age of the controller's last command when it was returned [s]; it grows where a controller repeats itself."""
        self._feedforward_m_s = 0.0

    def step(self, plan: MotionPlan, estimate: HeadingEstimate | None, *, held: bool, due: bool) -> TrackCommand | None:
        """Return the proposal of this tick; None leaves the last proposal in force.

        Args:
            plan: The plan of this tick.
            estimate: The newest heading.
            held: Whether the guard holds the chair: it does not follow its belts then, and a controller that got the heading would
                adapt to that.
            due: Whether a period of the controller begins.
        """
        before, self._feedforward_m_s = self._feedforward_m_s, plan.pitch_feedforward_m_s
        if plan.turn_m_s is not None:
            if due:
                self._driver.step(None, plan.t_s, plan)  # it does not steer: its adaptation to the belts is void
            self._steered = None
            speed = plan.speed_m_s + plan.pitch_feedforward_m_s
            return TrackCommand(t_s=plan.t_s, left_m_s=speed - plan.turn_m_s, right_m_s=speed + plan.turn_m_s)
        if due:
            self._steered = self._driver.step(None if held else estimate, plan.t_s, plan)
            self._late_s = 0.0 if self._steered is None else plan.t_s - self._steered.t_s
        elif plan.pitch_feedforward_m_s == before:
            return None
        return None if self._steered is None else _with_feedforward(self._steered, plan, plan.t_s - self._late_s)


def _with_feedforward(command: TrackCommand, plan: MotionPlan, t_s: float) -> TrackCommand:
    """Return a command with the pitch feedforward and a new stamp, also where the feedforward ends; a brake stays a brake."""
    if command.brake:
        return command
    return TrackCommand(
        t_s=t_s, left_m_s=command.left_m_s + plan.pitch_feedforward_m_s, right_m_s=command.right_m_s + plan.pitch_feedforward_m_s
    )
