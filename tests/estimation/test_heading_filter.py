"""Heading filter on synthetic data with known truth, and with failing sensors."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from world import belts

from treadline.core.angles import DEG, wrap
from treadline.core.arrays import rms
from treadline.core.errors import ShapeMismatch
from treadline.core.rotations import rotation_y, rotation_z
from treadline.core.signals import HeadingEstimate, HeadingMeasurement, ImuSample
from treadline.estimation import FilterConfig, HeadingFilter

IMU_S, FRAME_S = 0.01, 0.1
TICKS_PER_FRAME = 10
VISION_SIGMA_RAD = 0.3 * DEG
GYRO_SIGMA_RAD_S = 0.35 * DEG
BIAS_SIGMA_RAD_S, BIAS_TAU_S = 0.005 * DEG, 100.0
SEEDS = range(1000, 1003)
GAP_FROM_S = 90.0

Frame = tuple[float, float]
"""Stamp [s] and heading [rad] of a frame as delivered by vision."""


def gyro(t_s: float, rate_rad_s: float) -> ImuSample:
    return ImuSample(
        t_s=t_s,
        orientation=np.array([1.0, 0.0, 0.0, 0.0]),
        angular_velocity_rad_s=np.array([0.0, 0.0, rate_rad_s]),
        linear_acceleration_m_s2=np.array([0.0, 0.0, 9.81]),
    )


def seen(t_s: float, heading_rad: float, sigma_rad: float = VISION_SIGMA_RAD) -> HeadingMeasurement:
    return HeadingMeasurement(t_s=t_s, heading_rad=heading_rad, sigma_rad=sigma_rad, edge_count=6)


@dataclass
class Climb:
    """Chair that starts at 30°, turns square and continues to sway, with its sensor readings."""

    seed: int
    seconds: float = 120.0
    shaken: bool = False
    """Whether the gyro is the simulator's MPU-6050 on a vibrating chassis, instead of one with 0.35 °/s of white noise."""
    has_belts: bool = False
    """Whether belt readings are supplied: equal speeds except for the difference that turns the chair."""
    bias_rad_s: float = 0.03 * DEG
    frames: Callable[[float, float], Frame | None] = lambda t_s, heading: (t_s, heading)
    imu: Callable[[float, float], float | None] = lambda _t_s, rate: rate
    truth: Float[np.ndarray, " n"] = field(init=False)
    estimates: list[HeadingEstimate | None] = field(init=False)
    filter: HeadingFilter = field(default_factory=HeadingFilter)
    faults: list[tuple[float, str]] = field(default_factory=list)
    """Time and kind of each fault when first reported."""

    def __post_init__(self) -> None:
        rng = np.random.default_rng(self.seed)
        ticks = round(self.seconds / IMU_S)
        t = IMU_S * np.arange(ticks)
        phase = rng.uniform(0.0, 2.0 * np.pi, size=2)
        # 30° decaying with a time constant of 2 s (up to 15 °/s), nosings every second, a slow drift across the stair.
        self.truth = DEG * (30.0 * np.exp(-t / 2.0) + 0.5 * np.sin(2 * np.pi * t + phase[0]) + np.sin(t / 5 + phase[1]))
        rate = np.gradient(self.truth, IMU_S)
        walk = np.cumsum(BIAS_SIGMA_RAD_S * np.sqrt(2.0 * IMU_S / BIAS_TAU_S) * rng.normal(size=ticks))
        measured = (
            self._shaken(rate, rng) if self.shaken else rate + self.bias_rad_s + walk + GYRO_SIGMA_RAD_S * rng.normal(size=ticks)
        )
        noise = VISION_SIGMA_RAD * rng.normal(size=ticks)
        self.estimates = [None] * ticks
        for k in range(ticks):
            if self.has_belts:
                self.filter.step(belts(float(t[k]), 0.2, 0.2 + float(rate[k]) / 0.38))
            sensed = self.imu(float(t[k]), float(measured[k]))
            if sensed is not None:
                self.estimates[k] = self.filter.step(gyro(float(t[k]), sensed))
            if k % TICKS_PER_FRAME == 0:
                frame = self.frames(float(t[k]), float(self.truth[k] + noise[k]))
                if frame is not None:
                    self.estimates[k] = self.filter.step(seen(*frame))
                    self._note()

    def _note(self) -> None:
        health = self.filter.health
        if health is not None and health.fault is not None and health.since_s is not None:
            reported = (health.since_s, health.fault)
            if reported not in self.faults:
                self.faults.append(reported)

    def _shaken(self, rate: Float[np.ndarray, " n"], rng: np.random.Generator) -> Float[np.ndarray, " n"]:
        """Return the reading of an MPU-6050: 0.035 °/s of noise, bias, 1 % of scale, and 0.3 °/s of vibration."""
        turn = 2.0 * np.pi * 8.0 * IMU_S
        keep = np.exp(-0.15 * turn)
        driven = 0.0049 * DEG * np.sqrt(1.0 - keep**2) * rng.normal(size=(rate.size, 2)) @ np.array([1.0, 1.0j])
        phasor, angle = 0.0j, [0.0]
        for draw in driven.tolist():
            phasor = keep * np.exp(1j * turn) * phasor + draw
            angle.append(phasor.real)
        scale = 1.0 + 0.01 * rng.uniform(-1.0, 1.0)
        return scale * rate + 0.02 * DEG * rng.normal() + np.diff(angle) / IMU_S + 0.035 * DEG * rng.normal(size=rate.size)

    def found_s(self, since_s: float) -> float:
        """Return the time of the first fault reported after a time, or infinity."""
        return min((t_s for t_s, _ in self.faults if t_s >= since_s), default=math.inf)

    def errors_deg(self, since_s: float = 0.0, until_s: float = np.inf) -> Float[np.ndarray, " n"]:
        # Far from half a turn, so a plain difference will do.
        return np.array(
            [
                (estimate.heading_rad - truth) / DEG
                for estimate, truth in zip(self.estimates, self.truth.tolist(), strict=True)
                if estimate is not None and since_s <= estimate.t_s < until_s
            ]
        )


