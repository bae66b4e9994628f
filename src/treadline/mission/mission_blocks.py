"""Blocks of one mission from its configuration: ``MissionConfig -> Blocks``, and the guard's limits for its chair."""

from dataclasses import replace
from typing import Any

from treadline.control import ControllerConfig, HeadingController
from treadline.control.seat_leveller import PitchLeveller
from treadline.core import paper
from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.core.signals import TICK_S, ImuSample
from treadline.estimation import FilterConfig, HeadingFilter, OffsetEstimator
from treadline.guard import Guard, GuardConfig
from treadline.mission._blocks import Detector
from treadline.mission._warm_up import stair_frames
from treadline.mission.belt_controllers import ConstantSpeed, Driver
from treadline.mission.loop import Blocks, Estimator
from treadline.mission.mission_config import MissionConfig, Plugins, is_full_traversal
from treadline.mission.planner import Cruise, Planner
from treadline.mission.traversal import Traversal
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.frame_quality import quality_of
from treadline.perception.free_ground import ground_ahead
from treadline.vehicle.loading import Loading, plumb
from treadline.vehicle.tracks import bearing_ends_m, track_on_stair_m
from treadline.vehicle.traction import NORMAL_SLIP, level_turn_share

PERIODS_MISSED = 3
"""Control periods without a command after which the guard holds."""


def heading_driver(config: MissionConfig) -> Driver:
    """Return the driver of a mission: a plug-in, the heading controller, or constant speed where the loop is open.

    Raises:
        SettingsError: If the controller is missing, was made for another vehicle, or the plug-in builds no driver.
    """
    if config.loop == "open":
        return ConstantSpeed(config.climb_speed_m_s, 1.0 / paper.CONTROL_RATE_HZ)
    if config.plugins.controller is not None:
        return _built("controller", config.plugins.controller, config, Driver)
    design = config.controller
    if design is None:
        raise SettingsError("a closed loop needs a controller; make one with treadline tune")
    if design.vehicle != (name := config.chair.name):
        raise SettingsError(f"the controller was made for '{design.vehicle}', the chair is '{name}'; tune one with --vehicle")
    return HeadingController(
        design,
        ControllerConfig(
            climb_speed_m_s=config.climb_speed_m_s,
            allocation=config.allocation,
            reconstruct=config.reconstruct,
            max_speed_m_s=config.chair.drives.max_speed_m_s,
            period_s=design.period_s,
        ),
    )


def planner_of(config: MissionConfig, driver: Driver | None = None) -> Planner:
    """Return the planner of a full traversal, or of a single flight.

    Raises:
        SettingsError: If the chair cannot come down.
    """
    if not is_full_traversal(config, driver):
        if config.direction == "down":
            raise SettingsError(
                "coming down needs a chair with a flipper, a closed loop and robust vision; set chair.model = 'wheelchair'"
            )
        return Cruise(config.climb_speed_m_s)
    _ = config.camera  # raises where the chair has none
    return Traversal(config)


def build_blocks(config: MissionConfig, driver: Driver | None = None) -> Blocks:
    """Return the blocks of one mission.

    Args:
        driver: An experiment's own driver in place of the configured one.

    Raises:
        SettingsError: If a block cannot be built.
    """
    planner = planner_of(config, driver)
    driver = driver or heading_driver(config)
    return Blocks(
        detector=detector_of(config),
        estimator=_estimator_of(config),
        planner=planner,
        driver=driver,
        leveller=None if config.chair.seat is None else PitchLeveller(config.chair.seat),
        guard=Guard(guard_config(config, driver.period_s, driven=driver.follows_plan)),
        swept_half_m=config.chair.swept_half_m,
    )


def detector_of(config: MissionConfig) -> Detector:
    """Return the stair detector of a mission: a plug-in, or the shipped one.

    Raises:
        SettingsError: If the plug-in builds no detector.
    """
    if config.plugins.detector is not None:
        return _built("detector", config.plugins.detector, config, Detector)
    return StairDetector(DetectorConfig(method=config.vision, swept_half_m=config.chair.swept_half_m))


