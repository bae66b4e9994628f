"""The guard in a world: a wall, a drop or a gap at a known place, and a camera whose messages come late, lost, repeated, swapped or
flickering. Each message is made from the chair's true place at its exposure, and the guard alone stops the chair.
"""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from world import SLOPE_RAD, TICK_S, belts, estimate, flipper, frame, heading, health, imu, limits, stair

from treadline.core.signals import (
    FreeGround,
    HeadingHealth,
    MotionPlan,
    OperatorInput,
    SeatReading,
    StairMap,
    TrackCommand,
    VelocityCommand,
)
from treadline.guard import Guard

FRONT_M, REAR_M, PULLEY_M, SPAN_M = 0.995, 0.55, 0.475, 0.95
"""Reach of the shipped chair from mid-track, place of its pulleys, and flat run of its belts, from its chair file."""
LEFT_M = 0.30
"""Distance that must be left to a wall or drop: row 25 of the table of hazards."""
GAP_LEFT_M = 0.20
"""Distance that must be left to a gap: row 17."""
PITCH_M = 0.34
"""Distance of the nosings of a flight of 160/300 mm."""
LAG_S, ACCELERATION_M_S2, BRAKE_M_S2 = 0.15, 4.0, 10.0
"""Drives of the shipped chair."""
FLAT_PHASES = ("search", "align", "approach", "mount", "traction", "back_off", "land", "leave", "joystick")
"""Phases in which a chair may meet a wall or a drop on flat ground, and a person's joystick without a traversal."""


