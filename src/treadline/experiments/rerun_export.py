"""Run log as a Rerun recording: ``log.mcap -> run.rrd`` with chair, stair, plots, events, overlays and a layout.

Rerun's own converter (``rerun mcap convert``) reads the same log, but draws no markers; this module draws the meshes themselves.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG, quaternion_of
from treadline.core.errors import SettingsError
from treadline.io.mcap_read import mcap_messages
from treadline.io.ros_types import decoder_of
from treadline.io.runs import LOG
from treadline.playback import Recording, read_recording
from treadline.run.scene_log import SEEN_WIDTH_M, nosing_ends
from treadline.scenario.scenario import Chair
from treadline.vehicle.appearance import Colour, MeshPart, body_poses, chair_parts, colour, lug_part, lug_poses, stair_parts
from treadline.vehicle.bodies import sides

CLOCK = "time"
"""Name of the timeline: mission time."""
POSE_SAMPLES, LUG_POSES = 5, 2
"""Samples of 100 Hz per pose of the chair, and poses of the chair per pose of the lugs: 20 and 10 Hz."""
MISSING = "rerun is not installed; pip install '.[rerun]' in treadline's folder"
"""Error message without the extra."""


def write_rrd(source: Path, out: Path) -> int:
    """Write the Rerun recording of a run; return its number of poses.

    Args:
        source: Run folder or log.

    Raises:
        LogFormatError: If the log is missing or damaged.
        SettingsError: If rerun is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise SettingsError(MISSING) from None
    run = read_recording(source)
    stream = rr.RecordingStream("treadline", recording_id=f"{source.stem}-{run.seed}", send_properties=False)
    stream.set_log_time_enabled(enabled=False)
    stream.set_log_tick_enabled(enabled=False)
    log = source / LOG if source.is_dir() else source
    stream.save(out, default_blueprint=_blueprint(has_images=next(_overlays(log), None) is not None))
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    shown = run.decimated(POSE_SAMPLES)
    if run.has_poses:
        _log_scene(stream, shown)
    _log_plots(stream, run)
    for event in run.events:
        stream.set_time(CLOCK, duration=event.t_s)
        stream.log("events", rr.TextLog(f"{event.name}: {event.cause}", level="WARN" if event.name == "hold" else "INFO"))
    for t_s, data in _overlays(log):
        stream.set_time(CLOCK, duration=t_s)
        stream.log("camera/overlay", rr.EncodedImage(contents=data, media_type="image/jpeg"))
    stream.flush()
    stream.disconnect()
    return len(shown.t_s) if run.has_poses else 0


def _log_scene(stream: Any, run: Recording) -> None:
    """Log meshes, poses of chair, seat, flipper, linkage and lugs, and detected nosings."""
    import rerun as rr

    loading, belts = (Chair(), None) if run.scenario is None else (run.scenario.chair, run.scenario.belts)
    staircase = run.staircase
    for part in () if staircase is None else stair_parts(staircase):
        stream.log(f"world/stair/{part.name}", _mesh(part), static=True)
    for part in chair_parts(run.chair, loading, belts):
        below = "" if part.body == "chair" else f"{part.body}/"
        stream.log(f"world/chair/{below}{part.name}", _mesh(part), static=True)
    _log_poses(stream, "world/chair", run.t_s, run.p_WB, run.quat_WB)
    poses = [body_poses(run.chair, loading, float(a), float(b)) for a, b in zip(run.seat_rad, run.flipper_rad, strict=True)]
    for body in poses[0]:
        if body != "chair":
            X = np.array([pose[body] for pose in poses])
            _log_poses(stream, f"world/chair/{body}", run.t_s, X[:, :3, 3], np.array([quaternion_of(R) for R in X[:, :3, :3]]))
    for number, (side, _) in enumerate(sides(run.chair.tracks)):
        stream.log(f"world/chair/lugs_{side}", _mesh(lug_part(run.chair, belts)), static=True)
        for k in range(0, len(run.t_s), LUG_POSES):
            X = lug_poses(run.chair, side, float(run.belt_travel_m[k, number]), float(run.flipper_rad[k]), belts)
            stream.set_time(CLOCK, duration=float(run.t_s[k]))
            turned = [_xyzw(quaternion_of(R)) for R in X[:, :3, :3]]
            stream.log(f"world/chair/lugs_{side}", rr.InstancePoses3D(translations=X[:, :3, 3], quaternions=turned))
    for seen in run.maps:
        heading = float(run.estimate_rad[run.index_at(seen.t_s)])
        ends = nosing_ends(seen.nosings_B, 0.0 if np.isnan(heading) else heading)
        stream.set_time(CLOCK, duration=seen.t_s)
        strips = rr.LineStrips3D(ends, radii=0.5 * SEEN_WIDTH_M, colors=_bytes(colour("seen_nosing"), 1.0))
        stream.log("world/chair/seen_nosings", strips)


