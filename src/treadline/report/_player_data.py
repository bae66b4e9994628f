"""What the player page draws, as JSON values: time series for the plots, and the scene of a recording.

The scene holds meshes, poses of the moving bodies, and lugs along their belt. Bodies that move with the seat or the flipper are
tabulated over the angles that occur; the page interpolates.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S
from treadline.playback import Recording
from treadline.report.html_pages import packed, packed_indices
from treadline.report.plot_table import PLOTS, Plot, phase_colour
from treadline.scenario.scenario import Belts, Chair
from treadline.vehicle.appearance import BeltPath, MeshPart, body_poses, chair_parts, lug_part, lug_poses, stair_parts
from treadline.vehicle.bodies import flipper_turns
from treadline.vehicle.comfort import COMFORT_TICKS, passenger_acceleration

MOST_SAMPLES = 40_000
"""Most samples of a page, 400 s at 100 Hz: 80 kB per curve. Longer runs are decimated."""


def uniform(recording: Recording) -> Recording:
    """Return the recording on equal time steps, decimated to at most ``MOST_SAMPLES``."""
    every = -(-len(recording.t_s) // MOST_SAMPLES)
    index = np.arange(0, len(recording.t_s), every or 1)
    kept = recording.sampled(index, recording.t_s[index])
    steps = np.diff(kept.t_s)
    step_s = float(np.median(steps)) if len(steps) else TICK_S
    if not len(steps) or np.abs(steps - step_s).max() < 0.5 * step_s:
        return kept
    count = min(round((kept.t_s[-1] - kept.t_s[0]) / step_s) + 1, MOST_SAMPLES)
    grid = np.linspace(kept.t_s[0], kept.t_s[-1], count)
    return kept.sampled(np.clip(np.searchsorted(kept.t_s, grid + 1e-9, side="right") - 1, 0, None), grid)


def passenger_m_s2(recording: Recording) -> Float[np.ndarray, " T"]:
    """Return the magnitude of the passenger's acceleration [m/s²], mean over 50 ms; NaN without ground truth at 100 Hz."""
    t_s, missing = recording.t_s, 1 + COMFORT_TICKS
    found = np.full(len(t_s), np.nan)
    steps = np.diff(t_s)
    if len(t_s) < 2 * COMFORT_TICKS or not np.isfinite(recording.passenger_W).all() or steps.max() > 1.5 * TICK_S:
        return found
    # The magnitude does not depend on the yaw, about which the components are turned.
    acceleration = passenger_acceleration(recording.passenger_W.T, np.zeros(len(t_s)), steps)
    found[missing:] = np.linalg.norm(acceleration, axis=0)
    return found


def plots_of(recording: Recording) -> dict[str, Any]:
    """Return time base, series, panels and phase bands; the recording has equal time steps (``uniform``)."""
    t_s = recording.t_s
    step_s = float((t_s[-1] - t_s[0]) / max(len(t_s) - 1, 1)) or TICK_S
    passenger, series, panels = passenger_m_s2(recording), {}, []
    for plot in filter(lambda plot: plot.curves, (plot.known(recording, passenger=passenger) for plot in PLOTS)):
        curves = []
        for curve in plot.curves:
            name = f"{plot.title}, {curve.label}"
            series[name] = packed(curve.values(recording, passenger=passenger))
            shown = {"label": curve.label, "colour": f"--sign-{curve.colour}", "series": name, "dash": curve.dash}
            if curve.sigma and np.isfinite(sigma := replace(curve, series=curve.sigma).values(recording)).any():
                shown["sigma"] = f"{name}, band"
                series[f"{name}, band"] = packed(2.0 * sigma)
            curves.append(shown)
        panels.append(
            {
                **{name: getattr(plot, name) for name in ("title", "unit", "digits", "least_span")},
                "zero": plot.limit is not None and plot.limit.zero,
                "curves": curves,
                "limits": _limits(plot, recording),
            }
        )
    return {
        "time": {"start": float(t_s[0]), "step": step_s, "count": len(t_s)},
        "series": series,
        "panels": panels,
        "bands": [
            {
                "start": span.start_s,
                "end": span.end_s,
                "name": span.name,
                "cause": span.cause,
                "colour": phase_colour(span.name),
            }
            for span in recording.phases
        ],
    }


def _limits(plot: Plot, recording: Recording) -> list[dict[str, Any]]:
    """Return the lines of a limit with the spans in which it applies [s]; none where the run does not state it."""
    if plot.limit is None:
        return []
    first, last = float(recording.t_s[0]), recording.duration_s
    spans = [(max(start, first), min(end, last)) for start, end in plot.limit.spans(recording)]
    labels = (plot.limit_text(recording.limits), *[""] * 2)
    return [
        {"value": value, "label": label, "always": plot.limit.always, "spans": spans}
        for value, label in zip(plot.limits(recording.limits), labels, strict=False)
    ]


