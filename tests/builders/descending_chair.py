"""A chair without dynamics that backs down a flight, and a stand-in for the edge sequence."""

import math
from dataclasses import dataclass, field
from typing import Any

from world import CONFIG, PIVOT_M, RISE_M, RUN_M, SLOPE_RAD, TICK_S, World

from treadline.control.edge_sequence import EdgeCommand
from treadline.core.signals import FlipperCommand, FlipperReading, ImuSample, MotionPlan, TrackReading
from treadline.estimation.known_nosings import KnownNosings
from treadline.mission.descent_states import Descent

STEPS = 8
EDGE_M = (STEPS - 1) * RUN_M
"""Where the last nosing stands, the landing's edge; the first stands at zero."""


@dataclass(kw_only=True)
class Landing(World):
    """A chair on a landing, facing up, its camera looking back over the flight."""

    DIRECTION = "down"

    planner: Descent = field(default_factory=lambda: Descent(CONFIG))
    x_m: float = EDGE_M + 1.6
    tips: bool = True
    """Whether it pitches over the edge."""
    shows_end: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        self.z_m = STEPS * RISE_M
        if self.x_m < EDGE_M:
            self.z_m, self.pitch_rad = (self.x_m / RUN_M + 1.0) * RISE_M, SLOPE_RAD

    def move(self, plan: MotionPlan) -> None:
        self.belts_m_s = plan.speed_m_s
        moved = plan.speed_m_s * TICK_S
        if plan.flipper is not None and self.flipper_moves:
            self.flipper_rad = min(self.flipper_rad + plan.flipper.rate_rad_s * TICK_S, 0.7)
        self.x_m += moved * math.cos(self.pitch_rad) * math.cos(self.heading_rad)
        self.z_m += moved * math.sin(self.pitch_rad)
        if self.z_m < 0.0 or self.x_m < 0.0:
            # The rear has reached the floor: the pitch goes with the way that is left to where mid-track leaves the first nosing.
            self.pitch_rad = SLOPE_RAD * min(max((self.x_m + PIVOT_M) / PIVOT_M, 0.0), 1.0)
        elif self.tips and EDGE_M - 0.05 < self.x_m < EDGE_M and plan.phase in ("edge", "descend"):
            self.pitch_rad = SLOPE_RAD
        self.turn(self.heading_rad * -0.3 if plan.turn_m_s is None else plan.turn_m_s)

    def in_view(self, x_m: float) -> bool:
        return -3.2 < x_m < -PIVOT_M

    @property
    def before_m(self) -> float:
        """Of the rear pulley before the edge, level."""
        return self.x_m - EDGE_M - PIVOT_M

    def ends(self, nosings: list[tuple[int, list[float]]]) -> bool:
        return self.shows_end and nosings[-1][0] == 0


class Script:
    """Stand-in for the edge sequence: approaches, then plays stages, and keeps its inputs."""

    made: "list[Script]" = []  # noqa: RUF012  (each test empties it)
    stages: tuple[str, ...] = ("press", "lift", "settle", "leave", "done")

    def __init__(self, loading: Any, around: KnownNosings) -> None:
        self.loading, self.around = loading, around
        self.steps = 0
        Script.made.append(self)

    @property
    def behind_m(self) -> float:
        return -self.around.top.ahead_m

    def refusal(self, around: KnownNosings, sigmas: float) -> str:
        del around, sigmas
        return "the flipper is too short" if "refuses" in self.stages else ""

    def turn_back(self) -> bool:
        """As a flipper does that can still let the chair down again."""
        can = self.stages[min(self.steps // 10, len(self.stages) - 1)] in ("press", "lift")
        self.stages = ("lower", "barred") if can else self.stages
        return can or "barred" in self.stages

    def step(self, imu: ImuSample, flipper: FlipperReading, tracks: TrackReading, around: KnownNosings) -> EdgeCommand:
        del flipper, tracks
        self.around = around
        near = self.behind_m < 0.02
        stage: Any = self.stages[min(self.steps // 10, len(self.stages) - 1)] if near else "approach"
        self.steps += near
        still = FlipperCommand(t_s=imu.t_s, rate_rad_s=0.1)
        return EdgeCommand(t_s=imu.t_s, stage=stage, speed_m_s=-0.1, flipper=still, tip_n=90.0, is_unloaded=False)