def begun(heading_rad: float = 0.1, rate_rad_s: float = 0.0) -> HeadingFilter:
    """Return a filter that has had a sample and a frame at 0 s."""
    heading = HeadingFilter()
    heading.step(gyro(0.0, rate_rad_s))
    heading.step(seen(0.0, heading_rad))
    return heading


def within(t_s: float, start_s: float, seconds: float) -> bool:
    return start_s <= t_s < start_s + seconds


@pytest.fixture(scope="module")
def climbs() -> list[Climb]:
    """Return three climbs of two minutes with white gyro noise and no stair in the last 30 s."""
    return [Climb(seed, frames=lambda t, h: (t, h) if t < GAP_FROM_S else None) for seed in SEEDS]


@pytest.fixture(scope="module")
def shaken() -> list[Climb]:
    """Return the same with the simulator's gyro on a vibrating chassis."""
    return [Climb(seed, shaken=True, frames=lambda t, h: (t, h) if t < GAP_FROM_S else None) for seed in SEEDS]


def test_noise_and_bias_leave_less_than_0_15_degrees(climbs: list[Climb]) -> None:
    errors = [rms(climb.errors_deg(since_s=2.0, until_s=GAP_FROM_S)) for climb in climbs]
    # The design target, for each seed; the first 2 s are needed to average frames of 0.3°.
    assert max(errors) <= 0.15


def test_on_a_vibrating_chassis_thirty_seconds_without_vision_stay_within_half_a_degree(shaken: list[Climb]) -> None:
    # The target for the worst case. Sigma at the end is 0.12°: 0.09 from the bias, 0.07 from its drift, 0.03 from the start.
    assert max(np.abs(climb.errors_deg(since_s=2.0)).max() for climb in shaken) <= 0.5
    assert max(rms(climb.errors_deg(since_s=2.0, until_s=GAP_FROM_S)) for climb in shaken) <= 0.10


def test_as_long_as_the_guard_lets_the_gyro_drive_alone_half_a_degree_is_kept(climbs: list[Climb]) -> None:
    worst = [np.abs(climb.errors_deg(since_s=2.0, until_s=GAP_FROM_S + 12.0)).max() for climb in climbs]
    # The guard holds 12 s after the last stair. Sigma is 0.16° there (as above); three sigma are just under the required 0.5°.
    assert max(worst) <= 0.5


