"""Friction by step and by half of a step, and bodies that collide: what a scenario says is what the contacts have."""

from typing import Any

import numpy as np
import pytest
from oracles.plant_runs import held, plant_on

from treadline.core.ports import Truth
from treadline.plant.mujoco.mujoco_plant import MujocoPlant


def plant(*, stair: Any = None, start: Any = None, step: Any = (), chair: Any = None) -> MujocoPlant:
    few = {"steps": 12, "width_m": 2.0} | (stair or {})
    return plant_on(seed=0, stair=few, start=start, tables={"step": step}, **(chair or {}))


def driven(made: MujocoPlant, seconds: float, left_m_s: float, right_m_s: float) -> list[Truth]:
    return held(made, left_m_s, right_m_s, seconds)


def frictions(made: MujocoPlant) -> set[tuple[float, float, bool]]:
    """Return friction along and across of the belts' contacts now, and whether they lie left of the middle."""
    layout = made._memory[5]
    found = set()
    for i in range(made._data.ncon):
        row, whole = made._memory[3][i], made._memory[4][i]
        first, second = whole[layout[3]], whole[layout[3] + 1]
        if made._is_belt[first] or made._is_belt[second]:
            along, across = row[layout[1] : layout[1] + 2]
            found.add((float(along), float(across), bool(row[layout[0] - 2] > 0.0)))
    return found


def test_each_half_of_the_steps_has_its_own_friction() -> None:
    made = plant(stair={"friction": (0.8, 0.5), "friction_left": (0.7, 0.45)})
    driven(made, 0.5, 0.1, 0.1)
    assert frictions(made) == {(0.7, 0.45, True), (0.8, 0.5, False)}


def test_a_step_has_the_friction_of_its_own_table() -> None:
    made = plant(stair={"friction": (0.8, 0.5)}, step=[{"index": 5, "friction": (0.75, 0.4)}])
    driven(made, 0.02, 0.0, 0.0)
    found = {(along, across) for along, across, _ in frictions(made)}
    assert found == {(0.8, 0.5), (0.75, 0.4)}


def test_a_chair_slides_on_wet_steps_alone() -> None:
    """Test: held by its belts, 28° asks for 0.53. Expected result: on 0.36 it slides as g (sin β - μ cos β), on 0.8 it stays."""
    steps = [{"index": i, "friction": (0.36, 0.36)} for i in range(12)]
    dry, wet = (driven(plant(stair={"friction": (0.8, 0.5)}, **keys), 0.5, 0.0, 0.0) for keys in ({}, {"step": steps}))
    assert abs(dry[-1].x_m - dry[0].x_m) < 1e-3
    expected = 0.5 * 9.81 * (np.sin(np.radians(28.0)) - 0.36 * np.cos(np.radians(28.0))) * 0.5**2
    # Nosings come under the belts one by one: the load's share that slides changes, the friction does not.
    assert dry[0].x_m - 0.0 == pytest.approx(wet[0].x_m, abs=1e-6)
    assert wet[0].x_m - wet[-1].x_m == pytest.approx(expected, rel=0.05)
    assert wet[0].friction_use == pytest.approx(np.tan(np.radians(28.0)) / 0.36, rel=1e-3)


def test_the_floor_may_be_wet_on_its_own() -> None:
    made = plant(stair={"friction": (0.8, 0.5), "floor_friction": (0.3, 0.25)}, start={"place": "floor"})
    driven(made, 0.05, 0.1, 0.1)
    assert {(along, across) for along, across, _ in frictions(made)} == {(0.3, 0.25)}


def test_a_climbing_chair_touches_with_its_belts_alone() -> None:
    truth = driven(plant(), 4.0, 0.2, 0.2)
    assert truth[-1].x_m - truth[0].x_m > 0.6
    assert max(sample.hull_contacts for sample in truth) == 0.0


def test_a_passenger_beside_the_chair_meets_the_wall() -> None:
    """Test: 5 kg held 0.5 m to the left, 0.1 m from a wall that the chair climbs towards. Expected result: they touch."""
    chair = {"payload_kg": 5.0, "payload_offset_m": (0.0, 0.5, 0.0)}
    stair = {"width_m": 1.6, "walls": "left", "steps": 16}
    made = plant(stair=stair, start={"heading_deg": 5.0}, chair=chair)
    truth = driven(made, 6.0, 0.2, 0.2)
    touched = [sample for sample in truth if sample.hull_contacts > 0.0]
    assert touched
    # The payload's box is 0.4 m wide about its centre: 0.1 m from the wall, and a turn of 5° brings its corner nearer.
    assert 0.01 < touched[0].y_m < 0.1


def test_hull_and_passenger_do_not_collide_with_the_chairs_own_parts() -> None:
    made = plant(start={"place": "floor"})
    driven(made, 0.1, 0.0, 0.0)
    model = made._model
    own = [i for i in range(model.ngeom) if model.geom_bodyid[i] != 0]
    assert {model.geom(i).name for i in own if not made._is_belt[i]} == {"hull", "payload"}
    assert all(not model.geom_conaffinity[i] for i in own)
