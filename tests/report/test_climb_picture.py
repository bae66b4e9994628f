"""The moving picture: the scene of the player, frame by frame."""

import numpy as np
import pytest
from climb_picture import render
from web_page import CHROMIUM

from treadline.core.errors import SettingsError
from treadline.playback import Recording
from treadline.vehicle.film_camera import SIZE_PX


def test_without_a_browser_the_error_names_the_package(recording: Recording, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(SettingsError, match="apt-get install chromium"):
        render(recording, np.array([0.0]))


@pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's chromium")
def test_each_time_gives_a_picture_of_the_moving_chair(recording: Recording) -> None:
    """Test: two frames, 4 s of climbing apart. Expected: the size asked for, many colours, and different pictures."""
    first, second = (np.asarray(image).astype(int) for image in render(recording, np.array([0.5, 4.5])))
    assert first.shape == (SIZE_PX[1], SIZE_PX[0], 3)
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 500
    assert np.abs(second - first).mean() > 2.0
