"""Moments of synthetic runs whose true times are known, and the direction of the least tip-over margin against the simulator's."""

import math
from collections.abc import Callable
from dataclasses import astuple, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_y
from treadline.core.signals import Event, FrameQuality
from treadline.playback import (
    Limits,
    NosingComparison,
    PerceivedStair,
    PhaseSpan,
    Recording,
    comparison_of,
    findings_of,
    holding_at,
    least_margin,
    perceived_text,
    read_recording,
)
from treadline.playback import _moments as moments
from treadline.scenario.chair import read_chair
from treadline.scenario.faults import Fault
from treadline.scenario.scenario import Chair, Scenario, Stair
from treadline.vehicle.staircase import Staircase, as_designed

from .conftest import signals_of_a_run

# Literals, so that a changed value in the code is detected here.
SETTLED_RAD = 1.0 * DEG

Written = Callable[..., Path]
CHAIR = read_chair("wheelchair")
SCENARIO = Scenario(stair=Stair(slope_deg=28.0, steps=10), chair=Chair())
SLOPE_RAD = 28.0 * DEG


def test_the_numbers_of_perceived_nosings_add_up() -> None:
    """Test: eight perceived nosings, of which five are true ones. Expected: both numbers, and how many are none."""
    assert perceived_text(8, (8, 9, 10, 11, 12)) == "perceives 8 nosings: 8–12, and 3 where no true one is"
    assert perceived_text(3, (5, 7, 8)) == "perceives 3 nosings: 5, 7–8"
    assert perceived_text(1, ()) == "perceives 1 nosing, and no true one among them"
    assert perceived_text(2, None) == "perceives 2 nosings"


def of_pitch(pitch_rad: Any, *, speed_m_s: float = 0.1, **more: Any) -> Recording:
    """Return a run with a pitch at 100 Hz."""
    pitch = np.asarray(pitch_rad, dtype=float)
    belts = np.full((len(pitch), 2), speed_m_s)
    return Recording.of_curves(0.01 * np.arange(len(pitch)), CHAIR, pitch_rad=pitch, belt_m_s=belts, **more)


def climb_and_land() -> np.ndarray:
    """Return the pitch of 30 s: level, up to the slope from 2 s to 6 s, on the flight, and down from 20 s to 23 s."""
    return SLOPE_RAD * np.interp(0.01 * np.arange(3000), [0.0, 2.0, 6.0, 20.0, 23.0, 30.0], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])


# ---- ends of the flight ----


@pytest.mark.parametrize("known", [True, False])
def test_the_crest_is_when_the_pitch_leaves_the_slope_and_not_when_it_was_recognised(known: bool) -> None:
    """Test: a "crest" phase at 12 s, a pitch that falls from 20 s to 23 s, with and without a scenario."""
    events = (Event(t_s=12.0, name="crest", cause="end of the flight, seen"),)
    found = moments.crossings(of_pitch(climb_and_land(), events=events, scenario=SCENARIO if known else None))
    assert [moment.name for moment in found] == [
        "front lifts onto the first nosing",
        "parallel to the flight",
        "tips over the top edge",
        "level on the landing",
    ]
    # The pitch passes SETTLED_RAD on either side of a ramp of 28° in 4 s or 3 s; one sample of rounding.
    for moment, t_s, ramp_s in zip(found, (2.0, 6.0, 20.0, 23.0), (4.0, -4.0, 3.0, -3.0), strict=True):
        assert moment.t_s == pytest.approx(t_s + ramp_s * SETTLED_RAD / SLOPE_RAD, abs=0.011)


def test_a_descent_tips_over_the_edge_first_and_ends_on_the_floor() -> None:
    """Test: the same pitch, driven backwards. Expected: the names of a descent; the nose is up in both."""
    names = [moment.name for moment in moments.crossings(of_pitch(climb_and_land(), speed_m_s=-0.1, scenario=SCENARIO))]
    assert names == ["tips over the top edge", "parallel to the flight", "lower end on the floor", "level on the floor"]


