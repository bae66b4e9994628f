"""A vehicle with left-right symmetry is fitted by the difference of its belt speeds, if names and data permit."""

from dataclasses import replace

import numpy as np
import pytest
from systems import fit, system

from treadline.core.errors import PoorExcitation
from treadline.core.linear_systems import impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel

NAMES = ("left_m_s", "right_m_s")


def vehicle(right_over_left: float = 1.0) -> LinearModel:
    """Return a vehicle that turns with a lag, one belt stronger than the other."""
    gain = np.array([[-1.0, right_over_left]])
    return system([[0.7]], gain, [[0.5]], 0.2 * gain, dt_s=0.15, input_names=NAMES, output_names=("yaw_rate_rad_s",))


def driven(plant: LinearModel, seed: int, samples: int = 200, noise: float = 0.2) -> InputOutputRecord:
    """Return a drive with a large common speed, as in manual driving."""
    rng = np.random.default_rng(seed)
    u = 0.3 + 0.3 * rng.standard_normal((samples, 1)) + 0.1 * rng.standard_normal((samples, 2))
    y = simulate(plant, u, np.zeros(1))
    y += noise * y.std() * rng.standard_normal(y.shape)
    return InputOutputRecord(u=u, y=y, dt_s=plant.dt_s, input_names=plant.input_names, output_names=plant.output_names)


def error_of(model: LinearModel, plant: LinearModel) -> float:
    """Return the relative free-run error on another drive."""
    drive = driven(plant, 1000, samples=500, noise=0.0)
    return float(np.linalg.norm(simulate(model, drive.u, np.zeros(model.order)) - drive.y) / np.linalg.norm(drive.y))


def test_a_symmetric_vehicle_is_fitted_by_the_difference_of_its_belt_speeds() -> None:
    plant, by_difference, by_both = vehicle(), [], []
    for seed in range(6):
        record = driven(plant, seed)
        found = fit(record, order=1)
        assert found.differential is not None
        np.testing.assert_allclose(found.model.B[:, 0], -found.model.B[:, 1])
        np.testing.assert_allclose(found.model.D[:, 0], -found.model.D[:, 1])
        assert found.model.input_names == NAMES
        assert found.model.provenance["inputs"] == "difference"
        assert len(found.model.input_delay) == 2
        assert found.gram.units.input_count == 2
        by_difference.append(error_of(found.model, plant))
        by_both.append(error_of(fit(replace(record, input_names=("a_m_s", "b_m_s")), order=1).model, plant))
    # The large common speed does not disturb the turn: 0.65 to 0.78 times, over dozens of drives.
    assert np.mean(by_difference) < 0.9 * np.mean(by_both)


@pytest.mark.parametrize(("stronger", "samples"), [(1.1, 800), (0.7, 200)])
def test_a_stronger_belt_contradicts_the_symmetry(stronger: float, samples: int) -> None:
    for seed in range(6):
        found = fit(driven(vehicle(stronger), seed, samples=samples), order=1)
        assert not found.report.mirrored
        assert found.model.B[0, 1] / -found.model.B[0, 0] == pytest.approx(stronger, rel=0.15)


def test_belts_may_come_in_either_order() -> None:
    record = driven(vehicle(), 4)
    swapped = replace(record, u=record.u[:, ::-1].copy(), input_names=NAMES[::-1])
    here, there = (fit(one, order=1).model for one in (record, swapped))
    assert there.input_names == NAMES[::-1]
    np.testing.assert_allclose(impulse_response(here, 20), impulse_response(there, 20)[:, :, ::-1], atol=1e-9)


@pytest.mark.parametrize(
    ("inputs", "output", "expected"),
    [
        (("/left_wheel/state.velocity", "/right_wheel/state.velocity"), "/imu/data.angular_velocity.z", True),
        (("Left", "Right"), "/chair/heading.data", True),
        (NAMES, "forward_m_s", False),
        (("left_m_s", "right_rad_s"), "yaw_rate_rad_s", False),
        (("steer", "throttle"), "yaw_rate_rad_s", False),
    ],
)
def test_channel_names_identify_belts_and_turns(inputs: tuple[str, str], output: str, expected: bool) -> None:
    record = replace(driven(vehicle(), 5), input_names=inputs, output_names=(output,))
    assert fit(record, order=1).report.mirrored is expected


@pytest.mark.parametrize("method", ["okid-era", "pbsid"])
def test_a_named_method_fits_both_belts(method: str) -> None:
    found = fit(driven(vehicle(), 6), order=1, method=method)
    assert not found.report.mirrored
    assert found.model.B[0, 0] != -found.model.B[0, 1]


