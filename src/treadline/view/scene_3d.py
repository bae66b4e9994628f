"""Scene in the browser: stair, chair, perceived and true nosings, heading, support, forces, obstacle.

``Tape, t -> viser nodes``.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, quaternion_of, rotation_z
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance import MeshPart, body_poses, chair_parts, lug_part, lug_poses, stair_parts
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.static_stability import centre_of_mass
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD
from treadline.view.colours import BAD, CONTACT, GHOST, GOOD, MISSED, RISER, SEEN, SWEPT, TREAD, TRUE, WARN
from treadline.view.nosing_lines import SeenNosings, pose_of
from treadline.view.support import support_of
from treadline.view.tape import ContactForces, Look, Tape

PLANES_MAX = 24
"""Largest number of treads, and of risers, that are shown: more than a camera sees of a flight."""
PLANE_LIFT_M = 0.015
"""Distance of detected planes from the true ones towards the camera [m], so that they do not hide each other."""
QUADS = np.concatenate([4 * k + np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]) for k in range(PLANES_MAX)])
"""Triangles of the planes, each from both sides."""
NOWHERE = np.full((4 * PLANES_MAX, 3), -100.0, dtype=np.float32)
"""Corners of planes that are not shown [m]: below every stair."""
WEDGE_M = 1.8
"""Length of the heading wedge [m]: to the nosings ahead of the flipper."""
WEDGE_LIFT_M = 0.25
"""Height of the wedge above the belts' lower line [m]: above the belts, below the seat."""
LEAST_HALF_WEDGE = math.tan(0.8 * DEG)
"""Least half width of the wedge per length, so that a precise heading stays visible."""
NEWTON_PER_M = 500.0
"""Scale of the force arrows [N/m]: the weight of chair and passenger, 2 kN, is 4 m."""
CONTACT_N_PER_M = 250.0
"""Scale of the contact forces [N/m]: 80 N, one of a dozen contacts on a floor, reaches above the belts."""
SWEPT_M = 1.5
"""Length of the swept volume ahead of the chair [m]."""
SWEPT_HEIGHT_M = (0.06, 1.4)
"""Height of the swept volume above the belts' lower line [m], as in the simulator's ground truth of obstacles."""
BACKGROUND = np.full((2, 2, 3), (222, 230, 238), dtype=np.uint8)
"""Background: a light sky, so that white treads stand out."""
CAMERA_M, LOOK_AT_M = (-1.2, -4.4, 2.1), (0.5, 0.0, 0.7)
"""First view, relative to the chair [m]: from its right, so that it climbs to the right in the picture."""
FLAT: dict[str, Any] = {"material": "toon3", "cast_shadow": False, "receive_shadow": False}
"""Shading of every surface: one material in all, because a browser without a graphics card compiles each for a tenth of a second
before the first picture, and without shadows and physically based shading, which it draws slowly."""
NARROW_CAMERA_M, NARROW_LOOK_AT_M = (-1.6, -6.0, 1.9), (0.4, 0.0, -0.5)
"""First view on a narrow screen: from farther away, and the chair in the upper half of the picture."""
LABEL_M = 2.0
"""Height of the ghost's label above the belts [m]: above the label of the margin, so that both can be read."""
GHOST_OPACITY = 0.3
"""Opacity of the other chair."""


@dataclass(slots=True, kw_only=True)
class SceneChoices:
    """What of the scene is shown."""

    planes: bool = True
    forces: bool = False
    contacts: bool = False
    swept: bool = False
    follow: bool = True
    passenger: bool = True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stage:
    """Stair and chair of a run."""

    staircase: Staircase
    chair: ChairDescription
    loading: Chair
    belts: Belts
    rear_camera: bool = False
    image_height_px: int = 240


@dataclass(slots=True, kw_only=True, eq=False)
class _Body:
    """Nodes of one chair in the scene."""

    root: Any
    frames: dict[str, Any]
    lugs: Any
    passenger: list[Any] = field(default_factory=list)


