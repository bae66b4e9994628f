"""``treadline replay``: an unchanged run repeats itself bit for bit; settings change what they name; bad logs are one line."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.cli import main
from treadline.cli._output import SimulatedTime
from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Truth
from treadline.core.signals import HeadingEstimate, ImuSample, TrackCommand
from treadline.io.mcap_log import RunLog
from treadline.io.mcap_read import LogDecoder, mcap_messages, read_log
from treadline.io.message_types import seconds_of
from treadline.io.runs import read_series
from treadline.scenario.chair import read_chair

from .conftest import assert_refused

SCENARIO = """
[stair]
slope_deg = 28
steps = 30
width_m = 2.4
[start]
place = "flight"
step = 6
heading_deg = 8
[drive]
duration_s = 0.8
"""
WITHOUT_IMAGES = SCENARIO + '[sensors]\ncamera = "statistical"\n'
PID = f"{Path(__file__).parents[2] / 'examples' / 'own_controller_pid.py'}:HeadingPid"
FRAMES = 8
"""Frames that arrive in 0.8 s: the ninth, exposed at 0.8 s, is still under way when the run ends."""
RUN_FOLDER = ["log.mcap", "manifest.json", "result.json", "run-controller.json", "series.csv"]
WITH_WHAT_ONLY_A_SIMULATOR_KNOWS = {"roll_back_m", "lateral_m", "min_stability_margin_deg", "climbed_m"}


@pytest.fixture(scope="module")
def climbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short climb with its frames."""
    folder = tmp_path_factory.mktemp("climb")
    (folder / "short.toml").write_text(SCENARIO)
    assert main(["climb", str(folder / "short.toml"), "--out", str(folder / "run"), "--log-images", "--json"]) == 0
    return folder / "run"


def signals_of(run: Path, *kinds: type) -> list[Any]:
    return [signal for signal in read_log(run / "log.mcap") if isinstance(signal, kinds)]


