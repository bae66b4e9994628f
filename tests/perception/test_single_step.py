"""A kerb before a horizontal chair: its nosing is measured, and what is no kerb for the chair is refused."""

import math

import numpy as np
import pytest
from surfaces import frame_of

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_y, rotation_z
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.detector import FrameResult
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Stair
from treadline.vehicle.staircase import build_staircase

CHAIR = read_chair("wheelchair")


def look(before_m: float, *, rear: bool = False, heading_deg: float = 3.0, pitch_deg: float = 0.0, **stair: float) -> FrameResult:
    """Return what the detector finds with mid-track some distance before a kerb, or behind its edge."""
    rng = np.random.default_rng(4)
    kerb = build_staircase(Stair.model_validate({"steps": 1, "width_m": 3.0, "landing_m": 3.0, "walls": "none"} | stair), rng)
    R_WB = rotation_z(heading_deg * DEG) @ rotation_y(-pitch_deg * DEG)
    p_WB = np.array([before_m, 0.0, kerb.steps[0].z_m]) if rear else np.array([-before_m, 0.0, 0.0])
    frame, down_C = frame_of(kerb, CHAIR.camera_at(240, rear=rear), R_WB, p_WB, rng)
    return StairDetector(DetectorConfig(swept_half_m=CHAIR.swept_half_m)).see(frame, down_C)


@pytest.mark.parametrize("rear", [False, True], ids=["up", "down"])
@pytest.mark.parametrize("rise_m", [0.05, 0.10, 0.15, 0.20])
@pytest.mark.parametrize("before_m", [1.1, 1.4])
def test_the_nosing_of_a_kerb_is_measured(rise_m: float, before_m: float, *, rear: bool) -> None:
    seen = look(before_m, rear=rear, rise_m=rise_m)
    assert seen.measurement is not None
    assert seen.stair_map is not None
    assert seen.measurement.heading_rad == pytest.approx(3.0 * DEG, abs=max(4.0 * seen.measurement.sigma_rad, 0.2 * DEG))
    ((x_m, _, z_m),) = seen.stair_map.nosings_B
    assert (seen.stair_map.direction, seen.stair_map.ends) == ("down" if rear else "up", True)
    assert abs(x_m) == pytest.approx(before_m / math.cos(3.0 * DEG), abs=0.02)
    assert z_m == pytest.approx(0.0 if rear else rise_m, abs=0.015)
    assert seen.stair_map.rise_m == pytest.approx(rise_m, abs=0.02)


@pytest.mark.parametrize(
    ("why", "stair"),
    [
        ("a bench", {"rise_m": 0.30, "run_m": 0.5, "landing_m": 0.45}),
        ("narrower than the chair", {"rise_m": 0.15, "width_m": 0.8}),
        ("no deeper than a tread", {"rise_m": 0.15, "landing_m": 0.45}),
    ],
)
def test_what_does_not_bear_the_chair_is_no_kerb(why: str, stair: dict[str, float]) -> None:
    assert look(1.2, **stair).measurement is None, why


def test_a_pitched_chair_finds_no_kerb() -> None:
    """Test: the chair leans back by 12°, as on a flight. Expected result: it does not know the height of its own level."""
    assert look(1.2, rise_m=0.15, pitch_deg=12.0).measurement is None
