"""Rendered approaches to flights: a chair does not drive onto a flight that is narrower than it, whichever side it has seen."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scenes import RecordedDrive, ViewRecipe
from world import CHAIR, CONFIG, belts, estimate, flipper, imu_at

from treadline.core.angles import DEG
from treadline.core.signals import HeadingMeasurement, MotionPlan, StairMap
from treadline.mission import CameraBlock
from treadline.mission.traversal import Traversal
from treadline.perception import DetectorConfig, StairDetector

FROM_M, TICK_S, TICKS_PER_FRAME, LIMIT_S = 1.3, 0.05, 4, 10.0
NARROW_M, LEAST_FRAMES = 0.45, 4


@dataclass(frozen=True)
class Approach:
    """Outcome of one approach."""

    phases: list[str]
    hold: str | None
    frames: int
    """Number of frames with a stair map."""


def approach(seed: int, *, half_m: float = CHAIR.swept_half_m, hidden: tuple[str, ...] = (), **recipe: object) -> Approach:
    """Drive a square chair towards a flight by its plan, without dynamics, until it mounts, holds or refuses.

    Args:
        seed: Random seed of the view.
        half_m: Half width below which the detector rejects a flight with both sides in view.
        hidden: Sides at which no map shows what follows, as if they were out of view.
        recipe: Fields of ``ViewRecipe``.
    """
    rng = np.random.default_rng(seed)
    fixed = {
        "scenes": ("foot",),
        "slope_deg": (25.0, 29.0),
        "lateral_m": (-0.08, 0.08),
        "place_m": (FROM_M, FROM_M),
        "heading_deg": (0.0, 0.0),
        "gravity_error_deg": 0.3,
    }
    road = RecordedDrive(rng, ViewRecipe(**{**fixed, **recipe}))
    camera = CameraBlock(StairDetector(DetectorConfig(swept_half_m=half_m)), CHAIR.swept_half_m)
    planner = Traversal(CONFIG)
    plan, known, phases = MotionPlan(t_s=0.0, phase="search", speed_m_s=0.0), None, ["search"]
    along_m = speed_m_s = 0.0
    flipper_rad = CHAIR.tracks.approach_angle_deg * DEG
    maps = 0
    for k in range(round(LIMIT_S / TICK_S)):
        t_s = k * TICK_S
        speed_m_s = plan.speed_m_s
        along_m += TICK_S * speed_m_s
        flipper_rad += 0.0 if plan.flipper is None else TICK_S * plan.flipper.rate_rad_s
        pose = road.pose(along_m, 0.0)
        for reading in (belts(t_s, speed_m_s, speed_m_s), imu_at(t_s, pose.R_WB)):
            camera.update(reading)
            planner.update(reading)
        planner.update(flipper(t_s, flipper_rad))
        if k % TICKS_PER_FRAME == 0:
            for seen in camera.step(road.view(t_s, pose).frame, lambda _: True):
                if isinstance(seen, HeadingMeasurement):
                    known = estimate(t_s)
                if isinstance(seen, StairMap):
                    maps += 1
                    planner.update(replace(seen, **{f"{side}_{name}": None for side in hidden for name in ("edge_m", "side")}))
        plan = planner.step(t_s, known)
        phases += [plan.phase] if plan.phase != phases[-1] else []
        if plan.hold is not None or plan.phase in ("mount", "refused"):
            break
    return Approach(phases=phases, hold=plan.hold, frames=maps)


@pytest.mark.parametrize(("hidden", "cause"), [((), "is open"), (("left",), "side"), (("left", "right"), "was in view up to")])
def test_a_flight_narrower_than_the_chair_is_not_mounted_whichever_side_is_in_view(hidden: tuple[str, ...], cause: str) -> None:
    """Test: a flight 45 cm wide, open at both sides, and a detector that accepts it; both sides are known, one, or none. Expected
    result: an approach, and a hold before the flight that names the side."""
    one = approach(52_000, half_m=0.18, hidden=hidden, width_m=(NARROW_M, NARROW_M), walls=("none",), steps=(8, 12))
    assert one.frames >= LEAST_FRAMES
    assert one.phases[-1] == "approach"
    assert cause in one.hold


@pytest.mark.parametrize(
    ("width_m", "walls", "clutter"),
    [(1.1, ("both",), ()), (1.2, ("none",), ()), (1.3, ("left",), ("rail_right",))],
)
def test_a_flight_of_usual_width_is_mounted_without_a_hold(
    width_m: float, walls: tuple[str, ...], clutter: tuple[str, ...]
) -> None:
    one = approach(53_000, width_m=(width_m, width_m), walls=walls, clutter=clutter)
    assert one.hold is None, one
    assert one.phases[-1] == "mount", one
