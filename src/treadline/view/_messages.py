"""What the viewer and its workers send each other: orders and commands in, frames, obstacles and contact forces out."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Literal, TypeVar

import numpy as np
from jaxtyping import Float

from treadline.core.camera_images import PinholeCamera
from treadline.scenario.faults import Conditions, Fault
from treadline.scenario.scenario import Scenario
from treadline.vehicle.stair_solids import Box

SEND_S = 0.04
"""Interval of messages to the viewer and of its scene [s]: 25 updates a second; a display of 15 shows every second one or all."""
MESSAGES_MAX = 50
"""Messages on the way to the viewer: two seconds' worth; a viewer further behind gets no images."""
DEPTH_STEP = 4
"""Pixels between the depths that are kept: 10 kB per frame, and 1 cm on a nosing at 1 m."""

T = TypeVar("T")
Way = tuple[Float[np.ndarray, "v 3"], Mapping[str, Float[np.ndarray, " n"]]]
"""Ground, and the columns of the walk that ``check`` made over it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Handset:
    """State of the handset in the browser."""

    dead_man: bool = True
    stop: bool = False
    rearm: bool = False
    flight_ends: bool = False
    go_back: bool = False
    manual: bool = False
    """Whether the person steers instead of the planner."""
    speed_m_s: float = 0.0
    """Mean belt speed of a person who steers [m/s]."""
    turn_m_s: float = 0.0
    """Half the difference of the belt speeds of a person who steers, right minus left [m/s]; positive turns left."""


Command = Fault | Handset | Conditions
"""Command of a person to a running simulation."""
Script = list[tuple[int, Command]]
"""Commands with the tick before which each was given: scenario, seed and script give the same run to the bit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Run for a worker."""

    scenario: Scenario
    seed: int
    controller: Any = None
    detector: str | None = None
    estimator: str | None = None
    script: tuple[tuple[int, Command], ...] = ()
    """Commands that are applied at their ticks."""
    speed: float = 1.0
    """Simulated seconds per second; 0 is as fast as possible."""
    attended: bool = False
    """Whether a person may command the run, so that it goes on after a hold."""
    pictures: bool = True
    """Whether camera images are drawn."""
    contacts: bool = False
    """Whether the contact forces of every tick are sent: a tenth of the time of the physics."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageOrder:
    """Images of a log, for a worker that runs the detector on them."""

    log: str
    """MCAP file."""
    vision: Literal["robust", "paper"] = "robust"
    """Method of the detector."""
    camera: PinholeCamera
    """Camera with its mount on the chair, which images in a log do not have."""
    swept_half_m: float
    """Half width of the volume swept by the chair [m]."""
    latency_s: float
    """Time from exposure to the mission [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShownFrame:
    """Camera frame with the result of the detector."""

    t_s: float
    """Time of the exposure."""
    taken_s: float
    """Time at which the mission received the frame."""
    summary: str
    """One line for people."""
    reason: str | None = None
    """Reason of a rejected or unconfirmed frame; None if accepted."""
    heading_rad: float | None = None
    nosings_B: Float[np.ndarray, "n 3"] = field(default_factory=lambda: np.empty((0, 3)))
    """Perceived nosings in the chair frame of the exposure [m]."""
    is_judged: bool = True
    """Whether a detector has judged the frame; the images of a ROS bag are shown as they are."""
    planes_B: Mapping[str, Float[np.ndarray, "k 4 3"]] = field(default_factory=dict)
    """Corners of the detected ``treads`` and ``risers`` in the chair frame of the exposure [m]; empty without any."""
    picture: bytes | None = None
    """Image with overlay as JPEG; None if no image is kept."""
    depth_m: Float[np.ndarray, "h w"] | None = None
    """Every ``DEPTH_STEP``-th row and column of the depth image [m], kept as long as the picture."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Obstacle:
    """Box in the path from ``t_s`` on; without a box it has been removed."""

    t_s: float
    box: Box | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactForces:
    """Normal forces of stair and obstacle on the chair at a tick."""

    t_s: float
    points_W: Float[np.ndarray, "n 3"]
    """Contact points [m]."""
    forces_W: Float[np.ndarray, "n 3"]
    """Forces on the chair [N]."""


def latest(items: Sequence[T], t_s: float, time: str = "t_s") -> T | None:
    """Return the last item whose time is at or before a time; None before the first.

    Args:
        time: Name of the items' time.
    """
    number = bisect_right(items, t_s + 1e-6, key=attrgetter(time))  # stamps of a log are rounded
    return items[number - 1] if number else None
