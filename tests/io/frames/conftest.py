"""Frames with known truth."""

from collections.abc import Callable

import pytest
from surfaces import on_a_flight

from treadline.core.camera_images import RgbdFrame

Rendered = Callable[..., RgbdFrame]


@pytest.fixture
def rendered() -> Rendered:
    """Return a frame from within a flight."""
    return lambda seed=1, heading_deg=12.0, **options: on_a_flight(seed, heading_deg, **options)[0]
