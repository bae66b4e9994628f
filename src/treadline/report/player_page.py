"""Player page: one HTML file that plays a recorded run, without a request and without a server.

Scene, plots and controls are the package's own scripts in ``templates``; meshes and signals are 16-bit numbers in base64. The
content security policy admits the page's one script, by its hash, and no request.
"""

import hashlib
import io
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from treadline.core.angles import DEG
from treadline.core.files import write_whole
from treadline.core.rotations import rotation_of
from treadline.playback import (
    Findings,
    FrameNosings,
    Hold,
    Moment,
    PerceivedStair,
    Recording,
    comparison_of,
    findings_of,
    in_runs,
    perceived_text,
    pixels_of,
    read_frames,
)
from treadline.report._player_data import plots_of, scene_of, uniform
from treadline.report.answers import moments_of
from treadline.report.html_pages import TEMPLATES, in_base64, json_in_page, packed, page_of
from treadline.report.labels import PHASES, TERMS
from treadline.report.plot_table import SIGNS
from treadline.vehicle.comfort import SETTLED_RAD
from treadline.vehicle.stair_solids import stair_boxes

IN_SCENE = ("perceived", "true", "missed", "estimate")
"""Signs in the page's scene."""
SCRIPTS = ("packed.js", "scene.js", "plots.js", "player.js")
IMAGE_PX, IMAGE_QUALITY, MOST_IMAGES = 240, 62, 120
"""Height, JPEG quality and largest number of embedded camera images: about 10 kB each, so 1.2 MB."""
TALL_M = 1.4
"""Height of a seated passenger's head above the ground [m], with room: the drawn passenger is 1.3 m tall."""
VERDICTS = {
    "arrived_rough": "arrived roughly",
    "held_rough": "held roughly",
    "end_of_flight": "reached the end of the flight",
    "time_up": "ran to its time limit",
}
"""Verdicts in words, where they differ from their names."""
TRANSIENT_SHARE = 0.5
"""Largest share of a run that counts as a transient."""


def write_player(recording: Recording, path: Path) -> Path:
    """Write the page that plays a recording.

    Raises:
        OSError: If the file cannot be written.
    """
    write_whole(path, player_page(recording))
    return path


def player_page(recording: Recording) -> str:
    """Return the page that plays a recording."""
    return page_of(
        "player.html.j2",
        {},
        name=Path(recording.source).name or "run",
        verdicts=VERDICTS,
        degree=DEG,
        player=embedded(player_data(recording), recording),
    )


def embedded(data: dict[str, Any], recording: Recording) -> dict[str, Any]:
    """Return what ``player_body.html.j2`` needs: script with its hash for the content security policy, style, and data."""
    script = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in SCRIPTS)
    digest = in_base64(hashlib.sha256(script.encode()).digest())
    return {
        "recording": recording,
        "signs": SIGNS,
        # The package's own files, base64, and JSON in which every "<" is escaped.
        "script": Markup(script),  # noqa: S704
        "script_hash": Markup(f"sha256-{digest}"),  # noqa: S704
        "css": Markup((TEMPLATES / "player.css").read_text(encoding="utf-8")),  # noqa: S704
        "legend": [(SIGNS[sign]["colour"], text) for sign in IN_SCENE for text in SIGNS[sign]["means"]],
        "data": Markup(json_in_page(data)),  # noqa: S704
    }


def player_data(recording: Recording) -> dict[str, Any]:
    """Return everything that the player's script reads."""
    played = uniform(recording)
    drawn = played.has_poses
    findings = findings_of(recording)
    comparison = comparison_of(recording) if drawn else None
    numbers = [] if comparison is None else comparison.numbers.tolist()
    frames = [None] * len(recording.maps) if findings.nosings is None else findings.nosings
    return {
        "plots": plots_of(played),
        "pose": _pose(played) if drawn else None,
        "heading": packed(np.column_stack([played.heading_rad, played.estimate_rad, played.sigma_rad])),
        "scene": scene_of(played) if drawn else None,
        "nosings": [] if comparison is None else comparison.ends_W.round(4).tolist(),
        "maps": [_map(seen, frame, recording, numbers) for seen, frame in zip(recording.maps, frames, strict=True)]
        if drawn
        else [],
        "images": _images(recording),
        "events": [
            {"t": moment.t_s, "name": moment.name, "cause": moment.cause, "kind": moment.kind, "end": moment.end_s}
            for moment in _listed(findings)
        ],
        "holds": [_hold(hold) for hold in findings.holds],
        "missed": [{"t": frame.t_s, "numbers": in_runs(frame.missed)} for frame in findings.nosings or () if frame.missed],
        "moments": moments_of(recording, findings),
        "terms": TERMS,
        "phase_terms": PHASES,
        "colours": {sign: SIGNS[sign]["colour"] for sign in IN_SCENE},
        "transient_s": transient_s(played),
        "reach_m": recording.chair.reach_m,
        "extent": _extent(played) if drawn else None,
    }


def _listed(findings: Findings) -> list[Moment]:
    """Return the moments with the full cause of each hold."""
    causes = {hold.start_s: hold.cause for hold in findings.holds}
    return [
        replace(moment, cause=causes.get(moment.t_s, moment.cause)) if moment.name == "hold" else moment
        for moment in findings.moments
    ]


def _hold(hold: Hold) -> dict[str, Any]:
    chain = [f"{moment.name} at {moment.t_s:.2f} s ({moment.cause})" for moment in hold.chain]
    return {
        "start": hold.start_s,
        "end": hold.end_s,
        "cause": hold.cause,
        "chain": " → ".join([*chain, f"hold at {hold.start_s:.2f} s"]) if chain else "",
    }


