"""The plant in Gazebo next to MuJoCo's, its server's life, and a climb. Needs the environment: ``make test-gazebo`` runs these."""

import math
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from treadline.core.angles import DEG
from treadline.core.errors import GazeboError
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.gazebo import GazeboPlant, find_environment, open_gazebo
from treadline.plant.mujoco import open_plant
from treadline.run.episode import traverse
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Control, DriveSettings, Scenario, Sensors, Stair, Start
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.appearance import colour
from treadline.vehicle.film_camera import FRAME_S

pytestmark = pytest.mark.skipif(os.environ.get("TREADLINE_TEST_GAZEBO") != "1", reason="make test-gazebo runs these")

Opened = Callable[..., GazeboPlant]


def flight(*, sensors: Sensors | None = None, mismatch: float = 0.01, heading_deg: float = 5.0) -> Scenario:
    return Scenario(
        stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), walls="none", width_m=4.0),
        chair=Chair(belt_mismatch=mismatch),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        control=Control(vision="truth"),
        sensors=sensors or Sensors(),
    )


@pytest.fixture
def started() -> Iterator[Opened]:
    """Return what opens a plant at its start; all are closed at the end."""
    with ExitStack() as stack:

        def start(seed: int = 3, **options: object) -> GazeboPlant:
            plant = open_gazebo(flight(**options), seed)  # type: ignore[arg-type]
            stack.callback(plant.close)
            plant.start()
            return plant

        yield start


def test_the_chair_begins_where_the_other_simulator_puts_it(started: Opened) -> None:
    plant, other = started(), open_plant(flight(), 3)
    other.start()
    here, there = plant.truth()[0], other.truth()[0]
    assert here.heading_rad == pytest.approx(there.heading_rad, abs=0.1 * DEG)
    assert (here.pitch_rad, here.roll_rad) == pytest.approx((there.pitch_rad, there.roll_rad), abs=0.1 * DEG)
    assert (here.x_m, here.y_m) == pytest.approx((there.x_m, there.y_m), abs=0.005)
    assert here.seat_pitch_rad == pytest.approx(there.seat_pitch_rad, abs=0.1 * DEG)


def test_a_plugin_for_another_gazebo_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    # The loader's word for a plugin that it cannot link against this Gazebo.
    monkeypatch.setattr("treadline.plant.gazebo._gazebo_plant.PLUGIN", "lib/x86_64-linux-gnu/libnothing.so")
    plant = GazeboPlant(flight(), 0, read_chair("wheelchair"), find_environment())
    with pytest.raises(GazeboError, match=r"does not load the plugin: .*libnothing.so.*build it"):
        plant.start()


@pytest.mark.parametrize(("turn_rule", "turn_deg_s"), [(True, 0.0), (False, 3.5)])
def test_without_the_turn_rule_a_small_difference_of_the_belts_turns_the_chair(turn_rule: bool, turn_deg_s: float) -> None:
    """Test: belts at 0.18 and 0.22 m/s on 28°, 0.04 / 0.65 = 0.06 rad/s, for 3 s. Expected: by the rule the chair is taken to drive
    straight; without, it turns by 0.06 rad/s = 3.5 °/s as it does above the rule's 0.1 rad/s."""
    plant = open_gazebo(flight(mismatch=0.0, heading_deg=0.0), 3, turn_rule=turn_rule)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.18, right_m_s=0.22), SeatCommand(t_s=0.0, rate_m_s=0.0))
    plant.advance(3.0)
    truth = plant.truth()
    plant.close()
    assert (truth[-1].yaw_rad - truth[100].yaw_rad) / 2.0 == pytest.approx(turn_deg_s * DEG, abs=0.7 * DEG)


def test_a_film_shows_passenger_and_stair_and_does_not_change_the_run(tmp_path: Path) -> None:
    """Test: 2 s with and without a film. Expected: the same bits; an image every 0.4 s from the start on, in the drawn colours."""
    ends = []
    for film in (None, tmp_path):
        plant = open_gazebo(flight(), 3, film=film)
        plant.start()
        plant.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
        plant.advance(2.0)
        ends.append(plant.truth()[-1])
        plant.close()
    assert repr(ends[0]) == repr(ends[1])
    images = sorted(tmp_path.iterdir())
    taken_s = np.array([float(image.stem) for image in images])
    assert taken_s[0] < FRAME_S
    np.testing.assert_allclose(np.diff(taken_s), FRAME_S, atol=0.0051)  # the names have two digits
    pixels = np.asarray(Image.open(images[-1]).convert("RGB")).reshape(-1, 3) / 255.0
    for part in ("shirt", "cushion", "nosing"):
        hue = np.array(colour(part)) / max(colour(part))
        bright = pixels[pixels.max(axis=1) > 0.3]
        close = np.abs(bright / bright.max(axis=1, keepdims=True) - hue).max(axis=1) < 0.1
        assert close.sum() > 200, part


@pytest.mark.parametrize("heading_deg", [30.0, -30.0])
def test_a_chair_at_an_angle_is_turned_square_and_climbs_for_20_s(heading_deg: float) -> None:
    scenario = Scenario(
        stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), width_m=2.4, steps=30),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        drive=DriveSettings(duration_s=20.0),
        sensors=Sensors(camera="statistical", gravity_error_deg=0.5),
    )
    run = traverse(scenario, controller=shipped_controller("wheelchair"), seed=0, open_plant=open_gazebo)
    assert run.verdict == "time_up"
    assert abs(run.trace["heading_rad"][run.trace["t_s"] > 10.0]).max() < 3.0 * DEG
    # 20 s at 0.2 m/s, less the turn's.
    assert 2.5 < run.scores.climbed_m < 4.2
    assert run.scores.roll_back_m < 0.05
