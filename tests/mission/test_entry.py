"""Refusal by the measured stair: each with its number and what would help, and none by the noise of a measurement."""

import math

from chairs import CHAIR, with_piece
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.mission.entry_check import certain_reject_reason, reject_reason
from treadline.run.resolve import checked, ready
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Scenario, Stair
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.tracks import minimum_track_length

# Literals, so that a changed value in the code is detected here.
MEASURED_M = 0.01
MEASURED_RAD = 1.0 * DEG
SHAPE_SIGMAS = 3.0


def refusal(rise_m: float, run_m: float, payload_kg: float = 50.0, chair: ChairDescription = CHAIR) -> str | None:
    return reject_reason(chair, payload_kg, rise_m, run_m, math.atan2(rise_m, run_m))


@settings(max_examples=20)
@given(
    rise_m=st.floats(0.12, 0.18),
    slope_deg=st.floats(20.0, 30.0),
    kg=st.floats(0.0, 80.0),
    offset=st.tuples(st.floats(-0.05, 0.05), st.floats(-0.04, 0.04), st.floats(-0.10, 0.10)),
    slope_error_deg=st.floats(-0.6, 0.6),
)
def test_what_check_lets_in_with_its_seat_shift_is_not_refused_at_the_foot(
    rise_m: float, slope_deg: float, kg: float, offset: tuple[float, float, float], slope_error_deg: float
) -> None:
    """A slope that errs by two standard deviations, a passenger who does not sit where the mission assumes."""
    run_m = rise_m / math.tan(slope_deg * DEG)
    assume(run_m < 0.45)
    load = Chair(payload_kg=kg, payload_offset_m=offset)
    asked = Scenario(stair=Stair(rise_m=rise_m, run_m=run_m, steps=3, friction=(0.9, 0.8)), chair=load)
    setup, refused, _ = ready(asked, checked(asked, CHAIR))
    assume(refused is None)
    chair = CHAIR.with_seat_shifted(setup.chair.seat_shift_m)
    assert reject_reason(chair, kg, rise_m, run_m, (slope_deg + slope_error_deg) * DEG) is None


def test_110_kg_are_let_in_up_to_26_degrees() -> None:
    assert refusal(0.15, 0.15 / math.tan(26.0 * DEG), 110.0) is None


def test_a_track_that_does_not_span_two_nosings_is_refused_with_what_it_lacks() -> None:
    fixed = read_chair("wheelchair-fixed")
    lacking_m = minimum_track_length(0.18, 0.46) - fixed.tracks.flat_run_m
    assert lacking_m > MEASURED_M
    answer = refusal(0.18, 0.46, chair=fixed)
    assert f"{lacking_m:.3f} m too short" in answer
    assert "0.180 by 0.460 m" in answer
    assert "longer track" in answer
    # A flipper in line with the belts makes the track long enough.
    assert "too short" not in (refusal(0.18, 0.46) or "")


def test_a_track_at_its_limit_is_not_refused_by_a_centimetre_of_noise() -> None:
    run_m = 0.44
    rise_m = math.sqrt((0.5 * (CHAIR.tracks.flat_run_m + 0.9 * MEASURED_M)) ** 2 - run_m**2)
    answer = refusal(rise_m, run_m)
    assert answer is None or "too short" not in answer


def test_a_stair_beyond_the_seats_stroke_is_refused_with_both_angles() -> None:
    chair = with_piece("seat", stroke_m=(CHAIR.seat.stroke_m[0], 0.06))
    answer = refusal(0.16, 0.30, chair=chair)
    assert answer.startswith("the stair is 28.1° steep, the seat stays level to 1")
    assert "lengthen its stroke" in answer


def test_a_chair_that_would_tip_is_refused_with_its_margin() -> None:
    x, y, z = CHAIR.seat.hinge_m
    answer = refusal(0.16, 0.16 / math.tan(30.0 * DEG), 110.0, with_piece("seat", hinge_m=(x - 0.25, y, z)))
    assert "the tipping margin would be" in answer
    assert "below 7°" in answer
    assert "shift the seat or take less payload" in answer


@settings(max_examples=30)
@given(back_m=st.floats(0.0, 0.3), payload_kg=st.floats(0.0, 120.0), slope_deg=st.floats(18.0, 32.0))
def test_sitting_further_back_never_turns_a_no_into_a_yes(back_m: float, payload_kg: float, slope_deg: float) -> None:
    x, y, z = CHAIR.seat.hinge_m
    rise_m = 0.14
    run_m = rise_m / math.tan(slope_deg * DEG)
    if refusal(rise_m, run_m, payload_kg) is not None:
        assert refusal(rise_m, run_m, payload_kg, with_piece("seat", hinge_m=(x - back_m, y, z))) is not None


def test_the_noise_of_a_frames_mean_does_not_refuse_what_the_seat_can() -> None:
    # A degree is three standard deviations of the mean slope.
    chair = with_piece("seat", stroke_m=(CHAIR.seat.stroke_m[0], 0.08))
    reach = SeatLinkage(chair.seat).angle_range[1]
    answer = reject_reason(chair, 0.0, 0.12, 0.25, reach + 0.9 * DEG)
    assert answer is None or "lengthen" not in answer
    answer = reject_reason(chair, 0.0, 0.12, 0.25, reach + 1.1 * DEG)
    assert "lengthen" in answer


def test_a_stair_steeper_than_the_chair_is_rated_for_is_refused_with_both_angles() -> None:
    answer = reject_reason(CHAIR, 50.0, 0.18, 0.24, 36.9 * DEG)
    assert answer == "the stair is 36.9° steep, chair 'wheelchair' is rated for 32°; take another way"


@settings(max_examples=30)
@given(more_m=st.floats(0.001, 0.02), ratio=st.floats(0.05, 3.0))
def test_a_rise_above_the_limit_is_refused_for_good_only_beyond_its_interval(more_m: float, ratio: float) -> None:
    """Test: a rise above the rated slope by ``ratio`` half axes. Expected result: refused if the ellipse is above it."""
    rise_m = math.tan(CHAIR.rating.slope_deg * DEG + MEASURED_RAD) * 0.30 + more_m
    assume(abs(ratio - 1.0) > 0.02)  # at one the rounding decides
    sigma_m = more_m / ratio / SHAPE_SIGMAS
    refused = certain_reject_reason(CHAIR, 50.0, rise_m, 0.30, (sigma_m, 0.0))
    assert refusal(rise_m, 0.30) is not None
    assert (refused is not None) == (ratio > 1.0)
    if refused is not None:
        assert refused == refusal(rise_m, 0.30)


def test_before_the_rise_is_measured_nothing_is_refused_and_a_feasible_stair_never() -> None:
    assert certain_reject_reason(CHAIR, 50.0, 0.21, 0.27, (math.inf, math.inf)) is None
    assert certain_reject_reason(CHAIR, 50.0, 0.16, 0.30, (0.0, 0.0)) is None
