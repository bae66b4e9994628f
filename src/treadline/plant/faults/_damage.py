"""Damage of the chair, obstacles in its path, and false edges in the camera's view: faults simulated by the physics.

``Faults, t -> Damage -> solids``; each value replaces the previous one, so that ended faults are repaired. ``direction`` is +1 for
a chair driving forwards and -1 for a chair driving backwards, the viewing direction of its camera.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol, runtime_checkable

import numpy as np

from treadline.core.angles import DEG
from treadline.core.ports import Reading, TruthPlant
from treadline.core.rotations import Rotation, Vector3, rotation_z
from treadline.core.signals import FrameQuality, StairMap
from treadline.plant.sensors._instruments import CameraModel
from treadline.plant.sensors.camera import Camera
from treadline.plant.sensors.camera.solids import SceneBox, Shadow, beam
from treadline.scenario.chair import ChairDescription
from treadline.scenario.faults import Conditions, Fault, FaultKind, payload_shift_m
from treadline.vehicle.stair_solids import ground_m, stair_surfaces
from treadline.vehicle.staircase import Staircase

PHYSICAL: tuple[FaultKind, ...] = (
    "track_stalled", "track_slip", "low_friction", "seat_stuck", "power_cut", "obstacle", "false_edges", "flipper_lost",
"flipper_stuck", "payload_forward", "payload_left", "payload_up" )  # fmt: skip
"""Kinds of faults simulated by the physics."""
UNCHANGED = Conditions()
BOX_M = (0.25, 0.6, 0.5)
"""Depth, width and height of the obstacle [m]: a suitcase across both belts."""
OUT_OF_THE_WAY_M = (0.0, 0.0, -10.0)
"""Position of the box while the fault is inactive [m]."""
BOX_COLOUR = (150.0, 40.0, 38.0)
"""Colour of the box (red, green, blue)."""
SWEPT_HEIGHT_M = (0.06, 1.4)
"""Height range of the swept volume above the lower line of the belts [m]: the belts climb lower objects, and the rider is lower
than the upper limit."""
GRAIN_M = 0.02
"""Spacing of the points of the box tested for the swept volume [m]."""
SHOWN_M = 3.0
"""Largest distance from mid-track at which the camera detects an object on the ground [m]."""
BAR_M = (1.1, 0.04, 0.04)
"""Length, width and height of the false edge [m]: a broomstick, a rail, the rim of a mat."""
BAR_COLOUR = (200.0, 198.0, 190.0)
"""Colour of the bar (red, green, blue)."""
SHADOW_ASIDE_M, SHADOW_HALF_M = 0.06, 0.03
"""Offset and half width of the bar's shadow [m]."""
BAR_LEAST_M, BAR_MOST_M = 0.6, 2.0
"""Range of the bar's distance along the optical axis [m]; at larger distances it is indistinct from the nosings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Damage:
    """Damage of the chair and obstacles in its path at one instant; the default is no damage."""

    stalled: tuple[bool, bool] = (False, False)
    """Whether the left and the right belt are blocked."""
    grip: tuple[float, float] = (1.0, 1.0)
    """Factor on the friction of each belt, along and across."""
    power_cut: bool = False
    seat_stuck: bool = False
    flipper_lost: bool = False
    flipper_stuck: bool = False
    obstacle_m: float | None = None
    """Initial distance from the leading end to a box in the path [m]."""
    bar_rad: float | None = None
    """Angle of a bar across the nosings in view [rad], at its initial position."""
    payload_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the passenger's centre of mass in the seat [m]: forward, left, up."""


@runtime_checkable
class Breakable(TruthPlant, Protocol):
    """Simulated chair with support for damage."""

    def set_damage(self, damage: Damage) -> None:
        """Replace the present damage of the chair."""


def damage_of(faults: Iterable[Fault], t_s: float, conditions: Conditions = UNCHANGED) -> Damage:
    """Return the damage by all faults active at ``t_s``; of several obstacles or bars the first is used.

    Args:
        conditions: Friction, multiplied with that of the faults, and shift of the payload, added to theirs.
    """
    on = [fault for fault in faults if fault.active(t_s)]
    kinds = {fault.kind for fault in on}
    stalled = {int(fault.size) for fault in on if fault.kind == "track_stalled"}
    (left, right), (x, y, z), (dx, dy, dz) = conditions.friction, conditions.payload_m, payload_shift_m(on, t_s)
    return Damage(
        stalled=(0 in stalled, 1 in stalled),
        grip=(left * _grip(on, right=False), right * _grip(on, right=True)),
        power_cut="power_cut" in kinds,
        seat_stuck="seat_stuck" in kinds,
        flipper_lost="flipper_lost" in kinds,
        flipper_stuck="flipper_stuck" in kinds,
        obstacle_m=next((fault.size for fault in on if fault.kind == "obstacle"), None),
        bar_rad=next((fault.size * DEG for fault in on if fault.kind == "false_edges"), None),
        payload_m=(x + dx, y + dy, z + dz),
    )


