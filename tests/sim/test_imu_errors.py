"""The IMU errs as its data sheet says: noise, bias, scale, a tilted idea of down, a yaw that drifts."""

import math

import numpy as np
import pytest
from jaxtyping import Float

from treadline.angles import DEG, rotation_of, rotation_y, rotation_z, wrap
from treadline.devices.imu import IMUS, Imu
from treadline.signals import TICK_S, ImuSample

LEVEL = np.eye(3)
STILL = np.zeros(3)


def at_rest(
    kind: str, seed: int, samples: int, *, gravity_error_deg: float = 0.0, moving: bool = False, R_WB: np.ndarray = LEVEL
) -> list[ImuSample]:
    imu = Imu(IMUS[kind], gravity_error_deg * DEG, np.random.default_rng(seed))
    return [imu.sample(k * TICK_S, R_WB, STILL, STILL, moving=moving) for k in range(samples)]


def rates_deg_s(samples: list[ImuSample]) -> Float[np.ndarray, "n 3"]:
    return np.array([sample.angular_velocity_rad_s for sample in samples]) / DEG


def up_in_chair(samples: list[ImuSample]) -> Float[np.ndarray, "n 3"]:
    return np.array([rotation_of(sample.orientation)[2] for sample in samples])


def yaw_rad(sample: ImuSample) -> float:
    R = rotation_of(sample.orientation)
    return math.atan2(R[1, 0], R[0, 0])


def turning(kind: str, seed: int, seconds: float, rate_rad_s: float) -> list[ImuSample]:
    imu = Imu(IMUS[kind], 0.0, np.random.default_rng(seed))
    rate = np.array([0.0, 0.0, rate_rad_s])
    return [
        imu.sample(k * TICK_S, rotation_z(rate_rad_s * k * TICK_S), rate, STILL, moving=False)
        for k in range(round(seconds / TICK_S))
    ]


@pytest.mark.parametrize(("kind", "density"), [("mpu6050", 0.005), ("mpu9250", 0.01)])
def test_gyro_noise_is_white_and_of_its_density(kind: str, density: float) -> None:
    noise = rates_deg_s(at_rest(kind, 0, 4000))
    noise = noise - noise.mean(axis=0)
    # A density fills 50 Hz of band at 100 Hz. 4000 samples tell a deviation to 1.1 %; the bias wanders a little too.
    np.testing.assert_allclose(noise.std(axis=0), density * math.sqrt(50.0), rtol=0.05)
    neighbours = (noise[1:] * noise[:-1]).mean(axis=0) / noise.var(axis=0)
    assert np.abs(neighbours).max() < 0.07


def test_tracks_that_move_shake_the_gyro() -> None:
    shaken = rates_deg_s(at_rest("mpu6050", 1, 4000, moving=True))
    # 0.3 °/s RMS with the gyro's own 0.035 beside it; 40 s of a band of some 4 Hz tell a deviation to 4 %.
    np.testing.assert_allclose(shaken.std(axis=0), math.hypot(0.3, 0.0354), rtol=0.12)


@pytest.mark.parametrize("seed", range(4))
def test_shaking_is_motion_and_adds_up_to_nothing(seed: int) -> None:
    # The same draws with and without the belts: what differs is the shaking.
    shaking = rates_deg_s(at_rest("mpu6050", seed, 6000, moving=True)) - rates_deg_s(at_rest("mpu6050", seed, 6000))
    angle = np.cumsum(shaking, axis=0) * TICK_S
    # 0.3 °/s at 8 Hz is an angle of 0.005°; six sigma. As white noise it would have walked 0.23° in this minute.
    assert np.abs(angle).max() < 0.03


def test_the_chassis_rings_at_the_cleats_frequency() -> None:
    shaking = rates_deg_s(at_rest("mpu6050", 5, 6000, moving=True))
    power = np.square(np.abs(np.fft.rfft(shaking - shaking.mean(axis=0), axis=0))).sum(axis=1)
    frequency = np.fft.rfftfreq(6000, TICK_S)
    # Half of the power within a third of the frequency, where white noise would have a tenth.
    assert power[np.abs(frequency - 8.0) < 8.0 / 3.0].sum() > 0.45 * power.sum()
    # Whoever averages for a second is left with what white noise leaves.
    assert power[frequency < 0.5].sum() < 0.01 * power.sum()


def test_the_bias_that_is_left_differs_from_chair_to_chair() -> None:
    means = np.array([rates_deg_s(at_rest("mpu6050", seed, 100)).mean(axis=0) for seed in range(40)])
    # 0.02 °/s left, 0.005 wandering, 0.0035 of noise in a mean of 100; 120 values tell it to 6.5 %.
    assert means.std() == pytest.approx(math.hypot(0.02, 0.005, 0.0035), rel=0.2)


