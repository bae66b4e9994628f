"""The stabilisation diagram separates system poles from spurious poles."""

import math

import numpy as np
import pytest
from jaxtyping import Float
from scipy.linalg import block_diag
from systems import oscillation, system

import treadline as tl
from treadline.core.linear_systems import impulse_response
from treadline.core.models import LinearModel
from treadline.core.transfer_function import StabilisationDiagram
from treadline.identification._era import HankelSvd, realise
from treadline.identification.stabilisation import modes, stabilisation_of_svd

DT_S = 0.02
FREQUENCIES_HZ = (2.1, 5.7, 11.3)
DAMPINGS = (0.02, 0.01, 0.015)


@pytest.fixture(scope="module")
def modal() -> LinearModel:
    """Three lightly damped modes, two inputs, two outputs."""
    rng = np.random.default_rng(3)
    pairs = zip(2.0 * math.pi * DT_S * np.array(FREQUENCIES_HZ), DAMPINGS, strict=True)
    A = block_diag(*(oscillation(math.exp(-zeta * omega), omega * math.sqrt(1.0 - zeta**2)) for omega, zeta in pairs))
    return system(A, rng.standard_normal((6, 2)), rng.standard_normal((2, 6)), dt_s=DT_S)


@pytest.fixture(scope="module")
def noisy(modal: LinearModel) -> StabilisationDiagram:
    """The diagram of the impulse response with 1 % noise."""
    markov = impulse_response(modal, 121)
    rng = np.random.default_rng(4)
    markov += 0.01 * markov.std() * rng.standard_normal(markov.shape)
    return stabilisation_of_svd(HankelSvd(markov=markov, rows=60, columns=60), DT_S, 20)


def at(diagram: StabilisationDiagram, frequency_hz: float, order: int) -> Float[np.ndarray, " k"]:
    """Return the indices of the poles of one order within 1 % of a frequency."""
    near = np.abs(diagram.frequency_hz / frequency_hz - 1.0) < 0.01
    return np.flatnonzero(near & (diagram.order == order))


@pytest.mark.parametrize(("frequency", "damping"), [*zip(FREQUENCIES_HZ, DAMPINGS, strict=True)])
def test_a_true_pole_stabilises_at_its_frequency_and_damping(noisy: StabilisationDiagram, frequency: float, damping: float) -> None:
    found = 0
    for order in range(7, 21):
        place = at(noisy, frequency, order)
        assert noisy.frequency_stable[place].any()
        best = place[np.argmin(np.abs(noisy.damping[place] - damping))]
        # 120 samples of two outputs with 1 % noise determine a damping of 1 % to about a tenth.
        assert noisy.damping[best] == pytest.approx(damping, rel=0.3)
        found += int(noisy.damping_stable[best])
    assert found >= 12


def test_spurious_poles_do_not_stabilise(noisy: StabilisationDiagram) -> None:
    true = np.array([np.abs(noisy.frequency_hz / frequency - 1.0) < 0.02 for frequency in FREQUENCIES_HZ]).any(axis=0)
    spurious = ~true & (noisy.order > 7)
    assert spurious.sum() > 20
    # Some are within 1 % and 5 % by chance.
    assert noisy.damping_stable[spurious].mean() < 0.2


def test_without_noise_the_diagram_ends_at_the_true_order(modal: LinearModel) -> None:
    svd = HankelSvd(markov=impulse_response(modal, 121), rows=60, columns=60)
    diagram = stabilisation_of_svd(svd, DT_S)
    assert diagram.order.max() == 6
    last = diagram.order == 6
    np.testing.assert_allclose(np.sort(diagram.frequency_hz[last]), FREQUENCIES_HZ, rtol=1e-8)


def test_the_result_of_a_fit_draws_its_diagram(modal: LinearModel) -> None:
    u = np.random.default_rng(5).standard_normal((2000, 2))
    found = tl.identify(u, modal.simulate(u), DT_S, order=6, method="okid-era", lags=12)
    diagram = found.stabilisation()
    assert (diagram.chosen, diagram.nyquist_hz) == (6, 25.0)
    np.testing.assert_allclose(np.sort(diagram.frequency_hz[diagram.order == 6]), FREQUENCIES_HZ, rtol=1e-6)
    assert len(diagram.plot().axes) == 2


def test_leading_blocks_are_the_models_that_era_realises(modal: LinearModel) -> None:
    markov = impulse_response(modal, 41) + 1e-3 * np.random.default_rng(0).standard_normal((41, 2, 2))
    svd = HankelSvd(markov=markov, rows=20, columns=20)
    one_by_one = np.hstack([modes(np.linalg.eigvals(realise(svd, order)[0]).astype(complex), DT_S) for order in range(1, 13)])
    at_once = stabilisation_of_svd(svd, DT_S, 12)
    np.testing.assert_allclose([at_once.frequency_hz, at_once.damping], one_by_one, rtol=1e-6)


def test_a_pole_stable_in_damping_is_stable_in_frequency(noisy: StabilisationDiagram) -> None:
    assert not (noisy.damping_stable & ~noisy.frequency_stable).any()
    # The lowest order has nothing below it to be stable against.
    assert not noisy.frequency_stable[noisy.order == noisy.order.min()].any()


def test_modes_of_special_poles() -> None:
    # A growing pole has negative damping; an integrator has frequency zero; a pole at zero has no mode; a pair counts once.
    frequency, damping = modes(np.array([0.5, 1.0, 1.1, 0.0, -0.5, 0.9j, -0.9j]).astype(complex), 0.5)
    np.testing.assert_allclose(damping[:3], [1.0, 0.0, -1.0])
    assert frequency[1] == 0.0
    assert len(frequency) == 5
    assert frequency[0] == pytest.approx(math.log(2.0) / math.pi)
