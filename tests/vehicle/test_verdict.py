"""The verdict: every refusal has its number and a remedy, and the remedy works."""

import math
import re
from typing import Any

import pytest
from chairs import CHAIR, judge, with_piece
from hypothesis import given, settings
from hypothesis import strategies as st

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.run.resolve import checked as check
from treadline.run.verdict import CheckReport
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import SEAT_SHIFT_M, DriveSettings, Scenario, Start, read_scenario, shipped_scenarios
from treadline.scenario.shipped_files import CHAIRS
from treadline.vehicle.loading import Loading


def assert_refused_only_for(report: CheckReport, *words: str) -> str:
    """Return the one reason; it holds the words, a number, and after a semicolon what to do."""
    assert report.verdict == "refuse"
    (reason,) = report.reasons
    for word in words:
        assert word in reason
    what, _, remedy = reason.rpartition("; ")
    assert re.search(r"\d", what)
    assert remedy
    return reason


@pytest.mark.parametrize("chair", [path.stem for path in CHAIRS.glob("*.toml")])
@pytest.mark.parametrize("scenario", list(shipped_scenarios()))
def test_every_shipped_chair_may_climb_every_shipped_scenario(scenario: str, chair: str) -> None:
    asked = read_scenario(scenario)
    if chair == "rescue":  # 50 kg are not for a robot of 20
        asked = asked.model_copy(update={"chair": asked.chair.model_copy(update={"payload_kg": 3.0})})
    report = check(asked, read_chair(chair))
    crosses = scenario.startswith(("up-", "down-", "quarter-"))
    if chair == "wheelchair-fixed" and crosses:  # no rear camera, and no flipper
        assert report.verdict == "refuse"
        return
    assert (report.verdict, report.reasons, report.proposed_seat_shift_m) == ("go", [], None)


@pytest.mark.parametrize("slope_deg", [25, 28, 30])
def test_the_slopes_of_table_2_are_go_from_30_degrees_of_heading(slope_deg: int) -> None:
    for heading_deg in (-30, 0, 30):
        report = judge(stair={"slope_deg": slope_deg, "width_m": 2.4}, start={"heading_deg": heading_deg})
        assert report.verdict == "go"
        assert min(report.stability_margin_deg.values()) >= 5.0  # over the crest too; a passenger 5 cm further back takes four


def test_the_numbers_are_those_of_the_stair() -> None:
    report = judge(stair={"rise_m": 0.16, "run_m": 0.30})
    assert report.friction_needed == pytest.approx(0.16 / 0.30)
    assert report.friction_available == 0.62
    assert report.friction_use_at_start == pytest.approx(0.16 / 0.30 / 0.62)
    assert report.track_length_margin_m == pytest.approx(0.95 + 0.45 - 2.0 * 0.34)  # flat run, and the flipper in line with it
    fixed = judge(read_chair("wheelchair-fixed"), stair={"rise_m": 0.16, "run_m": 0.30})
    assert fixed.track_length_margin_m == pytest.approx(0.95 - 2.0 * 0.34)
    assert (report.nosings_in_contact, fixed.nosings_in_contact) == (4, 2)  # 1.40 / 0.34 = 4.1; 0.95 / 0.34 = 2.8
    assert report.seat_range_deg == pytest.approx((-7.0, 44.3), abs=0.05)


def test_the_track_that_two_pitches_lack_is_named_whatever_the_verdict() -> None:
    report = judge(with_piece("tracks", flat_run_m=0.22), stair={"rise_m": 0.16, "run_m": 0.30})
    assert report.track_length_margin_m == pytest.approx(-0.01)


def test_a_slippery_stair_is_refused_with_the_slope_it_would_do() -> None:
    report = judge(stair={"slope_deg": 28, "friction": [0.5, 0.5]})
    reason = assert_refused_only_for(report, "friction 0.50 is below 1.05 × tan β = 0.56", "roughen the nosings")
    steepest = float(reason.rsplit("below ", 1)[1].rstrip("°"))
    # The remedy is printed to 0.1°.
    for change, verdict in ((-0.06, "go"), (0.06, "refuse")):
        assert judge(stair={"slope_deg": steepest + change, "friction": [0.5, 0.5]}).verdict == verdict


