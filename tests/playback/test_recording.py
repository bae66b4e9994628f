"""A recording holds what the run's signals say, from a sink and from a log alike."""

import math
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from world import flipper

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.ports import Truth
from treadline.core.rotations import rotation_of, rotation_x, rotation_y, rotation_z
from treadline.core.signals import ImuSample
from treadline.playback import Recording, RecordingBuilder, SignalCollector, read_frames, read_recording
from treadline.ros.recorder import open_bag
from treadline.scenario.chair import read_chair
from treadline.vehicle.bodies import payload_com, payload_origin
from treadline.vehicle.staircase import Staircase, as_designed

from .conftest import SCENARIO, TICKS, signals_of_a_run, stair_map, truth

Written = Callable[..., Path]


def built(signals: list, **more: object) -> Recording:
    builder = RecordingBuilder(read_chair("wheelchair"), SCENARIO, seed=3, **more)
    for signal, taken_s in signals:
        builder(signal, taken_s)
    return builder.build(verdict="held", cause="operator")


def test_a_sink_and_a_log_give_the_same_recording(written: Written) -> None:
    from_sink, from_log = built(signals_of_a_run()), read_recording(written(signals_of_a_run()))
    for item in fields(Recording):
        ours, theirs = getattr(from_sink, item.name), getattr(from_log, item.name)
        if isinstance(ours, np.ndarray):
            assert ours.tobytes() == theirs.tobytes(), item.name
    assert from_sink.events == from_log.events
    assert from_sink.phases == from_log.phases
    for one, other in zip(from_sink.maps, from_log.maps, strict=True):
        assert (one.t_s, one.taken_s, one.nosings_W.tobytes()) == (other.t_s, other.taken_s, other.nosings_W.tobytes())
    assert (from_log.verdict, from_log.cause, from_log.seed) == ("held", "operator", 3)
    assert (from_log.limits.pitch_rate_rad_s, from_log.limits.belt_limit_m_s) == (0.4, 1.0)


def test_values_are_held_until_the_next_and_unknown_before_the_first() -> None:
    recording = built(signals_of_a_run())
    assert np.isnan(recording.estimate_rad[:5]).all()
    assert recording.estimate_rad[5] == pytest.approx(0.1)
    # A command every 0.1 s, held in between.
    assert recording.command_m_s[9, 0] == 0.0
    assert recording.command_m_s[10, 0] == pytest.approx(0.01)
    # 0.25 m/s for all but the first tick.
    assert recording.belt_travel_m[-1, 1] == pytest.approx(0.25 * 0.01 * (TICKS - 1), rel=1e-9)


def test_a_flipper_that_only_its_motor_holds_bears_no_load_and_one_with_a_load_its_torque() -> None:
    chair = read_chair("wheelchair")
    own_n_m = 0.5 * chair.tracks.approach_m * chair.flipper.mass_kg * 9.81
    for load_n_m in (0.0, 60.0):
        run = built([(truth(0), 0.0), (flipper(0.0, -20.0 * DEG, own_n_m - load_n_m), 0.0)])  # level, at a pitch of 20°
        assert run.columns["torque_n_m"][0] == pytest.approx(load_n_m)


def test_phases_span_the_run_with_their_causes() -> None:
    recording = built(signals_of_a_run())
    assert [(span.name, span.start_s, span.cause) for span in recording.phases] == [
        ("search", 0.0, "start"),
        ("climb", 0.2, "nosings found"),
    ]
    assert recording.phases[-1].end_s == recording.duration_s
    assert recording.phase_at(0.1999).name == "search"
    assert recording.phase_at(0.2).name == "climb"


def test_a_perceived_nosing_is_placed_by_the_pose_at_its_exposure_and_known_from_its_arrival() -> None:
    recording = built(signals_of_a_run())
    seen = recording.maps[1]
    at = truth(10)
    R_WB = rotation_of(recording.quat_WB[10])
    expected = R_WB @ seen.nosings_B[1] + np.array([at.chassis_x_m, at.chassis_y_m, at.chassis_z_m])
    np.testing.assert_allclose(seen.nosings_W[1], expected, atol=1e-12)  # rounding alone
    assert [seen.taken_s for seen in recording.maps[:2]] == pytest.approx([0.06, 0.16])


