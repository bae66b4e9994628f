"""Film strip of a run: side view, camera image and cause at the start of each phase."""

from typing import Any

from markupsafe import Markup

from treadline.playback import Recording
from treadline.report.side_view import SideViews

IMAGE_WITHIN_S = 0.5
"""Largest time between a phase's start and the camera image shown for it [s]."""
EVENLY = 5
"""Number of views of a run in a single phase, evenly spaced."""


def film_strip(recording: Recording, images: list[dict[str, Any]]) -> dict[str, Any]:
    """Return definitions and frames of the strip.

    Args:
        images: Camera images of the player's data.
    """
    views = SideViews(recording)
    return {
        "definitions": Markup(views.definitions),  # noqa: S704 - drawn by this package, its texts escaped
        "frames": [
            {
                "side": Markup(views.view(t_s, f"Side view at {t_s:.1f} s: {name}")),  # noqa: S704 - the same
                "shot": min(
                    (image for image in images if abs(image["t"] - t_s) < IMAGE_WITHIN_S),
                    key=lambda i: abs(i["t"] - t_s),
                    default=None,
                ),
                "t_s": t_s,
                "name": name,
                "cause": f": {cause}" if cause else "",
            }
            for t_s, name, cause in _stops(recording)
        ],
    }


def _stops(recording: Recording) -> list[tuple[float, str, str]]:
    """Return time, name and cause of each frame: the phases and the end; evenly spaced without phases."""
    phases = [(span.start_s, span.name, span.cause) for span in recording.phases]
    end = (recording.duration_s, recording.verdict or "end", recording.cause or "")
    if len(phases) > 1:
        return phases if phases[-1][0] > recording.duration_s - IMAGE_WITHIN_S else [*phases, end]
    step_s = recording.duration_s / (EVENLY - 1)
    name = phases[0][1] if phases else "drive"
    return [(k * step_s, name, "") for k in range(EVENLY - 1)] + [end]
