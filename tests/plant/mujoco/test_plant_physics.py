"""The plant moves as tracks on a stair must: slip limits, drift, slopes too steep, tipping."""

import math

import numpy as np
import pytest
from jaxtyping import Float
from oracles.plant_runs import STILL, held, plant_on

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.rotations import quaternion_of, rotation_of, rotation_z
from treadline.core.signals import ImuSample, TrackCommand
from treadline.plant.mujoco import MujocoPlant, open_plant
from treadline.scenario.scenario import Chair, Control, DriveSettings, Scenario, Stair, Start

GRAVITY_M_S2 = 9.81
CLIMB = TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2)


class Plane:
    """A chair in the middle of a long landing, belts locked, on which gravity can be turned: a ramp of any slope."""

    def __init__(self, *, heading_deg: float = 0.0, downhill_deg: float = 180.0) -> None:
        """Set the downhill direction relative to the chair: 180° when it faces uphill, 90° when its left side is the lower one."""
        scenario = Scenario(
            stair=Stair(landing_m=20.0, width_m=10.0, walls="none"),
            chair=Chair(belt_mismatch=0.0),
            start=Start(place="landing", seat="chassis"),
            drive=DriveSettings(direction="down"),
            control=Control(vision="truth"),
        )
        self.plant = open_plant(scenario, seed=1)
        self.plant.start()
        # Ten metres from every edge: a chair that turns by 90° where it starts would hang over the last nosing.
        pose = self.plant._data.qpos
        pose[0] += 10.0
        turned = rotation_z(heading_deg * DEG) @ rotation_of(pose[3:7].copy())
        pose[3:7] = quaternion_of(turned)
        self._downhill = (heading_deg + downhill_deg) * DEG
        self._tilt_deg = 0.0
        self._t_s = 0.0
        self.plant.write(TrackCommand.stop(0.0), STILL)
        self.wait(0.5)

    def tilt(self, tilt_deg: float) -> None:
        """Turn gravity at once."""
        tilt, self._tilt_deg = tilt_deg * DEG, tilt_deg
        direction = np.array([math.cos(self._downhill), math.sin(self._downhill)])
        self.plant._model.opt.gravity[:] = GRAVITY_M_S2 * np.array([*(math.sin(tilt) * direction), -math.cos(tilt)])

    def tilt_slowly(self, tilt_deg: float, over_s: float = 3.0) -> None:
        """Turn gravity so gently that nothing rocks, and wait for half a second."""
        for angle in np.linspace(self._tilt_deg, tilt_deg, round(over_s / 0.05)):
            self.tilt(float(angle))
            self.wait(0.05)
        self.wait(0.5)

    def wait(self, duration_s: float) -> float:
        """Let time pass, and return how far the chair went downhill."""
        before = self.plant._data.qpos[:2].copy()
        self._t_s += duration_s
        self.plant.advance(self._t_s)
        moved = self.plant._data.qpos[:2] - before
        return float(moved @ [math.cos(self._downhill), math.sin(self._downhill)])


def ground_track(plant: MujocoPlant, samples: list[Truth]) -> Float[np.ndarray, "n 2"]:
    """Return the positions on the level landing, from those in the stair's frame."""
    slope = plant.staircase.slope_rad
    return np.array([[sample.x_m / math.cos(slope), sample.y_m] for sample in samples])


def each_second(plant: MujocoPlant, command: TrackCommand, seconds: int) -> list[Truth]:
    """Hold one command and return the truth of every whole second: sensors and truth of 12 000 ticks take their time."""
    plant.write(command, STILL)
    samples = list(plant.truth())
    for second in range(1, seconds + 1):
        plant.advance(float(second))
        del plant._pending[:-1]
        samples.extend(plant.truth())
    return samples


def test_half_a_metre_a_second_of_belt_moves_the_chair_as_much_on_level_ground() -> None:
    level = Plane().plant
    level.start()
    track = ground_track(level, held(level, 0.5, 0.5, 6.0))
    # Two seconds for the drive's lag to die out (13 time constants).
    assert (track[600, 0] - track[200, 0]) / 4.0 == pytest.approx(0.5, abs=1e-3)


ALONG_DEG, ACROSS_DEG = math.degrees(math.atan(0.62)), math.degrees(math.atan(0.5))
"""31.8° and 26.6°: the slip limits of Table I's friction."""