def deviations(climb: Climb) -> list[float]:
    """Return a climb's errors each second, in declared standard deviations; systematic errors of real frames are absent."""
    systematic_sigma_rad = FilterConfig().systematic_sigma_rad
    return [
        (estimate.heading_rad - truth) / math.sqrt(estimate.sigma_rad**2 - systematic_sigma_rad**2)
        for estimate, truth in zip(climb.estimates[200::100], climb.truth[200::100].tolist(), strict=True)
        if estimate is not None
    ]


def test_sigma_is_consistent_for_random_walk_and_for_vibration(climbs: list[Climb], shaken: list[Climb]) -> None:
    for group in (climbs, shaken):
        squares = [ratio**2 for climb in group for ratio in deviations(climb)]
        # Errors persist for about ten seconds: some 50 independent ones, a standard deviation of 0.2; benchmarks/fusion.py has many
        # more. The kind of noise takes a minute to learn, and until then sigma lies between.
        assert 0.4 <= np.mean(squares) <= 1.6


def test_vision_determines_the_gyros_angle_random_walk(climbs: list[Climb], shaken: list[Climb]) -> None:
    walks = [np.mean([climb.filter.health.walk_rad_rts for climb in group if climb.filter.health]) for group in (climbs, shaken)]
    # 0.35 °/s per sample walk 0.035° in a second, the sensor alone 0.0035°.
    assert walks[0] > 0.025 * DEG
    assert walks[1] < 0.018 * DEG


def test_a_turn_seen_by_vision_determines_the_gyro_scale() -> None:
    reported = [Climb(9, seconds=20.0, shaken=True, imu=lambda _t, rate, by=by: by * rate).filter.health for by in (1.0, 1.02)]
    scales = [health.scale for health in reported if health is not None]
    # 2 % of the 30° turn are 0.6°, three prior sigma, half of it before the heading is known accurately.
    assert 0.005 < scales[1] - scales[0] < 0.025


def test_sigma_does_not_average_errors_shared_by_frames() -> None:
    squares, sigmas = [], []
    for seed in range(3):
        for memory_s in (8.0, 1e9):
            # Errors shared by neighbouring frames: 0.25° with a correlation time of some seconds, and 0.1° independent per frame.
            rng, vision, keep = np.random.default_rng(seed), np.random.default_rng(seed), math.exp(-FRAME_S / memory_s)
            error = 0.25 * DEG * vision.normal()
            held = HeadingFilter()
            for k in range(6000):
                t_s = k * IMU_S
                heading = 0.1 * math.sin(t_s / 3.0)
                estimate = held.step(gyro(t_s, 0.1 / 3.0 * math.cos(t_s / 3.0) + 0.035 * DEG * rng.normal()))
                if k % TICKS_PER_FRAME == 0:
                    # Declared: the total error of a frame.
                    error = keep * error + 0.25 * DEG * math.sqrt(1.0 - keep**2) * vision.normal()
                    estimate = held.step(seen(t_s, heading + error + 0.1 * DEG * vision.normal(), sigma_rad=0.27 * DEG))
                if k % 100 == 99 and estimate is not None:
                    squares.append(((estimate.heading_rad - heading) / estimate.sigma_rad) ** 2)
                    sigmas.append(estimate.sigma_rad)
    # Six drives with a few independent errors each; taken as white, sigma would be 0.06° and this mean above ten.
    assert np.mean(squares) < 2.5
    assert np.median(sigmas) > 0.12 * DEG


def in_burst(t_s: float) -> bool:
    """Whether a frame is one of the first twenty of a ten-second stretch, except the first stretch."""
    frame = round(t_s / FRAME_S)
    return frame >= 100 and frame % 100 < 20


@pytest.mark.parametrize("seed", SEEDS[:3])
def test_bursts_of_two_seconds_with_twelve_degrees_of_bias_are_rejected(seed: int) -> None:
    climb = Climb(seed, seconds=60.0, frames=lambda t, h: (t, h + (12.0 * DEG if in_burst(t) else 0.0)))
    # A fifth of the frames is wrong: the gyro's drift over 2 s is 0.07°, so the error must stay below 0.5°.
    assert np.abs(climb.errors_deg(since_s=2.0)).max() < 0.5
    # Five bursts of 20 frames, and occasional correct frames beyond three sigma (0.3 %).
    assert 100 <= climb.filter.rejected_count <= 110