def test_a_start_at_too_large_a_heading_is_refused_with_the_heading_that_holds() -> None:
    keys = {"slope_deg": 30, "width_m": 2.4}
    report = judge(stair=keys, start={"place": "flight", "heading_deg": 45})
    reason = assert_refused_only_for(report, "at a heading of 45° the chair slides", "start squarer than 32°")
    assert "(friction use 1.05)" in reason
    assert judge(stair=keys, start={"place": "flight", "heading_deg": 32}).verdict == "go"
    # On the floor it turns first.
    assert judge(stair=keys, start={"heading_deg": 45}).verdict == "go"


UP_AND_DOWN: dict[str, dict[str, Any]] = {
    "up": {"start": {"place": "floor"}},
    "down": {"start": {"place": "landing"}, "drive": {"direction": "down"}},
}
EIGHT = {"slope_deg": 28, "steps": 8}


@pytest.mark.parametrize(("direction", "ahead_m"), [("up", -0.2), ("down", -0.2), ("up", -0.15)])
def test_a_proposed_seat_shift_makes_the_walk_quiet(direction: str, ahead_m: float) -> None:
    """Test: 80 kg that lean back. Expected result: go, or refused for the moment at which the chair would turn too fast; with a
    proposed shift it is go."""
    loading = {"payload_kg": 80, "payload_offset_m": [ahead_m, 0.0, 0.05]}
    report = judge(stair=EIGHT, chair=loading, **UP_AND_DOWN[direction])
    if report.verdict == "go":
        assert report.walk.fastest.rate_rad_s < 15.0 * DEG
        return
    shift_m = report.proposed_seat_shift_m
    (reason,) = report.reasons
    assert "the chair would turn at" in reason or "are left to tipping" in reason
    if shift_m is None:
        assert reason.endswith("take another way")
        return
    assert f"shift the seat {1000 * abs(shift_m):.0f} mm uphill" in reason
    assert judge(stair=EIGHT, chair=loading | {"seat_shift_m": shift_m}, **UP_AND_DOWN[direction]).verdict == "go"


@pytest.mark.parametrize("direction", UP_AND_DOWN)
def test_the_stair_that_tipped_the_chair_is_walked_quietly(direction: str) -> None:
    """Test: two steps of 150 by 500 mm, from which a chair tipped at 29.6°/s after a go: its flipper was lifted before the weight
    passed the lower nosing. Expected result: go both ways, below 9°/s and with the torque of the motor."""
    report = judge(stair={"rise_m": 0.15, "run_m": 0.50, "steps": 2}, **UP_AND_DOWN[direction])
    assert (report.verdict, report.reasons) == ("go", [])
    assert report.walk.fastest.rate_rad_s < 9.0 * DEG
    assert max(report.walk.hardest.pose.torques_n_m) < 200.0


@pytest.mark.parametrize("direction", UP_AND_DOWN)
def test_a_chair_that_cannot_carry_its_load_is_refused_with_a_load_or_a_motor_that_would_do(direction: str) -> None:
    """Test: a flipper of 40 N m under 75 kg. Expected result: refused, and what is proposed is go."""
    weak, tables = with_piece("flipper", torque_n_m=40.0), UP_AND_DOWN[direction]
    report = judge(weak, stair=EIGHT, chair={"payload_kg": 75}, **tables)
    assert report.verdict == "refuse"
    (reason,) = report.reasons
    lighter = re.search(r"take (\d+) kg at most", reason)
    if lighter is not None:
        assert judge(weak, stair=EIGHT, chair={"payload_kg": float(lighter[1])}, **tables).verdict == "go"
    elif report.proposed_seat_shift_m is not None:
        shifted = {"payload_kg": 75, "seat_shift_m": report.proposed_seat_shift_m}
        assert judge(weak, stair=EIGHT, chair=shifted, **tables).verdict == "go"
    else:
        assert reason.endswith("; take another way") or "would do" in reason


def test_the_margins_are_the_least_of_the_walk() -> None:
    report = judge(stair=EIGHT, **UP_AND_DOWN["up"])
    poses = [stride.pose for stride in report.walk.strides]
    assert report.stability_margin_deg["uphill"] == pytest.approx(min(pose.front_margin_rad for pose in poses) / DEG)
    assert report.stability_margin_deg["downhill"] == pytest.approx(min(pose.rear_margin_rad for pose in poses) / DEG)
    assert 0.0 < report.stability_margin_deg["downhill"] < 15.0


def test_a_payload_far_aside_is_refused_where_no_shift_helps() -> None:
    for aside, side, other in ((0.5, "left", "right"), (-0.5, "right", "left")):
        report = judge(stair={"slope_deg": 28}, chair={"payload_offset_m": [0.0, aside, 0.0], "payload_kg": 90})
        assert_refused_only_for(report, f"the tipping margin {side} is", f"move the payload to the {other}")
        assert report.proposed_seat_shift_m is None


