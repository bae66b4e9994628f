"""A sound drive up a flight, tick by tick, in which a test puts a fault: all messages to the guard, and belts that obey."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from world import PITCH_M, SLOPE_RAD, TICK_S, belts, estimate, flipper, frame, heading, health, imu, limits, stair

from treadline.core.angles import DEG
from treadline.core.signals import (
    FlipperCommand,
    FreeGround,
    MotionPlan,
    OperatorInput,
    PlantState,
    SeatCommand,
    SeatReading,
    TrackCommand,
    VelocityCommand,
)
from treadline.guard import Guard

FRAME_TICKS = 10
LAG_S, ACCELERATION_M_S2, BRAKE_M_S2 = 0.15, 4.0, 10.0
"""Drives of the shipped chair."""
PROPOSED = (TrackCommand, SeatCommand, VelocityCommand)
READINGS = ("imu", "belts", "seat", "flipper", "camera", "ground", "operator", "plant")


class Drive:
    """A chair that climbs at 0.2 m/s, and what it says; ``spoil`` swallows or changes a message, ``silent`` names what ceases."""

    def __init__(self, **changes: Any) -> None:
        declared = {"has_planner": True, "awaits_ground": True, "awaits_map": True, "awaits_health": True}
        self.guard = Guard(limits(**declared | changes))
        self.tick = self.steps = 0
        self.asked = (0.2, 0.2)
        self.phase: Any = "climb"
        self.needs_stair = True
        self.plan: Any = {"speed_m_s": 0.2}
        """Further values of the plan."""
        self.pitch_rad, self.heading_deg = SLOPE_RAD, 0.0
        self.speeds, self.travel_m, self.slip, self.passed_m, self.furthest_m = [0.0, 0.0], 0.0, 0.0, 0.0, 0.0
        self.passed = TrackCommand.stop(0.0)
        self.seat, self.flipper = SeatCommand(t_s=0.0, rate_m_s=0.0), None
        self.seat_m_s: float | None = None
        """Rate that the leveller asks for at each tick; None: none."""
        self.gap_m, self.gap_at_m, self.wall_at_m, self.ends_at_m = 0.0, math.inf, math.inf, math.inf
        self.heal()

    def heal(self) -> None:
        """Take the fault away; what lies ahead stays."""
        self.silent: set[str] = set()
        self.spoil: Callable[[str, Any], Any] = lambda _, message: message
        self.slip, self.heading_deg = 0.0, 0.0

    @property
    def t_s(self) -> float:
        return self.tick * TICK_S

    @property
    def mean_m_s(self) -> float:
        return 0.5 * (self.passed.left_m_s + self.passed.right_m_s)

    def move(self) -> None:
        """Let the belts follow their command, and the nosings pass as the belts run, less what slips."""
        brake, most_m_s2 = self.passed.brake, BRAKE_M_S2 if self.passed.brake else ACCELERATION_M_S2
        for side, asked in enumerate((self.passed.left_m_s, self.passed.right_m_s)):
            change = (asked - self.speeds[side]) * (1.0 if brake else 1.0 - math.exp(-TICK_S / LAG_S))
            self.speeds[side] += min(max(change, -most_m_s2 * TICK_S), most_m_s2 * TICK_S)
        driven_m = 0.5 * sum(self.speeds) * TICK_S
        self.travel_m += driven_m
        self.passed_m += driven_m * (1.0 - self.slip)
        self.furthest_m = max(self.furthest_m, self.passed_m)

    def nosings(self) -> list[float]:
        """Return the distances of the nosings in view; the step at ``gap_at_m`` is ``gap_m`` longer."""
        places = [0.1 + k * PITCH_M + (self.gap_m if 0.1 + k * PITCH_M > self.gap_at_m else 0.0) for k in range(-20, 80)]
        return [place - self.passed_m for place in places if 0.7 < place - self.passed_m < 2.4]

    def messages(self) -> dict[str, Any]:
        """Return what is said at this tick, by its source."""
        t_s, far_m = self.t_s, -self.travel_m if self.guard.config.view == "rear" else self.travel_m
        ahead_m = self.wall_at_m - far_m
        turn, up = math.sin(0.7 * t_s), FlipperCommand(t_s=t_s, rate_rad_s=0.1)
        said: dict[str, Any] = {
            "operator": OperatorInput(t_s=t_s),
            "plant": PlantState(t_s=t_s, fault=None, battery_v=24.0),
            "imu": imu(t_s, self.pitch_rad),
            "belts": belts(t_s, *self.speeds, brake_on=self.passed.brake),
            "seat": SeatReading(t_s=t_s, pitch_rad=0.0, stroke_m=0.05),
            "flipper": flipper(t_s, 0.7, 1.0),
            "health": health(t_s),
            "plan": MotionPlan(t_s=t_s, phase=self.phase, needs_stair=self.needs_stair, flipper=up, **self.plan),
            "driver": TrackCommand(t_s=t_s, left_m_s=self.asked[0], right_m_s=self.asked[1]),
        }
        if self.seat_m_s is not None:
            said["leveller"] = SeatCommand(t_s=t_s, rate_m_s=self.seat_m_s)
        if self.tick % FRAME_TICKS == 0:
            ends_m = self.ends_at_m - far_m
            said["camera"] = frame(t_s, obstacle_m=ahead_m if 0.6 < ahead_m < 3.5 else None)
            said["ground"] = FreeGround(
                t_s=t_s,
                view=self.guard.config.view,
                blind_m=0.8,
                seen_m=min(max(ends_m, 0.8), 2.5),
                end_m=ends_m if 0.8 < ends_m < 2.5 else None,
            )
            said["heading"] = heading(t_s, 0.01 * turn)
            if self.pitch_rad > 0.1:
                said["map"] = stair(t_s, self.nosings(), obstacle_m=ahead_m if 0.6 < ahead_m < 3.5 else None)
        return said

    def send(self, source: str, message: Any) -> None:
        """Deliver a message by the guard's entrance for its source."""
        if isinstance(message, PROPOSED):
            self.guard.propose(message)
        elif source in READINGS:
            self.guard.admit(message)
        else:
            self.guard.on_message(message)

    def step(self) -> TrackCommand:
        t_s = self.t_s
        self.guard.advance(t_s)
        self.move()
        for source, message in self.messages().items():
            spoilt = None if source in self.silent else self.spoil(source, message)
            if spoilt is not None:
                self.send(source, spoilt)
        seen = None if "estimate" in self.silent else estimate(t_s, self.heading_deg * DEG)
        self.passed, self.seat, self.flipper = self.guard.step(t_s, seen)
        self.tick, self.steps = self.tick + 1, self.steps + 1
        return self.passed

    def run(self, seconds: float, each: Callable[["Drive"], None] = lambda _: None) -> "Drive":
        """Go on; the chair that is held stays so."""
        for _ in range(round(seconds / TICK_S)):
            each(self)
            self.step()
        return self

    def ticks_until_held(self, most: int, each: Callable[["Drive"], None]) -> int | None:
        """Return the number of ticks to the hold; None without one within ``most``."""
        for tick in range(most):
            each(self)
            self.step()
            if self.guard.holding is not None:
                return tick
        return None

    def press(self, **values: bool) -> None:
        """Let the operator's handset say something between two ticks, and then that nothing is pressed any more."""
        self.guard.advance(self.t_s)
        self.guard.admit(OperatorInput(t_s=self.t_s - 0.005, **values))

    def events(self) -> list[tuple[str, str]]:
        """Return the events since the last call."""
        return [(event.name, event.cause) for event in self.guard.take_events()]


def spoils(source: str, **changes: Any) -> Callable[[str, Any], Any]:
    """Return what replaces values in the messages of one source."""
    return lambda said, message: replace(message, **changes) if said == source else message
