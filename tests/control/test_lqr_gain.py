"""Eq. (10) to (14): the LQR gain and the static reconstruction."""

import numpy as np
import pytest

from treadline.control import lqr_gain
from treadline.control.lqr import static_reconstruction
from treadline.core import paper
from treadline.core.errors import NotDefinite, NotInvertible, NotStabilisable, ShapeMismatch


def test_gain_is_the_one_in_eq_14() -> None:
    K = lqr_gain(paper.A, paper.B, paper.Q, paper.R)
    # The paper prints A and B to four decimals, so K is known to about 3e-4.
    np.testing.assert_allclose(K, paper.K, atol=5e-4)


def test_static_reconstruction_inverts_eq_11b() -> None:
    inverse = static_reconstruction(paper.C, paper.D, paper.K)
    np.testing.assert_allclose(inverse @ (paper.C - paper.D @ paper.K), np.eye(2), atol=1e-12)


def test_an_uncontrollable_unstable_model_is_rejected() -> None:
    with pytest.raises(NotStabilisable):
        lqr_gain(np.diag([1.2, 0.5]), np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))


def test_a_free_input_is_rejected() -> None:
    with pytest.raises(NotDefinite):
        lqr_gain(paper.A, paper.B, paper.Q, np.zeros((2, 2)))


def test_fewer_outputs_than_states_cannot_be_inverted() -> None:
    with pytest.raises(NotInvertible):
        static_reconstruction(paper.C[:1], paper.D[:1], paper.K)


@pytest.mark.usefixtures("without_shape_checks")
def test_lists_are_matrices_too() -> None:
    K = lqr_gain(*(matrix.tolist() for matrix in (paper.A, paper.B, paper.Q, paper.R)))
    np.testing.assert_array_equal(K, lqr_gain(paper.A, paper.B, paper.Q, paper.R))


@pytest.mark.parametrize(
    ("A", "B", "message"),
    [
        (paper.A, [1.0, 0.0], r"B is of shape \(2,\); wanted a matrix"),
        (np.ones((2, 3)), paper.B, r"matrix A is \(2, 3\), A and B ask for \(2, 2\)"),
    ],
)
@pytest.mark.usefixtures("without_shape_checks")
def test_an_invalid_system_is_rejected(A: object, B: object, message: str) -> None:
    with pytest.raises(ShapeMismatch, match=message):
        lqr_gain(A, B, paper.Q, paper.R)
