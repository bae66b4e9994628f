"""Page of one run: it plays the run, and shows its course phase by phase, its scores and its settings."""

import json
import shlex
import warnings
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from markupsafe import Markup

from treadline.core.arrays import check_magnitude
from treadline.core.errors import SettingsError
from treadline.core.files import write_whole
from treadline.io.runs import read_series, read_walk
from treadline.playback import Recording, read_recording
from treadline.report._results import Manifest, RunResult, read_part
from treadline.report.html_pages import page_of
from treadline.report.labels import score_groups
from treadline.report.player_page import embedded, player_data
from treadline.report.run_figure import single_run
from treadline.report.side_view import SideViews
from treadline.report.svg_figures import svg_of
from treadline.report.walk_figure import walk_figure
from treadline.vehicle.ground_profile import ground_profile
from treadline.vehicle.rest_poses import rest_chair

FLAGS = {"--json", "--quick", "--log-images", "--debug"}
"""Options that no value follows."""
IMAGE_WITHIN_S = 0.5
"""Largest time between a phase's start and the camera image shown for it [s]."""
COLUMNS = (
    *("t_s", "heading_deg", "estimate_deg", "pitch_deg", "seat_pitch_deg", "stability_margin_deg"),
    *("left_m_s", "right_m_s", "x_m", "y_m", "friction_use"),
)
"""Columns of series.csv that the figures draw."""
MEASURED = ("t_s", "estimate_deg")
"""Those of a real chair, whose ground truth nobody knows."""


def write_run_page(folder: Path) -> Recording:
    """Write the page of a run; return its recording.

    Raises:
        SettingsError: If a file of the run lacks or mistypes something.
        LogFormatError: If its log is missing or damaged.
    """
    result = read_part(folder / "result.json", RunResult)
    manifest = read_part(folder / "manifest.json", Manifest)
    if result.seed is not None and result.seed != manifest.seed:
        raise SettingsError(f"{folder}: result.json is of seed {result.seed}, manifest.json of {manifest.seed}; make the run again")
    columns = MEASURED if "robot" in manifest.settings else COLUMNS
    series, recording = checked_series(folder, columns), read_recording(folder)
    data = player_data(recording)
    phases = [(span.start_s, span.name) for span in recording.phases]
    svg = svg_of(single_run(series, phases, recording, seat_alone=result.seat is not None))
    drawings = {"run": svg}
    walked = read_walk(folder)
    if walked is not None and recording.staircase is not None:
        chair, ground = rest_chair(recording.chair, 0.0), ground_profile(recording.staircase)
        driven = None if recording.is_reckoned else recording.columns
        drawings["check"] = svg_of(walk_figure(ground, chair, walked, driven))
    write_page(
        folder,
        "run.html.j2",
        drawings,
        player=embedded(data, recording),
        strip=film_strip(recording, data["images"]) if recording.has_poses else None,
        result=result,
        manifest=manifest,
        headline=headline(result, manifest, folder.name),
        groups=score_groups(result.figures, None if result.seat is None else result.seat.model_dump()),
        banded=len(phases) > 1,
        settings=json.dumps(manifest.settings, indent=1),
    )
    return recording


def write_page(
    folder: Path, template: str, drawings: Mapping[str, str], panels: Mapping[str, Sequence[str]] | None = None, **values: Any
) -> Path:
    """Write ``report.html`` and each drawing as a file of its own.

    Args:
        drawings: SVG by name.
        panels: The panels of each drawing for the page; None: the drawings themselves.
    """
    page = page_of(template, {name: [text] for name, text in drawings.items()} if panels is None else panels, **values)
    for name, text in drawings.items():
        write_whole(folder / "figures" / f"{name}.svg", '<?xml version="1.0" encoding="utf-8"?>\n' + text)
    path = folder / "report.html"
    write_whole(path, page)
    return path