def messages_of(run: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Return the messages of each topic with their log times."""
    found: dict[str, list[tuple[int, bytes]]] = {}
    for topic, taken_ns, data in mcap_messages(run / "log.mcap", lambda _: True, sealed=True):
        found.setdefault(topic.name, []).append((taken_ns, data))
    return found


def rewritten(run: Path, out: Path, change: Callable[[Any], Any | None]) -> Path:
    """Copy a run with each signal of its log changed, as late as it was; None leaves it out."""
    shutil.copytree(run, out, ignore=shutil.ignore_patterns("log.mcap"))
    decoder = LogDecoder()
    with RunLog(out / "log.mcap", image_every=1) as log:
        for topic, taken_ns, data in mcap_messages(run / "log.mcap", lambda _: True, sealed=True):
            signal = decoder.signal(topic.name, topic.kind, data)
            changed = None if signal is None else change(signal)
            if changed is not None:
                log(changed, seconds_of(taken_ns) + changed.t_s - signal.t_s)
    return out


@pytest.fixture(scope="module")
def blind(climbed: Path) -> Path:
    """The same run without its frames: quick to read where vision does not matter."""
    return rewritten(climbed, climbed.parent / "blind", lambda signal: None if isinstance(signal, RgbdFrame) else signal)


def test_an_unchanged_run_repeats_itself_bit_for_bit(run, climbed: Path, tmp_path: Path) -> None:
    outcome = run("replay", climbed, "--out", tmp_path / "again", "--log-images", "--json")
    assert outcome.code == 0, outcome.err
    values = outcome.values
    assert not set(values) & WITH_WHAT_ONLY_A_SIMULATOR_KNOWS
    assert (values["verdict"], values["sees"]) == ("time_up", "images")
    assert values["frames"] == values["accepted"] + sum(values["refusals"].values()) == FRAMES
    assert values["largest_command_gap_m_s"] == values["largest_seat_gap_m_s"] == values["rms_difference_deg"] == 0.0
    assert values["commands_compared"] == len(signals_of(climbed, TrackCommand)) >= 4  # 4 Hz from zero on
    assert values["rms_error_deg"] == values["recorded_rms_error_deg"]
    assert 0.0 < values["rms_error_deg"] < 0.5
    # What the chair itself knows agrees with what the simulator knew: a heading within 0.5°, a seat within its sensor's noise.
    climb = json.loads((climbed / "result.json").read_text())
    for key, tolerance in (("rms_heading_deg", 0.5), ("max_abs_heading_deg", 0.5), ("seat_rms_deg", 0.1)):
        assert values[key] == pytest.approx(climb[key], abs=tolerance), key
    # Readings, frames, headings seen, estimates, commands, events, truth and plans, frames of the scene: every message of the log
    # but the shape of the stair, which a recording does not know.
    again, first = (messages_of(folder) for folder in (tmp_path / "again", climbed))
    assert "/plan" in again
    assert again == {topic: data for topic, data in first.items() if topic != "/stair/true"} | {"/tf_static": again["/tf_static"]}


def test_a_replay_leaves_a_whole_run_folder_that_can_be_reported_and_replayed(run, climbed: Path, tmp_path: Path) -> None:
    out = tmp_path / "again"
    assert run("replay", climbed, "--out", out, "--set", "filter.gate=16", "--log-images").code == 0
    assert sorted(path.name for path in out.iterdir()) == RUN_FOLDER
    settings = json.loads((out / "manifest.json").read_text())["settings"]
    assert (settings["set"], settings["replay"]["filter"]["gate"]) == (["filter.gate=16"], 16.0)
    series, then = read_series(out), read_series(climbed)
    for column, recorded in (("t_s", "t_s"), ("heading_deg", "heading_deg"), ("recorded_deg", "estimate_deg")):
        np.testing.assert_array_equal(series[column], then[recorded])
    assert np.isfinite(series["seen_deg"][:-1]).all()  # a tenth of the ticks, those with a frame
    assert run("report", out).code == 0
    assert "filter.gate=16" in (out / "report.html").read_text()
    assert run("replay", out, "--out", tmp_path / "twice", "--json").values["rms_difference_deg"] == 0.0
    assert json.loads((tmp_path / "twice" / "manifest.json").read_text())["settings"]["set"] == ["filter.gate=16"]


def test_truth_and_commands_are_for_scoring_only(run, blind: Path, tmp_path: Path) -> None:
    def other(signal: Any) -> Any:
        if isinstance(signal, TrackCommand):
            return replace(signal, left_m_s=signal.left_m_s + 0.25)
        return replace(signal, heading_rad=1.0) if isinstance(signal, Truth) else signal

    wrong = rewritten(blind, tmp_path / "wrong", other)
    values = run("replay", wrong, "--out", tmp_path / "again", "--json").values
    assert values["largest_command_gap_m_s"] == pytest.approx(0.25)
    assert values["rms_difference_deg"] == 0.0
    assert values["rms_error_deg"] > 40.0
    bare = rewritten(blind, tmp_path / "bare", lambda signal: None if isinstance(signal, Truth) else signal)
    values = run("replay", bare, "--out", tmp_path / "bare-again", "--json").values
    assert values["largest_command_gap_m_s"] == values["rms_difference_deg"] == 0.0
    assert values["rms_error_deg"] is None
    assert run("report", tmp_path / "bare-again").code == 0


def test_without_images_the_headings_recorded_are_fused_and_the_summary_says_so(run, blind: Path, tmp_path: Path) -> None:
    outcome = run("replay", blind, "--out", tmp_path / "again")
    assert (outcome.code, "perception was skipped" in outcome.out) == (0, True)
    result = json.loads((tmp_path / "again" / "result.json").read_text())
    assert (result["sees"], result["frames"], result["accepted"]) == ("recorded headings", 0, FRAMES)
    assert result["largest_command_gap_m_s"] == 0.0


def test_anybodys_log_with_the_imu_in_the_camera_and_no_attitude(run, recording, climbed: Path, tmp_path: Path) -> None:
    R_BC = read_chair("wheelchair").camera_at(240).R_BC
    log = recording()
    for signal in signals_of(climbed, ImuSample, RgbdFrame):
        if isinstance(signal, ImuSample):
            rate, force = (R_BC.T @ part for part in (signal.angular_velocity_rad_s, signal.linear_acceleration_m_s2))
            log.imu("/camera/imu", signal.t_s, None, tuple(rate), tuple(force))
        else:
            counts = np.round(np.nan_to_num(signal.depth_m, nan=0.0) * 1000.0).astype(np.uint16)
            log.calibration("/camera/depth_registered/camera_info", signal.t_s, signal.camera)
            log.image("/camera/rgb/image_color", signal.t_s, signal.rgb[:, :, ::-1], "bgr8")
            log.image("/camera/depth_registered/image_raw", signal.t_s, counts, "16UC1")
    path = log.write(tmp_path / "kinect.mcap")
    outcome = run("replay", path, "--set", "imu.axes=camera", "--out", tmp_path / "out", "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.values["topics"]["depth"] == "/camera/depth_registered/image_raw"
    assert (outcome.values["frames"], outcome.values["largest_command_gap_m_s"]) == (FRAMES, None)
    # The accelerometer also measures the chair's motion: what remains is the tilt that it reads from that.
    then = np.array([signal.heading_rad for signal in signals_of(climbed, HeadingEstimate)])
    now = np.array([signal.heading_rad for signal in signals_of(tmp_path / "out", HeadingEstimate)])
    assert np.rad2deg(np.abs(now - then).max()) < 1.0


def test_a_log_without_an_imu_ends_held(run, recording, climbed: Path, tmp_path: Path) -> None:
    log = recording()
    # Vision alone may drive for a second (hazard 6): the frames twice.
    for later_s in (0.0, 0.9):
        for frame in signals_of(climbed, RgbdFrame):
            log.calibration("/depth/camera_info", frame.t_s + later_s, frame.camera)
            log.image("/depth/image", frame.t_s + later_s, frame.depth_m, "32FC1")
    path = log.write(tmp_path / "log.mcap")
    outcome = run("replay", path, "--out", tmp_path / "out", "--json")
    assert (outcome.code, outcome.values["verdict"], outcome.values["frames"]) == (1, "held", 2 * FRAMES)
    assert "IMU" in outcome.values["cause"]
    assert run("replay", path, "--set", "vision=paper", "--out", tmp_path / "paper").code == 2


def test_a_clock_that_leaps_back_holds_the_chair(run, blind: Path, tmp_path: Path) -> None:
    def back(signal: Any) -> Any:
        return replace(signal, t_s=signal.t_s + 10.0 - (1.1 if signal.t_s > 0.6 else 0.0))

    outcome = run("replay", rewritten(blind, tmp_path / "leap", back), "--out", tmp_path / "again", "--json")
    assert (outcome.code, outcome.values["verdict"]) == (1, "held")
    assert "leaps" in outcome.values["cause"]
    assert outcome.values["duration_s"] == pytest.approx(0.61, abs=0.02)


def test_an_interrupted_replay_leaves_what_is_done_readable(
    run, blind: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_: object, t_s: float, duration_s: float) -> None:
        del duration_s
        if t_s > 0.4:
            raise KeyboardInterrupt

    monkeypatch.setattr(SimulatedTime, "at", interrupt)
    out = tmp_path / "again"
    outcome = run("replay", blind, "--out", out)
    assert (outcome.code, outcome.out) == (130, "")
    assert signals_of(out, HeadingEstimate)
    assert read_series(out)["t_s"][-1] == pytest.approx(0.4)
    assert json.loads((out / "manifest.json").read_text())["seed"] == 0
    assert not (out / "result.json").exists()


def test_the_controller_of_the_run_is_used_again_whatever_became_of_its_file(run, tmp_path: Path) -> None:
    from treadline.scenario.shipped_files import shipped_controller

    shipped = shipped_controller("wheelchair")
    (tmp_path / "short.toml").write_text(WITHOUT_IMAGES)
    mine, other = tmp_path / "mine.json", tmp_path / "other.json"
    replace(shipped, K=0.5 * shipped.K).save(mine)
    replace(shipped, K=0.8 * shipped.K).save(other)
    first = tmp_path / "first"
    assert run("climb", tmp_path / "short.toml", "--controller", mine, "--out", first).code == 0
    assert (first / "run-controller.json").read_bytes() == mine.read_bytes()
    mine.unlink()
    again = tmp_path / "again"
    assert run("replay", first, "--out", again, "--json").values["largest_command_gap_m_s"] == 0.0
    settings = json.loads((again / "manifest.json").read_text())["settings"]
    assert settings["replay"]["controller"] == "run-controller.json"
    # Another one can be asked for.
    changed = tmp_path / "changed"
    values = run("replay", first, "--set", f"controller={other}", "--out", changed, "--json").values
    assert values["largest_command_gap_m_s"] > 0.001


def test_a_run_names_its_plug_in_and_its_replay_asks_for_it(run, tmp_path: Path) -> None:
    scenario, first, again = tmp_path / "short.toml", tmp_path / "first", tmp_path / "again"
    scenario.write_text(WITHOUT_IMAGES)
    assert run("climb", scenario, "--controller", PID, "--out", first).code == 0
    assert json.loads((first / "manifest.json").read_text())["plugins"] == {"controller": PID}
    assert_refused(run("replay", first, "--out", again), f"give --controller {PID}, or --controller shipped")
    played = run("replay", first, "--controller", PID, "--out", again, "--json")
    assert played.values["largest_command_gap_m_s"] == pytest.approx(0.0, abs=1e-9)  # the same readings, the same controller
    assert run("replay", first, "--controller", "shipped", "--out", tmp_path / "shipped", "--json").code == 0
    assert (tmp_path / "shipped" / "run-controller.json").is_file()


CAMERA = "width = 320\nheight = 240\nfx_px = 287.5\nfy_px = 287.5\ncx_px = 159.5\ncy_px = 119.5\n"


def test_a_calibration_counts_instead_of_the_logs_and_a_key_before_it(run, climbed: Path, tmp_path: Path) -> None:
    declared = tmp_path / "mounted.toml"
    declared.write_text(CAMERA + "mount_pitch_deg = 41.5\nmount_m = [0.4, 0.1, 0.8]\n")
    keys = ["--set", "camera.mount_pitch_deg=41.5", "--set", "camera.mount_m=[0.4, 0.1, 0.8]"]
    by_file = run("replay", climbed, "--camera", declared, "--out", tmp_path / "file", "--log-images", "--json").values
    by_keys = run("replay", climbed, *keys, "--out", tmp_path / "keys", "--log-images", "--json").values
    assert by_file["rms_error_deg"] == by_keys["rms_error_deg"] > by_keys["recorded_rms_error_deg"]
    # The logs' metadata hold the manifests, which say where the calibration came from.
    file, by_key = (list(mcap_messages(tmp_path / name / "log.mcap", lambda _topic: True)) for name in ("file", "keys"))
    assert file == by_key
    over = tmp_path / "over"
    right = ["--set", "camera.mount_pitch_deg=40", "--set", "camera.mount_m=[0.4, 0.0, 0.8]"]
    assert run("replay", climbed, "--camera", declared, *right, "--out", over, "--json").values["largest_command_gap_m_s"] == 0.0
    # The run's folder says what the file said, which may be another one tomorrow.
    declared.unlink()
    again = run("replay", tmp_path / "file", "--out", tmp_path / "again", "--json").values
    assert again["largest_command_gap_m_s"] == 0.0


def test_the_keys_are_listed(run, blind: Path) -> None:
    assert "filter.gate = 9" in run("replay", "--keys").out
    assert run("replay", blind, "--keys", "--json").values["keys"]["control.speed_m_s"] == "0.2"
