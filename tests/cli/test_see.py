"""``treadline see``: recorded frames in, a heading or a reason out; bad files are named."""

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from jaxtyping import Float
from surfaces import on_a_flight

from treadline.cli import main
from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.io.frames import read_frame
from treadline.scenario.camera_file import read_camera
from treadline.scenario.scenario import read_scenario

from .conftest import Outcome, assert_refused

HEADING_DEG = 12.0
KEYS = {"accepted", "reason", "heading_deg", "sigma_deg", "edge_direction", "edges", "box_px", "stair", "ms"}
CAMERA = """
width = 320
height = 240
fx_px = 287.5
fy_px = 287.5
cx_px = 159.5
cy_px = 119.5
mount_pitch_deg = 40.0
"""


def write_pair(folder: Path, name: str, frame: RgbdFrame) -> tuple[Path, Path]:
    rgb, depth = folder / f"{name}_rgb.png", folder / f"{name}_depth.png"
    cv2.imwrite(str(rgb), cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR))
    write_depth(depth, np.round(np.nan_to_num(frame.depth_m, nan=0.0) * 1000.0))
    return rgb, depth


def write_depth(path: Path, counts: Float[np.ndarray, "h w"]) -> None:
    cv2.imwrite(str(path), counts.astype(np.uint16))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_frames(tmp_path)
    return tmp_path


def write_frames(folder: Path) -> None:
    """Write a good pair, a, its calibration and gravity."""
    frame, down = on_a_flight(1, HEADING_DEG)
    write_pair(folder, "a", frame)
    (folder / "camera.toml").write_text(CAMERA)
    (folder / "gravity.csv").write_text("name,x,y,z\na," + ",".join(f"{part:.6f}" for part in down) + "\n")


def pair(folder: Path) -> list[object]:
    return [folder / "a_rgb.png", folder / "a_depth.png", "--camera", folder / "camera.toml"]


def gravity(folder: Path) -> str:
    return (folder / "gravity.csv").read_text().splitlines()[1].removeprefix("a,")


def test_a_recorded_frame_gives_the_heading_and_all_keys(run, folder: Path) -> None:
    outcome = run("see", *pair(folder), f"--gravity={gravity(folder)}", "--json")
    assert (outcome.code, outcome.err) == (0, "")
    seen = outcome.values
    assert set(seen) >= KEYS
    assert (seen["accepted"], seen["reason"]) == (True, None)
    # Three of the declared deviations, and depth rounded to millimetres costs next to nothing.
    assert abs(seen["heading_deg"] - HEADING_DEG) < 3.0 * seen["sigma_deg"] < 1.0
    assert np.linalg.norm(seen["edge_direction"]) == pytest.approx(1.0)
    u0, v0, u1, v1 = seen["box_px"]
    assert 0 <= u0 < u1 < 320
    assert 0 <= v0 < v1 < 240
    # 1 cm on a rise of 0.16 m and a run of 0.30 m: levels are medians of noisy blocks.
    assert seen["stair"]["rise_m"] == pytest.approx(0.30 * np.tan(28.0 * DEG), abs=0.01)
    assert seen["stair"]["run_m"] == pytest.approx(0.30, abs=0.01)


def test_the_measured_stair_is_written_as_a_scenario(run, folder: Path) -> None:
    assert run("see", folder, "--stair", folder / "measured.toml").code == 0
    stair = read_scenario(folder / "measured.toml").stair
    # As above: 1 cm on a rise of 0.16 m and a run of 0.30 m.
    assert stair.rise_m == pytest.approx(0.30 * np.tan(28.0 * DEG), abs=0.01)
    assert stair.run_m == pytest.approx(0.30, abs=0.01)


def test_turned_images_are_refused_with_the_value_to_set(run, folder: Path) -> None:
    depth = cv2.imread(str(folder / "a_depth.png"), cv2.IMREAD_UNCHANGED)
    write_depth(folder / "a_depth.png", depth[::-1, ::-1])
    outcome = run("see", folder, "--json")
    (frame,), (finding,) = outcome.values["frames"], outcome.values["calibration"]
    assert frame["heading_deg"] is None
    assert frame["reason"] == finding
    assert finding.startswith("images are turned clockwise by 180° from gravity; turn them back")
    assert run("see", *pair(folder), f"--gravity={gravity(folder)}", "--json").values["reason"] == finding


