"""The player: its numbers are the recording's, and it opens and plays in a browser without a request."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from page_text import unpacked

from treadline.guard._guard_config import FLIGHT
from treadline.playback import PhaseSpan, Recording, findings_of
from treadline.report._player_data import scene_of, uniform
from treadline.report.answers import moments_of
from treadline.report.html_pages import packed
from treadline.report.player_page import write_player
from treadline.report.plot_table import PLOTS
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.vehicle.appearance import body_poses, chair_parts

from .conftest import PlayerPage, climbing
from .pages import held

# Literals, so that a changed value in the code is detected here.
MOST_SAMPLES = 40000

MOST_BYTES = 5_000_000
"""Largest page of a traversal of 50 s (issue's bound)."""


@given(st.lists(st.floats(-100.0, 100.0) | st.just(float("nan")), min_size=1, max_size=30))
def test_packed_numbers_come_back_within_half_a_step(values: list[float]) -> None:
    table = np.array(values)[:, None]
    back = unpacked(packed(table))
    known = table[np.isfinite(table)]
    step = (known.max() - known.min()) / 65534 if known.size else 0.0
    np.testing.assert_array_equal(np.isnan(back), np.isnan(table))
    # Half a step, and the rounding of the product.
    np.testing.assert_allclose(back[np.isfinite(back)], known, atol=0.5 * step * (1 + 1e-6) + 1e-12)


def test_the_tables_of_moving_bodies_are_their_poses(recording: Recording) -> None:
    """Test: seat and flipper tables at their ends. Expected: the poses of the appearance, within the 16-bit step."""
    scene = scene_of(recording)
    chair = read_chair("wheelchair")
    for joint, names in (("seat", ("seat", "bar", "slider")), ("flipper", ("flipper",))):
        table = scene["bodies"][joint]
        for k, angle in ((0, table["low"]), (-1, table["high"])):
            poses = body_poses(chair, Chair(), angle if joint == "seat" else 0.0, angle if joint == "flipper" else None)
            for name in names:
                x, y, z, turn = unpacked(table["poses"][name])[k]
                np.testing.assert_allclose(poses[name][:3, 3], (x, y, z), atol=1e-4)
                np.testing.assert_allclose(poses[name][0, :3], (np.cos(turn), 0.0, np.sin(turn)), atol=1e-4)
    assert {part["body"] for part in scene["parts"]} >= {part.body for part in chair_parts(chair, Chair())}


def test_a_long_run_is_decimated_and_gaps_of_a_bag_get_equal_steps(recording: Recording) -> None:
    long = replace(recording.sampled(np.arange(600).repeat(150), 0.01 * np.arange(90_000)))
    kept = uniform(long)
    assert len(kept.t_s) <= MOST_SAMPLES
    assert kept.duration_s == pytest.approx(long.duration_s, abs=0.03)
    gap = recording.sampled(np.r_[0:200, 400:600], np.r_[recording.t_s[:200], recording.t_s[400:600]])
    assert np.ptp(np.diff(uniform(gap).t_s)) < 1e-9
    assert len(uniform(gap).t_s) == 600


def test_heading_errors_are_judged_on_flights_and_not_in_turns(recording: Recording) -> None:
    """Test: the true heading is that of another flight, by 180°, during a turn. Expected: the estimate is 0.2° off at most."""
    spans = [PhaseSpan(start_s=k, end_s=k + 1.0, name=name, cause="") for k, name in enumerate(("climb", "turn", "climb"))]
    turns = (recording.t_s >= 1.0) & (recording.t_s < 2.0)
    turned = replace(recording, phases=tuple(spans), heading_rad=recording.heading_rad + np.where(turns, np.pi, 0.0))
    assert moments_of(turned, findings_of(turned))[-1]["label"].startswith("largest heading error of the estimate 0.2°")


def test_the_limit_of_the_slip_is_drawn_where_the_guard_judges_slip() -> None:
    assert [plot.limit.phases for plot in PLOTS if plot.title == "slip"] == [FLIGHT]


def test_the_page_is_small(tmp_path: Path) -> None:
    """Test: 50 s at 100 Hz, perceived ten times a second. Expected: within 5 MB."""
    assert write_player(climbing(seconds=50.0), tmp_path / "run.html").stat().st_size < MOST_BYTES


# ---- in the browser ----


@pytest.fixture(scope="module")
def page(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_player(recording, tmp_path_factory.mktemp("player") / "run.html")


@pytest.mark.parametrize(("width_px", "dark"), [(1280, False), (390, True)])
def test_the_page_draws_plays_and_requests_nothing(browser: PlayerPage, page: Path, width_px: int, dark: bool) -> None:
    browser.open(page, width_px=width_px, dark=dark)
    first = browser.pixels("#scene")
    # A drawn scene has many colours; an empty canvas has one.
    assert len(np.unique(first.reshape(-1, 3), axis=0)) > 500
    assert first.std() > 15.0
    assert (first[0, 0] < 80).all() == dark
    browser.run("document.getElementById('play').click()")
    browser.until(lambda: browser.run("return player.t >= 0.5"), "half a second of playing")
    browser.run("document.getElementById('play').click()")
    assert np.abs(browser.pixels("#scene") - first).mean() > 0.5
    assert browser.run("return document.documentElement.scrollWidth <= window.innerWidth")
    assert browser.errors() == []
    assert [
        url for url in browser.requests() if not url.startswith(("file:", "data:", "chrome"))
    ] == []  # of the page, and the browser's start


def test_events_slider_and_keys_move_the_clock_and_the_readings(browser: PlayerPage, page: Path) -> None:
    browser.open(page)
    browser.run("document.querySelectorAll('#events button')[1].click()")
    assert browser.run("return player.t") == 3.0
    settled = "return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(%s))))"
    assert browser.run(settled % "document.getElementById('phase').textContent") == "crest"
    assert browser.run("return document.getElementById('why').textContent") == "because end of the flight in view"
    assert "missed: 6" in browser.run("return document.getElementById('sees').textContent")
    for key, t_s in (("ArrowRight", 3.5), (".", 3.51), ("PageUp", 3.0), ("Home", 0.0), ("End", 5.99)):
        browser.run(f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}'}}))")
        assert browser.run("return player.t") == pytest.approx(t_s, abs=1e-6)
    browser.run("const s = document.getElementById('slider'); s.value = 1.57; s.dispatchEvent(new Event('input'))")
    # The reading under the cursor is the margin of the recording at that time: 8.0°.
    assert browser.run(settled % "document.querySelector('.panel:nth-child(6) .key b').textContent").strip() == "8.00"


def test_the_belts_move_with_their_travel(browser: PlayerPage, page: Path) -> None:
    """Test: the same view with the chair held and its belts 20 mm further. Expected: a different picture, at the belts alone."""
    browser.open(page)
    drawn = "scene.view.target = [0.7, 0, 0.9]; scene.draw({{...stateAt(1), travel: [{0}, {0}]}}, [])"
    browser.run(drawn.format(0.0))
    still = browser.pixels("#scene")
    browser.run(drawn.format(0.02))
    changed = np.abs(browser.pixels("#scene") - still).max(axis=2) > 10
    assert 50 < changed.sum() < 0.2 * changed.size


def test_the_state_line_says_hold_with_its_cause_and_what_led_to_it(browser: PlayerPage, tmp_path: Path) -> None:
    browser.open(write_player(held(), tmp_path / "held.html"), width_px=390)
    shown = "seek(%s); refresh(); return ['phase', 'why', 'chain'].map((id) => document.getElementById(id).textContent)"
    phase, why, chain = browser.run(shown % 3.5)
    assert phase == "HOLD"
    assert "rolled back 0.26 m as the guard measured it" in why
    assert chain.startswith("fault at 2.00 s (low friction injected")
    assert "slip at 2.00 s" in chain
    assert browser.run(shown % 2.5)[0] == "climb"
    assert browser.run(shown % 4.5)[0] == "crest"
    # The strip of phases and the axis of time carry the marks; the text of a phase never exceeds its button.
    assert browser.run("return document.querySelectorAll('#phases .hold, #marks .hold').length") == 2
    fits = "return [...document.querySelectorAll('#phases button')].every((b) => b.scrollWidth <= b.clientWidth + 1)"
    assert browser.run(fits)


def test_space_plays_after_a_button_was_clicked(browser: PlayerPage, page: Path) -> None:
    browser.open(page)
    webdriver = pytest.importorskip("selenium.webdriver")
    browser.driver.find_element("css selector", "#moments button").click()
    assert browser.run("return player.playing") is False
    webdriver.ActionChains(browser.driver).send_keys(" ").perform()
    assert browser.run("return player.playing") is True