def test_noise_and_an_unfinished_crest_give_no_false_moment() -> None:
    pitch = climb_and_land()[:2150] + np.random.default_rng(1).normal(0.0, 0.2 * DEG, 2150)
    found = moments.crossings(of_pitch(pitch, scenario=SCENARIO))
    # The run ends before the pitch is below half the slope: the chair may still come back.
    assert [moment.name for moment in found] == ["front lifts onto the first nosing", "parallel to the flight"]
    assert moments.crossings(of_pitch(np.zeros(500))) == ()
    assert moments.crossings(of_pitch(np.full(500, SLOPE_RAD), scenario=SCENARIO)) == ()


def test_a_chair_that_slides_back_to_the_floor_does_not_cross_the_crest() -> None:
    """Test: the same pitch and belts that climb, but the chair ends where it began. Expected: the moments of the floor."""
    height_m = np.interp(0.01 * np.arange(3000), [0.0, 2.0, 6.0, 15.0, 20.0, 23.0], [0.0, 0.0, 0.5, 1.5, 0.5, 0.0])
    place = np.column_stack([np.zeros((3000, 2)), height_m])
    names = [moment.name for moment in moments.crossings(of_pitch(climb_and_land(), scenario=SCENARIO, p_WB=place))]
    assert names[2:] == ["lower end on the floor", "level on the floor"]


def test_a_chair_that_turns_back_on_the_first_nosings_was_not_on_the_flight() -> None:
    assert moments.crossings(of_pitch(0.7 * climb_and_land(), scenario=SCENARIO)) == ()


# ---- faults, slip and holds ----


def slipping_run() -> Recording:
    """Return a chair on the flight that loses friction at 4 s and is held at 5 s after 0.3 m of roll-back."""
    t_s = 0.01 * np.arange(601)
    up_m = 1.0 + 0.1 * np.minimum(t_s, 4.0) - 0.3 * np.clip(t_s - 4.0, 0.0, 1.0)
    fault = Fault(kind="low_friction", at_s=4.0, for_s=1.5, value=0.35)
    return of_pitch(
        np.full(601, SLOPE_RAD),
        scenario=SCENARIO.model_copy(update={"fault": (fault,)}),
        limits=Limits(roll_back_m=0.25),
        friction_use=np.where(t_s < 4.0, 0.86, 2.4),
        place_S=np.column_stack([up_m, np.zeros(601)]),
        events=(
            Event(t_s=0.0, name="climb", cause="test"),
            Event(t_s=1.0, name="slow", cause="an earlier reason"),
            Event(t_s=4.3, name="slow", cause="slip 0.50"),
            Event(t_s=5.0, name="hold", cause="rolled back 0.26 m"),
            Event(t_s=5.5, name="rearmed", cause="attendant"),
        ),
        phases=(PhaseSpan(start_s=0.0, end_s=6.0, name="climb", cause="test"),),
    )


def test_a_hold_states_measurement_limit_and_truth_and_what_led_to_it() -> None:
    recording = slipping_run()
    (hold,) = moments.holds_of(recording)
    assert (hold.start_s, hold.end_s) == (5.0, 5.5)
    assert hold.cause == "rolled back 0.26 m as the guard measured it from the nosings, limit 0.25 m, ground truth 0.30 m"
    assert [(moment.name, moment.t_s) for moment in hold.chain] == [("fault", 4.0), ("slip", 4.0), ("slow", 4.3)]
    assert "low friction" in hold.chain[0].cause
    assert "0.35" in hold.chain[0].cause
    (unknown,) = moments.holds_of(replace(recording, scenario=None, limits=Limits()))
    assert unknown.cause == "rolled back 0.26 m as the guard measured it from the nosings"


def test_the_guard_holds_from_the_hold_to_the_re_arming() -> None:
    events = slipping_run().events
    assert [holding_at(events, t_s) is not None for t_s in (4.99, 5.0, 5.49, 5.5)] == [False, True, True, False]


def test_slip_counts_on_the_flight_alone() -> None:
    """Test: too little friction from 1 s to 3 s, on the flight from 2 s. Expected: slip from 2 s to 3 s."""
    t_s = 0.01 * np.arange(500)
    use = np.where((t_s >= 1.0) & (t_s < 3.0), 1.5, 0.5)
    pitch = np.where(t_s < 2.0, 0.0, SLOPE_RAD)
    (found,) = moments.slipping(of_pitch(pitch, scenario=SCENARIO, friction_use=use))
    assert (found.t_s, found.end_s) == (pytest.approx(2.0), pytest.approx(2.99))
    assert "150%" in found.cause


