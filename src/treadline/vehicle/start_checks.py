"""Feasibility of the start pose and of the task from there: ``Scenario, ChairDescription -> problems``.

The penetration of the chair into the stair is that of boxes into boxes, by the separating axis theorem (Gottschalk et al.,
SIGGRAPH 1996). A pulley is treated as round along each tested axis; the axes are those of the boxes, so that the edge of a box can
appear up to 0.4 pulley radii too near.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.rotations import Rotation, Vector3, rotation_y
from treadline.scenario.chair import ChairDescription, Tracks
from treadline.scenario.scenario import Chair, Scenario, Start
from treadline.vehicle._start_view import StartView
from treadline.vehicle.bodies import Vehicle, flipper_turns, vehicle
from treadline.vehicle.landing_turn_kernels import Outline
from treadline.vehicle.stair_solids import Box, stair_boxes, stair_solids
from treadline.vehicle.staircase import Staircase, as_designed
from treadline.vehicle.start_pose import CLEARANCE_M, LANDING_LEAST_M, Standing, from_edge_m, length_m, rounded_off_m, standing

HEADROOM_M = 2.0
"""Least height between two flights [m]: the headroom over stairs in the UK's Approved Document K."""
SUNK_M = 0.01
"""Largest accepted penetration of a part into floor or stair at the start [m]: settling before t = 0 removes it."""
PARTS = {"hull": "the hull", "payload": "the passenger", "nose": "the tip of the flipper", "approach": "the flipper"}
"""Names of the chair's shapes in messages; all others are belts."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlacedPart:
    """Part of the chair in the world: a box or a cylinder."""

    name: str
    centre_W: Vector3
    half_m: Vector3
    R_WK: Rotation
    is_round: bool = False
    """Whether the part is a cylinder about its y."""

    def reach(self, axes: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Return the extent of the part from its centre along unit vectors [m]."""
        along = np.abs(axes @ self.R_WK)
        if not self.is_round:
            return np.asarray(along @ self.half_m)
        across = np.sqrt(np.maximum(1.0 - along[:, 1] ** 2, 0.0))
        return np.asarray(self.half_m[0] * across + self.half_m[1] * along[:, 1])


@dataclass(frozen=True, slots=True, kw_only=True)
class Overlap:
    """Deepest overlap of a part of the chair with a part of the stair."""

    part: str
    """Shape of the chair, named as in ``bodies.vehicle``."""
    into: str
    """Kind of the stair's box."""
    index: int
    """Index of the step; -1 for floor and walls."""
    depth_m: float


def checked_start(scenario: Scenario, chair: ChairDescription) -> tuple[tuple[str | None, ...], int | None]:
    """Return the problems of the task and of the view at the start, None for each passed test, and the number of nosings in view.

    The number is None in open loop, which uses no camera, and where the chair cannot do the task.

    Raises:
        MechanicsError: If the chair cannot stand at the start: nothing can be judged or simulated from there.
    """
    # The jitter of single steps is drawn when the plant is built.
    staircase, outside = as_designed(scenario.stair, scenario.step, scenario.sill), _outside_the_flight(scenario, chair.tracks)
    problem = (
        (outside if scenario.start.place == "flight" else None)
        or _in_the_floor(scenario, chair.tracks)
        or _on_winders(scenario, chair.tracks)
        or _over_the_landings_end(scenario, chair)
        or _over_an_edge(scenario, chair.tracks, staircase)
        or _overlapping(scenario, chair, staircase)
    )
    if problem is not None:
        raise MechanicsError(f"the chair cannot stand at its start: {problem}")
    aim = _nowhere_to_go(scenario) or _cannot_come_down(scenario, chair) or _cannot_mount(scenario, chair) or outside
    mount = chair.camera if scenario.drive.direction == "up" else chair.rear_camera
    if aim or mount is None or scenario.control.loop == "open":
        return (aim,), None
    view = StartView(scenario, chair, staircase, mount)

    def stands(start: Start) -> bool:
        other = scenario.model_copy(update={"start": start})
        return _in_the_floor(other, chair.tracks) is None and _on_winders(other, chair.tracks) is None

    return (view.problem(stands),), view.nosings(scenario.start)


