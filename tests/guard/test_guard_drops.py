"""Drop-off monitor: ground that ends, ground that was not seen, and edges that may be driven over."""

import math
from typing import Any

import pytest
import world
from world import estimate, imu, limits, stair

from treadline.core.signals import FreeGround, MotionPlan
from treadline.guard._drop_monitor import DropMonitor

DEG = math.pi / 180.0
PULLEY_M = 0.475
"""Half of the flat run of the shipped chair, 0.95 m."""
FRONT: dict[str, Any] = {"view": "front", "blind_m": 0.83, "seen_m": 2.0}
REAR: dict[str, Any] = {"view": "rear", "blind_m": 0.88, "seen_m": 2.0}


class Chair:
    """A chair with its monitor, standing on flat ground for a second."""

    def __init__(self, **changes: Any) -> None:
        self.monitor, self.travel_m = DropMonitor(limits(**changes)), 0.0
        self.tilt(0.0, 0.0)
        self.t_s, self.heading_rad = 1.0, 0.0
        self.cause(0.0)

    def hear(self, message: Any) -> None:
        self.monitor.hear(message, world.known(limits(), travel_m=self.travel_m))

    def tilt(self, t_s: float, pitch_rad: float) -> None:
        self.hear(imu(t_s, pitch_rad))

    def look(self, frames: int = 2, **ground: Any) -> "Chair":
        for _ in range(frames):
            self.hear(FreeGround(t_s=self.t_s, **ground))
        return self

    def map(self, behind_m: float = 0.86, maps: int = 2, **changes: Any) -> "Chair":
        nosings = [(-behind_m, 0.0, 0.0), (-behind_m - 0.3, 0.0, -0.16)]
        for _ in range(maps):
            self.hear(stair(self.t_s, **{"direction": "down", "nosings_B": nosings} | changes))
        return self

    def cause(self, speed_m_s: float, phase: Any = "search") -> str | None:
        plan = MotionPlan(t_s=self.t_s, phase=phase, speed_m_s=speed_m_s)
        seen = None if math.isinf(self.heading_rad) else estimate(self.t_s, self.heading_rad)
        values: dict[str, Any] = {"t_s": self.t_s, "plan": plan, "estimate": seen}
        return self.monitor.cause(world.known(limits(), speed_m_s=speed_m_s, travel_m=self.travel_m, **values))

    def goes(self, speed_m_s: float, phase: Any = "search", within_m: float = 3.0) -> float:
        """Return the travel in one direction until the monitor objects, at most ``within_m``."""
        began_m = self.travel_m
        while abs(self.travel_m - began_m) < within_m and self.cause(speed_m_s, phase) is None:
            self.travel_m += math.copysign(0.001, speed_m_s)
        return abs(self.travel_m - began_m)


def over(edge_m: float) -> float:
    """Return the travel of a chair that backs over an edge until 0.9 m of its 0.95 m are beyond."""
    return edge_m - PULLEY_M + 0.9


def test_a_low_kerb_that_hardly_tips_the_chair_is_past_once_the_chair_lies_beyond_it() -> None:
    """Test: an edge that the maps show as a kerb, driven over on the level, with and without a floor in view beyond. Expected
    result: over it on the plan's word while its middle passes, then as over any ground."""
    end = REAR | {"seen_m": 1.0, "end_m": 1.0, "end_sigma_m": 0.01}
    for phase in ("edge", "leave"):
        chair = Chair().look(**end).map(nosings_B=[(-1.0, 0.0, 0.0)], ends=True)
        assert chair.goes(-0.1, "edge", 1.15) == pytest.approx(1.15, abs=0.002)  # the middle has passed it
        chair.look(**REAR | {"seen_m": 1.5})
        assert chair.goes(-0.1, phase, 0.6) == pytest.approx(0.6, abs=0.002)  # all of it, over the floor in view
        chair.travel_m -= 0.6
        assert "no ground is seen beyond" in str(chair.cause(-0.1, "leave"))


