"""A recording as a plant: readings at the mission's pace, commands without effect, the IMU's axes and attitude made the chair's."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from world import imu_at

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.ports import Reading
from treadline.core.rotations import rotation_of, rotation_y, rotation_z
from treadline.core.signals import ImuSample, OperatorInput
from treadline.mission.replay_plant import ReplayPlant

UP = np.array([0.0, 0.0, 1.0])


def imu(t_s: float, *, R_WB: np.ndarray | None = None, turned: np.ndarray | None = None) -> ImuSample:
    """Return a sample at rest; ``turned`` is the rotation of the IMU in the chair."""
    R_WB = np.eye(3) if R_WB is None else R_WB
    turned = np.eye(3) if turned is None else turned
    return imu_at(t_s, R_WB @ turned, turned.T @ np.array([0.1, 0.2, 0.3]))


def on_time(readings: Iterable[Reading]) -> Iterator[tuple[float, Reading]]:
    return ((reading.t_s, reading) for reading in readings)


def played(plant: ReplayPlant, ticks: int) -> list[list[Reading]]:
    plant.start()
    batches = []
    for k in range(ticks):
        plant.advance(0.01 * k)
        batches.append(list(plant.read()))
    return batches


def test_each_reading_comes_at_its_tick_and_once() -> None:
    readings = [OperatorInput(t_s=t_s) for t_s in (0.0, 0.004, 0.01, 0.011, 0.02, 0.05)]
    plant = ReplayPlant(on_time(readings))
    batches = played(plant, 6)
    assert [len(batch) for batch in batches] == [1, 2, 2, 0, 0, 1]
    assert [reading for batch in batches for reading in batch] == readings
    assert plant.over


def test_a_reading_that_arrived_late_comes_at_its_arrival_with_its_own_stamp() -> None:
    late, fresh = OperatorInput(t_s=0.0), OperatorInput(t_s=0.02)
    batches = played(ReplayPlant([(0.02, fresh), (0.03, late)]), 4)
    assert batches == [[], [], [fresh], [late]]


def test_only_what_is_due_is_taken_from_the_log() -> None:
    taken = []

    def readings() -> Iterator[OperatorInput]:
        for k in range(1000):
            taken.append(k)
            yield OperatorInput(t_s=0.01 * k)

    played(ReplayPlant(on_time(readings())), 10)
    assert len(taken) == 11


def test_a_sample_in_the_chairs_axes_passes_untouched() -> None:
    sample = imu(0.0)
    assert played(ReplayPlant(on_time([sample])), 1) == [[sample]]


def test_an_imu_in_the_cameras_axes_is_turned_into_the_chairs() -> None:
    camera = PinholeCamera(width_px=2, height_px=2, fx_px=1.0, fy_px=1.0, cx_px=0.5, cy_px=0.5, mount_pitch_rad=40 * DEG)
    R_WB = rotation_z(0.3) @ rotation_y(-28 * DEG)
    plant = ReplayPlant(on_time([imu(0.0, R_WB=R_WB, turned=camera.R_BC)]), camera.R_BC)
    ((back,),) = played(plant, 1)
    np.testing.assert_allclose(rotation_of(back.orientation), R_WB, atol=1e-12)
    np.testing.assert_allclose(back.angular_velocity_rad_s, [0.1, 0.2, 0.3], atol=1e-12)
    np.testing.assert_allclose(back.linear_acceleration_m_s2, 9.81 * (R_WB.T @ UP), atol=1e-12)


@pytest.mark.parametrize("turned", [None, rotation_y(0.7)])
def test_an_imu_without_attitude_gets_one_from_gravity(turned: np.ndarray | None) -> None:
    R_WB = rotation_y(-28 * DEG)
    sample = imu(0.0, R_WB=R_WB, turned=turned)
    bare = replace(sample, orientation=np.zeros(4))
    ((back,),) = played(ReplayPlant(on_time([bare]), turned), 1)
    np.testing.assert_allclose(rotation_of(back.orientation).T @ UP, R_WB.T @ UP, atol=1e-9)
