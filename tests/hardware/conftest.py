"""A chair of the tests, whose box and handset the guard process imports from the builders."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from robots import TestRobot

TESTS = Path(__file__).parents[1]


@pytest.fixture(scope="session", autouse=True)
def _builders() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as environment:
        paths = [str(TESTS.parent / "src"), str(TESTS / "builders"), os.environ.get("PYTHONPATH", "")]
        environment.setenv("PYTHONPATH", os.pathsep.join(paths))
        yield


@pytest.fixture
def robot(tmp_path: Path) -> TestRobot:
    return TestRobot(tmp_path)
