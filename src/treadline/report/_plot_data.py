"""Time series of a recording for the plots of pages, as JSON values."""

from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.signals import TICK_S
from treadline.playback import Recording
from treadline.report._html import packed
from treadline.vehicle.comfort import COMFORT_TICKS, passenger_acceleration

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
    t_s, limits = recording.t_s, recording.limits
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

    def curve(name: str, label: str, colour: str, **more: Any) -> dict[str, Any]:
        return {"label": label, "colour": f"--{colour}", "series": name, **more}

    def limit(
        value: float | None, unit: str, scale: float = 1.0, *, both: bool = False, always: bool = False
    ) -> list[dict[str, Any]]:
        if value is None:
            return []
        sign = "±" if both else ""
        found = [{"value": value / scale, "label": f"limit {sign}{value / scale:g} {unit}", "always": always}]
        return found + ([{"value": -value / scale, "label": "", "always": always}] if both else [])

    drawn: list[dict[str, Any]] = [
        {
            "title": "heading",
            "unit": "°",
            "curves": [
                curve("heading", "true", "green"),
                curve("estimate", "estimate ± 2 σ", "blue", sigma="interval"),
            ],
            "limits": limit(limits.heading_rad, "° over crest and edge", DEG, both=True),
        },
        {
            "title": "pitch rate",
            "unit": "°/s",
            "curves": [curve("rate", "", "blue")],
            "limits": limit(limits.pitch_rate_rad_s, "°/s", DEG, both=True),
        },
        {
            "title": "belt speed",
            "unit": "m/s",
            "digits": 3,
            "zero": True,
            "curves": [
                curve("left_command", "left asked", "grey", dash=[2, 3]),
                curve("right_command", "right asked", "purple", dash=[2, 3]),
                curve("left", "left", "blue"),
                curve("right", "right", "red"),
            ],
            "limits": limit(limits.belt_m_s, "m/s", both=True),
        },
        {
            "title": "seat and chassis pitch",
            "unit": "°",
            "curves": [curve("seat", "seat", "green"), curve("pitch", "chassis", "grey")],
        },
        {
            "title": "tip-over margin",
            "unit": "°",
            "zero": True,
            "curves": [curve("margin", "", "purple")],
            "limits": limit(limits.margin_rad, "°", DEG, always=True),
        },
        {"title": "acceleration of the passenger, mean over 50 ms", "unit": "m/s²", "curves": [curve("passenger", "", "red")]},
        {"title": "lateral position, left positive", "unit": "m", "digits": 3, "curves": [curve("lateral", "", "green")]},
    ]
    panels = [
        {"limits": [], **panel, "curves": [item for item in panel["curves"] if item["series"] in known]}
        for panel in drawn
        if any(item["series"] in known for item in panel["curves"])
    ]
    for panel in panels:
        for item in panel["curves"]:
            if item.get("sigma") not in known:
                item.pop("sigma", None)
    used = {name for panel in panels for item in panel["curves"] for name in (item["series"], item.get("sigma")) if name}
    return {
        "time": {"start": float(t_s[0]), "step": step_s, "count": len(t_s)},
        "series": {name: packed(series[name]) for name in sorted(used)},
        "panels": panels,
        "bands": [{"start": span.start_s, "end": span.end_s, "name": span.name, "cause": span.cause} for span in recording.phases],
    }
