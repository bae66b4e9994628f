"""Road wheels: on level ground a belt bears along its length, in plant and statics alike; on nosings they have no effect."""

from functools import partial

import mujoco
import numpy as np
import pytest
from chairs import CHAIR, with_piece
from oracles.plant_runs import TABLE_I, PlantRun, plant_on, plant_run

from treadline.core.angles import DEG
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import floor_stance, steady_motion

TURN = (-0.1, 0.1)


def on_wheels(road_wheels: int) -> ChairDescription:
    return with_piece("tracks", road_wheels=road_wheels)


def share(yaw_rad_s: float) -> float:
    """Return the share of the yaw rate that ±0.1 m/s would give without slip."""
    return yaw_rad_s * CHAIR.tracks.gauge_m / (TURN[1] - TURN[0])


def rate_deg_s(run: PlantRun) -> float:
    return float(np.abs(run.settled["qvel"][:, 3:5]).max()) / DEG


@pytest.mark.parametrize("road_wheels", [2, 5, 12])
@pytest.mark.parametrize("friction", [TABLE_I, (0.5, 0.5), (1.0, 0.7)])
def test_the_plant_turns_on_the_floor_as_the_statics_say(friction: tuple[float, float], road_wheels: int) -> None:
    chair = on_wheels(road_wheels)
    run = plant_run(plant_on(0.0, friction, description=chair), TURN, 2.0)
    theory = steady_motion(floor_stance(chair, partial(centre_of_mass, chair, Chair())), friction, *TURN)
    assert share(run.yaw_deg_s * DEG) == pytest.approx(share(theory.yaw_rad_s[0]), abs=0.015)


@pytest.mark.parametrize("belts", [TURN, (0.1, 0.3), (0.3, 0.3)])
@pytest.mark.parametrize("friction", [TABLE_I, (0.5, 0.5)])
def test_a_chair_on_the_floor_neither_hops_nor_rocks(friction: tuple[float, float], belts: tuple[float, float]) -> None:
    run = plant_run(plant_on(0.0, friction), belts, 2.0)
    assert run.airborne == 0
    # Measured: 1.002 at most, from the tolerance of the contact forces, a thousandth of gravity.
    assert run.load.max() < 1.01
    assert rate_deg_s(run) < 0.2


def test_backing_to_the_landings_edge_is_smooth() -> None:
    plant = plant_on(28.0, steps=6, stair={"landing_m": 3.0}, start={"place": "landing"})
    to_edge_m = float(plant._data.qpos[0]) - plant.staircase.steps[-1].x_m
    run = plant_run(plant, (-0.2, -0.2), to_edge_m / 0.2, settle_s=0.5)
    # The rear half of the flat run is over the edge; the centre of mass, 0.13 m ahead of its middle, is not.
    assert run.airborne == 0
    assert run.load.max() < 1.02
    assert rate_deg_s(run) < 0.3


@pytest.mark.parametrize("road_wheels", [2, 6])
@pytest.mark.parametrize("lug", ["8/60", "20/80"])
def test_a_lugged_chair_drives_and_turns_on_the_floor_at_belt_speed(lug: str, road_wheels: int) -> None:
    """Two wheels a side spin as the pulleys do."""
    straight, turned, smooth = (
        plant_run(plant_on(0.0, tables={"belts": {"lug": profile}}, description=on_wheels(road_wheels)), belts, 1.0)
        for profile, belts in ((lug, (0.2, 0.2)), (lug, TURN), ("none", TURN))
    )
    speed_m_s = (straight.log[-1]["qpos"][0] - straight.begin["qpos"][0]) / straight.duration_s
    assert speed_m_s == pytest.approx(0.2, rel=0.005)
    assert turned.yaw_deg_s == pytest.approx(smooth.yaw_deg_s, rel=0.005)


@pytest.mark.parametrize(("slope_deg", "belts"), [(28.0, (0.15, 0.25)), (20.0, (0.1, 0.3))])
def test_on_a_flight_road_wheels_change_no_digit(slope_deg: float, belts: tuple[float, float]) -> None:
    few, many = (plant_run(plant_on(slope_deg, description=on_wheels(number)), belts, 1.0).log for number in (2, 9))
    np.testing.assert_array_equal(few.view(float), many.view(float))


def test_the_riser_of_a_landing_stops_the_pulleys() -> None:
    """The top of a landing is ground for the road wheels; flat runs and pulleys touch its nosing and riser."""
    plant = plant_on(0.0, steps=2, stair={"rise_m": 0.2})
    model, data, radius_m = plant._model, plant._data, CHAIR.tracks.pulley_radius_m
    landing = plant.staircase.steps[-1]
    # Level, 0.14 m below the landing; the riser is the nosing's radius behind its edge, and the pulleys stand 5 mm deep in it.
    front_m = landing.x_m + plant.staircase.nosing_radius_m + 0.005
    data.qpos[:7] = (front_m - radius_m - 0.5 * CHAIR.tracks.flat_run_m, 0.0, landing.z_m - 0.14, 1.0, 0.0, 0.0, 0.0)
    mujoco.mj_forward(model, data)
    touched = {model.geom(geom).name: contact for contact in data.contact for geom in contact.geom}
    for side in ("left", "right"):
        assert touched[f"{side}_front"].dist == pytest.approx(-0.005, abs=1e-6)
        assert abs(touched[f"{side}_front"].frame[0]) == pytest.approx(1.0)
    assert not any("_wheel_" in name for name in touched)
