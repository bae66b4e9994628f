"""Flippers in line with the belts: length of the track on a flight, nosings in contact, and the front of the support polygon."""

import math

import pytest

from treadline.mission.entry_check import reject_reason
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.vehicle.tracks import track_on_stair_m

FLIPPERS, FIXED = read_chair("wheelchair"), read_chair("wheelchair-fixed")


def with_tracks(chair: ChairDescription, **tracks: float) -> ChairDescription:
    return chair.model_copy(update={"tracks": chair.tracks.model_copy(update=tracks)})


def test_a_flipper_lengthens_the_track_and_a_raised_fixed_section_does_not() -> None:
    assert track_on_stair_m(FLIPPERS) == pytest.approx(0.95 + 0.45, abs=1e-12)
    assert track_on_stair_m(FIXED) == 0.95
    assert track_on_stair_m(with_tracks(FIXED, approach_angle_deg=0.0)) == pytest.approx(0.95 + 0.34, abs=1e-12)


def test_a_short_flat_run_needs_its_flipper() -> None:
    short = {"flat_run_m": 0.60}
    slope = math.atan2(0.16, 0.30)
    entered = [reject_reason(with_tracks(chair, **short), 50.0, 0.16, 0.30, slope) or "" for chair in (FLIPPERS, FIXED)]
    assert ["too short" in reason for reason in entered] == [False, True]
