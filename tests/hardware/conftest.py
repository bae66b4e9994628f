"""A chair of the tests, whose box and handset the guard process imports from the builders."""

import os
from pathlib import Path

import pytest
from robots import TestRobot

BUILDERS = Path(__file__).parents[1] / "builders"


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TestRobot:
    source = Path(__file__).parents[2] / "src"
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(source), str(BUILDERS), os.environ.get("PYTHONPATH", "")]))
    return TestRobot(tmp_path)
