"""Place of the chair on a landing: an extended Kalman filter of pose and centre of turns, by belts, gyro and the sides in view.

``HeadingEstimate, TrackReading, FreeGround -> pose``. Belts that turn on the spot skid about a centre ahead of mid-track, which
moves with load and friction: mid-track swings to the outer side. The sides that are in view, edges, walls and risers, are those of
the landing's plan; they correct the pose, and identify that centre, because its error grows with each degree of the turn.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.rotations import Vector3
from treadline.core.signals import FreeGround, Recent
from treadline.vehicle.flight_plan import FlightPlan

PLACE_SIGMA_M, ASIDE_SIGMA_M, HEADING_SIGMA_RAD, CENTRE_SIGMA_M = 0.03, 0.10, 2.0 * DEG, 0.04
"""Standard deviations at the start of a turn: place along the flight, as of the follower of ways over its end; place aside, which
is not tracked on a flight; heading; and centre of turns, by payloads of 20 to 110 kg [m, rad]."""
SLIDES_M_RTS, TURNS_RAD_RTS, CENTRE_M_RTS = 0.01, 0.3 * DEG, 0.01
"""Random walks in a second of motion: place and centre [m], and heading [rad]. Half of each and half as much again change a turn by
0.1 s, 0.6 cm and 0.1° (docs/evidence/building-stairs.md)."""
SIDE_SIGMA_M = 0.03
"""Standard deviation of the end of a side [m]: three times that of one frame, for frames share errors."""
SAME_SIDE_M, SAME_RAD = 0.25, 15.0 * DEG
"""Distance and angle from a side of the plan within which a side in view is that one: two and a half deviations aside."""


class LandingPlace:
    """Pose of mid-track on a landing, in the frame of the flight below from the landing's nosing, and the centre of turns.

    Args:
        plan: Plan of the landing.
        width_m: Width of the flights.
        pose: Place [m] and heading [rad] at the start.
        centre_m: Expected distance of the centre of turns ahead of mid-track.
    """

    def __init__(self, plan: FlightPlan, width_m: float, pose: Vector3, centre_m: float) -> None:
        turned = (math.cos(plan.turn_rad), math.sin(plan.turn_rad))
        foot = float(plan.foot(width_m).mean(axis=0) @ turned)
        self._lines = (
            (1.0, 0.0, plan.depth_m),
            (1.0, 0.0, 0.0),
            (0.0, 1.0, plan.right_m),
            (0.0, 1.0, plan.left_m),
            (*turned, foot),
        )
        """Normal and distance of each side's line, the next flight's foot among them."""
        self._state = np.array([*pose, centre_m])
        self._P = np.diag([PLACE_SIGMA_M, ASIDE_SIGMA_M, HEADING_SIGMA_RAD, CENTRE_SIGMA_M]) ** 2
        self._recent: Recent[Vector3] = Recent()

    @property
    def centre_m(self) -> float:
        """Distance of the centre of turns ahead of mid-track."""
        return float(self._state[3])

    @property
    def centre(self) -> Vector3:
        """Place of the centre of turns [m], and heading [rad]."""
        x, y, heading, ahead_m = self._state
        return np.array([x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading), heading])

    def move(self, t_s: float, dt_s: float, speed_m_s: float, rate_rad_s: float) -> None:
        """Move by the mean belt speed and the gyro: the centre of turns goes along the chair, mid-track also aside."""
        _, _, heading, ahead_m = self._state
        c, s = math.cos(heading), math.sin(heading)
        along_m, turned_rad = speed_m_s * dt_s, rate_rad_s * dt_s
        aside_m = -ahead_m * turned_rad
        self._state += (c * along_m - s * aside_m, s * along_m + c * aside_m, turned_rad, 0.0)
        F = np.eye(4)
        F[0, 2:], F[1, 2:] = (-s * along_m - c * aside_m, s * turned_rad), (c * along_m - s * aside_m, -c * turned_rad)
        moves = float(along_m != 0.0 or abs(turned_rad) > 1e-4 * dt_s)
        walks = np.array([SLIDES_M_RTS, SLIDES_M_RTS, TURNS_RAD_RTS, CENTRE_M_RTS])
        self._P = F @ self._P @ F.T + np.diag(moves * dt_s * walks**2)
        self._recent.add(t_s, self._state[:3].copy())

    def look(self, ground: FreeGround) -> None:
        """Correct by the sides of one frame, from where the chair was when it was exposed."""
        exposed = self._recent.at(ground.t_s)
        if exposed is None:
            return
        for ends in zip(ground.sides_B[::2], ground.sides_B[1::2], strict=True):
            moved = self._state[:3] - exposed
            self._see(np.array(ends)[:, :2], self._state[:3] - moved, moved)

    def _see(self, ends_B: Float[np.ndarray, "2 2"], pose: Vector3, moved: Vector3) -> None:
        """Correct by one side; ``moved`` is the motion since the frame."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        ends_F = ends_B @ np.array([[c, s], [-s, c]])
        along = ends_F[1] - ends_F[0]
        off_m, line = min((self._off_m(along, pose[:2] + ends_F.mean(axis=0), line), line) for line in self._lines)
        if off_m > SAME_SIDE_M:
            return
        normal = np.array(line[:2])
        for end in ends_F:
            H = np.array([*normal, normal @ (-end[1], end[0]), 0.0])
            gain = self._P @ H / (H @ self._P @ H + SIDE_SIGMA_M**2)
            self._state += gain * (line[2] - normal @ (self._state[:2] - moved[:2] + end))
            self._P = self._P - np.outer(gain, H @ self._P)

    def _off_m(self, along: Float[np.ndarray, " 2"], middle: Float[np.ndarray, " 2"], line: tuple[float, float, float]) -> float:
        """Return the distance of a side's middle from a line; infinite if they are not parallel."""
        turned_rad = wrap(2.0 * (math.atan2(along[1], along[0]) - math.atan2(-line[0], line[1]))) / 2.0
        return abs(float(middle @ line[:2]) - line[2]) if abs(turned_rad) < SAME_RAD else math.inf
