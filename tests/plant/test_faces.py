"""A passenger who looks downstairs: what is said of the passenger is turned by 180° against the chair, and nothing else is."""

from typing import Any

import numpy as np
import pytest

from treadline.core.ports import Truth
from treadline.plant.mujoco import open_plant
from treadline.run.resolve import checked
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Scenario
from treadline.vehicle.appearance import chair_parts

ON_THE_FLIGHT = {"stair": {"steps": 8}, "start": {"place": "flight"}, "sensors": {"camera": "statistical"}}


def truths(until_s: float, **chair: Any) -> list[Truth]:
    """Return the truth from the start to a time, on a flight."""
    plant = open_plant(Scenario.model_validate(ON_THE_FLIGHT | {"chair": chair}), seed=1)
    plant.start()
    plant.advance(until_s)
    return list(plant.truth())


def places(until_s: float, **chair: Any) -> np.ndarray:
    """Return the passenger's places in W from the start to a time (n, 3)."""
    return np.array([(one.passenger_x_m, one.passenger_y_m, one.passenger_z_m) for one in truths(until_s, **chair)])


@pytest.mark.parametrize("name", ["lean_m", "payload_offset_m"])
def test_forward_is_downhill_for_a_passenger_who_looks_downstairs(name: str) -> None:
    ahead = {"lean_m": [0.08, 0.03], "payload_offset_m": [0.08, 0.03, 0.0]}[name]
    behind = [-ahead[0], -ahead[1], *ahead[2:]]
    np.testing.assert_allclose(places(0.2, faces="down", **{name: ahead}), places(0.2, faces="up", **{name: behind}), atol=1e-12)


@pytest.mark.parametrize(("faces", "uphill"), [("up", 1.0), ("down", -1.0)])
def test_a_sway_begins_at_its_end_ahead_of_the_passenger(faces: str, uphill: float) -> None:
    swaying = truths(0.02, faces=faces, sway_m=[0.05, 0.02])[0].stability_margin_rad
    leaning, other = (truths(0.02, lean_m=[s * uphill * 0.05, s * uphill * 0.02])[0].stability_margin_rad for s in (1.0, -1.0))
    # The chair settles with the passenger at that end; the other end is a degree away.
    assert swaying == pytest.approx(leaning, abs=1e-3)
    assert abs(swaying - other) > np.radians(1.0)


def test_without_an_offset_nothing_moves() -> None:
    np.testing.assert_array_equal(places(0.2, faces="down"), places(0.2))


def test_check_says_who_looks_where() -> None:
    report = checked(Scenario.model_validate(ON_THE_FLIGHT | {"chair": {"faces": "down"}}))
    assert report.faces == "down"
    assert "up rear first, down front first" in str(report)


def test_the_passenger_is_drawn_looking_downstairs() -> None:
    feet = {}
    for faces in ("up", "down"):
        parts = chair_parts(read_chair("wheelchair").model_copy(update={"faces": faces}), Chair())
        shoes, trunk = (next(part for part in parts if part.name == name).vertices_m for name in ("person_shoes", "person_shirt"))
        feet[faces] = shoes[:, 0].mean() - trunk[:, 0].mean()
    assert feet["up"] == pytest.approx(-feet["down"], abs=1e-6)
    assert feet["up"] > 0.1
