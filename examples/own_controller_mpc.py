"""Write your own controller: model predictive control of the heading, a bounded least-squares problem per period.

python examples/own_controller_mpc.py
treadline climb up-28 --controller examples/own_controller_mpc.py:HeadingMpc --out runs/mpc
"""

import numpy as np
from scipy.optimize import lsq_linear

import treadline as tl
from treadline.control.belt_allocation import BeltLimits, back_safe, climb_safe
from treadline.core.signals import TrackCommand

HORIZON, PRICE = 12, 0.3  # periods; price of a belt difference [rad per m/s]


class HeadingMpc:
    follows_plan = True  # run the full traversal, not one flight alone
    period_s = 0.25

    def __init__(self, config):  # a MissionConfig: chair, payload, speed
        self.max_speed_m_s = config.chair.drives.max_speed_m_s
        turn = self.period_s / config.chair.tracks.gauge_m * np.tri(HORIZON)  # d/gauge is the yaw rate without slip
        self.cost = np.vstack([turn, PRICE * np.eye(HORIZON)])

    def step(self, estimate, t_s, plan):  # HeadingEstimate | None, float, MotionPlan -> TrackCommand
        if estimate is None or plan.turn_m_s is not None:  # unknown heading, or the plan itself turns the chair
            return TrackCommand.stop(t_s)
        error = np.full(HORIZON, plan.heading_rad - estimate.heading_rad)
        d = lsq_linear(self.cost, np.concatenate([error, np.zeros(HORIZON)]), bounds=(-0.6, 0.6)).x[0]
        limits = BeltLimits(climb_speed_m_s=abs(plan.speed_m_s), max_speed_m_s=self.max_speed_m_s)
        left, right = (climb_safe if plan.speed_m_s >= 0.0 else back_safe)(np.array([-0.5, 0.5]) * d, limits)
        return TrackCommand(t_s=t_s, left_m_s=float(left), right_m_s=float(right))


if __name__ == "__main__":
    print(
        tl.climb(tl.Scenario.model_validate({"stair": {"steps": 6}, "sensors": {"camera": "statistical"}}), controller=HeadingMpc)
    )