class SceneView:
    """Nodes of the scene, updated to an instant of the tape.

    Args:
        server: viser's server.
        stage: Stair and chair.
    """

    def __init__(self, server: Any, stage: Stage) -> None:
        self._scene, self._stage = server.scene, stage
        self._camera = stage.chair.camera_at(stage.image_height_px, rear=stage.rear_camera)
        self._nosings = SeenNosings(stage.staircase, self._camera)
        self._look: Look | None = None
        self._obstacle: Any = None
        self._obstacle_at: Any = None
        self._ghost: _Body | None = None
        self._ghost_label: Any = None
        self._add_world(server)
        self._chair = self._add_chair("/world/chair", None)
        self._add_marks()

    def _add_world(self, server: Any) -> None:
        scene = self._scene
        scene.configure_default_lights(enabled=False)
        # Image-based lighting more than doubles the time of a frame that is drawn in software.
        scene.configure_environment_map(None)
        scene.add_light_hemisphere("/lights/sky", sky_color=(255, 255, 255), ground_color=(150, 150, 150), intensity=2.2)
        scene.add_light_directional("/lights/sun", intensity=1.6, position=(-3.0, -5.0, 8.0))
        scene.set_background_image(BACKGROUND, format="png")
        scene.world_axes.visible = False
        self._world = scene.add_frame("/world", show_axes=False)
        for part in stair_parts(self._stage.staircase):
            self._add_part(f"/world/stair/{part.name}", part)
        server.initial_camera.position, server.initial_camera.look_at = CAMERA_M, LOOK_AT_M

    def _add_part(self, name: str, part: MeshPart, colour: tuple[int, int, int] | None = None, opacity: float | None = None) -> Any:
        return self._scene.add_mesh_simple(
            name,
            vertices=part.vertices_m,
            faces=part.faces,
            color=tuple(round(255 * c) for c in part.colour) if colour is None else colour,
            opacity=(None if part.opacity >= 1.0 else part.opacity) if opacity is None else opacity,
            flat_shading=True,
            **FLAT,
        )

    def _add_chair(self, root: str, opacity: float | None) -> _Body:
        stage, scene = self._stage, self._scene
        colour = None if opacity is None else GHOST
        body = _Body(root=scene.add_frame(root, show_axes=False), frames={}, lugs=None)
        for part in chair_parts(stage.chair, stage.loading, stage.belts):
            if part.body != "chair" and part.body not in body.frames:
                body.frames[part.body] = scene.add_frame(f"{root}/{part.body}", show_axes=False)
            under = root if part.body == "chair" else f"{root}/{part.body}"
            node = self._add_part(f"{under}/{part.name}", part, colour, opacity)
            if part.name.startswith(("person", "payload")):
                body.passenger.append(node)
        if opacity is None:
            lug = lug_part(stage.chair, stage.belts)
            places, turns = self._lugs_at(0.0, 0.0, None)
            body.lugs = scene.add_batched_meshes_simple(
                f"{root}/lugs",
                vertices=lug.vertices_m,
                faces=lug.faces,
                batched_wxyzs=turns,
                batched_positions=places,
                batched_colors=tuple(round(255 * c) for c in lug.colour),
                flat_shading=True,
                lod="off",
                **FLAT,
            )
        return body

    def _add_marks(self) -> None:
        scene, stage = self._scene, self._stage
        self._true = scene.add_line_segments("/world/nosings/true", self._nosings.true_lines(), TRUE, thickness=0.008)
        nothing = np.full((1, 2, 3), -100.0)
        self._seen = scene.add_line_segments("/world/nosings/perceived", nothing, SEEN, thickness=0.012)
        self._missed = scene.add_line_segments("/world/nosings/missed", nothing, MISSED, thickness=0.014)
        self._planes = [
            scene.add_mesh_simple(f"/world/planes/{name}", NOWHERE, QUADS, color=colour, opacity=0.5, **FLAT)
            for name, colour in (("treads", TREAD), ("risers", RISER))
        ]
        camera = self._camera
        self._frustum = scene.add_camera_frustum(
            "/world/chair/camera",
            fov=2.0 * math.atan2(0.5 * camera.height_px, camera.fy_px),
            aspect=camera.width_px / camera.height_px,
            scale=0.25,
            thickness=0.004,
            color=(80, 80, 80),
            wxyz=quaternion_of(camera.R_BC),
            position=camera.mount_m,
            cast_shadow=False,
            receive_shadow=False,
        )
        fan = np.array([[0.0, 0.0, 0.0], [WEDGE_M, -WEDGE_M, 0.0], [WEDGE_M, WEDGE_M, 0.0]])
        both = np.array([[0, 1, 2], [0, 2, 1]])
        self._wedge = scene.add_mesh_simple("/world/heading/estimate", fan, both, color=WARN, opacity=0.65, **FLAT)
        ahead = np.array([[[0.0, 0.0, 0.0], [WEDGE_M + 0.2, 0.0, 0.0]]])
        self._heading = scene.add_line_segments("/world/heading/true", ahead, TRUE, thickness=0.006)
        square = np.zeros((4, 3))
        self._support = scene.add_mesh_simple(
            "/world/chair/support",
            square,
            np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]),
            color=GOOD,
            opacity=0.5,
            **FLAT,
        )
        self._com = scene.add_icosphere("/world/com", radius=0.035, color=GOOD, subdivisions=2, **FLAT)
        self._plumb = scene.add_line_segments("/world/plumb", nothing, GOOD, thickness=0.008)
        self._label = scene.add_label("/world/margin", "", anchor="bottom-center", font_screen_scale=1.1)
        half, swept = 0.5 * stage.chair.tracks.gauge_m, stage.chair.swept_half_m
        low, high = SWEPT_HEIGHT_M
        self._forces = scene.add_arrows(
            "/world/chair/forces", np.zeros((2, 2, 3)), BAD, shaft_radius=0.015, head_radius=0.04, visible=False
        )
        self._contacts, self._ghost_contacts = (
            scene.add_arrows(
                name, np.zeros((1, 2, 3)), colour, shaft_radius=0.008, head_radius=0.02, head_length=0.05, visible=False
            )
            for name, colour in (("/world/contacts", CONTACT), ("/world/ghost_contacts", GHOST))
        )
        self._half_gauge_m = half
        ahead_m = -1.0 if stage.rear_camera else 1.0
        reach = stage.chair.rear_reach_m if stage.rear_camera else stage.chair.reach_m
        self._swept = scene.add_box(
            "/world/chair/swept",
            color=SWEPT,
            dimensions=(SWEPT_M, 2.0 * swept, high - low),
            opacity=0.2,
            position=(ahead_m * (reach + 0.5 * SWEPT_M), 0.0, 0.5 * (low + high)),
            visible=False,
            **FLAT,
        )

    def _lugs_at(
        self, left_m: float, right_m: float, flipper_rad: float | None
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
        """Return positions and orientations of all lugs in B."""
        stage = self._stage
        poses = np.concatenate(
            [
                lug_poses(stage.chair, "left", left_m, flipper_rad, stage.belts),
                lug_poses(stage.chair, "right", right_m, flipper_rad, stage.belts),
            ]
        )
        half = -0.5 * np.arctan2(poses[:, 2, 0], poses[:, 0, 0])  # a lug turns about the chair's y alone
        zero = np.zeros(len(half))
        return poses[:, :3, 3].astype(np.float32), np.stack([np.cos(half), zero, np.sin(half), zero], axis=1).astype(np.float32)

    def show(self, tape: Tape, t_s: float, choices: SceneChoices, ghost: Tape | None = None, ghost_name: str = "") -> None:
        """Update the scene to an instant of a tape; nothing changes if the tape is empty.

        Args:
            ghost: Run whose chair is shown as a ghost at the same instant.
            ghost_name: Change of that run, which labels its chair.
        """
        if not len(tape):
            return
        row = tape.at(t_s)
        self._move(self._chair, row)
        self._show_ghost(ghost, t_s, ghost_name)
        R_WB, p_WB = pose_of(row)
        self._world.position = (-float(p_WB[0]), 0.0, -float(p_WB[2])) if choices.follow else (0.0, 0.0, 0.0)
        self._show_heading(row, p_WB)
        self._show_support(row, R_WB, p_WB)
        self._show_look(tape, t_s)
        for node in self._planes:
            node.visible = choices.planes
        self._show_obstacle(tape, t_s)
        self._forces.visible, self._swept.visible = choices.forces, choices.swept
        if choices.forces:
            self._show_forces(row)
        for arrows, run in ((self._contacts, tape), (self._ghost_contacts, ghost)):
            _show_contacts(arrows, run.contacts_at(t_s) if choices.contacts and run is not None else None)
        for node in self._chair.passenger:
            node.visible = choices.passenger
            node.position = self._shift_of(row)

    def _move(self, body: _Body, row: dict[str, float]) -> None:
        body.root.position = (row["x_m"], row["y_m"], row["z_m"])
        body.root.wxyz = (row["qw"], row["qx"], row["qy"], row["qz"])
        poses = body_poses(self._stage.chair, self._stage.loading, row["seat_rad"], row["flipper_rad"])
        for name, frame in body.frames.items():
            X_BK = poses[name]  # type: ignore[index]
            frame.position, frame.wxyz = X_BK[:3, 3], quaternion_of(X_BK[:3, :3])
        if body.lugs is not None:
            body.lugs.batched_positions, body.lugs.batched_wxyzs = self._lugs_at(
                row["left_travel_m"], row["right_travel_m"], row["flipper_rad"]
            )

    def _show_ghost(self, ghost: Tape | None, t_s: float, name: str) -> None:
        if ghost is None or not len(ghost):
            if self._ghost is not None:
                self._ghost.root.visible = self._ghost_label.visible = False
            return
        if self._ghost is None:
            self._ghost = self._add_chair("/world/ghost", GHOST_OPACITY)
            self._ghost_label = self._scene.add_label("/world/ghost_label", "", anchor="bottom-center")
        self._ghost.root.visible = self._ghost_label.visible = True
        row = ghost.at(t_s)
        self._move(self._ghost, row)
        _, p_WB = pose_of(row)
        self._ghost_label.position = p_WB + np.array([0.0, 0.0, LABEL_M])
        self._ghost_label.text = f"fork: {name}" + (
            f", ended at {ghost.end_s:.1f} s" if t_s > ghost.end_s and ghost.verdict else ""
        )

    def _show_heading(self, row: dict[str, float], p_WB: Float[np.ndarray, " 3"]) -> None:
        staircase = self._stage.staircase
        R_WB, _ = pose_of(row)
        R_WS, _, _ = staircase.stair_frame(staircase.flight_at(p_WB, R_WB))
        place = p_WB + WEDGE_LIFT_M * R_WS[:, 2]
        self._heading.position, self._heading.wxyz = place + 0.01 * R_WS[:, 2], quaternion_of(R_WS @ rotation_z(row["heading_rad"]))
        known = not math.isnan(row["estimate_rad"])
        self._wedge.visible = known
        if known:
            half = max(math.tan(min(1.96 * row["sigma_rad"], 1.0)), LEAST_HALF_WEDGE)
            self._wedge.position, self._wedge.wxyz = place, quaternion_of(R_WS @ rotation_z(row["estimate_rad"]))
            self._wedge.scale = (1.0, half, 1.0)

    def _show_support(self, row: dict[str, float], R_WB: Float[np.ndarray, "3 3"], p_WB: Float[np.ndarray, " 3"]) -> None:
        stage = self._stage
        reach = support_of(stage.chair, stage.staircase, R_WB, p_WB)
        margin = row["margin_rad"]
        colour = BAD if margin <= 0.0 else WARN if margin < MARGIN_LIMIT_RAD else GOOD
        loading = stage.loading.moved(self._shift_of(row))
        com_B = np.array(centre_of_mass(stage.chair, loading, row["seat_rad"], row["flipper_rad"]))
        com_W = p_WB + R_WB @ com_B
        if reach is not None:
            front, rear, left, right = reach
            corners = [(front, left), (front, -right), (-rear, -right), (-rear, left)]
            self._support.vertices = np.array([(x, y, 0.004) for x, y in corners], dtype=np.float32)
        self._support.visible = reach is not None
        self._support.color = self._com.color = colour
        self._com.position = com_W
        down = p_WB + R_WB @ np.array([com_B[0], com_B[1], 0.0])
        foot = np.array([com_W[0], com_W[1], min(down[2], com_W[2]) - 0.05])
        self._plumb.points = np.array([[com_W, foot]], dtype=np.float32)
        self._plumb.colors = np.broadcast_to(np.array(colour, dtype=np.uint8), (1, 2, 3))
        if not math.isnan(margin):
            self._label.text = f"tip-over margin {margin / DEG:.1f}°"
            self._label.position = com_W + np.array([0.0, 0.0, 0.75])

    def _shift_of(self, row: dict[str, float]) -> tuple[float, float, float]:
        """Return the passenger's shift from the scenario's offset by lean, sway and faults [m]: forward, left, up."""
        loading = self._stage.loading
        (x, y), (a, b), sway = loading.lean_m, loading.sway_m, loading.sway_at(row["t_s"])
        return row["payload_forward_m"] + x + a * sway, row["payload_left_m"] + y + b * sway, row["payload_up_m"]

    def _show_look(self, tape: Tape, t_s: float) -> None:
        look = tape.fresh_look_at(t_s)
        if look is self._look:
            return
        self._look = look
        if look is None:
            self._seen.visible = self._missed.visible = False
            for node in self._planes:
                node.vertices = NOWHERE
            self._frustum.color, self._frustum.image = WARN, None
            return
        seen, missed = self._nosings.lines(look, tape.at(look.t_s))
        self._seen.visible, self._missed.visible = len(seen) > 0, len(missed) > 0
        if len(seen):
            self._seen.points = seen
        if len(missed):
            self._missed.points = missed
        self._show_planes(look, tape.at(look.t_s))
        self._frustum.color = BAD if look.reason else (80, 80, 80)
        if look.picture is not None:
            from treadline.perception.overlay import (
                from_jpeg,
            )  # imports the compiled detector: a second that the first picture saves

            self._frustum.image = from_jpeg(look.picture, 160)

    def _show_planes(self, look: Look, row: dict[str, float]) -> None:
        """Show the treads and risers that were detected in a frame, at the pose of its exposure."""
        R_WB, p_WB = pose_of(row)
        eye_B = np.array(self._camera.mount_m)
        for node, found_B in zip(self._planes, (look.treads_B, look.risers_B), strict=True):
            corners = np.full((PLANES_MAX, 4, 3), -100.0)
            near_B = found_B[:PLANES_MAX]
            towards = eye_B - near_B.mean(axis=1, keepdims=True) if len(near_B) else near_B
            near_B = near_B + PLANE_LIFT_M * towards / np.linalg.norm(towards, axis=2, keepdims=True)
            corners[: len(near_B)] = p_WB + near_B @ R_WB.T
            node.vertices = corners.reshape(-1, 3).astype(np.float32)

    def _show_obstacle(self, tape: Tape, t_s: float) -> None:
        box = tape.obstacle_at(t_s)
        if box is self._obstacle_at:
            return
        self._obstacle_at = box
        if self._obstacle is not None:
            self._obstacle.remove()
            self._obstacle = None
        if box is not None and box.centre_W is not None:
            self._obstacle = self._scene.add_box(
                "/world/obstacle",
                color=BAD,
                dimensions=tuple(2.0 * half for half in box.half_m),
                position=box.centre_W,
                wxyz=quaternion_of(rotation_z(box.yaw_rad)),
                **FLAT,
            )

    def _show_forces(self, row: dict[str, float]) -> None:
        places = np.array([[0.0, self._half_gauge_m, 0.03], [0.0, -self._half_gauge_m, 0.03]])
        tips = places.copy()
        tips[:, 0] += np.array([row["left_force_n"], row["right_force_n"]]) / NEWTON_PER_M
        self._forces.points = np.stack([places, tips], axis=1).astype(np.float32)


def _show_contacts(arrows: Any, found: ContactForces | None) -> None:
    arrows.visible = found is not None and len(found.points_W) > 0
    if found is not None and len(found.points_W):
        tips = found.points_W + found.forces_W / CONTACT_N_PER_M
        arrows.points = np.stack([found.points_W, tips], axis=1).astype(np.float32)
