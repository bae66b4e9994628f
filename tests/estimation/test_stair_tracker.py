"""Where the nosings are: what stands still stays where it is, whatever the chair does and whatever a frame says once."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world import RISE_M, RUN_M, SLOPE_RAD, Place, belts, imu, stair

from treadline.core.angles import DEG
from treadline.core.signals import StairMap
from treadline.estimation.stair_tracker import StairTracker

KNOWN_AFTER = 2
"""A nosing counts from its second sight on: a ghost is seen once (docs/decisions/0011)."""


@dataclass(kw_only=True)
class Chair(Place):
    """A chair without dynamics before a flight, and the readings of its sensors."""

    t_s: float = 0.0
    first_m: float = 1.5

    def sees(self, *steps: int, error_m: float = 0.0, **changes: Any) -> StairMap:
        return stair(self.t_s, [np.add(self.nosing_B(k), [error_m, 0.0, 0.0]) for k in steps], **changes)

    def update(self, where: StairTracker, *steps: int, ends: bool = False, error_m: float = 0.0, up: bool = True) -> None:
        """Let the mission have the attitude, and a frame of these steps."""
        where.heading_rad = self.heading_rad
        where.update(imu(self.t_s, self.pitch_rad, yaw_rad=self.heading_rad))
        if steps:
            where.update(self.sees(*steps, ends=ends, error_m=error_m, direction="up" if up else "down"))

    def drive(self, where: StairTracker, metres: float, speed_m_s: float = 0.2, slip: float = 0.0) -> None:
        """Move along the belts by what they do, less slip."""
        dt_s, along_m_s = 0.01, math.copysign(speed_m_s, metres)
        where.update(belts(self.t_s, along_m_s, along_m_s))
        for _ in range(round(abs(metres) / (speed_m_s * dt_s))):
            self.t_s += dt_s
            moved = along_m_s * dt_s * (1.0 - slip)
            self.x_m += moved * math.cos(self.pitch_rad) * math.cos(self.heading_rad)
            self.z_m += moved * math.sin(self.pitch_rad)
            where.update(belts(self.t_s, along_m_s, along_m_s))


def seen(chair: Chair, *steps: int, times: int = KNOWN_AFTER, up: bool = True) -> StairTracker:
    where = StairTracker()
    for _ in range(times):
        chair.update(where, *steps, up=up)
    return where


def test_a_nosing_is_where_the_map_says_and_known_at_the_second_sight() -> None:
    chair, where = Chair(), StairTracker()
    chair.update(where, 0, 1, 2)
    assert not where.known
    assert (where.first_ahead_m(), where.top_ahead_m(), where.ahead_m()) == (None, None, [])
    chair.update(where, 0, 1, 2)
    assert where.known
    assert where.ahead_m() == pytest.approx([1.5, 1.8, 2.1])
    assert where.first_ahead_m() == where.bottom_ahead_m() == pytest.approx(1.5)
    assert (where.rise_m, where.run_m, where.slope_rad) == pytest.approx((RISE_M, RUN_M, SLOPE_RAD))


@settings(max_examples=30)
@given(
    pitch=st.floats(-5.0, 9.0),
    heading=st.floats(-35.0, 35.0),
    x_m=st.floats(-1.0, 1.0),
    later_pitch=st.floats(-5.0, 35.0),
    later_heading=st.floats(-35.0, 35.0),
)
def test_a_nosing_stands_still_while_the_chair_pitches_and_turns(
    pitch: float, heading: float, x_m: float, later_pitch: float, later_heading: float
) -> None:
    chair = Chair(x_m=x_m, z_m=0.3, pitch_rad=pitch * DEG, heading_rad=heading * DEG)
    where = seen(chair, 2, 3, 4)
    chair.pitch_rad, chair.heading_rad = later_pitch * DEG, later_heading * DEG
    chair.update(where)
    expected = [chair.nosing_B(k)[0] for k in (2, 3, 4)]
    np.testing.assert_allclose(where.ahead_m(), expected, atol=1e-9)
    assert where.first_ahead_m() == pytest.approx(chair.first_m + 2 * RUN_M - x_m)


@settings(max_examples=30)
@given(latency=st.integers(0, 40), pitch=st.floats(0.0, 9.0), heading=st.floats(-30.0, 30.0), turn=st.floats(-2.0, 2.0))
def test_a_late_map_is_placed_by_the_pose_of_its_exposure(latency: int, pitch: float, heading: float, turn: float) -> None:
    """Test: each map arrives up to 0.4 s late at 0.2 m/s, from a chair that has pitched by up to 2° meanwhile. Expected: nosings
    where they are, not up to 80 mm off, nor 5 cm too high as 2° would place one 1.5 m ahead."""
    chair, where = Chair(pitch_rad=pitch * DEG, heading_rad=heading * DEG), StairTracker()
    chair.update(where)
    chair.drive(where, 0.02)
    for _ in range(KNOWN_AFTER):
        exposed = chair.sees(0, 1)
        chair.drive(where, 0.002 * latency)
        chair.t_s += 0.01
        chair.pitch_rad += turn * DEG
        where.update(belts(chair.t_s, 0.0, 0.0))
        chair.update(where)
        where.update(exposed)
    np.testing.assert_allclose(where.ahead_m(), [chair.nosing_B(k)[0] for k in (0, 1)], atol=1e-9)


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), slip=st.floats(0.0, 0.05))
def test_maps_that_err_by_a_centimetre_correct_belts_that_slip(seed: int, slip: float) -> None:
    rng, chair = np.random.default_rng(seed), Chair(first_m=2.5)
    where = seen(chair, 0, 1, 2)
    for _ in range(75):
        chair.drive(where, 0.02, slip=slip)
        chair.update(where, 0, 1, 2, error_m=0.01 * float(rng.normal()))
    first = where.first_ahead_m()
    # Half of each frame's error, and the slip of a frame's way (1 mm) twice: 4 standard deviations of 6 mm, nothing that adds up.
    assert abs(first - (chair.first_m - chair.x_m)) < 0.03
    assert len(where.ahead_m()) == 3


def test_a_chair_that_slides_back_on_belts_that_climb_is_measured_by_the_nosings_and_forgets_it_as_it_climbs_on() -> None:
    """Test: 0.2 m up; 0.06 m back in six maps while the belts run up by as much; 0.1 m up. Expected result: nothing slid, then
    0.06 m, then nothing; None once no map has come for half a second."""
    chair = Chair(pitch_rad=SLOPE_RAD, first_m=RUN_M)
    where = seen(chair, 1, 2, 3)
    for _ in range(4):
        chair.drive(where, 0.05)
        chair.update(where, 1, 2, 3)
    assert where.roll_back_m(chair.t_s) == pytest.approx(0.0, abs=1e-6)
    for _ in range(6):
        chair.drive(where, 0.01, slip=2.0)
        chair.update(where, 1, 2, 3)
    # The belts run up by 1 cm before the first map of the slide, which counts as travel until then.
    assert where.roll_back_m(chair.t_s) == pytest.approx(0.06, abs=0.011)
    for _ in range(4):
        chair.drive(where, 0.025)
        chair.update(where, 1, 2, 3)
    assert where.roll_back_m(chair.t_s) == pytest.approx(0.0, abs=1e-3)
    assert where.roll_back_m(chair.t_s + 0.5) is None


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_belts_that_outrun_the_chair_are_measured_by_the_nosings(way: float) -> None:
    """Test: belts at 0.2 m/s up or down the flight, a map each tenth of a second; for two seconds 0.05 m/s of the way up is lost.
    Expected result: none before, 0.05 m/s at the end of it, none two seconds later nor once no map comes."""
    chair = Chair(pitch_rad=SLOPE_RAD, first_m=RUN_M)
    where = seen(chair, 1, 2, 3)
    for slip_m_s in (0.0, 0.05, 0.0):
        for _ in range(20):
            chair.drive(where, way * 0.02, slip=way * slip_m_s / 0.2)
            chair.update(where, 1, 2, 3)
        # The nosings are taken to have moved by the rest: each takes a fiftieth or more of where a map shows it.
        assert where.slip_m_s(chair.t_s) == pytest.approx(slip_m_s, abs=0.002)
    chair.drive(where, way * 0.02, slip=1.0)
    chair.update(where, 1, 2, 3)
    assert where.slip_m_s(chair.t_s) != 0.0
    assert where.slip_m_s(chair.t_s + 0.5) == 0.0


def test_slip_is_corrected_for_the_nosings_out_of_view_too() -> None:
    chair = Chair()
    where = seen(chair, 0, 1, 2, 3, times=5)
    for _ in range(50):
        chair.drive(where, 0.02, slip=0.2)
        chair.update(where, 2, 3)
    # A fifth of a metre driven was slip; the two nosings that no frame shows any more have moved with the others, but for
    # what a frame's half leaves of 4 mm a frame, and what of it went into the nosings in view.
    np.testing.assert_allclose(where.ahead_m(), [chair.nosing_B(k)[0] for k in range(4)], atol=0.02)


def test_what_flickers_stays_known_and_where_it_was() -> None:
    chair = Chair()
    where = seen(chair, 0, 1, 2)
    for k in range(20):
        chair.drive(where, 0.02)
        chair.update(where, *((0, 1, 2), (1,), (0, 2), (2, 3))[k % 4])
    assert len(where.ahead_m()) == 4
    np.testing.assert_allclose(where.ahead_m(), [chair.nosing_B(k)[0] for k in range(4)], atol=2e-3)


@pytest.mark.parametrize("k", [-1, 3, 8])
def test_a_false_nosing_seen_once_counts_for_nothing(k: int) -> None:
    chair = Chair()
    where = seen(chair, 0, 1, 2, times=5)
    chair.update(where, *sorted((0, 1, 2, k)))
    for _ in range(3):
        chair.update(where, 0, 1, 2)
    assert where.ahead_m() == pytest.approx([1.5, 1.8, 2.1])
    assert where.top_ahead_m() == pytest.approx(2.1)


def test_a_nosing_missed_for_long_is_forgotten_and_known_again_at_the_second_sight() -> None:
    """Test: one of four is seen twice and missed by fifty frames of a chair that stands, then seen by all. Expected result: a gap
    as long as it is missed, and none from the second frame on."""
    chair = Chair()
    where = seen(chair, 0, 1, 2, 3)
    for _ in range(50):
        chair.update(where, 0, 1, 3)
    assert len(where.gaps_ahead_m()) == 1
    for k in range(3):
        chair.update(where, 0, 1, 2, 3)
        assert bool(where.gaps_ahead_m()) == (k < KNOWN_AFTER - 1)
    assert len(where.ahead_m()) == 4


def test_an_end_is_known_at_the_second_frame_that_shows_it_and_taken_back_by_frames_that_show_more() -> None:
    chair = Chair()
    where = seen(chair, 0, 1, 2)
    for is_known in (False, True):
        assert not where.top_ends
        chair.update(where, 0, 1, 2, ends=True)
        assert where.top_ends == is_known
    assert not where.bottom_ends
    for _ in range(2):
        chair.update(where, 1, 2, 3)
    assert not where.top_ends
    for _ in range(2):
        chair.update(where, 2, 3, ends=True)
    assert where.top_ends
    assert where.top_ahead_m() == pytest.approx(chair.nosing_B(3)[0])


@pytest.mark.parametrize("up", [True, False])
def test_a_false_nosing_beyond_the_end_is_forgotten_when_more_frames_show_the_end(up: bool) -> None:
    """Test: seven far frames show a nosing two runs beyond the last one, the next fifty the end before it. Expected result: the
    flight ends at its last nosing."""
    chair = Chair() if up else Chair(x_m=4.0, z_m=6 * RISE_M, first_m=0.0)
    steps, beyond, last = ((0, 1, 2), (0, 1, 2, 4), 2) if up else ((5, 4, 3), (5, 4, 3, 1), 3)
    where = seen(chair, *beyond, times=7, up=up)
    for _ in range(50):
        chair.update(where, *steps, up=up, ends=True)
    assert where.top_ends if up else where.bottom_ends
    found_m = where.top_ahead_m() if up else where.bottom_ahead_m()
    assert found_m == pytest.approx(chair.nosing_B(last)[0])


def test_a_flight_that_falls_behind_ends_at_its_lowest_nosing() -> None:
    chair = Chair(x_m=4.0, z_m=6 * RISE_M, first_m=0.0)
    where = StairTracker()
    for _ in range(2):
        chair.update(where, 5, 4, 3, up=False)
    for _ in range(2):
        chair.update(where, 3, 2, 1, 0, up=False, ends=True)
    assert where.bottom_ends
    assert not where.top_ends
    assert where.top_ahead_m() == pytest.approx(5 * RUN_M - 4.0)  # the edge: on the level with the belts
    assert where.bottom_ahead_m() == pytest.approx(-4.0)


def test_walls_are_those_of_the_last_frame() -> None:
    chair, where = Chair(), StairTracker()
    where.update(chair.sees(0, 1, left_wall_m=0.6, right_wall_m=0.7))
    assert (where.left_wall_m, where.right_wall_m) == (0.6, 0.7)
    where.update(chair.sees(0, 1))
    assert (where.left_wall_m, where.right_wall_m) == (None, None)


def test_a_gap_or_a_leap_back_in_the_belts_stamps_moves_nothing_far() -> None:
    chair, where = Chair(), StairTracker()
    for t_s in (0.0, 5.0, 1.0):
        chair.t_s = t_s
        where.update(belts(t_s, 0.2, 0.2))
    # A gap counts for a tenth of a second at most, a leap back for nothing.
    assert where.travel_m == pytest.approx(0.02)


@pytest.mark.parametrize("known", [False, True])
def test_a_map_without_nosings_changes_nothing(*, known: bool) -> None:
    """Test: a map that holds no nosing, before the flight is known and after. Expected result: all stays as it was."""
    chair = Chair()
    where = seen(chair, 0, 1, 2, times=3 * known)
    empty = replace(chair.sees(0), nosings_B=np.zeros((0, 3)))
    before = (where.map_count, where.ahead_m())
    where.update(empty)
    assert (where.map_count, where.ahead_m()) == before


@pytest.mark.parametrize(("way", "heading_deg"), [(1.0, 20.0), (1.0, -20.0), (-1.0, 20.0)])
def test_sides_stay_where_they_are_while_the_chair_moves_sideways(way: float, heading_deg: float) -> None:
    """Test: sides seen, then 0.5 m at 20°. Expected result: the sides shift by 0.5 m · sin 20° in the chair's view."""
    chair, where = Chair(first_m=3.0), StairTracker()
    sides = {"left_seen_m": 0.7, "right_seen_m": 0.6, "left_edge_m": 0.7, "left_side": "open"}
    chair.update(where)
    assert where.side_m("left") == where.side_m("right") == (None, None)
    for _ in range(KNOWN_AFTER):
        where.update(replace(chair.sees(0, 1), **sides))
    assert where.side_m("left") == pytest.approx((0.7, 0.7))
    chair.heading_rad = heading_deg * DEG
    chair.update(where)
    chair.drive(where, way * 0.5)
    left_m = way * 0.5 * math.sin(heading_deg * DEG)
    # The odometry takes the first reading's interval as zero: up to two steps of 2 mm, times sin 20°.
    assert where.side_m("left") == pytest.approx((0.7 - left_m, 0.7 - left_m), abs=0.002)
    seen_m, open_m = where.side_m("right")
    assert seen_m == pytest.approx(0.6 + left_m, abs=0.002)
    assert open_m is None


def test_a_side_is_open_at_the_second_sight_and_a_wall_is_not() -> None:
    chair, where = Chair(), StairTracker()
    for kind, is_open in (("open", False), ("open", True), ("wall", False), ("wall", False), ("open", False), ("open", True)):
        where.update(replace(chair.sees(0, 1), right_edge_m=0.5, right_side=kind))
        assert (where.side_m("right")[1] is not None) == is_open
