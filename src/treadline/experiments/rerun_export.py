"""Run log as a Rerun recording: ``log.mcap -> run.rrd`` with chair, stair, plots, events, overlays and a layout.

Rerun's own converter (``rerun mcap convert``) reads the same log, but draws no markers; this module draws the meshes themselves.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from mcap.reader import make_reader

from treadline.angles import DEG, attitude_of, quaternion_of
from treadline.appearance import MeshPart, body_poses, chair_parts, lug_part, lug_poses, stair_parts
from treadline.appearance.palette import SEEN_NOSING, Colour
from treadline.errors import LogFormatError, SettingsError
from treadline.experiments.scene_log import SEEN_WIDTH_M, nosing_ends
from treadline.io.mcap_read import BROKEN, LIBRARY, mcap_messages, read_log
from treadline.io.ros_types import decoder_of
from treadline.io.runs import LOG
from treadline.mechanics.bodies import sides
from treadline.mechanics.chair import ChairDescription, read_chair
from treadline.mechanics.linkage import SeatLinkage
from treadline.mechanics.staircase import build_staircase
from treadline.ports import Truth
from treadline.scenario import Scenario
from treadline.signals import TICK_S, Event, FlipperReading, HeadingEstimate, HeadingMeasurement, StairMap

CLOCK = "time"
"""Name of the timeline: mission time."""
POSE_TICKS, LUG_TICKS = 5, 10
"""Ticks between two poses of the chair and between two poses of the lugs: 20 and 10 Hz."""
MISSING = "rerun is not installed; pip install '.[rerun]' in treadline's folder"
"""Error message without the extra."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LoggedRun:
    """Signals of a run's log and the scenario that they belong to."""

    scenario: Scenario
    seed: int
    truth: tuple[Truth, ...]
    others: tuple[Any, ...]

    def of(self, kind: type) -> list[Any]:
        """Return the signals of one kind."""
        return [signal for signal in self.others if isinstance(signal, kind)]


def log_of(source: Path) -> Path:
    """Return the log of a run folder, or the file itself."""
    return source / LOG if source.is_dir() else source


def read_run(path: Path) -> LoggedRun:
    """Return the run in a log with ground truth.

    Raises:
        LogFormatError: If the file is no run log, or lacks the poses or the scenario.
    """
    signals = list(read_log(path))
    try:
        with path.open("rb") as file:
            found = next((item.metadata for item in make_reader(file).iter_metadata() if item.name == LIBRARY), None)
    except BROKEN as error:
        raise LogFormatError(f"{path}: the index of the log is damaged: {error}") from None
    truth = tuple(signal for signal in signals if isinstance(signal, Truth))
    if found is None or not truth or np.isnan(truth[0].chassis_x_m):
        lacking = "the scenario" if found is None else "the pose of the chair"
        raise LogFormatError(f"{path}: the log lacks {lacking}: an older version or a recording; run the scenario again with climb")
    return LoggedRun(
        scenario=Scenario.model_validate(json.loads(found["scenario"])),
        seed=int(found["seed"]),
        truth=truth,
        others=tuple(signal for signal in signals if not isinstance(signal, Truth)),
    )


def write_rrd(source: Path, out: Path) -> int:
    """Write the Rerun recording of a run; return its number of poses.

    Args:
        source: Run folder or log.

    Raises:
        LogFormatError: If the log cannot be shown.
        SettingsError: If rerun is not installed.
    """
    try:
        import rerun as rr
    except ImportError:
        raise SettingsError(MISSING) from None
    path = log_of(source)
    run = read_run(path)
    chair = read_chair(run.scenario.chair.model)
    recording = rr.RecordingStream("treadline", recording_id=f"{source.stem}-{run.seed}", send_properties=False)
    recording.set_log_time_enabled(enabled=False)
    recording.set_log_tick_enabled(enabled=False)
    recording.save(out, default_blueprint=_blueprint())
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    _log_parts(recording, run, chair)
    _log_plots(recording, run)
    for event in run.of(Event):
        recording.set_time(CLOCK, duration=event.t_s)
        recording.log("events", rr.TextLog(f"{event.name}: {event.cause}", level="WARN" if event.name == "hold" else "INFO"))
    _log_nosings(recording, run)
    for t_s, data in _overlays(path):
        recording.set_time(CLOCK, duration=t_s)
        recording.log("camera/overlay", rr.EncodedImage(contents=data, media_type="image/jpeg"))
    recording.flush()
    recording.disconnect()
    return len(run.truth[::POSE_TICKS])


