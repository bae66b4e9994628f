"""A late frame is seen with the gravity of its exposure, in the loop and in the camera node alike."""

from collections.abc import Callable

import numpy as np
import pytest
from world import imu, limits

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.rotations import rotation_y
from treadline.core.signals import HeadingMeasurement, ImuSample, StairMap
from treadline.mission._blocks import CameraBlock, GravityAtExposure
from treadline.ros import channels as on
from treadline.ros.block_nodes import CameraNode
from treadline.ros.lockstep import InProcess

CAMERA = PinholeCamera(width_px=8, height_px=6, fx_px=5.0, fy_px=5.0, cx_px=3.5, cy_px=2.5, mount_pitch_rad=30.0 * DEG)


def frame(t_s: float) -> RgbdFrame:
    depth_m = np.linspace(1.0, 2.0, 48, dtype=np.float32).reshape(6, 8)
    return RgbdFrame(t_s=t_s, rgb=np.zeros((6, 8, 3), np.uint8), depth_m=depth_m, camera=CAMERA)


class Looking:
    """A detector that keeps the gravity it is given."""

    def __init__(self) -> None:
        self.gravity: list[np.ndarray | None] = []

    def see(self, frame: RgbdFrame, gravity_C: np.ndarray | None = None) -> "Nothing":
        del frame
        self.gravity.append(gravity_C)
        return Nothing()


class Nothing:
    """A frame without a stair."""

    measurement: HeadingMeasurement | None = None
    stair_map: StairMap | None = None


def by_the_block(detector: Looking) -> tuple[Callable[[ImuSample], object], Callable[[RgbdFrame], object]]:
    block = CameraBlock(detector)
    return block.update, lambda late: list(block.step(late, lambda _: True))


def by_the_node(detector: Looking) -> tuple[Callable[[ImuSample], object], Callable[[RgbdFrame], object]]:
    node, bus = CameraNode(detector, limits(), 0.4), InProcess()
    node.listen(bus)
    node.advance(0.11)
    return lambda sample: bus.publish(on.IMU, sample), lambda late: bus.publish(on.CAMERA, late)


@pytest.mark.parametrize("wired", [by_the_block, by_the_node])
def test_a_frame_that_comes_60_ms_late_is_seen_with_the_gravity_of_its_exposure(wired: Callable[..., tuple]) -> None:
    """Test: the chair pitches by 1° per 10 ms; a frame of 0.05 s comes at 0.11 s. Expected result: gravity of 5°, not of 11°."""
    detector = Looking()
    take_imu, take_frame = wired(detector)
    for k in range(12):
        take_imu(imu(0.01 * k, k * DEG))
    take_frame(frame(0.05))
    (gravity_C,) = detector.gravity
    expected = CAMERA.R_BC.T @ rotation_y(-5.0 * DEG).T @ np.array([0.0, 0.0, -1.0])
    np.testing.assert_allclose(gravity_C, expected, atol=1e-12)


def test_without_an_attitude_there_is_no_gravity() -> None:
    assert GravityAtExposure().gravity_C(frame(0.0)) is None