def test_a_seat_that_cannot_reach_level_is_refused() -> None:
    report = judge(with_piece("seat", stroke_m=(-0.012, 0.09)), stair={"slope_deg": 28})
    reach = report.seat_range_deg[1]
    assert 20.0 < reach < 28.0
    assert_refused_only_for(report, f"the seat reaches {reach:.0f}°, the stair needs 31°", "lengthen its stroke")


def test_a_chair_that_its_brakes_would_not_hold_is_refused_with_the_slope_they_hold() -> None:
    """Test: brakes of 200 N a belt under chair and 50 kg. Expected result: half the pull down 28°, and half as much again, is more;
    on the stair named instead it may climb."""
    weak = with_piece("drives", brake_hold_n=200.0)
    pull_n = Loading(chair=weak, payload_kg=50.0).weight_n * math.sin(28.0 * DEG)
    assert 200.0 < 0.5 * 1.5 * pull_n < 1500.0
    asked = f"each belt's brake holds 200 N and needs {0.75 * pull_n:.0f} N with 50 kg on 28.0°"
    reason = assert_refused_only_for(judge(weak, stair={"slope_deg": 28}, chair={"payload_kg": 50.0}), asked, "take less payload")
    below_deg = float(reason.rpartition("below ")[2].rstrip("°"))
    assert judge(weak, stair={"slope_deg": below_deg - 0.1}, chair={"payload_kg": 50.0}).verdict == "go"


LOW_STAIR = {"rise_m": 0.08, "run_m": 0.20, "steps": 20}


@pytest.mark.parametrize("missing", [[5], [5, 6], [5, 7]])
def test_missing_steps_are_refused_with_their_distance_and_place(missing: list[int]) -> None:
    report = judge(stair=LOW_STAIR | {"missing_steps": missing})
    assert_refused_only_for(report, "a step is missing: ", "m from nosing to nosing", "take another way")


def test_a_start_beside_the_flight_is_refused() -> None:
    # 1.2 m of flight: a chair 0.75 m wide may stand 0.225 m off its middle.
    assert judge(start={"place": "flight", "lateral_m": -0.22}).verdict == "go"
    with pytest.raises(
        MechanicsError, match=r"cannot stand at its start: .* 0\.04 m outside the flight, .*; start nearer its middle"
    ):
        judge(start={"place": "flight", "lateral_m": -0.26})


@pytest.mark.parametrize(("place", "direction"), [("floor", "up"), ("landing", "down")])
def test_a_start_from_which_a_track_would_miss_the_flight_is_refused(place: str, direction: str) -> None:
    def at(lateral_m: float) -> CheckReport:
        return judge(start={"place": place, "lateral_m": lateral_m}, drive={"direction": direction})

    # Belts 0.65 m apart, a flight of 1.2 m: half of each is on it up to 0.275 m off its middle.
    for lateral_m in (-0.26, 0.27):
        assert at(lateral_m).verdict == "go"
    # The floor is 4 m wider than the flight, the landing as wide.
    beyond_m = 4.905
    if place == "floor":
        said = f"a track would enter {0.395 - 0.275:.2f} m outside the flight, which is 1.2 m wide"
        assert_refused_only_for(at(-0.395), said, "start nearer its middle")
    else:
        beyond_m = -0.395
    with pytest.raises(MechanicsError, match=f"m over an edge of the {place}; start squarer, or nearer its middle"):
        at(beyond_m)


@pytest.mark.parametrize(("slope_deg", "heading_deg"), [(20, 0), (28, 0), (28, 20), (30, 30)])
def test_a_start_in_the_floor_is_refused_with_the_first_step_that_would_do(slope_deg: int, heading_deg: int) -> None:
    keys = {"slope_deg": slope_deg, "width_m": 2.4}
    start = {"place": "flight", "heading_deg": heading_deg}
    with pytest.raises(MechanicsError, match=r"m below the floor, its front on step 0; start at step \d+ or above") as found:
        judge(stair=keys, start=start | {"step": 0})
    least = int(str(found.value).rpartition("start at step ")[2].split()[0])
    with pytest.raises(MechanicsError):
        judge(stair=keys, start=start | {"step": least - 1})
    assert judge(stair=keys, start=start | {"step": least}).verdict == "go"