def test_short_pauses_do_not_divide_a_slip() -> None:
    """Test: slip from 1 s to 3 s with a pause of 0.3 s, and from 4 s to 5 s. Expected: two spans."""
    t_s = 0.01 * np.arange(600)
    slides = ((t_s >= 1.0) & (t_s < 3.0) & ~((t_s >= 2.0) & (t_s < 2.3))) | ((t_s >= 4.0) & (t_s < 5.0))
    found = moments.slipping(of_pitch(np.full(600, SLOPE_RAD), scenario=SCENARIO, friction_use=np.where(slides, 1.2, 0.5)))
    assert [(moment.t_s, moment.end_s) for moment in found] == [(1.0, pytest.approx(2.99)), (4.0, pytest.approx(4.99))]
    assert moments.slipping(of_pitch(np.full(600, SLOPE_RAD), scenario=SCENARIO, friction_use=np.full(600, 0.5))) == ()


def test_a_fault_after_the_end_of_the_run_is_no_moment() -> None:
    faults = [Fault(kind="camera_lost", at_s=2.0, for_s=9.0), Fault(kind="camera_lost", at_s=50.0)]
    (found,) = moments.fault_moments(of_pitch(np.zeros(601), scenario=SCENARIO.model_copy(update={"fault": tuple(faults)})))
    assert (found.t_s, found.end_s) == (2.0, 6.0)
    assert found.cause == "camera lost injected: no frame, heading or map arrives, until 11.0 s"


# ---- camera ----


def seen_at(t_s: float) -> PerceivedStair:
    return PerceivedStair(t_s=t_s, taken_s=t_s + 0.06, nosings_B=np.empty((0, 3)), nosings_W=np.empty((0, 3)), ends=False)


def test_a_silent_camera_and_frames_without_a_stair_are_separated() -> None:
    """Test: 10 Hz; no frame from 2 s to 3 s, one frame lost at 4 s, no stair from 5 s on. Expected: two spans and their names."""
    times = [round(0.1 * k, 1) for k in range(80) if not 20 < k < 30 and k != 40]
    maps = tuple(seen_at(t_s) for t_s in times if t_s <= 5.0)
    silent, unseen = moments.silences(of_pitch(np.zeros(800), maps=maps, exposures_s=np.array(times)))
    assert (silent.name, silent.t_s, silent.end_s) == ("no camera frame", 2.0, 3.0)
    assert (unseen.name, unseen.t_s, unseen.end_s) == ("no stair perceived", 5.0, pytest.approx(7.99))
    assert "29 frames, none with a stair" in unseen.cause


def test_a_log_that_does_not_count_frames_says_so() -> None:
    recording = of_pitch(np.zeros(800), maps=(seen_at(0.0),))
    (found,) = moments.silences(recording)
    assert "does not say whether there were frames" in found.cause


def test_exposures_and_limits_come_from_the_files_of_a_run(written: Written) -> None:
    """Test: frame qualities in the log, one with and one without an obstacle. Expected: their stamps, the guard's limits."""
    quality = FrameQuality(t_s=0.1, fingerprint=1, brightness=0.5, contrast=0.2, valid_share=0.9)
    looked = [(quality, 0.16), (replace(quality, t_s=0.2, obstacle_m=1.0), 0.26)]
    recording = read_recording(written([*signals_of_a_run(), *looked]))
    np.testing.assert_allclose(recording.exposures_s, [0.1, 0.2])
    assert recording.limits.pitch_rate_rad_s == 0.4
    assert of_pitch(np.zeros(3)).exposures_s is None


def test_all_moments_come_in_order_of_time() -> None:
    found = findings_of(slipping_run())
    times = [moment.t_s for moment in found.moments]
    assert times == sorted(times)
    assert {"fault", "slip", "hold", "slow", "climb"} <= {moment.name for moment in found.moments}
    assert findings_of(of_pitch([])).moments == ()


