"""State machine of the edge on synthetic readings, without a plant."""

import math

import pytest
from chassis import GEOMETRY, Chassis, known

from treadline.control.edge_sequence import Edge
from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import read_chair
from treadline.vehicle.loading import Loading, before_for_margin, centre_of_mass_level, plumb

CHAIR = read_chair("wheelchair")
CONFIG = Loading(chair=CHAIR, payload_kg=50.0)
SLOPE = 28.0 * DEG
LIFTED_DEG = SLOPE / DEG
NEAR_M = 0.30
"""Distance of the nosing behind mid-track [m]: 5 cm before the tip is pressed down."""


class Brink(Chassis):
    """A chair on the landing before the edge behind it; a flipper whose tip carries follows the pitch."""

    AHEAD = -1.0

    def __init__(self, behind_m: float = NEAR_M) -> None:
        slopes = [SLOPE] * 4
        super().__init__(Edge(CONFIG, known(0.0, -behind_m, slopes)), behind_m, 0.0, slopes)

    def stopped(self, tip_n: float) -> float:
        pitch = self.pitch_deg * DEG
        return -(pitch + GEOMETRY.depression(pitch, 0.475 + self.nosing_m)) if tip_n > 0.0 else self.angle_rad

    def balanced_n(self, before_m: float) -> float:
        """Return the tip load for a distance of the plumb line before the nosing, along the belts."""
        pitch = self.pitch_deg * DEG
        return CONFIG.weight_n * before_m * math.cos(pitch) / GEOMETRY.reach(pitch, 0.475 + self.nosing_m)

    def pressed(self) -> "Brink":
        """Bring the chair to the start of the lift."""
        self.until("press")
        self.until("lift", tip_n=130.0)
        return self

    def lifted(self) -> "Brink":
        """Lift the chair completely, with its centre of mass at the assumed position."""
        self.pressed()
        while self.run(0.01, self.balanced_n(plumb(CONFIG, self.pitch_deg * DEG) + self.nosing_m), 8.0).stage == "lift":
            assert self.pitch_deg < 40.0
        return self


def test_a_chair_with_a_fixed_flipper_planner_is_rejected() -> None:
    with pytest.raises(MechanicsError, match=r"'wheelchair-fixed' has no driven flipper"):
        Edge(Loading(chair=read_chair("wheelchair-fixed"), payload_kg=50.0), known(0.0, -NEAR_M, [SLOPE]))


def test_it_backs_slowly_to_the_edge_and_lays_the_flipper() -> None:
    chair = Brink(1.2)
    assert chair.run(0.5).speed_m_s == -0.1
    assert chair.until("press").speed_m_s == 0.0
    assert chair.angle_rad == pytest.approx(2.0 * DEG, abs=0.5 * DEG)


@pytest.mark.parametrize("slope_deg", [20.0, 25.0, 30.0])
@pytest.mark.parametrize("payload_kg", [0.0, 50.0, 110.0])
def test_the_pressing_position_allows_for_15_cm_and_10_cm_of_error(slope_deg: float, payload_kg: float) -> None:
    config = Loading(chair=CHAIR, payload_kg=payload_kg)
    pressed_m = 0.25 - plumb(config, slope_deg * DEG)
    # Horizontal, the plumb line meets the belts at plumb(0): still before the nosing when both errors add up.
    assert pressed_m - 0.15 - 0.10 + plumb(config, 0.0) > 0.02
    # And 10 cm early the rear pulley is at the nosing, not on the landing behind it.
    assert pressed_m + 0.10 < GEOMETRY.pivot_m + 0.05


def test_a_tip_that_never_finds_the_landing_keeps_the_chair_where_it_is() -> None:
    chair = Brink()
    chair.until("press")
    waiting = chair.nosing_m
    command = chair.run(8.0 - 0.1)
    assert (command.stage, command.speed_m_s) == ("press", 0.0)
    assert chair.run(0.3).stage == "barred"
    assert chair.nosing_m == pytest.approx(waiting, abs=0.002)  # one tick at 0.1 m/s until the belts stop