def test_one_frame_alone_shows_no_end_and_frames_of_ground_beyond_it_take_it_back() -> None:
    near = FRONT | {"seen_m": 0.88, "end_m": 0.88, "end_sigma_m": 0.0}
    assert Chair().look(frames=1, **FRONT).look(frames=1, **near).cause(0.2) is None
    assert Chair().look(**FRONT).look(**near).cause(0.2) is not None
    assert Chair().look(**near).look(frames=1, **FRONT).cause(0.2) is not None  # a detector misses an edge now and then
    assert Chair().look(**near).look(frames=6, **FRONT).cause(0.2) is None
    chair = Chair().look(**near | {"seen_m": 1.5, "end_m": 1.5}).look(frames=1, **near)
    assert 1.5 - PULLEY_M - chair.goes(0.1) == pytest.approx(0.38, abs=0.002)  # the end in view, not the one frame


HIDDEN: dict[str, Any] = {"view": "rear", "blind_m": 0.88, "seen_m": 0.88}
"""A frame of which the image begins behind the landing's edge."""


def test_an_edge_below_the_image_is_where_the_maps_show_the_uppermost_nosing() -> None:
    """Test: an edge 0.86 m behind mid-track, where the image begins at 0.88 m. Expected result: two maps show the ground up to it
    and its end, 0.34 m and 0.4 s before which the chair stops; a plan that enters it goes over."""
    chair = Chair().look(**HIDDEN).map(0.86)
    assert 0.86 - PULLEY_M - chair.goes(-0.02) == pytest.approx(0.34 + 0.008, abs=0.002)
    assert "the ground ends" in str(chair.cause(-0.1))
    assert Chair().look(**HIDDEN).map(0.86, maps=3).goes(-0.1, "approach", over(0.86)) == pytest.approx(over(0.86), abs=0.002)
    turned = Chair().look(**HIDDEN).map(0.86 / math.cos(0.5)).map(0.86, maps=3)  # nearer as the chair turns square
    assert turned.goes(-0.1, "approach", over(0.86)) == pytest.approx(over(0.86), abs=0.002)


def test_what_ends_beyond_a_rising_flights_first_nosing_is_no_end_of_the_floor() -> None:
    """Test: ground that ends 0.85 m ahead, as floor in view below an open riser; two maps of a rising flight from 0.8 m on, from
    0.9 m on, one map alone. Expected result: the first goes on; the others stop, and so does a chair back from the flight."""
    ends = FRONT | {"seen_m": 0.85, "end_m": 0.85, "end_sigma_m": 0.0}

    def up(from_m: float, maps: int = 2) -> Chair:
        return Chair().look(**ends).map(maps=maps, direction="up", nosings_B=[(from_m, 0.0, 0.16), (from_m + 0.3, 0.0, 0.32)])

    assert up(0.8).cause(0.1, "mount") is None
    assert "the ground ends" in str(up(0.9).cause(0.1, "mount"))
    assert "the ground ends" in str(up(0.8, maps=1).cause(0.1, "mount"))
    assert "the ground ends" in str(Chair().look(**ends).map(direction="up").cause(0.1, "mount"))  # nosings behind, called a rise
    landed = up(0.8)
    for pitch_deg in (20.0, 0.0):
        landed.tilt(landed.t_s, pitch_deg * DEG)
    assert "the ground ends" in str(landed.cause(0.1, "land"))


def test_the_edge_is_one_run_before_a_nosing_that_is_one_rise_below_the_chair() -> None:
    """Test: the next nosing 0.98 m behind mid-track and 0.16 m below, on runs of 0.30 m. Expected result: an edge at 0.68 m, 0.34 m
    and 0.4 s before which the chair would have stopped; a plan that enters it goes over. With the next nosing at 1.68 m the edge
    would be in view: none is known."""
    lower = {"nosings_B": [(-0.98, 0.0, -0.16), (-1.28, 0.0, -0.32)]}
    assert "the ground ends 0.2" in str(Chair().look(**HIDDEN).map(**lower).cause(-0.1))
    assert Chair().look(**HIDDEN).map(maps=3, **lower).goes(-0.1, "approach", over(0.68)) == pytest.approx(over(0.68), abs=0.002)
    further = {"nosings_B": [(-1.68, 0.0, -0.16), (-1.98, 0.0, -0.32)]}
    assert "the ground ends" not in str(Chair().look(**HIDDEN).map(maps=3, **further).cause(-0.1))


