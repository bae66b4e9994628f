"""All messages to a guard, tick by tick: sound ones of every type, of which those of one type may be spoilt."""

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any

from world import TICK_S, belts, estimate, flipper, frame, heading, health, imu, limits, stair

from treadline.core.signals import (
    Event,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    PlantState,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
    VelocityCommand,
)
from treadline.guard import Guard

MADE: dict[type, Callable[[float], Any]] = {
    ImuSample: imu,
    TrackReading: belts,
    SeatReading: lambda t_s: SeatReading(t_s=t_s, pitch_rad=0.0, stroke_m=0.05),
    FlipperReading: lambda t_s: flipper(t_s, 0.7, 1.0),
    OperatorInput: lambda t_s: OperatorInput(t_s=t_s),
    PlantState: lambda t_s: PlantState(t_s=t_s, fault=None, battery_v=24.0),
    FrameQuality: lambda t_s: frame(t_s, obstacle_m=9.0),
    HeadingMeasurement: lambda t_s: heading(t_s, 0.01 * t_s),
    StairMap: lambda t_s: stair(t_s, [1.5 - 0.2 * t_s, 1.84 - 0.2 * t_s], obstacle_m=9.0, left_wall_m=1.0, right_seen_m=1.0),
    FreeGround: lambda t_s: FreeGround(
        t_s=t_s, view="front", blind_m=0.6, seen_m=2.0, end_m=None, sides_B=((1.5, -1.0, 0.0), (1.5, 1.0, 0.0))
    ),
    HeadingEstimate: estimate,
    HeadingHealth: lambda t_s: health(t_s, None, 0.0),
    MotionPlan: lambda t_s: MotionPlan(
        t_s=t_s, phase="climb", speed_m_s=0.2, min_inner_speed_ratio=0.5, flipper=FlipperCommand(t_s=t_s, rate_rad_s=0.1)
    ),
    TrackCommand: lambda t_s: TrackCommand(t_s=t_s, left_m_s=0.2, right_m_s=0.2),
    SeatCommand: lambda t_s: SeatCommand(t_s=t_s, rate_m_s=0.01),
    VelocityCommand: lambda t_s: VelocityCommand(t_s=t_s, speed_m_s=0.1, turn_rad_s=0.1),
}
"""A sound message of each type, of a chair that climbs at 0.2 m/s; the driver's commands have precedence over velocities."""
OUT = (Event, FlipperCommand)
"""Types that no block sends to the guard: its own events, and a command that is part of the plan."""
OF_CAMERA = (FrameQuality, HeadingMeasurement, StairMap, FreeGround)
PROPOSED = (TrackCommand, SeatCommand, MotionPlan)
"""Requests, which the guard may also limit."""
HOLD_S = {
    ImuSample: 1.0,
    TrackReading: 0.3,
    SeatReading: 0.3,
    FlipperReading: 0.3,
    OperatorInput: 0.3,
    FrameQuality: 3.0,
    FreeGround: 6.8,
    HeadingMeasurement: 3.5,
    HeadingEstimate: 0.3,
    HeadingHealth: 0.3,
    MotionPlan: 0.3,
    TrackCommand: 0.75,
}
"""Stated time from the last sound message of a type to the hold [s] (docs/explanation/safety.md; a stair out of view: 12 s, here
3.5 s; ground seen 1.9 m ahead at 0.2 m/s: 6.8 s); a message of another type must have no effect."""
BEGAN_S = 1.0
Spoil = Callable[[Any], list[Any]]


class Traffic:
    """All messages to a guard, tick by tick; those of one type are spoilt from ``began_s`` on."""

    def __init__(self, kind: type, spoil: Spoil, *, has_images: bool = True) -> None:
        self.guard = Guard(limits(has_planner=True, lost_timeout_s=3.5, awaits_ground=True, awaits_health=True))
        self.kind, self.spoil, self.has_images = kind, spoil, has_images
        self.tick, self.began_s = 0, BEGAN_S
        self.estimate: HeadingEstimate | None = None

    def step(self) -> tuple[float | None, ...]:
        """Return what leaves at the next tick: belts, brake, seat and flipper."""
        t_s = self.tick * TICK_S
        self.guard.advance(t_s)
        for kind, made in MADE.items():
            if kind in OF_CAMERA and (self.tick % 10 or (kind is FrameQuality and not self.has_images)):
                continue
            spoilt = kind is self.kind and t_s > self.began_s
            for message in self.spoil(made(t_s)) if spoilt else [made(t_s)]:
                self.send(message)
        tracks, seat, up = self.guard.step(t_s, self.estimate)
        self.tick += 1
        return tracks.left_m_s, tracks.right_m_s, tracks.brake, seat.rate_m_s, None if up is None else up.rate_rad_s

    def send(self, message: Any) -> None:
        """Deliver a message by the guard's entrance for its type."""
        match message:
            case HeadingEstimate():
                self.estimate = message
            case TrackCommand() | SeatCommand() | VelocityCommand():
                self.guard.propose(message)
            case HeadingHealth() | MotionPlan():
                self.guard.on_message(message)
            case HeadingMeasurement() | StairMap() if self.has_images:
                self.guard.on_message(message)
            case _:
                self.guard.admit(message)

    def run(self, seconds: float) -> list[tuple[float | None, ...]]:
        """Return what leaves in so many seconds."""
        return [self.step() for _ in range(round(seconds / TICK_S))]


def numbers(message: Any) -> Iterator[str | tuple[str, int]]:
    """Yield the places of the numbers of a message, those of tuples and of commands within it too."""
    for field in fields(message):
        value = getattr(message, field.name)
        if field.name == "t_s" or isinstance(value, bool | str):
            continue
        if isinstance(value, float | int):
            yield field.name
        elif isinstance(value, tuple) or is_dataclass(value):
            yield field.name, 0


def with_number(message: Any, place: str | tuple[str, int], value: float) -> Any:
    """Return a message with one number replaced."""
    if isinstance(place, str):
        return replace(message, **{place: value})
    held = getattr(message, place[0])
    if is_dataclass(held):
        return replace(message, **{place[0]: replace(held, rate_rad_s=value)})  # type: ignore[type-var]
    first = (value, *held[0][1:]) if isinstance(held[0], tuple) else value
    return replace(message, **{place[0]: (first, *held[1:])})


def sound(message: Any) -> list[Any]:
    """Return a message as it is."""
    return [message]