@pytest.mark.parametrize(("jump_deg", "over_s"), [(6.0, 0.1), (19.0, 0.1), (30.0, 0.3)])
def test_a_gyro_jump_under_continuous_vision_is_detected_and_corrected(jump_deg: float, over_s: float) -> None:
    rate = jump_deg * DEG / over_s
    climb = Climb(1, seconds=20.0, has_belts=True, imu=lambda t, reading: reading + (rate if within(t, 10.03, over_s) else 0.0))
    jumped = np.abs(climb.errors_deg())
    # The belts cannot turn the chair so fast: the sample is rejected, and hazard 7 allows 5°.
    assert jumped.max() < 5.0
    # Three frames constitute a disagreement; hazard 7 requires 0.5 s.
    assert climb.found_s(10.0) <= 10.03 + over_s + 0.4
    # A second of consistent frames, after a jump of up to 0.3 s and with one frame of tolerance: one of 0.3°, four sigma of it.
    assert jumped[1200:].max() < 1.2


@pytest.mark.parametrize("rate_deg_s", [1900.0, -300.0])
def test_an_implausible_rate_is_rejected_and_reported(rate_deg_s: float) -> None:
    clean = Climb(1, seconds=12.0)
    odd = Climb(1, seconds=12.0, imu=lambda t, rate: rate + (rate_deg_s * DEG if abs(t - 10.0) < 1e-9 else 0.0))
    # One sample less: the turn during 10 ms is interpolated.
    assert [kind for _, kind in odd.faults] == ["jump"]
    assert odd.found_s(10.0) == pytest.approx(10.0, abs=0.02)
    assert np.abs(odd.errors_deg(since_s=9.9)).max() < np.abs(clean.errors_deg(since_s=9.9)).max() + 0.05


def test_implausible_gyro_samples_do_not_hide_a_vision_error() -> None:
    """Test: vision 10° off for 1.5 s, one implausible gyro sample every 0.4 s. Expected result: the disagreement is reported
    throughout, since its beginning, so that the guard holds (hazard 7)."""
    spits = [10.2, 10.6, 11.0, 11.4]
    climb = Climb(
        1,
        seconds=11.5,
        imu=lambda t, rate: rate + (300.0 * DEG if min(abs(t - spit) for spit in spits) < 1e-9 else 0.0),
        frames=lambda t, h: (t, h + (10.0 * DEG if t > 10.0 else 0.0)),
    )
    (began_s,) = {t_s for t_s, kind in climb.faults if kind == "disagreement"}
    assert 10.0 < began_s < 10.6
    assert (climb.filter.health.fault, climb.filter.health.since_s) == ("disagreement", began_s)


@pytest.mark.parametrize(("seed", "step_deg_s"), [(1, 1.0), (2, -2.0), (1, 5.0)])
def test_a_gyro_drift_is_detected_within_a_second_and_corrected(seed: int, step_deg_s: float) -> None:
    climb = Climb(seed, seconds=35.0, has_belts=True, imu=lambda t, rate: rate + (step_deg_s * DEG if t > 20.03 else 0.0))
    # 1 °/s and frames of 0.3°: their ramp reaches 4.5 sigma after 0.8 s, a little sooner with belt readings. The half second of
    # hazard 7 is met from 2 °/s.
    assert climb.found_s(20.03) - 20.03 <= (0.95 if abs(step_deg_s) < 2.0 else 0.5)
    assert climb.faults[0][1] == "drift"
    # The drift acts until it is detected, and is then known to a third.
    assert np.abs(climb.errors_deg(since_s=20.0)).max() < 0.8 + abs(step_deg_s)
    # After that the bias is known, and the heading is as accurate as before: four sigma of 0.1°.
    assert np.abs(climb.errors_deg(since_s=27.0)).max() < 0.4


def test_correct_sensors_raise_no_fault(shaken: list[Climb]) -> None:
    # Six minutes, with and without a stair in view.
    assert [climb.faults for climb in shaken] == [[]] * len(shaken)


