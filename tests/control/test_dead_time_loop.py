"""Heading controller on a plant whose belts answer late: the commands under way are known to it."""

from typing import Literal

import numpy as np
import pytest
from systems import system

from treadline.control import ControllerConfig, HeadingController, closed_loop_poles, tune
from treadline.control.tune import heading_response
from treadline.core.angles import DEG
from treadline.core.errors import NotInvertible
from treadline.core.models import LinearModel
from treadline.core.signals import HeadingEstimate

PERIOD_S = 0.25
DELAYS = [(0, 0), (3, 3), (30, 30), (0, 5)]


def chair(delay: tuple[int, int] = (0, 0)) -> LinearModel:
    """Return heading and yaw rate of a chair that keeps its heading and lags by 0.3 s, 0.8 rad/m per belt speed difference."""
    lag = np.exp(-PERIOD_S / 0.3)
    A = np.array([[1.0, 0.3 * (1.0 - lag)], [0.0, lag]])
    gain = 0.8 * np.array([PERIOD_S - 0.3 * (1.0 - lag), 1.0 - lag])
    return system(A, np.outer(gain, [-1.0, 1.0]), np.eye(2), dt_s=PERIOD_S, input_offset=np.full(2, 0.2), input_delay=delay)


def headings(
    delay: tuple[int, int],
    *,
    informed: bool = True,
    start_rad: float = DEG,
    right_scale: float = 1.0,
    noise_rad: float = 0.0,
    allocation: Literal["climb-safe", "paper"] = "climb-safe",
) -> np.ndarray:
    """Return the headings of a loop of 400 periods; ``informed`` is whether the controller knows the dead time."""
    plant = chair(delay)
    driver = HeadingController(tune(plant if informed else chair()), ControllerConfig(period_s=PERIOD_S, allocation=allocation))
    rng, x, sent, seen = np.random.default_rng(0), np.array([start_rad, 0.0]), np.zeros((max(delay) + 1, 2)), np.empty(400)
    for k in range(len(seen)):
        seen[k] = x[0]
        y = x + noise_rad * rng.standard_normal(2)
        command = driver.step(
            HeadingEstimate(
                t_s=k * PERIOD_S, heading_rad=float(y[0]), heading_rate_rad_s=float(y[1]), sigma_rad=0.002, source="vision"
            ),
            k * PERIOD_S,
        )
        belts = np.array([command.left_m_s, command.right_m_s * right_scale])
        sent = np.vstack([belts - 0.2, sent[:-1]])
        x = plant.A @ x + plant.B @ sent[delay, (0, 1)]
    return seen


@pytest.mark.parametrize("delay", DELAYS)
def test_the_loop_is_stable_with_any_dead_time_noise_and_a_belt_two_percent_off(delay: tuple[int, int]) -> None:
    seen = headings(delay, start_rad=5.0 * DEG, right_scale=1.02, noise_rad=0.1 * DEG)
    assert np.abs(seen[300:]).max() < DEG


@pytest.mark.parametrize("delay", [(3, 3), (30, 30)])
def test_dead_time_delays_the_response_and_changes_nothing_else(delay: tuple[int, int]) -> None:
    late = delay[0]
    np.testing.assert_allclose(headings(delay)[late:], headings((0, 0))[:-late], atol=1e-9)
    np.testing.assert_allclose(headings(delay)[:late], DEG)


def test_a_controller_that_does_not_know_the_dead_time_swings() -> None:
    assert np.abs(headings((30, 30), informed=False)[300:]).max() > 5.0 * DEG


def test_inputs_with_their_own_dead_times_keep_the_poles_once_both_act() -> None:
    poles = closed_loop_poles(tune(chair((0, 5))))
    x = headings((0, 5), allocation="paper")[6:16]
    # Cayley and Hamilton: a response of these poles solves their characteristic equation.
    rest = x[2:] - float(poles.sum().real) * x[1:-1] + float(poles.prod().real) * x[:-2]
    np.testing.assert_allclose(rest, 0.0, atol=1e-9)
    assert abs(x[0]) > 1e-5


@pytest.mark.parametrize("delay", DELAYS[:3])
def test_the_response_that_warnings_judge_is_the_loop_s(delay: tuple[int, int]) -> None:
    judged = heading_response(tune(chair(delay)))
    measured = headings(delay)
    np.testing.assert_allclose(judged / judged[0], measured[: len(judged)] / measured[0], atol=1e-9)


def test_another_period_keeps_the_dead_time_in_seconds() -> None:
    assert chair((8, 4)).resampled(0.5).input_delay == (4, 2)
    assert tune(chair((8, 4)), period_s=0.05).model.input_delay == (40, 20)


def test_static_reconstruction_with_dead_time_is_rejected() -> None:
    with pytest.raises(NotInvertible, match="use the observer"):
        tune(chair((3, 3)), reconstruct="static")
    with pytest.raises(NotInvertible, match="use the observer"):
        HeadingController(tune(chair((3, 3))), ControllerConfig(reconstruct="static"))
