"""``treadline mount``: half a minute on a flight measures pitch and roll; a log that cannot is one line."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import RecordedDrive, ViewRecipe
from world import belts, imu_at

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import HeadingMeasurement, ImuSample
from treadline.io.mcap_log import RunLog
from treadline.io.mcap_read import read_log
from treadline.scenario.camera_file import read_camera

SECONDS = 26
"""Eight stretches of three seconds, and two for the tail: the least that the calibrator answers to."""
IMU_S = 0.05
PITCH_OFF_DEG, ROLL_OFF_DEG = 2.0, -3.0
RECIPE = ViewRecipe(
    scenes=("up",),
    steps=(48, 50),
    place_m=(0.3, 0.5),
    mount_pitch_error_deg=(PITCH_OFF_DEG, PITCH_OFF_DEG),
    mount_roll_error_deg=(ROLL_OFF_DEG, ROLL_OFF_DEG),
)
KEYS = {
    "accepted", "reason", "pitch_deg", "pitch_sigma_deg", "roll_deg", "roll_sigma_deg", "yaw_deg", "yaw_sigma_deg",
    "frames", "counted", "left_out", "dropped", "topics", "change_deg", "path",
}  # fmt: skip
MEANT_PITCH_DEG = 40.0
"""Mount pitch of the chair file [°]."""


def drive(log: Path, heading_rad: Callable[[float], float]) -> Path:
    """Write a drive with a frame a second, by a camera that sits 2 and -3 degrees off what the chair's file says."""
    road = RecordedDrive(np.random.default_rng(2026), RECIPE)
    with RunLog(log, image_every=1) as write:
        for k in range(round(SECONDS / IMU_S) + 1):
            t_s = k * IMU_S
            pose = road.pose(0.2 * t_s, heading_rad(t_s))
            rate = np.array([0.0, 0.0, (heading_rad(t_s + IMU_S) - heading_rad(t_s)) / IMU_S])
            write(imu_at(t_s, pose.R_WB, rate))
            write(belts(t_s))
            if k % round(1.0 / IMU_S) == 0:
                write(road.view(t_s, pose).frame)
    return log


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """To and fro by 8 degrees."""
    return drive(tmp_path_factory.mktemp("drive") / "log.mcap", lambda t_s: 8.0 * DEG * math.sin(t_s / 4.0))


def changed(log: Path, out: Path, change: Callable[[Any], Any | None]) -> Path:
    """Copy a log with each signal changed; None leaves it out."""
    with RunLog(out, image_every=1) as write:
        for signal in read_log(log):
            other = change(signal)
            if other is not None:
                write(other)
    return out


def without(kind: type) -> Callable[[Any], Any | None]:
    return lambda signal: None if isinstance(signal, kind) else signal


def test_pitch_and_roll_are_found_within_their_interval(run, driven: Path, tmp_path: Path) -> None:
    out = tmp_path / "camera.toml"
    outcome = run("mount", driven, "--out", out, "--json")
    assert outcome.code == 0, outcome.err
    values = outcome.values
    assert set(values) == KEYS
    assert values["accepted"]
    for name, off in (("pitch", PITCH_OFF_DEG), ("roll", ROLL_OFF_DEG)):
        # Half a minute, a frame a second: a tenth of what a drive gives; twice the target of 0.15 degrees for ten times as much.
        assert values["change_deg"][name] == pytest.approx(off, abs=min(0.3, 2.6 * values[f"{name}_sigma_deg"])), name
        assert values[f"{name}_sigma_deg"] < 0.2
    assert values["yaw_deg"] == pytest.approx(0.0, abs=min(1.0, 2.6 * values["yaw_sigma_deg"]))
    assert values["frames"] == SECONDS + 1
    assert values["counted"] + sum(values["left_out"].values()) == values["frames"]
    written = read_camera(out)
    assert written.mount_pitch_deg == pytest.approx(values["pitch_deg"], abs=1e-4)
    assert written.mount_roll_deg == pytest.approx(values["roll_deg"], abs=1e-4)
    assert (written.width, written.height) == (320, 240)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["camera.toml"]


