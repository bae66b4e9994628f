"""Player page: one HTML file that plays a recorded run, without a request and without a server.

Scene, plots and controls are the package's own scripts in ``templates``; meshes and signals are 16-bit numbers in base64. The
content security policy admits the page's one script, by its hash, and no request.
"""

import base64
import hashlib
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from treadline.angles import DEG
from treadline.mechanics.bodies import solids
from treadline.models import write_whole
from treadline.playback import PerceivedStair, Recording, read_frames
from treadline.report.packed import packed
from treadline.report.plot_data import plots_of, uniform
from treadline.report.scene import scene_of

TEMPLATES = Path(__file__).parent / "templates"
SCRIPTS = ("packed.js", "scene.js", "plots.js", "player.js")
IMAGE_PX, IMAGE_QUALITY, MOST_IMAGES = 240, 62, 120
"""Height, JPEG quality and largest number of embedded camera images: about 10 kB each, so 1.2 MB."""
MATCHED_M = 0.12
"""Largest distance between a perceived nosing and the true nosing that it stands for [m]: less than half the run of a stair."""
SETTLED_RAD = 2.0 * DEG
"""Largest deviation from the final heading of a settled run [rad], as in the settling time of the scores."""
TRANSIENT_SHARE = 0.5
"""Largest share of a run that counts as a transient."""


def write_player(recording: Recording, path: Path) -> Path:
    """Write the page that plays a recording.

    Raises:
        OSError: If the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, player_page(recording))
    return path


def player_page(recording: Recording) -> str:
    """Return the page that plays a recording."""
    return (
        environment()
        .get_template("player.html.j2")
        .render(
            title=title_of(recording),
            summary=_summary(recording),
            missing=recording.missing,
            player=embedded(player_data(recording), recording),
        )
    )


def environment() -> Environment:
    """Return the template engine of the report's pages, which escapes every value."""
    return Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )


def embedded(data: dict[str, Any], recording: Recording) -> dict[str, str]:
    """Return what ``player_body.html.j2`` needs: script with its hash for the content security policy, style, and data."""
    script = "\n".join((TEMPLATES / name).read_text(encoding="utf-8") for name in SCRIPTS)
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return {
        # The package's own files, base64, and JSON in which every "<" is escaped.
        "script": Markup(script),  # noqa: S704
        "script_hash": Markup(f"sha256-{digest}"),  # noqa: S704
        "css": Markup((TEMPLATES / "player.css").read_text(encoding="utf-8")),  # noqa: S704
        "data": Markup(json_in_page(data)),  # noqa: S704
        "scene_text": _scene_text(recording),
    }


