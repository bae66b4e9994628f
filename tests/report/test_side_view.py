"""Side views and film strips: what is drawn stands where the recording has it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from treadline.playback import Recording
from treadline.report._run_page import film_strip
from treadline.report.side_view import SideViews


def test_the_chassis_is_placed_by_its_pose(recording: Recording) -> None:
    """Test: a view at 2 s. Expected: the matrix of the chassis is its pitch and its place in the plane of x and z."""
    view = SideViews(recording).view(2.0, "words & <more>")
    matrix = [float(v) for v in re.search(r'#chair-middle-chair" transform="matrix\(([^)]*)\)', view)[1].split()]
    c, s = np.cos(recording.pitch_rad[200]), np.sin(recording.pitch_rad[200])
    x, _, z = recording.p_WB[200]
    np.testing.assert_allclose(matrix, [c, s, -s, c, x, z], atol=1e-4)  # four decimals
    assert 'aria-label="words &amp; &lt;more&gt;"' in view


def test_a_strip_has_a_frame_at_each_phase_and_at_the_end(recording: Recording) -> None:
    images = [{"t": 3.1, "jpeg": "", "lines": []}]
    frames = film_strip(recording, images)["frames"]
    assert [(frame["t_s"], frame["name"]) for frame in frames] == [(0.0, "climb"), (3.0, "crest"), (5.99, "arrived")]
    assert [frame["shot"] for frame in frames] == [None, images[0], None]
    single = film_strip(replace(recording, phases=recording.phases[:1]), [])["frames"]
    assert [frame["t_s"] for frame in single] == pytest.approx([0.0, 1.4975, 2.995, 4.4925, 5.99])