@pytest.mark.parametrize(("seed", "wall_deg", "unseen_s"), [(1, -20.0, 0.0), (2, 3.0, 0.0), (3, -12.0, 1.0), (4, 2.5, 1.0)])
def test_the_wall_of_a_landing_is_not_accepted_as_heading(seed: int, wall_deg: float, unseen_s: float) -> None:
    climb = Climb(
        seed,
        seconds=34.0,
        shaken=True,
        frames=lambda t, h: (t, h) if t < 20.0 else None if t < 20.0 + unseen_s else (t, h + wall_deg * DEG),
    )
    # The wall is in view for 14 s, as at the top of a flight; the gyro alone drifts by 0.2° in that time.
    assert np.abs(climb.errors_deg(since_s=2.0)).max() < 0.8
    assert climb.faults[-1][1] == "disagreement"
    health = climb.filter.health
    # One frame's noise, four sigma.
    assert health.disagreement_rad == pytest.approx(wall_deg * DEG, abs=1.2 * DEG)
    assert health.unseen_s > 12.0


def test_a_wrong_first_frame_is_replaced_after_four_seconds() -> None:
    climb = Climb(1, seconds=10.0, frames=lambda t, h: (t, h + (15.0 * DEG if t == 0.0 else 0.0)))
    # No earlier measurement supports it.
    assert np.abs(climb.errors_deg(since_s=5.0)).max() < 1.2


def test_a_gyro_that_repeats_itself_while_the_belts_run_is_stuck() -> None:
    climb = Climb(2, seconds=20.0, has_belts=True, imu=lambda t, rate: rate if t < 10.0 else 0.003)
    assert climb.faults[0] == (pytest.approx(10.2, abs=0.011), "stuck")
    assert "0.172 °/s" in climb.filter.health.cause
    # As with a silent gyro: vision carries the heading for a second, then the stamp stops.
    assert climb.estimates[-10].t_s <= 11.3


def standing(heading: HeadingFilter, from_s: float, to_s: float, rate: float, belts_m_s: float) -> list[str | None]:
    """Run a filter under steady belts and a repeating gyro; return the reported gyro fault, tick by tick."""
    said = []
    for k in range(round(from_s / IMU_S), round(to_s / IMU_S)):
        heading.step(belts(k * IMU_S, belts_m_s, belts_m_s, brake_on=belts_m_s == 0.0))
        heading.step(gyro(k * IMU_S, rate))
        said.append(None if heading.health is None else heading.health.fault)
    return said


def test_a_stuck_gyro_stays_stuck_under_a_chair_that_stops_for_it() -> None:
    """Test: the gyro sticks while the belts run, and they then stop. Expected result: stuck until the reading changes."""
    heading = begun(rate_rad_s=0.01)
    assert "stuck" in standing(heading, 0.01, 0.5, 0.02, 0.2)
    assert set(standing(heading, 0.5, 2.0, 0.02, 0.0)) == {"stuck"}
    heading.step(gyro(2.0, 0.021))
    assert heading.health.fault != "stuck"


def test_a_gyro_that_repeats_after_the_belts_stop_is_accepted() -> None:
    """Test: a gyro with coarse resolution, at rest from the moment the belts stop. Expected result: no fault."""
    heading = HeadingFilter()
    heading.step(seen(0.0, 0.1))
    for k in range(1, 100):
        heading.step(belts(k * IMU_S))
        heading.step(gyro(k * IMU_S, 0.001 * (k % 3)))
    assert set(standing(heading, 1.0, 3.0, 0.0, 0.0)) == {None}


def test_a_stuck_gyro_that_comes_back_is_used_again() -> None:
    climb = Climb(3, seconds=25.0, has_belts=True, imu=lambda t, rate: 0.003 if within(t, 10.0, 3.0) else rate)
    assert np.abs(climb.errors_deg(since_s=16.0)).max() < 0.5
    assert climb.filter.health.fault is None


@pytest.mark.parametrize("turn_deg_s", [0.3, 0.9, 5.0])
def test_a_frozen_picture_does_not_hold_the_heading(turn_deg_s: float) -> None:
    held = HeadingFilter()
    for k in range(400):
        t_s = k * IMU_S
        held.step(gyro(t_s, 0.0 if t_s < 2.0 else turn_deg_s * DEG))
        if k % TICKS_PER_FRAME == 0:
            estimate = held.step(seen(t_s, 0.1))
    # From 2 s to the last frame at 3.9 s no frame may have a significant effect; a tenth of a degree is the turn after which a
    # repeated heading is rejected, and is attributed to the gyro's bias in the meantime.
    assert estimate.heading_rad == pytest.approx(0.1 + 1.9 * turn_deg_s * DEG, abs=0.2 * DEG)


