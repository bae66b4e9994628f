"""The page of ``treadline view`` in a real browser: scene, controls, access, and clients that come and go."""

import io
import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from .conftest import COMPILING_S

SCENE = (400, 200, 1020, 740)
"""Part of the screenshot between the panels [px]."""


def scene_of(page: Any) -> np.ndarray:
    left, upper, right, lower = SCENE
    return whole(page)[upper:lower, left:right]


def _drawn(page: Any) -> np.ndarray | None:
    """Return the pixels of the scene if they show many colours, else None."""
    pixels = scene_of(page)
    return pixels if pixels.std() > 8.0 and colours(pixels) > 40 else None


def test_a_recorded_run_plays_pauses_and_scrubs(replay: Any) -> None:
    replay.click("start")
    replay.until(lambda: replay.t_s == 0.0, "the beginning")
    replay.click("+0.01 s")
    replay.until(lambda: replay.t_s == 0.01, "one tick on")
    replay.click("play")
    replay.until(lambda: replay.t_s > 0.3, "motion")
    replay.click("end")
    replay.until(lambda: replay.t_s > 1.9, "the end")
    replay.click("−0.01 s")
    replay.until(lambda: 1.9 < replay.t_s < 2.0, "one tick back, and a standstill there")


def test_the_scene_is_not_empty_and_moves_with_the_cursor(replay: Any) -> None:
    """Test: pixels between the panels at both ends of a run. Expected: many colours, and a different picture."""
    replay.click("start")
    replay.until(lambda: replay.t_s == 0.0, "the beginning")
    first = replay.until(lambda: _drawn(replay), "a drawn scene")
    replay.click("end")
    replay.until(lambda: replay.t_s > 1.9, "the end")
    replay.until(lambda: bool(np.abs(scene_of(replay) - first).mean() > 0.5), "another picture")


def test_the_page_asks_nothing_from_elsewhere(replay: Any, recorded: str) -> None:
    replay.until(lambda: _drawn(replay), "a drawn scene")
    own = urlsplit(recorded).netloc
    asked = replay.requests()
    assert any(url.startswith("ws://") for url in asked)  # the log of requests works
    assert {url for url in asked if urlsplit(url).scheme not in ("data", "blob") and urlsplit(url).netloc != own} == set()


def test_a_fork_without_a_change_shows_its_verdict(replay: Any) -> None:
    replay.click("What if")
    replay.choose("change", "no change (repeats the run)")
    replay.click("Fork here")
    replay.sees(r"fork at [\d.]+ s: no change[\s\S]*ended at 2\.00 s: time_up")
    replay.click("Remove the fork")


def test_a_typed_time_and_a_clicked_moment_move_the_cursor_and_stay(replay: Any) -> None:
    """Test: 1.25 typed into the time box, then a click on a moment. Expected: page, box and cursor agree a second later."""
    from selenium.webdriver.common.keys import Keys

    box = replay.element("document.querySelector('#timeline input[type=text]')", "the time box")
    box.send_keys(Keys.CONTROL, "a")
    box.send_keys("1.25")
    box.send_keys(Keys.TAB)
    replay.until(lambda: replay.t_s == 1.25, "the typed time")
    time.sleep(1.5)
    assert replay.t_s == 1.25
    assert float(box.get_attribute("value")) == 1.25
    replay.click("Events")
    replay.until(lambda: replay.run("return [...document.querySelectorAll('tr[data-jump]')].at(-1)"), "a row").click()
    replay.until(lambda: replay.t_s == 0.0, "the beginning of the phase")
    replay.until(lambda: float(box.get_attribute("value")) == 0.0, "the same time in the box")


def test_stop_rearm_and_a_fault_reach_the_chair_and_two_clients_see_it(page: Any, make_page: Callable[[], Any], live: str) -> None:
    """Test: two clients of one live run; the second is killed. Expected: both see stop, re-arm and fault, and the run goes on."""
    page.driver.get(live)
    page.until_it_runs()
    page.click("Control")
    page.click("STOP")
    page.sees("HOLD since .*\n?.*operator stop")
    other = make_page()
    other.driver.get(live)
    other.sees("HOLD since .*\n?.*operator stop")
    page.click("Re-arm")
    page.sees("guard: passes commands|guard: slowed")
    other.kill()
    now_s = page.t_s
    page.until(lambda: page.t_s > now_s + 0.5, "a simulation that goes on without the other client")
    page.sees("friction, left")
    page.sees("weight forward")
    page.click("Inject now")
    page.click("Show")
    page.tick("contact forces")
    page.click("Events")
    page.until(lambda: page.t_s > now_s + 1.0, "a simulation that goes on after the fault")