def transient_s(recording: Recording) -> float | None:
    """Return the time up to which the plots of a run first show [s], or None for the whole run.

    A run in one phase, such as a turn on a flight, may settle within a small part of its time: half as long again is shown.
    """
    heading = recording.heading_rad
    if len(recording.phases) > 1 or len(heading) < 2 or not np.isfinite(heading).all():
        return None
    off = np.abs(heading - np.median(heading[len(heading) // 2 :])) > SETTLED_RAD
    settled_s = float(recording.t_s[np.flatnonzero(off)[-1]]) if off.any() else 0.0
    shown_s = 1.5 * settled_s
    return round(shown_s, 2) if 0.0 < shown_s < TRANSIENT_SHARE * recording.duration_s else None


def _pose(recording: Recording) -> dict[str, Any]:
    quaternions = recording.quat_WB.copy()
    flips = np.concatenate([[1.0], np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))])
    quaternions *= np.cumprod(np.where(flips < 0.0, -1.0, 1.0))[:, None]  # the page interpolates between neighbours
    joints = np.column_stack([recording.seat_rad, recording.flipper_rad, recording.belt_travel_m])
    return {"p": packed(recording.p_WB), "q": packed(quaternions), "joints": packed(joints)}


def _map(seen: PerceivedStair, frame: FrameNosings | None, recording: Recording, numbers: list[int]) -> dict[str, Any]:
    """Return perceived nosings with their direction, and which true nosings in the image were missed.

    Args:
        numbers: Number of each nosing that the page draws.
    """
    k = recording.index_at(seen.t_s)
    heading = recording.estimate_rad[recording.index_at(seen.taken_s)]
    R_WB = rotation_of(recording.quat_WB[k])
    angle = heading if math.isfinite(heading) else 0.0
    across = R_WB @ np.array([math.sin(angle), math.cos(angle), 0.0])
    text = perceived_text(len(seen.nosings_W), None if frame is None else frame.found)
    missed: list[int] = []
    if frame is not None:
        missed = [numbers.index(number) for number in frame.missed]
        text += f" (the stair has {max(numbers)}); missed: {in_runs(frame.missed)}"
    return {
        "taken": seen.taken_s,
        "points": [[round(float(value), 3) for value in (*point, *across)] for point in seen.nosings_W],
        "missed": missed,
        "text": text + ("; the last one ends the flight" if seen.ends else ""),
    }


def _images(recording: Recording) -> list[dict[str, Any]]:
    """Return camera images as JPEG with the perceived nosings in image coordinates, evenly chosen; empty without images."""
    count = len(recording.frames_t_s)
    if not count:
        return []
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_IMAGES)).round().astype(int))
    frames = read_frames(recording, recording.frames_t_s[chosen].tolist())
    by_time = {round(seen.t_s, 6): seen for seen in recording.maps}
    return [
        {"t": frame.t_s, "jpeg": _jpeg_of(frame.rgb), "lines": _nosing_lines_in(recording, by_time.get(round(frame.t_s, 6)))}
        for frame in frames
    ]


def _jpeg_of(rgb: np.ndarray) -> str:
    """Return an image as base64 JPEG of at most ``IMAGE_PX`` rows."""
    picture = Image.fromarray(rgb)
    if picture.height > IMAGE_PX:
        picture = picture.resize((round(picture.width * IMAGE_PX / picture.height), IMAGE_PX))
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=IMAGE_QUALITY)
    return in_base64(buffer.getvalue())


def _nosing_lines_in(recording: Recording, seen: PerceivedStair | None) -> list[list[float]]:
    """Return each perceived nosing as a line in image coordinates from 0 to 1, 0.4 m to either side of the middle plane."""
    if seen is None:
        return []
    rear = (
        recording.scenario is not None and recording.scenario.drive.direction == "down" and recording.chair.rear_camera is not None
    )
    camera = recording.chair.camera_at(rear=rear)
    heading = recording.estimate_rad[recording.index_at(seen.t_s)]
    heading = heading if math.isfinite(heading) else 0.0
    across = 0.4 * np.array([math.sin(heading), math.cos(heading), 0.0])
    ends_B = np.stack([seen.nosings_B + across, seen.nosings_B - across], axis=1)
    u, v, z = pixels_of(camera, ends_B.reshape(-1, 3))
    lines = np.column_stack([(u + 0.5) / camera.width_px, (v + 0.5) / camera.height_px]).reshape(-1, 4)
    shares: list[list[float]] = lines[(z.reshape(-1, 2) > 0.1).all(axis=1)].round(4).tolist()
    return shares


def _extent(recording: Recording) -> dict[str, Any]:
    """Return the corners of a box about stair, driven path and passenger [m]."""
    points, staircase = recording.p_WB, recording.staircase
    low, high = points.min(axis=0) - np.array([recording.chair.reach_m, 0.4, 0.0]), points.max(axis=0)
    high = high + np.array([recording.chair.reach_m, 0.4, TALL_M])
    if staircase is not None:
        for box in stair_boxes(staircase):
            if box.kind in ("step", "landing"):
                half_m = np.abs(box.R_WK) @ np.array(box.half_m)
                low, high = np.minimum(low, box.centre_W - half_m), np.maximum(high, box.centre_W + half_m)
        low[2] = max(low[2], 0.0)
    return {"low": low.round(3).tolist(), "high": high.round(3).tolist()}