@dataclass
class World:
    """A chair that is driven on at a speed, whatever is ahead; distances are ahead of its mid-track at the start."""

    rng: np.random.Generator
    speed_m_s: float = 0.2
    phase: str = "land"
    wall_m: float = math.inf
    drop_m: float = math.inf
    gap_m: float = math.inf
    sees: str = "both"
    """Whether frames, maps or both show the wall."""
    rear: bool = False
    """Whether the chair backs, with a camera that looks to the rear."""
    latency_s: float = 0.0
    jitter_s: float = 0.0
    """Standard deviation of the latency: messages may overtake each other."""
    loss: float = 0.0
    repeats: float = 0.0
    shows: Callable[[int], bool] = lambda _: True
    """Whether the frame of a number shows what is ahead."""
    lacks: tuple[type, ...] = ()
    """Types of messages that never come."""
    direction: str = "up"
    x_m: float = 0.0
    tick: int = 0
    held: str | None = None
    events: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.is_on_flight = self.gap_m < math.inf or self.phase == "climb"
        driven = self.phase == "joystick"
        flat, view = not self.is_on_flight, "rear" if self.rear else "front"
        declared: dict[str, Any] = {"awaits_ground": flat, "awaits_map": not flat, "awaits_health": True, "view": view}
        self.guard = Guard(limits(has_planner=not driven, watches_slip=False, **declared))
        self.belts_m_s, self.asked_m_s, self.braked = 0.0, 0.0, False
        self.places_m: list[float] = []
        self.coming: list[tuple[float, Any, bool]] = []

    @property
    def lead_m(self) -> float:
        return REAR_M if self.rear else FRONT_M

    def run(self, seconds: float) -> "World":
        """Drive until the guard holds, or for a time."""
        for _ in range(round(seconds / TICK_S)):
            self.step()
            if self.guard.holding is not None and self.belts_m_s == 0.0:
                break
        self.held = self.guard.holding
        return self

    def step(self) -> None:
        t_s, sign = self.tick * TICK_S, -1.0 if self.rear else 1.0
        if self.braked:
            self.belts_m_s -= math.copysign(min(abs(self.belts_m_s), BRAKE_M_S2 * TICK_S), self.belts_m_s)
        else:
            change = (1.0 - math.exp(-TICK_S / LAG_S)) * (self.asked_m_s - self.belts_m_s)
            self.belts_m_s += min(max(change, -ACCELERATION_M_S2 * TICK_S), ACCELERATION_M_S2 * TICK_S)
        self.x_m += self.belts_m_s * TICK_S
        self.places_m.append(self.x_m)
        guard = self.guard
        guard.advance(t_s)
        for reading in self.readings(t_s):
            guard.admit(reading)
        if self.tick % 10 == 0:
            self.expose(t_s)
        self.deliver(t_s)
        if HeadingHealth not in self.lacks:
            guard.on_message(health(t_s))
        # It stands until what was exposed at the start has arrived.
        speed = sign * self.speed_m_s if t_s > self.latency_s + 1.0 else 0.0
        if self.phase == "joystick":
            guard.propose(VelocityCommand(t_s=t_s, speed_m_s=speed, turn_rad_s=0.0))
        else:
            plan: Any = self.phase
            guard.on_message(MotionPlan(t_s=t_s, phase=plan, speed_m_s=speed, needs_stair=False))
            guard.propose(TrackCommand(t_s=t_s, left_m_s=speed, right_m_s=speed))
        out = guard.step(t_s, estimate(t_s)).tracks
        self.asked_m_s, self.braked = 0.5 * (out.left_m_s + out.right_m_s), out.brake
        self.events += guard.take_events()
        self.tick += 1

    def readings(self, t_s: float) -> Sequence[Any]:
        pitch = SLOPE_RAD if self.is_on_flight else 0.0
        return (
            OperatorInput(t_s=t_s),
            imu(t_s, pitch, rates_rad_s=(0.0, 0.0, 1e-3 * math.sin(7.0 * t_s))),
            belts(t_s, self.belts_m_s, self.belts_m_s, brake_on=self.braked),
            SeatReading(t_s=t_s, pitch_rad=0.0, stroke_m=0.05),
            flipper(t_s, 0.7),
        )

    def expose(self, t_s: float) -> None:
        """Expose a frame, and plan when what it shows arrives."""
        if self.rng.random() < self.loss:
            return
        delay_s = max(self.latency_s + self.jitter_s * self.rng.standard_normal(), 0.0)
        times = 2 if self.rng.random() < self.repeats else 1
        messages = [item for item in self.frame(t_s, shows=self.shows(self.tick // 10)) if not isinstance(item[0], self.lacks)]
        self.coming += [(t_s + min(delay_s, 2.9) + 0.05 * again, *message) for again in range(times) for message in messages]

    def deliver(self, t_s: float) -> None:
        due = [item for item in self.coming if item[0] <= t_s + 1e-9]
        self.coming = [item for item in self.coming if item[0] > t_s + 1e-9]
        for _, message, is_reading in sorted(due, key=lambda item: item[0]):
            (self.guard.admit if is_reading else self.guard.on_message)(message)

    def frame(self, t_s: float, *, shows: bool) -> list[tuple[Any, bool]]:
        """Return what a frame shows from the present place: messages, and whether each is a reading."""
        far_m = self.x_m if not self.rear else -self.x_m
        wall_m, drop_m = self.wall_m - far_m, self.drop_m - far_m
        obstacle_m = wall_m if shows and 0.6 < wall_m < 3.5 else None
        seen: list[tuple[Any, bool]] = [
            (frame(t_s, obstacle_m=obstacle_m if self.sees != "maps" else None), True),
            (heading(t_s, 1e-3 * t_s), False),
        ]
        if not self.is_on_flight:
            ends = shows and drop_m < 2.5
            ground = FreeGround(
                t_s=t_s,
                view="rear" if self.rear else "front",
                blind_m=0.8,
                seen_m=max(drop_m, 0.8) if ends else 2.5,
                end_m=drop_m if ends and drop_m > 0.8 else None,
                end_sigma_m=0.02 if ends and drop_m > 0.8 else None,
            )
            seen.append((ground, True))
        elif not self.rear:
            nosings = [k * PITCH_M + 0.2 + (0.6 if k * PITCH_M + 0.2 > self.gap_m else 0.0) for k in range(40)]
            if not shows:
                nosings = [k * PITCH_M + 0.2 for k in range(40)]
            ahead = [(place - far_m, 0.0, 0.0) for place in nosings if 0.5 < place - far_m < 2.6]
            obstacle_m = obstacle_m if self.sees != "frames" else None
            seen.append((stair(t_s, ahead, direction=self.direction, obstacle_m=obstacle_m), False))
        return seen


def left_m(world: World) -> float:
    """Return the distance left to what is ahead: to a wall from the chair's end, to a drop from the leading pulley."""
    driven_m = abs(world.x_m)
    return min(world.wall_m - driven_m - world.lead_m, world.drop_m - driven_m - PULLEY_M)


def drawn(seed: int) -> World:
    """Return a world with a wall or a drop that is in view from at least 1.5 m before the chair."""
    rng = np.random.default_rng(seed)
    rear, kind = bool(rng.random() < 0.3), rng.choice(["wall", "drop", "wall on a flight"])
    near_m = (REAR_M if rear else FRONT_M) + 1.5
    place_m = near_m + rng.uniform(0.0, 2.0)
    share = rng.choice([1.0, 0.5, 1.0 / 3.0])
    every = round(1.0 / share)
    world: dict[str, Any] = {
        "rng": rng,
        "speed_m_s": float(rng.choice([0.2, 0.3])),
        "phase": str(rng.choice(FLAT_PHASES)),
        "latency_s": float(rng.choice([0.0, rng.uniform(0.0, 0.3), rng.uniform(0.3, 2.9)])),
        "jitter_s": float(rng.choice([0.0, 0.1])),
        "loss": float(rng.choice([0.0, 0.3])),
        "repeats": float(rng.choice([0.0, 0.3])),
        "shows": lambda number: number % every == 0,
    }
    if kind == "wall on a flight":
        return World(**world | {"phase": "climb", "wall_m": place_m, "sees": "maps"})
    return World(**world, **{f"{kind}_m": place_m}, rear=rear)


def keeps_its_distance(seed: int) -> int:
    """Drive one world; return its ticks."""
    world = drawn(seed).run(40.0)
    assert world.held is not None, f"seed {seed}: not held, {left_m(world):.2f} m left"
    assert left_m(world) >= LEFT_M, f"seed {seed}: {left_m(world):.2f} m left, {world.held}"
    return world.tick


@pytest.mark.parametrize("seed", range(60))
def test_whatever_the_camera_delays_loses_repeats_or_flickers_the_chair_keeps_its_distance(seed: int) -> None:
    """Test: a wall or a drop that a frame in two or three shows, in every phase and by joystick, forwards and backwards, with
    messages up to 2.9 s late, lost, repeated, swapped. Expected: at least 0.30 m are left, of which row 25 speaks."""
    keeps_its_distance(seed)


@pytest.mark.slow
@pytest.mark.skipif("TREADLINE_SLOW" not in os.environ, reason="make slow runs a million ticks")
def test_a_million_ticks_keep_their_distance() -> None:
    ticks, seed = 0, 1000
    while ticks < 1_000_000:
        ticks, seed = ticks + keeps_its_distance(seed), seed + 1


@pytest.mark.parametrize("speed_m_s", [0.2, 0.3])
@pytest.mark.parametrize("latency_s", [0.0, 1.0, 2.0, 2.9])
@pytest.mark.parametrize("what", ["wall_m", "drop_m"])
def test_a_late_message_is_placed_where_the_chair_was(what: str, latency_s: float, speed_m_s: float) -> None:
    """Test: messages with one latency throughout. Expected: 0.34 m and the stopping distance are kept, for a message of any age,
    as nearly as belts that are integrated tick by tick place it: 2 cm."""
    world = World(np.random.default_rng(0), speed_m_s=speed_m_s, latency_s=latency_s, **{what: 3.5}).run(40.0)
    assert 0.34 - 0.02 <= left_m(world) <= 0.34 + 0.4 * speed_m_s + 0.05


def test_what_one_frame_in_forty_shows_holds_nobody() -> None:
    world = World(np.random.default_rng(0), wall_m=3.0, phase="land", shows=lambda number: number % 40 == 20)
    assert world.run(8.0).held is None


def test_a_gap_that_maps_show_now_and_then_is_kept_away_from() -> None:
    """Test: a missing step in two maps of three. Expected: held before it, as row 17 asks."""
    world = World(np.random.default_rng(0), gap_m=3.0, phase="climb", shows=lambda number: number % 3 != 0).run(30.0)
    last_m = 0.2 + PITCH_M * math.floor((3.0 - 0.2) / PITCH_M)
    assert "too long for the track" in str(world.held)
    assert last_m - world.x_m - FRONT_M >= GAP_LEFT_M


@pytest.mark.parametrize(
    ("lacks", "words", "within_s"),
    [(StairMap, "headings without a stair map", 3.2), (HeadingHealth, "health of the heading silent", 0.5)],
)
def test_what_a_block_declares_and_never_sends_is_held_for(lacks: type, words: str, within_s: float) -> None:
    """Test: headings and frames are sound, and the maps or the health never come. Expected: held within the time that is awaited
    for it, 3.0 s of headings without a map, 0.3 s for the health; and a guard to which nothing is declared says so at once."""
    world = World(np.random.default_rng(0), phase="climb", lacks=(lacks,)).run(10.0)
    assert words in str(world.held)
    assert next(event.t_s for event in world.events if event.name == "hold") <= within_s
    guard = Guard(limits())
    guard.step(0.0, None)
    assert [event.name for event in guard.take_events()] == ["health_unwatched", "map_unwatched", "drop_unwatched"]


def test_maps_that_name_the_other_direction_hide_no_obstacle() -> None:
    """Test: the maps of a camera that looks ahead call the flight a falling one. Expected: what they show is ahead all the same."""
    world = World(np.random.default_rng(0), phase="climb", wall_m=3.0, sees="maps", direction="down").run(20.0)
    assert left_m(world) >= LEFT_M


def test_a_step_that_the_maps_show_is_no_obstacle() -> None:
    """Test: frames that show the first riser as what stands ahead, and maps its nosing there. Expected: driven at; without maps
    the same frames hold the chair."""

    class ShowsTheRiser(World):
        def frame(self, t_s: float, *, shows: bool) -> list[tuple[Any, bool]]:
            seen = super().frame(t_s, shows=shows)
            ahead = [(2.5 + k * 0.3 - self.x_m, 0.0, 0.16 * (k + 1)) for k in range(4)]
            return [*seen, (stair(t_s, ahead), False)] if self.sees == "both" else seen

    for sees, held in (("both", False), ("frames", True)):
        world = ShowsTheRiser(np.random.default_rng(0), wall_m=2.5, phase="approach", sees=sees)
        world.run((2.5 - FRONT_M) / 0.2)
        assert (world.held is not None) == held, world.held
