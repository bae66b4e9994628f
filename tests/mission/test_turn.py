"""The turn on a landing, in a kinematic world: belts that skid about a centre that the planner does not know, and sides in view."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pytest
from world import belts, flipper

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_z
from treadline.core.signals import TICK_S, HeadingEstimate
from treadline.core.step_sizes import TURN_CLEAR_M
from treadline.estimation.stair_tracker import StairTracker
from treadline.mission import _turn
from treadline.mission._flat_ground_steering import SKID, LevelSteering
from treadline.mission._situation import WAYS, Situation
from treadline.mission._turn import Turner, cannot_turn, has_turned
from treadline.plant.sensors._free_ground import GroundAhead
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller
from treadline.vehicle.landing_turn import landing_of
from treadline.vehicle.landing_turn_kernels import is_free
from treadline.vehicle.loading import Loading
from treadline.vehicle.staircase import as_designed

FRAME_TICKS, LAG_S = 10, 0.15
WALLS = ("far", "left", "right")


def scenario(direction: str, turn_deg: float, side_m: float, across_m: float, walls: tuple[str, ...] = WALLS) -> Scenario:
    landing = {"turn_deg": turn_deg, "landing_depth_m": side_m, "landing_width_m": across_m, "landing_walls": walls}
    return Scenario.model_validate(
        {
            "stair": {"slope_deg": 27, "width_m": 1.4, "landing_m": 3.0},
            "flight": [{"steps": 4}, {"steps": 4} | landing],
            "start": {"place": "floor" if direction == "up" else "landing"},
            "drive": {"direction": direction},
        }
    )


@dataclass
class Turned:
    """What became of a turn: the last situation, its time, and whether belts and outline were free all the way."""

    now: Situation
    took_s: float
    was_free: bool
    rates_rad_s: float
    off_rad: float


def turned(
    monkeypatch: pytest.MonkeyPatch,
    given: Scenario,
    *,
    truth: Scenario | None = None,
    centre_m: float = 0.17,
    aside_m: float = 0.04,
    off_rad: float = 2.0 * DEG,
    drift_rad_s: float = 0.0,
    spare_m: float = TURN_CLEAR_M - 0.02,
) -> Turned:
    """Return the turn of a chair that has come onto the landing off its middle line and off its direction.

    Args:
        truth: The stair as it is, where the chair's plan of it is wrong.
        drift_rad_s: Drift of the gyro from the start of the turn.
        spare_m: Distance from walls and edges by which the chair's outline is judged.
    """
    staircase, chair = as_designed((truth or given).stair), given.read_chair()
    config = mission_config(given, shipped_controller("wheelchair"), chair=chair)
    known = config.landings
    assert known is not None
    plan, is_up = known.plans[0], config.direction == "up"
    camera = GroundAhead(staircase, chair, chair.camera_at(240, rear=not is_up), np.random.default_rng(0))
    origin = staircase.flights[0][-1].nosing_F
    up = np.array([math.cos(plan.turn_rad), math.sin(plan.turn_rad)])
    pose = np.array([0.5, 0.0, 0.0]) if is_up else np.array([*(plan.foot(known.width_m).mean(axis=0) - 0.94 * up), plan.turn_rad])
    stair, loading = StairTracker(), Loading(chair=chair, payload_kg=config.payload_kg)
    turner, level = Turner(known), LevelSteering(chair.tracks.gauge_m)
    expected = pose.copy()
    monkeypatch.setattr(_turn, "pose_on", lambda *_: expected)
    pose += (0.0, aside_m, off_rad) if is_up else (*(aside_m * np.array([-up[1], up[0]])), off_rad)
    outline, numbers, mirror = known.outline.wider(spare_m), *landing_of(staircase.plans[0], known.width_m)
    speed = rate = fastest = 0.0
    angle, was_free, goal = 40.0 * DEG, True, plan.turn_rad if is_up else 0.0
    for tick in range(6000):
        t_s = tick * TICK_S
        off = pose[2] - goal
        seen = abs(off) < 40.0 * DEG
        source: Literal["vision", "gyro"] = "vision" if seen else "gyro"
        estimate = HeadingEstimate(
            t_s=t_s, heading_rad=off if seen else 0.0, heading_rate_rad_s=rate + drift_rad_s, sigma_rad=0.01, source=source
        )
        now = Situation(
            way=WAYS[config.direction], config=config, loading=loading, stair=stair, t_s=t_s, stalled_s=0.0, from_m=0.0,
            flights_done=0, phase="turn", estimate=estimate, tracks=belts(t_s, speed, speed), flipper=flipper(t_s, angle),
        )  # fmt: skip
        if tick % FRAME_TICKS == 0:
            turner.update(camera.look(t_s, rotation_z(pose[2]), origin + np.array([*pose[:2], 0.0])))
        now = turner.step(now)
        command = now.turn
        assert command is not None
        if has_turned(now) or cannot_turn(now):
            break
        wanted = level.turn(command.rate_rad_s) / (0.5 * chair.tracks.gauge_m * SKID)
        speed += (command.speed_m_s - speed) * TICK_S / LAG_S
        rate += (wanted - rate) * TICK_S / LAG_S
        c, s = math.cos(pose[2]), math.sin(pose[2])
        pose = pose + TICK_S * np.array([c * speed + s * centre_m * rate, s * speed - c * centre_m * rate, rate])
        angle += float(np.clip(command.flipper_rad - angle, -0.0026, 0.0026))
        fastest = max(fastest, abs(rate))
        if t_s > 2.0:
            was_free &= bool(is_free(numbers, outline, *(pose * mirror)))
    return Turned(now, t_s, was_free, fastest, pose[2] - goal)


@pytest.mark.parametrize("direction", ["up", "down"])
@pytest.mark.parametrize("turn_deg", [90.0, -90.0])
@pytest.mark.parametrize("centre_m", [0.10, 0.20])
def test_a_chair_turns_on_a_quarter_landing_whatever_its_centre_of_turns(
    direction: str, turn_deg: float, centre_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: square to the next flight within 3°, below 20 °/s, 3 cm or more from walls and edges by the truth."""
    found = turned(monkeypatch, scenario(direction, turn_deg, 2.0, 2.0), centre_m=centre_m)
    assert has_turned(found.now), found.now.turn
    assert abs(found.off_rad) < 3.0 * DEG
    assert found.rates_rad_s < 20.0 * DEG
    assert found.was_free