CREASE_RAD = 35.0 * DEG
"""Angle between two faces above which their edge is drawn: the facets of the meshes' round parts differ by at most 30°."""
TABLE_STEP_RAD = 2.0 * DEG
"""Step of the tables over seat and flipper angle: over 2° the chord of a 0.5 m lever deviates by 0.08 mm from its arc."""
PATH_POINTS = 160
"""Points of the tabulated belt path: one per 3 cm of a belt, or 15° of a pulley."""


def scene_of(recording: Recording) -> dict[str, Any]:
    """Return meshes and tables of a recording's chair and stair."""
    chair, scenario = recording.chair, recording.scenario
    loading, belts = (Chair(), None) if scenario is None else (scenario.chair, scenario.belts)
    staircase = recording.staircase
    parts = [*chair_parts(chair, loading, belts), *(() if staircase is None else stair_parts(staircase))]
    seat, flipper = _angles(recording.seat_rad), _angles(recording.flipper_rad)
    return {
        "parts": [_mesh(part) for part in parts],
        "lug": _mesh(lug_part(chair, belts)),
        "bodies": {
            "seat": _table(seat, [body_poses(chair, loading, float(angle)) for angle in seat], ("seat", "bar", "slider")),
            "flipper": _table(
                flipper, [body_poses(chair, loading, 0.0, float(angle)) for angle in flipper], tuple(flipper_turns(chair))
            ),
        },
        "belt": _belt(recording, belts, flipper),
    }


def _angles(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " n"]:
    """Return angles from the smallest to the largest value, at most ``TABLE_STEP_RAD`` apart."""
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    return np.linspace(low, high, 2 + math.floor((high - low) / TABLE_STEP_RAD))


def _table(angles: Float[np.ndarray, " n"], poses: list[Any], names: tuple[str, ...]) -> dict[str, Any]:
    """Return x, y, z and the rotation about y of each body over an angle; every body of a chair turns about y alone."""
    found = {}
    for name in names:
        if name not in poses[0]:
            continue
        X = np.array([pose[name] for pose in poses])
        turn = np.unwrap(np.arctan2(X[:, 0, 2], X[:, 0, 0]))
        found[name] = packed(np.column_stack([X[:, :3, 3], turn]))
    return {"low": float(angles[0]), "high": float(angles[-1]), "poses": found}


def _belt(recording: Recording, belts: Belts | None, flipper: Float[np.ndarray, " n"]) -> dict[str, Any]:
    """Return the belt's path at each flipper angle, at equal shares of its length, and the lugs' number and lateral positions."""
    chair = recording.chair
    share = np.linspace(0.0, 1.0, PATH_POINTS, endpoint=False)
    rows, lengths = [], []
    for angle in flipper:
        path = BeltPath(chair, float(angle))
        points, heading = path.at(share * path.length_m)
        rows.append(np.column_stack([points, np.cos(heading), np.sin(heading)]))
        lengths.append(path.length_m)
    poses = {side: lug_poses(chair, side, 0.0, None, belts) for side in ("left", "right")}
    return {
        "path": packed(np.concatenate(rows)),
        "points": PATH_POINTS,
        "lengths_m": lengths,
        "count": len(poses["left"]),
        "y_m": [float(poses[side][0, 1, 3]) for side in ("left", "right")],
    }


def _mesh(part: MeshPart) -> dict[str, Any]:
    return {
        "name": part.name,
        "body": part.body,
        "colour": [round(value, 3) for value in part.colour],
        "opacity": part.opacity,
        "vertices": packed(part.vertices_m),
        "faces": packed_indices(part.faces),
        "edges": packed_indices(creases(part.vertices_m, part.faces)),
    }


def creases(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Return the edges at which two faces meet at an angle above ``CREASE_RAD``, or that belong to one face only."""
    corners = vertices[faces].astype(float)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort(pairs.T)
    pairs, owner = pairs[order], owner[order]
    same = (pairs[1:] == pairs[:-1]).all(axis=1)
    first = np.flatnonzero(np.concatenate([[True], ~same]))
    count = np.diff(np.append(first, len(pairs)))
    twice = first[count == 2]
    angle = np.einsum("ij,ij->i", normal[owner[twice]], normal[owner[twice + 1]])
    sharp = twice[angle < math.cos(CREASE_RAD)]
    return pairs[np.concatenate([first[count != 2], sharp])]
