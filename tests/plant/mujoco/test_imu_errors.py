"""The IMU errs as its data sheet says: noise, bias and scale; its attitude is filtered from its own gyro and accelerometer."""

import math

import numpy as np
import pytest
from jaxtyping import Float

from treadline.core.angles import DEG, wrap
from treadline.core.rotations import rotation_of, rotation_y, rotation_z
from treadline.core.signals import TICK_S, ImuSample
from treadline.plant.sensors.imu import IMUS, Imu

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
    # A density fills 50 Hz of band at 100 Hz. 4000 samples give a standard deviation to 1.1 %; the bias wanders a little too.
    np.testing.assert_allclose(noise.std(axis=0), density * math.sqrt(50.0), rtol=0.05)
    neighbours = (noise[1:] * noise[:-1]).mean(axis=0) / noise.var(axis=0)
    assert np.abs(neighbours).max() < 0.07


def test_tracks_that_move_shake_the_gyro() -> None:
    shaken = rates_deg_s(at_rest("mpu6050", 1, 4000, moving=True))
    # 0.3 °/s RMS plus the gyro's own 0.035; 40 s of a band of about 4 Hz give a standard deviation to 4 %.
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
    # 0.02 °/s left, 0.005 wandering, 0.0035 of noise in a mean of 100; 120 values give it to 6.5 %.
    assert means.std() == pytest.approx(math.hypot(0.02, 0.005, 0.0035), rel=0.2)


def test_the_bias_wanders_within_its_bounds_and_slowly() -> None:
    tens = np.array([rates_deg_s(at_rest("mpu6050", seed, 3000)).reshape(3, 1000, 3).mean(axis=1) for seed in range(8)])
    steps = np.diff(tens, axis=1)
    # A Gauss-Markov process of 0.005 °/s and 100 s changes by 0.005 √(2 (1 - e^-0.1)) = 0.0022 °/s in ten seconds, less
    # a little for averaging; noise in the means of 1000 adds 0.0016. 48 differences give it to 10 %.
    assert steps.std() == pytest.approx(math.hypot(0.0021, 0.0016), rel=0.35)


def test_the_accelerometer_measures_gravity_and_acceleration_in_the_chairs_frame() -> None:
    R_WB = rotation_y(-30.0 * DEG)
    imu = Imu(IMUS["ideal"], 0.0, np.random.default_rng(0))
    at_ease = imu.sample(0.0, R_WB, STILL, STILL, moving=False).linear_acceleration_m_s2
    # Nose up by 30°: half of g along x, as if it accelerated forward.
    np.testing.assert_allclose(at_ease, [9.81 * 0.5, 0.0, 9.81 * math.cos(30.0 * DEG)], atol=1e-12)
    pushed = imu.sample(0.01, R_WB, STILL, np.array([0.0, 2.0, 0.0]), moving=False).linear_acceleration_m_s2
    np.testing.assert_allclose(np.subtract(pushed, at_ease), [0.0, 2.0, 0.0], atol=1e-12)
    noisy = np.array([sample.linear_acceleration_m_s2 for sample in at_rest("mpu6050", 2, 2000)])
    np.testing.assert_allclose(noisy.std(axis=0), 0.03, rtol=0.06)


@pytest.mark.parametrize("seed", range(4))
def test_a_biased_accelerometer_tilts_the_attitude_by_the_gravity_error(seed: int) -> None:
    up = up_in_chair(at_rest("mpu6050", seed, 6000, gravity_error_deg=0.5))[3000:]
    mean = up.mean(axis=0)
    angle_deg = math.acos(float(mean[2] / np.linalg.norm(mean))) / DEG
    # A gyro bias of up to three sigma (0.06 °/s) holds the filter off by 0.06 · 2 s = 0.12°.
    assert angle_deg == pytest.approx(0.5, abs=0.13)
    # 0.03 m/s² of white noise through 2 s: (0.03 / 9.81) √(0.01 / (2 · 2)) rad = 0.0088°; the gyro's 0.005 °/s/√Hz adds
    # 0.005 √(2 / 4) = 0.0035 to it. A mean over 30 s holds 7 independent values: 30 %, three sigma.
    np.testing.assert_allclose(up[:, :2].std(axis=0) / DEG, 0.0095, rtol=0.9)


@pytest.mark.parametrize("kind", ["ideal", "mpu6050"])
def test_the_gravity_error_is_fixed_to_the_chair_and_its_direction_drawn(kind: str) -> None:
    directions = []
    for seed in range(6):
        ups = [
            up_in_chair(at_rest(kind, seed, 1, gravity_error_deg=0.5, R_WB=rotation_z(turn)))[0] for turn in (0.0, 0.5 * math.pi)
        ]
        # The first tick's accelerometer noise is the same in the chair; the alignment's is drawn about the world's axes: 0.02°.
        np.testing.assert_allclose(ups[0], ups[1], atol=0.0 if kind == "ideal" else 3e-3)
        directions.append(math.atan2(ups[0][1], ups[0][0]))
    if kind == "mpu6050":
        assert np.ptp(directions) > 1.0


