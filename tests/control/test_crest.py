"""State machine of the crest on synthetic readings, without a plant."""

import math

import pytest
from chassis import GEOMETRY, Chassis, known
from world import flipper

from treadline.control.crest_sequence import Crest
from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.loading import Loading, centre_of_mass_level, plumb

CHAIR = read_chair("wheelchair")


class Summit(Chassis):
    """A chair on a stair, before its last nosing."""

    AHEAD = 1.0

    def __init__(self, ahead_m: float, *, pitch_deg: float = 28.0, payload_kg: float = 50.0) -> None:
        slopes = [pitch_deg * DEG] * 4
        crest = Crest(Loading(chair=CHAIR, payload_kg=payload_kg), 0.2, known(pitch_deg * DEG, ahead_m, slopes))
        super().__init__(crest, ahead_m, pitch_deg, slopes)

    @classmethod
    def leading(cls) -> "Summit":
        """Return a chair whose tip carries and whose centre of mass has passed the nosing."""
        chair = cls(0.6)
        chair.run(6.0)
        chair.until("lead", tip_n=120.0)
        return chair

    def stopped(self, tip_n: float) -> float:
        del tip_n
        return max(self.angle_rad, -75.0 * DEG)


@pytest.mark.parametrize(("slope_deg", "below_deg"), [(28.0, 61.0), (30.0, 66.0)])
def test_the_flipper_needs_more_than_45_degrees_below_the_belts(slope_deg: float, below_deg: float) -> None:
    # β + asin(d sin β / L) at d = 0.53 m, minus the effect of two equal pulleys on ground of two slopes: under 2°.
    slope = slope_deg * DEG
    assert (slope + GEOMETRY.depression(slope, 0.53)) / DEG == pytest.approx(below_deg - 1.3, abs=0.7)


@pytest.mark.parametrize("pitch_deg", [5.0, 15.0, 30.0])
@pytest.mark.parametrize("past_m", [0.2, 0.5, 0.7])
def test_the_flippers_angle_determines_the_distance_of_the_nosing(pitch_deg: float, past_m: float) -> None:
    pitch = pitch_deg * DEG
    angle = -(pitch + GEOMETRY.depression(pitch, past_m))
    assert GEOMETRY.past(pitch, angle) == pytest.approx(past_m, abs=1e-9)


def test_the_rates_are_the_derivatives() -> None:
    def angle(pitch: float, past_m: float) -> float:
        return -(pitch + GEOMETRY.depression(pitch, past_m))

    pitch, past_m, h = 20.0 * DEG, 0.5, 1e-6
    per_pitch = (angle(pitch + h, past_m) - angle(pitch - h, past_m)) / (2.0 * h)
    per_metre = (angle(pitch, past_m + h) - angle(pitch, past_m - h)) / (2.0 * h)
    # Central differences: h² and rounding, about 1e-9.
    assert GEOMETRY.rates(pitch, past_m) == pytest.approx((per_pitch, per_metre), abs=1e-6)


def test_the_sliding_distance_is_the_derivative_of_the_reach() -> None:
    pitch, past_m, h = 25.0 * DEG, 0.6, 1e-6
    grows = (GEOMETRY.reach(pitch - h, past_m) - GEOMETRY.reach(pitch + h, past_m)) / (2.0 * h)
    # Central differences: h² and rounding, about 1e-9.
    assert GEOMETRY.slide(pitch, past_m) == pytest.approx(grows, abs=1e-6)


def test_the_assumed_centre_of_mass_is_that_of_the_chair_file() -> None:
    x, z = centre_of_mass_level(Loading(chair=CHAIR, payload_kg=50.0), 28.0 * DEG)
    expected = centre_of_mass(CHAIR, Chair(payload_kg=50.0), 28.0 * DEG, -60.0 * DEG)
    # The flipper is included with its mass at its axis.
    assert (x, z) == pytest.approx((expected[0], expected[2]), abs=0.01)


def test_a_chair_with_a_fixed_flipper_planner_is_rejected() -> None:
    with pytest.raises(MechanicsError, match=r"'wheelchair-fixed' has no driven flipper.*use wheelchair"):
        Crest(Loading(chair=read_chair("wheelchair-fixed"), payload_kg=50.0), 0.2, known(0.5, 1.0, [0.5]))