def _grip(on: list[Fault], *, right: bool) -> float:
    share = 1.0
    for fault in on:
        if fault.kind == "low_friction" or (fault.kind == "track_slip" and (fault.size < 0.0) == right):
            share *= abs(fault.size)
    return share


class Surroundings:
    """Obstacle and false edge of a run, and the camera that sees them."""

    def __init__(self, staircase: Staircase, chair: ChairDescription, camera: CameraModel, direction: int) -> None:
        self.camera = self._clear_camera = camera
        self.box: SceneBox | None = None
        self._bar: tuple[SceneBox, Shadow] | None = None
        self._damage = Damage()
        self._staircase, self._chair, self._direction = staircase, chair, direction

    def change(self, damage: Damage, R_WB: Rotation, p_WB: Vector3) -> None:
        """Place or remove obstacle and bar for a change of damage, at the present pose of the chair."""
        before, self._damage = self._damage, damage
        if damage.obstacle_m != before.obstacle_m:
            stand = partial(box_ahead, self._staircase, self._chair, R_WB, p_WB, direction=self._direction)
            self.box = None if damage.obstacle_m is None else stand(damage.obstacle_m)
        if not isinstance(self._clear_camera, Camera):
            return
        if damage.bar_rad != before.bar_rad:
            calibration = self._clear_camera.calibration
            lie = partial(bar_in_view, self._staircase, R_WB @ calibration.R_BC, p_WB + R_WB @ np.array(calibration.mount_m))
            self._bar = None if damage.bar_rad is None else lie(damage.bar_rad)
        bars, shadows = ([], []) if self._bar is None else ([self._bar[0]], [self._bar[1]])
        solids = bars if self.box is None else [*bars, self.box]
        self.camera = self._clear_camera.facing(solids, shadows) if solids else self._clear_camera

    def with_obstacle(self, seen: Reading, R_WB: Rotation, p_WB: Vector3) -> Reading:
        """Return a reading of the statistical camera with the distance of the obstacle."""
        if self.box is None:
            return seen
        match seen:
            case StairMap():
                return replace(seen, obstacle_m=distance_m(self.box, self._chair, R_WB, p_WB, self._direction))
            case FrameQuality():
                far_m = on_the_level_m(self.box, self._staircase, R_WB, p_WB, self._direction)
                if far_m is not None and self._direction < 0:  # its top leans towards the chair
                    along_m = distance_m(self.box, self._chair, R_WB, p_WB, self._direction)
                    far_m = far_m if along_m is None else min(far_m, along_m)
                return replace(seen, obstacle_m=far_m)
            case _:
                return seen

    def gap_m(self, R_WB: Rotation, p_WB: Vector3) -> float | None:
        """Return the distance along the belts from the leading end to the obstacle [m]; None without an obstacle."""
        distance = None if self.box is None else distance_m(self.box, self._chair, R_WB, p_WB, self._direction)
        return None if distance is None else distance - leading_end_m(self._chair, self._direction)


def with_box(scene_xml: str) -> str:
    """Return a scene in MJCF with a movable box; the body index of the chair is unchanged."""
    (x, y, z), (a, b, c) = OUT_OF_THE_WAY_M, BOX_M
    geom = f'<geom class="stair" type="box" size="{a / 2} {b / 2} {c / 2}"/>'
    body = f'    <body name="obstacle" mocap="true" pos="{x} {y} {z}">{geom}</body>\n'
    return scene_xml.replace("  </worldbody>", f"{body}  </worldbody>")


def leading_end_m(chair: ChairDescription, direction: int) -> float:
    """Return the reach of the tracks from B [m], with the flipper in line with the belts."""
    return chair.reach_m if direction > 0 else chair.rear_reach_m


