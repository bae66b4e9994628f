"""Plots of the player on a phone: values and zoom work by touch, and a vertical swipe scrolls the page."""

import time

import pytest

from treadline.playback import Recording
from treadline.report.player_page import write_player

from .conftest import PlayerPage


@pytest.fixture(scope="module")
def phone(browser: PlayerPage, recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> PlayerPage:
    browser.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    browser.open(write_player(recording, tmp_path_factory.mktemp("phone") / "run.html"), width_px=390)
    return browser


def _until(browser: PlayerPage, script: str) -> None:
    browser.until(lambda: browser.run(script) or None, script)


def _touch(browser: PlayerPage, kind: str, x: float = 0.0, y: float = 0.0) -> None:
    points = [] if kind == "touchEnd" else [{"x": x, "y": y}]
    browser.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


def _middle(browser: PlayerPage, element: str) -> tuple[float, float]:
    browser.run(f"{element}.scrollIntoView({{block: 'center', behavior: 'instant'}})")
    at = None
    while at != (at := browser.run("return window.scrollY")):  # the page rolls on after a swipe
        time.sleep(0.1)
    x, y = browser.run(f"const b = {element}.getBoundingClientRect(); return [b.left + b.width / 2, b.top + b.height / 2]")
    return x, y


def _tap(browser: PlayerPage, element: str) -> None:
    x, y = _middle(browser, element)
    _touch(browser, "touchStart", x, y)
    _touch(browser, "touchEnd")


CANVAS = "document.querySelector('.panel canvas')"


def test_a_tap_on_a_curve_shows_its_value_there(phone: PlayerPage) -> None:
    _tap(phone, CANVAS)
    _until(phone, "return player.t > 0")
    assert 2.0 < phone.run("return player.t") < 4.0  # the middle of a run of 6 s; the axis takes some of the width
    _until(phone, "const value = document.querySelector('.panel .key b').textContent; return value && !value.includes('–')")


def test_a_horizontal_drag_moves_the_time_with_the_finger(phone: PlayerPage) -> None:
    x, y = _middle(phone, CANVAS)
    _touch(phone, "touchStart", x, y)
    for k in range(1, 11):
        _touch(phone, "touchMove", x + 10 * k, y)
    _touch(phone, "touchEnd")
    _until(phone, "return player.t > 4.2")


def test_a_vertical_swipe_scrolls_the_page(phone: PlayerPage) -> None:
    x, y = _middle(phone, CANVAS)
    before, t_s = phone.run("return window.scrollY"), phone.run("return player.t")
    _touch(phone, "touchStart", x, y)
    for k in range(1, 16):
        _touch(phone, "touchMove", x, y - 10 * k)
        time.sleep(0.02)
    _touch(phone, "touchEnd")
    _until(phone, f"return Math.abs(window.scrollY - {before}) > 50")
    assert phone.run("return player.t") == t_s
    # The list of events does not trap a swipe: it scrolls with the page.
    assert phone.run("const box = document.getElementById('eventbox'); return box.scrollHeight <= box.clientHeight + 1")


def test_buttons_zoom_in_and_show_the_whole_run_again(phone: PlayerPage) -> None:
    whole = phone.run("return plots.window")
    for label, shown in (("zoom in", "<"), ("whole run", "===")):
        _tap(phone, f"[...document.querySelectorAll('button')].find((b) => b.textContent.trim() === '{label}')")
        _until(phone, f"return plots.window[1] - plots.window[0] {shown} {whole[1] - whole[0]}")