def test_a_flight_too_low_for_the_track_is_entered_from_its_ends() -> None:
    with pytest.raises(MechanicsError, match=r"0\.14 m below the floor, its front on step 1; start on the floor or the landing"):
        judge(stair={"steps": 2}, start={"place": "flight", "step": 1})


@pytest.mark.parametrize(("end_wall", "needs_m"), [(False, 1.15), (True, 1.56)])
def test_a_landing_too_short_to_stand_on_is_refused_with_the_depth_it_needs(end_wall: bool, needs_m: float) -> None:
    """Test: belts of 0.95 m, 0.2 m from the edge; before a wall a flipper of 0.45 m, raised by 40°, and its pulley of 0.07 m."""
    keys = {"start": {"place": "landing"}, "drive": {"direction": "down"}}
    with pytest.raises(
        MechanicsError, match=f"the landing is .* needs {needs_m:.2f} m; start on the flight, or give stair.landing_m"
    ):
        judge(stair={"landing_m": needs_m - 0.02, "end_wall": end_wall}, **keys)
    assert judge(stair={"landing_m": needs_m + 0.02, "end_wall": end_wall}, **keys).verdict == "go"


@pytest.mark.parametrize(("tables", "what"), [({}, "drop"), ({"end_wall": True}, "wall")])
def test_a_landing_that_a_chair_cannot_arrive_on_is_refused_with_its_depth(tables: dict[str, Any], what: str) -> None:
    report = judge(stair={"landing_m": 0.9} | tables)
    reason = assert_refused_only_for(report, "the landing is 0.90 m deep", what, "take another way, or give stair.landing_m")
    needed = float(reason.rpartition("needs ")[2].split()[0])
    for landing_m, verdict in ((needed - 0.01, "refuse"), (needed + 0.01, "go")):
        assert judge(stair={"landing_m": landing_m} | tables).verdict == verdict


@pytest.mark.parametrize("lateral_m", [0.0, 0.3])
def test_an_edge_hidden_under_the_rear_camera_is_one_step_above_the_first_nosing_in_view(lateral_m: float) -> None:
    """Test: on a landing of 1.2 m, also 0.3 m off its middle; with treads 0.22 m deep two nosings are hidden. Expected result: go;
    refused with what to move, because the camera at 0.45 m and 40° sees the ground from 0.40 m behind the belts on."""
    tables = {"start": {"place": "landing", "lateral_m": lateral_m}, "drive": {"direction": "down"}}
    assert judge(stair={"landing_m": 1.2, "width_m": 1.6}, **tables).verdict == "go"
    short = {"width_m": 1.6, "slope_deg": 28.0, "run_m": 0.22}
    report = judge(stair={"landing_m": 1.2} | short, **tables)
    reason = assert_refused_only_for(report, "the edge, 0.20 m behind the belts, is hidden under the rear camera", "set the chair")
    needed = float(reason.rpartition("landing of ")[2].split()[0])
    assert judge(stair={"landing_m": needed + 0.01} | short, **tables).verdict == "go"


@pytest.mark.parametrize(
    ("chair", "tables", "warning"),
    [
        (CHAIR, {"start": {"heading_deg": 0.52}}, "start.heading_deg is 0.52°; did you mean 29.8, for 0.52 rad?"),
        (with_piece("camera", pitch_deg=0.698), {}, "camera.pitch_deg is 0.698°; did you mean 40.0, for 0.698 rad?"),
        (with_piece("tracks", approach_angle_deg=0.7), {}, "tracks.approach_angle_deg is 0.7°; did you mean 40.1, for 0.7 rad?"),
    ],
)
def test_an_angle_that_may_be_in_radians_is_asked_about(chair: ChairDescription, tables: dict[str, Any], warning: str) -> None:
    report = judge(chair, **tables)
    assert report.warnings == [warning]


def test_no_shipped_file_is_asked_about_and_neither_is_a_heading_of_two_degrees() -> None:
    for path in CHAIRS.glob("*.toml"):
        assert judge(read_chair(path.stem), start={"heading_deg": 2.0}).warnings == []


@pytest.mark.parametrize("place", ["floor", "landing"])
@pytest.mark.parametrize("rise_m", [0.05, 0.12, 0.20])
def test_a_kerb_that_users_clear_is_go_both_ways(rise_m: float, place: str) -> None:
    """23 of 25 users of a TopChair cleared a kerb of 20 cm. Half the flat run of 0.95 m stands on its nosing as it tips over."""
    drive = {"direction": "down" if place == "landing" else "up"}
    report = judge(stair={"steps": 1, "rise_m": rise_m, "landing_m": 3.0}, start={"place": place}, drive=drive)
    assert (report.verdict, report.reasons) == ("go", [])
    assert (report.nosings_in_contact, report.nosings_in_view, report.track_length_margin_m) == (1, 1, None)
    assert report.friction_needed == pytest.approx(math.tan(math.asin(rise_m / 0.475)))


