"""Fixtures of the campaign tests: a small sweep and functions that stand in for the simulator."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from treadline.campaign.spec import Spec, read_spec

sys.path.insert(0, str(Path(__file__).parent))  # spawned processes import the episode functions by module name

SMALL = Path(__file__).with_name("spec.toml")


@pytest.fixture
def spec_file(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "spec.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture
def small(spec_file: Callable[[str], Path]) -> Path:
    return spec_file(SMALL.read_text(encoding="utf-8"))


@pytest.fixture(scope="session")
def small_spec() -> Spec:
    """Return the small sweep, whose corners are checked once."""
    return read_spec(SMALL)
