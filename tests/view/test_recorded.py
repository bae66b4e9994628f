"""Recorded runs in the viewer: the same as during the run, and images with what the detector finds in them."""

import io
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from world import stair, truth

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.models import ControllerDesign
from treadline.core.rotations import rotation_of
from treadline.io.message_types import nanoseconds_of, store
from treadline.io.runs import LOG
from treadline.io.scene_messages import compressed_message
from treadline.perception.overlay import as_jpeg
from treadline.playback import Recording, read_recording
from treadline.ros.recorder import open_bag
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import resolve
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import DriveSettings, Scenario, Start
from treadline.vehicle.staircase import as_designed
from treadline.view._feed import Feed
from treadline.view._images import frames_of, pictures_of
from treadline.view._live_run import LiveRun
from treadline.view._messages import ImageOrder, Order, ShownFrame
from treadline.view._panels import PANELS, camera_html
from treadline.view._session import RunMoments, Session
from treadline.view.opening import is_recorded, open_recorded

SHORT = Scenario(start=Start(place="flight", step=4, heading_deg=6.0), drive=DriveSettings(duration_s=0.8, check=False))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "run"
    recorded_run(folder, resolve(SHORT, None, 3), image_every=1)
    return folder


@pytest.fixture(scope="module")
def live() -> Feed:
    feed = Feed.live(Order(scenario=SHORT, seed=3, speed=0.0), read_chair("wheelchair"))
    LiveRun(feed.order, lambda message: feed.take(*message) is None, list).run()
    return feed


@pytest.fixture(scope="module")
def frames(folder: Path) -> list[ShownFrame]:
    """Frames of the log with what the detector finds in them."""
    chair = read_chair("wheelchair")
    order = ImageOrder(log=str(folder / LOG), camera=chair.camera_at(240), swept_half_m=chair.swept_half_m, latency_s=0.0)
    return list(frames_of(order))


def test_a_live_run_is_the_recording_of_its_log(folder: Path, live: Feed) -> None:
    """Test: all quantities, events, moments and answers of a run and of its log. Expected: equal up to the rounding of stamps."""
    logged, run = read_recording(folder), live.recording
    for item in fields(Recording):
        if isinstance(getattr(run, item.name), np.ndarray):
            # Stamps are whole nanoseconds, and angles are converted.
            np.testing.assert_allclose(getattr(logged, item.name), getattr(run, item.name), atol=1e-9, err_msg=item.name)
    assert [span.name for span in logged.phases] == [span.name for span in run.phases]
    assert [seen.taken_s for seen in logged.maps] == pytest.approx([seen.taken_s for seen in run.maps])
    assert logged.limits == run.limits
    assert logged.outcome == run.outcome == "time_up"
    of_log, of_run, shown = RunMoments(), RunMoments(), Feed.recorded(logged, live.order)
    assert of_log.update(shown)
    assert of_run.update(live)
    assert not of_run.update(live)  # nothing is new
    assert of_run.margin == of_log.margin != ""
    assert [moment.name for moment in of_run.listed] == [moment.name for moment in of_log.listed]
    assert [answer["label"] for answer in of_run.answers] == [answer["label"] for answer in of_log.answers]
    assert "of the whole run" in str(PANELS["answers"](Session(feed=shown)))


def test_the_images_of_a_log_show_what_the_detector_saw_in_the_run(frames: list[ShownFrame], live: Feed) -> None:
    assert [frame.t_s for frame in frames] == pytest.approx([frame.t_s for frame in live.frames])
    assert [frame.reason for frame in frames] == [frame.reason for frame in live.frames]
    assert all(frame.picture is not None and frame.picture.startswith(b"\xff\xd8") for frame in frames)  # JPEG


def test_detected_planes_lie_on_the_stair(frames: list[ShownFrame], live: Feed) -> None:
    """Test: corners of the detected treads at the true pose. Expected: at heights of treads, and above true treads in plan."""
    run, heights = live.recording, np.array([step.z_m for step in as_designed(SHORT.stair).steps])
    poses = [(rotation_of(run.quat_WB[k]), run.p_WB[k]) for k in (run.index_at(frame.t_s) for frame in frames)]
    found = [frame.planes_B["treads"].reshape(-1, 3) @ R_WB.T + p_WB for frame, (R_WB, p_WB) in zip(frames, poses, strict=True)]
    corners = np.concatenate(found)
    assert len(corners) > 20
    off = np.abs(corners[:, 2:] - heights).min(axis=1)
    # The gyro's drift tilts no plane, the jitter of heights is 2 mm and the depth noise at 2 m is 1 cm.
    assert np.median(off) < 0.01


