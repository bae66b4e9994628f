"""Tip-over feedforward: pitch rate of the gyro in, additional belt speed out.

Limits are those of docs/decisions/0019: dead band 2 °/s, 0.1 m/s for at most 0.4 s, decay 0.2 m/s².
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from world import imu

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S
from treadline.mission._tip_over import TipOverFeedforward


def eased(rates_deg_s: list[float], *, allowed: bool = True) -> list[float]:
    """Return the added speed at each tick for these rates of the pitch, front down positive."""
    falling, added = TipOverFeedforward(), []
    for tick, rate in enumerate(rates_deg_s):
        t_s = tick * TICK_S
        falling.update(imu(t_s, rates_rad_s=(0.0, rate * DEG, 0.0)))
        added.append(falling.step(t_s, allowed=allowed))
    return added


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["onto its front", "onto its rear"])
def test_belts_go_the_way_in_which_the_chair_falls(way: float) -> None:
    """Test: 2.4 °/s for 0.2 s, then rest. Expected result: uphill as the front drops, downhill as the rear does; back at the rate
    at which speed comes back."""
    added = way * np.array(eased([way * 2.4] * 20 + [0.0] * 80))
    assert added[19] == pytest.approx(0.1)
    back = np.diff(added[24:])
    assert back[:10] == pytest.approx(-0.2 * TICK_S)
    assert added[-1] == 0.0


def test_a_chair_that_trembles_or_that_may_not_is_left_alone() -> None:
    """Test: ±3 °/s from sample to sample; a steady 1.9 °/s; a fall of a chair that may not. Expected result: nothing is added."""
    assert not any(eased([3.0 * (-1.0) ** tick for tick in range(100)])[70:])
    assert not any(eased([1.9] * 100))
    assert not any(eased([6.0] * 100, allowed=False))


@pytest.mark.parametrize("rate_deg_s", [3.0, -3.0])
def test_a_gyro_that_is_off_moves_the_belts_once(rate_deg_s: float) -> None:
    """Test: 3 °/s for ten seconds. Expected result: the belts go along for as long as a fall lasts, and come back for good."""
    added = np.abs(eased([rate_deg_s] * 1000))
    last = round((0.4 + 0.1 / 0.2) / TICK_S) + 5
    assert added.max() == 0.1
    assert not added[last:].any()


def test_what_was_added_comes_back_where_the_chair_may_no_longer() -> None:
    falling = TipOverFeedforward()
    falling.rate_rad_s = 6.0 * DEG
    assert falling.step(0.0, allowed=True) == 0.1
    assert falling.step(TICK_S, allowed=False) == pytest.approx(0.1 - 0.2 * TICK_S)


@given(st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=200))
def test_whatever_the_gyro_says_the_belts_add_little_and_come_back_slowly(rates_deg_s: list[float]) -> None:
    """Expected result: never beyond the most; where it shrinks without changing its sign, no faster than it may come back."""
    added = np.array(eased(rates_deg_s))
    assert np.abs(added).max() <= 0.1
    same = added[1:] * added[:-1] > 0.0
    shrinks = np.abs(added[:-1]) - np.abs(added[1:])
    assert np.all(shrinks[same] <= 0.2 * TICK_S + 1e-12)
