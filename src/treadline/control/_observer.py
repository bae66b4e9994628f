"""State observer with disturbance estimation, driven by the saturated belt speeds.

The observer uses the input after saturation, so that limits cause no windup. In addition to the model's state it estimates a
constant difference between commanded and effective inputs (a belt that runs 2 % fast), without which a proportional law
leaves a heading offset. See docs/decisions/0004-offset-free-heading.md.

With dead time the inputs sent wait in a queue and enter the observer when they act. The gain K of the plant without dead time
answers the state predicted to that moment, which the inputs under way determine. With one dead time for all inputs this is the
optimal gain of the plant with the queue as states; with any, the closed loop has the poles of A - BK and those of the queue, zero.
"""

import numpy as np
from jaxtyping import Float, Int

from treadline.control.lqr import solvable
from treadline.core.arrays import spectral_radius
from treadline.core.errors import NotDetectable
from treadline.core.models import LinearModel

DISTURBANCE_LIMIT = 0.2
"""Largest belt speed difference attributed to mismatch [m/s]: turning on a 30° stair gives 0.15, a chair slowed by the guard
increasingly more."""


def kalman_gain(
    A: Float[np.ndarray, "n n"],
    C: Float[np.ndarray, "p n"],
    process: Float[np.ndarray, "n n"],
    measurement: Float[np.ndarray, "p p"],
) -> Float[np.ndarray, "n p"]:
    """Return the steady-state predictor gain L of ``x[k+1] = A x[k] + L (y[k] - C x[k])``.

    Args:
        A: State transition matrix.
        C: Output matrix.
        process: Covariance of the process noise per period.
        measurement: Covariance of the measurement noise.

    Raises:
        NotDetectable: If no gain makes ``A - LC`` stable.
    """
    from scipy.linalg import solve_discrete_are  # here, because a climb, which loads this module, designs nothing

    # For an unobservable mode at the stability limit, rounding may give a useless solution of the equation, or none.
    undetectable = NotDetectable(
        f"no gain makes A - LC stable (spectral radius of A is {spectral_radius(A):.3f}); add an output that shows the slow state"
    )
    with solvable(undetectable):
        P = solve_discrete_are(A.T, C.T, process, measurement)
        L = A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + measurement)
    if not spectral_radius(A - L @ C) < 1.0:
        raise undetectable
    return np.asarray(L)


def with_disturbance(
    model: LinearModel, direction: Float[np.ndarray, " m"]
) -> tuple[Float[np.ndarray, "n1 n1"], Float[np.ndarray, "p n1"]]:
    """Return A and C of the model with a constant input disturbance as last state."""
    n = model.order
    A = np.eye(n + 1)
    A[:n, :n], A[:n, n] = model.A, model.B @ direction
    return A, np.column_stack([model.C, model.D @ direction])


class Observer:
    """Predictor-form observer around the model's offsets, with a constant input disturbance and a queue of the inputs under way.

    Inputs are deviations from the operating point. The disturbance acts along ``direction`` in the input space (for two belts:
    their difference) and is corrected by ``disturbance_gain`` times the innovation; None keeps it at zero.
    """

    def __init__(
        self,
        model: LinearModel,
        gain: Float[np.ndarray, "n p"],
        direction: Float[np.ndarray, " m"],
        disturbance_gain: Float[np.ndarray, " p"] | None,
    ) -> None:
        self._model = model
        self._gain = gain
        self._direction = direction
        self._disturbance_gain = disturbance_gain
        self._delay = np.array(model.input_delay)
        self._sent = np.zeros((max(model.input_delay) + 1, len(direction)))
        self.state = np.zeros(model.order)
        self.disturbance = 0.0

    def check(self) -> None:
        """Check that the estimation error decays.

        Raises:
            NotDetectable: If the error does not decay.
        """
        A, C, gain = self._model.A, self._model.C, self._gain
        if self._disturbance_gain is not None:
            A, C = with_disturbance(self._model, self._direction)
            gain = np.vstack([gain, self._disturbance_gain])
        radius = spectral_radius(A - gain @ C)
        if not radius < 1.0:
            raise NotDetectable(f"the design's observer has spectral radius {radius:.3f} and never converges; tune it again")

    def forget(self) -> None:
        """Reset the estimated disturbance and the inputs under way; ``start`` initialises the state."""
        self.disturbance = 0.0
        self._sent[:] = 0.0

    def send(self, u: Float[np.ndarray, " m"]) -> None:
        """Put the effective input of a period, a deviation from the operating point, into the queue."""
        self._sent = np.vstack([u, self._sent[:-1]])

    def start(self, y: Float[np.ndarray, " p"]) -> None:
        """Initialise the state by least squares from an output, at the model's operating point; the disturbance is kept."""
        self.state = np.linalg.pinv(self._model.C) @ (y - self._model.output_offset)

    def predicted(self) -> Float[np.ndarray, " p"]:
        """Return the model's output for the input that acted in the last period."""
        return np.asarray(self._model.output_offset + self._model.C @ self.state + self._model.D @ self._acting(self._delay))

    def update(self, y: Float[np.ndarray, " p"], *, learn: bool) -> None:
        """Advance one period with the input that acted in it.

        Args:
            y: Output at the start of the period.
            learn: Whether the disturbance estimate is updated; must be False for a saturated input or in the dead zone.
        """
        model = self._model
        innovation = y - self.predicted()
        self.state = model.A @ self.state + model.B @ self._acting(self._delay) + self._gain @ innovation
        if learn and self._disturbance_gain is not None:
            learned = self.disturbance + float(self._disturbance_gain @ innovation)
            self.disturbance = min(max(learned, -DISTURBANCE_LIMIT), DISTURBANCE_LIMIT)

    def expected(self) -> Float[np.ndarray, " p"]:
        """Return the expected output of this period, whose inputs without dead time are still to be chosen and count as zero."""
        model = self._model
        known = np.where(self._delay > 0, self._acting(np.maximum(self._delay - 1, 0)), 0.0)
        return np.asarray(model.output_offset + model.C @ self.state + model.D @ known)

    def answer(self, K: Float[np.ndarray, "m n"], state: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        """Return -K x for each input, x being the state when it will act.

        Args:
            K: Feedback gain.
            state: State of this period.
        """
        answer = -K @ state
        for ahead in range(max(self._delay)):
            # The input that acts so many periods from now, where it was sent; else the one that the law will send.
            under_way = self._acting(np.maximum(self._delay - 1 - ahead, 0))
            state = self._model.A @ state + self._model.B @ np.where(self._delay > ahead, under_way, -K @ state)
            answer = np.where(self._delay > ahead, -K @ state, answer)
        return np.asarray(answer)

    def _acting(self, ago: Int[np.ndarray, " m"]) -> Float[np.ndarray, " m"]:
        """Return the input sent some periods ago, with the disturbance that it meets."""
        return np.asarray(self._sent[ago, np.arange(len(ago))] + self.disturbance * self._direction)
