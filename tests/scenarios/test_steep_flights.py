"""35°: the chair whose flipper reaches further down, on dry rough steps; over the crest it turns away from square by itself."""

from typing import Any

import numpy as np
import pytest

from treadline.run.episode import run_episode
from treadline.run.resolve import resolve
from treadline.scenario.scenario import Scenario

pytestmark = pytest.mark.usefixtures("without_shape_checks")
STEEP: dict[str, Any] = {"rise_m": 0.18, "run_m": 0.257, "steps": 9, "friction": [0.9, 0.72], "landing_m": 3.0}
PLACES = {"up": "floor", "down": "landing"}


@pytest.mark.parametrize(
    ("direction", "faces", "lean_m"), [("up", "up", 0.0), ("down", "up", 0.0), ("up", "down", 0.1), ("down", "down", 0.0)]
)
def test_a_chair_whose_flipper_reaches_88_degrees_down_drives_35_degrees_square(direction: str, faces: str, lean_m: float) -> None:
    """Test: 75 kg, statistical camera, upright, or on the way up a lean of 10 cm with the seat shifted by 8 cm.

    Expected result: arrival within the 5° of the guard; without steering while the tip slides the chair is held at 5° over the
    crest, whichever way chance turns it.
    """
    downhill_m = lean_m if faces == "down" else -lean_m
    tables = {
        "stair": STEEP,
        "start": {"place": PLACES[direction]},
        "drive": {"direction": direction, "duration_s": 120.0},
        "chair": {
            "model": "wheelchair-35",
            "faces": faces,
            "payload_kg": 75.0,
            "payload_offset_m": [downhill_m, 0.0, 0.0],
            "seat_shift_m": 0.8 * lean_m,
        },
        "sensors": {"model": "statistical"},
    }
    run = run_episode(resolve(Scenario.model_validate(tables), None, 0))
    assert (run.verdict, run.cause) == ("arrived", None)
    assert np.degrees(np.abs(run.trace["heading_rad"]).max()) < 5.0
    assert run.scores.max_pitch_rate_deg_s < 12.0
    assert run.scores.min_stability_margin_deg > 5.0