def test_the_bias_wanders_within_its_bounds_and_slowly() -> None:
    tens = np.array([rates_deg_s(at_rest("mpu6050", seed, 3000)).reshape(3, 1000, 3).mean(axis=1) for seed in range(8)])
    steps = np.diff(tens, axis=1)
    # A Gauss-Markov process of 0.005 °/s and 100 s changes by 0.005 √(2 (1 - e^-0.1)) = 0.0022 °/s in ten seconds, less
    # a little for averaging; noise in the means of 1000 adds 0.0016. 48 differences tell it to 10 %.
    assert steps.std() == pytest.approx(math.hypot(0.0021, 0.0016), rel=0.35)


def test_the_accelerometer_feels_gravity_and_acceleration_in_the_chairs_frame() -> None:
    R_WB = rotation_y(-30.0 * DEG)
    imu = Imu(IMUS["ideal"], 0.0, np.random.default_rng(0))
    at_ease = imu.sample(0.0, R_WB, STILL, STILL, moving=False).linear_acceleration_m_s2
    # Nose up by 30°: half of g along x, as if it accelerated forward.
    np.testing.assert_allclose(at_ease, [9.81 * 0.5, 0.0, 9.81 * math.cos(30.0 * DEG)], atol=1e-12)
    pushed = imu.sample(0.01, R_WB, STILL, np.array([0.0, 2.0, 0.0]), moving=False).linear_acceleration_m_s2
    np.testing.assert_allclose(pushed - at_ease, [0.0, 2.0, 0.0], atol=1e-12)
    noisy = np.array([sample.linear_acceleration_m_s2 for sample in at_rest("mpu6050", 2, 2000)])
    np.testing.assert_allclose(noisy.std(axis=0), 0.03, rtol=0.06)


@pytest.mark.parametrize("seed", range(4))
def test_the_idea_of_down_is_off_by_the_gravity_error_and_stays_so(seed: int) -> None:
    up = up_in_chair(at_rest("mpu6050", seed, 3000, gravity_error_deg=0.5))
    mean = up.mean(axis=0)
    angle_deg = math.acos(float(mean[2] / np.linalg.norm(mean))) / DEG
    # The attitude filter wanders by 0.05° with a memory of one second: 0.05 √(2/30) = 0.013° in a mean of 30 s.
    assert angle_deg == pytest.approx(0.5, abs=0.05)
    np.testing.assert_allclose(up[:, :2].std(axis=0) / DEG, 0.05, rtol=0.4)


def test_the_gravity_error_is_fixed_to_the_chair_and_its_direction_drawn() -> None:
    directions = []
    for seed in range(6):
        ups = [
            up_in_chair(at_rest("ideal", seed, 1, gravity_error_deg=0.5, R_WB=rotation_z(turn)))[0] for turn in (0.0, 0.5 * math.pi)
        ]
        np.testing.assert_allclose(ups[0], ups[1], atol=1e-12)
        directions.append(math.atan2(ups[0][1], ups[0][0]))
    assert np.ptp(directions) > 1.0


def test_an_ideal_imu_follows_a_turn_from_an_arbitrary_zero() -> None:
    samples = turning("ideal", 3, 2.0, 0.5)
    yaw = np.unwrap([yaw_rad(sample) for sample in samples])
    np.testing.assert_allclose(np.diff(yaw), 0.5 * TICK_S, atol=1e-12)
    zeros = [yaw_rad(at_rest("ideal", seed, 1)[0]) for seed in range(6)]
    assert np.ptp(zeros) > 1.0


def test_yaw_drifts_by_what_the_gyro_measures_wrong() -> None:
    samples = turning("mpu6050", 4, 10.0, 0.3)
    wrong = sum(float(sample.angular_velocity_rad_s[2]) - 0.3 for sample in samples[1:]) * TICK_S
    drift = wrap(yaw_rad(samples[-1]) - yaw_rad(samples[0]) - 0.3 * (len(samples) - 1) * TICK_S)
    # The tilt's wander turns yaw in the second order only: 0.05° squared.
    assert drift == pytest.approx(wrong, abs=1e-5)


def test_a_turn_is_measured_within_the_scale_error() -> None:
    shares = []
    for seed in range(20):
        rates = [float(sample.angular_velocity_rad_s[2]) for sample in turning("mpu6050", seed, 1.0, 1.0)]
        shares.append(np.mean(rates) - 1.0)
    # Uniform within ±1 %, with bias and noise of 0.0004 beside it.
    assert np.abs(shares).max() < 0.012
    assert np.std(shares) == pytest.approx(0.01 / math.sqrt(3.0), rel=0.4)


def test_the_same_generator_gives_the_same_samples() -> None:
    first, again, other = (rates_deg_s(at_rest("mpu6050", seed, 50)) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()
