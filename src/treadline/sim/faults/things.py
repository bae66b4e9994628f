"""Things that come to stand in a chair's way or to lie in its view: ``Damage -> solids``, seen by its camera.

``way`` is +1 for a chair that drives forwards and -1 for one that backs: the side that its camera looks to.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from treadline.angles import rotation_z
from treadline.mechanics.chair import ChairDescription
from treadline.mechanics.staircase import Staircase
from treadline.signals import FrameQuality, Reading, StairMap
from treadline.sim.camera.camera import Camera
from treadline.sim.camera.eye import Eye
from treadline.sim.camera.solids import Shadow, Solid, beam
from treadline.sim.camera.truth import SWEPT_HEIGHT_M
from treadline.sim.faults.damage import Damage

BOX_M = (0.25, 0.6, 0.5)
"""Depth, width and height of the obstacle: a suitcase that reaches both belts."""
OUT_OF_THE_WAY_M = (0.0, 0.0, -10.0)
"""Where the box waits."""
BOX_COLOUR = (150.0, 40.0, 38.0)
GRAIN_M = 0.02
"""Between the points of the box that are asked whether the chair would sweep them."""
SHOWN_M = 3.0
"""From mid-track, for a camera to see what stands on the ground."""
BAR_M = (1.1, 0.04, 0.04)
"""Length, width and height of the false edge: a broomstick, a rail left lying, the rim of a mat."""
BAR_COLOUR = (200.0, 198.0, 190.0)
SHADOW_ASIDE_M, SHADOW_HALF_M = 0.06, 0.03
BAR_LEAST_M, BAR_MOST_M = 0.6, 2.0
"""Where a bar may lie along the camera's axis; further away it would be no edge among others."""


