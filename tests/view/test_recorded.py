"""Recorded runs on a tape: the same as during the run, and images with what the detector finds in them."""

import io
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from treadline.core.errors import LogFormatError
from treadline.core.images import PinholeCamera, RgbdFrame
from treadline.core.models import ControllerDesign
from treadline.core.ports import Truth
from treadline.core.signals import StairMap
from treadline.io.cdr import nanoseconds_of
from treadline.io.runs import LOG
from treadline.io.scene_messages import compressed_message
from treadline.perception.overlay import as_jpeg
from treadline.playback.recording import in_world
from treadline.ros.bag_writer import open_bag
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import resolve
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import DriveSettings, Scenario, Start
from treadline.vehicle.staircase import as_designed
from treadline.view.images import looks_of, pictures_of
from treadline.view.moment_panel import RunMoments
from treadline.view.opening import is_recorded, open_recorded
from treadline.view.orders import ImageOrder, Order
from treadline.view.pages import answers_html, camera_html
from treadline.view.session import Feed
from treadline.view.tape import COLUMNS, NUMBER, Tape
from treadline.view.worker import LiveRun

SHORT = Scenario(start=Start(place="flight", step=4, heading_deg=6.0), drive=DriveSettings(duration_s=0.8, check=False))
LIVE_ONLY = ("brake", "force_share", "left_force_n", "right_force_n")
"""Quantities that a recording does not hold."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "run"
    recorded_run(folder, resolve(SHORT, None, 3), image_every=1)
    return folder


def image_order(folder: Path) -> ImageOrder:
    chair = read_chair("wheelchair")
    return ImageOrder(log=str(folder / LOG), camera=chair.camera_at(240), swept_half_m=chair.swept_half_m)


def live() -> Feed:
    feed = Feed(order=Order(scenario=SHORT, seed=3, speed=0.0))
    LiveRun(feed.order, lambda message: feed._take(*message) is None, list).run()
    return feed


def test_a_log_gives_the_tape_of_the_run(folder: Path) -> None:
    """Test: all columns of a run on its tape and on that of its log. Expected: equal up to the rounding of stamps and angles."""
    opened = open_recorded(str(folder))
    opened.session.close()
    tape, run = opened.session.tape, live().tape
    assert opened.can_fork
    assert len(tape) == len(run)
    for name in COLUMNS:
        if name not in LIVE_ONLY:
            # Stamps are whole nanoseconds; an estimate may count from the tick before or after it.
            late = 1e-3 if name in ("estimate_rad", "sigma_rad", "command_left_m_s", "command_right_m_s", "flipper_rad") else 1e-6
            np.testing.assert_allclose(tape.column(name)[5:], run.column(name)[5:], atol=late, err_msg=name)
    assert [span.name for span in tape.phases] == [span.name for span in run.phases]
    assert tape.limits == run.limits
    assert tape.verdict == run.verdict == "time_up"


def test_a_live_run_has_the_moments_of_its_log(folder: Path) -> None:
    """Test: moments of a run that has ended, and of its log. Expected: the same least margin and the same list."""
    opened, feed = open_recorded(str(folder)), live()
    opened.session.close()
    of_log = RunMoments(chair=opened.stage.chair, recording=opened.recording)
    of_run = RunMoments(chair=opened.stage.chair)
    assert of_log.update(opened.session.feed)
    assert of_run.update(feed)
    assert not of_run.update(feed)  # nothing is new
    assert of_run.margin == of_log.margin != ""
    names = [[moment.name for moment in found.listed] for found in (of_run, of_log)]
    assert names[0] == names[1]
    assert "of the whole run" in answers_html(of_log.answers, live=False)


def test_the_images_of_a_log_show_what_the_detector_saw_in_the_run(folder: Path) -> None:
    looks, run = list(looks_of(image_order(folder))), live()
    seen = run.tape.looks
    assert [look.t_s for look in looks] == pytest.approx([look.t_s for look in seen])
    assert [look.reason for look in looks] == [look.reason for look in seen]
    assert all(look.picture is not None and look.picture.startswith(b"\xff\xd8") for look in looks)  # JPEG


def test_detected_planes_lie_on_the_stair(folder: Path) -> None:
    """Test: corners of the detected treads at the true pose. Expected: at heights of treads, and above true treads in plan."""
    tape, staircase = live().tape, as_designed(SHORT.stair)
    heights = np.array([step.z_m for step in staircase.steps])
    found = [in_world(look.treads_B.reshape(-1, 3), *pose(tape, look.t_s)) for look in looks_of(image_order(folder))]
    corners = np.concatenate(found)
    assert len(corners) > 20
    off = np.abs(corners[:, 2:] - heights).min(axis=1)
    # The gyro's drift tilts no plane, the jitter of heights is 2 mm and the depth noise at 2 m is 1 cm.
    assert np.median(off) < 0.01


def pose(tape: Tape, t_s: float) -> tuple[np.ndarray, np.ndarray]:
    row = tape.at(t_s)
    return np.array([row[name] for name in ("x_m", "y_m", "z_m")]), np.array([row[name] for name in ("qw", "qx", "qy", "qz")])


def test_frames_replace_the_stair_maps_that_came_from_them(folder: Path) -> None:
    opened = open_recorded(str(folder))
    feed = opened.session.feed
    feed._end_images()
    maps = len(feed.tape.looks)
    for look in looks_of(image_order(folder)):
        feed._illustrate("look", look)
    assert len(feed.tape.looks) >= maps
    assert all(look.picture is not None for look in feed.tape.looks)
    assert (np.diff([look.t_s for look in feed.tape.looks]) > 0.0).all()


def test_targets_are_told_apart(folder: Path, tmp_path: Path) -> None:
    assert is_recorded(str(folder))
    assert is_recorded(str(folder / LOG))
    assert is_recorded("missing.mcap")
    assert not is_recorded("up-28")
    assert not is_recorded(str(tmp_path / "own.toml"))
    with pytest.raises(LogFormatError, match=r"missing\.mcap"):
        open_recorded("missing.mcap")
    assert NUMBER["t_s"] == 0


def test_a_log_without_its_folder_can_be_forked_as_the_folder(folder: Path, tmp_path: Path) -> None:
    bare = tmp_path / "bare.mcap"
    bare.write_bytes((folder / LOG).read_bytes())
    whole, alone = open_recorded(str(folder)), open_recorded(str(bare))
    whole.session.close()
    alone.session.close()
    assert alone.can_fork
    orders = [opened.session.feed.order for opened in (whole, alone)]
    assert (orders[0].scenario, orders[0].seed) == (orders[1].scenario, orders[1].seed)
    assert isinstance(orders[0].controller, ControllerDesign)
    np.testing.assert_array_equal(orders[0].controller.K, orders[1].controller.K)


COLOURS = ((250, 20, 20), (20, 250, 20), (20, 20, 250))
"""Colours of the images of a bag, 0.1 s apart."""


def write_bag(path: Path, *, compressed: bool) -> None:
    """Write 0.3 s of ground truth, a stair map and images of one colour each, stamped by a wall clock."""
    begun_s = 1.7e9
    bag = open_bag(path)
    for k in range(31):
        t_s = begun_s + 0.01 * k
        bag(replace(STILL, t_s=t_s), t_s)
        if k == 10:
            bag(replace(MAP, t_s=t_s), t_s)
        if k % 10 == 0 and k < 30:
            rgb = np.full((24, 32, 3), COLOURS[k // 10], dtype=np.uint8)
            if not compressed:
                bag(RgbdFrame(t_s=t_s, rgb=rgb, depth_m=np.ones((24, 32), np.float32), camera=SMALL), t_s)
                continue
            topic, kind, data = compressed_message("/camera/image/compressed", t_s, "camera", as_jpeg(rgb, 32))
            bag._connections[topic] = bag._connections.get(topic) or bag._connect(topic, kind)
            bag._writer.write(bag._connections[topic], nanoseconds_of(t_s), data)
    bag.close()


STILL = Truth(**dict.fromkeys((item.name for item in fields(Truth) if item.type in (float, "float")), 0.0))
MAP = StairMap(
    t_s=0.0,
    direction="up",
    nosings_B=np.array([[1.0, 0.0, 0.16]]),
    rise_m=0.16,
    run_m=0.3,
    slope_rad=0.5,
    ends=False,
    left_wall_m=None,
    right_wall_m=None,
    obstacle_m=None,
)
SMALL = PinholeCamera(width_px=32, height_px=24, fx_px=30.0, fy_px=30.0, cx_px=15.5, cy_px=11.5)


@pytest.mark.parametrize(("name", "compressed"), [("raw.db3", False), ("raw.bag", False), ("compressed.db3", True)])
def test_the_images_of_a_bag_are_shown_at_their_time(tmp_path: Path, name: str, compressed: bool) -> None:
    """Test: images of one colour each, raw and compressed. Expected: each at its time, and one with the map."""
    path = tmp_path / name
    write_bag(path, compressed=compressed)
    feed = open_recorded(str(path)).session.feed
    assert feed.images is not None
    order = ImageOrder(log=str(path), camera=SMALL, swept_half_m=0.4)
    feed._end_images()
    for shown in pictures_of(order):
        feed._illustrate("look", shown)
    feed.close()
    looks = feed.tape.looks
    assert [look.t_s for look in looks] == pytest.approx([0.0, 0.1, 0.2], abs=1e-5)
    assert [look.is_judged for look in looks] == [False, True, False]
    assert [len(look.nosings_B) for look in looks] == [0, 1, 0]
    for look, colour in zip(looks, COLOURS, strict=True):
        with Image.open(io.BytesIO(look.picture or b"")) as image:
            middle = np.asarray(image)[image.height // 2, image.width // 2]
        np.testing.assert_allclose(middle, colour, atol=6)  # two JPEG compressions at quality 80
    assert "image of 0.00 s" in camera_html(looks[0], [], {}, None)
