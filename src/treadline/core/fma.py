"""Compiled sums of products with fused multiply-add, so that results round as in BLAS and identically on all processors."""

from numba import types
from numba.extending import intrinsic, register_jitable


@intrinsic
def fused(_typing, a, b, c):
    """Return ``a * b + c`` with a single rounding."""
    del a, b, c
    double = types.float64
    return double(double, double, double), lambda _context, builder, _signature, arguments: builder.fma(*arguments)


@register_jitable  # a part of the kernels that call it: two processes that compile them share no file
def dot(a, b):
    """Return the inner product of two vectors."""
    total = a[0] * b[0]
    for i in range(1, a.shape[0]):
        total = fused(a[i], b[i], total)
    return total