# ---- nosings ----


def comparison() -> NosingComparison:
    found = comparison_of(of_pitch([0.0], scenario=SCENARIO))
    assert found is not None
    return found


def test_perceived_nosings_are_found_and_a_left_out_one_is_missed() -> None:
    R_WB, p_WB = rotation_y(-SLOPE_RAD), np.array([0.5, 0.0, 0.28])  # with nosings 5 to 8 in its camera's image
    all_B = (as_designed(SCENARIO.stair).nosings_W - p_WB) @ R_WB
    found, missed = comparison().compare(all_B[4:8], R_WB, p_WB)
    assert (found, missed) == ((5, 6, 7, 8), ())
    found, missed = comparison().compare(all_B[[4, 6, 7]], R_WB, p_WB)
    assert (found, missed) == ((5, 7, 8), (6,))
    # A nosing between two true ones belongs to neither.
    found, _ = comparison().compare(0.5 * (all_B[[5]] + all_B[[6]]), R_WB, p_WB)
    assert found == ()


def test_a_nosing_at_the_border_of_the_image_is_not_missed() -> None:
    """Test: the chair drives over the floor towards the stair; all nosings but the first are perceived.

    Expected: the first one is missed until its riser leaves the image, and never again.
    """
    nosings = as_designed(SCENARIO.stair).nosings_W
    answers = []
    for x_m in np.arange(-2.0, -0.2, 0.05):
        place = np.array([x_m, 0.0, 0.0])
        _, missed = comparison().compare(nosings[1:6] - place, np.eye(3), place)
        answers.append(1 in missed)
    assert answers[0]
    assert not answers[-1]
    assert sum(a != b for a, b in pairwise(answers)) == 1


# ---- tip-over margin ----


def standing(payload_m: tuple[float, float, float]) -> Recording:
    """Return one sample of a chair on the floor before the stair, with a shifted load."""
    scenario = Scenario(stair=SCENARIO.stair, chair=Chair(payload_offset_m=payload_m))
    known = {"quat_WB": np.array([[1.0, 0.0, 0.0, 0.0]]), "p_WB": np.array([[-1.5, 0.0, 0.0]]), "seat_rad": np.zeros(1)}
    flipper = {"flipper_rad": np.full(1, 30.0 * DEG), "margin_rad": np.zeros(1)}
    return Recording.of_curves(np.zeros(1), CHAIR, scenario=scenario, **known, **flipper)


@pytest.mark.parametrize(
    ("payload_m", "direction"),
    [((0.3, 0.0, 0.0), "forward"), ((-0.4, 0.0, 0.0), "backward"), ((0.0, 0.3, 0.0), "left"), ((0.0, -0.3, 0.0), "right")],
)
def test_a_shifted_load_tips_the_chair_towards_itself(payload_m: tuple[float, float, float], direction: str) -> None:
    recording = standing(payload_m)
    margins = moments.margins_at(recording, 0)
    logged = replace(recording, margin_rad=np.array([min(astuple(margins))]))
    assert moments.tipping_direction(logged, 0) == direction


def test_a_logged_margin_that_no_direction_explains_has_none() -> None:
    recording = standing((0.3, 0.0, 0.0))
    assert moments.tipping_direction(replace(recording, margin_rad=np.array([80.0 * DEG])), 0) is None
    assert moments.tipping_direction(replace(recording, scenario=None), 0) is None
    assert least_margin(replace(recording, margin_rad=np.array([math.nan]))) is None


def test_the_margins_are_those_of_the_simulator(driven: tuple[Recording, Staircase]) -> None:
    """Test: a chair that stands on the flight and then drives half a pitch. Expected: the logged margin, with a direction.

    The simulator adds the contacts of the last quarter second, so single samples may differ: nine of ten agree within 0.1°.
    """
    recording, _ = driven
    count = len(recording.t_s)
    deviations = [abs(min(astuple(moments.margins_at(recording, k))) - recording.margin_rad[k]) for k in range(50, count, 5)]
    assert np.quantile(deviations, 0.9) < 0.1 * DEG
    assert moments.tipping_direction(recording, count - 1) == "backward"
