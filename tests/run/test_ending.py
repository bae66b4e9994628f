"""A slide is a retreat that the belts did not drive; an arrival may be too rough."""

from dataclasses import replace

import numpy as np
import pytest
from world import truth

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.run._ending import Ending, SlideWatch, rough_cause
from treadline.run.run_scores import Trace, score
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario


def ride(x_m: np.ndarray, belts_m_s: float, *, pitch_deg: float = 28.0, heading_deg: float = 0.0) -> list[Truth]:
    """Return the truth of a chair that goes through these places, a tick apart, its belts at one speed."""
    moved = {"left_m_s": belts_m_s, "right_m_s": belts_m_s, "pitch_rad": pitch_deg * DEG, "heading_rad": heading_deg * DEG}
    return [truth(0.01 * k, x_m=float(x), **moved) for k, x in enumerate(x_m)]


def slid(samples: list[Truth], *, upward: bool = True) -> float:
    watch = SlideWatch(upward=upward)
    return max(watch.update(sample) for sample in samples)


@pytest.mark.parametrize("belts_m_s", [0.0, 0.2])
def test_a_chair_that_goes_back_while_its_belts_do_not_slides(belts_m_s: float) -> None:
    back = np.linspace(2.0, 1.4, 301)
    assert slid(ride(back, belts_m_s)) == pytest.approx(0.6)
    assert slid(ride(-back, -belts_m_s), upward=False) == pytest.approx(0.6)


def test_a_chair_that_backs_away_on_its_belts_does_not() -> None:
    # 0.2 m/s for 3 s; and twice as fast as its belts, half of it is a slide.
    assert slid(ride(np.linspace(2.0, 1.4, 301), -0.2)) == pytest.approx(0.0, abs=1e-12)
    assert slid(ride(np.linspace(2.0, 0.8, 301), -0.2)) == pytest.approx(0.6)


def test_a_chair_on_the_level_or_that_recovers_does_not() -> None:
    assert slid(ride(np.linspace(2.0, 1.4, 301), 0.0, pitch_deg=2.0)) == 0.0
    slips = np.concatenate([np.linspace(0.0, -0.2, 50), np.linspace(-0.2, 1.0, 50)] * 2)
    assert slid(ride(slips[:100], 0.2)) == pytest.approx(0.2)


@pytest.mark.parametrize(("metres", "fell"), [(0.49, False), (0.51, True)])
def test_a_slide_of_more_than_half_a_metre_is_a_fall(metres: float, fell: bool) -> None:
    ending = Ending(Scenario(), read_chair("wheelchair"))
    ends = [ending.fall(sample) for sample in ride(np.linspace(3.0, 3.0 - metres, 201), 0.0)]
    assert (ends[-1] is not None) == fell
    if fell:
        assert ends[-1] == ("fell", "slid 0.51 m down the flight by 2.00 s")


@pytest.mark.parametrize(
    ("passenger_m_s2", "margin_deg", "cause"),
    [
        (3.9, 0.1, None),
        (4.1, 0.1, "passenger at 4.1 m/s², above 4"),
        (8.3, -1.3, "passenger at 8.3 m/s², above 4; tip-over margin -1.3°, below 0"),
    ],
)
def test_an_arrival_is_rough_by_acceleration_or_margin(passenger_m_s2: float, margin_deg: float, cause: str | None) -> None:
    scores = score(Trace.of([truth(0.0)]))
    assert rough_cause(replace(scores, passenger_max_m_s2=passenger_m_s2, min_stability_margin_deg=margin_deg)) == cause
