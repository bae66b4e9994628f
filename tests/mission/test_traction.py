"""The traction test with synthetic belts and IMU: what it lets pass by friction, and how far errors of the sensors move that."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from world import G_M_S2, TICK_S, belts, imu

from treadline.core.angles import DEG
from treadline.mission._traction_test import TractionTest


@dataclass(kw_only=True)
class Foot:
    """A chair on two nosings, rear on the floor: Coulomb friction on the belts, a drive with its lag, an IMU with its errors."""

    slope_deg: float = 28.0
    share: float = 0.2
    """Friction over tan β, less one."""
    pitch_deg: float | None = None
    """None: the slope's."""
    lag_s: float = 0.15
    bias_m_s2: float = 0.0
    gravity_deg: float = 0.0
    """Error of the IMU's attitude, front up positive."""
    slope_error_deg: float = 0.0
    noise_m_s2: float = 0.0
    seed: int = 0
    stalled: bool = False

    def run(self) -> TractionTest:
        """Return the test when it is over."""
        rng = np.random.default_rng(self.seed)
        slope = self.slope_deg * DEG
        pitch = slope if self.pitch_deg is None else self.pitch_deg * DEG
        most = G_M_S2 * ((1.0 + self.share) * math.tan(slope) * math.cos(pitch) - math.sin(pitch))
        test = TractionTest(slope + self.slope_error_deg * DEG)
        speed = chair = self.farthest_m = self.fastest_m_s = 0.0
        t_s = 0.0
        while not test.over:
            asked = 0.0 if self.stalled else test.speed_m_s
            speed += (asked - speed) * TICK_S / self.lag_s
            # Friction pulls the chair to its belts' speed as fast as it can, and no faster; a brake needs less of it.
            change = max(min((speed - chair) / TICK_S, most), -4.0)
            chair += change * TICK_S
            self.farthest_m += chair * TICK_S
            self.fastest_m_s = max(self.fastest_m_s, speed)
            test.update(belts(t_s, speed, speed))
            # The attitude errs, the force does not: gravity in the true axes, and what the chair gains along its belts.
            force = imu(t_s, pitch, speeds_up_m_s2=change + self.bias_m_s2).linear_acceleration_m_s2
            wrong = imu(t_s, pitch + self.gravity_deg * DEG)
            test.update(replace(wrong, linear_acceleration_m_s2=force + self.noise_m_s2 * rng.normal(size=3)))
            t_s += TICK_S
        self.seconds = t_s
        return test


@pytest.mark.parametrize("slope_deg", [20.0, 25.0, 28.0, 30.0])
@pytest.mark.parametrize(("share", "holds"), [(-0.5, False), (0.0, False), (0.03, False), (0.07, True), (0.5, True)])
def test_below_1_03_tan_is_refused_and_from_1_07_is_not(slope_deg: float, share: float, holds: bool) -> None:
    assert Foot(slope_deg=slope_deg, share=share).run().holds is holds


@settings(max_examples=15)
@given(slope_deg=st.floats(20.0, 30.0), lag_s=st.floats(0.05, 0.15), bias=st.floats(-0.3, 0.3), seed=st.integers(0, 1000))
def test_neither_bias_nor_noise_nor_the_drives_lag_moves_the_limits(slope_deg: float, lag_s: float, bias: float, seed: int) -> None:
    errors = {"lag_s": lag_s, "bias_m_s2": bias, "noise_m_s2": 0.03, "seed": seed}
    # The lag costs a hundredth of the four between the limits (at 0.15 s), the noise less.
    assert not Foot(slope_deg=slope_deg, share=0.03, **errors).run().holds  # type: ignore[arg-type]
    assert Foot(slope_deg=slope_deg, share=0.07, **errors).run().holds  # type: ignore[arg-type]


@pytest.mark.parametrize("error_deg", [-0.5, 0.5])
def test_gravity_that_errs_alike_in_attitude_and_map_cancels(error_deg: float) -> None:
    for share, holds in ((0.03, False), (0.07, True)):
        assert Foot(share=share, gravity_deg=error_deg, slope_error_deg=error_deg).run().holds is holds