def test_a_light_chair_that_rises_early_is_led_from_its_pitch() -> None:
    chair = Brink()
    chair.until("press")
    assert chair.run(0.3, tip_n=20.0, pitch_deg_s=4.0).stage == "lift"


def test_the_flipper_moves_down_faster_than_the_front_rises() -> None:
    chair = Brink().pressed()
    command = chair.run(1.0, tip_n=250.0, pitch_deg_s=7.0)
    # The flipper turns against a rising chassis: -(1 + d cos / L) per pitch, about 2.5 for d = 0.75 m.
    assert -30.0 * DEG <= command.flipper.rate_rad_s < -2.0 * 7.0 * DEG


@pytest.mark.parametrize(("before_m", "sign"), [(0.60, -1.0), (0.0, 1.0)])
def test_the_belts_keep_the_centre_of_mass_before_the_edge(before_m: float, sign: float) -> None:
    chair = Brink().pressed()
    chair.run(0.5, tip_n=chair.balanced_n(0.60))  # back slightly, so that there is room ahead
    command = chair.run(0.5, tip_n=max(chair.balanced_n(before_m), 1.0))
    assert math.copysign(1.0, command.speed_m_s) == sign


def test_it_never_drives_further_ahead_than_where_it_pressed() -> None:
    chair = Brink().pressed()
    pressed = chair.nosing_m
    chair.run(5.0, tip_n=1.0)
    assert chair.nosing_m <= pressed + 0.005


def test_before_a_kerb_the_lift_ends_as_the_rear_stands_on_the_floor() -> None:
    """Test: a kerb of 160 mm, its edge 2 cm past mid-track. Expected result: the rear stands on the floor at 18.4°, where its axis
    is 0.495 m times the sine, and 0.07 m times one less the cosine, below the edge; at that pitch the chair goes on."""
    chair = Brink()
    chair.slopes_rad, chair.rise_m = (), 0.16
    chair.pressed()
    chair.run(1.0)  # the filtered load of the tip is gone: only the map says where the edge is
    chair.nosing_m, chair.pitch_deg = -0.02, 17.5
    assert chair.run(0.05).stage == "lift"
    chair.nosing_m, chair.pitch_deg = -0.02, 18.4
    assert chair.run(0.05).stage == "settle"


def test_the_lift_ends_at_the_flippers_range() -> None:
    chair = Brink().pressed()
    chair.pitch_deg, far = 25.0, GEOMETRY.past(25.0 * DEG, -73.0 * DEG)
    chair.nosing_m = far - 0.475
    keep_m = before_for_margin(CONFIG, LIFTED_DEG * DEG, 7.0 * DEG)
    chair.run(1.0, tip_n=chair.balanced_n(keep_m))
    assert chair.run(0.5, tip_n=chair.balanced_n(keep_m)).flipper.rate_rad_s == pytest.approx(0.0, abs=2.5 * DEG)


def test_a_heavily_loaded_tip_yields_while_the_chair_settles() -> None:
    """Test: settling, with 60 N on the tip and then 300. Expected result: the flipper rises faster with the load; 15 N·m correspond
    to the chair's own motion."""
    rates = []
    for tip_n in (60.0, 300.0):
        chair = Brink().lifted()
        rates.append(chair.run(0.3, tip_n=tip_n).flipper.rate_rad_s)
    assert rates[1] - rates[0] > 10.0 * DEG


def test_lifted_it_backs_on_until_the_front_pulley_is_about_to_leave_the_landing() -> None:
    chair = Brink().lifted()
    assert chair.run(0.05, tip_n=40.0).speed_m_s == -0.05
    chair.until("leave", tip_n=40.0)
    assert GEOMETRY.pivot_m + chair.nosing_m == pytest.approx(0.06, abs=0.01)
    # The centre of mass is past the nosing, including 10 cm of error.
    assert plumb(CONFIG, SLOPE) + chair.nosing_m < -0.2


