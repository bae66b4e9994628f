"""Live frames by a fake camera: each fault of a stream has one defined behaviour."""

import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from frame_files import write_calibration

from treadline.cli import main
from treadline.cli.see import StatusLine
from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import CameraError, ImageError, SettingsError
from treadline.io.live import CameraImages, camera_by_name
from treadline.io.live._depth_camera import no_frame, not_opened
from treadline.io.live.stream import LiveFrames
from treadline.scenario.camera_file import read_camera

RATE_HZ = 30.0
WIDTH, HEIGHT = 32, 24
SMALL = PinholeCamera(width_px=WIDTH, height_px=HEIGHT, fx_px=10.0, fy_px=10.0, cx_px=15.5, cy_px=11.5)


class FakeCamera:
    """Camera that plays recorded images, and then fails as one that is unplugged."""

    name = "fake"
    rate_hz = RATE_HZ

    def __init__(self, camera: PinholeCamera, images: Iterable[CameraImages], error: Exception | None = None) -> None:
        self._camera = camera
        self._images = iter(images)
        self._error = error
        self.opened = self.closed = 0

    def open(self, *, colour: bool) -> None:
        self.colour = colour
        self.opened += 1
        if self._error is not None:
            raise self._error

    def intrinsics(self) -> PinholeCamera:
        return self._camera

    def next_images(self, timeout_s: float) -> CameraImages:
        images = next(self._images, None)
        if images is None:
            raise no_frame(self.name, timeout_s, RuntimeError("Frame didn't arrive"))
        return images

    def close(self) -> None:
        self.closed += 1


def images_at(times: Iterable[float], frame: RgbdFrame | None = None, **more: Any) -> list[CameraImages]:
    depth_m = np.full((HEIGHT, WIDTH), 1.5, np.float32) if frame is None else frame.depth_m
    return [CameraImages(t_s=t_s, depth_m=depth_m, **more) for t_s in times]


def stamps(count: int, rate_hz: float = RATE_HZ, start_s: float = 1000.0) -> list[float]:
    return [start_s + number / rate_hz for number in range(count)]


def played(
    images: Iterable[CameraImages], camera: PinholeCamera = SMALL, **options: Any
) -> tuple[list, LiveFrames, list[str], str]:
    """Return the frames up to the failure, their stream, its warnings as they arose, and the failure."""
    said: list[str] = []
    fake = FakeCamera(camera, images)
    frames, found = LiveFrames(fake, on_warning=said.append, **options), []
    with pytest.raises(CameraError) as failed:
        found.extend(frames)
    assert (fake.opened, fake.closed, fake.colour) == (1, 1, options.get("colour", False))
    return found, frames, said, str(failed.value)


@pytest.mark.parametrize(
    ("times", "kept_s", "warnings"),
    [
        (stamps(4), stamps(4, start_s=0.0), []),
        ([*stamps(3), 1000.0, 1000.0 + 2 / RATE_HZ, 1001.0], [*stamps(3, start_s=0.0), 1.0], ["2 frames left out: their stamps "]),
        # The first frame loads the compiled kernels for a second.
        ([1000.0, *stamps(90, start_s=1001.0)], [0.0, *stamps(90, start_s=1.0)], []),
    ],
    ids=["sound", "repeated", "slow at first"],
)
def test_frames_have_times_from_the_first_until_the_camera_is_unplugged(times, kept_s, warnings) -> None:
    found, frames, said, failure = played(images_at(times))
    assert [named.t_s for named in found] == [named.frame.t_s for named in found] == pytest.approx(kept_s)
    assert [named.name for named in found[:2]] == ["000000", "000001"]
    assert {named.frame.camera for named in found} == {SMALL}
    assert [warning[:32] for warning in frames.warnings] == warnings
    assert said == []
    assert failure == f"fake: no depth image for 2 s (Frame didn't arrive); was it unplugged? ({len(kept_s)} frames before)"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("errno=16 Device or\nresource busy", r"busy \(errno=16 Device or resource busy\)"),
        ("X_LINK_DEVICE_ALREADY_IN_USE", "busy"),
        ("No device connected", "cannot be opened .* is it plugged in"),
    ],
)
def test_a_busy_or_missing_device_is_closed_and_named(text: str, said: str) -> None:
    camera = FakeCamera(SMALL, [], not_opened("fake", RuntimeError(text)))
    with pytest.raises(CameraError, match=f"^fake: {said}"):
        list(LiveFrames(camera))
    assert camera.closed == 1


@pytest.mark.parametrize(("rate_hz", "warned"), [(29.0, False), (16.0, False), (11.0, True), (0.5, True)])
def test_a_frame_rate_that_collapses_is_a_warning_with_figures(rate_hz: float, warned: bool) -> None:
    times = stamps(90)  # the rate is checked from two seconds on
    for rate in (rate_hz, RATE_HZ, rate_hz):
        times += stamps(60, rate, times[-1] + 1.0 / rate)
    _, frames, said, _ = played(images_at(times))
    # One warning per collapse, and the slowest rate afterwards.
    assert ["of 30 frames per second" in text for text in said] == [True, True] * warned
    assert frames.warnings == [f"the frame rate fell to {rate_hz:.1f} Hz of 30 Hz"] * warned