@pytest.mark.parametrize("heading_deg", [0.0, 5.0, -10.0])
@pytest.mark.parametrize("over_s", [0.5, 2.0])
def test_the_heading_is_preserved_from_stair_to_landing(heading_deg: float, over_s: float) -> None:
    """The heading is about the nosing plane's normal on the stair and about gravity on the landing; between them the chair tips."""
    climb_s, slope = 10.0, 28.0 * DEG
    rng, held, estimate, R_WB = np.random.default_rng(6), HeadingFilter(), None, np.eye(3)
    for k in range(round((climb_s + over_s + 1.0) / IMU_S)):
        t_s = k * IMU_S
        down = min(max((t_s - climb_s) / over_s, 0.0), 1.0)
        heading = heading_deg * DEG + 1.0 * DEG * math.sin(t_s)
        before, R_WB = R_WB, rotation_y(-slope * (1.0 - down)) @ rotation_z(heading)
        turn = before.T @ R_WB
        # Rotation from one attitude to the next, about z_B, from the skew-symmetric part.
        sensed = (turn[1, 0] - turn[0, 1]) / (2.0 * IMU_S) if k > 0 else 0.0
        estimate = held.step(gyro(t_s, sensed + 0.035 * DEG * rng.normal())) or estimate
        if k % TICKS_PER_FRAME == 0 and t_s < climb_s - 2.0:
            estimate = held.step(seen(t_s, heading + VISION_SIGMA_RAD * rng.normal()))
    # On the landing, heading is the rotation about the vertical. The target is 1.5°; eight seconds of frames determine it to 0.1°,
    # four sigma. The IMU's yaw, which is about gravity, would have changed from 11.3° to 10° on the way.
    assert abs(wrap(estimate.heading_rad - math.atan2(R_WB[1, 0], R_WB[0, 0]))) < 0.4 * DEG


@pytest.mark.parametrize(("seconds", "until_s", "every", "limit_deg"), [(20.0, 19.0, 5, 0.5), (40.0, 40.0, 12, 1.0)])
def test_sparse_frames_do_not_override_the_gyro(seconds: float, until_s: float, every: int, limit_deg: float) -> None:
    """Test: after 10 s frames off by 12°, at 2 Hz: nine in 4 s, 20 in 9.5 s, within which the error is the gyro's 0.2°; then 1.2 s
    apart: 25 in 30 s. Expected result: never accepted. Three sigma of 30 s on the gyro alone are 0.85°."""

    def sparse(t: float, h: float) -> Frame | None:
        return (t, h) if t < 10.0 else (t, h + 12.0 * DEG) if round(t / FRAME_S) % every == 0 else None

    climb = Climb(2, seconds=seconds, frames=sparse)
    assert np.abs(climb.errors_deg(since_s=2.0, until_s=until_s)).max() < limit_deg


MEANINGLESS = [
    *(lambda _, stamp=stamp: gyro(stamp, 0.1) for stamp in (np.nan, np.inf)),
    *(lambda tick, rate=rate: gyro((tick + 0.2) * IMU_S, rate) for rate in (np.nan, np.inf, 1e300)),
    *(lambda tick, back=back: gyro((tick - back) * IMU_S, 30.0) for back in (0, 5)),
    *(lambda _, stamp=stamp: seen(stamp, 0.3) for stamp in (np.nan, np.inf)),
    *(lambda tick, back=back: seen((tick - back) * IMU_S, 0.11) for back in (3, 4, 35)),
    *(lambda tick, heading=heading: seen(tick * IMU_S, heading) for heading in (np.nan, np.inf)),
    *(lambda tick, sigma=sigma: seen(tick * IMU_S, 0.1, sigma) for sigma in (np.nan, 0.0, -1.0, 1e300)),
]
"""Signals by the tick at which they come, three ticks after a frame: not finite, or not newer than those before."""


@pytest.mark.parametrize("meaningless", MEANINGLESS)
def test_a_signal_without_meaning_changes_nothing_then_and_later(meaningless: Callable[[int], Any]) -> None:
    clean, odd = begun(), begun()
    for tick in range(1, 200):
        t_s = tick * IMU_S
        estimates = [heading.step(gyro(t_s, 0.1)) for heading in (clean, odd)]
        if tick % TICKS_PER_FRAME == 0:
            estimates = [heading.step(seen(t_s, 0.1 + 0.1 * t_s)) for heading in (clean, odd)]
        if tick % TICKS_PER_FRAME == 3:
            estimates[1] = odd.step(meaningless(tick))
        # The same bits as without these signals.
        assert estimates[0] == estimates[1]