@pytest.mark.parametrize("seat_deg", [-5.0, 0.0, 12.0, 28.0])
@pytest.mark.parametrize("bank_deg", [0.0, 9.0])
def test_the_seat_angle_follows_from_the_seats_pitch(seat_deg: float, bank_deg: float) -> None:
    """Test: a chassis with pitch and bank, its seat turned about B's y axis. Expected: the angle of that turn."""
    R_WB = rotation_z(0.3) @ rotation_y(-20.0 * DEG) @ rotation_x(bank_deg * DEG)
    forward = R_WB @ rotation_y(seat_deg * DEG) @ np.array([1.0, 0.0, 0.0])
    pose = {"yaw_rad": 0.3, "pitch_rad": math.asin(R_WB[2, 0]), "roll_rad": math.asin(R_WB[2, 1])}
    sample = replace(truth(0), seat_pitch_rad=math.asin(forward[2]), **pose)
    recording = built([(sample, 0.0)])
    assert recording.seat_rad[0] == pytest.approx(seat_deg * DEG, abs=1e-12)
    np.testing.assert_allclose(rotation_of(recording.quat_WB[0]), R_WB, atol=1e-12)


def test_pose_seat_angle_and_stair_are_those_of_the_simulator(driven: tuple[Recording, Staircase]) -> None:
    """Test: a stair with jitter, and a chair whose seat moves. Expected: the passenger where the simulator has it; its nosings."""
    recording, staircase = driven
    loading = recording.scenario.chair
    origin, com = np.array(payload_origin(recording.chair, loading)), np.array(payload_com(recording.chair, loading))
    for k in (0, 20, len(recording.t_s) - 1):
        in_chair = origin + rotation_y(recording.seat_rad[k]) @ com
        place = recording.p_WB[k] + rotation_of(recording.quat_WB[k]) @ in_chair
        np.testing.assert_allclose(place, recording.passenger_W[k], atol=1e-9)  # arcsine and back of 1 m: rounding
    np.testing.assert_array_equal(recording.staircase.nosings_W, staircase.nosings_W)
    assert not np.array_equal(staircase.nosings_W, as_designed(SCENARIO.stair).nosings_W)


def test_a_log_without_ground_truth_gives_signals_and_says_so(written: Written) -> None:
    sensors = [(signal, t_s) for signal, t_s in signals_of_a_run() if not isinstance(signal, Truth)]
    recording = read_recording(written(sensors))
    assert "no ground truth" in recording.missing[0]
    # Expected: by dead reckoning, along an x axis that rises by 0.2 rad; what the belts slip is unknown.
    assert recording.has_poses
    travel_m = recording.belt_travel_m[-1].mean()
    np.testing.assert_allclose(recording.p_WB[-1], travel_m * np.array([math.cos(0.2), 0.0, math.sin(0.2)]), atol=1e-12)
    assert np.isnan(recording.slip).all()
    # Expected: from the IMU, whose quaternion is a rotation by -0.2 rad about y, front up.
    np.testing.assert_allclose(recording.pitch_rad, 0.2, atol=1e-12)
    np.testing.assert_allclose(recording.pitch_rate_rad_s, 0.02, atol=1e-15)
    assert recording.belt_m_s[3].tolist() == [0.2, 0.2]


def test_a_log_from_before_the_pose_was_kept_says_so(written: Written) -> None:
    old = [
        (replace(signal, chassis_x_m=math.nan) if isinstance(signal, Truth) else signal, t_s) for signal, t_s in signals_of_a_run()
    ]
    recording = read_recording(written(old))
    assert not recording.has_poses
    assert "make the run again" in recording.missing[0]


def test_a_log_alone_is_read_without_its_stair(written: Written, tmp_path: Path) -> None:
    alone = tmp_path / "alone.mcap"
    alone.write_bytes((written(signals_of_a_run()) / "log.mcap").read_bytes())
    recording = read_recording(alone)
    assert recording.has_poses
    assert recording.staircase is None
    assert any("stair is unknown" in sentence for sentence in recording.missing)


