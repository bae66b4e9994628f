"""The shipped chair, and its pieces with single values changed."""

import pytest

from treadline.scenario.chair import ChairDescription, read_chair


@pytest.fixture(scope="session")
def chair() -> ChairDescription:
    return read_chair("wheelchair")