def _log_poses(stream: Any, entity: str, times: Float[np.ndarray, " n"], places: Any, quaternions: Any) -> None:
    import rerun as rr

    columns = rr.Transform3D.columns(translation=places, quaternion=[_xyzw(q) for q in quaternions])
    stream.send_columns(entity, indexes=[rr.TimeColumn(CLOCK, duration=times)], columns=columns)


def _log_plots(stream: Any, run: Recording) -> None:
    """Log the time series, angles in degrees."""
    import rerun as rr

    series = {
        "heading/true": run.heading_rad / DEG,
        "heading/estimated": run.estimate_rad / DEG,
        "pitch/chassis": run.pitch_rad / DEG,
        "pitch/seat": run.seat_pitch_rad / DEG,
        "belts/left": run.belt_m_s[:, 0],
        "belts/right": run.belt_m_s[:, 1],
        "margin/tip_over": run.margin_rad / DEG,
    }
    for name, values in series.items():
        known = np.isfinite(values)
        if known.any():
            index = rr.TimeColumn(CLOCK, duration=run.t_s[known])
            stream.send_columns(f"plots/{name}", indexes=[index], columns=rr.Scalars.columns(scalars=values[known]))


def _overlays(path: Path) -> Iterator[tuple[float, bytes]]:
    """Yield time and JPEG file of each overlay in a log."""
    decode = None
    for topic, _, data in mcap_messages(path, "/camera/overlay/compressed".__eq__, sealed=True):
        decode = decoder_of(topic) if decode is None else decode
        message = decode(data)
        stamp = message.header.stamp
        yield stamp.sec + 1e-9 * stamp.nanosec, bytes(message.data)


def _mesh(part: MeshPart) -> Any:
    """Return a part as a mesh with flat faces: every triangle has vertices of its own."""
    import rerun as rr

    corners = part.vertices_m[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=corners.reshape(-1, 3),
        triangle_indices=np.arange(3 * len(corners)).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0),
        albedo_factor=_bytes(part.colour, part.opacity),
    )


def _bytes(colour: Colour, opacity: float) -> list[int]:
    return [round(255.0 * value) for value in (*colour, opacity)]


def _xyzw(quaternion: Float[np.ndarray, " 4"]) -> list[float]:
    w, x, y, z = quaternion.tolist()
    return [x, y, z, w]


def _blueprint(*, has_images: bool) -> Any:
    """Return the layout: scene and, if there are images, overlay on the left, plots and events on the right."""
    import rerun.blueprint as rrb

    plots = [
        rrb.TimeSeriesView(origin=f"plots/{name}", name=title)
        for name, title in (
            ("heading", "heading [°]"),
            ("pitch", "pitch [°]"),
            ("belts", "belt speeds [m/s]"),
            ("margin", "tip-over margin [°]"),
        )
    ]
    scene = rrb.Spatial3DView(origin="world", name="scene")
    left = rrb.Vertical(scene, rrb.Spatial2DView(origin="camera", name="camera"), row_shares=[3, 1]) if has_images else scene
    side = rrb.Vertical(*plots, rrb.TextLogView(origin="events", name="events"))
    return rrb.Blueprint(rrb.Horizontal(left, side, column_shares=[3, 2]), collapse_panels=True)
