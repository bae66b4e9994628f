"""Each kind of fault does what its table says, in physical terms, and leaves alone what is not its own."""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import get_args

import numpy as np
import pytest

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import SettingsError
from treadline.core.ports import Reading, Truth, TruthPlant
from treadline.core.rotations import rotation_of
from treadline.core.signals import (
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    HeadingMeasurement,
    ImuSample,
    OperatorInput,
    PlantState,
    SeatCommand,
    SeatReading,
    StairMap,
    TrackCommand,
    TrackReading,
)
from treadline.plant.faults import FaultyPlant, faulty
from treadline.plant.faults._damage import PHYSICAL
from treadline.plant.mujoco import MujocoPlant, open_plant
from treadline.scenario.faults import EXTENTS, Fault, FaultKind, Message, Process, stamp_of
from treadline.scenario.scenario import Chair, Control, DriveSettings, Realism, Scenario, Sensors, Stair, Start

GRAVITY_M_S2 = 9.81
SLOPE_DEG = 28.0
AT_S, FOR_S = 0.5, 0.4
TICK_S = 0.01
Orders = Callable[[float], tuple[TrackCommand, SeatCommand, FlipperCommand | None]]
Run = tuple[list[tuple[float, Reading]], list[Truth]]


def scenario(*faults: Fault, camera: str = "statistical", direction: str = "up", friction: float = 0.62) -> Scenario:
    """Return a chair on a flight of 28°, ideal except for the given settings."""
    return Scenario(
        stair=Stair(rise_m=0.30 * math.tan(SLOPE_DEG * DEG), walls="none", width_m=4.0, friction=(friction, 0.8 * friction)),
        chair=Chair(belt_mismatch=0.0),
        start=Start(place="flight", step=8),
        drive=DriveSettings.model_validate({"direction": direction}),
        control=Control(vision="robust"),
        sensors=Sensors.model_validate({"camera": camera}),
        realism=Realism(camera_latency_s=0.0, camera_jitter_s=0.0, camera_drop_rate=0.0),
        fault=faults,
    )


def fault(kind: str, value: float = 0.0, *, at_s: float = AT_S, for_s: float = FOR_S) -> Fault:
    return Fault.model_validate({"kind": kind, "value": value, "at_s": at_s, "for_s": for_s})


def at(speed_m_s: float) -> Orders:
    """Return the orders to run both belts at a speed."""
    return lambda t_s: (TrackCommand(t_s=t_s, left_m_s=speed_m_s, right_m_s=speed_m_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None)


climbing, backing = at(0.2), at(-0.1)


def standing(t_s: float) -> tuple[TrackCommand, SeatCommand, FlipperCommand | None]:
    return TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.0), None


def opened(asked: Scenario, seed: int = 3) -> tuple[MujocoPlant, TruthPlant]:
    """Return a started plant, bare and with its faults around it."""
    bare = open_plant(asked, seed)
    plant = faulty(bare, asked, seed)
    plant.start()
    return bare, plant


def drive(plant: TruthPlant, until_s: float, orders: Orders) -> Run:
    """Drive as a mission does, a hundred times a second; return each reading with the time at which it came, and the truth."""
    came: list[tuple[float, Reading]] = []
    for k in range(round(until_s / TICK_S) + 1):
        plant.advance(k * TICK_S)
        came += [(k * TICK_S, reading) for reading in plant.read()]
        plant.write(*orders(k * TICK_S))
    return came, list(plant.truth())


@cache
def run(asked: Scenario, until_s: float = 1.2, *, orders: Orders = climbing, seed: int = 3) -> Run:
    """Return a drive from the start of a scenario."""
    return drive(opened(asked, seed)[1], until_s, orders)


def sound(camera: str = "statistical") -> Run:
    """Return the run without a fault."""
    return run(scenario(camera=camera))


def within(t_s: float) -> bool:
    return AT_S - 1e-6 <= t_s < AT_S + FOR_S - 1e-6


def of(came: Sequence[tuple[float, Reading]], kind: type) -> list[Reading]:
    return [reading for _, reading in came if isinstance(reading, kind)]