def test_intrinsics_of_another_resolution_are_refused() -> None:
    with pytest.raises(ImageError, match="images of 32×24 pixels, intrinsics for 16×24"):
        list(LiveFrames(FakeCamera(replace(SMALL, width_px=16), images_at(stamps(1)))))


def test_a_calibration_file_gives_the_mount_and_is_compared(tmp_path: Path) -> None:
    own = read_camera(write_calibration(tmp_path / "a.toml", SMALL))
    for focal_px, warnings in ((10.0, []), (10.2, []), (10.5, ["fx = 10.0 px differs from the device's 10.5 px by 4.8 %"])):
        device = replace(SMALL, fx_px=focal_px, fy_px=focal_px)
        (named,), _, said, _ = played(images_at(stamps(1)), device, calibration=own)
        assert named.mount_known
        assert named.frame.camera == replace(device, mount_pitch_rad=own.camera.mount_pitch_rad)
        assert [text[len("the calibration's ") :].partition(";")[0] for text in said] == warnings
    other = read_camera(write_calibration(tmp_path / "b.toml", replace(SMALL, width_px=33)))
    with pytest.raises(ImageError, match="calibration is for 33×24, the camera gives 32×24"):
        list(LiveFrames(FakeCamera(SMALL, []), calibration=other))


def test_colour_of_another_time_is_a_warning_and_depth_is_used() -> None:
    rgb = np.full((HEIGHT, WIDTH, 3), 7, np.uint8)
    paired = [replace(item, rgb=rgb, rgb_t_s=item.t_s + 0.01) for item in images_at(stamps(3))]
    found, *_ = played(paired, colour=True)
    assert [(named.has_colour, named.frame.rgb.max()) for named in found] == [(True, 7)] * 3
    late = [replace(item, rgb_t_s=item.t_s + 0.033) for item in paired]
    found, frames, said, _ = played(late, colour=True)
    assert [(named.has_colour, named.frame.rgb.max()) for named in found] == [(False, 0)] * 3
    assert said == ["fake: depth and colour are 33 ms apart, at most 20 ms are paired; depth alone is used"]
    assert frames.warnings == ["3 frames used without colour: depth and colour were more than 20 ms apart"]


def test_gravity_is_opposite_to_the_mean_force() -> None:
    rng = np.random.default_rng(1)
    down = np.array([0.1, 0.9, 0.4]) / np.linalg.norm([0.1, 0.9, 0.4])
    # Vibration of 1 m/s²: the mean over a second of 30 Hz keeps 1/√60 of it (exponential weights), which is 0.75° per axis.
    images = [replace(item, force_C=-9.8 * down + rng.normal(0.0, 1.0, 3)) for item in images_at(stamps(120))]
    found, *_ = played(images)
    assert np.degrees(np.arccos(found[-1].gravity_C @ down)) < 3.0
    found, *_ = played(images_at(stamps(3), force_C=np.array([0.0, -1.0, 0.0])))
    assert found[0].gravity_C is None
    found, *_ = played(images[:1], gravity_C=down)
    np.testing.assert_array_equal(found[0].gravity_C, down)


@pytest.mark.parametrize("name", ["kinect", "realsense:1", ""])
def test_unknown_cameras_are_refused_with_the_list(name: str) -> None:
    with pytest.raises(SettingsError, match="allowed: realsense, orbbec, oak"):
        camera_by_name(name)


def test_the_command_shows_a_line_and_the_newest_picture_and_ends_at_ctrl_c(rendered, monkeypatch, capsys, tmp_path: Path) -> None:
    frame, table = rendered(), tmp_path / "walk.jsonl"

    def interrupted() -> Iterator[CameraImages]:
        yield from (replace(item, rgb=frame.rgb, rgb_t_s=item.t_s) for item in images_at(stamps(31), frame))
        raise KeyboardInterrupt

    camera = FakeCamera(replace(frame.camera, mount_pitch_rad=0.0, mount_m=(0.0, 0.0, 0.0)), interrupted())
    monkeypatch.setattr("treadline.io.live.camera_by_name", lambda _: camera)
    words = ["see", "--live", "realsense", "--out", str(tmp_path / "seen"), "--headings", str(table), "--json"]
    assert main(words) == 0
    said = capsys.readouterr()
    values = json.loads(said.out)
    assert values["summary"]["count"] == values["summary"]["accepted"] == 31
    assert len(table.read_text().splitlines()) == 31
    assert "heading +" in said.err
    # 3 mm on both: noise of one frame.
    rise, run = (int(number) for number in re.search(r"rise (\d+) mm, run (\d+) mm", said.err).groups())
    assert (rise, run) == (pytest.approx(160, abs=3), pytest.approx(300, abs=3))
    assert (camera.opened, camera.closed, camera.colour) == (1, 1, True)
    assert [path.name for path in (tmp_path / "seen").iterdir()] == ["live-seen.png"]
    assert cv2.imread(str(tmp_path / "seen" / "live-seen.png")).shape[1] == 960


def test_lines_are_written_once_a_second_where_no_person_watches(capsys) -> None:
    times = iter([0.0, 0.0, 0.5, 1.2, 1.2])
    line = StatusLine(clock=lambda: next(times))
    for text in ("a", "b", "c"):
        line.show(text)
    line.warn("slow")
    assert capsys.readouterr().err == "a\nc\nwarning: slow\n"
