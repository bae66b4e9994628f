"""Camera readings are delayed and in order, some dropped; encoders quantise."""

import numpy as np
import pytest

from treadline.core.signals import TICK_S, FrameQuality
from treadline.plant.mujoco import open_plant
from treadline.plant.sensors._instruments import CameraLink, Encoder
from treadline.scenario.scenario import Control, Realism, Scenario, Start


def frame(tick: int) -> FrameQuality:
    return FrameQuality(t_s=tick * TICK_S, fingerprint=tick, brightness=0.5, contrast=0.2, valid_share=1.0)


def delays_s(realism: Realism, frames: int) -> np.ndarray:
    """Return how late each of many frames at 10 Hz arrives."""
    link = CameraLink(realism, np.random.default_rng(0))
    late = []
    for tick in range(10, 10 * frames + 10):
        if tick % 10 == 0:
            link.send(tick, [frame(tick)])
        late += [tick * TICK_S - reading.t_s for reading in link.arrived(tick)]
    return np.array(late)


def test_a_latency_is_rounded_up_to_the_tick_and_none_is_none() -> None:
    np.testing.assert_allclose(delays_s(Realism(camera_latency_s=0.055, camera_jitter_s=0.0), 50), 0.06)
    assert (delays_s(Realism(camera_latency_s=0.0, camera_jitter_s=0.0), 50) == 0.0).all()


def test_jitter_spreads_the_latency_and_never_changes_the_order() -> None:
    late = delays_s(Realism(camera_latency_s=0.06, camera_jitter_s=0.01), 4000)
    # Rounding up adds half a tick to the mean and TICK/√12 = 0.003 s to the spread; 4000 frames give both to 2 %.
    assert late.mean() == pytest.approx(0.065, abs=0.001)
    assert late.std() == pytest.approx(np.hypot(0.01, 0.0029), rel=0.05)
    link = CameraLink(Realism(camera_latency_s=0.1, camera_jitter_s=0.2), np.random.default_rng(1))
    stamps = []
    for tick in range(5000):
        if tick % 10 == 0:
            link.send(tick, [frame(tick)])
        stamps += [reading.t_s for reading in link.arrived(tick)]
    assert (np.diff(stamps) > 0.0).all()


def test_the_drop_rate_is_that_of_the_frames() -> None:
    link = CameraLink(Realism(camera_drop_rate=0.1), np.random.default_rng(2))
    # Binomial: 0.003 of one sigma in 10000.
    assert np.mean([link.is_dropped() for _ in range(10000)]) == pytest.approx(0.1, abs=0.01)


def test_an_encoder_quantises_speed_and_loses_no_distance() -> None:
    encoder = Encoder(10_000.0)
    read = np.array([encoder.speed_m_s(0.1234) for _ in range(1000)])
    # A count is 0.1 mm in 10 ms: steps of 10 mm/s.
    np.testing.assert_allclose(read / 0.01, np.round(read / 0.01), atol=1e-9)
    assert set(np.round(read, 6)) == {0.12, 0.13}
    assert read.sum() * TICK_S == pytest.approx(1.234, abs=1e-4)
    assert Encoder(0.0).speed_m_s(0.1234) == 0.1234
    assert Encoder(0.0, error=0.02).speed_m_s(0.1) == pytest.approx(0.102)


def test_a_plant_delivers_frames_late_with_the_stamp_of_their_exposure() -> None:
    scenario = Scenario(
        start=Start(place="flight"),
        control=Control(vision="truth"),
        realism=Realism(camera_latency_s=0.05, camera_jitter_s=0.0, camera_drop_rate=0.0),
    )
    plant = open_plant(scenario, 0)
    plant.start()
    seen = []
    for tick in range(31):
        plant.advance(tick * TICK_S)
        seen += [(tick, round(r.t_s / TICK_S)) for r in plant.read() if isinstance(r, FrameQuality)]
    # The first frame shows a chair that has stood there before.
    assert seen == [(0, 0), (15, 10), (25, 20)]
