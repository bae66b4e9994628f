"""One thread of BLAS for the time of an identification.

Its matrices are small: a second thread costs more than it brings, ten to a hundred times where cores are shared, and sums
in another order differ in their last digits.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> ThreadpoolController:
    return ThreadpoolController()


@contextmanager
def one_thread() -> Iterator[None]:
    """Limit BLAS to one thread."""
    with _libraries().limit(limits=1):
        yield
