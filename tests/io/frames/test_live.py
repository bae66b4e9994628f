"""Live frames by a fake camera: each fault of a stream has one defined behaviour."""

import json
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from treadline.cli import main
from treadline.cli.see import StatusLine
from treadline.core.camera_images import NamedFrame, PinholeCamera, RgbdFrame
from treadline.core.errors import CameraError, ImageError, SettingsError
from treadline.io.live import CameraImages, camera_by_name
from treadline.io.live._depth_camera import no_frame, not_opened
from treadline.io.live.stream import LiveFrames
from treadline.scenario.camera_file import read_camera

RATE_HZ = 30.0


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


def bare(frame: RgbdFrame) -> PinholeCamera:
    return replace(frame.camera, mount_pitch_rad=0.0, mount_m=(0.0, 0.0, 0.0))


def recorded(frame: RgbdFrame, stamps: Iterable[float], **more: object) -> list[CameraImages]:
    return [CameraImages(t_s=t_s, depth_m=frame.depth_m, **more) for t_s in stamps]


def stamps(count: int, rate_hz: float = RATE_HZ, start_s: float = 1000.0) -> list[float]:
    return [start_s + number / rate_hz for number in range(count)]


@pytest.fixture
def frame(rendered) -> RgbdFrame:
    """Return a frame from a flight."""
    return rendered()


def played(camera: FakeCamera, **options: object) -> tuple[list, LiveFrames, list[str], str]:
    """Return the frames up to the failure, their stream, its warnings and the failure."""
    said: list[str] = []
    frames = LiveFrames(camera, on_warning=said.append, **options)
    found: list[NamedFrame] = []
    with pytest.raises(CameraError) as failed:
        found.extend(frames)
    return found, frames, said, str(failed.value)


def test_frames_have_times_from_the_first_and_the_device_intrinsics(frame) -> None:
    camera = FakeCamera(bare(frame), recorded(frame, stamps(4)))
    found, frames, said, _ = played(camera)
    assert [named.t_s for named in found] == pytest.approx(stamps(4, start_s=0.0))
    assert all(named.frame.camera == bare(frame) for named in found)
    assert (camera.opened, camera.closed, camera.colour) == (1, 1, False)
    assert said == frames.warnings == []


def test_an_unplugged_camera_is_one_line_with_the_count(frame) -> None:
    camera = FakeCamera(bare(frame), recorded(frame, stamps(7)))
    *_, failure = played(camera)
    assert failure == "fake: no depth image for 2 s (Frame didn't arrive); was it unplugged? (7 frames before)"
    assert camera.closed == 1


def test_a_busy_device_is_closed_and_named(frame) -> None:
    camera = FakeCamera(bare(frame), [], not_opened("fake", RuntimeError("errno=16 Device or\nresource busy")))
    found, *_, failure = played(camera)
    assert found == []
    assert failure.startswith("fake: busy (errno=16 Device or resource busy)")
    assert camera.closed == 1
    assert "is it plugged in" in str(not_opened("fake", RuntimeError("No device connected")))


@pytest.mark.parametrize(("rate_hz", "warned"), [(29.0, False), (16.0, False), (11.0, True), (0.5, True)])
def test_a_frame_rate_that_collapses_is_a_warning_with_figures(frame, rate_hz: float, warned: bool) -> None:
    before = stamps(90)  # the rate is checked from two seconds on
    slow = stamps(60, rate_hz, before[-1] + 1.0 / rate_hz)
    after = stamps(60, RATE_HZ, slow[-1] + 1.0 / RATE_HZ)
    again = stamps(60, rate_hz, after[-1] + 1.0 / rate_hz)
    _, frames, said, _ = played(FakeCamera(bare(frame), recorded(frame, before + slow + after + again)))
    # One warning per collapse, and the slowest rate afterwards.
    assert len(said) == (2 if warned else 0)
    assert len(frames.warnings) == (1 if warned else 0)
    if warned:
        assert "of 30 frames per second" in said[0]
        assert f"fell to {rate_hz:.1f} Hz of 30 Hz" in frames.warnings[0]


def test_slow_first_frames_are_no_collapse(frame) -> None:
    # The first frame loads the compiled kernels for a second.
    times = [1000.0, *(1001.0 + number / RATE_HZ for number in range(90))]
    _, frames, said, _ = played(FakeCamera(bare(frame), recorded(frame, times)))
    assert said == frames.warnings == []


def test_stamps_that_repeat_or_go_back_are_left_out_and_counted(frame) -> None:
    times = [*stamps(3), 1000.0, 1000.0 + 2 / RATE_HZ, 1001.0]
    found, frames, _, _ = played(FakeCamera(bare(frame), recorded(frame, times)))
    assert len(found) == 4
    assert frames.warnings[0].startswith("2 frames left out")


def test_intrinsics_of_another_resolution_are_refused(frame) -> None:
    double = replace(bare(frame), width_px=640, height_px=480)
    with pytest.raises(ImageError, match="images of 320×240 pixels, intrinsics for 640×480"):
        list(LiveFrames(FakeCamera(double, recorded(frame, stamps(1)))))


def test_a_calibration_file_gives_the_mount_and_is_compared(frame, calibration_file, tmp_path: Path) -> None:
    own = read_camera(calibration_file(tmp_path / "a.toml", frame.camera))
    found, _, said, _ = played(FakeCamera(bare(frame), recorded(frame, stamps(1))), calibration=own)
    assert said == []
    assert found[0].mount_known
    assert found[0].frame.camera == replace(bare(frame), mount_pitch_rad=own.camera.mount_pitch_rad)
    longer = replace(bare(frame), fx_px=300.0, fy_px=300.0)
    found, _, said, _ = played(FakeCamera(longer, recorded(frame, stamps(1))), calibration=own)
    assert "fx = 287.5 px differs from the device's 300.0 px by 4.2 %" in said[0]
    assert found[0].frame.camera.fx_px == 300.0
    other = read_camera(calibration_file(tmp_path / "b.toml", replace(frame.camera, width_px=330)))
    with pytest.raises(ImageError, match="calibration is for 330×240, the camera gives 320×240"):
        list(LiveFrames(FakeCamera(bare(frame), []), calibration=other))