def test_a_chair_turns_by_half_a_turn_on_a_half_landing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert has_turned(turned(monkeypatch, scenario("up", 180.0, 1.8, 3.0)).now)


@pytest.mark.parametrize("direction", ["up", "down"])
def test_no_part_of_the_chair_is_over_an_edge_that_is_nearer_than_in_the_plan(
    direction: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Test: a landing with edges, 5 cm less deep and less wide than in the plan."""
    given, truth = (scenario(direction, 90.0, side_m, side_m, walls=()) for side_m in (2.05, 2.0))
    assert turned(monkeypatch, given, truth=truth, spare_m=0.0).was_free


@pytest.mark.parametrize("drift_deg_s", [-1.0, 1.0])
def test_sides_in_view_correct_a_gyro_that_drifts(drift_deg_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Test: 1 °/s from the start of the turn, some 10° in all. Expected: square within 5°, and nothing over an edge."""
    found = turned(monkeypatch, scenario("up", 90.0, 2.0, 2.0), drift_rad_s=drift_deg_s * DEG, spare_m=0.0)
    assert has_turned(found.now), found.now.turn
    assert abs(found.off_rad) < 5.0 * DEG
    assert found.was_free


def test_a_landing_that_is_too_small_is_named_with_its_size(monkeypatch: pytest.MonkeyPatch) -> None:
    found = turned(monkeypatch, scenario("up", 90.0, 1.4, 1.4))
    assert "1.40 m wide and 1.40 m deep" in str(cannot_turn(found.now))


def test_a_chair_that_turns_has_no_other_command_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    found = turned(monkeypatch, scenario("up", 90.0, 1.4, 1.4))
    assert Turner(found.now.config.landings).step(replace(found.now, phase="land")).turn is None