def test_it_climbs_then_slows_down_half_a_metre_before_the_centre_of_mass_is_there() -> None:
    chair = Summit(2.0)
    assert chair.run(1.0).stage == "climb"
    assert chair.until("slow").speed_m_s == 0.1
    x, z = centre_of_mass_level(Loading(chair=CHAIR, payload_kg=50.0), 28.0 * DEG)
    assert chair.nosing_m - (x - z * math.tan(28.0 * DEG)) >= 0.5 - 0.005  # two ticks at 0.2 m/s


def test_a_tip_that_never_finds_the_landing_keeps_the_chair_where_it_is() -> None:
    chair = Summit(0.6)
    reached = chair.run(12.0)
    # After eight seconds the sequence is barred.
    assert (reached.stage, reached.speed_m_s) == ("barred", 0.0)
    assert chair.angle_rad < -70.0 * DEG  # straight down and further: 28° plus 42°
    waiting = chair.nosing_m
    chair.run(5.0)
    assert chair.nosing_m == waiting


@pytest.mark.parametrize("slope_deg", [20.0, 30.0])
@pytest.mark.parametrize("payload_kg", [0.0, 12.0, 110.0])
def test_a_tip_that_stands_on_the_nosing_itself_is_lifted_and_tries_again_further_on(payload_kg: float, slope_deg: float) -> None:
    """Test: belts have slipped, and the flipper, hardly lowered, lifts the chair by a degree. Expected result: the flipper is
    raised, the chair moves on by 5 cm, and the flipper reaches again; after at least two
    such attempts the sequence is barred, with the centre of mass still behind the assumed nosing."""
    chair = Summit(0.6, pitch_deg=slope_deg, payload_kg=payload_kg)
    tries, stage, before_m = 0, "slow", math.inf
    while stage == "slow":
        chair.pitch_deg = slope_deg
        chair.until("reach")
        if tries > 0:
            assert before_m - chair.nosing_m == pytest.approx(0.05, abs=0.005)
        before_m = chair.nosing_m
        chair.pitch_deg += 1.2
        while (command := chair.run(0.01, tip_n=60.0)).stage == "reach":
            pass
        stage, tries = command.stage, tries + 1
    assert (stage, command.speed_m_s) == ("barred", 0.0)
    assert f"stood on the last nosing, try {tries}" in command.cause
    assert tries >= 3
    assert plumb(Loading(chair=CHAIR, payload_kg=payload_kg), slope_deg * DEG) < chair.nosing_m


def test_a_lifted_light_chair_counts_as_contact_and_is_lifted_no_further() -> None:
    """Test: the tip on the landing, the chair pitched up by a degree before the load reaches 80 N. Expected result: contact is
    recognised; the flipper stays in place as long as the chair is lifted."""
    chair = Summit(0.6)
    chair.until("reach")
    while chair.angle_rad > -(28.0 * DEG + GEOMETRY.depression(28.0 * DEG, 0.08)):
        assert chair.run(0.01).stage == "reach"
    chair.pitch_deg = 29.2
    assert chair.run(0.1, tip_n=60.0).stage == "carry"
    assert chair.run(0.3, tip_n=60.0).flipper.rate_rad_s == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("stage", ["reach", "carry"])
def test_a_flipper_that_props_the_chair_up_is_barred(stage: str) -> None:
    chair = Summit(0.6)
    chair.until("reach")
    if stage == "carry":
        chair.run(2.6)
        chair.until("carry", tip_n=90.0)
    chair.pitch_deg = 32.5
    command = chair.run(0.1, tip_n=40.0)
    assert (command.stage, command.speed_m_s) == ("barred", 0.0)
    assert "lifted the chair by 4.5°" in command.cause


def test_belts_that_run_on_under_a_chair_that_stays_are_stopped() -> None:
    """Test: the tip carries, and by the flipper the nosing stays ahead. Expected result: barred after eight seconds."""
    chair = Summit(0.6)
    chair.until("reach")
    chair.run(2.6)
    chair.until("carry", tip_n=90.0)
    begun_s = chair.t_s
    for _ in range(3000):
        chair.angle_rad = -30.0 * DEG
        if (command := chair.run(0.01, tip_n=90.0)).stage == "barred":
            break
    assert command.stage == "barred"
    assert "they slip on the last nosing" in command.cause
    assert chair.t_s - begun_s == pytest.approx(8.0, abs=1.0)