def printed(reading: Reading) -> object:
    """Return a reading to the last bit."""
    match reading:
        case RgbdFrame():
            return reading.t_s, reading.rgb.tobytes(), reading.depth_m.tobytes()
        case ImuSample():
            return reading.t_s, reading.orientation, reading.angular_velocity_rad_s, repr(reading)
        case _:
            return repr(reading)


# The table


def test_every_kind_says_what_its_value_means_within_which_limits() -> None:
    assert set(EXTENTS) == set(get_args(FaultKind))
    for extent in EXTENTS.values():
        assert extent.means
        assert extent.low <= 0.0 <= extent.high, "zero is the default of every kind"
        assert extent.low <= extent.default <= extent.high


def test_a_fault_is_on_from_its_tick_up_to_the_one_that_ends_it() -> None:
    late = fault("camera_lost", at_s=0.1, for_s=0.2)  # 0.1 + 0.2 is more than 30 ticks of 0.01 s in the last bit
    assert [k for k in range(40) if late.active(k * TICK_S)] == list(range(10, 30))


def test_without_faults_the_plant_stays_itself() -> None:
    asked = scenario()
    bare = open_plant(asked, 0)
    assert faulty(bare, asked, 0) is bare


def test_a_plant_that_cannot_be_broken_is_not_wrapped_in_what_would_break_it() -> None:
    class Tape:
        """A plant that only plays back."""

        start = advance = read = write = close = truth = lambda *_: None

    FaultyPlant(Tape(), [fault("camera_lost")], 0)
    with pytest.raises(SettingsError, match=r"fault.kind 'power_cut': this plant cannot be broken"):
        FaultyPlant(Tape(), [fault("camera_lost"), fault("power_cut")], 0)


# Sensors


PURE = [kind for kind in EXTENTS if kind not in {*PHYSICAL, "process_killed", "late_tick"}]


OF_IMAGES = ("camera_lost", "camera_frozen", "camera_dark", "depth_holes", "false_edges")


@pytest.mark.parametrize(
    ("kind", "camera"), [*((kind, "statistical") for kind in PURE), *((kind, "kinect1") for kind in OF_IMAGES)]
)
def test_before_and_after_a_fault_of_sensors_every_reading_is_what_it_would_have_been(kind: FaultKind, camera: str) -> None:
    came, truth = run(scenario(fault(kind), camera=camera))
    expected, expected_truth = sound(camera)
    assert truth == expected_truth
    ours = [printed(reading) for t_s, reading in came if not within(t_s) and not isinstance(reading, OperatorInput)]
    assert ours == [printed(reading) for t_s, reading in expected if not within(t_s)]


def test_the_same_seed_gives_the_same_faults_and_each_fault_chance_of_its_own() -> None:
    holes, dark = fault("depth_holes"), fault("camera_dark")
    alone, again, other = (
        [printed(frame) for frame in of(run(scenario(holes, camera="kinect1"), seed=seed)[0], RgbdFrame)] for seed in (3, 3, 4)
    )
    assert alone == again != other
    both = of(run(scenario(dark, holes, camera="kinect1"))[0], RgbdFrame)
    assert [frame.depth_m.tobytes() for frame in both] == [depth for _, _, depth in alone]


def test_how_often_the_mission_reads_does_not_change_what_it_reads() -> None:
    faults = [fault("camera_dark"), fault("track_slip", at_s=0.63), fault("imu_stuck"), fault("operator_stop")]
    asked = scenario(*faults, camera="kinect1").model_copy(update={"realism": Realism()})  # frames arrive late
    readings = []
    for stride in (1, 30):
        _, plant = opened(asked)
        plant.write(*climbing(0.0))
        got: list[Reading] = []
        for k in range(1, 31):  # within the watchdog's patience: only the first order of the fault-free stretch is heard
            plant.advance(k * TICK_S)
            if k % stride == 0:
                got += plant.read()
        readings.append([printed(reading) for reading in got])
    assert readings[0] == readings[1]