class Surroundings:
    """What stands in a chair's way and lies in its view beside the stair itself, and the camera that sees it."""

    def __init__(self, staircase: Staircase, chair: ChairDescription, eye: Eye, way: int) -> None:
        self.eye = self._clear_eye = eye
        self.box: Solid | None = None
        self._bar: tuple[Solid, Shadow] | None = None
        self._damage = Damage()
        self._staircase, self._chair, self._way = staircase, chair, way

    def change(self, damage: Damage, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> None:
        """Put things where a chair goes and looks from a pose, and take away what is over."""
        before, self._damage = self._damage, damage
        if damage.obstacle_m != before.obstacle_m:
            stand = partial(box_ahead, self._staircase, self._chair, R_WB, p_WB, way=self._way)
            self.box = None if damage.obstacle_m is None else stand(damage.obstacle_m)
        if not isinstance(self._clear_eye, Camera):
            return
        if damage.bar_rad != before.bar_rad:
            camera = self._clear_eye.calibration
            lie = partial(bar_in_view, self._staircase, R_WB @ camera.R_BC, p_WB + R_WB @ np.array(camera.mount_m))
            self._bar = None if damage.bar_rad is None else lie(damage.bar_rad)
        bars, shadows = ([], []) if self._bar is None else ([self._bar[0]], [self._bar[1]])
        things = bars if self.box is None else [*bars, self.box]
        self.eye = self._clear_eye.facing(things, shadows) if things else self._clear_eye

    def told(self, seen: Reading, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> Reading:
        """Return what a camera without images says, with what stands in the way."""
        if self.box is None:
            return seen
        match seen:
            case StairMap():
                return replace(seen, obstacle_m=distance_m(self.box, self._chair, R_WB, p_WB, self._way))
            case FrameQuality():
                far_m = on_the_level_m(self.box, self._staircase, R_WB, p_WB, self._way)
                if far_m is not None and self._way < 0:  # its top leans towards the chair
                    along_m = distance_m(self.box, self._chair, R_WB, p_WB, self._way)
                    far_m = far_m if along_m is None else min(far_m, along_m)
                return replace(seen, obstacle_m=far_m)
            case _:
                return seen

    def gap_m(self, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> float | None:
        """Return how far the leading end is from what stands in the way, along the belts; None where nothing does."""
        distance = None if self.box is None else distance_m(self.box, self._chair, R_WB, p_WB, self._way)
        return None if distance is None else distance - leading_end_m(self._chair, self._way)


def with_box(scene_xml: str) -> str:
    """Return a scene in MJCF with a box that can be put in the chair's way; the chair keeps its place among the bodies."""
    (x, y, z), (a, b, c) = OUT_OF_THE_WAY_M, BOX_M
    geom = f'<geom class="stair" type="box" size="{a / 2} {b / 2} {c / 2}"/>'
    body = f'    <body name="obstacle" mocap="true" pos="{x} {y} {z}">{geom}</body>\n'
    return scene_xml.replace("  </worldbody>", f"{body}  </worldbody>")


def leading_end_m(chair: ChairDescription, way: int) -> float:
    """Return how far the tracks reach from B, a flipper laid in line with the belts."""
    return chair.reach_m if way > 0 else chair.rear_reach_m


def box_ahead(
    staircase: Staircase,
    chair: ChairDescription,
    R_WB: Float[np.ndarray, "3 3"],
    p_WB: Float[np.ndarray, " 3"],
    ahead_m: float,
    way: int,
) -> Solid:
    """Return a box on tread or floor, its face towards the chair ``ahead_m`` from the leading end along the belts."""
    near = p_WB + way * (leading_end_m(chair, way) + ahead_m) * R_WB[:, 0]
    yaw = math.atan2(way * R_WB[1, 0], way * R_WB[0, 0])
    half = 0.5 * np.array(BOX_M)
    far = near + rotation_z(yaw)[:, 0] * BOX_M[0]
    centre = 0.5 * (near + far)
    centre[2] = min(_ground_m(staircase, near), _ground_m(staircase, far)) + half[2]
    return Solid(kind="bag", centre_W=centre, half_m=half, R_WK=rotation_z(yaw), colour=BOX_COLOUR, texture="dark")


def distance_m(
    box: Solid, chair: ChairDescription, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"], way: int
) -> float | None:
    """Return how far from B along x the nearest of a box is that the chair would sweep; None if it would sweep none of it."""
    axes = [np.linspace(-half, half, round(2.0 * half / GRAIN_M) + 1) for half in box.half_m]
    points_K = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    x, y, z = ((box.centre_W + points_K @ box.R_WK.T - p_WB) @ R_WB).T
    swept = (np.abs(y) <= 0.5 * (chair.tracks.gauge_m + chair.tracks.belt_width_m)) & (way * x > 0.0)
    swept &= (z >= SWEPT_HEIGHT_M[0]) & (z <= SWEPT_HEIGHT_M[1])
    return float((way * x[swept]).min()) if swept.any() else None


def on_the_level_m(
    box: Solid, staircase: Staircase, R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"], way: int
) -> float | None:
    """Return how far ahead of mid-track a box on the level beyond the stair is; None if it is on a step, or far off."""
    stands_m = float(box.centre_W[2] - box.half_m[2])
    level_m = staircase.steps[-1].z_m if way > 0 else 0.0
    ahead = way * R_WB[:2, 0] / np.linalg.norm(R_WB[:2, 0])
    far_m = float(ahead @ (box.centre_W - p_WB)[:2]) - float(box.half_m[0])
    return far_m if abs(stands_m - level_m) < GRAIN_M and 0.0 < far_m < SHOWN_M else None


def bar_in_view(
    staircase: Staircase, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"], askew_rad: float
) -> tuple[Solid, Shadow]:
    """Return a bar on the nosings where the camera looks, turned to the left by ``askew_rad``, and a shadow along it."""
    R_WS = staircase.R_WS
    along = R_WS @ np.array([-math.sin(askew_rad), math.cos(askew_rad), 0.0])
    across = R_WS @ np.array([math.cos(askew_rad), math.sin(askew_rad), 0.0])
    centre = _looked_at(staircase, R_WC, p_WC) + 0.5 * BAR_M[2] * R_WS[:, 2]
    reach = 0.5 * BAR_M[0] * along
    bar = beam("rail", centre - reach, centre + reach, BAR_M[1:], colour=BAR_COLOUR)
    shadow = Shadow(
        normal_W=(float(across[0]), float(across[1]), float(across[2])),
        level_m=float(across @ centre) - SHADOW_ASIDE_M,
        half_m=SHADOW_HALF_M,
    )
    return bar, shadow


def _looked_at(staircase: Staircase, R_WC: Float[np.ndarray, "3 3"], p_WC: Float[np.ndarray, " 3"]) -> Float[np.ndarray, " 3"]:
    """Return where the camera's axis meets the plane of the nosings, on the flight."""
    p_SC, axis_S = staircase.R_WS.T @ (p_WC - staircase.p_WS), staircase.R_WS.T @ R_WC[:, 2]
    depth = -p_SC[2] / axis_S[2] if axis_S[2] < 0.0 else BAR_MOST_M
    p_S = p_SC + min(max(depth, BAR_LEAST_M), BAR_MOST_M) * axis_S
    length = staircase.pitch_m * (len(staircase.steps) - 1)
    return np.asarray(staircase.p_WS + staircase.R_WS @ np.array([min(max(p_S[0], 0.0), length), p_S[1], 0.0]))


def _ground_m(staircase: Staircase, p_W: Float[np.ndarray, " 3"]) -> float:
    """Return the height of what one stands on at a place; where flights turn, on the flight that is nearest below it."""
    if not staircase.turn_rad:
        return max((step.z_m for step in staircase.steps if step.x_m <= p_W[0] and not step.missing), default=0.0)
    x, y, c, s, half_length, half_width, height = staircase.surfaces.T
    along, across = c * (p_W[0] - x) + s * (p_W[1] - y), c * (p_W[1] - y) - s * (p_W[0] - x)
    below = (np.abs(along) <= half_length) & (np.abs(across) <= half_width)
    below &= height <= p_W[2] + max(step.rise_m for step in staircase.steps)
    return float(height[below].max(initial=0.0))
