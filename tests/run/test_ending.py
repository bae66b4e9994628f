"""A slide is a retreat that the belts did not drive; an arrival or a hold may be too rough."""

from dataclasses import replace

import numpy as np
import pytest
from world import truth

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.run.ending import Ending, SlideWatch, rough_cause
from treadline.run.run_scores import Trace, score
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario


def ride(x_m: np.ndarray, belts_m_s: float, *, pitch_deg: float = 28.0, heading_deg: float = 0.0) -> list[Truth]:
    """Return the truth of a chair that goes through these places, a tick apart, its belts at one speed."""
    moved = {"left_m_s": belts_m_s, "right_m_s": belts_m_s, "pitch_rad": pitch_deg * DEG, "heading_rad": heading_deg * DEG}
    return [truth(0.01 * k, x_m=float(x), **moved) for k, x in enumerate(x_m)]


BACK_M = np.linspace(2.0, 1.4, 301)
"""Places of a chair that goes back at 0.2 m/s."""


@pytest.mark.parametrize(
    ("samples", "roll_back_m"),
    [
        (ride(BACK_M, 0.0), 0.6),
        (ride(BACK_M, 0.2), 0.6),
        # On its belts it does not slide; twice as fast, half of the distance is a slide.
        (ride(BACK_M, -0.2), 0.0),
        (ride(np.linspace(2.0, 0.8, 301), -0.2), 0.6),
        # On the level it does not slide, and slides are no sum: the chair recovers.
        (ride(BACK_M, 0.0, pitch_deg=2.0), 0.0),
        (ride(np.concatenate([np.linspace(0.0, -0.2, 50), np.linspace(-0.2, 1.0, 50)]), 0.2), 0.2),
    ],
)
def test_a_chair_that_goes_back_while_its_belts_do_not_slides(samples: list[Truth], roll_back_m: float) -> None:
    watch, down = SlideWatch(upward=True), SlideWatch(upward=False)
    assert max(map(watch.update, samples)) == pytest.approx(roll_back_m, abs=1e-12)
    mirrored = [replace(at, x_m=-at.x_m, left_m_s=-at.left_m_s, right_m_s=-at.right_m_s) for at in samples]
    assert max(map(down.update, mirrored)) == pytest.approx(roll_back_m, abs=1e-12)


@pytest.mark.parametrize(("metres", "fell"), [(0.49, False), (0.51, True)])
def test_a_slide_of_more_than_half_a_metre_is_a_fall(metres: float, fell: bool) -> None:
    ending = Ending(Scenario(), read_chair("wheelchair"))
    ends = [ending.fall(sample) for sample in ride(np.linspace(3.0, 3.0 - metres, 201), 0.0)]
    assert (ends[-1] is not None) == fell
    if fell:
        assert ends[-1] == ("fell", "slid 0.51 m down the flight by 2.00 s")


@pytest.mark.parametrize(
    ("passenger_m_s2", "pitch_deg_s", "margin_deg", "cause"),
    [
        (3.9, 24.9, 0.1, None),
        (4.1, 24.9, 0.1, "passenger at 4.1 m/s², above 4"),
        (3.9, 25.6, 0.1, "pitch rate 26 °/s, above 25"),
        (8.3, 0.0, -1.3, "passenger at 8.3 m/s², above 4; tip-over margin -1.3°, below 0"),
    ],
)
def test_a_run_is_rough_by_acceleration_pitch_rate_or_margin(
    passenger_m_s2: float, pitch_deg_s: float, margin_deg: float, cause: str | None
) -> None:
    measured = {"passenger_max_m_s2": passenger_m_s2, "max_pitch_rate_deg_s": pitch_deg_s, "min_stability_margin_deg": margin_deg}
    assert rough_cause(replace(score(Trace.of([truth(0.0)])), **measured)) == cause