def test_then_it_stows_the_flipper_while_it_backs_on_and_ends_with_it_along_the_belts() -> None:
    """Test: the tip bears until 6 cm before the edge. Expected result: on at 5 cm/s while the flipper rises; the front
    has left the landing at the end. A chair that stood meanwhile fell forward off a low edge."""
    chair = Brink().lifted()
    assert chair.until("leave", tip_n=40.0).speed_m_s == -0.05
    assert chair.angle_rad < -25.0 * DEG
    chair.until("done")
    assert chair.angle_rad > -3.0 * DEG
    assert GEOMETRY.pivot_m + chair.nosing_m < 0.0


def test_a_tip_stays_on_the_landing_while_a_chair_that_leans_to_the_rear_is_off_it() -> None:
    """Test: the lifted chair tips half a degree further by itself. Expected result: the flipper yields with its tip loaded, and
    does not rise without. The chair may fall back, and fell at 33 °/s onto a flipper that had risen by 11°."""
    rises = []
    for tip_n in (0.0, 200.0):
        chair = Brink().lifted()
        chair.pitch_deg, chair.speed_m_s, chair.t_s = LIFTED_DEG + 0.5, 0.0, chair.t_s + 0.2
        rises.append(chair.run(0.01, tip_n).flipper.rate_rad_s)
    assert rises[0] <= 0.0 < rises[1]


def test_a_chair_that_sinks_before_its_belts_lie_is_not_backed_on() -> None:
    chair = Brink().lifted()
    chair.pitch_deg = LIFTED_DEG - 5.0
    command = chair.run(0.5)
    assert command.stage == "lift"
    assert command.speed_m_s > 0.0


def test_a_flipper_without_progress_lowers_the_chair_and_reports_it() -> None:
    chair = Brink().pressed()
    chair.until("lower", tip_n=130.0)
    command = chair.run(0.1, tip_n=130.0)
    assert (command.stage, command.speed_m_s) == ("barred", 0.0)
    chair.run(10.0)
    assert chair.angle_rad == pytest.approx(40.0 * DEG, abs=1.0 * DEG)


def test_a_flipper_that_stops_half_way_lowers_the_front_again() -> None:
    chair = Brink().pressed()
    chair.run(1.0, tip_n=250.0, pitch_deg_s=9.0)
    lowering = chair.until("lower", tip_n=200.0)
    assert lowering.speed_m_s >= 0.0
    assert chair.sequence.turn_back(), "what is being let down already goes on"
    assert chair.run(0.5, tip_n=200.0, pitch_deg_s=-5.0).flipper.rate_rad_s > 5.0 * DEG
    chair.until("barred", tip_n=200.0, pitch_deg_s=-5.0)


def test_a_chair_that_turns_back_is_lowered_onto_the_landing() -> None:
    """Test: the request comes during the lift, just after, and with the centre of mass past the nosing. Expected result: lowered,
    then barred; in the third case too late, and the chair continues."""
    chair = Brink().pressed()
    chair.run(1.0, tip_n=250.0, pitch_deg_s=9.0)
    assert chair.sequence.turn_back()
    assert chair.run(0.01, tip_n=200.0).stage == "lower"
    chair.until("barred", tip_n=200.0, pitch_deg_s=-5.0)
    assert chair.sequence.turn_back()

    lifted = Brink().lifted()
    assert lifted.sequence.turn_back()
    assert lifted.run(0.01, tip_n=200.0).stage == "lower"

    late = Brink().lifted()
    late.run(2.0, tip_n=40.0)
    assert not late.sequence.turn_back()
    late.until("leave", tip_n=40.0)


