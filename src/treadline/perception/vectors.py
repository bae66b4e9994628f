"""Algebra of single vectors, without the overhead of numpy for stacks of vectors."""

import numpy as np
from jaxtyping import Float


def cross(a: Float[np.ndarray, " 3"], b: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Return a × b; ``numpy.cross`` takes ten times as long for one pair."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
