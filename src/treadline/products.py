"""Sums of products, compiled, each term added by a fused multiply-add: as BLAS rounds them, and on any processor alike.

``no_type_check`` keeps the tests' shape checker from wrapping what numba compiles.
"""

from typing import no_type_check

from numba import njit, types
from numba.extending import intrinsic


@intrinsic
@no_type_check
def fused(_typing, a, b, c):
    """Return ``a * b + c``, rounded once."""
    del a, b, c
    double = types.float64
    return double(double, double, double), lambda _context, builder, _signature, arguments: builder.fma(*arguments)


@njit(cache=True)
@no_type_check
def dot(a, b):
    """Return the inner product of two vectors."""
    total = a[0] * b[0]
    for i in range(1, a.shape[0]):
        total = fused(a[i], b[i], total)
    return total