def checked_series(folder: Path, columns: Sequence[str] = COLUMNS) -> dict[str, Float[np.ndarray, " T"]]:
    """Return the columns of a run's series.csv; those that a real chair cannot know are NaN.

    Args:
        columns: Columns that the table must have.

    Raises:
        SettingsError: If it is missing, is not a table, or lacks a column.
    """
    path = folder / "series.csv"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # numpy warns of a table without rows
            series = read_series(folder)
    except OSError as error:
        raise SettingsError(f"{path}: {error.strerror}; make the run again") from None
    except (ValueError, IndexError, UserWarning) as error:
        said = " ".join(str(error).split())[:80]
        raise SettingsError(f"{path}: not a table of numbers ({said}); make the run again") from None
    missing = [name for name in columns if name not in series]
    if missing:
        raise SettingsError(f"{path}: no column '{missing[0]}'; make the run again")
    absent = np.full(len(series["t_s"]), np.nan)
    series = {**dict.fromkeys(COLUMNS, absent), **series}
    for name, values in series.items():
        check_magnitude(f"{path}: column '{name}'", values[np.isfinite(values)], "make the run again")
    if not np.isfinite(series["t_s"]).all():
        raise SettingsError(f"{path}: a time in t_s is not a number; make the run again")
    return series


# ---- heading: what one run was, and how it ended ----


def headline(result: RunResult, manifest: Manifest, name: str) -> str:
    """Return the heading of a run's page, as in ``climb up-28: arrived after 48.8 s``.

    Args:
        name: Name of the run folder, which identifies a run of a reproduction.
    """
    verb, subject = _asked(manifest.command)
    if verb == "reproduce":
        subject = name
    cause = f" ({result.cause})" if result.cause else ""
    return f"{' '.join(word for word in (verb, subject) if word) or 'One run'}: {_ending(verb, result)}{cause}"


def _asked(command: str) -> tuple[str, str]:
    """Return verb and subject of a command line, empty where it names none."""
    try:
        words = shlex.split(command)
    except ValueError:
        return "", ""
    if words[:1] != ["treadline"] or len(words) < 2:
        return "", ""
    valued = {word for word in words if word.startswith("--") and "=" not in word} - FLAGS
    plain = [word for before, word in pairwise(words[1:]) if not word.startswith("-") and before not in valued]
    return words[1], plain[0] if plain else ""


def _ending(verb: str, result: RunResult) -> str:
    if result.seat is not None:
        settle = result.seat.settle_s
        return "the seat did not settle" if settle is None else f"level within 1° after {settle:.2f} s"
    duration = result.figures.get("duration_s")
    if result.verdict == "time_up":
        whole = "played to its end" if verb == "replay" else "driven to the end of its time"
        return whole if duration is None else f"{whole}, {duration:.1f} s"
    ended = "the simulation diverged" if result.verdict == "diverged" else result.verdict.replace("_rough", " roughly")
    return ended if duration is None or result.verdict == "refused" else f"{ended} after {duration:.1f} s"


# ---- film strip: side view, camera image and cause at the start of each phase ----


def film_strip(recording: Recording, images: list[dict[str, Any]]) -> dict[str, Any]:
    """Return definitions and frames of the strip.

    Args:
        images: Camera images of the player's data.
    """
    views = SideViews(recording)
    frames = [
        {
            "side": Markup(views.view(t_s, f"Side view at {t_s:.1f} s: {name}")),  # noqa: S704 - drawn here, its texts escaped
            "shot": _shot(images, t_s),
            "t_s": t_s,
            "name": name,
            "cause": f": {cause}" if cause else "",
        }
        for t_s, name, cause in _stops(recording)
    ]
    return {"definitions": Markup(views.definitions), "frames": frames}  # noqa: S704 - the same


def _shot(images: list[dict[str, Any]], t_s: float) -> dict[str, Any] | None:
    """Return the camera image nearest to a time, or None without one near it."""
    near = [image for image in images if abs(image["t"] - t_s) < IMAGE_WITHIN_S]
    return min(near, key=lambda image: abs(image["t"] - t_s), default=None)


def _stops(recording: Recording) -> list[tuple[float, str, str]]:
    """Return time, name and cause of each frame: the phases and the end; five, evenly spaced, without phases."""
    phases = [(span.start_s, span.name, span.cause) for span in recording.phases]
    end = (recording.duration_s, recording.verdict or "end", recording.cause or "")
    if len(phases) > 1:
        return phases if phases[-1][0] > recording.duration_s - IMAGE_WITHIN_S else [*phases, end]
    step_s = recording.duration_s / 4
    name = phases[0][1] if phases else "drive"
    return [(k * step_s, name, "") for k in range(4)] + [end]