def test_a_bag_of_ros_2_gives_what_it_holds(tmp_path: Path) -> None:
    """Test: ground truth, IMU and a stair map in a bag, stamped by a wall clock. Expected: time from zero, and poses."""
    path, begun_s = tmp_path / "run.db3", 1.7e9
    bag = open_bag(path)
    for signal, taken_s in signals_of_a_run():
        if isinstance(signal, Truth | ImuSample):
            bag(replace(signal, t_s=begun_s + signal.t_s), begun_s + taken_s)
    bag(stair_map(begun_s + 0.1), begun_s + 0.16)
    bag.close()
    recording = read_recording(path)
    assert recording.has_poses
    # A stamp of 1.7e9 s as a float is exact to 0.24 µs.
    np.testing.assert_allclose(recording.t_s, 0.01 * np.arange(TICKS), atol=1e-6)
    assert recording.maps[0].taken_s == pytest.approx(0.16, abs=1e-6)


def test_frames_are_found_by_time(written: Written) -> None:
    recording = read_recording(written(signals_of_a_run()))
    np.testing.assert_allclose(recording.frames_t_s, [0.0, 0.1, 0.2, 0.3])
    (frame,) = read_frames(recording, [0.19])
    assert isinstance(frame, RgbdFrame)
    assert frame.t_s == pytest.approx(0.2)
    assert frame.rgb[0, 0, 0] == 20


@pytest.mark.parametrize("sees_truth", [True, False])
def test_a_recording_does_not_depend_on_how_the_run_is_divided(sees_truth: bool) -> None:
    """Test: signals collected elsewhere, in parts of 1, 7 and 50, and built after each. Expected: the same to the bit."""
    signals = [(signal, t_s) for signal, t_s in signals_of_a_run() if sees_truth or not isinstance(signal, Truth)]
    whole = built(signals)
    for size in (1, 7, 50):
        collector, builder = SignalCollector(), RecordingBuilder(read_chair("wheelchair"), SCENARIO, seed=3)
        for first in range(0, len(signals), size):
            for signal, taken_s in signals[first : first + size]:
                collector(signal, taken_s)
            builder.add(collector.take())
            grown = builder.build()
        for item in fields(Recording):
            if isinstance(getattr(whole, item.name), np.ndarray):
                assert getattr(grown, item.name).tobytes() == getattr(whole, item.name).tobytes(), item.name
        assert [seen.nosings_W.tobytes() for seen in grown.maps] == [seen.nosings_W.tobytes() for seen in whole.maps]
        assert (grown.events, grown.phases) == (whole.events, whole.phases)


def test_a_recording_in_progress_is_a_view_that_costs_no_copy() -> None:
    builder = RecordingBuilder(read_chair("wheelchair"), SCENARIO)
    for k in range(3):
        builder(truth(k))
    first = builder.build()
    assert np.shares_memory(first.p_WB, builder.build().p_WB)
    builder(truth(3))
    assert (len(first.t_s), len(builder.build().t_s)) == (3, 4)


@pytest.mark.parametrize(
    ("moved", "heading_deg", "rate_deg_s", "slip"),
    [(1, 0, 0, 0), (0.7, 0, 0, 0.3), (0, 0, 0, 1), (1, 4, 0.4, 0), (1, 0, 1, math.nan), (1, 6, 0, math.nan)],
)
def test_slip_is_what_the_slower_belt_travels_beyond_the_chair(
    moved: float, heading_deg: float, rate_deg_s: float, slip: float
) -> None:
    """Test: belts at 0.1 and 0.3 m/s; the chair covers a share of 0.1 m/s. Expected: the rest of it, NaN before 3 cm.

    A chair that turns, or is not square, skids: the guard does not judge its slip, and the recording has none.
    """
    fixed = {"yaw_rad": 0.0, "pitch_rad": 0.0, "roll_rad": 0.0, "left_m_s": 0.1, "right_m_s": 0.3}
    headings = enumerate((heading_deg + 0.01 * rate_deg_s * np.arange(200)) * DEG)
    truths = [replace(truth(k), chassis_x_m=0.001 * moved * k, heading_rad=heading, **fixed) for k, heading in headings]
    found = built([(sample, sample.t_s) for sample in truths]).slip
    assert np.isnan(found[:29]).all()
    np.testing.assert_allclose(found[60:], slip, atol=1e-9)