@pytest.mark.parametrize("error_deg", [-0.5, 0.5])
def test_gravity_that_errs_in_the_attitude_alone_costs_two_hundredths(error_deg: float) -> None:
    for share, holds in ((0.02, False), (0.09, True)):
        assert Foot(share=share, gravity_deg=error_deg).run().holds is holds


@pytest.mark.parametrize("slope_deg", [20.0, 25.0, 28.0, 30.0])
@pytest.mark.parametrize("steeper_deg", [-3.0, 0.0, 1.0, 2.0, 3.0])
def test_however_the_chair_is_pitched_grip_passes_and_none_does_not(slope_deg: float, steeper_deg: float) -> None:
    """Test: pitched more or less than the stair; belts that grip, and a chair that stays where it is while they
    run, for its rear stands on the floor. Expected result: go; refused, also where gravity alone asks for more than is wanted."""
    pitch_deg = slope_deg + steeper_deg
    gripping = Foot(slope_deg=slope_deg, pitch_deg=pitch_deg, share=1.0)
    assert gripping.run().holds
    assert gripping.farthest_m > 0.0
    stays = math.tan(pitch_deg * DEG) / math.tan(slope_deg * DEG) - 1.0
    assert not Foot(slope_deg=slope_deg, pitch_deg=pitch_deg, share=stays).run().holds


@pytest.mark.parametrize(("share", "holds"), [(0.5, True), (0.02, False)])
def test_belts_rest_pulse_and_hardly_move_the_chair(share: float, *, holds: bool) -> None:
    """Test: belts with grip and with too little. Expected result: it is over at the pulse's end, for a stop there would jolt the
    passenger (2.8 m/s²) where the climb goes on, and another pulse begins with a rest where it does not."""
    foot = Foot(share=share)
    test = foot.run()
    assert foot.seconds == pytest.approx(1.2, abs=2 * TICK_S)
    assert 0.0 < foot.farthest_m < 0.08
    assert foot.fastest_m_s < 0.25
    assert test.holds is holds
    assert test.slip < 0.02 or not test.holds
    assert test.speed_m_s == 0.0


def test_the_pulse_asks_for_the_share_over_what_the_stair_needs() -> None:
    test, slope = TractionTest(28.0 * DEG), 28.0 * DEG
    speeds = []
    for k in range(120):
        test.update(imu(k * TICK_S, slope))
        speeds.append(test.speed_m_s)
    assert speeds[: 60 + 1] == [0.0] * (60 + 1)
    asked = (speeds[100] - speeds[80]) / (20 * TICK_S)
    # Friction asked: tan θ + a/(g cos θ), to be (1 + share)·tan β where the chair lies on the stair. G is rounded to 9.81 here.
    friction = math.tan(slope) + asked / (G_M_S2 * math.cos(slope))
    assert friction == pytest.approx((1.0 + 0.085) * math.tan(slope), rel=1e-3)


def test_belts_that_do_not_move_are_no_grip() -> None:
    for seed in range(5):
        test = Foot(stalled=True, noise_m_s2=0.03, seed=seed).run()
        assert not test.holds
        assert test.slip == pytest.approx(1.0, abs=0.1)


def test_a_test_that_was_stopped_begins_again_and_has_shown_nothing() -> None:
    """Test: the belts are braked in the middle of the pulse, for two seconds. Expected result: no verdict of it; then a whole test,
    from its rest on."""
    test = TractionTest(28.0 * DEG)
    for tick in range(420):
        t_s, braked = tick * TICK_S, 80 <= tick < 280
        test.update(belts(t_s, 0.0, 0.0, brake_on=braked))
        test.update(imu(t_s, 28.0 * DEG))
        assert not test.over or tick >= 279 + 120
        if 80 <= tick < 279 + 60:
            assert test.speed_m_s == 0.0
    assert test.slip == 1.0  # belts that do not move after all have shown no grip
