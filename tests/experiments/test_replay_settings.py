"""What a replay may change: every key reaches its block, and what cannot be is one line."""

from dataclasses import replace
from pathlib import Path

import pytest

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import SettingsError
from treadline.estimation import FilterConfig, HeadingFilter, OffsetEstimator
from treadline.experiments._replay_settings import resolved
from treadline.mission.mission_blocks import guard_config
from treadline.mission.mission_config import MissionConfig
from treadline.perception import StairDetector
from treadline.scenario.chair import read_chair
from treadline.scenario.shipped_files import shipped_controller

BASE = MissionConfig(chair=read_chair("wheelchair"))
LOGGED = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=288.5, cx_px=159.5, cy_px=119.5)


def test_nothing_set_changes_nothing() -> None:
    settings = resolved(BASE, ())
    assert settings.mission.vision == BASE.vision
    assert settings.mission.allocation == BASE.allocation
    # The very bits: a gate that is 1e-17 off would be another run.
    assert settings.changed(FilterConfig(), "filter") == FilterConfig()
    assert settings.changed(guard_config(BASE, 0.25), "guard") == guard_config(BASE, 0.25)
    assert settings.R_BI is None
    mounted = settings.calibrate(LOGGED, (320, 240))
    of_the_log = {"fx_px": 287.5, "fy_px": 288.5, "cx_px": 159.5, "cy_px": 119.5}
    assert mounted == replace(BASE.chair.camera_at(240), **of_the_log)


def test_a_key_changes_its_setting_and_no_bit_of_the_others() -> None:
    items = ("filter.gate=16", "filter.drift.least_deg_s=0.5", "filter.drift.least_count=4", "guard.watches_slip=false")
    settings = resolved(BASE, items)
    drift = replace(FilterConfig().drift, least_rad_s=0.5 * DEG, least_count=4)
    assert settings.changed(FilterConfig(), "filter") == replace(FilterConfig(), gate=16.0, drift=drift)
    assert settings.changed(guard_config(BASE, 0.25), "guard") == replace(guard_config(BASE, 0.25), watches_slip=False)


def test_the_estimator_follows_vision_unless_it_is_named() -> None:
    for items, kind in (
        ((), HeadingFilter),
        (("vision=paper",), OffsetEstimator),
        (("vision=paper", "estimator=kalman"), HeadingFilter),
        (("estimator=offset",), OffsetEstimator),
    ):
        assert isinstance(resolved(BASE, items).blocks(StairDetector()).estimator, kind)


def test_the_camera_takes_what_is_set_and_keeps_the_rest() -> None:
    settings = resolved(BASE, ("camera.mount_pitch_deg=30", "camera.fx_px=300"))
    camera = settings.calibrate(LOGGED, (320, 240))
    assert camera.mount_pitch_rad == 30 * DEG
    assert (camera.fx_px, camera.fy_px) == (300.0, 288.5)
    assert settings.calibrate(None, (320, 240)) is None  # three of the four intrinsics are unknown
    whole = resolved(BASE, [f"camera.{name}=200" for name in ("fx_px", "fy_px", "cx_px", "cy_px")]).calibrate(None, (320, 240))
    assert (whole.width_px, whole.fx_px) == (320, 200.0)


def test_a_controller_is_loaded_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    shipped_controller("wheelchair").save(path)
    assert resolved(BASE, (f"controller={path}",)).controller_name == str(path)
    with pytest.raises(SettingsError, match="no such file"):
        resolved(BASE, (f"controller={tmp_path / 'none.json'}",))


@pytest.mark.parametrize(
    ("item", "words"),
    [
        ("filter.gat=1", ("filter.gat", "did you mean filter.gate", "allowed: filter.", "--keys")),
        ("speed=1", ("speed", "vision", "guard.cruise_limit_m_s")),
        ("filter.gate", ("key=value",)),
        ("filter.gate=high", ("filter.gate", "a number ≥ 0", "'high'")),
        ("vision=truth", ("'robust' or 'paper'", "'truth'")),
        ("control.speed_m_s=1.0", ("control.speed_m_s", "0.3")),
        ("filter.drift.least_count=2.5", ("filter.drift.least_count: must be a whole number",)),
    ],
)
def test_what_cannot_be_set_is_one_line_with_the_key(item: str, words: tuple[str, ...]) -> None:
    with pytest.raises(SettingsError) as caught:
        resolved(BASE, (item,))
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message, message
