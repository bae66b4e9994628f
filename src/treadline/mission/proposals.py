"""What is asked of the belts: the plan's own turn at each tick, the driver's when it is due; eased by the plan, whoever steers.

``MotionPlan, HeadingEstimate -> TrackCommand``. The loop and the driver's node share it.
"""

from treadline.mission.drivers import Driver
from treadline.signals import HeadingEstimate, MotionPlan, TrackCommand


class Proposals:
    """Asks for belt speeds, and remembers what the driver said last: a fall does not wait for its period."""

    def __init__(self, driver: Driver) -> None:
        self._driver = driver
        self._steered: TrackCommand | None = None
        self._late_s = 0.0
        """How old what the driver said last already was: of a driver that repeats itself, more and more."""
        self._eased_m_s = 0.0

    def step(self, plan: MotionPlan, estimate: HeadingEstimate | None, *, held: bool, due: bool) -> TrackCommand | None:
        """Return what to propose at this tick; None leaves it at what was proposed last.

        Args:
            plan: What to do now.
            estimate: Where the chair heads.
            held: Whether the guard holds it: it does not answer its belts then, and a driver that knew where it heads would learn
                from that.
            due: Whether the driver's period is over.
        """
        eased, self._eased_m_s = self._eased_m_s, plan.pitch_feedforward_m_s
        if plan.turn_m_s is not None:
            if due:
                self._driver.step(None, plan.t_s, plan)  # it does not steer: what it has learned of the belts is void
            self._steered = None
            speed = plan.speed_m_s + plan.pitch_feedforward_m_s
            return TrackCommand(t_s=plan.t_s, left_m_s=speed - plan.turn_m_s, right_m_s=speed + plan.turn_m_s)
        if due:
            self._steered = self._driver.step(None if held else estimate, plan.t_s, plan)
            self._late_s = 0.0 if self._steered is None else plan.t_s - self._steered.t_s
        elif plan.pitch_feedforward_m_s == eased:
            return None
        return None if self._steered is None else _eased(self._steered, plan, plan.t_s - self._late_s)


def _eased(command: TrackCommand, plan: MotionPlan, t_s: float) -> TrackCommand:
    """Return a command with the plan's easing, stamped anew, for its end is news too. Belts that are to stand do."""
    if command.brake:
        return command
    return TrackCommand(
        t_s=t_s, left_m_s=command.left_m_s + plan.pitch_feedforward_m_s, right_m_s=command.right_m_s + plan.pitch_feedforward_m_s
    )
