"""Memory layout of MuJoCo that cannot be measured, and equality of the compiled loop with MuJoCo's own step."""

import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest
from oracles.plant_runs import plant_on

from treadline.core.errors import SimulationDiverged
from treadline.plant import _actuator_lag_and_slew_kernels as drives
from treadline.plant.mujoco import _native as native
from treadline.plant.mujoco import _step_kernels as kernels
from treadline.plant.mujoco.contact import _coulomb_kernels as coulomb

EMPTY = "<mujoco><worldbody/></mujoco>"


def test_options_that_are_not_where_they_were_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native.ctypes, "string_at", lambda _, size: bytes(size))
    with pytest.raises(SimulationDiverged, match=r"noslip_iterations was found in 0 places; use 4\.0"):
        native.noslip_address(mujoco.MjModel.from_xml_string(EMPTY))


def test_without_a_contact_there_is_no_list_to_find() -> None:
    model = mujoco.MjModel.from_xml_string(EMPTY)
    with pytest.raises(SimulationDiverged, match="touches nothing at its start"):
        native.contact_list(mujoco.MjData(model))


def test_a_mujoco_without_its_library_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(mujoco, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(SimulationDiverged, match=r"MuJoCo \d.* ships no library"):
        native.load_library()


def test_the_compiled_stages_are_those_of_mj_step_to_the_last_bit() -> None:
    compiled = plant_on(heading_deg=10.0, seed=0, belt_mismatch=0.02)
    reference = copy.copy(compiled._data)
    compiled._is_belt[:] = False  # no contact is turned
    compiled._corrected[0] = False  # nor are its forces corrected: what is left is MuJoCo's own step
    compiled._model.opt.noslip_iterations = 0  # as the loop has it unless the brake holds
    compiled._drives.command[:] = (0.3, 0.1, 0.0, 0.02, 0.0)
    log = np.empty(1, kernels.ROW)
    for _ in range(150):
        compiled._run(1, log, compiled._friction)
        reference.ctrl[:] = compiled._data.ctrl
        for _ in range(compiled._physics.substeps):
            mujoco.mj_step(compiled._model, reference)
    assert reference.ncon > 0
    np.testing.assert_array_equal(reference.qpos, compiled._data.qpos)
    np.testing.assert_array_equal(reference.qvel, compiled._data.qvel)
    assert reference.time == compiled._data.time
    # It did move, and the belts did drive it.
    assert np.linalg.norm(compiled._data.qvel) > 0.01


def rotation(rng: np.random.Generator) -> np.ndarray:
    """Return a rotation that prefers no direction."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    q[:, 0] *= np.sign(np.linalg.det(q))
    return q


FRAME, FRICTION, SURFACEVEL, GEOM = 0, 9, 14, 20
"""Places in a contact that is made up for these tests; geoms as ints of half the width."""


def contact(rng: np.random.Generator, geoms: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Return a contact as doubles and as ints over the same memory."""
    real = np.zeros((1, 16))
    real[0, FRAME : FRAME + 9] = rotation(rng).ravel()
    real[0, FRICTION : FRICTION + 5] = (1.0, 1.0, 0.0, 0.0, 0.0)
    real[0, SURFACEVEL : SURFACEVEL + 2] = rng.standard_normal(2)
    whole = np.zeros((1, 32), dtype=np.int32)
    whole[0, GEOM : GEOM + 2] = geoms
    return real, whole


def turn(real: np.ndarray, whole: np.ndarray, chair_y: np.ndarray) -> None:
    layout = (FRAME, FRICTION, SURFACEVEL, GEOM)
    is_belt = np.array([False, True])
    mu = np.array([((0.62, 0.5), (0.62, 0.5), (0.0, 0.0), (0.0, 1.0))] * 2, coulomb.FRICTION)
    kernels.turn_contacts(1, real, whole, *layout, is_belt, tuple(chair_y.tolist()), mu)


def test_a_contact_of_no_belt_is_left_alone() -> None:
    real, whole = contact(np.random.default_rng(0), (0, 0))
    before = real.copy()
    turn(real, whole, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_array_equal(real, before)


def test_a_belts_side_face_has_no_direction_of_travel_and_the_lower_friction() -> None:
    real, whole = contact(np.random.default_rng(1), (1, 0))
    before = real.copy()
    turn(real, whole, before[0, FRAME : FRAME + 3])
    np.testing.assert_array_equal(real[0, FRICTION : FRICTION + 2], [0.5, 0.5])
    np.testing.assert_array_equal(real[0, FRAME : FRAME + 9], before[0, FRAME : FRAME + 9])


@pytest.mark.parametrize(
    ("speed", "asked", "brake", "expected"),
    [
        # A tenth of the way to the target a tick, at most 0.02 m/s; targets beyond ±1 m/s are not followed.
        *((0.0, 0.1, False, 0.01), (0.0, 0.9, False, 0.02), (0.95, 5.0, False, 0.955), (-0.95, -5.0, False, -0.955)),
        # A brake takes 0.1 m/s a tick, and does not turn a belt back.
        *((0.25, 1.0, True, 0.15), (0.05, 1.0, True, 0.0), (-0.05, 1.0, True, 0.0)),
    ],
)
def test_a_belt_follows_with_lag_within_its_limits_and_a_brake_stops_it(
    speed: float, asked: float, brake: bool, expected: float
) -> None:
    assert drives.drive_belt(speed, asked, brake, 1.0, 0.1, 0.02, 0.1) == pytest.approx(expected, abs=1e-15)
