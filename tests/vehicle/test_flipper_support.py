"""Flippers in line with the belts: length of the track on a flight, nosings in contact, and the front of the support polygon."""

import math

import numpy as np
import pytest
from chairs import with_piece
from scipy.optimize import linprog

from treadline.mission.entry_check import reject_reason
from treadline.run.resolve import checked as check
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Scenario
from treadline.vehicle.tip_over_margin import worst_support
from treadline.vehicle.tracks import track_on_stair_m

FLIPPERS, FIXED = read_chair("wheelchair"), read_chair("wheelchair-fixed")
HEAVY_N = 9.81 * 180.0
"""A chair with a heavy passenger."""


def with_tracks(chair: ChairDescription, **tracks: float) -> ChairDescription:
    return chair.model_copy(update={"tracks": chair.tracks.model_copy(update=tracks)})


def test_a_flipper_lengthens_the_track_and_a_raised_fixed_section_does_not() -> None:
    assert track_on_stair_m(FLIPPERS) == pytest.approx(0.95 + 0.45, abs=1e-12)
    assert track_on_stair_m(FIXED) == 0.95
    assert track_on_stair_m(with_tracks(FIXED, approach_angle_deg=0.0)) == pytest.approx(0.95 + 0.34, abs=1e-12)


@pytest.mark.parametrize("pitch_m", [0.25, 0.34, 0.42, 0.5])
def test_the_support_grows_with_the_torque_from_the_flat_run_to_the_whole_track(pitch_m: float) -> None:
    found = [
        worst_support(with_piece("flipper", torque_n_m=torque), pitch_m, HEAVY_N).front_m
        for torque in (1e-9, 50.0, 100.0, 200.0, 1e4)
    ]
    assert found == sorted(found)
    # At the worst phase a nosing lies √(pitch · torque / weight), some micrometres, ahead of the flipper's axis.
    assert found[0] == pytest.approx(0.5 * 0.95 - pitch_m, abs=1e-5)
    assert found[-1] == pytest.approx(0.5 * 0.95 + 0.45 - pitch_m, abs=1e-9)


@pytest.mark.parametrize("pitch_m", [0.25, 0.34, 0.42])
def test_without_a_flipper_the_support_ends_a_pitch_before_the_flat_run(pitch_m: float) -> None:
    assert worst_support(FIXED, pitch_m, HEAVY_N).front_m == 0.5 * 0.95 - pitch_m


@pytest.mark.parametrize(("pitch_m", "torque_n_m"), [(0.30, 120.0), (0.30, 30.0), (0.42, 200.0), (0.20, 90.0)])
def test_the_support_is_the_least_of_the_furthest_centres_of_pressure(pitch_m: float, torque_n_m: float) -> None:
    half_m, weight_n = 0.5 * 0.95, 900.0
    furthest = []
    for phase in np.linspace(0.0, 1.0, 401):
        nosings = np.arange(half_m + 0.45 - phase * pitch_m, -half_m - 1e-12, -pitch_m)
        # Loads as shares of the weight, furthest forward, with the flipper's motor at most at its torque.
        levers = np.maximum(nosings - half_m, 0.0)
        best = linprog(-nosings, A_ub=[levers * weight_n], b_ub=[torque_n_m], A_eq=[np.ones_like(nosings)], b_eq=[1.0])
        furthest.append(-best.fun)
    # Another grid of phases: the edge moves by at most a step of the grid, a 400th of a pitch.
    found = worst_support(with_piece("flipper", torque_n_m=torque_n_m), pitch_m, weight_n).front_m
    assert min(furthest) - pitch_m / 400 <= found <= min(furthest) + 1e-9


def test_a_square_chair_counts_its_flipper_and_a_turned_one_has_lifted_it() -> None:
    slope, pitch_m = math.radians(28.0), 0.34
    square = static_margins(FLIPPERS, Chair(), slope, pitch_m, 0.0)
    turned = static_margins(FLIPPERS, Chair(), slope, pitch_m, 1e-9)
    assert square.uphill > turned.uphill + math.radians(5.0)
    assert square.downhill == pytest.approx(turned.downhill, abs=1e-8)
    fixed = [static_margins(FIXED, Chair(), slope, pitch_m, heading).uphill for heading in (0.0, 1e-9)]
    assert fixed[0] == pytest.approx(fixed[1], abs=1e-8)


def test_a_short_flat_run_needs_its_flipper() -> None:
    scenario = Scenario.model_validate({"stair": {"rise_m": 0.16, "run_m": 0.30}})
    short = {"flat_run_m": 0.60}
    by_flipper, fixed = (check(scenario, with_tracks(chair, **short)).reasons for chair in (FLIPPERS, FIXED))
    assert not any("too short for two nosings" in reason for reason in by_flipper)
    assert any("track is 0.080 m too short" in reason for reason in fixed)
    slope = math.atan2(0.16, 0.30)
    entered = [reject_reason(with_tracks(chair, **short), 50.0, 0.16, 0.30, slope) or "" for chair in (FLIPPERS, FIXED)]
    assert ["too short" in reason for reason in entered] == [False, True]
