"""Time series of a recording for the plots of pages, as JSON values."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S
from treadline.playback import Limits, Recording
from treadline.report._html import packed
from treadline.vehicle.comfort import COMFORT_TICKS, passenger_acceleration

PANELS = Path(__file__).parents[1] / "data" / "player_panels.toml"
MOST_SAMPLES = 40_000
"""Most samples of a page, 400 s at 100 Hz: 80 kB per curve. Longer runs are decimated."""


def uniform(recording: Recording) -> Recording:
    """Return the recording on equal time steps, decimated to at most ``MOST_SAMPLES``."""
    every = -(-len(recording.t_s) // MOST_SAMPLES)
    kept = recording.decimated(every) if every > 1 else recording
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
    series: dict[str, Float[np.ndarray, " T"]] = {
        "heading": recording.heading_rad / DEG,
        "estimate": recording.estimate_rad / DEG,
        "interval": 2.0 * recording.sigma_rad / DEG,
        "rate": recording.pitch_rate_rad_s / DEG,
        "left": recording.belt_m_s[:, 0],
        "right": recording.belt_m_s[:, 1],
        "left_command": recording.command_m_s[:, 0],
        "right_command": recording.command_m_s[:, 1],
        "pitch": recording.pitch_rad / DEG,
        "seat": recording.seat_pitch_rad / DEG,
        "margin": recording.margin_rad / DEG,
        "passenger": passenger_m_s2(recording),
        "lateral": recording.place_S[:, 1],
    }
    known = {name for name, values in series.items() if np.isfinite(values).any()}
    panels = []
    for entry in tomllib.loads(PANELS.read_text(encoding="utf-8"))["panel"]:
        limited = _limits(recording.limits, **entry.pop("limit")) if "limit" in entry else []
        curves = [curve for curve in entry["curves"] if curve["series"] in known]
        for curve in curves:
            if curve.get("sigma") not in known:
                curve.pop("sigma", None)
        if curves:
            panels.append({"limits": limited, **entry, "curves": curves})
    used = {name for panel in panels for curve in panel["curves"] for name in (curve["series"], curve.get("sigma")) if name}
    return {
        "time": {"start": float(t_s[0]), "step": step_s, "count": len(t_s)},
        "series": {name: packed(series[name]) for name in sorted(used)},
        "panels": panels,
        "bands": [{"start": span.start_s, "end": span.end_s, "name": span.name, "cause": span.cause} for span in recording.phases],
    }


def _limits(
    limits: Limits, name: str, unit: str, *, deg: bool = False, both: bool = False, always: bool = False
) -> list[dict[str, Any]]:
    """Return the lines of a limit; none where the run does not state it."""
    value = getattr(limits, name)
    if value is None:
        return []
    shown = value / DEG if deg else value
    found = [{"value": shown, "label": f"limit {'±' if both else ''}{shown:g} {unit}", "always": always}]
    return found + ([{"value": -shown, "label": "", "always": always}] if both else [])
