"""A chair without dynamics that climbs a flight, and a stand-in for the crest sequence."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from world import CHAIR, CONFIG, G_M_S2, PITCH_M, PIVOT_M, RISE_M, RUN_M, SLOPE_RAD, TICK_S, World

from treadline.control.crest_sequence import CrestCommand
from treadline.core.angles import DEG
from treadline.core.signals import FlipperCommand, FlipperReading, ImuSample, MotionPlan, StairMap, TrackReading
from treadline.estimation.known_nosings import KnownNosings
from treadline.mission.ascent_states import Ascent

SEES_M = 2.8
"""Reach of the camera, of which nothing nearer than the front pulley is in view."""


@dataclass(kw_only=True)
class Foot(World):
    """A chair before a flight, a camera over its front; friction limits how fast it follows its belts on the flight."""

    DIRECTION = "up"

    planner: Ascent = field(default_factory=lambda: Ascent(CONFIG))
    first_m: float = 1.8
    grip: float = 0.5
    """Friction over tan β, less one."""
    slip: float = 0.0
    """Slip ratio of the belts on the floor."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.speed = 0.0
        self.flipper_rad = CHAIR.tracks.approach_angle_deg * DEG
        self.xs: list[float] = []

    def tick(self) -> MotionPlan:
        plan = super().tick()
        self.xs.append(self.x_m)
        return plan

    def move(self, plan: MotionPlan) -> None:
        self.belts_m_s += (plan.speed_m_s - self.belts_m_s) * TICK_S / 0.1
        most = G_M_S2 * ((1.0 + self.grip) * math.tan(SLOPE_RAD) * math.cos(self.pitch_rad) - math.sin(self.pitch_rad))
        wanted = (self.belts_m_s * (1.0 - self.slip) - self.speed) / TICK_S
        self.speeds_up_m_s2 = max(min(wanted, most), -4.0) if self.pitch_rad > 0.1 else wanted
        self.speed += self.speeds_up_m_s2 * TICK_S
        self.x_m += self.speed * TICK_S * math.cos(self.pitch_rad) * math.cos(self.heading_rad)
        self.z_m += self.speed * TICK_S * math.sin(self.pitch_rad)
        begins, lies = self.first_m - PIVOT_M, self.first_m + 0.10
        if self.x_m > begins:
            self.pitch_rad = SLOPE_RAD * min((self.x_m - begins) / (lies - begins), 1.0)
        elif self.plans:
            self.pitch_rad = 0.0
        self.turn((self.heading_rad - plan.heading_rad) * -0.3 if plan.turn_m_s is None else plan.turn_m_s)
        if plan.flipper is not None and self.flipper_moves:
            self.flipper_rad += plan.flipper.rate_rad_s * TICK_S

    def in_view(self, x_m: float) -> bool:
        return PIVOT_M < x_m < SEES_M

    def ends(self, nosings: list[tuple[int, list[float]]]) -> bool:
        return nosings[-1][1][0] < SEES_M - PITCH_M  # a further nosing would be in view

    @property
    def before_m(self) -> float:
        """Of the front pulley before the first nosing, level."""
        return self.first_m - self.x_m - PIVOT_M


class Script:
    """Stand-in for the crest sequence: plays stages, and keeps its inputs."""

    made: "list[Script]" = []  # noqa: RUF012  (each test empties it)
    SPEED_M_S = 0.05
    stages: tuple[str, ...] = ("climb", "slow", "reach", "carry", "lead", "land", "done")

    def __init__(self, loading: Any, cruise_m_s: float, around: KnownNosings) -> None:
        self.loading, self.cruise_m_s, self.ahead_m = loading, cruise_m_s, around.top.ahead_m
        self.steps = 0
        Script.made.append(self)

    def step(self, imu: ImuSample, flipper: FlipperReading, tracks: TrackReading, around: KnownNosings) -> CrestCommand:
        del flipper, tracks, around
        stage: Any = self.stages[min(self.steps // 10, len(self.stages) - 1)]
        self.steps += 1
        still = FlipperCommand(t_s=imu.t_s, rate_rad_s=0.0)
        return CrestCommand(t_s=imu.t_s, stage=stage, speed_m_s=self.SPEED_M_S, flipper=still, tip_n=90.0, is_unloaded=False)


def rising_by(rise_m: float, until_m: float = 0.0) -> Callable[[StairMap], StairMap]:
    """Return a camera that measures another rise, nosings included, while the nearest nosing is beyond ``until_m``."""

    def measured(seen: StairMap) -> StairMap:
        if not len(seen.nosings_B) or seen.nosings_B[0][0] < until_m:
            return seen
        return replace(
            seen,
            nosings_B=np.array(seen.nosings_B) * [1.0, 1.0, rise_m / RISE_M],
            rise_m=rise_m,
            slope_rad=math.atan2(rise_m, RUN_M),
        )

    return measured


JUST_TOO_HIGH_M = math.tan((32.0 + 1.0) * DEG) * RUN_M + 0.002
"""Rise above the limit of 32° and a degree of measurement error, by less than the deviation of the first maps from 2.4 m."""