@pytest.mark.parametrize(("kind", "value"), [("camera_lost", 0.0), ("process_killed", Process.PERCEPTION)])
@pytest.mark.parametrize("camera", ["kinect1", "statistical"])
def test_a_lost_camera_or_a_dead_perception_sends_nothing(kind: str, value: float, camera: str) -> None:
    came, _ = run(scenario(fault(kind, value), camera=camera), 1.0)
    sights = [t_s for t_s, reading in came if isinstance(reading, RgbdFrame | FrameQuality | HeadingMeasurement | StairMap)]
    assert sights
    assert not any(within(t_s) for t_s in sights)
    assert any(within(t_s) for t_s, reading in came if isinstance(reading, ImuSample))


def test_a_frozen_camera_repeats_its_last_frame_with_new_stamps() -> None:
    frames = of(run(scenario(fault("camera_frozen"), camera="kinect1"))[0], RgbdFrame)
    assert [frame.t_s for frame in frames] == pytest.approx(np.arange(13) * 0.1)
    for frame in frames[5:9]:
        np.testing.assert_array_equal(frame.rgb, frames[4].rgb)
        np.testing.assert_array_equal(frame.depth_m, frames[4].depth_m)
    assert (frames[9].depth_m != frames[4].depth_m).any()
    qualities = of(run(scenario(fault("camera_frozen")))[0], FrameQuality)
    assert len({quality.fingerprint for quality in qualities[4:9]}) == 1


@pytest.mark.parametrize("value", [0.0, 30.0])
def test_dark_and_glare_leave_little_in_the_colours_and_depth_as_it_is(value: float) -> None:
    lit = of(sound("kinect1")[0], RgbdFrame)[6]
    frame = of(run(scenario(fault("camera_dark", value), camera="kinect1"))[0], RgbdFrame)[6]
    # 2 % of the light leaves a tenth of the contrast, noise of one or two counts included; 30 times drowns it in white.
    assert frame.rgb.std() < 0.1 * lit.rgb.std()
    assert (frame.rgb.mean() < 6.0) if value == 0.0 else (frame.rgb.mean() > 245.0)
    np.testing.assert_array_equal(frame.depth_m, lit.depth_m)


def test_a_negative_value_blinds_depth_as_well() -> None:
    asked = fault("camera_dark", -0.02)
    assert np.isnan(of(run(scenario(asked, camera="kinect1"))[0], RgbdFrame)[5].depth_m).all()
    came, _ = run(scenario(asked))
    assert of(came, FrameQuality)[5].valid_share == 0.0
    assert not [t_s for t_s, reading in came if isinstance(reading, HeadingMeasurement) and within(t_s)]


@pytest.mark.parametrize("share", [0.0, 0.8])
def test_holes_take_their_share_of_the_depth_image_in_blotches(share: float) -> None:
    whole = of(sound("kinect1")[0], RgbdFrame)[5].depth_m
    depth = of(run(scenario(fault("depth_holes", share), camera="kinect1"))[0], RgbdFrame)[5].depth_m
    lost = np.isnan(depth) & ~np.isnan(whole)
    # What had no return before is a few percent, and falls on holes as on the rest.
    assert lost.mean() == pytest.approx((share or 0.4) * (~np.isnan(whole)).mean(), abs=0.03)
    np.testing.assert_array_equal(depth[~np.isnan(depth)], whole[~np.isnan(depth)])
    # In blotches a pixel is nearly always as its neighbour; single pixels would differ in half of all places.
    gone = np.isnan(depth) | np.isnan(whole)
    assert (gone[:, 1:] != gone[:, :-1]).mean() < 0.15


def test_a_stuck_imu_repeats_itself_and_a_dead_one_says_nan_or_nothing() -> None:
    stuck = of(run(scenario(fault("imu_stuck")))[0], ImuSample)
    assert len(stuck) == 121
    assert len({sample.angular_velocity_rad_s for sample in stuck[49:90]}) == 1
    assert len({sample.angular_velocity_rad_s for sample in stuck[:50]}) == 50
    nothing = of(run(scenario(fault("imu_nan")))[0], ImuSample)
    finite = [
        bool(np.isfinite(sample.orientation).any() or np.isfinite(sample.linear_acceleration_m_s2).any()) for sample in nothing
    ]
    assert finite == [not within(sample.t_s) for sample in nothing]
    lost = of(run(scenario(fault("imu_lost")))[0], ImuSample)
    assert [sample.t_s for sample in lost] == pytest.approx([k * TICK_S for k in range(121) if not within(k * TICK_S)])


