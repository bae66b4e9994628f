"""A planner's chair at a flight: it rests on the true ground, and a camera shows nosings that may be others."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from resting_chair import HALF_M, Nosing, RestingChair, flight, ground_of
from world import CHAIR, CONFIG, G_M_S2, RISE_M, RUN_M, SLOPE_RAD, Place, belts, estimate, imu, stair

from treadline.core.angles import DEG
from treadline.core.signals import MotionPlan, StairMap
from treadline.mission._situation import Situation
from treadline.mission.mission_config import MissionConfig
from treadline.mission.traversal import Traversal

TICK_S = 0.05
SEES_M = {True: (HALF_M, 2.8), False: (-3.2, -HALF_M)}
"""Distances ahead of mid-track between which a nosing is in view, going up and down: none above the pulley."""
Spoil = Callable[[StairMap], StairMap | None]


def steps(count: int, rise_m: float = RISE_M, run_m: float = RUN_M) -> list[Nosing]:
    """Return the nosings of an even flight that begins at zero."""
    return flight(*[(rise_m, run_m)] * count)


@dataclass(kw_only=True)
class World(Place):
    """A chair at a flight whose first nosing is at zero, its planner, and a camera that shows each tenth of a second."""

    up: bool = True
    nosings: Sequence[Nosing] = field(default_factory=lambda: steps(8))
    shown: Sequence[Nosing] | None = None
    """Nosings that the camera shows; None: the true ones."""
    away_m: float = 1.8
    """Distance of mid-track before the flight at the start, negative on it."""
    landing_m: float = 4.0
    """Depth of the landing, behind which there is nothing."""
    config: MissionConfig = CONFIG
    knows: bool = True
    """Whether the filter has a heading."""
    brake_on: bool = False
    grip: float = 0.5
    """Friction over tan β, less one."""
    slip: float = 0.0
    """Slip ratio of the belts."""
    flipper_moves: bool = True
    most_n_m: float = 200.0
    """Torque of the flipper's motor."""
    shows_end: bool = True
    spoil: Spoil = lambda seen: seen
    """What the camera makes of a map."""

    def __post_init__(self) -> None:
        self.shown = self.nosings if self.shown is None else self.shown
        self.planner = Traversal(replace(self.config, direction="up" if self.up else "down"))
        self.edge_m = self.nosings[-1][0]
        x_m = -self.away_m if self.up else self.edge_m + self.away_m
        pitch = SLOPE_RAD if self.away_m < 0.0 else 0.0
        ground = ground_of(self.nosings, self.landing_m)
        self.body = RestingChair(ground=ground, x_m=x_m, payload_kg=self.config.payload_kg, pitch_rad=pitch)
        self.t_s = self.turned = self.belts_m_s = self.speed_m_s = self.speeds_up_m_s2 = 0.0
        self.maps = 0
        self.plans: list[MotionPlan] = []
        self.xs: list[float] = []
        self._pose()

    def _pose(self) -> None:
        self.x_m, self.z_m, self.pitch_rad = self.body.x_m, self.body.pose.height_m, self.body.pitch_rad

    def run(self, *until: str, limit_s: float = 90.0) -> MotionPlan:
        """Tick until a phase has begun, or for the time given."""
        end_s = self.t_s + limit_s
        while self.t_s < end_s:
            plan = self.tick()
            if plan.phase in until:
                return plan
        assert not until, f"still in {plan.phase}: {plan.cause}"
        return plan

    def until_held(self, limit_s: float = 90.0) -> str:
        """Tick until the plan asks for a hold, and return its cause."""
        end_s = self.t_s + limit_s
        while (cause := self.tick().hold) is None:
            assert self.t_s < end_s, f"not held, {self.plans[-1].phase}: {self.plans[-1].cause}"
        return cause

    def to_the_end(self, limit_s: float = 120.0) -> MotionPlan:
        """Tick until the planner holds the chair or has ended."""
        end_s = self.t_s + limit_s
        while self.t_s < end_s:
            plan = self.tick()
            if plan.hold is not None or plan.phase in ("arrived", "refused"):
                return plan
        raise AssertionError(f"still in {plan.phase}: {plan.cause}")

    def tick(self) -> MotionPlan:
        if self.plans:
            self._move(self.plans[-1])
        for signal in self._senses():
            self.planner.update(signal)
        plan: MotionPlan = self.planner.step(self.t_s, estimate(self.t_s, self.heading_rad) if self.knows else None)
        self.plans.append(plan)
        self.xs.append(self.x_m)
        self.t_s = round(self.t_s + TICK_S, 6)
        return plan

    def _move(self, plan: MotionPlan) -> None:
        """Do what the last plan says: friction limits how fast the chair follows its belts on the flight."""
        goes = not self.brake_on and plan.hold is None
        wanted_m_s = plan.speed_m_s + plan.pitch_feedforward_m_s if goes else 0.0
        self.belts_m_s += (wanted_m_s - self.belts_m_s) * TICK_S / 0.1
        most = G_M_S2 * ((1.0 + self.grip) * math.tan(SLOPE_RAD) * math.cos(self.pitch_rad) - math.sin(self.pitch_rad))
        wanted = (self.belts_m_s * (1.0 - self.slip) - self.speed_m_s) / TICK_S
        self.speeds_up_m_s2 = max(min(wanted, most), -4.0) if self.pitch_rad > 0.1 else wanted
        self.speed_m_s += self.speeds_up_m_s2 * TICK_S
        rate = plan.flipper.rate_rad_s if goes and plan.flipper is not None else 0.0
        self.body.flipper_moves, self.body.most_n_m = self.flipper_moves, self.most_n_m
        self.body.move(self.speed_m_s * TICK_S * math.cos(self.heading_rad), rate, TICK_S)
        self._pose()
        turn_m_s = (self.heading_rad - plan.heading_rad) * -0.3 if plan.turn_m_s is None else plan.turn_m_s
        # A slip ratio that makes the chair turn at 1/1.6 of the belts' kinematic rate.
        self.turned = 2.0 * turn_m_s / CHAIR.tracks.gauge_m / 1.6 if goes else 0.0
        self.heading_rad += self.turned * TICK_S

    def _senses(self) -> list[Any]:
        rates = (0.0, 0.0, self.turned)
        signals: list[Any] = [
            belts(self.t_s, self.belts_m_s, self.belts_m_s, brake_on=self.brake_on),
            self.body.reading(self.t_s),
            imu(self.t_s, self.pitch_rad, rates_rad_s=rates, speeds_up_m_s2=self.speeds_up_m_s2),
        ]
        if round(self.t_s / TICK_S) % 2 == 0:
            self.maps += 1
            seen = self.spoil(self._camera())
            signals += [] if seen is None or len(seen.nosings_B) < min(2, len(self.shown)) else [seen]
        return signals

    def in_view(self) -> list[tuple[int, list[float]]]:
        """Return number and place of the nosings in view, the nearest first."""
        low, high = SEES_M[self.up]
        order = range(len(self.shown)) if self.up else reversed(range(len(self.shown)))
        return [(k, place) for k in order if low < (place := self.in_B(*self.shown[k]))[0] < high]

    def _camera(self) -> StairMap:
        seen = self.in_view()
        # A nosing further up would be in view; going down, the floor is.
        ends = seen[-1][1][0] < SEES_M[True][1] - 0.34 if self.up and seen else bool(seen) and seen[-1][0] == 0
        places = [place for _, place in seen]
        direction = "up" if self.up else "down"
        return stair(self.t_s, places, direction=direction, ends=self.shows_end and ends, left_seen_m=1.0, right_seen_m=1.0)

    @property
    def before_m(self) -> float:
        """Distance of the leading pulley before the flight, level."""
        return -self.x_m - HALF_M if self.up else self.x_m - self.edge_m - HALF_M

    @property
    def now(self) -> Situation:
        """What the planner knows."""
        return self.planner._tracker.now

    @property
    def phases(self) -> list[str]:
        return [plan.phase for k, plan in enumerate(self.plans) if k == 0 or plan.phase != self.plans[k - 1].phase]


