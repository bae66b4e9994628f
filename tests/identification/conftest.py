"""Fixtures: Eq. (12) as a model with known truth, and records simulated from it."""

from collections.abc import Callable

import numpy as np
import pytest
from jaxtyping import Float

from treadline.core import paper
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification.validate import simulate

NAMES = {"input_names": ("left_m_s", "right_m_s"), "output_names": ("heading", "yaw_rate")}
Draw = Callable[..., InputOutputRecord]


@pytest.fixture(scope="session")
def eq_12() -> LinearModel:
    return LinearModel(
        A=paper.A.copy(),
        B=paper.B.copy(),
        C=paper.C.copy(),
        D=paper.D.copy(),
        dt_s=paper.SAMPLING_TIME_S,
        input_offset=np.zeros(2),
        output_offset=np.zeros(2),
    )


@pytest.fixture(scope="session")
def draw(eq_12: LinearModel) -> Draw:
    """Return a function that simulates a record of Eq. (12) under random inputs."""

    def record(
        seed: int,
        *,
        samples: int = paper.SAMPLES,
        noise: float = 0.0,
        x0: Float[np.ndarray, " 2"] | None = None,
    ) -> InputOutputRecord:
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((samples, 2))
        y = simulate(eq_12, u, np.zeros(2) if x0 is None else x0)
        y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
        return InputOutputRecord(u=u, y=y, dt_s=paper.SAMPLING_TIME_S, **NAMES)

    return record