def test_the_operating_point_lies_between_the_belts_own_means() -> None:
    plant = replace(vehicle(), output_names=("yaw",), input_offset=np.array([0.0, 0.08]), output_offset=np.array([0.3]))
    record = replace(driven(plant, 7, samples=600, noise=0.02), input_names=("left", "right"))
    model = fit(record, order=1).model
    # No drive separates offsets of belts and output; with the right belt faster by 0.08 the output is 0.3.
    np.testing.assert_allclose(model.input_offset.mean(), record.u.mean(axis=0).mean(), atol=1e-9)
    still = np.linalg.solve(np.eye(1) - model.A, model.B @ (np.array([0.0, 0.08]) - model.input_offset))
    declared = model.output_offset + model.C @ still + model.D @ (np.array([0.0, 0.08]) - model.input_offset)
    np.testing.assert_allclose(declared, 0.3, atol=0.01)


def test_intervals_of_both_belts_are_those_of_their_difference() -> None:
    within, plant = [], vehicle()
    for seed in range(25):
        found = fit(driven(plant, 100 + seed, samples=400), order=1)
        intervals = found.intervals
        spread = intervals.impulse(6)
        np.testing.assert_allclose(spread[:, :, 0], spread[:, :, 1])
        off = np.abs(impulse_response(found.model, 6) - impulse_response(plant, 6))
        within.append(off[1, 0] < 1.96 * spread[1, 0])
    # 95 of 100 are contained; below 82 % of 25 runs is three standard deviations less.
    assert np.mean(within) > 0.82


def test_dead_time_is_removed_before_the_belts_are_combined() -> None:
    record = driven(vehicle(), 8, samples=400)
    late = replace(record, u=record.u[:-2], y=record.y[:-2])
    late = replace(late, y=np.vstack([np.zeros((2, 1)), late.y[:-2]]))
    found = fit(late, order=1, delays=[2, 2])
    assert found.report.mirrored
    np.testing.assert_allclose(impulse_response(found.model, 22)[2:], impulse_response(vehicle(), 20), atol=0.1)


def test_samples_before_the_dead_time_do_not_affect_the_input_structure() -> None:
    """Test: the samples before the dead time, which are left out, differ strongly from the rest. Expected result: the same input
    structure and intervals as for the data shifted by hand."""
    record = driven(vehicle(), 10, samples=300)
    u, y = np.vstack([record.u, np.zeros((2, 2))]), np.vstack([np.ones((2, 1)), record.y])
    declared = fit(replace(record, u=u, y=y), order=1, delays=[2, 2])
    by_hand = fit(record, order=1)
    assert declared.report.mirrored
    np.testing.assert_allclose(impulse_response(declared.model, 22)[2:], impulse_response(by_hand.model, 20), atol=1e-9)
    np.testing.assert_allclose(declared.intervals.impulse(10), by_hand.intervals.impulse(10), rtol=1e-6)


@pytest.mark.parametrize("method", ["okid-era", "pbsid"])
def test_the_gram_matrix_of_a_record_with_gaps_has_the_fitted_windows(method: str) -> None:
    record = driven(vehicle(), 11, samples=3000)
    record.y[::20] = np.nan
    found = fit(record, method=method)
    assert found.gram.count == found.report.samples
    again = fit(record, method=method, prior=found.gram)
    assert again.report.samples == 2 * found.report.samples


def test_belts_with_equal_speeds_are_rejected() -> None:
    record = driven(vehicle(), 9)
    with pytest.raises(PoorExcitation, match="'left_m_s' and 'right_m_s' always differ by the same speed"):
        fit(replace(record, u=np.repeat(record.u[:, :1], 2, axis=1)), order=1)


@pytest.mark.parametrize("left_over_right", [-1.0, 0.0, 0.5])
@pytest.mark.parametrize("method", ["best", "okid-era"])
def test_belts_that_move_together_are_fitted_by_their_difference(left_over_right: float, method: str) -> None:
    plant = vehicle()
    u = driven(plant, 9, samples=400).u[:, 1:] * [left_over_right, 1.0]
    record = InputOutputRecord(
        u=u, y=simulate(plant, u, np.zeros(1)), dt_s=plant.dt_s, input_names=NAMES, output_names=plant.output_names
    )
    found = fit(record, order=1, method=method)
    assert found.report.mirrored
    assert "move each belt by itself" in found.report.warnings[0]
    np.testing.assert_allclose(impulse_response(found.model, 10), impulse_response(plant, 10), atol=1e-6)
