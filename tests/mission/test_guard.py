"""The guard: each scenario is *Test / Expected result* in terms of what reaches the belts."""

import math

import pytest

from treadline.angles import DEG
from treadline.mission.guard import Guard, GuardConfig
from treadline.signals import HeadingEstimate, OperatorInput, SeatCommand, TrackCommand


def command(t_s: float, left: float = 0.2, right: float = 0.2) -> TrackCommand:
    return TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right)


def estimate(t_s: float, heading_deg: float = 0.0) -> HeadingEstimate:
    return HeadingEstimate(t_s=t_s, heading_rad=heading_deg * DEG, heading_rate_rad_s=0.0, sigma_rad=0.003, source="vision")


def healthy(guard: Guard, t_s: float) -> None:
    guard.imu_arrived(t_s)
    guard.frame_arrived(t_s)
    guard.stair_seen(t_s)


@pytest.fixture
def guard() -> Guard:
    guard = Guard(GuardConfig())
    healthy(guard, 0.0)
    guard.propose(command(0.0))
    return guard


def test_a_healthy_command_passes_unchanged(guard: Guard) -> None:
    passed = guard.step(0.0, estimate(0.0))
    assert (passed.left_m_s, passed.right_m_s, passed.brake) == (0.2, 0.2, False)
    assert guard.holding is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("belt", ["left", "right"])
def test_a_command_that_is_not_finite_never_reaches_the_belts(guard: Guard, bad: float, belt: str) -> None:
    guard.propose(command(0.01, **{belt: bad}))
    stopped = guard.step(0.01, estimate(0.01))
    assert (stopped.left_m_s, stopped.right_m_s, stopped.brake) == (0.0, 0.0, True)
    assert guard.holding == "command is not finite"


def test_an_estimate_that_is_not_finite_holds(guard: Guard) -> None:
    assert guard.step(0.01, estimate(0.01, math.nan)).brake


@pytest.mark.parametrize(
    ("silent", "passes_s", "holds_s", "word"),
    [
        ("imu", 0.05, 0.07, "IMU"),
        ("frames", 3.0, 3.1, "frame"),
        ("stair", 12.0, 12.1, "stair"),
        ("driver", 0.75, 0.80, "command"),
    ],
)
def test_a_silent_source_holds_within_its_time_and_not_before(
    guard: Guard, silent: str, passes_s: float, holds_s: float, word: str
) -> None:
    def feed(t_s: float) -> None:
        if silent != "imu":
            guard.imu_arrived(t_s)
        if silent != "frames":
            guard.frame_arrived(t_s)
        if silent not in ("stair", "frames"):
            guard.stair_seen(t_s)
        if silent != "driver":
            guard.propose(command(t_s))

    feed(passes_s)
    assert not guard.step(passes_s, estimate(passes_s)).brake
    feed(holds_s)
    assert guard.step(holds_s, estimate(holds_s)).brake
    assert guard.holding is not None
    assert word in guard.holding


@pytest.mark.parametrize("age_s", [0.5, -0.5])
def test_an_estimate_of_another_time_holds(guard: Guard, age_s: float) -> None:
    healthy(guard, 1.0)
    guard.propose(command(1.0))
    assert guard.step(1.0, estimate(1.0 - age_s)).brake
    assert guard.holding is not None
    assert "old" in guard.holding


def test_without_frames_the_chair_slows_before_it_holds(guard: Guard) -> None:
    guard.imu_arrived(0.5)
    guard.propose(command(0.5, left=0.1, right=0.3))
    passed = guard.step(0.5, estimate(0.5))
    assert 0.5 * (passed.left_m_s + passed.right_m_s) == pytest.approx(0.10)
    assert passed.right_m_s - passed.left_m_s == pytest.approx(0.2)  # steering keeps, common speed yields
    assert [event.name for event in guard.take_events()] == ["slow"]


@pytest.mark.parametrize(("heading_deg", "mean_m_s"), [(0.0, 0.30), (4.9, 0.30), (-5.1, 0.55), (30.0, 0.55)])
def test_the_mean_speed_is_limited_more_when_square_than_when_turning(guard: Guard, heading_deg: float, mean_m_s: float) -> None:
    guard.propose(command(0.01, left=0.6, right=0.8))
    passed = guard.step(0.01, estimate(0.01, heading_deg))
    assert 0.5 * (passed.left_m_s + passed.right_m_s) == pytest.approx(mean_m_s)


def test_no_belt_passes_its_limit(guard: Guard) -> None:
    guard.propose(command(0.01, left=-3.0, right=4.0))
    passed = guard.step(0.01, estimate(0.01, 30.0))
    assert max(abs(passed.left_m_s), abs(passed.right_m_s)) <= 1.0


@pytest.mark.parametrize(
    "press",
    [OperatorInput(t_s=0.1, stop=True), OperatorInput(t_s=0.1, dead_man=False)],
    ids=["stop", "dead man"],
)
def test_the_operators_stop_acts_within_the_tick_and_only_a_person_re_arms(guard: Guard, press: OperatorInput) -> None:
    guard.operator(press)
    assert guard.step(0.1, estimate(0.1)).brake
    healthy(guard, 0.2)
    guard.propose(command(0.2))
    assert guard.step(0.2, estimate(0.2)).brake
    guard.operator(OperatorInput(t_s=0.3, rearm=True))
    assert not guard.step(0.3, estimate(0.3)).brake
    assert [event.name for event in guard.take_events()] == ["hold", "rearmed"]


def test_an_open_loop_run_needs_no_heading_but_still_needs_a_driver() -> None:
    guard = Guard(GuardConfig(needs_heading=False))
    guard.propose(command(5.0))
    assert not guard.step(5.0, None).brake
    assert guard.step(6.0, None).brake


def test_a_seat_rate_that_is_no_number_does_not_pass_and_holds(guard: Guard) -> None:
    fine = SeatCommand(t_s=0.01, rate_m_s=0.02)
    assert guard.pass_seat(fine) == fine
    assert guard.pass_seat(SeatCommand(t_s=0.02, rate_m_s=math.nan)).rate_m_s == 0.0
    assert guard.holding == "seat rate is not finite"