def _overlapping(scenario: Scenario, chair: ChairDescription, staircase: Staircase) -> str | None:
    """Return which part of the chair would start in a wall, a step or the floor, and how deep."""
    start = standing(staircase, chair.tracks, scenario.start)
    parts = placed_parts(vehicle(chair, scenario.chair.entered), start, flipper_turns(chair))
    found = deepest_overlap(parts, staircase)
    if found is None or found.depth_m <= SUNK_M:
        return None
    step = f" {found.index}" if found.index >= 0 else ""
    into = f"{'the' if found.into == 'floor' or step else 'a'} {found.into}{step}"
    side, _, name = found.part.rpartition("_")
    part = PARTS.get(name, "the belt") + (f" on the {side}" if side else "")
    other = ", or nearer the middle of the flight" if found.into == "wall" else ""
    other = other or (", or at another step" if scenario.start.place == "flight" else "")
    return f"{part} would start {found.depth_m:.2f} m inside {into}; start squarer{other}"


def _over_an_edge(scenario: Scenario, tracks: Tracks, staircase: Staircase) -> str | None:
    """Return how far a track would start beyond the front or a side of floor or landing; half of a belt's width is allowed."""
    place = scenario.start.place
    if place == "flight":
        return None
    start = standing(staircase, tracks, scenario.start)
    box = next((box for box in reversed(stair_boxes(staircase)) if box.kind == place), None)
    if box is None:  # of several parts, between which sills lie: the chair starts behind the last one
        return None
    half_run, aside = 0.5 * tracks.flat_run_m, 0.5 * tracks.gauge_m
    ends_B = np.array([[x, y, 0.0] for x in (-half_run, half_run) for y in (-aside, aside)])
    ends_K = (start.p_WB + ends_B @ start.R_WB.T - np.array(box.centre_W)) @ box.R_WK
    over_m = max(float(-box.half_m[0] - ends_K[:, 0].min()), float(np.abs(ends_K[:, 1]).max()) - box.half_m[1])
    if over_m <= 1e-6:  # rounding
        return None
    return f"a track would start {over_m:.2f} m over an edge of the {place}; start squarer, or nearer its middle"


def _nowhere_to_go(scenario: Scenario) -> str | None:
    place, direction = scenario.start.place, scenario.drive.direction
    if (place, direction) not in {("floor", "down"), ("landing", "up")}:
        return None
    other, turned = ("landing", "up") if place == "floor" else ("floor", "down")
    remedy = f"start on the {other}, or give drive.direction = '{turned}'"
    return f"no flight leads {direction} from start.place = '{place}'; {remedy}"


def _cannot_come_down(scenario: Scenario, chair: ChairDescription) -> str | None:
    """Return what a chair lacks to come down, rearwards: the mission tips over the edge with the flipper, and looks back."""
    parts = {"flipper": chair.flipper, "rear_camera": chair.rear_camera}
    lacking = [f"[{name}]" for name, part in parts.items() if part is None]
    if scenario.drive.direction == "up" or not lacking:
        return None
    reason = f"chair '{chair.name}' lacks {' and '.join(lacking)}, and comes down no stair; give chair.model = 'wheelchair'"
    return reason + _fall(scenario, chair)


def _cannot_mount(scenario: Scenario, chair: ChairDescription) -> str | None:
    """Return that a chair without flippers only drives along a flight: over a crest it would fall, and so it does not mount."""
    if chair.flipper is not None or scenario.start.place != "floor" or scenario.control.loop == "open":
        return None
    reason = f"chair '{chair.name}' lacks [flipper], and can only drive along a flight; give start.place = 'flight'"
    return reason + _fall(scenario, chair)


def _fall(scenario: Scenario, chair: ChairDescription) -> str:
    """Return in words how a chair without flippers would fall; empty for one with them."""
    from treadline.vehicle.edge_fall import falls_at_the_edge  # few vehicles have no flipper

    return "" if chair.flipper is not None else f": {falls_at_the_edge(scenario, chair)}"


def _outside_the_flight(scenario: Scenario, tracks: Tracks) -> str | None:
    """Return how far a track lies next to the flight: its outermost corner on the flight, or half a belt before the flight."""
    start, width_m = scenario.start, scenario.stair.width_m
    on_it = start.place == "flight"
    reach_m = _reach_m(scenario, tracks)[1] if on_it else 0.5 * tracks.gauge_m
    outside_m = abs(start.lateral_m) + reach_m - 0.5 * width_m
    if outside_m <= 0.0:
        return None
    verb = "starts" if on_it else "would enter"
    return f"a track {verb} {outside_m:.2f} m outside the flight, which is {width_m:g} m wide; start nearer its middle"


