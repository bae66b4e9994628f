"""Lugs: a periodic profile under Coulomb friction that hooks nosings, and nothing else about the chair."""

import math

import mujoco
import numpy as np
import pytest
from oracles.plant_runs import STILL, TABLE_I, held, plant_on

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.ports import Truth
from treadline.core.signals import TrackCommand
from treadline.plant.mujoco import MujocoPlant
from treadline.plant.mujoco.contact import _rubber_lug_kernels as lug_kernels
from treadline.run.resolve import checked as check
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import LUGS_MM, Belts, Scenario

NUMBERS = lug_kernels.LugParameters(0.015, 0.08, 0.024, 0.014, 0.02, 0.95, 0.45, 0.07, 0.05, 0.65, 0.002)
"""15/80 on the wheelchair."""


def chair_on(belts: Belts, friction: tuple[float, float] = TABLE_I, seed: int = 1) -> MujocoPlant:
    return plant_on(28.0, friction, seed=seed, tables={"belts": belts})


def drive(plant: MujocoPlant, speed_m_s: float, until_s: float) -> list[Truth]:
    return held(plant, speed_m_s, speed_m_s, until_s)


def test_the_profile_is_periodic_continuous_and_as_deep_as_the_lugs_are_high() -> None:
    along = np.linspace(-0.2, 0.2, 4001)
    gap, slope = np.array([lug_kernels.profile(float(place), NUMBERS) for place in along]).T
    shifted = np.array([lug_kernels.profile(float(place) + 0.08, NUMBERS)[0] for place in along])
    np.testing.assert_allclose(gap, shifted, atol=1e-12)
    assert (gap.min(), gap.max()) == pytest.approx((0.0, 0.015), abs=1e-12)
    # The steepest flank is h π/(2 f) = 1.68; steps of 0.1 mm.
    assert np.abs(np.diff(gap)).max() < 1.69e-4
    # Central differences err where a half-cosine begins, by its curvature times half a step: 190 /m · 0.1 mm.
    np.testing.assert_allclose(slope[1:-1], (gap[2:] - gap[:-2]) / 2e-4, atol=0.03)
    assert gap[np.abs(along) <= 0.012].max() < 1e-12  # the tip


def test_on_level_ground_a_belt_stands_on_its_tips_and_on_a_slope_on_the_next_lug() -> None:
    for place in np.linspace(0.0, 0.08, 17):
        assert lug_kernels.standing(float(place), 0.0, NUMBERS)[0] == 0.0
    rise = -math.sin(28.0 * DEG)
    # The next lug uphill begins 40 mm less half a tip from here, and stands that much times sin θ higher.
    gap, slope = lug_kernels.standing(0.04, rise, NUMBERS)
    assert gap == pytest.approx(0.028 * math.sin(28.0 * DEG))
    assert slope == pytest.approx(math.sin(28.0 * DEG))
    # Mirrored, for a belt that leans the other way.
    assert lug_kernels.standing(-0.04, -rise, NUMBERS) == pytest.approx((gap, -slope))


def test_lugs_of_no_height_are_the_smooth_belt_to_the_last_bit() -> None:
    smooth, flat = (drive(chair_on(belts), 0.2, 1.0) for belts in (Belts(), Belts(lug="15/80", height_m=0.0)))
    assert smooth == flat


def test_lugs_without_gaps_between_them_climb_as_a_smooth_belt_does() -> None:
    """The shrunken solids, the margin and the profile together put the tips where the smooth outline is."""
    almost = Belts(height_m=0.015, pitch_m=0.3, tip_m=0.298, flank_m=0.001)
    smooth, lugged = (drive(chair_on(belts), 0.2, 4.0) for belts in (Belts(), almost))
    assert lugged[-1].x_m == pytest.approx(smooth[-1].x_m, abs=2e-3)
    assert lugged[-1].passenger_z_m == pytest.approx(smooth[-1].passenger_z_m, abs=2e-3)


def test_a_lug_hooks_a_nosing_where_a_smooth_belt_slides() -> None:
    # 28° needs 0.53; belts at rest, no brake. 0.97 m/s² of free sliding over 2 s are 1.9 m.
    smooth, lugged = (drive(chair_on(belts, friction=(0.42, 0.34)), 0.0, 2.0) for belts in (Belts(), Belts(lug="15/80")))
    assert smooth[0].x_m - smooth[-1].x_m > 1.0
    # A lug that is not yet on a nosing slides to the next one: a pitch at most.
    assert lugged[0].x_m - lugged[-1].x_m < 0.08


def energy_j(plant: MujocoPlant) -> float:
    mujoco.mj_energyPos(plant._model, plant._data)
    mujoco.mj_energyVel(plant._model, plant._data)
    return float(plant._data.energy.sum())


def test_belts_at_rest_give_no_energy() -> None:
    plant = chair_on(Belts(lug="15/80"), friction=(0.30, 0.25))
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.0, right_m_s=0.0), STILL)
    before, lost = energy_j(plant), []
    for k in range(1, 301):
        plant.advance(round(0.01 * k, 2))
        lost.append(before - energy_j(plant))
    # Contacts store up to a joule when they bear twice the weight a millimetre deep.
    assert min(lost) > -1.0
    assert np.abs(plant._data.qvel[:3]).max() < 5.0


def test_the_seed_says_where_the_lugs_start_and_a_second_start_repeats_it() -> None:
    first, again, other = (chair_on(Belts(lug="15/80"), seed=seed) for seed in (1, 1, 2))
    assert drive(first, 0.2, 0.5) == drive(again, 0.2, 0.5) != drive(other, 0.2, 0.5)
    before = list(drive(first, 0.2, 1.0))
    first.start()
    drive(first, 0.2, 1.0)
    first.start()
    assert first._lugs.travel_m == pytest.approx(first._lugs.start_m)
    assert before


def test_stiffer_rubber_is_a_shorter_time_constant_of_the_belts_alone() -> None:
    model = chair_on(Belts(stiffness_s=0.005))._model
    belts = [model.geom(f"left_{part}").id for part in ("rear", "front", "nose", "flat", "approach")]
    assert (model.geom_solref[belts, 0] == 0.005).all()
    assert (np.delete(model.geom_solref[:, 0], [*belts, *(model.geom(f"right_{p}").id for p in ("rear", "nose"))]) >= 0.005).all()


@pytest.mark.parametrize("lug", [lug for lug in LUGS_MM if lug != "none"])
def test_named_lugs_have_their_names_measures(lug: str) -> None:
    belts = Belts.model_validate({"lug": lug})
    assert belts.measures_m[:2] == pytest.approx(tuple(1e-3 * float(mm) for mm in lug.split("/")))


def test_lugs_larger_than_the_pulley_are_refused_by_plant_and_check() -> None:
    with pytest.raises(SettingsError, match=r"height_m is 0\.040, the pulleys' radius 0\.070 m; lugs up to 0\.035 m fit"):
        chair_on(Belts(lug="15/80", height_m=0.04))
    refused = Scenario(belts=Belts(height_m=0.036))
    assert any("lugs up to 0.035 m fit" in reason for reason in check(refused, read_chair("wheelchair")).reasons)