def test_drives_that_report_nothing_leave_the_other_senses() -> None:
    came = run(scenario(fault("readings_lost")))[0]
    for kind in (TrackReading, SeatReading, FlipperReading):
        assert not any(within(reading.t_s) for reading in of(came, kind))
        assert len(of(came, kind)) > 20
    assert len(of(came, ImuSample)) == 121


@pytest.mark.parametrize(("value", "turned_deg"), [(0.0, FOR_S), (-3.0, -3.0 * FOR_S), (30.0, 30.0)])
def test_a_bias_or_a_jump_turns_gyro_and_attitude_alike(value: float, turned_deg: float) -> None:
    wrong = of(run(scenario(fault("imu_bias", value)))[0], ImuSample)
    right = of(sound()[0], ImuSample)
    excess = np.array(
        [np.subtract(a.angular_velocity_rad_s, b.angular_velocity_rad_s) / DEG for a, b in zip(wrong, right, strict=False)]
    )
    assert np.sum(excess[:, 2]) * TICK_S == pytest.approx(turned_deg, rel=1e-9)
    assert np.abs(excess).max() <= 300.0 + 1e-9  # a gyro's range is 2000 °/s
    R = rotation_of(wrong[89].orientation) @ rotation_of(right[89].orientation).T
    assert math.atan2(R[1, 0], R[0, 0]) / DEG == pytest.approx(turned_deg, rel=1e-6)


def test_a_gyro_ramp_grows_evenly_and_its_yaw_is_the_integral() -> None:
    wrong, right = (of(drive_of, ImuSample) for drive_of in (run(scenario(fault("gyro_ramp", 2.0)))[0], sound()[0]))
    on = [k for k, sample in enumerate(wrong) if within(sample.t_s)]
    rates = [wrong[k].angular_velocity_rad_s[2] - right[k].angular_velocity_rad_s[2] for k in on]
    steps = np.diff(rates)
    np.testing.assert_allclose(steps, steps[0], rtol=1e-6)
    assert rates[0] == pytest.approx(0.0, abs=1e-12)
    # One tick before its end the ramp is one tick below its end.
    assert rates[-1] + steps[0] == pytest.approx(2.0 * DEG, rel=1e-6)


def test_a_wrong_stamp_is_that_of_one_kind_of_message_while_it_lasts() -> None:
    faults = [fault("wrong_stamp", 1.0, at_s=0.5, for_s=0.5)]
    assert [stamp_of(faults, Message.PLAN, t_s) for t_s in (0.4, 0.6, 1.1)] == [0.4, 1e6, 1.1]
    assert stamp_of(faults, Message.MAP, 0.6) == 0.6


def test_a_clock_that_leaps_back_names_old_times_twice() -> None:
    came, _ = run(scenario(fault("clock_back")), 1.2)
    stamps = [(t_s, reading.t_s) for t_s, reading in came if isinstance(reading, TrackReading)]
    assert [stamp for t_s, stamp in stamps if within(t_s)] == pytest.approx(
        [t_s - 0.5 for k in range(120) if within(t_s := k * TICK_S) for _ in "ab"]
    )
    assert all(stamp == t_s for t_s, stamp in stamps if not within(t_s))


def test_the_persons_handset_speaks_in_scenarios_that_have_one() -> None:
    came, _ = run(scenario(fault("operator_stop")))
    beats = of(came, OperatorInput)
    assert [beat.t_s for beat in beats] == pytest.approx(np.arange(13) * 0.1)
    assert [beat.stop for beat in beats] == [within(beat.t_s) for beat in beats]
    released = of(run(scenario(fault("operator_stop", 1.0)))[0], OperatorInput)
    assert [beat.dead_man for beat in released] == [not within(beat.t_s) for beat in released]
    silent = of(run(scenario(fault("link_lost")))[0], OperatorInput)
    assert [beat.t_s for beat in silent] == pytest.approx([0.1 * k for k in range(13) if not within(0.1 * k)])
    assert not of(sound()[0], OperatorInput)
    stamps = [reading.t_s for _, reading in came]
    assert stamps == sorted(stamps)


