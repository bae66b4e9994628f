"""Meshes of the shipped chairs: closed, inside the geometry they stand for, and few enough triangles to be sent."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import treadline
from treadline.core.rotations import rotation_y
from treadline.scenario.chair import ChairDescription, Payload, read_chair
from treadline.scenario.scenario import Chair, Stair
from treadline.vehicle.appearance import BeltPath, MeshPart, body_poses, chair_parts, lug_part, lug_poses, stair_parts
from treadline.vehicle.bodies import vehicle
from treadline.vehicle.staircase import as_designed
from treadline.vehicle.tracks import pulley_centres

SHIPPED = sorted(path.stem for path in (Path(treadline.__file__).parent / "data" / "chairs").glob("*.toml"))
ROUNDING_M = 1e-6
"""Single precision of coordinates below 2 m."""


def _loading(chair: ChairDescription) -> Chair:
    return Chair(model=chair.name, payload_kg=70.0 if chair.payload_size_m[2] > 0.5 else 4.0)


def _carrier() -> ChairDescription:
    """Return a robot whose payload is fixed to the chassis."""
    chair = read_chair("rescue")
    return chair.model_copy(update={"seat": None, "payload": Payload(com_m=(0.0, 0.0, 0.26), size_m=(0.3, 0.3, 0.2))})


CHAIRS = {**{name: read_chair(name) for name in SHIPPED}, "carrier": _carrier()}
every_chair = pytest.mark.parametrize("chair", CHAIRS.values(), ids=CHAIRS.keys())


def _volume(part: MeshPart) -> float:
    a, b, c = (part.vertices_m[part.faces[:, k]].astype(float) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def _components(part: MeshPart) -> list[MeshPart]:
    """Return the connected components of a part."""
    root = np.arange(len(part.vertices_m))
    while True:
        least = root[part.faces].min(axis=1)
        after = root.copy()
        np.minimum.at(after, part.faces.ravel(), np.repeat(least, 3))
        if np.array_equal(after, root):
            break
        root = after
    labels = root[part.faces[:, 0]]
    return [replace(part, faces=part.faces[labels == label]) for label in np.unique(labels)]


def _assert_closed_and_outward(part: MeshPart) -> None:
    edges = Counter((int(f[i]), int(f[(i + 1) % 3])) for f in part.faces for i in range(3))
    assert max(edges.values()) == 1, part.name
    assert all((b, a) in edges for a, b in edges), part.name
    assert all(_volume(piece) > 0.0 for piece in _components(part)), part.name


@every_chair
def test_each_part_is_watertight_with_outward_faces_and_all_are_few_enough(chair: ChairDescription) -> None:
    parts, lug = chair_parts(chair, _loading(chair)), lug_part(chair)
    assert len({part.name for part in parts}) == len(parts)
    assert {part.body for part in parts} <= set(body_poses(chair, _loading(chair)))
    lugs = sum(len(lug_poses(chair, side, 0.0)) for side in ("left", "right"))
    # They are embedded in pages and sent over a network.
    assert sum(len(part.faces) for part in parts) + lugs * len(lug.faces) <= 12_000
    for part in (*parts, lug):
        assert part.vertices_m.dtype == np.float32
        assert part.faces.dtype == np.int32
        assert np.isfinite(part.vertices_m).all()
        _assert_closed_and_outward(part)


@every_chair
def test_belts_are_inside_the_collision_geometry_in_width_and_outline(chair: ChairDescription) -> None:
    tracks = chair.tracks
    low, high = 0.5 * (tracks.gauge_m - tracks.belt_width_m), 0.5 * (tracks.gauge_m + tracks.belt_width_m)
    turns = np.linspace(0.0, 2.0 * math.pi, 400)
    normals = np.stack([np.cos(turns), np.sin(turns)])
    # Three pulleys reach this far in each direction.
    reach = (pulley_centres(chair) @ normals).max(axis=0) + tracks.pulley_radius_m
    poses = body_poses(chair, _loading(chair))
    belts = [part for part in chair_parts(chair, _loading(chair)) if "belt" in part.name]
    assert belts
    for part in belts:
        p_B = part.vertices_m @ poses[part.body][:3, :3].T + poses[part.body][:3, 3]
        assert ((np.abs(p_B[:, 1]) >= low - ROUNDING_M) & (np.abs(p_B[:, 1]) <= high + ROUNDING_M)).all()
        assert (p_B[:, [0, 2]] @ normals < reach).all(), "lugs stand out of the belt"


@every_chair
@pytest.mark.parametrize("flipper_deg", [-60.0, 0.0, 40.0])
def test_lugs_follow_the_belt_at_equal_distances_and_advance_with_it(chair: ChairDescription, flipper_deg: float) -> None:
    angle = math.radians(flipper_deg)
    path = BeltPath(chair, angle)
    poses = lug_poses(chair, "left", 0.0, angle)
    spacing = path.length_m / len(poses)
    # Chord against arc on a pulley of five centimetres at a spacing of six: 6 % shorter; a corner of 60° shortens more.
    gaps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0, append=poses[:1, :3, 3]), axis=1)
    assert (gaps <= spacing + 1e-9).all()
    assert np.median(gaps) == pytest.approx(spacing, rel=0.01)
    np.testing.assert_allclose(lug_poses(chair, "left", spacing, angle), np.roll(poses, -1, axis=0), atol=1e-9)
    np.testing.assert_allclose(lug_poses(chair, "left", path.length_m, angle), poses, atol=1e-9)
    moved = lug_poses(chair, "left", 0.01, angle)[0, :3, 3] - poses[0, :3, 3]
    np.testing.assert_allclose(moved, [-0.01, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(poses[:, :3, :3]), 1.0)


@pytest.mark.parametrize("pitch_deg", [0.0, 20.0, 30.0])
def test_a_seat_at_the_chassis_pitch_is_level_and_its_bar_joins_pin_and_slider(pitch_deg: float) -> None:
    chair = read_chair("wheelchair")
    loading, pitch = Chair(seat_shift_m=0.05), math.radians(pitch_deg)
    poses = body_poses(chair, loading, pitch)
    np.testing.assert_allclose(rotation_y(-pitch) @ poses["seat"][:3, :3], np.eye(3), atol=1e-12)
    seat = chair.levelled_seat
    pin = poses["seat"] @ [seat.lever_arm_m, 0.0, 0.0, 1.0]
    np.testing.assert_allclose(poses["bar"] @ [seat.bar_m, 0.0, 0.0, 1.0], pin, atol=1e-12)
    np.testing.assert_allclose(poses["bar"][:3, 3], poses["slider"][:3, 3])
    np.testing.assert_allclose(poses["seat"][:3, 3], vehicle(chair, loading).seat.origin_m)


@pytest.mark.parametrize(
    "stair",
    [
        Stair(steps=6),
        Stair(steps=6, open_risers=True, walls="both"),
        Stair(steps=5, flights=2, turn="left"),
        Stair(steps=6, nosing_radius_m=0.002),
    ],
    ids=["plain", "open", "turn", "sharp"],
)
def test_stairs_are_closed_with_a_strip_at_each_nosing(stair: Stair) -> None:
    staircase = as_designed(stair)
    parts = {part.name: part for part in stair_parts(staircase)}
    for part in parts.values():
        assert part.body == "world"
        _assert_closed_and_outward(part)
    assert {"floor", "treads", "nosings"} <= set(parts)
    for nosing in staircase.nosings_W:
        # The strip stands 1.5 mm above the tread.
        assert np.abs(parts["nosings"].vertices_m[:, 2] - nosing[2]).min() < 0.002
