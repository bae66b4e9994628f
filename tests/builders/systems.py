"""Plants with known truth for identification, records of them, and the error of what is found."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.linear_systems import impulse_response, simulate
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification import IdentificationOptions, Identified, identify

Draw = Callable[..., InputOutputRecord]
"""The fixture ``draw``: a record of Eq. (12) for a seed."""
STEPS = 20
"""Number of Markov parameters compared; the slower pole of Eq. (12), 0.71, has decayed to a thousandth by then."""


def system(A: Any, B: Any, C: Any, D: Any = None, *, dt_s: float = 1.0, **fields: Any) -> LinearModel:
    """Return a model without offsets and, unless ``D`` is given, without feedthrough."""
    A, B, C = (np.array(matrix, dtype=float) for matrix in (A, B, C))
    p, m = len(C), B.shape[1]
    D = np.zeros((p, m)) if D is None else np.array(D, dtype=float)
    at_zero = {"input_offset": np.zeros(m), "output_offset": np.zeros(p)}
    return LinearModel(A=A, B=B, C=C, D=D, dt_s=dt_s, **(at_zero | fields))


def oscillation(radius: float, angle_rad: float) -> Float[np.ndarray, "2 2"]:
    """Return the state transition with the poles radius · e^(±i angle)."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return radius * np.array([[c, s], [-s, c]])


def white_record(plant: LinearModel, seed: int, samples: int, noise: float = 0.0) -> InputOutputRecord:
    """Return a record under white inputs; the outputs have noise of a share of their deviation."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, plant.B.shape[1]))
    y = simulate(plant, u, np.zeros(plant.order))
    return InputOutputRecord(u=u, y=y + noise * y.std(axis=0) * rng.standard_normal(y.shape), dt_s=plant.dt_s)


def noise_record(seed: int, samples: int, inputs: int = 2, outputs: int = 2, dt_s: float = 1.0) -> InputOutputRecord:
    """Return a record of outputs that no input moves."""
    rng = np.random.default_rng(seed)
    return InputOutputRecord(u=rng.standard_normal((samples, inputs)), y=rng.standard_normal((samples, outputs)), dt_s=dt_s)


def fit(data: InputOutputRecord | Sequence[InputOutputRecord], **options: Any) -> Identified:
    """Identify with options given by name."""
    return identify(data, IdentificationOptions(**options))


def markov_error(model: LinearModel, true: LinearModel) -> float:
    """Return ‖Y - Ŷ‖/‖Y‖ over the Markov parameters, independent of the choice of states."""
    expected = impulse_response(true, STEPS)
    return float(np.linalg.norm(impulse_response(model, STEPS) - expected) / np.linalg.norm(expected))