# Orders and processes


def test_a_late_mission_is_heard_late_and_hears_in_bursts() -> None:
    def braking(t_s: float) -> tuple[TrackCommand, SeatCommand, FlipperCommand | None]:
        return standing(t_s) if t_s >= AT_S - 1e-6 else climbing(t_s)

    came, truth = run(scenario(fault("late_tick", 0.2, for_s=0.6)), 1.3, orders=braking)
    still = next(sample.t_s for sample in truth[20:] if sample.left_m_s == 0.0)
    # Asked to stop at 0.5 s, the belts hear of it 0.2 s later and need 0.02 s for it.
    assert still == pytest.approx(AT_S + 0.2 + 0.02, abs=0.011)
    bursts = sorted({t_s for t_s, _ in came if AT_S - 1e-6 <= t_s < AT_S + 0.6 - 1e-6})
    assert bursts == pytest.approx([0.7, 0.9])
    # Late, but complete.
    assert len(of(came, ImuSample)) == 131


def test_a_dead_mission_is_braked_by_the_actuators_and_let_go_after_a_stop_only() -> None:
    def going_on(t_s: float) -> tuple[TrackCommand, SeatCommand, FlipperCommand | None]:
        return standing(t_s) if 1.5 - 1e-6 <= t_s < 1.6 else climbing(t_s)

    _, truth = run(scenario(fault("process_killed", for_s=0.6)), 2.2, orders=going_on)
    speeds = {round(sample.t_s, 2): sample.left_m_s for sample in truth}
    assert speeds[0.75] == pytest.approx(0.2, abs=0.01), "the last order holds at first"
    # The last order came at 0.49 s, the watchdog waits 0.3 s, the brake needs 0.02 s. Hazard 22 allows 0.8 s.
    assert all(speeds[round(k * TICK_S, 2)] == 0.0 for k in range(83, 160)), "orders are back at 1.1 s, and do not release it"
    assert speeds[2.2] > 0.19


def test_a_dead_seat_process_leaves_the_actuator_running_until_its_watchdog() -> None:
    def lifting(t_s: float) -> tuple[TrackCommand, SeatCommand, FlipperCommand | None]:
        return TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.01 if t_s < AT_S - 1e-6 else -0.01), None

    came, _ = run(scenario(fault("process_killed", Process.SEAT, for_s=1.0)), 1.5, orders=lifting)
    strokes = {round(reading.t_s, 2): reading.stroke_m for reading in of(came, SeatReading)}
    assert strokes[0.8] - strokes[0.5] == pytest.approx(0.003, abs=2e-4)
    assert strokes[1.49] - strokes[1.3] == pytest.approx(0.0, abs=1e-4)


def test_silence_brakes_a_chair_with_faults_alone() -> None:
    _, plant = opened(scenario(fault("camera_lost", at_s=9.0)))
    plant.write(*climbing(0.0))
    plant.advance(1.0)
    assert plant.truth()[-1].left_m_s == 0.0
    # Repeated each 0.1 s, as the plant node does.
    assert [state.t_s for state in of([(1.0, reading) for reading in plant.read()], PlantState)] == pytest.approx(
        [0.31, *(0.1 * k for k in range(4, 11))]
    )
    free = open_plant(scenario(), 3)
    free.start()
    free.write(*climbing(0.0))
    free.advance(1.0)
    assert free.truth()[-1].left_m_s == pytest.approx(0.2, abs=0.01)


# The chair itself


@pytest.mark.parametrize("kind", PHYSICAL)
def test_before_damage_every_reading_is_what_it_would_have_been(kind: FaultKind) -> None:
    came, truth = run(scenario(fault(kind)), AT_S)
    # A box in the scene is one body more, and another order of sums: the last bits may differ, and do not.
    assert truth[:-1] == sound()[1][:50]
    assert [printed(reading) for t_s, reading in came if t_s < AT_S - 1e-6] == [
        printed(reading) for t_s, reading in sound()[0] if t_s < AT_S - 1e-6
    ]