def test_a_frame_older_than_the_filters_memory_is_dropped() -> None:
    heading = begun()
    for k in range(1, 301):
        before = heading.step(gyro(k * IMU_S, 0.0))
    assert heading.step(seen(1.9, 0.101)) == before
    assert heading.step(seen(2.1, 0.101)) != before


@pytest.mark.parametrize("late_s", [0.1, 0.3])
def test_late_frames_are_paired_with_the_heading_of_their_time(late_s: float) -> None:
    rate = 15.0 * DEG
    heading = HeadingFilter()
    estimate = None
    for k in range(1000):
        t_s = k * IMU_S
        estimate = heading.step(gyro(t_s, rate))
        if k % TICKS_PER_FRAME == 0 and t_s >= late_s:
            estimate = heading.step(seen(t_s - late_s, wrap(rate * (t_s - late_s))))
    # Taken as current, a frame 0.1 s late would be wrong by 1.5°. One tick at 15 °/s is 0.15°, of which the bias learns 1/10.
    assert abs(wrap(estimate.heading_rad - rate * estimate.t_s)) < 0.2 * DEG


@pytest.mark.parametrize("gap_s", [0.06, 0.2, 0.5])
def test_unobserved_motion_increases_the_uncertainty(gap_s: float) -> None:
    climb = Climb(
        4, seconds=20.0, frames=lambda t, h: (t, h) if t < 9.0 else None, imu=lambda t, r: None if within(t, 10.0, gap_s) else r
    )
    before, after = climb.estimates[990], climb.estimates[1100]
    # 10 °/s is the declared sigma of an unobserved turn, so one gap adds 10°·gap; other contributions are small.
    assert after.sigma_rad == pytest.approx(np.hypot(before.sigma_rad, 10.0 * DEG * (gap_s + IMU_S)), rel=0.1)


def test_jitter_of_the_gyro_clock_does_not_increase_the_uncertainty() -> None:
    steady, jittery = begun(), begun()
    for k in range(1, 101):
        a = steady.step(gyro(0.04 * k, 0.0))
        b = jittery.step(gyro(0.04 * k + (0.004 if k % 2 and k < 100 else 0.0), 0.0))
    # The sum of squared steps grows by the jitter's 1 %.
    assert b.sigma_rad == pytest.approx(a.sigma_rad, rel=0.02)


def test_without_a_gyro_vision_carries_the_heading_for_a_second_and_says_when_it_stops() -> None:
    climb = Climb(5, seconds=20.0, imu=lambda t, rate: rate if t < 10.0 else None)
    alone = {estimate.t_s: estimate for estimate in climb.estimates if estimate is not None and estimate.t_s > 10.0}
    # Ten frames in a second; the frame at its very end depends on rounding.
    assert len(alone) in {9, 10}
    for estimate in alone.values():
        true = float(climb.truth[round(estimate.t_s / IMU_S)])
        # One frame has 0.3° and little else is known: four sigma.
        assert abs(estimate.heading_rad - true) < 1.2 * DEG
        assert 0.2 * DEG < estimate.sigma_rad < 0.4 * DEG
        # No sensor measures the rate.
        assert estimate.heading_rate_rad_s == 0.0
    last = climb.estimates[-10]
    # The stamp does not advance, so a reader of the estimate detects its age.
    assert last.t_s <= 11.0


def test_a_frame_from_the_future_does_not_stop_the_filter() -> None:
    climb = Climb(7, seconds=20.0, frames=lambda t, h: (t + 0.9, h) if abs(t - 10.0) < 1e-9 else (t, h))
    assert climb.estimates[-1].t_s == pytest.approx(19.99)
    # The wrong stamp costs one inflation of the variance, so the accuracy of one frame, 0.3°: four sigma.
    assert np.abs(climb.errors_deg(since_s=2.0)).max() < 1.2


def test_before_the_first_frame_there_is_no_heading() -> None:
    heading = HeadingFilter()
    assert all(heading.step(gyro(k * IMU_S, 0.1)) is None for k in range(100))


