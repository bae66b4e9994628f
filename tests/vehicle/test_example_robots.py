"""The robots in ``examples/robots``: public figures, and what ``check`` says of each on steps of 170 by 290 mm."""

import re
from pathlib import Path

import pytest

import treadline as tl
from treadline.scenario.chair import read_chair

pytestmark = pytest.mark.usefixtures("without_shape_checks")
ROBOTS = Path(__file__).parents[2] / "examples" / "robots"
STAIR = {"stair": {"rise_m": 0.17, "run_m": 0.29, "steps": 9, "friction": [0.8, 0.65], "landing_m": 3.0}}
UP_AND_DOWN = {
    "up": {"start": {"place": "floor"}},
    "down": {"start": {"place": "landing"}, "drive": {"direction": "down"}},
}
REASONS = {
    "marv": None,
    "markhor": None,
    "ftr_stand_in": None,
    "absolem": "a flipper with 60 N m would do",
    "taurob": "the chair would turn at",
    "bunker": r"lacks \[flipper\].* over the edge it would fall by 30°, and a flipper of 0.23 m",
}
"""Words of the refusal of each, or None."""


def test_every_robot_is_checked_and_marks_its_estimates() -> None:
    files = {path.stem: path.read_text() for path in ROBOTS.glob("*.toml")}
    assert files.keys() == REASONS.keys()
    for name, text in files.items():
        assert read_chair(str(ROBOTS / f"{name}.toml")).name == name
        assert "github.com/" in text
        assert "[tracks]" not in text
        assert text.count("stimate") > 1


@pytest.mark.parametrize("direction", UP_AND_DOWN)
@pytest.mark.parametrize("name", REASONS)
def test_a_robot_is_go_or_refused_with_its_cure(name: str, direction: str) -> None:
    keys = STAIR | UP_AND_DOWN[direction] | {"chair": {"model": str(ROBOTS / f"{name}.toml"), "payload_kg": 0.0}}
    report = tl.check(tl.Scenario.model_validate(keys))
    wanted = REASONS[name]
    assert report.verdict == ("go" if wanted is None else "refuse")
    if wanted is not None:
        assert any(re.search(wanted, reason) for reason in report.reasons), report.reasons
