"""Panels of the page as HTML: state, timeline, answers, phases, events, camera, handset, fork. ``Session -> str``.

The markup stands in ``panels.html.j2``, a macro for each panel.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from treadline.core.rotations import rotation_of
from treadline.guard import SILENCE_S
from treadline.playback import Recording, holding_at, in_runs, perceived_text
from treadline.report.html_pages import in_base64
from treadline.report.labels import PHASES, TERMS
from treadline.report.plot_table import SIGNS, Plot, phase_colour
from treadline.view._messages import ShownFrame
from treadline.view._plots import ALONG, view_of, way_lines
from treadline.view._session import Session

EVENTS_SHOWN = 40
"""Events of the log that are shown, the newest first."""
GREEN, ORANGE, RED = (str(SIGNS[state]["colour"]) for state in ("good", "near", "bad"))
"""Colours of cards and marks."""
STYLE = "font-size:12px;line-height:1.35;margin-right:14px"


def text_on(colour: str) -> str:
    """Return black or white, whichever has the larger contrast on a colour: at least 4.58 on any."""
    channels = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)  # WCAG 2.2
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return "#000" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#fff"


_ENGINE = Environment(loader=PackageLoader("treadline", "view"), autoescape=True, undefined=StrictUndefined)
_ENGINE.globals |= {"GREEN": GREEN, "ORANGE": ORANGE, "RED": RED, "SIGNS": SIGNS, "TERMS": TERMS, "PHASE_TERMS": PHASES}
_ENGINE.globals |= {"phase_colour": phase_colour, "text_on": text_on, "style": STYLE}
HTML: Any = _ENGINE.get_template("panels.html.j2").module
"""Macros of the template."""


def state_html(session: Session) -> str:
    """Return time, phase with its reason, guard and margin at the cursor."""
    run, t_s = session.run, session.cursor_s
    guard = [event for event in run.events if event.t_s <= t_s and event.name in ("slow", "resumed", "rearmed")]
    slowed = guard[-1] if guard and guard[-1].name == "slow" else None
    return str(HTML.state(session, run.phase_at(t_s), holding_at(run.events, t_s), slowed))


def events_html(session: Session) -> str:
    """Return events, faults, camera silence and other moments up to the cursor, the newest first."""
    found = [(event.t_s, event.name, event.cause) for event in session.run.events]
    found += [(moment.t_s, moment.name, moment.cause) for moment in session.moments.listed if moment.kind != "event"]
    past = sorted(entry for entry in found if entry[0] <= session.cursor_s + 1e-6)
    return str(HTML.events(past[-EVENTS_SHOWN:][::-1]))


def camera_html(session: Session) -> str:
    """Return the camera image with its overlay, the detector's answer, and the nosings by number.

    The last frame before a silence is dimmed, below a sentence about a silent camera or a stair that is not perceived.
    """
    frame, warning = session.feed.frame_at(session.cursor_s), camera_warning(session)
    jpeg = None if frame is None or frame.picture is None else in_base64(frame.picture)
    perceived, missed = "", None
    if frame is not None and frame.is_judged and warning is None:
        found, lacking = _nosings_of(session, frame)
        known = session.feed.knows_stair
        perceived = perceived_text(len(frame.nosings_B), found if known else None)
        missed = _reasons(lacking) if known else None
    return str(HTML.camera(frame, warning, jpeg, perceived, missed))


def _nosings_of(session: Session, frame: ShownFrame) -> tuple[Sequence[int], dict[int, str]]:
    """Return the numbers of the nosings that were perceived in a frame, and of the missed ones, each with the reason."""
    if session.feed.is_empty or not session.feed.knows_stair:
        return (), {}
    run, nosings = session.run, session.feed.nosings
    k = run.index_at(frame.t_s)
    pose = rotation_of(run.quat_WB[k]), run.p_WB[k]
    found, missed = nosings.compare(frame.nosings_B, *pose)
    if frame.reason is not None:
        return found, dict.fromkeys(missed, "the frame is rejected")
    if frame.depth_m is None:
        return found, dict.fromkeys(missed, "its image is not kept")
    return found, {number: nosings.why_missed(number, frame.depth_m, *pose) for number in missed}


def camera_warning(session: Session) -> str | None:
    """Return a sentence about a silent camera or a stair that is not perceived at the cursor; None while frames arrive."""
    t_s, frame = session.cursor_s, session.feed.frame_at(session.cursor_s)
    spans = [span for span in session.moments.listed if span.kind == "perception" and span.t_s < t_s <= (span.end_s or span.t_s)]
    silent = next((span for span in spans if span.name == "no camera frame"), None)
    since_s = silent.t_s if silent is not None else 0.0 if frame is None else frame.taken_s
    if session.feed.fresh_frame_at(t_s) is not None or t_s - since_s <= SILENCE_S:
        return None
    if silent is None and spans:
        return f"no stair perceived for {t_s - spans[0].t_s:.1f} s; {spans[0].cause}"
    return f"no frame for {t_s - since_s:.1f} s, since {since_s:.2f} s: the camera is silent"


def _reasons(missed: Mapping[int, str]) -> str:
    """Return the numbers of missed nosings with their reasons; nosings with the same reason are named together."""
    together: dict[str, list[int]] = {}
    for index, reason in missed.items():
        together.setdefault(reason, []).append(index)
    return "; ".join(f"{in_runs(indices)} ({reason})" for reason, indices in together.items())


def legend_html(plot: Plot, run: Recording, cursor_s: float, *, forked: bool) -> str:
    """Return the title of a plot, its lines in their colours with their values at the cursor, and its limits."""
    values = [curve.values(run)[run.index_at(cursor_s)] for curve in plot.curves]
    low, high = view_of(plot, run)
    is_shown = any(low <= limit <= high for limit in plot.limits(run.limits))
    return str(HTML.plot(plot, values, plot.limit_text(run.limits), is_shown, forked and not plot.no_fork))


def way_html(session: Session) -> str:
    """Return the way over the place with the chair on it, a plot for each quantity; empty without a walk or a known place."""
    way, run = session.feed.way, session.run
    if way is None or session.feed.is_empty or not session.feed.knows_stair:
        return ""
    low_m = float(way[1]["x_m"].min())
    high_m = max(float(way[1]["x_m"].max()), low_m + 1e-3)
    rows = []
    for name, lines in way_lines(way, run, session.cursor_s).items():
        values = np.concatenate([line[:, 1] for line in lines])
        low, high = float(values.min()), float(values.max())
        # Of an image of 1000 × 1000, from above.
        shown = [1000.0 * (line - (low_m, high)) / (high_m - low_m, min(low - high, -1e-3)) for line in lines]
        texts = [" ".join(f"{x:.0f},{y:.0f}" for x, y in line.tolist()) for line in shown]
        rows.append((ALONG[name], low, high, *texts, float(lines[1][-1, 1]) if len(lines[1]) else None))
    here_m = float(run.p_WB[run.index_at(session.cursor_s), 0])
    return str(HTML.way(rows, 1000.0 * (here_m - low_m) / (high_m - low_m), low_m, high_m, here_m))


PANELS: Mapping[str, Callable[[Session], str]] = {
    "state": state_html,
    "camera": camera_html,
    "answers": HTML.answers,
    "events": events_html,
    "handset": HTML.handset,
    "contacts": HTML.contacts,
    "outcome": HTML.outcome,
}
"""Panels by name."""
