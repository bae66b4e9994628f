"""Export of a chair, and of the stair around it, as SDF 1.6 for Gazebo 11.

Each belt is a separate link, as required by Gazebo's tracked-vehicle plugins (Pecka et al., IROS 2017): ``left_track`` and
``right_track`` on the chassis, ``left_flipper`` and ``right_flipper`` on the flipper. Without a plugin for moving contact surfaces
(``Lockstep``) the belts are at rest.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Tracks
from treadline.scenario.scenario import Chair
from treadline.vehicle import film_camera
from treadline.vehicle.appearance import MeshPart, stair_parts
from treadline.vehicle.bodies import HULL_FRICTION, Body, Vehicle, sides, vehicle
from treadline.vehicle.stair_solids import NosingGeometry, stair_solids
from treadline.vehicle.staircase import Staircase
from treadline.vehicle.start_pose import Standing
from treadline.vehicle.urdf import document, drawn_parts, mesh_files, roll_pitch_yaw, text


def sdf_model(chair: ChairDescription, loading: Chair, *, friction: tuple[float, float]) -> str:
    """Return a chair without a world as SDF.

    Args:
        friction: Coefficients along and across the belts.
    """
    return _written(chair, vehicle(chair, loading), friction)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lockstep:
    """Plugin that drives a chair in lock-step, and films it. Its belts stay on chassis and flipper."""

    plugin: str
    """File of the plugin, as Gazebo sees it."""
    port: int
    """Port of the plugin on the loopback interface."""
    film: str | None = None
    """Folder, as Gazebo sees it, that holds ``film_meshes`` and receives the images; None: nothing is filmed."""


def sdf_world(
    staircase: Staircase,
    chair: ChairDescription,
    loading: Chair,
    *,
    start: Standing | None = None,
    lockstep: Lockstep | None = None,
) -> str:
    """Return a world with the stair and the chair; light and floor are included, nothing is downloaded.

    Args:
        start: Start pose of the chair; a chair that is driven has one.
        lockstep: Plugin that drives the chair.
    """
    solids = [(solid.box, solid.nosing and _bar(solid.nosing)) for solid in stair_solids(staircase)]
    pose = "" if start is None else text(*start.p_WB, *roll_pitch_yaw(start.R_WB))
    more: dict[str, Any] = {"solids": solids, "pose": pose, "start": start, "lockstep": lockstep, "vehicle": chair}
    if lockstep is not None and lockstep.film is not None and start is not None:
        more |= {"drawn": _drawn(staircase, chair, loading), "film": film_camera, "film_pose": film_camera.pose(start.p_WB)}
    return _written(chair, vehicle(chair, loading), staircase.friction, **more)


def film_meshes(staircase: Staircase, chair: ChairDescription, loading: Chair) -> dict[str, bytes]:
    """Return the mesh files of a filmed world by name."""
    return mesh_files(_drawn(staircase, chair, loading))


def _drawn(staircase: Staircase, chair: ChairDescription, loading: Chair) -> tuple[MeshPart, ...]:
    return (*drawn_parts(chair, loading, None), *stair_parts(staircase))


def _written(chair: ChairDescription, whole: Vehicle, friction: tuple[float, float], **more: Any) -> str:
    """Return the file; a body without mass is left out: a robot without payload, for SDF has no link without mass."""
    words = {} if more.get("lockstep") else {"chair": "track", "flipper": "flipper"}
    massive = [body for body in whole.bodies if body.mass_kg > 0.0]
    links = [(body, divided(body, chair.tracks, words[body.name]) if body.name in words else (body,)) for body in massive]
    return document(
        "world.sdf.j2",
        **{"solids": None, "name": whole.name, "bodies": links, "friction": friction, **more},
        hull_friction=HULL_FRICTION,
        gravity_m_s2=GRAVITY_M_S2,
    )


def divided(body: Body, tracks: Tracks, word: str) -> tuple[Body, Body, Body]:
    """Return a body as three: the middle, and its left and right belt, named by side and ``word``.

    The two sides are level with the centre of mass, half a gauge to either side: sum, centre and moments are those of the body.
    """
    (x, y, z), (ixx, iyy, izz), aside_m = body.com_m, body.inertia, 0.5 * tracks.gauge_m
    side_kg = 0.02 * body.mass_kg  # simulators need a mass in each link, with an unchanged sum
    own = side_kg * 0.05**2 / 12.0  # a thin horizontal plate, small enough for a thin flipper
    apart = side_kg * aside_m**2
    middle = replace(
        body,
        mass_kg=body.mass_kg - 2.0 * side_kg,
        inertia=(ixx - 2.0 * (apart + own), iyy - 2.0 * own, izz - 2.0 * (apart + 2.0 * own)),
        shapes=tuple(shape for shape in body.shapes if shape.belt is None),
    )
    left, right = (
        replace(
            body,
            name=f"{side}_{word}",
            mass_kg=side_kg,
            com_m=(x, y + sign * aside_m, z),
            inertia=(own, own, 2.0 * own),
            products=(0.0, 0.0, 0.0),
            shapes=tuple(shape for shape in body.shapes if shape.belt == side),
        )
        for (side, _), sign in zip(sides(tracks), (1.0, -1.0), strict=True)
    )
    return middle, left, right


def _bar(nosing: NosingGeometry) -> dict[str, Any]:
    """Return the bar between a nosing's ends; SDF 1.6 has no capsule, so its ends are flat."""
    left, right = np.array(nosing.left_W), np.array(nosing.right_W)
    across = left - right
    pose = (*(0.5 * (left + right)), -0.5 * math.pi, 0.0, math.atan2(-across[0], across[1]))
    return {"pose": pose, "radius_m": nosing.radius_m, "length_m": float(np.linalg.norm(across))}