def without(*numbers: int) -> Spoil:
    """Return a camera that misses some of the nosings that it would show, counted from the nearest."""
    return lambda seen: replace(seen, nosings_B=[place for k, place in enumerate(seen.nosings_B) if k not in numbers], ends=False)


def rising_by(rise_m: float, run_m: float = RUN_M, until_m: float = 0.0) -> Spoil:
    """Return a camera that measures another rise and run, for a level chair, while the nearest nosing is beyond a distance."""

    def measured(seen: StairMap) -> StairMap:
        nosings = np.array(seen.nosings_B)
        if not len(nosings) or abs(nosings[0, 0]) < until_m:
            return seen
        nosings[:, 0] = nosings[0, 0] + (nosings[:, 0] - nosings[0, 0]) * run_m / RUN_M
        nosings[:, 2] *= rise_m / RISE_M
        return replace(seen, nosings_B=nosings, rise_m=rise_m, run_m=run_m, slope_rad=math.atan2(rise_m, run_m))

    return measured


STEEPER = rising_by(0.20, 0.27)
JUST_TOO_HIGH_M = math.tan((32.0 + 1.0) * DEG) * RUN_M + 0.002
"""Rise above the limit of 32° and a degree of measurement error, by less than the deviation of the first maps from 2.4 m."""