def test_colour_of_another_time_is_a_warning_and_depth_is_used(frame) -> None:
    late = [CameraImages(t_s=t_s, depth_m=frame.depth_m, rgb=frame.rgb, rgb_t_s=t_s + 0.033) for t_s in stamps(3)]
    found, frames, said, _ = played(FakeCamera(bare(frame), late), colour=True)
    assert [named.has_colour for named in found] == [False] * 3
    assert said == ["fake: depth and colour are 33 ms apart, at most 20 ms are paired; depth alone is used"]
    assert frames.warnings == ["3 frames used without colour: depth and colour were more than 20 ms apart"]
    paired = [replace(images, rgb_t_s=images.t_s + 0.01) for images in late]
    found, *_ = played(FakeCamera(bare(frame), paired), colour=True)
    assert all(named.has_colour for named in found)


def test_gravity_is_opposite_to_the_mean_force(frame) -> None:
    rng = np.random.default_rng(1)
    down = np.array([0.1, 0.9, 0.4]) / np.linalg.norm([0.1, 0.9, 0.4])
    # Vibration of 1 m/s²: the mean over a second of 30 Hz keeps 1/√60 of it (exponential weights), which is 0.75° per axis.
    images = [CameraImages(t_s=t_s, depth_m=frame.depth_m, force_C=-9.8 * down + rng.normal(0.0, 1.0, 3)) for t_s in stamps(120)]
    found, *_ = played(FakeCamera(bare(frame), images))
    assert np.degrees(np.arccos(found[-1].gravity_C @ down)) < 3.0
    falling = [replace(item, force_C=np.array([0.0, -1.0, 0.0])) for item in images[:3]]
    found, *_ = played(FakeCamera(bare(frame), falling))
    assert found[0].gravity_C is None
    found, *_ = played(FakeCamera(bare(frame), images[:1]), gravity_C=down)
    np.testing.assert_array_equal(found[0].gravity_C, down)


@pytest.mark.parametrize("name", ["kinect", "realsense:1", ""])
def test_unknown_cameras_are_refused_with_the_list(name: str) -> None:
    with pytest.raises(SettingsError, match="allowed: realsense, orbbec, oak"):
        camera_by_name(name)


@pytest.fixture
def plugged_in(monkeypatch: pytest.MonkeyPatch, frame) -> Callable[..., FakeCamera]:
    """Plug a fake camera in under every name."""

    def plug(images: list[CameraImages], error: Exception | None = None) -> FakeCamera:
        camera = FakeCamera(bare(frame), images, error)
        monkeypatch.setattr("treadline.io.live.camera_by_name", lambda _name: camera)
        return camera

    return plug


def test_the_command_shows_a_line_and_the_newest_picture(plugged_in, frame, capsys, tmp_path: Path) -> None:
    camera = plugged_in([replace(item, rgb=frame.rgb, rgb_t_s=item.t_s) for item in recorded(frame, stamps(40))])
    table = tmp_path / "walk.jsonl"
    words = ["see", "--live", "realsense", "--seconds", "1", "--out", str(tmp_path / "seen"), "--headings", str(table), "--json"]
    assert main(words) == 0
    said = capsys.readouterr()
    values = json.loads(said.out)
    # A second at 30 Hz has 31 stamps, the one at 0 s with them.
    assert values["summary"]["count"] == values["summary"]["accepted"] == 31
    assert len(table.read_text().splitlines()) == 31
    assert "heading +" in said.err
    # 3 mm on both: noise of one frame.
    rise, run = (int(number) for number in re.search(r"rise (\d+) mm, run (\d+) mm", said.err).groups())
    assert (rise, run) == (pytest.approx(160, abs=3), pytest.approx(300, abs=3))
    assert (camera.opened, camera.closed, camera.colour) == (1, 1, True)
    assert [path.name for path in (tmp_path / "seen").iterdir()] == ["live-seen.png"]
    assert cv2.imread(str(tmp_path / "seen" / "live-seen.png")).shape[1] == 960


def test_ctrl_c_ends_a_live_view_with_its_summary(plugged_in, frame, capsys) -> None:
    def interrupted() -> Iterator[CameraImages]:
        yield from recorded(frame, stamps(3))
        raise KeyboardInterrupt

    camera = plugged_in(interrupted())
    assert main(["see", "--live", "orbbec"]) == 0
    assert capsys.readouterr().out.startswith("fake: 3 of 3 frames accepted (100 %)")
    assert camera.closed == 1


def test_a_rejected_frame_shows_its_reason(plugged_in, frame, capsys) -> None:
    wall = replace(frame, depth_m=np.full_like(frame.depth_m, 1.5))
    plugged_in(recorded(wall, stamps(3)))
    main(["see", "--live", "realsense", "--seconds", "0.05"])
    said = capsys.readouterr()
    assert "no heading: " in said.err
    assert "rejected 3: " in said.out


def test_lines_are_written_once_a_second_where_no_person_watches(capsys) -> None:
    times = iter([0.0, 0.0, 0.5, 1.2, 1.2])
    line = StatusLine(clock=lambda: next(times))
    for text in ("a", "b", "c"):
        line.show(text)
    line.warn("slow")
    assert capsys.readouterr().err == "a\nc\nwarning: slow\n"