def test_a_second_start_mends_everything() -> None:
    asked = scenario(*(fault(kind) for kind in PHYSICAL))
    _, plant = opened(asked)
    first = drive(plant, 0.7, climbing)[1]
    plant.start()
    # The sensors' noise goes on where it was; the physics begins anew.
    assert drive(plant, 0.7, climbing)[1] == first


@pytest.mark.parametrize(("value", "turn"), [(0.0, 1.0), (1.0, -1.0)], ids=["left", "right"])
def test_a_stalled_belt_stands_in_truth_and_report_and_turns_the_chair_to_its_side(value: float, turn: float) -> None:
    came, truth = run(scenario(fault("track_stalled", value, for_s=1.0)), 2.2)
    reported = {round(reading.t_s, 2): (reading.left_m_s, reading.right_m_s)[int(value)] for reading in of(came, TrackReading)}
    true = {round(sample.t_s, 2): (sample.left_m_s, sample.right_m_s)[int(value)] for sample in truth}
    # The encoder's counts are 9.2 µm apart (109 000 per metre): 0.92 mm/s in a tick of 10 ms.
    assert reported == pytest.approx(true, abs=9.2e-4)
    # 0.2 m/s at 10 m/s² stops within 0.02 s.
    assert all(true[round(k * TICK_S, 2)] == 0.0 for k in range(53, 151))
    assert true[2.2] > 0.19
    other = [(sample.right_m_s, sample.left_m_s)[int(value)] for sample in truth[60:150]]
    assert min(other) > 0.19
    # A belt that runs alone on a slope at 0.86 of its friction turns slowly; 0.65 m apart without slip it would be 17 °/s.
    assert 1.5 < turn * (truth[150].heading_rad - truth[50].heading_rad) / DEG < 17.0


def test_a_belt_without_grip_lets_the_chair_turn_to_its_side() -> None:
    left = run(scenario(fault("track_slip", 0.3)), 0.9)[1][-1]
    right = run(scenario(fault("track_slip", -0.3)), 0.9)[1][-1]
    assert left.heading_rad > 2.0 * DEG
    # The chair is its own mirror image.
    assert right.heading_rad == pytest.approx(-left.heading_rad, abs=0.05 * DEG)
    assert left.friction_use == pytest.approx(right.friction_use, rel=1e-3)


def test_on_oil_a_braked_chair_slides_as_friction_allows() -> None:
    beta = SLOPE_DEG * DEG
    _, truth = run(scenario(fault("low_friction")), 0.9, orders=standing)
    t_s = np.array([sample.t_s for sample in truth[52:90]])
    fitted = np.polyfit(t_s, [sample.x_m for sample in truth[52:90]], 2)
    expected = GRAVITY_M_S2 * (math.sin(beta) - 0.31 * math.cos(beta))
    # Nosings pass under the belts as it goes: a few percent.
    assert -2.0 * fitted[0] == pytest.approx(expected, rel=0.06)
    assert abs(truth[49].x_m - truth[0].x_m) < 1e-3


def test_friction_above_the_slopes_tangent_still_holds() -> None:
    # 0.9 · 0.62 = 0.558, and tan 28° = 0.532.
    _, truth = run(scenario(fault("low_friction", 0.9, for_s=3.0)), 1.5, orders=standing)
    assert abs(truth[-1].x_m - truth[0].x_m) < 2e-3
    assert truth[-1].friction_use == pytest.approx(math.tan(SLOPE_DEG * DEG) / 0.558, rel=1e-6)


def lifting(t_s: float) -> tuple[TrackCommand, SeatCommand, FlipperCommand]:
    """Return the order to stand, to lengthen the seat's actuator and to lower the flipper."""
    return TrackCommand.stop(t_s), SeatCommand(t_s=t_s, rate_m_s=0.01), FlipperCommand(t_s=t_s, rate_rad_s=-10.0 * DEG)