def test_a_kerb_too_high_is_refused_with_the_pitch_it_needs() -> None:
    report = judge(stair={"steps": 1, "rise_m": 0.26, "friction": [1.0, 0.8], "landing_m": 3.0})
    assert any("over the kerb of 0.26 m the chair pitches by 33.2°" in reason for reason in report.reasons)


def test_the_height_of_a_kerb_may_stand_in_a_step() -> None:
    low = judge(stair={"steps": 1, "landing_m": 3.0}, step=[{"index": 0, "rise_m": 0.015}])
    assert low.friction_needed == pytest.approx(0.015 / 0.475, rel=1e-3)
    assert judge(stair={"steps": 1, "rise_m": 0.015, "landing_m": 3.0}, sensors={"model": "statistical"}).verdict == "go"
    assert_refused_only_for(low, "a threshold of 0.015 m is ground: the detector sees single steps from 0.04 m on", "by hand")


stairs = st.fixed_dictionaries(
    {
        "slope_deg": st.floats(19.0, 26.0),  # of which any run here is a rise that may be
        "run_m": st.floats(0.15, 0.60),
        "friction": st.tuples(st.floats(0.01, 2.0), st.floats(0.01, 2.0)),
        "steps": st.integers(14, 16),
        "missing_steps": st.lists(st.integers(0, 12), max_size=13).map(tuple),
    }
)
loadings = st.fixed_dictionaries(
    {
        "payload_kg": st.floats(0.0, 200.0),
        "payload_offset_m": st.tuples(*[st.floats(-0.5, 0.5)] * 3),
        "seat_shift_m": st.floats(*SEAT_SHIFT_M),
    }
)
# In the middle of the flight, mostly where the chair can stand.
starts = st.fixed_dictionaries({"heading_deg": st.floats(-15.0, 15.0), "lateral_m": st.floats(-0.2, 0.2), "step": st.just(12)})


@given(stair=stairs, loading=loadings, start=starts)
@settings(max_examples=40)  # each refusal by a walk walks up to ten remedies
def test_any_scenario_gets_a_verdict_whose_reasons_have_number_and_remedy(
    stair: dict[str, Any], loading: dict[str, Any], start: dict[str, Any]
) -> None:
    try:
        report = judge(stair=stair, chair=loading, start=start | {"place": "flight"})
    except MechanicsError as error:
        reasons = [str(error)]
    else:
        reasons = report.reasons
        assert report.verdict == ("refuse" if reasons else "go")
        assert all(math.isfinite(margin) for margin in report.stability_margin_deg.values())
    for reason in reasons:
        what, _, remedy = reason.rpartition("; ")
        assert re.search(r"\d", what)
        assert remedy
        assert "nan" not in reason


@pytest.mark.parametrize(
    ("place", "direction", "why"),
    [
        ("floor", "down", "no flight leads down from start.place = 'floor'; start on the landing, or give drive.direction = 'up'"),
        ("landing", "up", "no flight leads up from start.place = 'landing'; start on the floor, or give drive.direction = 'down'"),
        ("floor", "up", None),
        ("landing", "down", None),
        ("flight", "up", None),
        ("flight", "down", None),
    ],
)
def test_a_flight_leads_from_where_the_chair_starts_to_where_it_goes(place: Any, direction: Any, why: str | None) -> None:
    report = check(Scenario(start=Start(place=place), drive=DriveSettings(direction=direction)), read_chair("wheelchair"))
    assert [reason for reason in report.reasons if "leads" in reason] == ([] if why is None else [why])


@pytest.mark.parametrize(("yaw_deg", "verdict"), [(1.9, "go"), (2.1, "refuse")])
def test_neighbouring_nosings_that_differ_in_direction_by_more_than_two_degrees_are_refused(yaw_deg: float, verdict: str) -> None:
    report = judge(read_chair("wheelchair"), stair={"rise_m": 0.16, "run_m": 0.30}, step=[{"index": 4, "yaw_deg": yaw_deg}])
    assert report.verdict == verdict
    assert all("differ in direction by 2.1°" in reason for reason in report.reasons)