@pytest.mark.parametrize(
    "changes",
    [
        {"maps": 1},
        {"nosings_B": [(-0.86, 0.0, -0.32), (-1.16, 0.0, -0.48)]},  # two nosings are out of view
        {"behind_m": 1.2},  # the strip is longer than the chair bridges
    ],
    ids=["one map", "two steps lower", "far"],
)
def test_other_maps_show_no_hidden_edge(changes: dict[str, Any]) -> None:
    chair = Chair().look(**HIDDEN).map(**{"behind_m": 0.86} | changes)
    assert chair.goes(-0.1, "approach") < 0.4


def test_an_end_below_the_image_is_remembered_by_the_travel_of_the_belts() -> None:
    """Test: the end leaves the view at 0.8 m. Expected result: the same place holds, and what was not seen is not free either."""
    chair = Chair().look(**FRONT | {"seen_m": 1.2, "end_m": 1.2, "end_sigma_m": 0.0})
    chair.travel_m = 0.3
    chair.look(**FRONT | {"blind_m": 0.95})
    chair.look(**FRONT | {"seen_m": 0.83})
    assert 1.2 - PULLEY_M - 0.3 - chair.goes(0.1) == pytest.approx(0.38, abs=0.002)


def test_ground_counts_as_far_as_it_was_seen_and_driven() -> None:
    """Test: 1.5 m seen and nothing beyond, then backwards. Expected result: 0.34 m and 0.4 s of driving are left before what is out
    of sight, unless the plan enters a flight there; a pulley stays on known ground, and stops on it."""
    chair = Chair().look(**FRONT | {"seen_m": 1.5})
    assert chair.goes(0.1) == pytest.approx(1.5 - PULLEY_M - 0.38, abs=0.002)
    assert chair.goes(-0.1) == pytest.approx(1.5 - PULLEY_M - 0.42, abs=0.003)
    assert Chair().look(**FRONT | {"seen_m": 1.5}).goes(0.1, "approach") == pytest.approx(1.5 - PULLEY_M - 0.04, abs=0.002)
    chair.travel_m = 0.5
    for chair.heading_rad, known in ((4.0 * DEG, True), (6.0 * DEG, False), (9.0 * DEG, False)):
        assert [chair.cause(speed_m_s) is None for speed_m_s in (0.1, -0.1)] == [known, known]  # seen and driven: aside beyond 5°
    assert chair.look(frames=1, **FRONT).cause(0.1) is None
    chair.travel_m = 0.25
    assert chair.cause(-0.1) is not None
    chair.travel_m = 0.5
    chair.heading_rad = 10.5 * DEG
    assert chair.cause(-0.1) is None  # 4.5° on, and 0.25 m were driven meanwhile
    chair.heading_rad = 12.0 * DEG
    assert chair.cause(0.1) is None  # the frame at 9° is 3° old


@pytest.mark.parametrize(("aside_m", "knows"), [(0.0, True), (0.7, True), (1.0, False)])
def test_a_chair_that_has_turned_and_turned_back_may_back_over_what_it_had_driven(aside_m: float, knows: bool) -> None:
    """Test: 1 m driven over seen ground, a turn by 10° in two parts, a drive in that heading and back, and the turn taken back.
    Expected result: the metre is known again, unless the chair was more than 14 cm aside of it: 0.17 of the way."""
    chair = Chair().look(**FRONT)
    assert chair.goes(0.1, within_m=1.0) == pytest.approx(1.0, abs=0.002)
    for chair.heading_rad in (6.0 * DEG, 10.0 * DEG):
        chair.cause(0.0)
    assert chair.cause(-0.1) == "the ground 0.00 m behind the belts was neither seen nor driven over"
    for speed_m_s in (0.1, -0.1):
        chair.look(**FRONT).goes(speed_m_s, within_m=0.5 * aside_m)
    for chair.heading_rad in (5.0 * DEG, 0.0):
        chair.cause(0.0)
    assert (chair.cause(-0.1) is None) == knows