def test_a_stuck_seat_stays_and_goes_on_afterwards() -> None:
    came, _ = run(scenario(fault("seat_stuck")), 1.2, orders=lifting)
    stroke = {round(reading.t_s, 2): reading.stroke_m for reading in of(came, SeatReading)}
    assert stroke[0.5] - stroke[0.0] == pytest.approx(0.01 * (0.5 - 0.1), abs=5e-4)  # less the actuator's lag
    assert stroke[0.9] == stroke[0.51]
    assert stroke[1.2] > stroke[0.9] + 0.001


def test_a_stuck_flipper_stays_and_a_lost_one_falls() -> None:
    angles, torques = {}, {}
    for kind in ("flipper_stuck", "flipper_lost"):
        flippers = of(run(scenario(fault(kind, for_s=1.0)), 2.0, orders=lifting)[0], FlipperReading)
        angles[kind] = {round(flipper.t_s, 2): flipper.angle_rad / DEG for flipper in flippers}
        torques[kind] = np.array([flipper.torque_n_m for flipper in flippers])
    stuck, lost = angles["flipper_stuck"], angles["flipper_lost"]
    # It coasts to a stop within its servo's lag, and goes on at 10 °/s.
    assert stuck[1.5] == pytest.approx(stuck[0.7], abs=0.2)
    assert stuck[2.0] < stuck[1.5] - 4.0
    # 3 kg with 0.23 m of lever on 0.5 kg·m² fall from 35° in well under a second; the tip's noise is 2 N·m.
    assert lost[1.5] < stuck[1.5] - 10.0
    assert abs(torques["flipper_lost"][60:150]).max() < 10.0 < abs(torques["flipper_lost"][150:]).max()


def test_without_power_the_brake_falls_in_and_gears_hold() -> None:
    def going_on(t_s: float) -> tuple[TrackCommand, SeatCommand, FlipperCommand]:
        _, seat, flipper = lifting(t_s)
        return climbing(t_s)[0] if t_s < 1.5 - 1e-6 else TrackCommand.stop(t_s), seat, flipper

    came, truth = run(scenario(fault("power_cut", for_s=0.6)), 1.7, orders=going_on)
    assert all(sample.left_m_s == sample.right_m_s == 0.0 for sample in truth[53:])
    # Power is back at 1.1 s, and with it orders to climb: after a brake that fell in, drives want a stop first.
    assert {reading.brake_on for reading in of(came, TrackReading)[52:]} == {True}
    assert abs(truth[-1].x_m - truth[60].x_m) < 2e-3
    strokes = [reading.stroke_m for reading in of(came, SeatReading)]
    assert strokes[110] == strokes[51]
    flippers = [reading.angle_rad for reading in of(came, FlipperReading)]
    assert flippers[110] == pytest.approx(flippers[70], abs=0.2 * DEG)


@pytest.mark.parametrize(("direction", "orders", "speed_m_s"), [("up", climbing, 0.2), ("down", backing, 0.1)])
def test_an_obstacle_cannot_be_passed(direction: str, orders: Orders, speed_m_s: float) -> None:
    asked = scenario(fault("obstacle", 0.02, at_s=0.0, for_s=9.0), direction=direction)
    _, truth = run(asked, 4.0, orders=orders)
    # The flipper at its rest reaches 0.11 m less far than laid in line, from where the distance counts.
    assert abs(truth[-1].x_m - truth[0].x_m) < 0.6 * (4.0 - 0.15) * speed_m_s


@pytest.mark.parametrize(("place", "direction"), [("flight", "up"), ("flight", "down"), ("floor", "up"), ("landing", "down")])
def test_a_box_stands_on_the_ground_ahead_of_the_end_that_leads(place: str, direction: str) -> None:
    asked = scenario(fault("obstacle", 0.3, at_s=0.0), direction=direction)
    asked = asked.model_copy(update={"start": Start.model_validate({"place": place, "step": 8})})
    bare, _ = opened(asked)
    box = bare._around.box
    low = box.centre_W[2] - box.half_m[2]
    heights = [0.0, *(step.z_m for step in bare.staircase.steps)]
    assert min(abs(low - height) for height in heights) < 1e-9
    assert (box.centre_W[0] > bare._data.qpos[0]) == (direction == "up")
    # The reported distance is along the chair's x: backing down, the box's top leans towards it by 0.5 m · sin 28°.
    assert bare.gap_m == pytest.approx(0.3 - (0.2 if (place, direction) == ("flight", "down") else 0.0), abs=0.05)


