"""Write your own controller: a PID on the heading in place of the LQR, from floor to landing.

python examples/own_controller_pid.py
treadline climb up-28 --controller examples/own_controller_pid.py:HeadingPid --out runs/pid
"""

import numpy as np

import treadline as tl
from treadline.control.belt_allocation import BeltLimits, back_safe, climb_safe
from treadline.core.signals import TrackCommand

KP, KI, KD = 1.6, 0.2, 0.3  # m/s per rad, per rad·s and per rad/s


class HeadingPid:
    follows_plan = True  # run the full traversal, not one flight alone
    period_s = 0.25

    def __init__(self, config):  # a MissionConfig: chair, payload, speed
        self.max_speed_m_s = config.chair.drives.max_speed_m_s
        self.integral = 0.0

    def step(self, estimate, t_s, plan):  # HeadingEstimate | None, float, MotionPlan -> TrackCommand
        if estimate is None or plan.turn_m_s is not None:  # unknown heading, or the plan itself turns the chair
            self.integral = 0.0
            return TrackCommand.stop(t_s)
        error = plan.heading_rad - estimate.heading_rad
        self.integral = min(max(self.integral + error * self.period_s, -0.5), 0.5)
        difference = KP * error + KI * self.integral - KD * estimate.heading_rate_rad_s
        limits = BeltLimits(climb_speed_m_s=abs(plan.speed_m_s), max_speed_m_s=self.max_speed_m_s)
        allocate = climb_safe if plan.speed_m_s >= 0.0 else back_safe
        left, right = allocate(np.array([-0.5, 0.5]) * difference, limits)
        return TrackCommand(t_s=t_s, left_m_s=float(left), right_m_s=float(right))


if __name__ == "__main__":
    print(tl.climb("up-28", HeadingPid, set={"stair.steps": 6, "sensors.camera": "statistical"}))