def test_a_chair_on_the_flight_does_not_fall_onto_a_raised_flipper() -> None:
    """Test: turning back, with the centre of mass further back than assumed: no tip load for 1.5 s, then a load. Expected result:
    the chair drives towards the landing with the tip following the ground, never rising; then it is lowered."""
    chair = Brink().lifted()
    assert chair.sequence.turn_back()
    chair.run(0.3)  # delay of the tip load filter
    for _ in range(120):
        command = chair.run(0.01)
        assert (command.stage, command.speed_m_s > 0.0) == ("lower", True)
        assert command.flipper.rate_rad_s <= 0.0
    command = chair.run(0.5, tip_n=100.0)
    assert command.flipper.rate_rad_s > 2.0 * DEG


@pytest.mark.parametrize("stage", ["approach", "press"])
def test_turning_back_before_the_lift_has_no_effect(stage: str) -> None:
    chair = Brink()
    chair.until(stage)
    assert chair.sequence.turn_back() == (stage == "press")
    assert chair.run(0.01).stage == ("lower" if stage == "press" else "approach")


def test_a_flipper_that_no_longer_folds_props_the_chair_up_and_ends_its_backing() -> None:
    chair = Brink().lifted()
    command = chair.until("barred", tip_n=300.0, pitch_deg_s=2.0)
    assert command.speed_m_s == 0.0
    assert chair.pitch_deg < LIFTED_DEG + 4.5


def test_a_flipper_that_does_not_lower_is_given_up_where_it_stands() -> None:
    chair = Brink().pressed()
    chair.run(1.0, tip_n=250.0, pitch_deg_s=9.0)
    chair.until("lower", tip_n=200.0)
    chair.run(2.0 * 8.0 - 0.1, tip_n=200.0)
    assert chair.run(0.3, tip_n=200.0).stage == "barred"


@pytest.mark.parametrize(("top_deg", "refused"), [(28.0, False), (32.0, False), (34.0, True), (36.0, True)])
def test_uppermost_nosings_steeper_than_the_flippers_range_are_refused_before_the_edge(top_deg: float, *, refused: bool) -> None:
    """Test: the uppermost pair of nosings is steeper than the flight of 28°. Expected result: at 34° the tip on the landing needs
    -76° and more with 5° to tipping, beyond the range of -75°: refused with the slope. From afar 34° may be 33°."""
    around = known(0.0, -1.5, [top_deg * DEG, SLOPE, SLOPE])
    assert (f"{top_deg:.1f}° steep" in Edge(CONFIG, around).refusal(around, 0.0)) == refused
    assert not Edge(CONFIG, known(0.0, -1.5, [SLOPE] * 3)).refusal(around, 10.0)


@pytest.mark.parametrize(("slope_deg", "refused"), [(28.0, False), (33.0, True)])
def test_the_rescue_robot_is_let_down_where_its_range_suffices(slope_deg: float, *, refused: bool) -> None:
    config = Loading(chair=read_chair("rescue"), payload_kg=3.0)
    around = known(0.0, -1.5, [slope_deg * DEG] * 3)
    assert ("the flipper would have to turn below its -75°" in Edge(config, around).refusal(around, 0.0)) == refused


@pytest.mark.parametrize("payload_kg", [0.0, 50.0, 90.0])
def test_the_lifted_chair_has_seven_degrees_to_tipping_where_the_range_allows(payload_kg: float) -> None:
    """Test: 25°, lifted completely. Expected result: the plumb line through the centre of mass is so far before the edge that
    gravity could turn by 7° before it passes it."""
    config = Loading(chair=CHAIR, payload_kg=payload_kg)
    pitch = 25.0 * DEG
    before_m = before_for_margin(config, pitch, 7.0 * DEG)
    _, z = centre_of_mass_level(config, pitch)
    assert math.atan((before_m + z * math.tan(pitch)) / z) - pitch == pytest.approx(7.0 * DEG)