def test_an_obstacle_is_in_the_depth_image_and_in_the_map_of_a_camera_without_images() -> None:
    asked = fault("obstacle", 0.3, for_s=0.4)
    frames = of(run(scenario(asked, camera="kinect1"), 0.9, orders=standing)[0], RgbdFrame)
    clear, blocked = frames[4].depth_m, frames[5].depth_m
    nearer = clear - blocked > 0.1
    assert nearer.mean() > 0.05
    assert np.nanmean(np.abs(frames[9].depth_m - clear)) < 0.02, "taken away again"
    red = frames[5].rgb[nearer].mean(axis=0)
    assert red[0] > 1.5 * red[2]
    maps = of(run(scenario(asked, camera="statistical"), 0.9, orders=standing)[0], StairMap)
    end_m = 0.475 + 0.45 + 0.07
    for seen in maps:
        assert (seen.obstacle_m is not None) == within(seen.t_s)
        assert seen.obstacle_m is None or seen.obstacle_m == pytest.approx(end_m + 0.3, abs=0.06)


@pytest.mark.parametrize(("direction", "step", "ahead_m"), [("up", 6, 1.5), ("down", 4, 2.0)])
def test_a_camera_without_images_reports_a_box_on_flat_ground_beyond_the_flight(direction: str, step: int, ahead_m: float) -> None:
    asked = scenario(fault("obstacle", ahead_m, at_s=0.0, for_s=9.0), direction=direction)
    asked = asked.model_copy(update={"stair": asked.stair.model_copy(update={"steps": 8})})
    asked = asked.model_copy(update={"start": Start(place="flight", step=step)})
    came, _ = run(asked, 0.5, orders=standing)
    reported = [seen.obstacle_m for seen in of(came, FrameQuality)]
    lead_m = 0.475 + 0.45 + 0.07 if direction == "up" else 0.55
    # Put there along the belts, from the end that leads; reported is the horizontal distance, or that to its top along the belts if
    # smaller: backing down, its top is about as high as mid-track.
    level_m = (lead_m + ahead_m) * math.cos(SLOPE_DEG * DEG)
    near_m = level_m if direction == "up" else level_m * math.cos(SLOPE_DEG * DEG)
    assert reported
    assert all(value == pytest.approx(near_m, abs=0.1) for value in reported)
    on_a_step = scenario(fault("obstacle", 0.3, at_s=0.0), direction=direction)
    assert all(seen.obstacle_m is None for seen in of(run(on_a_step, 0.5, orders=standing)[0], FrameQuality))


def test_a_false_edge_lies_at_its_angle_in_colour_and_depth_and_stays() -> None:
    frames = of(run(scenario(fault("false_edges"), camera="kinect1"), 0.9, orders=standing)[0], RgbdFrame)
    clear = np.median([frame.depth_m for frame in frames[:5]], axis=0)  # NaN where one of them has none
    masks = [clear - frame.depth_m > 0.025 for frame in frames]
    shares = [mask.mean() for mask in masks]
    assert max(*shares[:5], shares[9]) < 0.004
    assert min(shares[5:9]) > 0.01
    # The same object in each frame: what noise of the depth leaves of it overlaps.
    assert (masks[5] & masks[8]).sum() > 0.6 * masks[5].sum()
    row, column = np.nonzero(masks[5])
    middle = (np.abs(column - column.mean()) < 80) & (np.abs(row - np.median(row)) < 60)
    slant = np.polyfit(column[middle], row[middle], 1)[0]
    # Turned to the left seen from above: its right end lies nearer to the nosing ahead. Foreshortening makes 15° less.
    assert 4.0 * DEG < abs(math.atan(slant)) < 20.0 * DEG
    pixels = np.abs(frames[5].rgb.astype(float) - frames[4].rgb).mean(axis=2)
    assert pixels[masks[5]].mean() > 5.0 * pixels[~masks[5]].mean()
