"""Panels and plots of the page, without a browser."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from page_text import PageText

from treadline.core.angles import DEG
from treadline.playback import Limits, Moment, Recording
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import Box
from treadline.vehicle.staircase import as_designed
from treadline.view._messages import Handset, Obstacle, ShownFrame, latest
from treadline.view._panels import HTML, PANELS, camera_html, legend_html, way_html
from treadline.view._plots import LIVE_PLOTS, plot_data, shown_plots, way_lines
from treadline.view._session import Fork, Session

from ..report.conftest import Transcript  # noqa: TID252 - pytest names the folders; outside of it they are no package
from .conftest import END_S, LIMITS, FakeWorker, a_run, session_of

HEADING, PITCH_RATE, _, SLIP, *_ = LIVE_PLOTS
EMPTY = Recording.of_curves(np.empty(0), read_chair("wheelchair"), scenario=Scenario())


def test_a_run_answers_for_any_instant() -> None:
    run, box = a_run(), Box(kind="obstacle", index=-1, centre_W=(1.0, 0.0, 0.2), half_m=(0.1, 0.1, 0.1), yaw_rad=0.0)
    assert [run.t_s[run.index_at(t_s)] for t_s in (-1.0, 17.503, 99.0)] == pytest.approx([0.0, 17.5, END_S])
    assert [run.phase_at(t_s).name for t_s in (19.99, 20.0)] == ["climb", "crest"]
    there = [Obstacle(t_s=5.0, box=box), Obstacle(t_s=8.0, box=None)]
    assert latest(there, 4.9) is None
    assert [latest(there, t_s).box for t_s in (5.0, 7.9, 8.0)] == [box, box, None]


# ---- plots ----


def test_a_plot_keeps_every_transient_and_shows_limits_and_cursor() -> None:
    """Test: one sample of 30 °/s among 3000. Expected: it is among the few hundred points, and all arrays have one length."""
    rate = np.zeros(3001)
    rate[1234] = 30.0 * DEG
    data = plot_data(PITCH_RATE, a_run(pitch_rate_rad_s=rate), 12.0)
    t_s, _, upper, lower, curve, cursor = data
    assert {len(column) for column in data} == {len(t_s)}
    assert len(t_s) < 600
    assert curve.max() == pytest.approx(30.0)
    assert (upper[0], lower[0]) == (25.0, -25.0)  # the guard's limit, row 18 of the hazards
    assert (np.diff(t_s) >= 0.0).all()
    assert t_s[np.argmax(cursor)] == pytest.approx(12.0)
    assert all(np.isfinite(column).all() for column in data)


def test_a_plot_of_quantities_that_are_not_known_yet_is_finite() -> None:
    unknown = a_run(estimate_rad=math.nan, slip=math.nan, seat_pitch_rad=math.nan)
    for plot in shown_plots(unknown):  # all: a run in progress knows its estimate later
        data = plot_data(plot, unknown, 3.0)
        assert len(data) == len(plot.curves) + len(plot.limits(LIMITS)) + 3
        assert all(np.isfinite(column).all() for column in data)


def test_the_curve_of_a_fork_is_its_own_up_to_its_end() -> None:
    data = plot_data(HEADING, a_run(), 1.0, a_run(heading_rad=5.0 * DEG))
    assert data[1][10] == pytest.approx(5.0)
    assert data[-2][10] == pytest.approx(0.0)  # the estimate of the run


def test_a_limit_far_from_the_signal_is_named_but_does_not_flatten_it() -> None:
    """Test: a pitch rate of 1 °/s and a limit of 25 °/s; then one of 20 °/s. Expected: drawn only in the second plot."""
    slow, fast = (a_run(pitch_rate_rad_s=rate * DEG * np.sin(np.arange(3001))) for rate in (1.0, 20.0))
    assert max(column.max() for column in plot_data(PITCH_RATE, slow, 1.0)[1:]) < 3.0
    assert max(column.max() for column in plot_data(PITCH_RATE, fast, 1.0)[1:]) == pytest.approx(25.0)
    assert "guard's limit ±25 °/s (beyond this plot)" in legend_html(PITCH_RATE, slow, 1.0, forked=False)
    assert "beyond" not in legend_html(PITCH_RATE, fast, 1.0, forked=False)


def test_plots_draw_the_limits_of_the_run_and_none_that_it_does_not_state() -> None:
    assert [plot.limits(Limits(margin_rad=None)) for plot in LIVE_PLOTS] == [(), (), (), (), (), (0.0,)]
    assert SLIP.limits(LIMITS) == (0.3,)
    assert "limit" not in legend_html(PITCH_RATE, replace(a_run(), limits=Limits()), 1.0, forked=False)


def test_a_limit_is_drawn_in_the_phases_in_which_it_applies() -> None:
    """Test: the heading limit of a chair on the crest from 20 s on. Expected: drawn there, and hidden by the curve before."""
    t_s, _, upper, *_ = plot_data(HEADING, a_run(heading_rad=4.0 * DEG), 1.0)
    np.testing.assert_allclose(upper, np.where(t_s < 20.0, 4.0, 5.0))


# ---- panels ----


def frame(nosings_B: Any, **more: Any) -> ShownFrame:
    """Return a frame of the instant 0 s, taken at 0.06 s."""
    return ShownFrame(t_s=0.0, taken_s=0.06, summary="<b>", heading_rad=0.0, nosings_B=np.asarray(nosings_B), **more)


def before_the_flight(shown: ShownFrame, x_m: float = -1.5) -> Session:
    """Return a session of a chair that stands on the floor before a flight, with one frame."""
    run = replace(a_run(), p_WB=np.tile([x_m, 0.0, 0.0], (3001, 1)))
    session = session_of(run, 0.1)
    session.feed.frames.append(shown)
    return session


def held_and_forked() -> Session:
    """Return a run that is held, with its least margin at 9 s and a fork at 2 s."""
    margin = np.full(3001, 20.0 * DEG)
    margin[900] = 4.0 * DEG
    session = session_of(a_run(margin_rad=margin, belt_travel_m=np.full((3001, 2), [1.0, 2.0])), 13.0)
    session.moments.update(session.feed)
    session.ghost = Fork(feed=session.feed, from_s=2.0, name="none", began_at=0.0)
    return session


def by_hand() -> Session:
    session = session_of(a_run(), 21.0, live=True, attended=True)
    session.handset = Handset(manual=True, dead_man=False, speed_m_s=0.1)
    return session


def seen(x_m: float = -1.5, depth_m: float | None = None, found: slice = slice(0), **more: Any) -> Session:
    """Return a chair on the floor that perceives some of the two nosings in its image; one depth in every pixel, if any."""
    image = {} if depth_m is None else {"depth_m": np.full((60, 80), depth_m, dtype=np.float32)}
    nosings_B = as_designed(Scenario().stair).nosings_W[:2] - np.array([-1.5, 0.0, 0.0])
    return before_the_flight(frame(nosings_B[found], **image, **more), x_m)


def silent_since(seconds: float, *listed: Moment) -> Session:
    """Return a session whose last frame was taken so long ago, at 0.06 s; with the moments of a log, if any."""
    session = before_the_flight(frame(np.ones((2, 3))))
    session.cursor_s, session.moments.listed = 0.06 + seconds, listed
    return session


def without_truth() -> Session:
    session = seen(found=slice(1, 2))
    session.feed.recording.heading_rad[:] = math.nan
    return session


def with_forces(session: Session, **workers: Any) -> Session:
    """Return a session in which a person has asked for contact forces."""
    session.shows["contacts"] = True
    session.feed.workers |= workers
    return session


UNSEEN = Moment(t_s=0.0, name="no stair perceived", cause="9 frames, none with a stair", kind="perception", end_s=5.0)
SILENT = Moment(t_s=2.0, name="no camera frame", cause="from 2.00 s to 3.00 s", kind="perception", end_s=3.0)
STATES = {
    "a run that has not begun": lambda: session_of(EMPTY, live=True, attended=True),
    "held, and forked": held_and_forked,
    "re-armed": lambda: session_of(a_run(), 16.0, live=True),
    "driven by hand": by_hand,
    "one nosing missed": lambda: seen(found=slice(1, 2)),
    "a rejected frame that shows both": lambda: seen(found=slice(2), reason="too dark"),
    "a rejected frame that shows none": lambda: seen(reason="too dark"),
    "no depth": lambda: seen(depth_m=math.nan),
    "something in between": lambda: seen(depth_m=0.4),
    "depth beyond the nosing": lambda: seen(depth_m=9.0),
    "a riser outside of the image": lambda: seen(-0.8, 9.0),
    "a frame of 0.30 s ago": lambda: silent_since(0.30),
    "no frame for 0.32 s": lambda: silent_since(0.32),
    "frames without a stair, which are no silence": lambda: silent_since(1.44, UNSEEN),
    "a silent camera, in a log of moments": lambda: silent_since(2.44, UNSEEN, SILENT),
    "nosings of a stair that nobody knows": without_truth,
    "contact forces, which a repetition will compute": lambda: with_forces(session_of(a_run())),
    "contact forces, which a repetition computes": lambda: with_forces(session_of(a_run()), repeat=FakeWorker()),
    "contact forces of a log": lambda: with_forces(replace(session_of(a_run()), can_repeat=False)),
}
GOLDEN = Transcript(Path(__file__).with_name("panels.txt"))
"""Panels as text; ``TREADLINE_ACCEPT=1 pytest tests/view/test_panels.py`` writes them anew."""


@pytest.mark.parametrize("title", STATES)
def test_panels_show_what_their_golden_file_says(title: str) -> None:
    """Test: a state of the page, whose log says ``<stop>`` and ``<b>``. Expected: its panels; of a frame, the camera's alone."""
    session = STATES[title]()
    shown = {"camera": camera_html} if session.feed.frames else {"timeline": HTML.timeline} | PANELS
    GOLDEN.check(title, [line for name, panel in shown.items() for line in (f"# {name}", *PageText(panel(session)).lines)])


