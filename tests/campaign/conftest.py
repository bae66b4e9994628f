"""Fixtures of the campaign tests: a small sweep and functions that stand in for the simulator."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from treadline.campaign.spec import Spec, read_spec

sys.path.insert(0, str(Path(__file__).parent))  # spawned processes import the episode functions by module name

SMALL = """
[drive]
duration_s = 100
[[draw]]
key = "stair.slope_deg"
uniform = [20, 30]
[[draw]]
key = "stair.friction.0"
uniform = [{ times = 1.1, of = "stair.tan_slope" }, 1.0]
[[draw]]
key = "chair.payload_kg"
uniform = [0, 110]
when = { "stair.slope_deg" = { at_most = 26 } }
[[draw]]
key = "chair.payload_kg"
uniform = [0, 80]
when = { "stair.slope_deg" = { above = 26 } }
[[draw]]
key = "stair.texture"
choice = ["wood", "carpet", "dark"]
weights = [8, 1, 1]
[[draw]]
key = "start.heading_deg"
normal = { mean = 0, sigma = 20, low = -30, high = 30 }
"""


@pytest.fixture
def spec_file(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "spec.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def small(spec_file: Callable[[str], Path]) -> Path:
    return spec_file(SMALL)


@pytest.fixture(scope="session")
def small_spec(tmp_path_factory: pytest.TempPathFactory) -> Spec:
    """Return the small sweep, whose corners are checked once."""
    path = tmp_path_factory.mktemp("small") / "spec.toml"
    path.write_text(SMALL, encoding="utf-8")
    return read_spec(path)