def box_ahead(
    staircase: Staircase, chair: ChairDescription, R_WB: Rotation, p_WB: Vector3, ahead_m: float, direction: int
) -> SceneBox:
    """Return a box on tread or floor, its face ``ahead_m`` from the leading end along the belts."""
    near = p_WB + direction * (leading_end_m(chair, direction) + ahead_m) * R_WB[:, 0]
    yaw = math.atan2(direction * R_WB[1, 0], direction * R_WB[0, 0])
    half = 0.5 * np.array(BOX_M)
    far = near + rotation_z(yaw)[:, 0] * BOX_M[0]
    centre = 0.5 * (near + far)
    centre[2] = min(_ground_m(staircase, near), _ground_m(staircase, far)) + half[2]
    return SceneBox(kind="bag", centre_W=centre, half_m=half, R_WK=rotation_z(yaw), colour=BOX_COLOUR, texture="dark")


def distance_m(box: SceneBox, chair: ChairDescription, R_WB: Rotation, p_WB: Vector3, direction: int) -> float | None:
    """Return the distance along x from B to the nearest point of a box in the swept volume [m]; None without such a point."""
    axes = [np.linspace(-half, half, round(2.0 * half / GRAIN_M) + 1) for half in box.half_m]
    points_K = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, z = ((box.centre_W + points_K @ box.R_WK.T - p_WB) @ R_WB).T
    swept = (np.abs(y) <= 0.5 * (chair.tracks.gauge_m + chair.tracks.belt_width_m)) & (direction * x > 0.0)
    swept &= (z >= SWEPT_HEIGHT_M[0]) & (z <= SWEPT_HEIGHT_M[1])
    return float((direction * x[swept]).min()) if swept.any() else None


def on_the_level_m(box: SceneBox, staircase: Staircase, R_WB: Rotation, p_WB: Vector3, direction: int) -> float | None:
    """Return the distance from mid-track to a box on the flat ground after the stair [m]; None on a step or out of range."""
    stands_m = float(box.centre_W[2] - box.half_m[2])
    level_m = staircase.steps[-1].z_m if direction > 0 else 0.0
    ahead = direction * R_WB[:2, 0] / np.linalg.norm(R_WB[:2, 0])
    far_m = float(ahead @ (box.centre_W - p_WB)[:2]) - float(box.half_m[0])
    return far_m if abs(stands_m - level_m) < GRAIN_M and 0.0 < far_m < SHOWN_M else None


def bar_in_view(staircase: Staircase, R_WC: Rotation, p_WC: Vector3, angle_rad: float) -> tuple[SceneBox, Shadow]:
    """Return a bar on the nosings at the centre of the view, rotated to the left by ``angle_rad``, and its shadow."""
    R_WS = staircase.R_WS
    along = R_WS @ np.array([-math.sin(angle_rad), math.cos(angle_rad), 0.0])
    across = R_WS @ np.array([math.cos(angle_rad), math.sin(angle_rad), 0.0])
    centre = _looked_at(staircase, R_WC, p_WC) + 0.5 * BAR_M[2] * R_WS[:, 2]
    reach = 0.5 * BAR_M[0] * along
    bar = beam("rail", centre - reach, centre + reach, BAR_M[1:], colour=BAR_COLOUR)
    shadow = Shadow(
        normal_W=(float(across[0]), float(across[1]), float(across[2])),
        level_m=float(across @ centre) - SHADOW_ASIDE_M,
        half_m=SHADOW_HALF_M,
    )
    return bar, shadow


def _looked_at(staircase: Staircase, R_WC: Rotation, p_WC: Vector3) -> Vector3:
    """Return the intersection of the camera's axis with the nosing plane, limited to the flight."""
    p_SC, axis_S = staircase.R_WS.T @ (p_WC - staircase.p_WS), staircase.R_WS.T @ R_WC[:, 2]
    depth = -p_SC[2] / axis_S[2] if axis_S[2] < 0.0 else BAR_MOST_M
    p_S = p_SC + min(max(depth, BAR_LEAST_M), BAR_MOST_M) * axis_S
    length = staircase.pitch_m * (len(staircase.steps) - 1)
    return np.asarray(staircase.p_WS + staircase.R_WS @ np.array([min(max(p_S[0], 0.0), length), p_S[1], 0.0]))


def _ground_m(staircase: Staircase, p_W: Vector3) -> float:
    """Return the height of the ground at a place [m]; with turning flights, on the nearest flight below."""
    if len(staircase.courses) == 1:
        return max((step.z_m for step in staircase.steps if step.x_m <= p_W[0] and not step.missing), default=0.0)
    top_W = p_W + np.array([0.0, 0.0, max(step.rise_m for step in staircase.steps)])
    return max(float(ground_m(stair_surfaces(staircase), top_W[None])[0]), 0.0)
