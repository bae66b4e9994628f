"""What the mission is told before it starts, and the blocks that follow from it.

Everything here comes from the chair's file, the controller's file and the operator. Nothing comes from a scenario:
payload, slope, friction and heading are for the sensors to find.
"""

from dataclasses import dataclass
from typing import Literal

from treadline import paper
from treadline.control import ControllerConfig, HeadingController
from treadline.errors import SettingsError
from treadline.estimation import HeadingFilter, OffsetEstimator
from treadline.mechanics.chair import ChairDescription
from treadline.mission.ascent import Ascent, AscentConfig
from treadline.mission.blocks import Detector
from treadline.mission.descent import Descent, DescentConfig
from treadline.mission.drivers import ConstantSpeed, Driver
from treadline.mission.guard import Guard, GuardConfig
from treadline.mission.loop import Blocks, Estimator
from treadline.mission.planner import Cruise, Planner
from treadline.models import ControllerDesign, Reconstruct
from treadline.perception import DetectorConfig, StairDetector
from treadline.seat import LevellerConfig, PitchLeveller

PERIODS_MISSED = 3
"""Control periods without a command after which the guard holds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionConfig:
    """The operator's choices and the files the chair carries."""

    chair: ChairDescription
    controller: ControllerDesign | None = None
    """None only where an experiment brings its own driver, or the loop is open."""
    direction: Literal["up", "down"] = "up"
    payload_kg: float = 50.0
    """What the passenger weighs, as entered; where in the seat is not known."""
    climb_speed_m_s: float = 0.2
    flights: int | None = None
    """How many to climb or come down; None goes on as long as another is seen across a landing."""
    loop: Literal["closed", "open"] = "closed"
    vision: Literal["robust", "paper"] = "robust"
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    reconstruct: Reconstruct | None = None
    """None leaves it to the controller's file."""


def heading_driver(config: MissionConfig) -> Driver:
    """Return the driver that the operator chose: the heading controller, or constant speed.

    Raises:
        SettingsError: If the controller is missing or was made for another vehicle.
    """
    if config.loop == "open":
        return ConstantSpeed(config.climb_speed_m_s, 1.0 / paper.CONTROL_RATE_HZ)
    design = config.controller
    if design is None:
        raise SettingsError("a closed loop needs a controller; make one with treadline tune")
    if design.vehicle != config.chair.name:
        raise SettingsError(f"the controller was made for '{design.vehicle}', the chair is '{config.chair.name}'")
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


def is_full_traversal(config: MissionConfig, driver: Driver | None = None) -> bool:
    """Say whether a mission goes from floor to landing, or back, and not along a flight alone.

    The paper's vision sees no stair map, an open loop steers by nothing, a chair without a flipper must not cross a crest, and an
    experiment's own driver has the flight for itself.
    """
    steers = driver is None or isinstance(driver, HeadingController)
    return steers and config.loop == "closed" and config.vision == "robust" and config.chair.flipper is not None


def planner_of(config: MissionConfig, driver: Driver | None = None) -> Planner:
    """Return the planner of a whole traversal, or of the flight alone.

    Raises:
        SettingsError: If the chair cannot come down.
    """
    chair = config.chair
    if not is_full_traversal(config, driver):
        if config.direction == "down":
            raise SettingsError(
                "coming down needs a chair with a flipper, a closed loop and robust vision; set chair.model = 'wheelchair'"
            )
        return Cruise(config.climb_speed_m_s)
    if config.direction == "down":
        chair.camera_at(rear=True)  # raises where there is none
        return Descent(
            DescentConfig(chair=chair, payload_kg=config.payload_kg, cruise_m_s=config.climb_speed_m_s, flights=config.flights)
        )
    return Ascent(
        AscentConfig(chair=chair, payload_kg=config.payload_kg, cruise_m_s=config.climb_speed_m_s, flights=config.flights)
    )


def build_blocks(config: MissionConfig, driver: Driver | None = None) -> Blocks:
    """Return the blocks of one mission; an experiment may bring its own driver, which then drives on the flight alone."""
    planner = planner_of(config, driver)
    driver = driver or heading_driver(config)
    detector: Detector = StairDetector(DetectorConfig(method=config.vision, swept_half_m=config.chair.swept_half_m))
    estimator: Estimator = HeadingFilter() if config.vision == "robust" else OffsetEstimator()
    return Blocks(
        detector=detector,
        estimator=estimator,
        planner=planner,
        driver=driver,
        leveller=PitchLeveller(LevellerConfig(seat=config.chair.seat)),
        guard=Guard(guard_config(config, driver.period_s, driven=isinstance(driver, HeadingController))),
        swept_half_m=config.chair.swept_half_m,
    )


def guard_config(config: MissionConfig, period_s: float, *, driven: bool = True) -> GuardConfig:
    """Return the limits that follow from the chair and from the driver's period.

    Args:
        driven: By the heading controller; an experiment's own signal skids on purpose, as the paper's allocation does.
    """
    chair = config.chair
    tracks = chair.tracks
    return GuardConfig(
        belt_limit_m_s=chair.drives.max_speed_m_s,
        drive_lag_s=chair.drives.lag_s,
        drive_acceleration_m_s2=chair.drives.max_acceleration_m_s2,
        front_m=chair.reach_m,
        rear_m=chair.rear_reach_m,
        gauge_m=tracks.gauge_m,
        track_span_m=tracks.flat_run_m,
        needs_heading=config.loop == "closed",
        watches_slip=config.allocation == "climb-safe" and config.loop == "closed" and driven,
        driver_timeout_s=PERIODS_MISSED * period_s,
    )