@pytest.mark.parametrize("pitch_deg", [0.0, -30.0, 30.0])
def test_a_chair_at_rest_is_levelled_to_a_fraction_of_a_degree(pitch_deg: float) -> None:
    R_WB = rotation_y(pitch_deg * DEG)
    for seed in range(8):
        up = up_in_chair(at_rest("mpu6050", seed, 1500, R_WB=R_WB))
        errors = np.arccos(np.clip(up @ R_WB[2], -1.0, 1.0)) / DEG
        # Gyro bias times 2 s: 0.04° per axis, alignment noise 0.018°; four sigma on both axes at once.
        assert errors.max() < 0.25


def test_an_acceleration_tilts_the_attitude_and_two_seconds_later_it_is_forgotten() -> None:
    imu = Imu(IMUS["mpu6050"], 0.0, np.random.default_rng(1))
    samples = [
        imu.sample(k * TICK_S, LEVEL, STILL, np.array([0.8 if k < 50 else 0.0, 0.0, 0.0]), moving=False) for k in range(1050)
    ]
    pitch_deg = np.array([sample.pitch_rad for sample in samples]) / DEG
    # A push ahead tilts the specific force by atan(0.8 / 9.81) = 4.66°, front up: 0.5 s of it moves a 2 s filter by
    # 1 - e^(-1/4) of that, 1.03°; bias and noise stay below 0.1°.
    assert pitch_deg[49] == pytest.approx(1.03, abs=0.1)
    # Ten seconds later e^-5 of it is left, 0.007°.
    assert abs(pitch_deg[-1]) < 0.1


def test_a_jolt_beyond_a_tenth_of_g_is_not_taken_for_gravity() -> None:
    imu = Imu(IMUS["mpu6050"], 0.0, np.random.default_rng(2))
    samples = [imu.sample(k * TICK_S, LEVEL, STILL, np.array([0.0, 0.0, 3.0]) + 20.0 * (k > 0), moving=False) for k in range(100)]
    # Only the gyro turns the attitude meanwhile: at most 0.06 °/s for a second, and 0.02° of alignment twice.
    assert max(abs(sample.pitch_rad) for sample in samples) / DEG < 0.12


def test_the_attitude_follows_a_rocking_chair() -> None:
    imu = Imu(IMUS["mpu6050"], 0.0, np.random.default_rng(3))
    errors = []
    for k in range(3000):
        phase = 2.0 * math.pi * 0.6 * k * TICK_S
        pitch, rate = 6.0 * DEG * math.sin(phase), 6.0 * DEG * 2.0 * math.pi * 0.6 * math.cos(phase)
        sample = imu.sample(k * TICK_S, rotation_y(-pitch), np.array([0.0, -rate, 0.0]), STILL, moving=True)
        errors.append(sample.pitch_rad - pitch)
    # Scale error of 1 % of 6°, gyro bias 0.04°, vibration 0.005°.
    assert np.abs(errors).max() / DEG < 0.2


def test_an_ideal_imu_follows_a_turn_from_an_arbitrary_zero() -> None:
    samples = turning("ideal", 3, 2.0, 0.5)
    yaw = np.unwrap([yaw_rad(sample) for sample in samples])
    # A quaternion of half the angle, not of its tangent: 0.0025³ / 3 of two parts.
    np.testing.assert_allclose(np.diff(yaw), 0.5 * TICK_S, atol=2e-8)
    zeros = [yaw_rad(at_rest("ideal", seed, 1)[0]) for seed in range(6)]
    assert np.ptp(zeros) > 1.0


def test_yaw_drifts_by_what_the_gyro_measures_wrong() -> None:
    samples = turning("mpu6050", 4, 10.0, 0.3)
    rates = np.array([float(sample.angular_velocity_rad_s[2]) for sample in samples])
    wrong = float((0.5 * (rates[1:] + rates[:-1]) - 0.3).sum()) * TICK_S  # the trapezoid rule, as the filter integrates
    drift = wrap(yaw_rad(samples[-1]) - yaw_rad(samples[0]) - 0.3 * (len(samples) - 1) * TICK_S)
    # A tilt of 0.1° turns yaw in the second order: 0.3 rad/s · 10 s · (0.1°)² / 2 = 5e-6, and its coning as much again.
    assert drift == pytest.approx(wrong, abs=5e-5)


def test_a_turn_is_measured_within_the_scale_error() -> None:
    shares = []
    for seed in range(20):
        rates = [float(sample.angular_velocity_rad_s[2]) for sample in turning("mpu6050", seed, 1.0, 1.0)]
        shares.append(np.mean(rates) - 1.0)
    # Uniform within ±1 %, plus bias and noise of 0.0004.
    assert np.abs(shares).max() < 0.012
    assert np.std(shares) == pytest.approx(0.01 / math.sqrt(3.0), rel=0.4)