def test_a_wrong_calibration_is_corrected_and_keeps_the_rest(run, driven: Path, tmp_path: Path) -> None:
    declared = tmp_path / "declared.toml"
    declared.write_text(
        "width = 320\nheight = 240\nfx_px = 287.5\nfy_px = 287.5\ncx_px = 159.5\ncy_px = 119.5\ndepth_unit_m = 0.0002\n"
        'mount_pitch_deg = 44.0\nmount_yaw_deg = 0.5\nsensor = "kinect1"\n'
    )
    outcome = run("mount", driven, "--camera", declared, "--out", declared, "--force")
    assert outcome.code == 0, outcome.err
    assert outcome.out.startswith("pitch 4")
    assert f"treadline replay {driven} --camera {declared} --out RUN" in outcome.out
    assert "changed by pitch -" in outcome.out
    learned = read_camera(declared)
    assert learned.mount_pitch_deg == pytest.approx(MEANT_PITCH_DEG + PITCH_OFF_DEG, abs=0.3)
    assert learned.mount_roll_deg == pytest.approx(ROLL_OFF_DEG, abs=0.3)
    assert learned.depth_unit_m == 0.0002
    assert learned.sensor == "kinect1"
    assert learned.mount_m == (0.4, 0.0, 0.8)  # the chair's: the file does not say
    # What was learned stays when it is accepted.
    again = run("mount", driven, "--camera", declared, "--out", tmp_path / "again.toml", "--json").values
    assert max(abs(again["change_deg"][name]) for name in ("pitch", "roll")) < 0.05


def test_rejected_frames_are_counted_by_reason(run, driven: Path, tmp_path: Path) -> None:
    def level(signal: Any) -> Any:
        return replace(signal, orientation=np.array([1.0, 0.0, 0.0, 0.0])) if isinstance(signal, ImuSample) else signal

    def dark(signal: Any) -> Any:
        return replace(signal, depth_m=np.full_like(signal.depth_m, 2.0)) if isinstance(signal, RgbdFrame) else signal

    for change, words in (
        (level, "the slope by vision is more than 3° from the IMU's"),
        (dark, "gravity is not known, and no treads show it"),
    ):
        outcome = run("mount", changed(driven, tmp_path / "log.mcap", change), "--out", tmp_path / "camera.toml", "--json")
        assert outcome.code == 1
        values = outcome.values
        assert not values["accepted"]
        assert values["path"] is values["pitch_deg"] is values["change_deg"]["pitch"] is None
        assert f"0 of {SECONDS + 1} frames are usable" in values["reason"]
        assert words in values["reason"]
        assert sum(values["left_out"].values()) == SECONDS + 1
        assert not (tmp_path / "camera.toml").exists()


def test_a_drive_that_is_too_short_says_how_much_is_missing(run, driven: Path, tmp_path: Path) -> None:
    def early(signal: Any) -> Any:
        return signal if signal.t_s < 15.0 else None

    outcome = run("mount", changed(driven, tmp_path / "log.mcap", early), "--out", tmp_path / "camera.toml", "--json")
    assert outcome.code == 1
    values = outcome.values
    # Five blocks of three seconds are there, eight are needed.
    assert "5 blocks of 3 s" in values["reason"]
    assert "drive and record at least 9 s more" in values["reason"]
    assert f"{values['counted']} of {values['frames']} frames are usable" in values["reason"]
    assert 0 < values["counted"] == values["frames"] - sum(values["left_out"].values())


def test_a_mount_far_from_the_one_meant_is_said_to_be(run, driven: Path, tmp_path: Path) -> None:
    declared = tmp_path / "declared.toml"
    declared.write_text(
        "width = 320\nheight = 240\nfx_px = 287.5\nfy_px = 287.5\ncx_px = 159.5\ncy_px = 119.5\nmount_pitch_deg = 20\n"
    )
    outcome = run("mount", driven, "--camera", declared, "--out", tmp_path / "camera.toml")
    assert outcome.code == 1
    assert len(outcome.out.splitlines()) == 1
    assert "more than 15° from its direction with the nominal mount" in outcome.out


def test_a_log_that_cannot_decide_is_one_line(run, driven: Path, tmp_path: Path) -> None:
    def seen(signal: Any) -> Any:
        if isinstance(signal, RgbdFrame):
            return HeadingMeasurement(t_s=signal.t_s, heading_rad=0.0, sigma_rad=0.01, edge_count=4)
        return signal

    blind = changed(driven, tmp_path / "blind.mcap", seen)
    numb = changed(driven, tmp_path / "numb.mcap", without(ImuSample))
    there = tmp_path / "there.toml"
    there.write_text("width = 640\nheight = 480\nfx_px = 575\nfy_px = 575\ncx_px = 319.5\ncy_px = 239.5\n")
    for arguments, words in (
        ((blind,), "no images"),
        ((numb,), "no IMU"),
        ((driven, "--camera", there), "sizes differ"),
    ):
        outcome = run("mount", *arguments, "--out", tmp_path / "camera.toml")
        assert outcome.code == 2
        assert outcome.out == ""
        last = outcome.err.splitlines()[-1]
        assert last.startswith("treadline: ")
        assert words in last
        assert "--set" not in last
    outcome = run("mount", driven, "--out", tmp_path)
    assert outcome.code == 2
    assert "is a folder" in outcome.err
