"""Tape, plots, texts and session of the viewer, without a browser."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.signals import Event
from treadline.playback import Limits
from treadline.playback.findings import Moment
from treadline.playback.recording import slip_ratio
from treadline.scenario.chair import read_chair
from treadline.scenario.faults import Fault
from treadline.scenario.scenario import Scenario, Stair
from treadline.vehicle.staircase import as_designed
from treadline.view.nosing_lines import SeenNosings
from treadline.view.orders import Handset, Order, Worker
from treadline.view.pages import (
    GREEN,
    ORANGE,
    PHASE_COLOURS,
    RED,
    camera_html,
    camera_warning,
    events_html,
    handset_html,
    state_html,
    text_on,
    timeline_html,
    transitions_html,
)
from treadline.view.plot_panels import legend_html, plot_data, plot_specs
from treadline.view.session import PAUSE, SILENT_S, Feed, Session
from treadline.view.support import support_of
from treadline.view.tape import COLUMNS, DEPTH_STEP, NUMBER, Look, Obstacle, Tape

END_S = 30.0
LIMITS = Limits(pitch_rate_rad_s=25.0 * DEG, heading_rad=5.0 * DEG, cruise_m_s=0.3, slip=0.3, seat_rad=5.0 * DEG)


def tape(**columns: Any) -> Tape:
    """Return thirty seconds of a chair that drives forwards at 0.1 m/s; columns by name."""
    t_s = 0.01 * np.arange(round(END_S / 0.01) + 1)
    rows = np.zeros((len(t_s), len(COLUMNS)))
    rows[:, NUMBER["t_s"]], rows[:, NUMBER["x_m"]], rows[:, NUMBER["qw"]] = t_s, 0.1 * t_s, 1.0
    rows[:, NUMBER["margin_rad"]] = 20.0 * DEG
    for name, values in columns.items():
        rows[:, NUMBER[name]] = values
    made = Tape(
        events=[
            Event(t_s=0.0, name="climb", cause="start"),
            Event(t_s=12.0, name="hold", cause="operator <stop>"),
            Event(t_s=15.0, name="rearmed", cause="by a person"),
            Event(t_s=20.0, name="crest", cause="end of the flight"),
        ],
    )
    for part in np.array_split(rows, 7):
        made.append(part)
    return made


def test_a_tape_grows_in_parts_and_answers_for_any_instant() -> None:
    made = tape()
    assert len(made) == 3001
    assert made.at(17.503)["t_s"] == pytest.approx(17.50)
    assert made.at(-1.0)["t_s"] == 0.0
    assert made.at(99.0)["t_s"] == pytest.approx(END_S)
    assert made.phase_at(19.99).name == "climb"
    assert made.phase_at(20.0).name == "crest"
    assert [made.holding_at(t_s) is not None for t_s in (11.9, 12.0, 14.9, 15.0)] == [False, True, True, False]


def test_an_obstacle_is_there_from_its_time_until_it_is_removed() -> None:
    made = tape()
    made.obstacles += [Obstacle(t_s=5.0, centre_W=(1.0, 0.0, 0.2)), Obstacle(t_s=8.0, centre_W=None)]
    assert [made.obstacle_at(t_s) is not None for t_s in (4.9, 5.0, 7.9, 8.0)] == [False, True, True, False]


def test_a_plot_keeps_every_transient_and_shows_limits_and_cursor() -> None:
    """Test: one sample of 30 °/s among 3000. Expected: it is among the few hundred points, and all arrays have one length."""
    rate = np.zeros(3001)
    rate[1234] = 30.0 * DEG
    spec = plot_specs(LIMITS)[1]
    data = plot_data(spec, tape(pitch_rate_rad_s=rate), 12.0)
    t_s, _, upper, lower, curve, cursor = data
    assert {len(column) for column in data} == {len(t_s)}
    assert len(t_s) < 600
    assert curve.max() == pytest.approx(30.0)
    assert (upper[0], lower[0]) == (25.0, -25.0)  # the guard's limit, row 18 of the hazards
    assert (np.diff(t_s) >= 0.0).all()
    assert t_s[np.argmax(cursor)] == pytest.approx(12.0)
    assert all(np.isfinite(column).all() for column in data)


def test_a_plot_of_an_empty_tape_or_of_unknown_quantities_is_finite() -> None:
    for spec in plot_specs(LIMITS):
        for made in (Tape(), tape(estimate_rad=math.nan, slip=math.nan, seat_pitch_rad=math.nan)):
            data = plot_data(spec, made, 3.0)
            assert len(data) == len(spec.curves) + len(spec.limits) + 3
            assert all(np.isfinite(column).all() for column in data)


def test_the_curve_of_a_fork_is_its_own_up_to_its_end() -> None:
    fork = tape(heading_rad=5.0 * DEG)
    data = plot_data(plot_specs(LIMITS)[0], tape(), 1.0, fork)
    assert data[1][10] == pytest.approx(5.0)
    assert data[-2][10] == pytest.approx(0.0)  # the estimate of the run


def test_the_texts_name_hold_phase_and_least_margin_and_escape_what_a_log_says() -> None:
    margin = np.full(3001, 20.0 * DEG)
    margin[900] = 4.0 * DEG
    made = tape(margin_rad=margin)
    state = state_html(made, 13.0, live=False, title="run")
    assert "HOLD since 12.00 s" in state
    assert "operator &lt;stop&gt;" in state
    assert "of the whole run" in state
    assert "4.0° at 9.00 s" in state
    assert "HOLD" not in state_html(made, 16.0, live=True, title="run")
    assert "end of the flight" in transitions_html(made, 25.0)
    assert "hold" in events_html(made, 13.0)
    assert "rearmed" not in events_html(made, 13.0)
    assert timeline_html(made, 13.0, 2.0).count("position:absolute") == 6  # two phases, hold, re-arm, fork, cursor


def test_a_limit_far_from_the_signal_is_named_but_does_not_flatten_it() -> None:
    """Test: a pitch rate of 1 °/s and a limit of 25 °/s; then one of 20 °/s. Expected: drawn only in the second plot."""
    spec = plot_specs(LIMITS)[1]
    slow, fast = (tape(pitch_rate_rad_s=rate * DEG * np.sin(np.arange(3001))) for rate in (1.0, 20.0))
    assert max(column.max() for column in plot_data(spec, slow, 1.0)[1:]) < 3.0
    assert max(column.max() for column in plot_data(spec, fast, 1.0)[1:]) == pytest.approx(25.0)
    assert "guard's limit ±25° (beyond this plot)" in legend_html(spec, slow, 1.0, forked=False)
    assert "beyond" not in legend_html(spec, fast, 1.0, forked=False)


def test_a_silent_camera_is_a_warning_and_shows_no_nosings() -> None:
    """Test: the last frame at 0.06 s. Expected: fresh to 0.36 s, then a warning instead of "accepted" and "none missed"."""
    made = tape()
    made.looks.append(look(np.ones((2, 3))))
    assert camera_warning(made, 0.36, ()) is None
    assert made.fresh_look_at(0.36) is not None
    assert made.fresh_look_at(0.38) is None
    warning = camera_warning(made, 20.76, ())
    assert warning == "no frame for 20.7 s, since 0.06 s: the camera is silent"
    page = camera_html(made.looks[0], (1,), {}, warning)
    assert "none missed" not in page
    assert "last frame of 0.00 s" in page


def test_a_log_names_a_stair_that_was_not_perceived_and_a_silent_camera() -> None:
    """Test: a log of stair maps alone, with its moments. Expected: frames without a stair are no silence of the camera."""
    made = tape()
    made.looks.append(look(np.ones((2, 3))))
    unseen = Moment(t_s=0.0, name="no stair perceived", cause="9 frames, none with a stair", kind="perception", end_s=5.0)
    silent = Moment(t_s=2.0, name="no camera frame", cause="from 2.00 s to 3.00 s", kind="perception", end_s=3.0)
    assert camera_warning(made, 1.5, (unseen,)) == "no stair perceived for 1.5 s; 9 frames, none with a stair"
    assert camera_warning(made, 2.5, (unseen, silent)) == "no frame for 0.5 s, since 2.00 s: the camera is silent"
    listed = events_html(made, 2.5, (unseen, silent))
    assert "no camera frame" in listed
    assert 'data-jump="2.000"' in listed


@pytest.mark.parametrize("colour", [*PHASE_COLOURS.values(), ORANGE, GREEN, RED])
def test_text_on_every_colour_can_be_read(colour: str) -> None:
    """Test: contrast by WCAG 2.2. Expected: at least 4.5:1, as it asks for small text."""

    def luminance(code: str) -> float:
        digits = code[1:] if len(code) == 7 else "".join(2 * letter for letter in code[1:])
        parts = [int(digits[k : k + 2], 16) / 255.0 for k in (0, 2, 4)]
        return float(np.dot([0.2126, 0.7152, 0.0722], [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]))

    dark, light = sorted((luminance(colour), luminance(text_on(colour))))
    assert (light + 0.05) / (dark + 0.05) >= 4.5


def test_the_name_of_a_phase_is_shown_whole_or_not_at_all() -> None:
    made = tape()
    made.events.append(Event(t_s=29.5, name="traction", cause="on two nosings"))
    drawn = timeline_html(made, 1.0)
    assert "&nbsp;climb</div>" in drawn
    assert "&nbsp;</div>" in drawn


def look(nosings_B: np.ndarray, reason: str | None = None) -> Look:
    return Look(
        t_s=0.0, taken_s=0.06, reason=reason, heading_rad=0.0, sigma_rad=0.01, edge_count=3, nosings_B=nosings_B, summary="<b>"
    )


def test_a_missed_nosing_is_named() -> None:
    """Test: the chair on the floor before a flight; two nosings in the image, the map lacks the first. Expected: missed."""
    staircase, chair = as_designed(Stair(steps=8)), read_chair("wheelchair")
    row = dict.fromkeys(COLUMNS, 0.0) | {"qw": 1.0, "x_m": -1.5}
    places = staircase.nosings_W[:2] - np.array([-1.5, 0.0, 0.0])
    nosings = SeenNosings(staircase, chair.camera_at(240))
    seen, missed = nosings.judge(look(places[1:]), row)
    assert seen == (2,)
    assert missed == (1,)
    seen_lines, missed_lines = nosings.lines(look(places[1:]), row)
    assert (len(seen_lines), len(missed_lines)) == (1, 1)
    assert "missed: 1 (dark)" in camera_html(look(places), seen, dict.fromkeys(missed, "dark"), None)
    assert "&lt;b&gt;" in camera_html(look(places), seen, {}, None)
    assert "rejected, too dark" in camera_html(look(places, "too dark"), [], {}, None)


@pytest.mark.parametrize(
    ("x_m", "depth_m", "reason"),
    [
        (-1.5, math.nan, "no depth at 100 % of its pixels"),
        (-1.5, 0.4, "hidden by something"),
        (-1.5, 9.0, "depth at 100 % of its pixels"),
        (-0.8, 9.0, "its riser is not in the image"),
    ],
)
def test_a_missed_nosing_has_a_reason_by_its_depth(x_m: float, depth_m: float, reason: str) -> None:
    """Test: the chair on the floor before a flight, one depth in the whole image. Expected: the cause that this depth means."""
    staircase, chair = as_designed(Stair(steps=8)), read_chair("wheelchair")
    camera = chair.camera_at(240)
    nosings = SeenNosings(staircase, camera)
    row = dict.fromkeys(COLUMNS, 0.0) | {"qw": 1.0, "x_m": x_m}
    image = np.full((camera.height_px // DEPTH_STEP, camera.width_px // DEPTH_STEP), depth_m, dtype=np.float32)
    blind = replace(look(np.zeros((0, 3))), depth_m=image)
    _, missed = nosings.judge(blind, row)
    assert 1 in missed
    assert reason in nosings.why_missed(1, blind, row)
    assert nosings.why_missed(1, replace(blind, reason="too dark"), row) == "the frame is rejected"


def test_nosings_missed_for_one_reason_are_named_together() -> None:
    page = camera_html(look(np.zeros((0, 3))), [1], {2: "no depth", 3: "no depth", 5: "hidden"}, None)
    assert "missed: 2, 3 (no depth); 5 (hidden)" in page


def test_the_support_is_the_flat_run_on_a_floor_and_less_over_an_edge() -> None:
    staircase, chair = as_designed(Stair(steps=8)), read_chair("wheelchair")
    half = 0.5 * chair.tracks.flat_run_m
    on_floor = support_of(chair, staircase, np.eye(3), np.array([-2.0, 0.0, 0.0]))
    assert on_floor is not None
    assert on_floor[:2] == (pytest.approx(half), pytest.approx(half))
    top = staircase.steps[-1]
    over_edge = support_of(chair, staircase, np.eye(3), np.array([top.x_m, 0.0, top.z_m]))
    assert over_edge is not None
    assert over_edge[0] == pytest.approx(half)
    assert over_edge[1] < 0.021  # the landing begins under mid-track; points are 2 cm apart
    assert support_of(chair, staircase, np.eye(3), np.array([-2.0, 0.0, 0.5])) is None


@pytest.mark.parametrize(("gap_m", "is_supported"), [(0.014, True), (0.016, False)])
def test_the_support_reaches_as_far_as_that_of_the_tip_over_margin(gap_m: float, *, is_supported: bool) -> None:
    """Test: a chair above the floor. Expected: support up to the 15 mm of the instruments' tip-over margin."""
    staircase, chair = as_designed(Stair(steps=8)), read_chair("wheelchair")
    assert (support_of(chair, staircase, np.eye(3), np.array([-2.0, 0.0, gap_m])) is not None) == is_supported