@pytest.mark.parametrize("with_gravity", [True, False])
def test_without_a_mount_the_heading_is_said_to_be_the_cameras_own(run, folder: Path, with_gravity: bool) -> None:
    known = run("see", *pair(folder), "--json").values
    assert (known["mount_known"], known["warning"]) == (True, None)
    (folder / "camera.toml").write_text(CAMERA.replace("mount_pitch_deg = 40.0\n", ""))
    declared = [f"--gravity={gravity(folder)}"] if with_gravity else []
    seen = run("see", *pair(folder), *declared, "--json").values
    assert seen["mount_known"] is False
    assert "give mount_pitch_deg" in seen["warning"]
    # tan 12° · cos 40° is that of 9.2° (docs/frames.md): half a degree separates them.
    assert seen["heading_deg"] == pytest.approx(np.arctan(np.tan(HEADING_DEG * DEG) * np.cos(40.0 * DEG)) / DEG, abs=0.5)
    # The frame was taken on the flight: there the nosings' plane stands in for the mount, and gravity does not.
    assert seen["heading_on_flight_deg"] == pytest.approx(HEADING_DEG, abs=0.5)
    assert abs(seen["heading_on_level_deg"] - HEADING_DEG) > 1.5


def test_the_papers_method_answers_or_says_why_not(run, folder: Path) -> None:
    for rule in ("median", "otsu", "rosin", "mad"):
        outcome = run("see", *pair(folder), "--method", "paper", "--threshold", rule, "--json")
        seen = outcome.values
        assert outcome.code == (0 if seen["accepted"] else 1)
        assert (seen["heading_deg"] is None) == bool(seen["reason"])
        assert seen["square_deg"] == 90.0


def test_a_mount_that_may_be_in_radians_is_asked_about(run, folder: Path) -> None:
    (folder / "camera.toml").write_text(CAMERA.replace("mount_pitch_deg = 40.0", "mount_pitch_deg = 0.44"))
    assert "warning: mount_pitch_deg is 0.44°; did you mean 25.2, for 0.44 rad?" in run("see", *pair(folder)).out


def test_a_wall_is_an_answer_of_no(run, folder: Path) -> None:
    write_depth(folder / "a_depth.png", np.full((240, 320), 1500.0))
    outcome = run("see", *pair(folder), f"--gravity={gravity(folder)}", "--json")
    seen = outcome.values
    assert (outcome.code, seen["accepted"], bool(seen["reason"])) == (1, False, True)
    assert seen["heading_deg"] is seen["sigma_deg"] is seen["edge_direction"] is seen["stair"] is None


def test_the_six_stages_and_what_was_seen_are_written(run, folder: Path) -> None:
    out = folder / "stages"
    assert run("see", *pair(folder), "--threshold", "otsu", "--out", out).code == 0
    pictures = sorted(path.name for path in out.iterdir())
    assert pictures.pop().endswith("-seen.png")
    assert len(pictures) == 6
    for name in pictures:
        assert cv2.imread(str(out / name)).shape == (240, 320, 3)


