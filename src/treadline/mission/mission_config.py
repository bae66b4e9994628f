"""Mission configuration: the operator's choices, the chair's file, the controller's file, and plug-ins in place of shipped blocks.

Nothing here comes from a scenario: payload, slope, friction and heading are measured by sensors.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, Protocol, runtime_checkable

from treadline.control.belt_allocation import CRUISE_M_S
from treadline.core import paper
from treadline.core.camera_images import PinholeCamera
from treadline.core.models import ControllerDesign, Reconstruct
from treadline.mission._blocks import Detector
from treadline.mission.belt_controllers import Driver
from treadline.mission.loop import Estimator
from treadline.scenario.chair import ChairDescription
from treadline.vehicle.flight_plan import FlightPlan
from treadline.vehicle.landing_turn_kernels import Outline

FILE_PREFIX = "treadline_plugin_"
"""Beginning of the module name that a plug-in file gets."""


@runtime_checkable
class ControllerPlugin(Protocol):
    """Class of a controller: builds a ``Driver`` from the mission configuration.

    The entry point group is ``treadline.controllers``.
    """

    follows_plan: bool
    """Whether the controller applies ``plan.speed_m_s`` and ``plan.heading_rad``. Only then does the mission run the phases of a
    full traversal (alignment, mounting, traction test, crest, landing); otherwise it drives on the flight alone, and the run ends
    with the verdict ``end_of_flight``."""

    def __call__(self, config: "MissionConfig", /) -> Driver:
        """Return the controller; ``step(estimate, t_s, plan)`` is called every ``period_s``."""


@runtime_checkable
class DetectorPlugin(Protocol):
    """Class of a stair detector: builds a ``Detector`` from the mission configuration.

    The entry point group is ``treadline.detectors``.
    """

    maps_stair: bool
    """Whether ``see`` returns a ``stair_map``, which a full traversal needs; otherwise the mission drives on the flight alone."""

    def __call__(self, config: "MissionConfig", /) -> Detector:
        """Return the detector; ``see(frame, gravity_C)`` is called for each camera frame."""


@runtime_checkable
class EstimatorPlugin(Protocol):
    """Class of a heading estimator: builds an ``Estimator`` from the mission configuration.

    The entry point group is ``treadline.estimators``.
    """

    def __call__(self, config: "MissionConfig", /) -> Estimator:
        """Return the estimator; ``step(signal)`` is called for each IMU sample, belt reading and heading measurement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plugins:
    """Blocks that replace the shipped ones; None keeps the shipped block."""

    controller: ControllerPlugin | None = None
    detector: DetectorPlugin | None = None
    estimator: EstimatorPlugin | None = None

    def sources(self) -> dict[str, str]:
        """Return ``module:Class`` of each plug-in by its kind, for the manifest of a run."""
        given = {"controller": self.controller, "detector": self.detector, "estimator": self.estimator}
        return {kind: source_of_plugin(plugin) for kind, plugin in given.items() if plugin is not None}


class KnownSill(NamedTuple):
    """Outline of a sill or ramp next to a flight."""

    flight: int
    end: Literal["foot", "top"]
    """End of the flight from whose nosing the distances count."""
    outline: tuple[tuple[float, float], ...]
    """Distance away from the flight and height above the ground at its end of each vertex, the nearest first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownLandings:
    """Plans of the landings between flights, as drawn; the sides in view correct the chair's place on them."""

    plans: tuple[FlightPlan, ...]
    """Plan of the flight below each landing and of the landing, the lowest first."""
    width_m: float
    """Width of the flights [m]."""
    outline: Outline
    """Outline of the chair with its flipper folded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionConfig:
    """Configuration of one mission."""

    chair: ChairDescription
    controller: ControllerDesign | None = None
    """Gain and observer. None: the loop is open, a plug-in controls, or an experiment brings its own driver."""
    plugins: Plugins = field(default_factory=Plugins)
    """Blocks that replace the shipped ones."""
    direction: Literal["up", "down"] = "up"
    payload_kg: float = paper.PAYLOAD_KG
    """Weight of the passenger as the operator entered it; the place in the seat is unknown."""
    climb_speed_m_s: float = CRUISE_M_S
    check: bool = True
    """Whether a measured stair beyond the chair's limits is refused before entry; a maker who tries a chair turns it off."""
    flights: int | None = None
    """Number of flights to traverse. None: continue as long as another flight is seen across a landing."""
    sills: tuple[KnownSill, ...] = ()
    """Known edges of sills and ramps on floor and landings."""
    landings: KnownLandings | None = None
    """Landings between the flights; None: the chair turns on none."""
    reports_ground: bool = False
    """Whether the ground ahead (``FreeGround``) is known from frames or from the plant; the guard then awaits it."""
    loop: Literal["closed", "open"] = "closed"
    vision: Literal["robust", "paper"] = "robust"
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    reconstruct: Reconstruct | None = None
    """State reconstruction; None keeps the choice in the controller's file."""

    @property
    def camera(self) -> PinholeCamera:
        """Camera in use, on the chair."""
        return self.chair.camera_at(rear=self.direction == "down")


def is_full_traversal(config: MissionConfig, driver: Driver | None = None) -> bool:
    """Return whether a mission goes from floor to landing (or back) instead of along one flight.

    A full traversal needs a controller that follows the plan, a detector that maps the stair (the paper's does not) and a flipper
    to cross the crest.

    Args:
        driver: An experiment's own driver in place of the configured one.
    """
    plugins = config.plugins
    controller = driver or plugins.controller
    follows_plan = config.loop == "closed" and (controller is None or controller.follows_plan)
    maps_stair = config.vision == "robust" if plugins.detector is None else plugins.detector.maps_stair
    return follows_plan and maps_stair and config.chair.flipper is not None


def source_of_plugin(plugin: Callable[..., object]) -> str:
    """Return ``module:Class`` of a plug-in; a class that was read from a file names the file."""
    module = sys.modules.get(plugin.__module__)
    file = getattr(module, "__file__", None)
    place = str(file) if plugin.__module__.startswith(FILE_PREFIX) and file is not None else plugin.__module__
    return f"{place}:{getattr(plugin, '__qualname__', type(plugin).__qualname__)}"