def json_in_page(value: Any) -> str:
    """Return JSON that cannot end the script element around it: text in a log may hold anything."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def player_data(recording: Recording) -> dict[str, Any]:
    """Return everything that the player's script reads."""
    played = uniform(recording)
    lines = _nosing_lines(recording)
    drawn = played.has_poses
    return {
        "plots": plots_of(played),
        "pose": _pose(played) if drawn else None,
        "heading": packed(np.column_stack([played.heading_rad, played.estimate_rad, played.sigma_rad])),
        "scene": scene_of(played) if drawn else None,
        "nosings": [[[round(x, 4) for x in end] for end in line] for line in lines],
        "maps": [_map(seen, recording, lines) for seen in recording.maps] if drawn else [],
        "images": _images(recording),
        "events": [{"t": event.t_s, "name": event.name, "cause": event.cause} for event in recording.events],
        "moments": moments_of(recording),
        "transient_s": transient_s(played),
        "reach_m": recording.chair.reach_m,
        "extent": _extent(played) if drawn else None,
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


def title_of(recording: Recording) -> str:
    """Return the page's title: name, verdict and duration."""
    name = Path(recording.source).name or "run"
    verdict = {"end_of_flight": "reached the end of the flight", "time_up": "ran to its time limit"}.get(
        recording.verdict or "", recording.verdict or "recorded"
    )
    cause = f": {recording.cause}" if recording.cause else ""
    return f"{name} {verdict} after {recording.duration_s:.1f} s{cause}"


def _summary(recording: Recording) -> str:
    scenario = recording.scenario
    if scenario is None:
        return f"Chair {recording.chair.name}."
    stair = scenario.stair
    return (
        f"Simulated, seed {recording.seed}: chair {recording.chair.name} with {scenario.chair.payload_kg:g} kg, "
        f"{'up' if scenario.drive.direction == 'up' else 'down'} a stair of {stair.slope_rad / DEG:.0f}° with {stair.steps} steps, "
        f"friction {stair.friction[0]:g} along and {stair.friction[1]:g} across the belts. No claim to any safety standard is made."
    )


def _scene_text(recording: Recording) -> str:
    phases = ", ".join(span.name for span in recording.phases)
    return f"Scene of chair and stair over {recording.duration_s:.0f} s" + (f"; phases: {phases}" if phases else "")


def moments_of(recording: Recording) -> list[dict[str, Any]]:
    """Return the times that answer the usual questions: least margin, fastest pitch, largest heading error, holds."""
    found: list[dict[str, Any]] = []

    def extreme(values: Float[np.ndarray, " T"], words: str, unit: str, *, least: bool = False, digits: int = 1) -> None:
        if np.isfinite(values).any():
            k = int(np.nanargmin(values) if least else np.nanargmax(np.abs(values)))
            value = f"{values[k]:.{digits}f}".replace("-", "−")
            label = f"{words} {value}{unit} at {recording.t_s[k]:.1f} s"
            found.append({"label": label, "t": float(recording.t_s[k])})

    extreme(recording.margin_rad / DEG, "least tip-over margin", "°", least=True)
    extreme(recording.pitch_rate_rad_s / DEG, "fastest pitch", "°/s")
    extreme((recording.estimate_rad - recording.heading_rad) / DEG, "largest heading error of the estimate", "°")
    extreme(100.0 * recording.friction_use, "highest friction use", " %", digits=0)
    found += [
        {"label": f"{event.name} at {event.t_s:.1f} s", "t": event.t_s}
        for event in recording.events
        if event.name in ("hold", "crest", "refused", "rearmed")
    ]
    return found


def _pose(recording: Recording) -> dict[str, Any]:
    quaternions = recording.quat_WB.copy()
    flips = np.concatenate([[1.0], np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))])
    quaternions *= np.cumprod(np.where(flips < 0.0, -1.0, 1.0))[:, None]  # the page interpolates between neighbours
    joints = np.column_stack([recording.seat_rad, recording.flipper_rad, recording.belt_travel_m])
    return {"p": packed(recording.p_WB), "q": packed(quaternions), "joints": packed(joints)}