@pytest.mark.parametrize(
    ("heading_deg", "downhill_deg", "limit_deg", "creep_m_s"),
    [
        (0.0, 180.0, ALONG_DEG, 0.02),
        (90.0, 0.0, ALONG_DEG, 0.02),
        (90.0, 90.0, ACROSS_DEG, 0.001),
        (0.0, -90.0, ACROSS_DEG, 0.001),
    ],
    ids=["facing up", "facing down", "left side down", "right side down"],
)
def test_friction_holds_to_a_third_of_a_degree_of_its_limit(
    heading_deg: float, downhill_deg: float, limit_deg: float, creep_m_s: float
) -> None:
    ramp = Plane(heading_deg=heading_deg, downhill_deg=downhill_deg)
    ramp.tilt_slowly(limit_deg - 0.3)
    # MuJoCo's friction is soft: near its limit a chair on the end of its belts creeps 12 mm/s, on both belts 0.1 mm/s.
    # Half a degree beyond the limit it would slide by 50 mm in this second, and by 150 mm in the next.
    assert abs(ramp.wait(1.0)) < creep_m_s


@pytest.mark.parametrize(("slope_deg", "minutes"), [(25.0, 2), (30.0, 1)])
def test_a_symmetric_chair_keeps_its_heading_for_minutes(slope_deg: float, minutes: int) -> None:
    """Test: straight up, on 25° where nosing phases turn a chair, and on 30° where none does. Expected: 0.01° a minute at most."""
    samples = each_second(plant_on(slope_deg, steps=50 * minutes), CLIMB, 60 * minutes)
    assert max(abs(sample.heading_rad) for sample in samples) < 0.01 * minutes * DEG
    # Belt travel is 12 m a minute less the drive's lag; climbing costs a percent of slip at most.
    assert samples[-1].x_m - samples[0].x_m > 11.86 * minutes


@pytest.mark.parametrize("slope_deg", [33.0, 35.0])
def test_a_stair_steeper_than_friction_allows_cannot_be_climbed_and_with_more_it_can(slope_deg: float) -> None:
    little, more = (held(plant_on(slope_deg, friction), 0.2, 0.2, 5.0) for friction in ((0.62, 0.5), (0.8, 0.65)))
    assert little[-1].x_m < little[0].x_m
    # Belt travel is 1 m less the drive's lag of 0.15 s; a tenth may be slip.
    assert more[-1].x_m - more[0].x_m > 0.87


def test_a_payload_behind_the_hinge_makes_the_chair_rear_up() -> None:
    upright = held(plant_on(30.0), 0.2, 0.2, 3.0)
    reared = held(plant_on(30.0, payload_offset_m=(-0.45, 0.0, 0.0)), 0.2, 0.2, 3.0)
    # Between nosings a chair nods by a degree or so.
    assert max(sample.pitch_rad for sample in upright) < 33.0 * DEG
    assert max(sample.pitch_rad for sample in reared) > 45.0 * DEG
    assert reared[0].stability_margin_rad < 0.0 < min(sample.stability_margin_rad for sample in upright)


@pytest.mark.parametrize("slope_deg", [25.0, 30.0])
@pytest.mark.parametrize("heading_deg", [0.0, 30.0, -30.0])
def test_the_chair_starts_at_the_requested_heading(slope_deg: float, heading_deg: float) -> None:
    first = plant_on(slope_deg, heading_deg=heading_deg).truth()[0]
    assert first.t_s == 0.0
    assert first.heading_rad == pytest.approx(heading_deg * DEG, abs=0.1 * DEG)
    assert first.pitch_rad > 0.0


def test_a_floor_that_falls_to_the_right_rolls_the_chair_for_imu_and_truth() -> None:
    """Test: 2° of side slope under a chair at rest. Expected result: roll and least margin by 2°, and gravity aside in the IMU."""
    loaded = Scenario(start=Start(place="floor"), chair=Chair(payload_offset_m=(0.0, -0.2, 0.0)))
    level, falls = (open_plant(loaded.changed(stair={"side_slope_deg": deg}), 0) for deg in (0.0, 2.0))
    for made in (level, falls):
        made.start()
        made.advance(0.5)
    upright, rolled = level.truth()[-1], falls.truth()[-1]
    assert (upright.roll_rad, rolled.roll_rad) == pytest.approx((0.0, 2.0 * DEG), abs=0.1 * DEG)
    assert upright.stability_margin_rad - rolled.stability_margin_rad == pytest.approx(2.0 * DEG, abs=0.2 * DEG)
    force = np.mean([reading.linear_acceleration_m_s2 for reading in falls.read() if isinstance(reading, ImuSample)], axis=0)
    assert math.atan2(force[1], force[2]) == pytest.approx(2.0 * DEG, abs=0.3 * DEG)


def test_friction_use_is_the_share_that_the_slope_takes() -> None:
    first = plant_on(28.0, heading_deg=30.0).truth()[0]
    tangent = math.tan(28.0 * DEG)
    expected = math.hypot(math.cos(30.0 * DEG) * tangent / 0.62, math.sin(30.0 * DEG) * tangent / 0.5)
    # The settled heading is within 0.1° of the requested one: 2e-3 of friction.
    assert first.friction_use == pytest.approx(expected, abs=2e-3)
