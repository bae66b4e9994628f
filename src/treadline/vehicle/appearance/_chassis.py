"""Chassis and cameras: frame, battery, covers and drive inside the hull's box; masts and housings at the camera mounts."""

import numpy as np

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_x, rotation_y, rotation_z
from treadline.scenario.chair import CameraMount, ChairDescription
from treadline.vehicle.appearance._mesh import Mesh, MeshPart, box, cylinder, extrusion, merged, part, rounded_box, tube
from treadline.vehicle.appearance._seat import carries_person, linkage_y_m

PLATE_M = 0.012
"""Thickness of the frame's side plates [m] (drawn only)."""
HOUSING_M = (0.026, 0.124, 0.029)
"""Depth, width and height of the camera housing [m]: RealSense D455, data sheet of the D400 family."""
MAST_M = 0.011
"""Radius of the camera masts [m] (drawn only)."""


def chassis_parts(chair: ChairDescription) -> tuple[MeshPart, ...]:
    """Return the chassis and the cameras on their masts."""
    (cx, _, cz), (length, width, height) = chair.masses.hull_centre_m, chair.masses.chassis_size_m
    x0, x1, z0, z1 = cx - 0.5 * length, cx + 0.5 * length, cz - 0.5 * height, cz + 0.5 * height
    half = 0.5 * width
    # The sides drop towards the front, where the passenger's feet are.
    side = np.array(
        [
            (x0 + 0.12 * height, z0),
            (x1 - 0.3 * height, z0),
            (x1, z0 + 0.25 * height),
            (x1, z0 + 0.5 * height),
            (cx + 0.1 * length, z1),
            (x0 + 0.2 * height, z1),
            (x0, z1 - 0.2 * height),
            (x0, z0 + 0.12 * height),
        ]
    )
    frame: list[Mesh] = [extrusion(side, half - PLATE_M, half), extrusion(side, -half, -half + PLATE_M)]
    frame += [
        cylinder((x, -half + 0.5 * PLATE_M, z), (x, half - 0.5 * PLATE_M, z), 0.05 * height, sides=10)
        for x, z in (
            (x1 - 0.07 * height, z0 + 0.32 * height),
            (x0 + 0.1 * height, z1 - 0.15 * height),
            (cx + 0.1 * length, z0 + 0.07 * height),
        )
    ]
    inner = min(0.62 * half, linkage_y_m(chair) - 0.02)
    low, high = x0 + 0.14 * length, cx
    battery = rounded_box((0.5 * (low + high), 0.0, z0 + 0.32 * height), (high - low, 2.0 * inner, 0.56 * height), 0.08 * height)
    lid = rounded_box((0.5 * (x0 + high), 0.0, z1 - 0.19 * height), (high - x0 - 0.02, 1.9 * inner, 0.34 * height), 0.12 * height)
    front = np.array(
        [
            (x1 - 0.24 * height, z0 + 0.01 * height),
            (x1 - 0.2 * height, z0 + 0.01 * height),
            (x1 - 0.01 * height, z0 + 0.26 * height),
            (x1 - 0.05 * height, z0 + 0.26 * height),
        ]
    )
    covers = [lid, extrusion(front, -half + PLATE_M, half - PLATE_M)]
    radius = 0.17 * height
    at = (x0 + 0.28 * height, z0 + 0.3 * height)
    drive = [
        cylinder((at[0], sign * (half - PLATE_M), at[1]), (at[0], sign * 0.3 * half, at[1]), radius, sides=14)
        for sign in (1.0, -1.0)
    ]
    parts = [
        part("frame", "chair", frame, "frame"),
        part("battery", "chair", [battery], "battery"),
        part("covers", "chair", covers, "cover"),
        part("drive", "chair", drive, "drive"),
    ]
    masts = [_front_mast(chair, chair.camera, (x1 - 0.07 * height, half, z0 + 0.32 * height))]
    cameras = [chair.camera]
    if chair.rear_camera is not None:
        masts.append(_rear_mast(chair, chair.rear_camera, (x0, half, z1)))
        cameras.append(chair.rear_camera)
    parts.append(part("camera_masts", "chair", masts, "seat_frame"))
    parts.append(part("camera_housings", "chair", [_housing(mount) for mount in cameras], "camera"))
    parts.append(part("camera_lenses", "chair", [lens for mount in cameras for lens in _lenses(mount)], "lens"))
    return tuple(parts)


def _front_mast(chair: ChairDescription, mount: CameraMount, hull: tuple[float, float, float]) -> Mesh:
    """Return the mast of the front camera on the frame's front tube; a person has the mast at the side, with a crossbar."""
    x, y, z = mount.position_m
    x1, half, low = hull
    foot_x = min(x, x1)
    if not carries_person(chair):
        return tube([(foot_x, y, low), (foot_x, y, z - 0.05), (x - 0.03, y, z - 0.01)], MAST_M)
    aside = half - 0.5 * PLATE_M
    bend = 0.06
    return tube(
        [
            (foot_x, aside, low),
            (foot_x, aside, z - bend - 0.03),
            (x - 0.02, aside - bend, z - 0.03),
            (x - 0.02, y, z - 0.03),
        ],
        MAST_M,
    )


def _rear_mast(chair: ChairDescription, mount: CameraMount, hull: tuple[float, float, float]) -> Mesh:
    """Return the mast of the rear camera; on a chair for a person, the push handles with a crossbar."""
    x, y, z = mount.position_m
    x0, half, z1 = hull
    foot_x = max(x, x0 + 0.05)
    if not carries_person(chair):
        return tube([(foot_x, y, z1 - 0.02), (foot_x, y, z - 0.05), (x + 0.03, y, z - 0.01)], MAST_M)
    aside = 0.75 * half
    rods = [
        tube([(foot_x, s * aside, z1 - 0.03), (x + 0.03, s * aside, z - 0.03), (x - 0.09, s * aside, z)], MAST_M) for s in (1, -1)
    ]
    return merged([*rods, tube([(x + 0.03, -aside, z - 0.03), (x + 0.03, aside, z - 0.03)], MAST_M)])


def _pose(mount: CameraMount, mesh: Mesh) -> Mesh:
    """Return a mesh of the camera's frame (x along the optical axis) in B."""
    R = rotation_z(mount.yaw_deg * DEG) @ rotation_y(mount.pitch_deg * DEG) @ rotation_x(mount.roll_deg * DEG)
    return mesh.moved(mount.position_m, R)


def _housing(mount: CameraMount) -> Mesh:
    depth, width, height = HOUSING_M
    return _pose(
        mount,
        merged(
            [
                rounded_box((-0.5 * depth, 0.0, 0.0), HOUSING_M, 0.3 * height),
                box((-depth, 0.0, -0.4 * height), (0.02, 0.5 * width, 0.01)),
            ]
        ),
    )


def _lenses(mount: CameraMount) -> list[Mesh]:
    _, width, height = HOUSING_M
    return [
        _pose(mount, cylinder((-0.01, s * 0.3 * width, 0.0), (0.004, s * 0.3 * width, 0.0), 0.28 * height, sides=10))
        for s in (1, 0, -1)
    ]