def test_the_ways_aside_of_driven_ground_add_up_over_turns() -> None:
    """Test: 1 m driven, and twice 0.6 m onwards at 10°, the turn taken back each time. Expected result: a metre behind is known
    again after the first, 0.10 m aside; after the second, 0.20 m aside, it is not."""
    chair = Chair().look(**FRONT)
    chair.goes(0.1, within_m=1.0)
    known = []
    for _ in range(2):
        chair.heading_rad = 10.0 * DEG
        chair.cause(0.0)
        assert chair.look(**FRONT).goes(0.1, within_m=0.6) == pytest.approx(0.6, abs=0.002)
        chair.heading_rad = 0.0
        known.append(chair.cause(-2.5) is None)  # stops within a metre
    assert known == [True, False]


def test_frames_move_a_confirmed_edge_while_it_is_in_view() -> None:
    """Test: an edge 1.2 m behind with its nosings, then frames that show it 0.1 m nearer. Expected: 0.34 m are kept from there."""
    chair = Chair().look(**REAR | {"seen_m": 1.2, "end_m": 1.2, "end_sigma_m": 0.0}).map(1.2)
    chair.look(**REAR | {"seen_m": 1.1, "end_m": 1.1, "end_sigma_m": 0.0})
    assert chair.goes(-0.1) == pytest.approx(1.1 - PULLEY_M - 0.34 - 0.1 * 0.4, abs=0.002)  # stops in 0.4 s


def test_an_end_below_the_image_lies_aside_after_a_turn() -> None:
    chair = Chair().look(**FRONT | {"seen_m": 0.85, "end_m": 0.85, "end_sigma_m": 0.0})
    chair.heading_rad = 90.0 * DEG
    chair.cause(0.0)
    assert chair.look(**FRONT | {"blind_m": 0.9}).cause(0.1) is None
    chair.look(**FRONT | {"seen_m": 0.85, "end_m": 0.85, "end_sigma_m": 0.0}).heading_rad = math.inf
    assert "the ground ends" in str(chair.cause(0.1))  # an unknown heading takes nothing back
    chair = Chair().look(**FRONT)
    chair.heading_rad = math.inf
    assert chair.cause(0.1) is None  # nor the ground of the latest frame


def test_a_strip_below_the_image_may_be_as_long_as_the_chairs_reach() -> None:
    """Test: ground in view behind a strip from the pulley on. Expected result: 0.995 m ahead and 0.55 m behind are bridged."""
    for view, way, reach_m in (("front", 1.0, 0.995), ("rear", -1.0, 0.55)):
        for strip_m, known in ((reach_m - 0.01, True), (reach_m + 0.01, False)):
            ground = {"view": view, "blind_m": PULLEY_M + strip_m, "seen_m": 2.0}
            assert (Chair().look(**ground).cause(0.1 * way) is None) is known


@pytest.mark.parametrize("phase", ["approach", "edge"])
def test_an_edge_is_entered_where_the_guards_own_maps_show_its_nosing(phase: Any) -> None:
    end = REAR | {"seen_m": 1.2, "end_m": 1.2, "end_sigma_m": 0.01}
    chair = Chair()
    chair.travel_m = -0.25
    assert chair.look(**end).map(1.2).goes(-0.1, phase, over(1.2)) == pytest.approx(over(1.2), abs=0.002)
    assert Chair().look(**end).map(1.2).goes(-0.1, "search") < 0.35  # the maps alone are not enough
    assert Chair().look(**end).goes(-0.1, phase) < 0.35  # nor is the plan
    assert Chair().look(**end).map(1.2, maps=1).goes(-0.1, phase) < 0.35
    assert Chair().look(**end).map(1.4).goes(-0.1, phase) < 0.35  # a nosing elsewhere
    assert Chair().look(**end).map(1.2, direction="up").goes(-0.1, phase) < 0.35
    nosing = [(-1.2, 0.0, 0.0)]
    assert Chair().look(**end).map(1.2, nosings_B=nosing).goes(-0.1, phase) < 0.35  # one nosing is no flight
    assert Chair().look(**end).map(1.2, nosings_B=nosing, ends=True).goes(-0.1, phase) > 1.0  # but may be a kerb
    assert Chair().look(**end).map(1.2, nosings_B=(), ends=True).goes(-0.1, phase) < 0.35  # nor is no nosing