def test_headings_on_both_sides_of_half_a_turn_are_neighbours() -> None:
    heading = begun(np.pi - 0.002)
    heading.step(gyro(0.01, 0.0))
    estimate = heading.step(seen(0.01, -np.pi + 0.002))
    # Between two frames 0.004 rad apart, across the discontinuity.
    assert abs(wrap(estimate.heading_rad - np.pi)) <= 0.002 + 1e-9
    assert heading.rejected_count == 0


def test_the_source_says_when_the_gyro_alone_carries_the_heading() -> None:
    climb = Climb(8, seconds=20.0, frames=lambda t, h: (t, h) if t < 10.0 else None)
    sources = [estimate.source for estimate in climb.estimates if estimate is not None]
    # The last frame is at 9.9 s, plus half a second.
    assert sources[1030] == "vision"
    assert sources[1050] == "gyro"


def test_a_frame_stamped_long_after_the_first_gyro_sample_does_not_shut_out_the_rest() -> None:
    heading = HeadingFilter()
    heading.step(seen(1e6, 0.3))
    for k in range(100):
        estimate = heading.step(gyro(k * IMU_S, 0.0))
        if k % TICKS_PER_FRAME == 0:
            estimate = heading.step(seen(k * IMU_S, 0.31))
    # All are accepted. Identical frames after a different one contain little information on vision errors: three sigma of one.
    assert estimate.heading_rad == pytest.approx(0.31, abs=3.0 * VISION_SIGMA_RAD)
    assert heading.rejected_count == 0
    assert heading.health.unseen_s < 0.1


def test_a_gyro_clock_that_leaps_ahead_does_not_spin_the_heading() -> None:
    estimate = begun(rate_rad_s=0.2).step(gyro(1e4, 0.2))
    # One second of the rate is integrated, and sigma is half a turn: the heading is unknown.
    assert abs(estimate.heading_rad - 0.1) <= 0.2 + 1e-9
    assert estimate.sigma_rad == pytest.approx(np.pi, rel=0.01)


def test_an_imu_sample_may_be_of_lists_and_must_be_of_three_rates() -> None:
    listed = {"orientation": [1, 0, 0, 0], "angular_velocity_rad_s": [0.0, 0.0, 0.1], "linear_acceleration_m_s2": [0.0, 0.0, 9.81]}
    sample = ImuSample(t_s=0.0, **listed)
    assert HeadingFilter().step(sample) is None
    assert sample.orientation == (1.0, 0.0, 0.0, 0.0)
    with pytest.raises(ShapeMismatch, match="angular_velocity_rad_s has 2 numbers; wanted 3"):
        ImuSample(t_s=0.0, **listed | {"angular_velocity_rad_s": [0.0, 0.1]})


def test_a_corrected_mount_moves_the_heading_and_not_the_gyro_bias() -> None:
    """Test: headings off by 2° by a rolled mount, from 20 s on corrected. Expected result: with the correction declared the heading
    is right at once and stays so: 0.15° is three sigma of the filter."""
    rng = np.random.default_rng(8)
    estimator, errors, biases = HeadingFilter(), [], []
    for k in range(4000):
        t_s = k * IMU_S
        truth = 3.0 * DEG * math.sin(t_s / 4.0)
        estimate = estimator.step(gyro(t_s, 0.75 * DEG * math.cos(t_s / 4.0) + GYRO_SIGMA_RAD_S * rng.normal()))
        if k % 10 == 0:
            wrong_rad = 2.0 * DEG if t_s < 20.0 else 0.0
            sigma_rad = 1.2 * DEG if t_s < 20.0 else 0.2 * DEG
            measured = replace(
                seen(t_s, truth + wrong_rad + 0.05 * DEG * rng.normal(), sigma_rad),
                correction_rad=-2.0 * DEG if k == round(20.0 / IMU_S) else 0.0,
            )
            estimate = estimator.step(measured)
        assert estimate is not None or k == 0
        if estimate is not None and t_s >= 20.0:
            errors.append(abs(estimate.heading_rad - truth))
            biases.append(abs(estimator.health.bias_rad_s))
    assert max(errors) < 0.15 * DEG
    assert max(biases) < 0.05 * DEG
    assert estimator.rejected_count == 0