def test_the_slip_ratio_is_zero_when_the_chair_follows_its_belts_and_one_when_it_stands() -> None:
    t_s = 0.01 * np.arange(200)
    belts_m, level = 0.2 * t_s, np.tile([1.0, 0.0, 0.0, 0.0], (200, 1))
    place = np.column_stack([belts_m, np.zeros(200), np.zeros(200)])
    # The belts move by 1 cm in half a second from 0.05 s on; before, no slip ratio is given.
    np.testing.assert_allclose(slip_ratio(t_s, place, level, belts_m)[10:], 0.0, atol=1e-9)
    np.testing.assert_allclose(slip_ratio(t_s, 0.0 * place, level, belts_m)[10:], 1.0)
    assert np.isnan(slip_ratio(t_s, place, level, 0.0 * belts_m)).all()


def test_the_slip_ratio_of_a_tape_does_not_depend_on_how_it_grows() -> None:
    whole, parts = (tape(left_travel_m=0.1 * np.arange(3001) ** 0.5) for _ in range(2))
    again = Tape()
    again.append(whole.rows)
    assert again.rows.tobytes() == parts.rows.tobytes()
    assert np.isfinite(parts.column("slip")).any()


def test_plots_draw_the_limits_of_the_run_and_none_that_it_does_not_state() -> None:
    assert [spec.limits for spec in plot_specs(Limits(margin_rad=None))] == [(), (), (), (), (), (0.0,)]
    assert plot_specs(LIMITS)[3].limits == (0.3,)
    assert "limit" not in legend_html(plot_specs(Limits())[1], tape(), 1.0, forked=False)