@pytest.mark.parametrize(("turn_deg", "enters"), [(15.0, True), (44.0, True), (46.0, False)])
def test_a_confirmed_edge_below_the_image_is_entered_by_a_chair_that_turned_square(turn_deg: float, enters: bool) -> None:
    """Test: an edge and its nosings seen at an angle, then a turn with both below the image. Expected result: entered up to 45°."""
    chair = Chair().look(**REAR | {"seen_m": 0.9, "end_m": 0.9, "end_sigma_m": 0.01}).map(0.9)
    chair.heading_rad = turn_deg * DEG
    chair.cause(0.0)
    assert (chair.look(**REAR | {"seen_m": 0.88}).cause(-0.1, "approach") is None) is enters


def test_the_first_tread_beyond_a_confirmed_edge_is_not_the_landing() -> None:
    """Test: an edge with its nosings in maps, then below the image, where frames show the tread and its end. Expected result: the
    edge stays where it was, and is entered."""
    chair = Chair().look(**REAR | {"seen_m": 0.9, "end_m": 0.9, "end_sigma_m": 0.01}).map(0.9)
    chair.travel_m = -0.05
    chair.look(**REAR | {"seen_m": 1.15, "end_m": 1.15, "end_sigma_m": 0.01})
    assert chair.goes(-0.1, "approach", 0.8) == pytest.approx(0.8, abs=0.002)
    assert chair.cause(-0.1, "search") is not None


def test_on_a_flight_neither_rule_holds_and_off_it_the_ground_is_awaited_for_three_frames() -> None:
    """Test: phases with a pitch above 5°, then level. Expected result: an end holds off the flight, unseen ground after 0.3 s."""
    chair = Chair().look(**FRONT | {"seen_m": 0.85, "end_m": 0.85, "end_sigma_m": 0.0})
    chair.tilt(1.0, 28.0 * DEG)
    assert [phase for phase in ("drive", "climb", "edge", "descend", "crest", "land") if chair.cause(0.1, phase) is not None] == [
        "crest",
        "land",
    ]
    chair = Chair()
    chair.tilt(1.0, 5.5 * DEG)
    assert chair.cause(0.1, "land") is None
    chair.tilt(1.0, 4.5 * DEG)
    for chair.t_s, held in ((1.25, False), (1.375, True)):
        assert (chair.cause(0.1, "land") is not None) is held
    assert chair.cause(0.1, "climb") is not None  # flat ground, whatever the plan says


def test_an_edge_is_past_once_the_chair_lies_on_the_flight() -> None:
    chair = Chair().look(**REAR | {"seen_m": 1.2, "end_m": 1.2, "end_sigma_m": 0.0})
    chair.travel_m = -1.0
    chair.tilt(1.0, 28.0 * DEG)
    assert chair.cause(-0.1, "leave") is None


def test_what_another_frame_showed_says_nothing_of_this_direction() -> None:
    """Test: an end in view ahead, then frames to the rear; frames to the rear that show nothing near, and a turn; frames before the
    first tick. Expected result: no end behind; unknown ground behind, and in either direction."""
    near = FRONT | {"seen_m": 0.8, "end_m": 0.8, "end_sigma_m": 0.0}
    assert Chair().look(**near).cause(0.0) is None  # a chair that stands may
    assert Chair().look(**near).look(**REAR).cause(-0.1) is None
    chair = Chair().look(**FRONT).look(**REAR | {"blind_m": 1.3})
    chair.heading_rad = 6.0 * DEG
    assert chair.cause(-0.1) is not None
    for ground, way in ((FRONT, 1.0), (REAR, -1.0)):
        chair = Chair()
        chair.monitor = DropMonitor(limits())
        chair.tilt(0.0, 0.0)
        assert chair.look(**ground).cause(0.1 * way) is not None