def test_a_short_knock_on_the_flipper_is_not_the_landing() -> None:
    chair = Summit(0.6)
    chair.run(4.5)
    chair.run(0.05, tip_n=300.0)
    assert chair.run(0.05).stage == "reach"


def test_it_leads_only_when_the_tip_carries_and_the_centre_of_mass_has_passed() -> None:
    chair = Summit(0.6)
    chair.run(6.0)
    assert chair.run(0.4, tip_n=100.0).stage == "carry"
    # 120 N: slightly less than the nominal tip load, so that the flipper follows the belts.
    assert chair.until("lead", tip_n=120.0).speed_m_s < 0.1
    # Lowering the pitch raises the flipper relative to the chair: about 2.2 times the pitch rate by geometry.
    assert chair.run(0.5, tip_n=140.0).flipper.rate_rad_s > 10.0 * DEG


def test_a_tip_that_unloads_in_the_lead_is_pressed_down_again() -> None:
    chair = Summit.leading()
    chair.run(0.3, tip_n=140.0)
    command = chair.run(0.5)
    assert command.stage == "carry"
    assert command.flipper.rate_rad_s < 0.0


def test_a_tip_supported_by_friction_is_ignored_while_the_chair_follows() -> None:
    """Test: almost no motor torque, and the pitch follows the reference. Expected result: the reference continues, no faster than
    the tip may slide."""
    chair = Summit.leading()
    while chair.pitch_deg > 8.5:
        before_rad, pitch_rad = chair.sequence._lead_rad, chair.pitch_deg * DEG
        command = chair.run(0.01, tip_n=10.0)
        chair.pitch_deg = chair.sequence._lead_rad / DEG + 0.2  # compliance of servo and flipper
        assert command.stage == "lead"
        slides_m_s = (before_rad - chair.sequence._lead_rad) / 0.01 * GEOMETRY.slide(pitch_rad, GEOMETRY.pivot_m - chair.nosing_m)
        assert slides_m_s <= 0.06 + 1e-9
    assert command.flipper.rate_rad_s > 10.0 * DEG


def test_a_chair_that_neither_leans_on_the_tip_nor_follows_is_lowered_slowly() -> None:
    """Test: the reference starts, the tip unloads, and the pitch stays. Expected result: once the pitch lags by more than the
    compliance of servo and flipper, the reference slows to the waiting rate, so that a chair that tips after all falls less."""
    chair = Summit.leading()
    leads_rad_s = []
    while chair.sequence._stage == "lead":
        before_rad = chair.sequence._lead_rad
        behind = chair.pitch_deg * DEG > before_rad + 0.25 * DEG
        chair.run(0.01)
        if behind and chair.sequence._stage == "lead":
            leads_rad_s.append((before_rad - chair.sequence._lead_rad) / 0.01)
    assert leads_rad_s
    assert max(leads_rad_s) <= 4.0 * DEG + 1e-9


@pytest.mark.parametrize(("above_deg", "rate_deg_s"), [(20.0, 16.0), (0.0, 8.0), (-5.0, 8.0)])
def test_the_flipper_reaches_fast_and_meets_the_landing_slowly(above_deg: float, rate_deg_s: float) -> None:
    """Test: a flipper that reaches down, far above the expected contact of its tip, at it, and below. Expected result: full rate,
    then half the rate, also where the landing is lower than expected from nosing and pitch."""
    chair = Summit(0.6)
    chair.until("reach")
    pitch_rad = chair.pitch_deg * DEG
    angle_rad = above_deg * DEG - pitch_rad - GEOMETRY.depression(pitch_rad, GEOMETRY.pivot_m - chair.nosing_m)
    asked_rad_s = chair.sequence._reach(pitch_rad, flipper(chair.t_s, angle_rad))
    assert asked_rad_s == pytest.approx(-rate_deg_s * DEG)


def test_with_an_unloaded_tip_the_chair_waits_before_the_nosing() -> None:
    chair = Summit(0.6)
    chair.run(6.0)
    chair.run(0.4, tip_n=100.0)
    command = chair.run(8.0)  # the tip has lost contact with the landing
    assert (command.stage, command.speed_m_s) == ("carry", 0.0)


