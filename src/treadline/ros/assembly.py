"""Which nodes there are, and how each comes out of the same settings that a mission has."""

from collections.abc import Callable
from pathlib import Path
from uuid import uuid4

from treadline.core.errors import SettingsError
from treadline.core.ports import Plant
from treadline.mission.mission_blocks import build_blocks, guard_config, warm_up
from treadline.mission.mission_config import MissionConfig
from treadline.ros.block_nodes import CameraNode, DriverNode, GuardNode, HeadingNode, Node, SeatNode
from treadline.ros.goal_driver import GoalDriverNode
from treadline.ros.plant_node import PlantNode
from treadline.ros.recorder import RecorderNode
from treadline.scenario.chair import ChairDescription
from treadline.vehicle.linkage import SeatLinkage

ROLES = {
    "guard": "passes commands, limits them, or holds",
    "camera": "images to heading and stair map (the paper's /depth)",
    "heading": "IMU, belts and measured headings to the heading estimate",
    "seat": "levels the seat by its IMU",
    "driver": "planner and LQR: plan and belt speeds",
    "plant": "the chair on its stair, simulated",
    "recorder": "identification record and log",
}
DRIVING = tuple(name for name in ROLES if name != "recorder")
"""The graph; the guard is started first, the plant last."""


def driving_nodes(chair: ChairDescription) -> tuple[str, ...]:
    """Return the nodes of a chair's graph: without a seat linkage there is no seat node."""
    return tuple(name for name in DRIVING if name != "seat" or chair.seat is not None)


def reject_unknown(name: str) -> None:
    """Reject a name that no node has.

    Raises:
        SettingsError: If it is one.
    """
    if name not in ROLES:
        raise SettingsError(f"no node is called '{name}'; there are: {', '.join(ROLES)}")


def node_of(
    name: str,
    config: MissionConfig,
    *,
    plant: Callable[[], Plant] | None = None,
    out: Path | None = None,
    goals: bool = False,
) -> Node:
    """Return a node by its name.

    Args:
        goals: Whether the driver stands until it is given a goal; ``/cmd_vel`` moves the chair meanwhile.
        plant: Makes the chair; only the plant node asks.
        out: Where the recorder writes.

    Raises:
        SettingsError: If there is no such node, or it lacks what it needs.
    """
    reject_unknown(name)
    blocks = build_blocks(config)
    limits = guard_config(config, blocks.driver.period_s)
    if name == "plant":
        if plant is None:
            raise SettingsError("the plant node needs a plant; on a real chair its drivers take its place")
        return PlantNode(plant(), limits)
    match name:
        case "guard":
            awaited = tuple(other for other in driving_nodes(config.chair) if other != "guard")
            return GuardNode(limits, awaited, sender=f"guard-{uuid4().hex[:8]}")
        case "camera":
            warm_up(config)
            return CameraNode(blocks.detector, limits, blocks.swept_half_m)
        case "heading":
            linkage = None if config.chair.seat is None else SeatLinkage(config.chair.seat)
            return HeadingNode(blocks.estimator, limits, config.camera, linkage)
        case "seat":
            if blocks.leveller is None:
                raise SettingsError(f"chair {config.chair.name!r} has no seat linkage; leave out the seat node")
            return SeatNode(blocks.leveller, limits)
        case "driver":
            return GoalDriverNode(config, limits) if goals else DriverNode(blocks.planner, blocks.driver, limits)
    return RecorderNode(out, blocks.driver.period_s)