def _estimator_of(config: MissionConfig) -> Estimator:
    """Return the heading estimator of a mission: a plug-in, the Kalman filter, or the paper's offset rule.

    Raises:
        SettingsError: If the plug-in builds no estimator.
    """
    if config.plugins.estimator is not None:
        return _built("estimator", config.plugins.estimator, config, Estimator)
    if config.vision != "robust":
        return OffsetEstimator()
    turn_per_belt = 0.0 if config.controller is None else config.controller.model.turn_per_belt_rad_m
    return HeadingFilter(FilterConfig(turn_per_belt_rad_m=turn_per_belt) if turn_per_belt > 0.0 else None)


def _built(kind: str, plugin: Any, config: MissionConfig, protocol: Any) -> Any:
    """Return the block that a plug-in builds; the names of the protocol that it lacks are an error."""
    block = plugin(config)
    if isinstance(block, protocol):
        return block
    wanted = sorted(name for name in {*dir(protocol), *getattr(protocol, "__annotations__", {})} if not name.startswith("_"))
    missing = [name for name in wanted if not hasattr(block, name)]
    raise SettingsError(f"the {kind} plug-in builds a {type(block).__name__} without {', '.join(missing)}; add it")


def warm_up(config: MissionConfig) -> None:
    """Detect and estimate on synthetic frames of a staircase, so that all kernels are compiled before the chair moves.

    Detector and estimator are new ones, of those shipped: a plug-in may keep what it has seen.
    """
    shipped = replace(config, plugins=Plugins())
    detector, estimator = detector_of(shipped), _estimator_of(shipped)
    camera = config.camera
    still = ImuSample(
        t_s=0.0, orientation=(1.0, 0.0, 0.0, 0.0), angular_velocity_rad_s=(0.0,) * 3, linear_acceleration_m_s2=(0.0,) * 3
    )
    for number, (frame, gravity_C) in enumerate(stair_frames(camera, rises=config.direction == "up")):
        quality_of(frame, ground_ahead(frame, gravity_C, config.chair.swept_half_m).obstacle_m)
        seen = detector.see(frame, gravity_C)
        _ = seen.stair_map  # made when it is asked for
        estimator.step(replace(still, t_s=number * TICK_S))
        if seen.measurement is not None:
            estimator.step(replace(seen.measurement, t_s=number * TICK_S))


def guard_config(config: MissionConfig, period_s: float, *, driven: bool = True) -> GuardConfig:
    """Return the guard's limits for a chair and a control period.

    Args:
        driven: Whether the driver follows the plan. The guard limits slip for such a driver only: excitation, and the paper's
            allocation, slip by design.
    """
    chair = config.chair
    tracks = chair.tracks
    plugins, is_robust = config.plugins, config.vision == "robust"
    outline = None if config.landings is None else config.landings.outline
    return GuardConfig(
        belt_limit_m_s=chair.drives.max_speed_m_s,
        drive_lag_s=chair.drives.lag_s,
        drive_acceleration_m_s2=chair.drives.max_acceleration_m_s2,
        seat_rate_m_s=None if chair.seat is None else chair.seat.max_rate_m_s,
        flipper_rate_rad_s=None if chair.flipper is None else chair.flipper.max_rate_deg_s * DEG,
        front_m=chair.reach_m,
        rear_m=chair.rear_reach_m,
        gauge_m=tracks.gauge_m,
        track_span_m=bearing_ends_m(chair)[1] - bearing_ends_m(chair)[0],
        track_on_stair_m=track_on_stair_m(chair),
        level_turn_share=level_turn_share(chair, config.payload_kg),
        normal_slip=NORMAL_SLIP,
        turn_outline_m=None if outline is None else (outline.rear_m, outline.front_m, outline.half_m),
        turn_centre_m=plumb(Loading(chair=chair, payload_kg=config.payload_kg), 0.0),
        awaits_ground=config.reports_ground,
        awaits_map=is_robust if plugins.detector is None else getattr(plugins.detector, "sends_map", True),
        awaits_health=is_robust if plugins.estimator is None else getattr(plugins.estimator, "sends_health", True),
        view="rear" if config.direction == "down" else "front",
        needs_heading=config.loop == "closed",
        watches_slip=config.allocation == "climb-safe" and config.loop == "closed" and driven,
        driver_timeout_s=PERIODS_MISSED * period_s,
    )
