"""Recorded runs on a tape: the same as during the run, and images with what the detector finds in them."""

from pathlib import Path

import numpy as np
import pytest

from treadline.errors import LogFormatError
from treadline.experiments.recorded import recorded_run
from treadline.io.runs import LOG
from treadline.mechanics.chair import read_chair
from treadline.mechanics.staircase import as_designed
from treadline.models import ControllerDesign
from treadline.playback.recording import in_world
from treadline.scenario import DriveSettings, Scenario, Start
from treadline.setup import resolve
from treadline.viewer.images import looks_of
from treadline.viewer.opening import is_recorded, open_recorded
from treadline.viewer.orders import ImageOrder, Order
from treadline.viewer.session import Feed
from treadline.viewer.tape import COLUMNS, NUMBER, Tape
from treadline.viewer.worker import LiveRun

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