def _log_parts(recording: Any, run: LoggedRun, chair: ChairDescription) -> None:
    """Log the meshes, and the poses of chair, seat, flipper, linkage and lugs."""
    import rerun as rr

    scenario, loading = run.scenario, run.scenario.chair
    staircase = build_staircase(scenario.stair, np.random.default_rng(run.seed).spawn(1)[0], scenario.step)
    for part in stair_parts(staircase):
        recording.log(f"world/stair/{part.name}", _mesh(part), static=True)
    for part in chair_parts(chair, loading, scenario.belts):
        below = "" if part.body == "chair" else f"{part.body}/"
        recording.log(f"world/chair/{below}{part.name}", _mesh(part), static=True)
    shown = run.truth[::POSE_TICKS]
    times = np.array([truth.t_s for truth in shown])
    places = np.array([(truth.chassis_x_m, truth.chassis_y_m, truth.chassis_z_m) for truth in shown])
    turns = attitude_of(*np.array([(truth.yaw_rad, truth.pitch_rad, truth.roll_rad) for truth in shown]).T)
    _log_poses(recording, "world/chair", times, places, turns)
    seat = np.array([truth.pitch_rad - truth.seat_pitch_rad for truth in shown])
    if chair.seat is not None:
        seat = np.clip(seat, *SeatLinkage(chair.seat).angle_range)
    flipper = _flipper_angles(run, chair, times)
    poses = [body_poses(chair, loading, float(a), float(b)) for a, b in zip(seat, flipper, strict=True)]
    for body in poses[0]:
        if body != "chair":
            X = np.array([pose[body] for pose in poses])
            _log_poses(recording, f"world/chair/{body}", times, X[:, :3, 3], np.array([quaternion_of(R) for R in X[:, :3, :3]]))
    travel = np.cumsum([(truth.left_m_s, truth.right_m_s) for truth in run.truth], axis=0) * TICK_S
    every = LUG_TICKS // POSE_TICKS
    for number, (side, _) in enumerate(sides(chair.tracks)):
        recording.log(f"world/chair/lugs_{side}", _mesh(lug_part(chair, scenario.belts)), static=True)
        for k in range(0, len(times), every):
            X = lug_poses(chair, side, float(travel[k * POSE_TICKS, number]), float(flipper[k]), scenario.belts)
            recording.set_time(CLOCK, duration=float(times[k]))
            turned = [_xyzw(quaternion_of(R)) for R in X[:, :3, :3]]
            recording.log(f"world/chair/lugs_{side}", rr.InstancePoses3D(translations=X[:, :3, 3], quaternions=turned))


def _log_poses(recording: Any, entity: str, times: Float[np.ndarray, " n"], places: Any, quaternions: Any) -> None:
    import rerun as rr

    columns = rr.Transform3D.columns(translation=places, quaternion=[_xyzw(q) for q in quaternions])
    recording.send_columns(entity, indexes=[rr.TimeColumn(CLOCK, duration=times)], columns=columns)


def _log_plots(recording: Any, run: LoggedRun) -> None:
    """Log the time series, angles in degrees."""
    truth = run.truth
    times = [item.t_s for item in truth]
    series: dict[str, tuple[list[float], list[float]]] = {
        "heading/true": (times, [item.heading_rad / DEG for item in truth]),
        "heading/estimated": _pairs(run.of(HeadingEstimate)),
        "heading/measured": _pairs(run.of(HeadingMeasurement)),
        "pitch/chassis": (times, [item.pitch_rad / DEG for item in truth]),
        "pitch/seat": (times, [item.seat_pitch_rad / DEG for item in truth]),
        "belts/left": (times, [item.left_m_s for item in truth]),
        "belts/right": (times, [item.right_m_s for item in truth]),
        "margin/tip_over": (times, [item.stability_margin_rad / DEG for item in truth]),
    }
    import rerun as rr

    for name, (at, values) in series.items():
        if at:
            index = rr.TimeColumn(CLOCK, duration=np.array(at))
            recording.send_columns(f"plots/{name}", indexes=[index], columns=rr.Scalars.columns(scalars=values))


def _pairs(signals: Sequence[Any]) -> tuple[list[float], list[float]]:
    return [signal.t_s for signal in signals], [signal.heading_rad / DEG for signal in signals]


def _log_nosings(recording: Any, run: LoggedRun) -> None:
    """Log the detected nosings as lines on the chair."""
    import rerun as rr

    headings = {item.t_s: item.heading_rad for item in run.of(HeadingMeasurement)}
    for stair in run.of(StairMap):
        ends = nosing_ends(stair, headings.get(stair.t_s, 0.0))
        recording.set_time(CLOCK, duration=stair.t_s)
        strips = rr.LineStrips3D(ends, radii=0.5 * SEEN_WIDTH_M, colors=_bytes(SEEN_NOSING, 1.0))
        recording.log("world/chair/seen_nosings", strips)


def _flipper_angles(run: LoggedRun, chair: ChairDescription, times: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return the flipper's angle at each time; its rest angle on a chair without a flipper."""
    readings = run.of(FlipperReading)
    if not readings:
        return np.full(len(times), chair.tracks.approach_angle_deg * DEG)
    return np.interp(times, [reading.t_s for reading in readings], [reading.angle_rad for reading in readings])


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


def _blueprint() -> Any:
    """Return the layout: scene and overlay on the left, plots and events on the right."""
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
    scene = rrb.Vertical(
        rrb.Spatial3DView(origin="world", name="scene"), rrb.Spatial2DView(origin="camera", name="camera"), row_shares=[3, 1]
    )
    side = rrb.Vertical(*plots, rrb.TextLogView(origin="events", name="events"))
    return rrb.Blueprint(rrb.Horizontal(scene, side, column_shares=[3, 2]), collapse_panels=True)