def test_targets_are_separated(folder: Path, tmp_path: Path) -> None:
    assert is_recorded(str(folder))
    assert is_recorded(str(folder / LOG))
    assert is_recorded("missing.mcap")
    assert not is_recorded("up-28")
    assert not is_recorded(str(tmp_path / "own.toml"))
    with pytest.raises(LogFormatError, match=r"missing\.mcap"):
        open_recorded("missing.mcap")


def test_a_log_without_its_folder_can_be_forked_as_the_folder(folder: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.mcap"
    bare.write_bytes((folder / LOG).read_bytes())
    whole, alone = open_recorded(str(folder)), open_recorded(str(bare))
    whole.close()
    alone.close()
    assert [session.feed.way is None for session in (whole, alone)] == [False, True]  # check.csv is a file of the folder
    assert alone.can_repeat
    orders = [session.feed.order for session in (whole, alone)]
    assert (orders[0].scenario, orders[0].seed) == (orders[1].scenario, orders[1].seed)
    assert isinstance(orders[0].controller, ControllerDesign)
    np.testing.assert_array_equal(orders[0].controller.K, orders[1].controller.K)
    of_folder, of_log = (session.run for session in (whole, alone))
    assert (of_log.scenario, of_log.seed, of_log.limits, of_log.missing) == (SHORT, 3, of_folder.limits, ())
    np.testing.assert_array_equal(of_log.p_WB, of_folder.p_WB)


COLOURS = ((250, 20, 20), (20, 250, 20), (20, 20, 250))
"""Colours of the images of a bag, 0.1 s apart."""


def write_bag(path: Path, *, compressed: bool) -> None:
    """Write 0.3 s of ground truth, a stair map and images of one colour each, stamped by a wall clock."""
    begun_s = 1.7e9
    bag = open_bag(path)
    for k in range(31):
        t_s = begun_s + 0.01 * k
        bag(truth(t_s), t_s)
        if k == 10:
            bag(stair(t_s, [(1.0, 0.0, 0.16)]), t_s)
        if k % 10 == 0 and k < 30:
            rgb = np.full((24, 32, 3), COLOURS[k // 10], dtype=np.uint8)
            if not compressed:
                bag(RgbdFrame(t_s=t_s, rgb=rgb, depth_m=np.ones((24, 32), np.float32), camera=SMALL), t_s)
                continue
            image = compressed_message("/camera/image/compressed", t_s, "camera_optical_frame", as_jpeg(rgb, 32))
            topic, kind = image.topic, image.kind
            connection = bag._connections.get(topic) or bag._writer.add_connection(topic, kind, typestore=store(ros1=False))
            bag._connections[topic] = connection
            bag._writer.write(connection, nanoseconds_of(t_s), image.encoded())
    bag.close()


SMALL = PinholeCamera(width_px=32, height_px=24, fx_px=30.0, fy_px=30.0, cx_px=15.5, cy_px=11.5)


@pytest.mark.parametrize(("name", "compressed"), [("raw.db3", False), ("raw.bag", False), ("compressed.db3", True)])
def test_the_images_of_a_bag_are_shown_at_their_time(tmp_path: Path, name: str, compressed: bool) -> None:
    """Test: images of one colour each, raw and compressed. Expected: each at its time, and one with the map."""
    path = tmp_path / name
    write_bag(path, compressed=compressed)
    session = open_recorded(str(path))
    feed = session.feed
    assert "images" in feed.workers
    order = ImageOrder(log=str(path), camera=SMALL, swept_half_m=0.4, latency_s=0.0)
    feed.close()
    for shown in pictures_of(order):
        feed.take("frame", shown, "images")
    assert [frame.t_s for frame in feed.frames] == pytest.approx([0.0, 0.1, 0.2], abs=1e-5)
    assert [frame.is_judged for frame in feed.frames] == [False, True, False]
    assert [len(frame.nosings_B) for frame in feed.frames] == [0, 1, 0]
    for frame, colour in zip(feed.frames, COLOURS, strict=True):
        with Image.open(io.BytesIO(frame.picture or b"")) as image:
            middle = np.asarray(image)[image.height // 2, image.width // 2]
        np.testing.assert_allclose(middle, colour, atol=6)  # two JPEG compressions at quality 80
    assert "image of 0.00 s" in camera_html(session)
