"""Regression on many lags under a prior that decays with the lag, its strength chosen by the evidence of the data.

The observer of measured data has long memory; with few samples, plain least squares on many lags follows the noise, and a
choice of few lags cuts the memory off. Here all lags stay, and each coefficient has a prior variance relative to the noise:
``λ decay^(i-1)`` at lag i (a Minnesota prior: Litterman, 1986; in system identification a tuned/correlated kernel: Pillonetto and
De Nicolao, 2010). With a conjugate prior the evidence is known in closed form, and a function of the Gram matrix alone:
``-N/2 log|S| - p/2 Σ log(1 + λ v_i)``, with v_i the eigenvalues of the weighted Gram matrix and S the penalised residual.
"""

import numpy as np
from jaxtyping import Float

from treadline.identification._gram import Gram
from treadline.identification._limits import ROUNDING

DECAYS = (0.7, 0.9, 1.0)
"""Ratios of prior variances of successive lags: a memory of about three lags, of about ten, and of all."""
STRENGTHS = 10.0 ** np.arange(-4.0, 5.5, 0.5)
"""Prior variances tried, relative to the noise, for channels in standard deviations: from no coefficient to no penalty."""


def decaying_ridge(data: Gram, decay: float, *, feedthrough: bool) -> tuple[Float[np.ndarray, "q p"], float]:
    """Return the coefficients on ``[1, u_k, z_{k-1}, …, z_{k-p}]``, or without u_k, and the logarithm of their evidence.

    Args:
        data: Gram matrix; all its lags are used.
        decay: Ratio of the prior variances of successive lags; 1 is an ordinary ridge.
        feedthrough: Whether u_k is a regressor.
    """
    m, r = data.units.input_count, len(data.units.scale)
    columns = np.concatenate([np.arange(1, 1 + m if feedthrough else 1), np.arange(1 + r, len(data.sums))])
    lag = np.concatenate([np.zeros(m if feedthrough else 0), np.repeat(np.arange(data.lags), r)])
    outputs = np.arange(1 + m, 1 + r)
    mean = data.sums[0] / data.count
    about_mean = data.sums - data.count * np.outer(mean, mean)  # the constant has no prior: it is eliminated
    XX, XY, YY = (about_mean[np.ix_(*at)] for at in ((columns, columns), (columns, outputs), (outputs, outputs)))
    weight = decay ** (0.5 * lag)
    v, Q = np.linalg.eigh(XX * weight[:, None] * weight)
    v, seen = np.maximum(v, 0.0), Q.T @ (XY * weight[:, None])
    evidence, strength = max((_evidence(v, seen, YY, data.count, one), one) for one in STRENGTHS)
    theta = weight[:, None] * (Q @ (seen / (v + 1.0 / strength)[:, None]))
    return np.vstack([mean[outputs] - mean[columns] @ theta, theta]), evidence


def _evidence(
    v: Float[np.ndarray, " q"], seen: Float[np.ndarray, "q p"], YY: Float[np.ndarray, "p p"], count: float, strength: float
) -> float:
    """Return the logarithm of the evidence of a prior, up to a constant."""
    p = len(YY)
    left = YY / count - (seen / (v + 1.0 / strength)[:, None]).T @ seen / count
    _, size = np.linalg.slogdet(0.5 * (left + left.T) + ROUNDING * np.eye(p))
    return float(-0.5 * count * size - 0.5 * p * np.log1p(strength * v).sum())
