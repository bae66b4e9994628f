"""The Gram matrix of lagged inputs and outputs: all that OKID needs of the data, in one pass.

Rows of the regression are ``[1, u_k, z_{k-1}, …, z_{k-p}]`` with ``z = (u, y)``, targets ``y_k``. Sums of outer products
add up over chunks and over experiments; a window that holds a NaN is left out and counted. The constant column takes
the offsets, so that nobody has to subtract a mean that is not one.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.models import InputOutputRecord

CHUNK = 65536
"""Rows per pass: a few megabytes of regressors."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gram:
    """Sums over all whole windows of one or more experiments, channels scaled to unit deviation."""

    lags: int
    feedthrough: bool
    XX: Float[np.ndarray, "q q"]
    XY: Float[np.ndarray, "q p"]
    YY: Float[np.ndarray, "p p"]
    count: int
    dropped: int
    input_scale: Float[np.ndarray, " m"]
    output_scale: Float[np.ndarray, " p"]

    def __add__(self, other: "Gram") -> "Gram":
        return Gram(
            lags=self.lags,
            feedthrough=self.feedthrough,
            XX=self.XX + other.XX,
            XY=self.XY + other.XY,
            YY=self.YY + other.YY,
            count=self.count + other.count,
            dropped=self.dropped + other.dropped,
            input_scale=self.input_scale,
            output_scale=self.output_scale,
        )


def gram(
    record: InputOutputRecord,
    lags: int,
    *,
    feedthrough: bool,
    input_scale: Float[np.ndarray, " m"],
    output_scale: Float[np.ndarray, " p"],
) -> Gram:
    """Return the Gram matrix of one experiment."""
    u, y = record.u / input_scale, record.y / output_scale
    m, p = u.shape[1], y.shape[1]
    width = 1 + (m if feedthrough else 0) + lags * (m + p)
    XX, XY, YY = np.zeros((width, width)), np.zeros((width, p)), np.zeros((p, p))
    count = dropped = 0
    for start in range(lags, len(u), CHUNK):
        stop = min(start + CHUNK, len(u))
        X, Y = regressors(u, y, lags, start, stop, feedthrough=feedthrough)
        whole = np.isfinite(X).all(axis=1) & np.isfinite(Y).all(axis=1)
        X, Y = X[whole], Y[whole]
        XX += X.T @ X
        XY += X.T @ Y
        YY += Y.T @ Y
        count += len(X)
        dropped += int(whole.size - len(X))
    return Gram(
        lags=lags,
        feedthrough=feedthrough,
        XX=XX,
        XY=XY,
        YY=YY,
        count=count,
        dropped=dropped,
        input_scale=input_scale,
        output_scale=output_scale,
    )


def regressors(
    u: Float[np.ndarray, "T m"],
    y: Float[np.ndarray, "T p"],
    lags: int,
    start: int,
    stop: int,
    *,
    feedthrough: bool,
) -> tuple[Float[np.ndarray, "N q"], Float[np.ndarray, "N p"]]:
    """Return regression rows and targets for the samples ``start … stop - 1``."""
    blocks = [np.ones((stop - start, 1))]
    if feedthrough:
        blocks.append(u[start:stop])
    for lag in range(1, lags + 1):
        blocks.extend((u[start - lag : stop - lag], y[start - lag : stop - lag]))
    return np.hstack(blocks), y[start:stop]
