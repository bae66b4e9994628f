"""The follower alone, over rest poses: it arrives quietly on every ground; where its flipper finds nothing it stands, and why."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest
from resting_chair import FLIPPER_M, HALF_M, MOST_N_M, Nosing, RestingChair, flight, ground_of
from world import CHAIR, belts, imu

from treadline.core.angles import DEG
from treadline.mission import follow
from treadline.mission.follow import FollowCommand, Follower, Terrain
from treadline.vehicle.loading import Loading
from treadline.vehicle.way import WayTable

TICK_S, PATIENCE_S = 0.04, 8.0
QUIET_DEG_S, ROUGH_DEG_S = 10.0, 15.0
"""Pitch rates: 9 °/s is the planner's largest, 0.1° in 0.1 s the rest poses' own steps; a nominal drive may reach 15 °/s."""

FLIGHT = flight(*[(0.16, 0.30)] * 5)
GROUNDS: dict[str, list[Nosing]] = {
    "28 degrees": FLIGHT,
    "last riser 45 mm high": flight(*[(0.16, 0.30)] * 4, (0.205, 0.30)),
    "last riser 45 mm low": flight(*[(0.16, 0.30)] * 4, (0.115, 0.30)),
    "kerb 50": flight((0.05, 0.30)),
    "kerb 150": flight((0.15, 0.30)),
    "kerb 200": flight((0.20, 0.30)),
    "two long steps": flight(*[(0.15, 0.50)] * 2),
    "two low steps": flight(*[(0.06, 0.30)] * 2),
}
HEAVY = ("28 degrees", "kerb 200")
BOTH_WAYS = pytest.mark.parametrize("up", [True, False], ids=["up", "down"])


@dataclass
class Drive:
    """A chair that follows its way, the ground that it is shown, and where it is given to be."""

    nosings: Sequence[Nosing] = field(default_factory=lambda: FLIGHT)
    up: bool = True
    kg: float = 50.0
    shown: Sequence[Nosing] | None = None
    off_m: float = 0.0
    """Error of the place."""
    x_m: float | None = None
    on_flight: bool = False
    landing_m: float = 4.0
    brake_on: bool = False
    slip: float = 0.0
    flipper: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.shown = self.shown or self.nosings
        begin_m = -HALF_M - FLIPPER_M - 0.5 if self.up else self.nosings[-1][0] + HALF_M + 0.4
        stands = {"pitch_rad": 28.0 * DEG, "angle_rad": 0.0} if self.on_flight else {}
        self.body = RestingChair(
            ground=ground_of(self.nosings, self.landing_m),
            x_m=begin_m if self.x_m is None else self.x_m,
            payload_kg=self.kg,
            **stands,
            **self.flipper,
        )
        self.follower = Follower(Loading(chair=CHAIR, payload_kg=self.kg), 1.0 if self.up else -1.0)
        self.t_s = self.speed_m_s = self.moved_s = 0.0
        """Time, belt speed, and time at which place or pitch last changed."""
        self.commands: list[FollowCommand] = []

    def tick(self) -> FollowCommand:
        shown = self.shown or self.nosings
        terrain = Terrain(ground=ground_of(shown)[:-2], x_m=self.body.x_m + self.off_m, foot_m=shown[0][0], top_m=shown[-1][0])
        tracks = belts(self.t_s, self.speed_m_s, self.speed_m_s, brake_on=self.brake_on)
        command = self.follower.step(imu(self.t_s, self.body.pitch_rad), self.body.reading(self.t_s), tracks, terrain)
        self.commands.append(command)
        if not self.brake_on:
            self.speed_m_s = command.speed_m_s
            before = self.body.pose
            self.body.move(self.speed_m_s * (1.0 - self.slip) * TICK_S, command.flipper.rate_rad_s, TICK_S)
            moved = abs(self.body.x_m - before.x_m) > 1e-4 or abs(self.body.pitch_rad - before.pitch_rad) > 1e-4
            self.moved_s = self.t_s if moved else self.moved_s
        self.t_s = round(self.t_s + TICK_S, 6)
        return command

    def until(self, ends: Callable[[FollowCommand], Any], limit_s: float = 90.0) -> FollowCommand:
        end_s = self.t_s + limit_s
        while not ends(command := self.tick()):
            assert self.t_s < end_s, (command.place, self.body.x_m)
        return command

    def ends(self) -> FollowCommand:
        """Drive until the chair is past the flight, or does not come further."""
        return self.until(lambda command: command.place == "past" or command.barred)

    @property
    def fastest_deg_s(self) -> float:
        return self.body.fastest_rad_s / DEG


def with_top(up_m: float) -> list[Nosing]:
    """Return the flight with another height of its landing."""
    return [*FLIGHT[:-1], (FLIGHT[-1][0], FLIGHT[-1][1] + up_m)]


@BOTH_WAYS
@pytest.mark.parametrize(("name", "kg"), [*((name, 50.0) for name in GROUNDS), *((name, 100.0) for name in HEAVY)])
def test_over_every_ground_it_arrives_and_turns_the_chair_no_faster_than_its_pace(name: str, kg: float, *, up: bool) -> None:
    drive = Drive(GROUNDS[name], up=up, kg=kg)
    assert (drive.ends().place, drive.commands[-1].barred) == ("past", "")
    assert drive.fastest_deg_s < QUIET_DEG_S
    assert drive.t_s < 60.0  # 3.5 m at 0.1 m/s, and the flipper's 220° at 16 °/s, twice
    assert abs(drive.body.pitch_rad) < 0.1 * DEG
    drives = [command for command in drive.commands if command.leads]
    assert max(abs(command.speed_m_s) for command in drives) < 0.13  # 0.1 m/s along the ground, at 35°
    assert all(command.state is None or command.state.torque_n_m <= 0.95 * MOST_N_M for command in drives)


@pytest.mark.parametrize(
    ("up", "x_m", "on_flight"),
    [(True, -1.07, False), (True, 0.5, True), (False, 1.78, False), (False, 0.6, True)],
)
def test_from_wherever_it_starts_it_arrives_quietly(x_m: float, *, up: bool, on_flight: bool) -> None:
    drive = Drive(up=up, x_m=x_m, on_flight=on_flight)
    assert drive.ends().place == "past"
    assert drive.fastest_deg_s < QUIET_DEG_S


@BOTH_WAYS
@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"off_m": 0.015}, id="place 15 mm ahead"),
        pytest.param({"off_m": -0.015}, id="place 15 mm behind"),
        pytest.param({"shown": with_top(0.010)}, id="landing 10 mm lower than shown"),
        pytest.param({"shown": with_top(-0.010)}, id="landing 10 mm higher than shown"),
        pytest.param({"shown": with_top(0.030)}, id="landing 30 mm lower than shown"),
        pytest.param({"flipper": {"most_n_m": 0.5 * MOST_N_M}}, id="flipper weak by half"),
    ],
)
def test_what_the_map_and_the_motor_may_err_leaves_it_quiet(changes: dict[str, Any], *, up: bool) -> None:
    """Test: one standard deviation of the tracker's place, ten of a riser in view, a motor with half of its torque. Expected
    result: it arrives, within the pitch rate of a nominal drive."""
    drive = Drive(up=up, **changes)
    assert (drive.ends().place, drive.commands[-1].barred) == ("past", "")
    assert drive.fastest_deg_s < ROUGH_DEG_S


@BOTH_WAYS
@pytest.mark.parametrize(
    ("flipper", "why"),
    [
        pytest.param({"flipper_moves": False}, "it would not carry the chair", id="stuck"),
        pytest.param({"most_n_m": 0.0}, "it would not carry the chair|it does not rise", id="dead"),
        pytest.param({"most_n_m": 80.0}, "its motor is too weak for this load", id="weak"),
    ],
)
def test_a_flipper_that_does_not_follow_is_found_before_the_chair_needs_it(flipper: dict[str, Any], why: str, *, up: bool) -> None:
    drive = Drive(up=up, flipper=flipper)
    assert re.search(why, drive.ends().barred)
    pose = drive.body.pose
    assert min(pose.front_margin_rad, pose.rear_margin_rad) > 20.0 * DEG  # the least on a flight of 28° is 12°
    assert drive.body.x_m < FLIGHT[0][0] if up else drive.body.x_m > FLIGHT[-1][0] + 0.1


@pytest.mark.parametrize("name", ["28 degrees", "kerb 150"])
def test_no_weight_goes_onto_a_tip_that_finds_nothing(name: str) -> None:
    """Test: behind the last nosing there is no landing. Expected result: the chair stands on the edge, its pitch that of the flight
    or more, and says so after its patience and three seconds in which pressing the flipper further down counts as progress."""
    drive = Drive(GROUNDS[name], landing_m=0.02)
    lies_rad = 0.0
    while not (command := drive.tick()).barred:
        lies_rad = max(lies_rad, drive.body.pitch_rad)
        assert drive.body.pitch_rad > lies_rad - 2.0 * DEG
        assert drive.t_s < 60.0
    assert command.barred.startswith("nothing carried the flipper in 8 s: ")
    assert (command.speed_m_s, drive.fastest_deg_s < QUIET_DEG_S) == (0.0, True)
    assert drive.t_s - drive.moved_s < PATIENCE_S + 3.0


@BOTH_WAYS
def test_belts_that_run_without_a_chair_that_comes_further_are_said_to_slip(*, up: bool) -> None:
    """Test: the belts lose their grip while the flipper turns the chair; going up it comes down all the same, its tip then free."""
    drive = Drive(up=up)
    drive.until(lambda command: command.place == "top" and not command.is_unloaded and 4.0 < drive.body.pitch_rad / DEG < 24.0)
    drive.slip = 1.0
    assert drive.ends().barred == "the chair stayed for 8 s while the belts ran: they slip on the last nosing"
    assert PATIENCE_S - 2.0 < drive.t_s - drive.moved_s < PATIENCE_S + 2.0  # a second of the way is less than a second's motion


def test_without_a_way_the_chair_stands_and_says_so() -> None:
    """Test: the first tick near a flight; then steps of half a metre. Expected result: no motion until there is a way; where there
    is none, a reason after the patience."""
    drive = Drive(x_m=-1.1)
    first = drive.tick()
    assert (first.place, first.state, first.speed_m_s, first.flipper.rate_rad_s) == ("foot", None, 0.0, 0.0)
    assert drive.until(lambda command: command.state is not None).barred == ""
    wall = Drive(flight((0.5, 0.3), (0.5, 0.3)), x_m=-1.1)
    assert wall.ends().barred == "no way leads over the ground that is seen"
    assert wall.body.x_m == -1.1
    assert wall.t_s == pytest.approx(PATIENCE_S, abs=1.0)  # a plan that finds none takes half a second


def test_the_brake_stops_its_clock_and_its_commands_begin_from_rest() -> None:
    """Test: half a minute with the brake on as the flipper finds nothing. Expected result: no reason is given meanwhile."""
    drive = Drive(landing_m=0.02)
    drive.until(lambda command: command.place == "top" and command.speed_m_s == 0.0 and drive.body.angle_rad < 0.0)
    drive.brake_on = True
    for _ in range(round(30.0 / TICK_S)):
        command = drive.tick()
        assert (command.barred, command.flipper.rate_rad_s) == ("", 0.0)
    drive.brake_on, from_s = False, drive.t_s
    assert drive.ends().barred
    assert drive.t_s - from_s > PATIENCE_S - 0.1


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> list[WayTable]:
    """Return the list of the tables that are begun."""
    made: list[WayTable] = []

    class Noted(WayTable):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            made.append(self)

    monkeypatch.setattr(follow, "WayTable", Noted)
    return made


@pytest.mark.parametrize(("up_m", "replans"), [(0.006, False), (0.012, True), (-0.006, False), (-0.012, True)])
def test_it_plans_again_where_the_ground_has_moved_by_more_than_eight_millimetres(
    tables: list[WayTable], up_m: float, *, replans: bool
) -> None:
    """Test: the landing is corrected while the chair rides at the crest, its tip in the air. The limit counts from the mean of the
    five nosings near it, which moves by a quarter."""
    drive = Drive()
    drive.until(lambda command: command.place == "top" and command.state is not None)
    made, drive.shown = len(tables), with_top(up_m)
    for _ in range(round(2.0 / TICK_S)):
        drive.tick()
    assert (len(tables) > made) is replans


@BOTH_WAYS
def test_while_the_tip_bears_it_keeps_its_way(tables: list[WayTable], *, up: bool) -> None:
    """Test: the landing is corrected by 15 mm while the flipper turns the chair. Expected result: no new way meanwhile."""
    drive = Drive(up=up)
    drive.until(
        lambda command: command.place == "top" and not command.is_unloaded and 5.0 * DEG < drive.body.pitch_rad < 24.0 * DEG
    )
    made, drive.shown = len(tables), with_top(0.015)
    drive.until(lambda command: command.is_unloaded)
    assert len(tables) <= made + 1
    assert drive.ends().place == "past"
    assert drive.fastest_deg_s < ROUGH_DEG_S


def test_the_same_signals_give_the_same_commands() -> None:
    one, other = Drive(GROUNDS["kerb 150"], kg=75.0), Drive(GROUNDS["kerb 150"], kg=75.0)
    one.ends()
    other.ends()
    assert one.commands == other.commands


def test_a_chair_that_turns_back_over_the_edge_stands_on_the_landing_again() -> None:
    drive = Drive(up=False)
    drive.until(lambda _: drive.body.pitch_rad > 8.0 * DEG)
    drive.follower.turn_back()
    drive.until(lambda command: command.place == "before" or command.barred)
    assert (drive.commands[-1].barred, abs(drive.body.pitch_rad) < 0.1 * DEG) == ("", True)
    assert drive.fastest_deg_s < QUIET_DEG_S
