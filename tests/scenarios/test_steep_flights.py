"""35°: a chair whose flipper reaches further down, on dry rough steps, where over the crest it turns away from square by itself."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from treadline.run.episode import run_episode
from treadline.run.resolve import resolve
from treadline.scenario.scenario import scenario_of
from treadline.scenario.shipped_files import CHAIRS

pytestmark = pytest.mark.usefixtures("without_shape_checks")
STEEP: dict[str, Any] = {"rise_m": 0.18, "run_m": 0.257, "steps": 9, "friction": [0.9, 0.72], "landing_m": 3.0}


@pytest.mark.parametrize(("direction", "start"), [("up", {"place": "floor"}), ("down", {"place": "landing"})])
def test_a_chair_whose_flipper_reaches_88_degrees_down_drives_35_degrees_square(
    direction: str, start: dict[str, Any], tmp_path: Path
) -> None:
    """Test: 75 kg, statistical camera. Expected result: arrival within the 5° of the guard; without steering while the tip slides
    the chair is held at 5° over the crest, whichever way chance turns it."""
    chair = (
        (CHAIRS / "wheelchair.toml")
        .read_text()
        .replace("[-75.0, 60.0]", "[-88.0, 60.0]")
        .replace("slope_deg = 32.0", "slope_deg = 40.0")
    )
    (tmp_path / "chair.toml").write_text(chair)
    tables = {
        "stair": STEEP,
        "start": start,
        "drive": {"direction": direction, "duration_s": 120.0},
        "chair": {"model": "chair.toml", "payload_kg": 75.0},
        "sensors": {"model": "statistical"},
    }
    run = run_episode(resolve(scenario_of(tables, tmp_path / "steep.toml", where="steep"), None, 0))
    assert (run.verdict, run.cause) == ("arrived", None)
    assert np.degrees(np.abs(run.trace["heading_rad"]).max()) < 5.0
    assert run.scores.max_pitch_rate_deg_s < 12.0
    assert run.scores.min_stability_margin_deg > 5.0
