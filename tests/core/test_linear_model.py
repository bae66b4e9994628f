"""Methods of a linear model against hand-made recursions, SciPy and python-control."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.polynomial import polynomial
from scipy import signal
from systems import oscillation, system, white_record

import treadline as tl
from treadline.core.errors import ModelError, PeriodMismatch, RecordError
from treadline.core.linear_systems import impulse_response, initial_state, prefix, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.other_libraries import as_matlab, as_python, as_transfer_function, transfer_functions
from treadline.core.printing import percent_text
from treadline.core.state_space import record_of

GAIN = np.array([[0.3, 0.1], [0.0, 0.2], [0.1, 0.0]])


def plant(seed: int = 0, **fields: Any) -> LinearModel:
    """Return a stable system of three states, two inputs and two outputs with offsets and feedthrough."""
    rng = np.random.default_rng(seed)
    A = np.zeros((3, 3))
    A[:2, :2], A[2, 2] = oscillation(0.8, 0.5), 0.6
    B, C, D = rng.standard_normal((3, 2)), rng.standard_normal((2, 3)), rng.standard_normal((2, 2))
    at = {"input_offset": np.array([0.2, 0.1]), "output_offset": np.array([1.0, -1.0]), "observer_gain": GAIN}
    return system(A, B, C, D, dt_s=0.1, **(at | fields))


def by_hand(model: LinearModel, u: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Return the outputs of the difference equation, one sample after the other."""
    x, outputs = x0.copy(), []
    v = u - model.input_offset
    for k in range(len(u)):
        now = np.array([v[k - d, j] if k >= d else 0.0 for j, d in enumerate(model.input_delay)])
        outputs.append(model.C @ x + model.D @ now + model.output_offset)
        x = model.A @ x + model.B @ now
    return np.array(outputs)


@pytest.mark.parametrize("delay", [(), (0, 3), (2, 1), (70, 2)])
def test_a_simulation_is_the_difference_equation(delay: tuple[int, ...]) -> None:
    model, rng = plant(input_delay=delay), np.random.default_rng(1)
    u, x0 = rng.standard_normal((50, 2)), rng.standard_normal(3)
    np.testing.assert_allclose(model.simulate(u, x0), by_hand(model, u, x0), atol=1e-12)
    np.testing.assert_allclose(model.simulate(u), by_hand(model, u, np.zeros(3)), atol=1e-12)


@pytest.mark.parametrize("delay", [(), (0, 3)])
def test_the_frequency_response_is_that_of_scipy(delay: tuple[int, ...]) -> None:
    model = plant(input_delay=delay)
    f = np.linspace(0.01, 4.9, 40)
    z = np.exp(2j * np.pi * f * model.dt_s)
    for i, j, numerator, denominator in transfer_functions(model):
        _, expected = signal.freqz(numerator, denominator, worN=2.0 * np.pi * f * model.dt_s)
        # freqz counts powers of 1/z, the transfer function powers of z: of the same degree they agree.
        np.testing.assert_allclose(model.bode(f).response[:, i, j], expected * z ** -model.input_delay[j], rtol=1e-9)
    response = model.bode(f)
    np.testing.assert_allclose(response.magnitude * np.exp(1j * response.phase_rad), response.response, rtol=1e-12)
    assert np.abs(np.diff(response.phase_rad, axis=0)).max() < np.pi


def test_a_frequency_above_nyquist_is_refused() -> None:
    with pytest.raises(ModelError, match="6 Hz lies above the Nyquist frequency of 5 Hz"):
        plant().bode([1.0, 6.0])


@pytest.mark.parametrize("delay", [(), (4, 0), (1, 30)])
def test_a_step_response_is_the_cumulated_impulse_response_and_settles_at_the_static_gain(delay: tuple[int, ...]) -> None:
    model = plant(input_delay=delay)
    (t_s, step), (_, impulse) = model.step(200), model.impulse(200)
    np.testing.assert_allclose(step, np.cumsum(impulse, axis=0))
    np.testing.assert_allclose(step[-1], model.dcgain(), atol=1e-9)
    assert t_s[1] == model.dt_s
    at_rest = model.simulate(np.tile(model.input_offset + np.array([1.0, 0.0]), (200, 1))) - model.output_offset
    np.testing.assert_allclose(step[:, :, 0], at_rest, atol=1e-12)