class FakeWorker(Worker):
    """Worker without a process that keeps its commands."""

    def __init__(self) -> None:
        self.sent: list[tuple[str, Any]] = []

    @property
    def is_alive(self) -> bool:
        return True

    def receive(self) -> list[Any]:
        return []

    def send(self, kind: str, value: Any = None) -> None:
        self.sent.append((kind, value))

    def close(self) -> None:
        pass


@pytest.fixture
def live() -> Session:
    feed = Feed(order=Order(scenario=Scenario(), seed=0), tape=tape(), worker=FakeWorker())
    return Session(feed=feed, attended=True)


def test_a_recorded_session_plays_pauses_steps_and_seeks() -> None:
    session = Session(feed=Feed(order=Order(scenario=Scenario(), seed=0), tape=tape()), playing=False, following=False)
    session.advance(1.0)
    assert session.cursor_s == 0.0
    session.play()
    session.set_speed(5.0)
    session.advance(1.0)
    assert session.cursor_s == pytest.approx(5.0)
    session.press_transport("+0.01 s")
    assert (session.playing, session.cursor_s) == (False, pytest.approx(5.01))
    session.press_transport("−0.01 s")
    session.seek(99.0)
    assert session.cursor_s == pytest.approx(END_S)
    session.play()
    session.advance(0.1)
    assert session.cursor_s == pytest.approx(0.5)  # play at the end begins anew
    session.act(Fault(kind="imu_lost"))  # nothing to act on: ignored