def test_a_chair_on_the_landing_is_detected_by_its_flipper_despite_a_gravity_error() -> None:
    chair = Summit.leading()
    chair.pitch_deg = 2.0  # error of gravity: the chair is horizontal
    assert chair.run(0.9).stage == "lead"
    assert chair.run(0.3).stage == "land"


@pytest.mark.parametrize("pitch_deg", [-0.3, 0.0, 0.3, 5.0])
def test_a_loaded_tip_under_a_horizontal_chair_does_not_move_the_nosing(pitch_deg: float) -> None:
    """Test: the chair is pushed over; by the flipper the landing is horizontal. Expected result: the position by belts and map."""
    chair = Summit(0.6)
    chair.run(6.0)
    chair.pitch_deg = pitch_deg
    while (command := chair.run(0.01, tip_n=100.0)).stage == "reach":
        pass
    assert command.stage == "carry"
    assert chair.sequence._ahead_m == pytest.approx(chair.nosing_m, abs=0.01)
    chair.pitch_deg = min(pitch_deg, 0.3)
    chair.until("land", tip_n=100.0)
    chair.until("done")
    assert chair.nosing_m == pytest.approx(-GEOMETRY.pivot_m, abs=0.01)


def test_level_it_stows_the_flipper_and_ends_when_the_rear_has_left_the_nosing() -> None:
    chair = Summit.leading()
    chair.pitch_deg = 0.3
    assert chair.run(0.1, tip_n=140.0).stage == "land"
    assert chair.run(15.0).stage == "done"
    assert chair.angle_rad == pytest.approx(40.0 * DEG, abs=1.0 * DEG)


def test_the_place_by_a_tip_on_the_landing_stands_above_that_of_the_map() -> None:
    """Test: the map puts the nosings 6 cm too far ahead. Expected result: once the tip stands on the landing, the sequence knows
    the place within a centimetre."""
    chair = Summit(0.6)
    chair.mapped_m = 0.06
    chair.until("reach")
    chair.run(1.0)
    past_m = GEOMETRY.pivot_m - chair.nosing_m
    chair.angle_rad = -(28.0 * DEG + GEOMETRY.depression(28.0 * DEG, past_m))
    while chair.run(0.01, tip_n=90.0).stage != "carry":
        chair.angle_rad = -(28.0 * DEG + GEOMETRY.depression(28.0 * DEG, past_m))
    assert chair.sequence._ahead_m == pytest.approx(chair.nosing_m, abs=0.01)


def test_nosings_steeper_than_the_flipper_reaches_stop_the_chair_before_the_crest() -> None:
    """Test: the last step is so high that the chair would pass it at 40°. Expected result: barred on the flight."""
    chair = Summit(1.2)
    chair.slopes_rad = [40.0 * DEG, *chair.slopes_rad]
    command = chair.until("barred")
    assert command.speed_m_s == 0.0
    assert command.cause == "a flipper that turns to -75° is too short for last nosings of 40.0°"


def test_below_a_low_last_step_the_chair_is_lowered_first_about_the_nosing_that_bears_it() -> None:
    """Test: the last step is a third as steep as the flight. Expected result: the belts lie on the nosings before the last, and the
    pitch is led when the centre of mass has passed the upper one of those, before the landing's edge."""
    chair = Summit(0.6)
    chair.slopes_rad = [10.0 * DEG, *chair.slopes_rad]
    chair.until("reach")
    step_m, turned, pitch = 0.34, 18.0 * DEG, 28.0 * DEG
    while (command := chair.run(0.01, tip_n=0.0 if chair.t_s < 8.0 else 120.0)).stage != "lead":
        past_m = GEOMETRY.pivot_m - chair.nosing_m + step_m * math.cos(turned)
        chair.angle_rad = -(pitch + GEOMETRY.depression(pitch, past_m, step_m * math.sin(10.0 * DEG)))
        assert command.stage in ("reach", "carry")
    loading = Loading(chair=CHAIR, payload_kg=50.0)
    assert chair.nosing_m == pytest.approx(plumb(loading, pitch) + step_m * math.cos(turned) - 0.03, abs=0.02)