def test_without_ground_truth_what_was_measured_is_plotted_alone() -> None:
    known = shown_plots(a_run(heading_rad=math.nan, slip=math.nan, margin_rad=math.nan, pitch_rate_rad_s=0.1))
    # Heading, pitch rate, belt speed and seat pitch; neither slip nor tip-over margin.
    assert [plot.curves[0].label for plot in known] == ["estimate ± 2 σ", "measured", "left asked", "measured"]


def test_the_way_has_the_values_of_the_walk_and_what_was_driven_up_to_a_marker_that_moves() -> None:
    """Test: a chair that drives at 0.1 m/s along a walk of 4 m. Expected: the marker passes a quarter of it in 10 s."""
    ground, x_m = np.array([[-9.0, 0.0, 0.0], [9.0, 0.0, 0.0]]), np.linspace(0.0, 4.0, 50)
    walk = {"x_m": x_m, "pitch_deg": 3.0 * x_m, "flipper_deg": 9.0 - x_m, "torque_n_m": x_m**2, "z_m": x_m}
    session = session_of(a_run(pitch_rad=3.0 * DEG, flipper_rad=0.1, flipper_n_m=5.0), 10.0)
    assert way_html(session) == ""
    session.feed.way = ground, walk
    lines, run = way_lines(session.feed.way, session.run, session.cursor_s), session.run
    assert all(np.array_equal(lines[name][0], np.column_stack([x_m, walk[name]])) for name in list(lines)[1:])
    assert [lines[name][1][-1].tolist() for name in lines] == [[pytest.approx(1.0), run.columns[name][1000]] for name in lines]
    assert '"M250.0 ' in way_html(session)
    session.cursor_s = 20.0
    assert '"M500.0 ' in way_html(session)