def _nosing_lines(recording: Recording) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Return the ends of each true nosing in W, the lowest first; empty if the stair is unknown."""
    staircase = recording.staircase
    if staircase is None:
        return []
    found = [solid.nosing for solid in solids(staircase) if solid.nosing is not None]
    ends = [(tuple(nosing.right_W), tuple(nosing.left_W)) for nosing in found]
    return sorted(ends, key=lambda line: line[0][2] + line[1][2])


def _map(seen: PerceivedStair, recording: Recording, lines: list[tuple[tuple[float, ...], tuple[float, ...]]]) -> dict[str, Any]:
    """Return perceived nosings with their direction, and which true nosings between the first and the last were missed."""
    k = recording.index_at(seen.t_s)
    heading = recording.estimate_rad[recording.index_at(seen.taken_s)]
    w, x, y, z = recording.quat_WB[k]
    c, s = math.cos(heading), math.sin(heading)
    forward = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    left = np.array([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)])
    across = s * forward + c * left if math.isfinite(heading) else left
    matched = sorted({index for point in seen.nosings_W if (index := _nearest(point, lines)) is not None})
    missed = [index for index in range(matched[0], matched[-1]) if index not in matched] if matched else []
    number = f"perceives {len(seen.nosings_W)} nosing{'' if len(seen.nosings_W) == 1 else 's'}"
    if matched:
        number += f": {_runs([index + 1 for index in matched])} of {len(lines)}"
    text = number + (f"; missed: {_runs([index + 1 for index in missed])}" if missed else "")
    return {
        "taken": seen.taken_s,
        "points": [[round(float(value), 3) for value in (*point, *across)] for point in seen.nosings_W],
        "missed": missed,
        "text": text + ("; the last one ends the flight" if seen.ends else ""),
    }


def _nearest(point: Float[np.ndarray, " 3"], lines: list[tuple[tuple[float, ...], tuple[float, ...]]]) -> int | None:
    """Return the index of the nosing within ``MATCHED_M`` of a point, or None."""
    if not lines or not np.isfinite(point).all():
        return None
    ends = np.array(lines)
    along = ends[:, 1] - ends[:, 0]
    share = np.clip(np.einsum("ij,ij->i", point - ends[:, 0], along) / np.einsum("ij,ij->i", along, along), 0.0, 1.0)
    distance = np.linalg.norm(point - ends[:, 0] - share[:, None] * along, axis=1)
    k = int(np.argmin(distance))
    return k if distance[k] < MATCHED_M else None


def _runs(numbers: list[int]) -> str:
    """Return sorted numbers with consecutive ones as ranges: 3–5, 7."""
    parts: list[list[int]] = []
    for number in numbers:
        if parts and number == parts[-1][-1] + 1:
            parts[-1].append(number)
        else:
            parts.append([number])
    return ", ".join(str(part[0]) if len(part) == 1 else f"{part[0]}–{part[-1]}" for part in parts)


def _images(recording: Recording) -> list[dict[str, Any]]:
    """Return camera images as JPEG with the perceived nosings in image coordinates, evenly chosen; empty without images."""
    count = len(recording.frames_t_s)
    if not count:
        return []
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_IMAGES)).round().astype(int))
    frames = read_frames(recording, recording.frames_t_s[chosen].tolist())
    by_time = {round(seen.t_s, 6): seen for seen in recording.maps}
    return [
        {"t": frame.t_s, "jpeg": jpeg_of(frame.rgb), "lines": nosing_lines_in(recording, by_time.get(round(frame.t_s, 6)))}
        for frame in frames
    ]


def jpeg_of(rgb: np.ndarray) -> str:
    """Return an image as base64 JPEG of at most ``IMAGE_PX`` rows."""
    picture = Image.fromarray(rgb)
    if picture.height > IMAGE_PX:
        picture = picture.resize((round(picture.width * IMAGE_PX / picture.height), IMAGE_PX))
    buffer = io.BytesIO()
    picture.save(buffer, "JPEG", quality=IMAGE_QUALITY)
    return base64.b64encode(buffer.getvalue()).decode()


def nosing_lines_in(recording: Recording, seen: PerceivedStair | None) -> list[list[float]]:
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
    found = []
    for nosing in seen.nosings_B:
        ends = [camera.R_BC.T @ (nosing + side * across - np.array(camera.mount_m)) for side in (1.0, -1.0)]
        if all(end[2] > 0.1 for end in ends):
            pixels = [(camera.cx_px + camera.fx_px * e[0] / e[2], camera.cy_px + camera.fy_px * e[1] / e[2]) for e in ends]
            found.append([round(v, 4) for x, y in pixels for v in ((x + 0.5) / camera.width_px, (y + 0.5) / camera.height_px)])
    return found


def _extent(recording: Recording) -> dict[str, Any]:
    """Return the middle of the driven way and the distance from which a view of 36° shows all of it."""
    low, high = recording.p_WB.min(axis=0), recording.p_WB.max(axis=0)
    middle = 0.5 * (low + high) + np.array([0.0, 0.0, 0.4])
    return {"middle": middle.round(3).tolist(), "distance": round(float(np.linalg.norm(high - low)) * 1.25 + 3.0, 3)}