def _reach_m(scenario: Scenario, tracks: Tracks) -> tuple[float, float]:
    """Return the extent of the flat run's corners from its middle, along and across the flight [m]."""
    heading = abs(scenario.start.heading_deg) * DEG
    half_width, half_run = 0.5 * (tracks.gauge_m + tracks.belt_width_m), 0.5 * tracks.flat_run_m
    c, s = math.cos(heading), math.sin(heading)
    return half_run * c + half_width * s, half_width * c + half_run * s


def _in_the_floor(scenario: Scenario, tracks: Tracks) -> str | None:
    """Return how deep a corner of the flat run lies below the floor with the front pulley on a low nosing."""
    start, stair = scenario.start, scenario.stair
    behind_m = 0.5 * tracks.flat_run_m * math.cos(start.heading_deg * DEG) + _reach_m(scenario, tracks)[0]
    # The rear pulley turns up behind the flat run: its lowest point lies below the end of that.
    aside = math.sin(stair.slope_rad) * math.sin(start.heading_deg * DEG)
    rounder_m = tracks.pulley_radius_m * (math.sqrt(1.0 - aside * aside) - math.cos(stair.slope_rad))
    lower_m = (rounded_off_m(stair.nosing_radius_m, stair.slope_rad) - CLEARANCE_M) * math.cos(stair.slope_rad)
    below_m = behind_m * math.sin(stair.slope_rad) + rounder_m + lower_m
    sunk_m = below_m - (start.step + 1) * stair.rise_m
    if start.place != "flight" or sunk_m <= SUNK_M:
        return None
    least = math.ceil((below_m - SUNK_M) / stair.rise_m) - 1
    remedy = f"start at step {least} or above" if least < stair.steps else "start on the floor or the landing"
    return f"the rear of a track would start {sunk_m:.2f} m below the floor, its front on step {start.step}; {remedy}"


def _on_winders(scenario: Scenario, tracks: Tracks) -> str | None:
    """Return from which step to start where the flat run would lie on winders, whose nosings are in no common plane."""
    start, stair = scenario.start, scenario.stair
    if start.place != "flight" or not stair.winders:
        return None
    after, reach_m = stair.first_winder + stair.winders, 2.0 * _reach_m(scenario, tracks)[0]
    clear = after + math.ceil(reach_m * math.cos(stair.slope_rad) / stair.run_m)
    # A front pulley on the first winder's nosing, which is square to the flight, touches no other winder.
    if start.step <= stair.first_winder or start.step >= clear:
        return None
    remedy = [f"{stair.first_winder} or below"] * (stair.first_winder > 0) + [f"{clear} or above"] * (clear < stair.steps)
    where = f"start at step {', or at '.join(remedy)}" if remedy else "start on the floor or the landing"
    return f"the tracks would start on winders, steps {stair.first_winder} to {after - 1}; {where}"


def _over_the_landings_end(scenario: Scenario, chair: ChairDescription) -> str | None:
    """Return the depth of landing required so that a chair starting there has its belts on it, and a wall clear of its flipper."""
    stair, tracks, depth_m = scenario.stair, chair.tracks, max(scenario.stair.landing_m, scenario.stair.run_m)
    sills_m, _ = as_designed(stair, (), scenario.sill).ground_behind(stair.count - 1)
    behind_m = max(from_edge_m(stair, tracks), sills_m + LANDING_LEAST_M)
    needed_m = behind_m + length_m(stair, tracks) * math.cos(scenario.start.heading_deg * DEG)
    if scenario.start.place != "landing" or depth_m >= needed_m:
        return None
    return (
        f"the landing is {depth_m:.2f} m deep, a chair that starts on it needs {needed_m:.2f} m; start on the flight, or give "
        "stair.landing_m with the floor that follows"
    )


