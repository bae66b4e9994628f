"""Run log as a Rerun recording: ``log.mcap -> run.rrd`` with chair, stair, plots, events, overlays and a layout.

Rerun's own converter (``rerun mcap convert``) reads the same log, but draws no markers. The scene is that of the log: its frames
become transforms, its markers meshes and lines.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError
from treadline.io.mcap_read import mcap_messages
from treadline.io.message_files import decoder_of
from treadline.io.runs import LOG
from treadline.io.scene_messages import LINE_LIST
from treadline.playback import Recording, read_recording

CLOCK = "time"
"""Name of the timeline: mission time."""
FRAMES = ("/tf_static", "/tf")
MARKERS = ("/chair", "/stair/true", "/stair/seen")
OVERLAY = "/camera/overlay/compressed"
PLOTS = {
    "heading": "heading [°]",
    "pitch": "pitch [°]",
    "belts": "belt speeds [m/s]",
    "margin": "tip-over margin [°]",
}
"""Title of each plot."""
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
    has_images = next(_messages(log, OVERLAY), None) is not None
    stream.save(out, default_blueprint=_blueprint(has_images=has_images))
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    poses = _log_scene(stream, log)
    _log_plots(stream, run)
    for event in run.events:
        stream.set_time(CLOCK, duration=event.t_s)
        stream.log("events", rr.TextLog(f"{event.name}: {event.cause}", level="WARN" if event.name == "hold" else "INFO"))
    for _, message in _messages(log, OVERLAY):
        stream.set_time(CLOCK, duration=_seconds(message.header.stamp))
        stream.log("camera/overlay", rr.EncodedImage(contents=bytes(message.data), media_type="image/jpeg"))
    stream.flush()
    stream.disconnect()
    return poses


def _messages(log: Path, *topics: str) -> Iterator[tuple[str, Any]]:
    """Yield topic and decoded message of each message of some topics."""
    decoders: dict[str, Any] = {}
    for topic, _, data in mcap_messages(log, topics.__contains__, sealed=True):
        if topic.name not in decoders:
            decoders[topic.name] = decoder_of(topic)
        yield topic.name, decoders[topic.name](data)


def _log_scene(stream: Any, log: Path) -> int:
    """Log frames and markers of the scene; return the number of poses of the chair."""
    import rerun as rr

    frames = [(topic, frame) for topic, message in _messages(log, *FRAMES) for frame in message.transforms]
    parents = {frame.child_frame_id: frame.header.frame_id for _, frame in frames}

    def entity(frame: str) -> str:
        return f"{entity(parents[frame])}/{frame}" if frame in parents else "world"

    for topic, frame in frames:
        p, q = frame.transform.translation, frame.transform.rotation
        pose = rr.Transform3D(translation=[p.x, p.y, p.z], quaternion=[q.x, q.y, q.z, q.w])
        stream.set_time(CLOCK, duration=_seconds(frame.header.stamp))
        stream.log(entity(frame.child_frame_id), pose, static=topic == "/tf_static")
    for topic, message in _messages(log, *MARKERS):
        for marker in message.markers:
            stream.set_time(CLOCK, duration=_seconds(marker.header.stamp))
            stream.log(f"{entity(marker.header.frame_id)}/{marker.ns}", _shape(marker), static=topic != "/stair/seen")
    return sum(frame.child_frame_id == "base_link" for _, frame in frames)


def _shape(marker: Any) -> Any:
    """Return a marker as line strips, or as a mesh with flat faces: every triangle has vertices of its own."""
    import rerun as rr

    points = np.array([(point.x, point.y, point.z) for point in marker.points])
    colour = [round(255.0 * getattr(marker.color, name)) for name in "rgba"]
    if marker.type == LINE_LIST:
        return rr.LineStrips3D(points.reshape(-1, 2, 3), radii=0.5 * marker.scale.x, colors=colour)
    corners = points.reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=points,
        triangle_indices=np.arange(len(points)).reshape(-1, 3),
        vertex_normals=np.repeat(normals, 3, axis=0),
        albedo_factor=colour,
    )


def _log_plots(stream: Any, run: Recording) -> None:
    """Log the time series, angles in degrees."""
    import rerun as rr

    series: dict[str, Float[np.ndarray, " n"]] = {
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


def _seconds(stamp: Any) -> float:
    return float(stamp.sec + 1e-9 * stamp.nanosec)


def _blueprint(*, has_images: bool) -> Any:
    """Return the layout: scene and, if there are images, overlay on the left, plots and events on the right."""
    import rerun.blueprint as rrb

    plots = [rrb.TimeSeriesView(origin=f"plots/{name}", name=title) for name, title in PLOTS.items()]
    scene = rrb.Spatial3DView(origin="world", name="scene")
    left = rrb.Vertical(scene, rrb.Spatial2DView(origin="camera", name="camera"), row_shares=[3, 1]) if has_images else scene
    side = rrb.Vertical(*plots, rrb.TextLogView(origin="events", name="events"))
    return rrb.Blueprint(rrb.Horizontal(left, side, column_shares=[3, 2]), collapse_panels=True)
