"""Fixtures: Eq. (12) as a model with known truth, and records simulated from it."""

import numpy as np
import pytest
from systems import Draw, system

from treadline.core import paper
from treadline.core.linear_systems import simulate
from treadline.core.models import InputOutputRecord, LinearModel

NAMES = {"input_names": ("left_m_s", "right_m_s"), "output_names": ("heading", "yaw_rate")}


@pytest.fixture(scope="session")
def eq_12() -> LinearModel:
    return system(paper.A, paper.B, paper.C, paper.D, dt_s=paper.SAMPLING_TIME_S)


@pytest.fixture(scope="session")
def draw(eq_12: LinearModel) -> Draw:
    """Return a function that simulates a record of Eq. (12) under random inputs."""

    def record(seed: int, *, samples: int = 1000, noise: float = 0.0, x0: np.ndarray | None = None) -> InputOutputRecord:
        rng = np.random.default_rng(seed)
        u = rng.standard_normal((samples, 2))
        y = simulate(eq_12, u, np.zeros(2) if x0 is None else x0)
        y = y + noise * y.std(axis=0) * rng.standard_normal(y.shape)
        return InputOutputRecord(u=u, y=y, dt_s=paper.SAMPLING_TIME_S, **NAMES)

    return record
