"""Single-threaded BLAS during an identification.

The matrices are small: a second thread costs more than it gains, ten to a hundred times where cores are shared, and a
different order of summation changes the last digits.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

_libraries = cache(ThreadpoolController)
"""Return the BLAS libraries of this process, found once."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Context manager that limits BLAS to one thread."""
    with _libraries().limit(limits=1):
        yield