def test_a_chair_has_an_infinite_gain_to_its_heading_and_a_finite_one_to_its_yaw_rate() -> None:
    chair = system([[1.0, 0.25], [0.0, 0.5]], [[0.0, 0.0], [-0.6, 0.6]], np.eye(2))
    np.testing.assert_allclose(chair.dcgain(), [[-np.inf, np.inf], [-1.2, 1.2]])
    twice = system([[1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.5]], [[0.0], [1.0], [1.0]], [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(twice.dcgain(), [[np.inf], [2.0]])


@pytest.mark.parametrize("library", ["scipy", "control"])
@pytest.mark.parametrize("delay", [(), (2, 0), (1, 3)])
def test_a_state_space_object_of_another_library_has_the_same_impulse_response(library: str, delay: tuple[int, ...]) -> None:
    if library == "control":
        pytest.importorskip("control")
    model = plant(input_delay=delay)
    other = model.to_statespace(library)
    again = system(other.A, other.B, other.C, other.D, dt_s=other.dt)
    np.testing.assert_allclose(again.impulse(30).y, model.impulse(30).y, atol=1e-12)
    assert again.dt_s == model.dt_s
    with pytest.raises(ModelError, match="library is 'matlab'; allowed: control, scipy"):
        model.to_statespace("matlab")


def test_zeros_of_a_single_channel_are_the_roots_of_its_numerator() -> None:
    known = np.array([0.5, -1.2])
    A, B, C, D = signal.zpk2ss(known, [0.9, 0.3 + 0.2j, 0.3 - 0.2j, 0.1], 2.0)
    np.testing.assert_allclose(np.sort(system(A, B, C, D).zeros().real), np.sort(known), atol=1e-9)
    assert plant().poles().tolist() == sorted(plant().poles().tolist(), key=abs, reverse=True)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("feedthrough", [True, False])
def test_at_a_transmission_zero_the_system_matrix_loses_rank(seed: int, feedthrough: bool) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = 0.4 * rng.standard_normal((6, 6)), rng.standard_normal((6, 2)), rng.standard_normal((2, 6))
    model = system(A, B, C, rng.standard_normal((2, 2)) if feedthrough else None)
    zeros = model.zeros()
    assert len(zeros) == (6 if feedthrough else 4)  # without D, two inputs cost two zeros
    for zero in zeros:
        pencil = np.block([[A - zero * np.eye(6), B], [C, model.D]])
        assert np.linalg.svd(pencil, compute_uv=False)[-1] < 1e-9


def test_zeros_that_all_channels_share_survive_more_outputs_than_inputs() -> None:
    A, B, C, D = signal.zpk2ss([0.5], [0.9, 0.2], 1.0)
    tall = system(A, B, np.vstack([C, -3.0 * C]), np.vstack([D, -3.0 * D]))
    np.testing.assert_allclose(tall.zeros(), [0.5], atol=1e-9)
    wide = system(A.T, tall.C.T, B.T, tall.D.T)
    np.testing.assert_allclose(wide.zeros(), [0.5], atol=1e-9)
    assert system(A, B, np.eye(2)).zeros().size == 0


@pytest.mark.parametrize("horizon", [1, 2, 7])
@pytest.mark.parametrize("delay", [(), (0, 2)])
def test_a_prediction_knows_no_output_of_the_last_samples(horizon: int, delay: tuple[int, ...]) -> None:
    model = plant(input_delay=delay)
    record = white_record(model, 3, 400, noise=0.1)
    before = model.predict(record, horizon=horizon)
    record.y[200] += 1.0
    change = np.abs(model.predict(record, horizon=horizon) - before).max(axis=1)
    assert np.nanmax(change[: 200 + horizon]) == 0.0
    assert change[200 + horizon] > 1e-3


def test_a_prediction_over_the_whole_record_is_a_free_run_from_the_first_state() -> None:
    model = plant()
    record = white_record(model, 3, 300)
    np.testing.assert_allclose(model.predict(record, horizon=300), record.y, atol=1e-9)
    with pytest.raises(RecordError, match="horizon is 0"):
        model.predict(record, horizon=0)


def test_the_initial_state_continues_a_record(tmp_path: Path) -> None:
    model, u = plant(), np.random.default_rng(5).standard_normal((60, 2))
    x0 = np.array([1.0, -2.0, 3.0])
    y = simulate(model, u, x0)
    np.testing.assert_allclose(initial_state(model, record_of(u, y, model.dt_s)), x0, atol=1e-9)
    model.save(tmp_path / "model.json")
    np.testing.assert_array_equal(tl.load_model(tmp_path / "model.json").simulate(u, x0), y)


def test_a_result_answers_for_its_model_and_compares_with_its_own_data() -> None:
    record = white_record(plant(), 0, 600, noise=0.01)
    found = tl.identify(record.u, record.y, record.dt_s, order=3, method="okid-era", validation=0.5)
    assert len(found.compare().measured) == 300
    np.testing.assert_array_equal(found.simulate(record.u), found.model.simulate(record.u))
    with pytest.raises(AttributeError, match="no 'simulat', nor has its model"):
        found.simulat(record.u)
    with pytest.raises(RecordError, match="the data have 1 inputs and 2 outputs, the model has 2 and 2"):
        found.predict(record.u[:, :1], record.y)
    with pytest.raises(RecordError, match=r"period of 0.2 s, the model 0.1 s; resample"):
        found.compare(InputOutputRecord(u=record.u, y=record.y, dt_s=0.2))
    with pytest.raises(RecordError, match=r"u is of shape \(600, 1\); wanted one row per sample and 2 columns"):
        found.simulate(record.u[:, :1])
    with pytest.raises(ModelError, match=r"x0 is of shape \(2,\); wanted 3 states"):
        found.simulate(record.u, [1.0, 2.0])


def test_a_comparison_scores_what_the_start_has_not_seen() -> None:
    model = plant()
    record = white_record(model, 3, 400)
    found = model.compare(record)
    assert found.fit_prefix_s == pytest.approx(4.0)
    assert found.samples == 360
    assert min(found.fit_percent.values()) > 100.0 - 1e-6
    assert found.forecast_percent is None
    assert "from the state of the first 4 s, scored on the 360 samples after them" in repr(found)
    # Outputs of the prefix move the start, and nothing else; those after it move nothing.
    late = InputOutputRecord(u=record.u, y=record.y + np.where(np.arange(400) < 40, 0.0, 5.0)[:, None], dt_s=0.1)
    np.testing.assert_allclose(model.compare(late).modelled, found.modelled, atol=1e-12)
    assert len(found.plot().axes) == 4


def test_the_start_is_not_chosen_with_hindsight() -> None:
    """A slow mode that the plant lacks could bend the run onto any drift, if the whole record chose the start."""
    slow = system(np.diag([0.999, 0.5]), [[0.0], [1.0]], [[1.0, 1.0]], dt_s=1.0)
    rng = np.random.default_rng(0)
    u = rng.standard_normal(1000)
    drift = np.concatenate([np.zeros(100), np.full(900, 3.0)])
    y = slow.simulate(u)[:, 0] + drift
    bent = slow.simulate(u, initial_state(slow, record_of(u, y, slow.dt_s)))[:, 0]
    assert np.linalg.norm((y - bent)[100:]) < 0.6 * np.linalg.norm((y - slow.compare(u, y).modelled[:, 0])[100:])


def test_an_unstable_model_gets_a_forecast_of_stated_length() -> None:
    plant_ = system([[1.05]], [[1.0]], [[1.0]], dt_s=0.5, observer_gain=np.array([[0.5]]))
    rng = np.random.default_rng(0)
    y, u = np.zeros(300), np.zeros(300)
    for k in range(299):
        u[k] = -0.3 * y[k] + rng.standard_normal()
        y[k + 1] = 1.05 * y[k] + u[k]
    found = plant_.compare(u, y)
    assert found.fit_percent is None
    assert found.forecast_horizon_s == 15.0  # a tenth of the record; 3 / ln 1.05 would be 61 samples
    assert found.percent["y1"] > 99.0
    assert "forecast 15 s ahead (unstable model)" in repr(found)


def test_a_prefix_is_a_tenth_or_enough_for_the_state() -> None:
    assert prefix(1000, 2, 2) == 100
    assert prefix(100, 20, 2) == 30  # three values per state
    assert prefix(100, 60, 1) == 50  # never more than half


def test_a_pair_is_the_model_of_one_input_and_one_output() -> None:
    model = plant(input_delay=(0, 2), input_names=("a", "b"), output_names=("c", "d"))
    pair = model.pair(1, 1)
    assert (pair.input_names, pair.output_names, pair.input_delay) == (("b",), ("d",), (2,))
    np.testing.assert_allclose(impulse_response(pair, 20)[:, 0, 0], impulse_response(model, 20)[:, 1, 1], atol=1e-14)


def test_a_copied_model_is_the_model() -> None:
    model = plant(input_delay=(0, 2), input_names=("left_m_s", "o'right"), output_names=("a", "b"))
    copy: dict[str, Any] = {}
    exec(as_python(model), copy)  # noqa: S102 - the text under test
    np.testing.assert_array_equal(copy["model"].impulse(20).y, model.impulse(20).y)
    assert copy["model"].input_names == model.input_names
    text = as_matlab(model)
    assert f"A = [{' '.join(repr(float(value)) for value in model.A[0])};" in text
    assert "ss(A, B, C, D, 0.1, 'InputDelay', [0, 2])" in text
    assert "{'left_m_s', 'o''right'}" in text


def test_a_transfer_function_in_words_is_that_of_the_model() -> None:
    lag = system([[0.5]], [[1.0]], [[2.0]], [[1.0]], input_delay=(3,))
    assert as_transfer_function(lag, ["u"], ["y"]).splitlines()[1] == "y / u = (z + 1.5) / (z - 0.5) z^-3"
    for i, j, numerator, denominator in transfer_functions(plant()):
        at_one = polynomial.polyval(1.0, numerator[::-1]) / polynomial.polyval(1.0, denominator[::-1])
        assert at_one == pytest.approx(plant().dcgain()[i, j])


def test_nothing_draws_before_a_figure_is_asked_for() -> None:
    code = "import sys, treadline as tl; tl.LinearModel; print('matplotlib' in sys.modules, 'scipy.signal' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.split() == ["False", "False"]
    assert all(figure.axes for figure in (plant().step().plot(), plant().bode().plot(), plant().plot()))


def test_the_size_of_a_diverging_error_is_not_printed() -> None:
    assert [percent_text(value) for value in (91.23, -3.0, -1e9, -np.inf, np.nan)] == ["91.2 %", "-3.0 %", *["below -100 %"] * 3]


@pytest.mark.parametrize("delay", [(), (8, 4)])
def test_a_resampled_model_meets_the_outputs_at_the_samples_that_both_have(delay: tuple[int, ...]) -> None:
    model = plant(input_delay=delay)
    slow = model.resampled(0.2)
    u = np.random.default_rng(2).standard_normal((60, 2))
    np.testing.assert_allclose(slow.simulate(u), model.simulate(np.repeat(u, 2, axis=0))[::2], atol=1e-10)
    back = slow.resampled(0.1)
    np.testing.assert_allclose(back.impulse(40).y, model.impulse(40).y, atol=1e-10)
    with pytest.raises(PeriodMismatch, match="pole at or below zero, and no counterpart at another period"):
        system([[-0.5]], [[1.0]], [[1.0]]).resampled(0.5)
    with pytest.raises(PeriodMismatch, match=r"the period is 0\.0 s; it must be positive"):
        model.resampled(0.0)


def test_a_model_in_continuous_time_is_sampled_to_the_model() -> None:
    model = plant()
    other = model.to_continuous("scipy")
    sampled = other.to_discrete(model.dt_s)
    for name in "ABCD":
        np.testing.assert_allclose(getattr(sampled, name), getattr(model, name), atol=1e-12)
    integrator = system([[1.0]], [[0.1]], [[1.0]], dt_s=0.1).to_continuous("scipy")
    np.testing.assert_allclose([integrator.A, integrator.B], [[[0.0]], [[1.0]]], atol=1e-12)
    with pytest.raises(ModelError, match=r"input_delay is \[0, 3\] samples: a dead time has no states"):
        plant(input_delay=(0, 3)).to_continuous()


@pytest.mark.parametrize("delay", [(), (0, 3)])
@pytest.mark.parametrize("feedthrough", [1.0, 0.0])
def test_a_transfer_function_has_the_frequency_response_of_the_model(delay: tuple[int, ...], feedthrough: float) -> None:
    model, omega = plant(input_delay=delay), np.linspace(0.01, 3.1, 50)
    model = replace(model, D=feedthrough * model.D)
    for i, j in np.ndindex(2, 2):
        _, response = model.transfer_function(i, j).freqresp(omega)
        np.testing.assert_allclose(response, model.bode(omega / (2.0 * np.pi * 0.1)).response[:, i, j], rtol=1e-8)
    with pytest.raises(ModelError, match="no output 2 with input 0: 2 outputs and 2 inputs"):
        model.transfer_function(2)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("delay", [0, 3, 40])
def test_at_its_margins_a_loop_has_a_pole_on_the_unit_circle(seed: int, delay: int) -> None:
    model = replace(plant(seed), D=np.zeros((2, 2)), input_delay=(0, delay))
    found = model.margins(1, 1)
    # With dead time as states: the closed loop, and the loop gain at the frequencies that are named.
    A, B, C, _ = (np.asarray(getattr(model.to_statespace("scipy"), name)) for name in "ABCD")
    poles = np.linalg.eigvals(A - found.gain * B[:, 1:] @ C[1:])
    assert np.abs(np.abs(poles) - 1.0).min() < 1e-6
    assert np.abs(poles - np.exp(2j * np.pi * found.gain_frequency_hz * 0.1)).min() < 1e-5
    if np.isfinite(found.phase_rad):
        loop = complex(model.bode([found.phase_frequency_hz]).response[0, 1, 1])
        assert abs(1.0 + loop * np.exp(-1j * found.phase_rad)) < 1e-8
    assert not np.isfinite(system([[0.5]], [[1e-6]], [[1.0]]).margins().phase_rad)
