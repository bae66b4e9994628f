"""The intrinsics of a chair's camera: from a camera file, from the chair's own file, or a Kinect 1's."""

from pathlib import Path

import numpy as np
import pytest
from chairs import changed_chair

from treadline.scenario.chair import ChairDescription, read_chair

CAMERA = "width = 1280\nheight = 720\nfx_px = 640.0\nfy_px = 641.0\ncx_px = 630.0\ncy_px = 350.0\nmount_pitch_deg = 3.0\n"


def chair(folder: Path, addition: str) -> ChairDescription:
    return read_chair(changed_chair(folder, "\n[camera]\n", f"\n[camera]\n{addition}\n"))


def test_a_camera_file_gives_the_intrinsics_and_the_chair_the_mount(tmp_path: Path) -> None:
    (tmp_path / "wide.toml").write_text(CAMERA)
    mine, shipped = chair(tmp_path, 'file = "wide.toml"'), read_chair("wheelchair")
    camera = mine.camera_at(720)
    assert (camera.width_px, camera.height_px) == (1280, 720)
    assert (camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px) == pytest.approx((640.0, 641.0, 630.0, 350.0))
    assert camera.mount_pitch_rad == shipped.camera_at().mount_pitch_rad
    assert mine.camera_at(rear=True) == shipped.camera_at(rear=True)  # no file is named there


@pytest.mark.parametrize("height_px", [240, 480])
def test_a_scaled_image_shows_the_same_directions(tmp_path: Path, height_px: int) -> None:
    (tmp_path / "wide.toml").write_text(CAMERA)
    mine = chair(tmp_path, 'file = "wide.toml"')
    whole, small = mine.camera_at(720), mine.camera_at(height_px)
    # The image's corners, half a pixel beyond the outermost centres, lie in the same directions; its width is rounded to a pixel.
    for camera in (whole, small):
        left, top = (-0.5 - camera.cx_px) / camera.fx_px, (-0.5 - camera.cy_px) / camera.fy_px
        np.testing.assert_allclose((left, top), (-630.5 / 640.0, -350.5 / 641.0), rtol=1e-12)
    assert small.width_px == round(1280 * height_px / 720)


def test_intrinsics_may_stand_in_the_chairs_own_file(tmp_path: Path) -> None:
    inline = "calibration = { width = 640, height = 480, fx_px = 500.0, fy_px = 500.0, cx_px = 319.5, cy_px = 239.5 }"
    assert chair(tmp_path, inline).camera_at(480).fx_px == 500.0


def test_without_a_file_the_camera_is_a_kinect_1() -> None:
    camera = read_chair("wheelchair").camera_at(480)
    assert (camera.width_px, camera.fx_px, camera.cx_px, camera.cy_px) == (640, 575.0, 319.5, 239.5)