@pytest.mark.parametrize("name", ["a_rgb.png", "a_depth.png"])
def test_a_damaged_picture_is_refused_in_one_line(capfd, folder: Path, name: str) -> None:
    whole = (folder / name).read_bytes()
    turned = bytearray(whole)
    turned[len(whole) // 2] ^= 0x10
    _, encoded = cv2.imencode(".jpg", np.full((240, 320, 3), 90, np.uint8))
    jpeg = encoded.tobytes()[: len(encoded) // 2]
    for damaged in (whole[: len(whole) // 2], whole[:-12], bytes(turned), whole[:8] + b"x" * 50, jpeg):
        (folder / name).write_bytes(damaged)
        code = main(["see", *(str(argument) for argument in pair(folder))])
        # Of the file descriptor, for decoders write past Python, straight to the terminal.
        assert_refused(Outcome(code, *capfd.readouterr()), name, "damaged")


def test_an_unreadable_pair_is_reported_and_the_others_are_evaluated(run, folder: Path) -> None:
    for kind in ("rgb", "depth"):
        (folder / f"b_{kind}.png").write_bytes((folder / f"a_{kind}.png").read_bytes())
    (folder / "a_depth.png").write_bytes(b"no image")
    seen = run("see", folder, "--json")
    assert seen.code == 0, seen.err
    broken, whole = seen.values["frames"]
    assert (broken["name"], broken["accepted"]) == ("a", False)
    assert "a_depth.png: not an image" in broken["reason"]
    assert (whole["name"], whole.keys()) == ("b", broken.keys())
    assert "a: no heading: " in run("see", folder).out


def test_depth_alone_suffices(run, folder: Path) -> None:
    both = run("see", *pair(folder), "--json").values
    out = folder / "pictures"
    alone = run("see", folder / "a_depth.png", "--camera", folder / "camera.toml", "--out", out, "--json").values
    assert [path.name for path in out.iterdir()] == ["a_depth-seen.png"]
    # The robust method reads depth alone, so the results are equal.
    assert {**alone, "ms": 0, "name": ""} == {**both, "ms": 0, "name": ""}
    (folder / "a_rgb.png").unlink()
    (item,) = run("see", folder, "--json").values["frames"]
    # The folder's gravity.csv replaces the gravity estimated from the treads.
    assert item["heading_deg"] == pytest.approx(both["heading_deg"], abs=0.01)


def test_the_size_of_a_kinect_2_is_a_stated_guess(run, folder: Path) -> None:
    write_depth(folder / "k_depth.png", np.full((424, 512), 1500.0))
    outcome = run("see", folder / "k_depth.png")
    assert outcome.code == 1
    assert "warning: no --camera: 512×424 is the size of a Kinect 2" in outcome.out


def test_the_unit_of_depth_can_be_given(run, folder: Path) -> None:
    (folder / "camera.toml").write_text(CAMERA + "depth_unit_m = 0.00001\n")
    assert run("see", *pair(folder), "--unit", "mm").code == 0


def test_a_colour_image_of_sixteen_bits_is_colour(run, folder: Path) -> None:
    before = run("see", *pair(folder), "--method", "paper", "--json").values
    cv2.imwrite(str(folder / "a_rgb.png"), cv2.imread(str(folder / "a_rgb.png")).astype(np.uint16) * 257)
    after = run("see", *pair(folder), "--method", "paper", "--json").values
    assert {**after, "ms": 0} == {**before, "ms": 0}


def test_a_picture_that_announces_too_many_pixels_is_refused(run, folder: Path) -> None:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 2_000_000, 2_000_000, 16, 0, 0, 0, 0))
    whole = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"\0" * 100)) + chunk(b"IEND", b"")
    (folder / "a_depth.png").write_bytes(whole)
    assert_refused(run("see", *pair(folder)), "a_depth.png", "not an image that can be read")


@pytest.mark.parametrize("picture", ["a_rgb-1.png", "a_rgb-seen.png"])
def test_pictures_on_a_full_disk_are_one_line_that_names_the_file(run, no_room_for, folder: Path, picture: str) -> None:
    """Test: no room is left for a picture. Expected result: one line, exit code 2, and no part of it."""
    no_room_for(picture.removesuffix(".png"))
    assert_refused(run("see", *pair(folder), "--out", folder / "out"), str(folder / "out" / picture), "No space left on device")
    assert picture not in {path.name.removesuffix(".part") for path in (folder / "out").iterdir()}


POSE = "registered = false\nX_depth_colour = [[1, 0, 0, {x}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"


def test_colour_from_beside_the_depth_camera_is_put_on_depth(folder: Path) -> None:
    # A wall at 1.5 m, painted with a ramp: 50 mm to the side is 287.5 · 0.05 / 1.5 = 9.6 columns.
    write_depth(folder / "a_depth.png", np.full((240, 320), 1500.0))
    ramp = np.repeat(np.round(np.arange(320) * 0.75).astype(np.uint8)[None, :, None], 240, axis=0).repeat(3, axis=2)
    cv2.imwrite(str(folder / "a_rgb.png"), ramp)
    (folder / "camera.toml").write_text(CAMERA + POSE.format(x=0.05))
    frame = read_frame(folder / "a_rgb.png", folder / "a_depth.png", read_camera(folder / "camera.toml"))
    seen = frame.rgb[120, 20:300, 0].astype(float)
    # What depth sees in column u, a camera 50 mm to the right sees 9.6 columns further left.
    np.testing.assert_allclose(seen, 0.75 * (np.arange(20, 300) - 287.5 * 0.05 / 1.5), atol=1.0)


def test_a_table_of_gravity_that_is_no_text_is_refused(run, folder: Path) -> None:
    (folder / "gravity.csv").write_bytes(b"name,x,y,z\n\xff\xfe,0,1,0\n")
    assert_refused(run("see", folder), "gravity.csv", "UTF-8")


def test_a_folder_takes_a_calibration_and_gravity_from_the_command_line(run, folder: Path) -> None:
    own = run("see", folder, "--json").values["frames"][0]
    down = gravity(folder)
    (folder / "camera.toml").rename(folder / "other.toml")
    (folder / "gravity.csv").unlink()
    assert_refused(run("see", folder), "camera.toml", "no such file")
    given = run("see", folder, "--camera", folder / "other.toml", f"--gravity={down}", "--json").values["frames"][0]
    assert {**given, "ms": 0} == {**own, "ms": 0}