def test_pause_step_and_speed_act_on_an_attended_simulation(live: Session) -> None:
    live.advance(0.1)
    assert live.cursor_s == pytest.approx(END_S)
    live.play(playing=False)
    live.step(1)
    live.play(playing=True)
    live.set_speed(2.0)
    assert live.feed.worker.sent == [("speed", PAUSE), ("step", 1), ("speed", 1.0), ("speed", 2.0)]


def test_a_session_that_only_views_passes_no_command_on(live: Session) -> None:
    live.attended = False
    live.play(playing=False)
    live.press("stop")
    live.act(Fault(kind="imu_lost"))
    live.set_manual(manual=True)
    live.report(dead_man=True, ahead=1.0, turn=0.0)
    assert live.feed.worker.sent == []


def test_a_silent_handset_counts_as_released(live: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("treadline.view.session.time.monotonic", lambda: clock[0])
    live.set_manual(manual=True)
    live.report(dead_man=True, ahead=2.0, turn=-0.5)
    driving = live.feed.worker.sent[-1][1]
    assert driving == Handset(manual=True, speed_m_s=0.10, turn_m_s=-0.04)
    clock[0] += SILENT_S + 0.01
    live.advance(0.0)
    assert live.feed.worker.sent[-1][1] == Handset(manual=True, dead_man=False)


def test_a_pressed_button_is_released_by_itself(live: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [100.0]
    monkeypatch.setattr("treadline.view.session.time.monotonic", lambda: clock[0])
    live.press("stop")
    clock[0] += 1.0
    live.advance(0.0)
    assert [command.stop for _, command in live.feed.worker.sent] == [True, False]


def test_the_handset_shows_its_switch_and_the_travel_of_the_belts() -> None:
    made = tape(left_travel_m=1.0, right_travel_m=2.0)
    assert "the planner drives; belts travelled 1.50 m" in handset_html(Handset(), made, 3.0)
    driven = handset_html(Handset(manual=True, dead_man=False, speed_m_s=0.1), made, 3.0)
    assert "<b>released</b>; speed +0.10 m/s" in driven
    assert "belts travelled 0.00 m" in handset_html(Handset(), Tape(), 0.0)
