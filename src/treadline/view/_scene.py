"""Scene in the browser: stair, chair, perceived and true nosings, heading, support, forces, obstacle.

``Feed, t -> viser nodes``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.rotations import Rotation, Vector3, quaternion_of, rotation_of, rotation_z
from treadline.playback import HALF_LINE_M, Recording, support_at
from treadline.report.plot_table import SIGNS
from treadline.vehicle.appearance import MeshPart, body_poses, chair_parts, lug_part, lug_poses, stair_parts
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD
from treadline.view._feed import Feed
from treadline.view._messages import ShownFrame, latest
from treadline.view._session import Fork

Rgb = tuple[int, int, int]
Points = Float[np.ndarray, "n 2 3"]

COLOURS: Mapping[str, Rgb] = {
    name: (int(sign["colour"][1:3], 16), int(sign["colour"][3:5], 16), int(sign["colour"][5:7], 16)) for name, sign in SIGNS.items()
}
"""Colours of the scene."""
SHOWN = {
    "follow": ("follow the chair", True),
    "passenger": ("passenger", True),
    "planes": ("detected treads and risers", True),
    "forces": ("belt forces", False),
    "contacts": ("contact forces", False),
}
"""What a person may show or hide, with its name and whether it is shown at first."""
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
BACKGROUND = np.full((2, 2, 3), (222, 230, 238), dtype=np.uint8)
"""Background: a light sky, so that white treads stand out."""
CAMERA_M, LOOK_AT_M = (-1.2, -4.4, 2.1), (0.5, 0.0, 0.7)
"""First view, relative to the chair [m]: from its right, so that it climbs to the right in the picture."""
FLAT: dict[str, Any] = {"material": "toon3", "cast_shadow": False, "receive_shadow": False}
"""Shading of every surface: one material in all, because a browser without a graphics card compiles each for a tenth of a second
before the first picture, and without shadows and physically based shading, which it draws slowly."""
NARROW_CAMERA_M, NARROW_LOOK_AT_M = (-1.6, -6.0, 1.9), (0.4, 0.0, -0.5)
"""First view on a narrow screen: from farther away, and the chair in the upper half of the picture."""
LIFT_M = 0.012
"""Lift of the lines above the edges [m], so that the treads do not hide them."""
GREY = (80, 80, 80)
"""Colour of the camera."""


@dataclass(slots=True, kw_only=True, eq=False)
class _Body:
    """Nodes of one chair in the scene."""

    root: Any
    frames: dict[str, Any] = field(default_factory=dict)
    lugs: Any = None
    passenger: list[Any] = field(default_factory=list)


class SceneView:
    """Nodes of the scene, updated to an instant of a run.

    Args:
        server: viser's server.
        feed: Run that is shown; its chair and stair stay the same.
    """

    def __init__(self, server: Any, feed: Feed) -> None:
        scenario = feed.order.scenario
        self._scene, self._feed = server.scene, feed
        self._belts = scenario.belts
        self._frame: ShownFrame | None = None
        self._box: Any = None
        self._box_node: Any = None
        self._ghost: _Body | None = None
        self._ghost_label: Any = None
        self._add_world(server)
        self._chair = self._add_chair("/world/chair")
        self._add_nosings()
        self._add_marks()
        self._add_forces()

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
        for part in stair_parts(self._feed.staircase) if self._feed.knows_stair else ():
            self._add_part(f"/world/stair/{part.name}", part)
        server.initial_camera.position, server.initial_camera.look_at = CAMERA_M, LOOK_AT_M

    def _add_part(self, name: str, part: MeshPart, colour: Rgb | None = None, opacity: float | None = None) -> Any:
        return self._scene.add_mesh_simple(
            name,
            vertices=part.vertices_m,
            faces=part.faces,
            color=rgb_of(part) if colour is None else colour,
            opacity=(None if part.opacity >= 1.0 else part.opacity) if opacity is None else opacity,
            flat_shading=True,
            **FLAT,
        )

    def _add_chair(self, root: str, colour: Rgb | None = None, opacity: float | None = None) -> _Body:
        """Add the chair, or one in a single colour, which has no lugs."""
        chair, loading, scene = self._feed.recording.chair, self._feed.order.scenario.chair, self._scene
        body = _Body(root=scene.add_frame(root, show_axes=False))
        for part in chair_parts(chair, loading, self._belts):
            if part.body != "chair" and part.body not in body.frames:
                body.frames[part.body] = scene.add_frame(f"{root}/{part.body}", show_axes=False)
            under = root if part.body == "chair" else f"{root}/{part.body}"
            node = self._add_part(f"{under}/{part.name}", part, colour, opacity)
            if part.name.startswith(("person", "payload")):
                body.passenger.append(node)
        if colour is None:
            lug = lug_part(chair, self._belts)
            places, turns = self._lugs_at((0.0, 0.0), None)
            body.lugs = scene.add_batched_meshes_simple(
                f"{root}/lugs",
                vertices=lug.vertices_m,
                faces=lug.faces,
                batched_wxyzs=turns,
                batched_positions=places,
                batched_colors=rgb_of(lug),
                flat_shading=True,
                lod="off",
                **FLAT,
            )
        return body

    def _add_lines(self, name: str, colour: str, thickness: float, points: Points | None = None) -> Any:
        """Add lines; those that are not known yet lie below every stair."""
        points = NOWHERE[None, :2] if points is None else points
        return self._scene.add_line_segments(f"/world/{name}", points, COLOURS[colour], thickness=thickness)

    def _add_nosings(self) -> None:
        camera = self._feed.camera
        if self._feed.knows_stair:
            true_W = (self._feed.nosings.ends_W + np.array([0.0, 0.0, LIFT_M])).astype(np.float32)
            self._add_lines("nosings/true", "true", 0.008, true_W)
        self._perceived = self._add_lines("nosings/perceived", "perceived", 0.012)
        self._missed = self._add_lines("nosings/missed", "missed", 0.014)
        self._planes = {
            name: self._scene.add_mesh_simple(f"/world/planes/{name}", NOWHERE, QUADS, color=COLOURS[name], opacity=0.5, **FLAT)
            for name in ("treads", "risers")
        }
        self._frustum = self._scene.add_camera_frustum(
            "/world/chair/camera",
            fov=2.0 * math.atan2(0.5 * camera.height_px, camera.fy_px),
            aspect=camera.width_px / camera.height_px,
            scale=0.25,
            thickness=0.004,
            color=GREY,
            wxyz=quaternion_of(camera.R_BC),
            position=camera.mount_m,
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_marks(self) -> None:
        """Add heading, support, centre of mass and its plumb line."""
        scene, good = self._scene, COLOURS["good"]
        fan = np.array([[0.0, 0.0, 0.0], [WEDGE_M, -WEDGE_M, 0.0], [WEDGE_M, WEDGE_M, 0.0]])
        both = np.array([[0, 1, 2], [0, 2, 1]])
        self._wedge = scene.add_mesh_simple("/world/heading/estimate", fan, both, color=COLOURS["estimate"], opacity=0.65, **FLAT)
        self._heading = self._add_lines("heading/true", "true", 0.006, np.array([[[0.0, 0.0, 0.0], [WEDGE_M + 0.2, 0.0, 0.0]]]))
        self._support = scene.add_mesh_simple("/world/chair/support", np.zeros((4, 3)), QUADS[:4], color=good, opacity=0.5, **FLAT)
        self._com = scene.add_icosphere("/world/com", radius=0.035, color=good, subdivisions=2, **FLAT)
        self._plumb = self._add_lines("plumb", "good", 0.008)
        self._label = scene.add_label("/world/margin", "", anchor="bottom-center", font_screen_scale=1.1)

    def _add_forces(self) -> None:
        """Add the forces, which are hidden at first."""
        self._forces = self._add_arrows("chair/forces", "forces", 0.015, 0.04)
        self._contacts, self._ghost_contacts = (
            self._add_arrows(name, colour, 0.008, 0.02, head_length=0.05)
            for name, colour in (("contacts", "contacts"), ("ghost_contacts", "fork"))
        )

    def _add_arrows(self, name: str, colour: str, shaft_m: float, head_m: float, **more: float) -> Any:
        look = {"shaft_radius": shaft_m, "head_radius": head_m, **more}
        return self._scene.add_arrows(f"/world/{name}", np.zeros((1, 2, 3)), COLOURS[colour], visible=False, **look)

    def _lugs_at(
        self, travel_m: tuple[float, float], flipper_rad: float | None
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 4"]]:
        """Return positions and orientations of all lugs in B."""
        chair = self._feed.recording.chair
        left = lug_poses(chair, "left", travel_m[0], flipper_rad, self._belts)
        right = lug_poses(chair, "right", travel_m[1], flipper_rad, self._belts)
        poses = np.concatenate([left, right])
        half = -0.5 * np.arctan2(poses[:, 2, 0], poses[:, 0, 0])  # a lug turns about the chair's y alone
        zero = np.zeros(len(half))
        return poses[:, :3, 3].astype(np.float32), np.stack([np.cos(half), zero, np.sin(half), zero], axis=1).astype(np.float32)

    def show(self, t_s: float, shows: Mapping[str, bool], fork: Fork | None = None) -> None:
        """Update the scene to an instant of the run; nothing changes if nothing is known of it yet.

        Args:
            shows: What is shown, by the names of ``SHOWN``.
            fork: Run whose chair is shown as a ghost at the same instant.
        """
        feed, run = self._feed, self._feed.recording
        if feed.is_empty:
            return
        k = run.index_at(t_s)
        R_WB, p_WB = rotation_of(run.quat_WB[k]), run.p_WB[k]
        shift_m = self._shift_at(run.t_s[k])
        self._move(self._chair, run, k)
        self._show_ghost(fork, t_s)
        self._world.position = (-float(p_WB[0]), 0.0, -float(p_WB[2])) if shows["follow"] else (0.0, 0.0, 0.0)
        self._show_heading(run, k, R_WB, p_WB)
        self._show_support(run, k, R_WB, p_WB, shift_m)
        self._show_frame(feed.fresh_frame_at(t_s))
        self._show_obstacle(t_s)
        for node in self._planes.values():
            node.visible = shows["planes"]
        for node in self._chair.passenger:
            node.visible, node.position = shows["passenger"], run.chair.in_chair(shift_m)
        show_arrows(self._forces, *self._belt_forces(run, k), NEWTON_PER_M, visible=shows["forces"])
        for arrows, of in ((self._contacts, feed), (self._ghost_contacts, None if fork is None else fork.feed)):
            found = None if of is None else of.contacts_at(t_s)
            points, forces = (np.empty((0, 3)),) * 2 if found is None else (found.points_W, found.forces_W)
            show_arrows(arrows, points, forces, CONTACT_N_PER_M, visible=shows["contacts"])

    def _move(self, body: _Body, run: Recording, k: int) -> None:
        body.root.position, body.root.wxyz = run.p_WB[k], run.quat_WB[k]
        seat_rad, flipper_rad = float(run.seat_rad[k]), float(run.flipper_rad[k])
        poses = body_poses(run.chair, self._feed.order.scenario.chair, seat_rad, flipper_rad)
        for name, frame in body.frames.items():
            X_BK = poses[name]
            frame.position, frame.wxyz = X_BK[:3, 3], quaternion_of(X_BK[:3, :3])
        if body.lugs is not None:
            left_m, right_m = run.belt_travel_m[k].tolist()
            body.lugs.batched_positions, body.lugs.batched_wxyzs = self._lugs_at((left_m, right_m), flipper_rad)

    def _show_ghost(self, fork: Fork | None, t_s: float) -> None:
        if fork is None or fork.feed.is_empty:
            if self._ghost is not None:
                self._ghost.root.visible = self._ghost_label.visible = False
            return
        if self._ghost is None:
            self._ghost = self._add_chair("/world/ghost", COLOURS["fork"], opacity=0.3)
            self._ghost_label = self._scene.add_label("/world/ghost_label", "", anchor="bottom-center")
        self._ghost.root.visible = self._ghost_label.visible = True
        run, end_s = fork.feed.recording, fork.feed.recording.duration_s
        k = run.index_at(t_s)
        self._move(self._ghost, run, k)
        # Above the label of the margin, so that both can be read.
        self._ghost_label.position = run.p_WB[k] + np.array([0.0, 0.0, 2.0])
        self._ghost_label.text = f"fork: {fork.name}" + (f", ended at {end_s:.1f} s" if t_s > end_s and run.verdict else "")

    def _show_heading(self, run: Recording, k: int, R_WB: Rotation, p_WB: Vector3) -> None:
        staircase, estimate_rad = self._feed.staircase, float(run.estimate_rad[k])
        R_WS, _, _ = staircase.stair_frame(staircase.flight_at(p_WB, R_WB))
        place = p_WB + WEDGE_LIFT_M * R_WS[:, 2]
        self._heading.position = place + 0.01 * R_WS[:, 2]
        self._heading.wxyz = quaternion_of(R_WS @ rotation_z(float(run.heading_rad[k])))
        self._heading.visible = self._feed.knows_stair
        self._wedge.visible = self._feed.knows_stair and not math.isnan(estimate_rad)
        if self._wedge.visible:
            half = max(math.tan(min(1.96 * float(run.sigma_rad[k]), 1.0)), LEAST_HALF_WEDGE)
            self._wedge.position, self._wedge.wxyz = place, quaternion_of(R_WS @ rotation_z(estimate_rad))
            self._wedge.scale = (1.0, half, 1.0)

    def _show_support(self, run: Recording, k: int, R_WB: Rotation, p_WB: Vector3, shift_m: tuple[float, float, float]) -> None:
        margin_rad, seat_rad, flipper_rad = float(run.margin_rad[k]), float(run.seat_rad[k]), float(run.flipper_rad[k])
        colour = COLOURS["bad" if margin_rad <= 0.0 else "near" if margin_rad < MARGIN_LIMIT_RAD else "good"]
        found = support_at(run.chair, self._feed.staircase, R_WB, p_WB, flipper_rad) if self._feed.knows_stair else None
        self._support.visible = found is not None
        if found is not None:
            front, rear, left, right = found.front_m, -found.rear_m, found.left_m, -found.right_m
            corners = [(front, left), (front, right), (rear, right), (rear, left)]
            self._support.vertices = np.array([(x, y, 0.004) for x, y in corners], dtype=np.float32)
        loading = self._feed.order.scenario.chair.moved(shift_m)
        com_B = np.array(centre_of_mass(run.chair, loading, seat_rad, flipper_rad))
        com_W, down_W = p_WB + R_WB @ com_B, p_WB + R_WB @ np.array([com_B[0], com_B[1], 0.0])
        foot = np.array([com_W[0], com_W[1], min(down_W[2], com_W[2]) - 0.05])
        self._support.color = self._com.color = colour
        self._com.position = com_W
        self._plumb.points = np.array([[com_W, foot]], dtype=np.float32)
        self._plumb.colors = np.broadcast_to(np.array(colour, dtype=np.uint8), (1, 2, 3))
        if not math.isnan(margin_rad):
            self._label.text = f"tip-over margin {margin_rad / DEG:.1f}°"
            self._label.position = com_W + np.array([0.0, 0.0, 0.75])

    def _shift_at(self, t_s: float) -> tuple[float, float, float]:
        """Return the passenger's shift from the scenario's offset by lean, sway and faults [m]: forward, left, up."""
        loading = self._feed.order.scenario.chair
        (x, y), (a, b), sway = loading.lean_m, loading.sway_m, loading.sway_at(t_s)
        dx, dy, dz = self._feed.payload_shift_at(t_s)
        return dx + x + a * sway, dy + y + b * sway, dz

    def _show_frame(self, frame: ShownFrame | None) -> None:
        if frame is self._frame:
            return
        self._frame = frame
        if frame is None:
            self._perceived.visible = self._missed.visible = False
            for node in self._planes.values():
                node.vertices = NOWHERE
            self._frustum.color, self._frustum.image = COLOURS["near"], None
            return
        run = self._feed.recording
        k = run.index_at(frame.t_s)
        R_WB, p_WB = rotation_of(run.quat_WB[k]), run.p_WB[k]
        perceived, missed = self._lines_of(frame, float(run.heading_rad[k]), R_WB, p_WB)
        for node, lines in ((self._perceived, perceived), (self._missed, missed)):
            node.visible = len(lines) > 0
            if len(lines):
                node.points = lines
        self._show_planes(frame, R_WB, p_WB)
        self._frustum.color = COLOURS["bad"] if frame.reason else GREY
        if frame.picture is not None:
            # Imports the compiled detector: a second that the first picture saves.
            from treadline.perception.overlay import from_jpeg

            self._frustum.image = from_jpeg(frame.picture, 160)

    def _lines_of(self, frame: ShownFrame, heading_rad: float, R_WB: Rotation, p_WB: Vector3) -> tuple[Points, Points]:
        """Return the perceived nosings in W, and the missed true ones, as lines."""
        nosings, lift_W = self._feed.nosings, np.array([0.0, 0.0, 2.0 * LIFT_M])
        heading_rad = heading_rad if frame.heading_rad is None else frame.heading_rad
        across_B = HALF_LINE_M * np.array([math.sin(heading_rad), math.cos(heading_rad), 0.0])
        perceived_B = np.stack([frame.nosings_B - across_B, frame.nosings_B + across_B], axis=1)
        _, missed = nosings.compare(frame.nosings_B, R_WB, p_WB) if frame.is_judged and self._feed.knows_stair else ((), ())
        missed_W = nosings.ends_W[[nosings.place_of(number) for number in missed]] + lift_W
        return (p_WB + perceived_B @ R_WB.T + lift_W).astype(np.float32), missed_W.astype(np.float32)

    def _show_planes(self, frame: ShownFrame, R_WB: Rotation, p_WB: Vector3) -> None:
        """Show the treads and risers that were detected in a frame, at the pose of its exposure."""
        eye_B = np.array(self._feed.camera.mount_m)
        for name, node in self._planes.items():
            corners = NOWHERE.reshape(-1, 4, 3).copy()
            if name in frame.planes_B and len(near_B := frame.planes_B[name][:PLANES_MAX]):
                towards = eye_B - near_B.mean(axis=1, keepdims=True)
                near_B = near_B + PLANE_LIFT_M * towards / np.linalg.norm(towards, axis=2, keepdims=True)
                corners[: len(near_B)] = p_WB + near_B @ R_WB.T
            node.vertices = corners.reshape(-1, 3)

    def _show_obstacle(self, t_s: float) -> None:
        found = latest(self._feed.obstacles, t_s)
        box = None if found is None else found.box
        if box is self._box:
            return
        self._box = box
        if self._box_node is not None:
            self._box_node.remove()
            self._box_node = None
        if box is not None:
            self._box_node = self._scene.add_box(
                "/world/obstacle",
                color=COLOURS["forces"],
                dimensions=tuple(2.0 * half for half in box.half_m),
                position=box.centre_W,
                wxyz=quaternion_of(rotation_z(box.yaw_rad)),
                **FLAT,
            )

    def _belt_forces(self, run: Recording, k: int) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points at the belts and their forces in B; none where the forces are unknown."""
        half_m, forces = 0.5 * run.chair.tracks.gauge_m, np.zeros((2, 3))
        forces[:, 0] = run.belt_force_n[k]
        known = np.isfinite(forces[:, 0])
        return np.array([[0.0, half_m, 0.03], [0.0, -half_m, 0.03]])[known], forces[known]


def rgb_of(part: MeshPart) -> Rgb:
    """Return the colour of a part in whole numbers from 0 to 255."""
    red, green, blue = (round(255 * c) for c in part.colour)
    return red, green, blue


def show_arrows(
    arrows: Any, points: Float[np.ndarray, "n 3"], forces: Float[np.ndarray, "n 3"], newton_per_m: float, *, visible: bool
) -> None:
    """Show forces as arrows from their points, as far as there are any."""
    arrows.visible = visible and len(points) > 0
    if arrows.visible:
        arrows.points = np.stack([points, points + forces / newton_per_m], axis=1).astype(np.float32)