def placed_parts(chair: Vehicle, start: Standing, turns_rad: Mapping[str, float]) -> tuple[PlacedPart, ...]:
    """Return the chair's shapes at its start pose, its flippers turned as ``flipper_turns`` says."""
    turned = {name: rotation_y(angle_rad) for name, angle_rad in {"seat": start.seat_rad, **turns_rad}.items()}
    return tuple(
        PlacedPart(
            name=shape.name,
            centre_W=start.p_WB + start.R_WB @ (np.array(body.origin_m) + R_BK @ np.array(shape.centre_m)),
            half_m=np.array(shape.half_m),
            R_WK=start.R_WB @ R_BK @ rotation_y(-shape.nose_up_rad),
            is_round=shape.kind == "cylinder",
        )
        for body in chair.bodies
        for R_BK in [turned.get(body.name, np.eye(3))]
        for shape in body.shapes
    )


def outline_of(chair: ChairDescription, flipper_rad: float | None = None) -> Outline:
    """Return the outline of a chair on level ground.

    Args:
        flipper_rad: Angle of the flipper above the belts; None: as far up as it turns.
    """
    if flipper_rad is None and chair.flipper is not None:
        flipper_rad = math.radians(chair.flipper.range_deg[1])
    level = Standing(p_WB=np.zeros(3), R_WB=np.eye(3), seat_rad=0.0)
    parts = placed_parts(vehicle(chair, Chair()), level, flipper_turns(chair, flipper_rad))
    ways = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    rear_m, front_m, half_m = np.max([ways @ part.centre_W + part.reach(ways) for part in parts], axis=0).tolist()
    tracks = chair.tracks
    return Outline(
        rear_m=rear_m,
        front_m=front_m,
        half_m=half_m,
        belts_rear_m=0.5 * tracks.flat_run_m,
        belts_front_m=0.5 * tracks.flat_run_m,
        half_belts_m=0.5 * (tracks.gauge_m + tracks.belt_width_m),
    )


def deepest_overlap(parts: tuple[PlacedPart, ...], staircase: Staircase) -> Overlap | None:
    """Return the deepest overlap of the chair with the stair, or None."""
    boxes = [solid.box for solid in stair_solids(staircase)]
    centres, radii = np.array([box.centre_W for box in boxes]), np.array([math.hypot(*box.half_m) for box in boxes])
    worst: Overlap | None = None
    for part in parts:
        reach_m = radii + float(np.linalg.norm(part.half_m))
        for place in np.flatnonzero(np.linalg.norm(centres - part.centre_W, axis=1) < reach_m):
            box = boxes[int(place)]
            depth_m = depth_of_overlap(part, box)
            if depth_m > (0.0 if worst is None else worst.depth_m):
                worst = Overlap(part=part.name, into=box.kind, index=box.index, depth_m=depth_m)
    return worst


def crossing_flights(staircase: Staircase) -> tuple[int, int] | None:
    """Return two flights of which one passes too low over the other, or None; a flight may stand on the landing at its foot."""
    number = {step.index: k for k, steps in enumerate(staircase.flights) for step in steps}
    can_cross = len(staircase.courses) > 1 and staircase.winders is None
    boxes = [box for box in stair_boxes(staircase) if can_cross and box.kind in ("step", "landing")]
    for box in boxes:
        x, y, z = box.centre_W
        room_m = np.array([*box.half_m[:2], box.half_m[2] + 0.5 * HEADROOM_M])
        below = PlacedPart(name="", centre_W=np.array([x, y, z - 0.5 * HEADROOM_M]), half_m=room_m, R_WK=box.R_WK)
        for lower in boxes:
            two = number[lower.index], number[box.index]
            stands = two[1] == two[0] or (two[1] == two[0] + 1 and lower.kind == "landing")
            if lower.index < box.index and not stands and depth_of_overlap(below, lower) > SUNK_M:
                return two
    return None


def depth_of_overlap(part: PlacedPart, box: Box) -> float:
    """Return the distance needed to separate two boxes [m], negative without contact."""
    A, B = part.R_WK, box.R_WK
    apart = np.array(box.centre_W) - part.centre_W
    cross = np.cross(A.T[:, None, :], B.T[None, :, :]).reshape(-1, 3)
    squared = np.einsum("ij,ij->i", cross, cross)
    skew = squared > 1e-9  # the cross product of parallel edges is no axis
    axes = np.vstack([A.T, B.T, cross[skew] / np.sqrt(squared[skew])[:, None]])
    reach = part.reach(axes) + np.abs(axes @ B) @ np.array(box.half_m)
    return float((reach - np.abs(axes @ apart)).min())
