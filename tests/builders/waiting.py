"""Waiting for what another process does, with a generous limit."""

import time
from collections.abc import Callable
from typing import Any

import pytest

PATIENCE_S = 60.0
"""Time after which a test that waits fails [s]."""


def wait(until: Callable[[], Any], said: Callable[[], object] = str) -> Any:
    """Return the first true result; a test that waits in vain fails with what was said."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if result := until():
            return result
        time.sleep(0.01)
    pytest.fail(f"it did not come to pass: {said()}")
