"""Hull, seat and passenger collide; a regular traversal, up and down, still touches with its belts alone."""

import pytest

from treadline.run.episode import traverse
from treadline.scenario.scenario import read_scenario
from treadline.scenario.shipped_files import shipped_controller


@pytest.mark.parametrize("name", ["up-28", "down-28"])
def test_a_shipped_traversal_logs_no_contact_but_that_of_its_belts(name: str) -> None:
    asked = read_scenario(name, {"sensors.camera": "statistical", "stair.steps": 6})
    result = traverse(asked, controller=shipped_controller("wheelchair"), seed=0)
    assert result.verdict == "arrived", result.cause
    assert result.trace["hull_contacts"].max() == 0.0
    assert "hull_contact" not in [event.name for event in result.events]