def test_the_demo_moves_at_once_and_runs_live_in_the_same_page(page: Any, demo: str) -> None:
    """Test: the demonstration, and its button once the kernels are compiled. Expected: motion, then a live run of the scenario."""
    page.driver.get(demo)
    page.until(lambda: _drawn(page), "a drawn scene")
    first_s = page.t_s
    page.until(lambda: page.t_s > first_s + 0.5, "a chair that climbs")
    page.sees("The simulator is ready", COMPILING_S)
    page.click("Run it live")
    page.sees(r"[\d.]+ s of [\d.]+ s · live", COMPILING_S)
    page.until_it_runs()


GAMEPAD = """
window.pad = { axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })) };
navigator.getGamepads = () => [window.pad, null, null, null];
"""
"""Gamepad of the standard mapping, whose axes and buttons a test sets."""
PUSHED = "window.pad.axes[1] = -1; window.pad.buttons[5].pressed = arguments[0];"


@pytest.fixture
def driving(page: Any, by_hand: str) -> Iterator[Any]:
    """Page of a live run whose chair a person drives; small, so that software draws it fast enough for reports in time."""
    page.driver.set_window_size(700, 500)
    page.driver.get(by_hand)
    page.until_it_runs()
    page.click("Control")
    page.tick("Drive by hand")
    # Nobody holds the switch yet, so that the chair stands; a report of the page that a person drives takes 0.2 s.
    page.sees("HOLD since")
    time.sleep(1.0)
    yield page
    page.tick("Drive by hand")
    page.driver.set_window_size(1440, 900)


def place(page: Any) -> float:
    """Return the distance that the belts have travelled, as the control panel shows it [m]."""
    return float(page.sees(r"belts travelled ([-\d.]+) m").group(1))


SLOWLY_DRAWN_S = 120.0
"""Patience with a page that software draws, whose late reports make the guard hold again and again [s]."""


def place_at_rest(page: Any, within_m: float = 0.011) -> float:
    """Assert that nothing moves for a second, and return where the chair was."""
    start_m, then_s = place(page), page.t_s
    page.until(lambda: page.t_s > then_s + 1.0, "a second in which nothing may move")
    assert place(page) == pytest.approx(start_m, abs=within_m)
    return start_m


def drives_from(page: Any, start_m: float) -> bool:
    """Return whether the chair has driven 0.1 m, and re-arm it: a page that is drawn slowly reports late, and the guard holds."""
    if "HOLD since" in page.text():
        page.click("Re-arm")
    return place(page) > start_m + 0.1


def test_the_chair_follows_the_keys_while_the_dead_man_switch_is_held(driving: Any) -> None:
    """Test: W alone, then Shift and W, then W alone again. Expected: motion between pressing and releasing Shift only."""
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    def keys() -> Any:
        return ActionChains(driving.driver)

    keys().key_down("w").perform()
    start_m = place_at_rest(driving)
    keys().key_down(Keys.SHIFT).perform()
    driving.until(lambda: drives_from(driving, start_m), "a chair that drives", SLOWLY_DRAWN_S)
    keys().key_up(Keys.SHIFT).perform()
    driving.sees("HOLD since .*\n?.*dead-man switch is released")
    place_at_rest(driving, within_m=0.03)  # the page shows the hold 0.1 s before the belts rest
    keys().key_up("w").perform()


def test_the_chair_follows_a_gamepad_while_its_shoulder_button_is_held(driving: Any) -> None:
    """Test: stick forward without and with the right shoulder button. Expected: motion with the button only."""
    driving.run(GAMEPAD)
    driving.run(PUSHED, False)
    start_m = place_at_rest(driving)
    driving.run(PUSHED, True)
    driving.until(lambda: drives_from(driving, start_m), "a chair that drives", SLOWLY_DRAWN_S)
    driving.run(PUSHED, False)
    driving.sees("HOLD since .*\n?.*dead-man switch is released")


def test_a_narrow_page_shows_scene_and_stop(page: Any, live: str) -> None:
    """Test: a phone of 390 by 844 px. Expected: STOP in view, the panels over less than half of the page, the scene drawn above."""
    page.resize(390, 844)
    try:
        page.driver.get(live)
        page.until_it_runs()
        top = page.run(
            "const stop = [...document.querySelectorAll('button')].find(b => b.innerText.trim() === 'STOP');"
            "const { top, bottom, width } = stop.getBoundingClientRect();"
            "return [top, bottom, width, innerWidth, innerHeight, document.documentElement.scrollWidth];"
        )
        upper, lower, width, page_px, height_px, scroll_px = top
        assert 0.5 * height_px < upper < lower < height_px
        assert width > 0.9 * page_px
        assert scroll_px == page_px == 390
        page.until(lambda: colours(whole(page)[150:430]) > 40, "a drawn scene above the panels")
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def colours(pixels: np.ndarray) -> int:
    return len(np.unique((pixels // 16).reshape(-1, 3), axis=0))


def whole(page: Any) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(page.driver.get_screenshot_as_png())).convert("RGB"), dtype=float)
