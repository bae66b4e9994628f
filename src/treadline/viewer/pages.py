"""Text of the panels as HTML: state, timeline, transitions, guard, events, camera. ``Tape, t -> str``."""

import base64
import math
from html import escape

from treadline.angles import DEG
from treadline.mechanics.tipping import MARGIN_LIMIT_RAD
from treadline.playback import PhaseSpan
from treadline.viewer.orders import Handset
from treadline.viewer.tape import Look, Tape

PHASE_COLOURS = {
    "search": "#bbbbbb", "align": "#56b4e9", "approach": "#0072b2", "mount": "#e69f00", "traction": "#999933", "climb": "#009e73",
    "crest": "#d55e00", "land": "#cc79a7", "edge": "#d55e00", "descend": "#009e73", "leave": "#cc79a7", "back_off": "#882255",
    "drive": "#009e73", "arrived": "#44aa99", "refused": "#882255",
}  # fmt: skip
"""Colour of each phase in the timeline."""
NARROW = 0.045
"""Share of the timeline below which a phase's name does not fit."""
EVENTS_SHOWN = 40
"""Events of the log that are shown, the newest first."""
OLD_S = 0.5
"""Age of a frame beyond which the panel says so [s]: five periods of the camera."""
IMAGE_STYLE = "width:calc(100% - 14px);max-height:250px;object-fit:contain;object-position:left;display:block"
STYLE = "font-size:12px;line-height:1.35;margin-right:14px"


def state_html(tape: Tape, t_s: float, *, live: bool, title: str) -> str:
    """Return time, phase with its reason, guard and margin at an instant."""
    phase, hold = tape.phase_at(t_s), tape.holding_at(t_s)
    what = "live" if live else (tape.verdict or "recorded")
    lines = [
        f'<div style="{STYLE}"><b style="font-size:15px">{t_s:.2f} s</b> of {tape.end_s:.1f} s · {escape(what)}'
        f'<br><span style="opacity:.7">{escape(title)}</span></div>'
    ]
    if phase is not None:
        colour = _colour_of(phase)
        lines.append(
            f'<div style="{STYLE};border-left:6px solid {colour};padding-left:6px;margin:4px 14px 4px 0">'
            f"<b>{escape(phase.name)}</b> since {phase.start_s:.2f} s<br>{escape(phase.cause)}</div>"
        )
    if hold is not None:
        lines.append(_card("#d55e00", f"HOLD since {hold.t_s:.2f} s", hold.cause))
    else:
        slow = next(
            (event for event in reversed(tape.events) if event.t_s <= t_s and event.name in ("slow", "resumed", "rearmed")), None
        )
        if slow is not None and slow.name == "slow":
            lines.append(_card("#e69f00", f"guard: slowed since {slow.t_s:.2f} s", slow.cause))
        else:
            lines.append(_card("#009e73", "guard: passes commands", "no limit reached"))
    if len(tape):
        lines.append(_margin_html(tape, t_s))
    return "".join(lines)


def _card(colour: str, head: str, text: str) -> str:
    return (
        f'<div style="{STYLE};background:{colour};color:#fff;border-radius:4px;padding:3px 7px;margin:4px 14px 4px 0">'
        f"<b>{escape(head)}</b><br>{escape(text)}</div>"
    )


def _margin_html(tape: Tape, t_s: float) -> str:
    now = tape.at(t_s)["margin_rad"]
    past = tape.column("margin_rad")[: tape.index(t_s) + 1]
    if math.isnan(now):
        return ""
    lowest = int(past.argmin())
    least_s, least = float(tape.column("t_s")[lowest]), float(past[lowest])
    colour = "#d55e00" if least < MARGIN_LIMIT_RAD else "inherit"
    return (
        f'<div style="{STYLE}">tip-over margin <b>{now / DEG:.1f}°</b> now; least so far '
        f'<b style="color:{colour}">{least / DEG:.1f}° at {least_s:.2f} s</b> (7° is required)</div>'
    )


def timeline_html(tape: Tape, t_s: float, fork_s: float | None = None) -> str:
    """Return the phases as a bar, with holds, the cursor, and the instant of a fork."""
    end_s = max(tape.end_s, 1e-3)
    bars = []
    for span in tape.phases:
        share = (span.end_s - span.start_s) / end_s
        name = escape(span.name) if share > NARROW else ""
        bars.append(
            f'<div title="{span.start_s:.2f} s {escape(span.name)}: {escape(span.cause)}" style="position:absolute;left:'
            f"{100.0 * span.start_s / end_s:.2f}%;width:{100.0 * share:.2f}%;height:22px;background:"
            f'{_colour_of(span)};color:#fff;font-size:11px;overflow:hidden;white-space:nowrap">&nbsp;{name}</div>'
        )
    marks = [
        _mark(event.t_s / end_s, "#d00000" if event.name == "hold" else "#00a000", f"{event.t_s:.2f} s {event.name}: {event.cause}")
        for event in tape.events
        if event.name in ("hold", "rearmed")
    ]
    if fork_s is not None:
        marks.append(_mark(fork_s / end_s, "#56b4e9", f"{fork_s:.2f} s: the fork begins"))
    cursor = _mark(min(t_s / end_s, 1.0), "#000", f"{t_s:.2f} s")
    inside = "".join([*bars, *marks, cursor])
    return f'<div style="position:relative;height:30px;margin:2px 14px 2px 0;border-radius:3px">{inside}</div>'


def _mark(share: float, colour: str, title: str) -> str:
    return (
        f'<div title="{escape(title)}" style="position:absolute;left:calc({100.0 * share:.2f}% - 1px);width:2px;height:30px;'
        f'background:{colour};outline:1px solid #fff8"></div>'
    )


def transitions_html(tape: Tape, t_s: float) -> str:
    """Return the table of transitions: time, phase, reason; the present phase is bold."""
    present = tape.phase_at(t_s)
    rows = [_row(span.start_s, span.name, span.cause, bold=span == present, colour=_colour_of(span)) for span in tape.phases]
    return _table(rows)


def _colour_of(span: PhaseSpan) -> str:
    return PHASE_COLOURS.get(span.name, "#888")


def events_html(tape: Tape, t_s: float) -> str:
    """Return the event log up to an instant, the newest first."""
    past = [event for event in tape.events if event.t_s <= t_s + 1e-6][-EVENTS_SHOWN:]
    colours = {"hold": "#d55e00", "slow": "#e69f00", "rearmed": "#009e73", "hull_contact": "#d55e00", "rejected": "#e69f00"}
    rows = [
        _row(event.t_s, event.name, event.cause, bold=event.name == "hold", colour=colours.get(event.name, "#888"))
        for event in past
    ]
    return _table(rows[::-1]) if rows else f'<div style="{STYLE}">no event yet</div>'


def _row(t_s: float, name: str, cause: str, *, bold: bool, colour: str) -> str:
    weight = "bold" if bold else "normal"
    return (
        f'<tr style="font-weight:{weight};vertical-align:top"><td style="text-align:right;white-space:nowrap;padding-right:6px">'
        f'{t_s:.2f} s</td><td style="border-left:4px solid {colour};padding:0 6px;white-space:nowrap">{escape(name)}</td>'
        f"<td>{escape(cause)}</td></tr>"
    )


def _table(rows: list[str]) -> str:
    return f'<table style="{STYLE};border-collapse:collapse;width:100%">{"".join(rows)}</table>'


def handset_html(state: Handset, tape: Tape, t_s: float) -> str:
    """Return the state of the handset and the distance travelled by the belts."""
    travelled_m = 0.0
    if len(tape):
        row = tape.at(t_s)
        travelled_m = 0.5 * (row["left_travel_m"] + row["right_travel_m"])
    asked = "the planner drives"
    if state.manual:
        switch = "held" if state.dead_man else "released"
        asked = f"dead-man switch <b>{switch}</b>; speed {state.speed_m_s:+.2f} m/s, turn {state.turn_m_s:+.2f} m/s"
    return f'<div style="{STYLE}">{asked}; belts travelled {travelled_m:.2f} m</div>'


def camera_html(look: Look | None, seen: list[int], missed: dict[int, str], t_s: float) -> str:
    """Return the camera image with its overlay, the detector's answer, and the nosings by number.

    Args:
        missed: Numbers of the missed nosings, each with the reason.
    """
    if look is None:
        return f'<div style="{STYLE}">no camera frame yet</div>'
    picture = ""
    if look.picture is not None:
        data = base64.b64encode(look.picture).decode("ascii")
        picture = f'<img alt="camera image with detected nosings" style="{IMAGE_STYLE}" src="data:image/jpeg;base64,{data}">'
    if not look.is_judged:
        return f'{picture}<div style="{STYLE}"><b>image of {look.t_s:.2f} s</b><br>{escape(look.summary)}</div>'
    head = f"frame of {look.t_s:.2f} s: " + ("accepted" if look.reason is None else f"rejected, {look.reason}")
    if t_s - look.taken_s > OLD_S:
        head = f"nothing for {t_s - look.t_s:.1f} s; last {head}"
    colour = "#d55e00" if look.reason is not None else "#009e73"
    found = f"nosings perceived: {_numbers(seen)}; " + (
        f'<b style="color:#d55e00">missed: {escape(_reasons(missed))}</b>' if missed else "none missed in view"
    )
    return f'{picture}<div style="{STYLE}"><b style="color:{colour}">{escape(head)}</b><br>{escape(look.summary)}<br>{found}</div>'


def _reasons(missed: dict[int, str]) -> str:
    """Return the numbers of missed nosings with their reasons; nosings with the same reason are named together."""
    together: dict[str, list[int]] = {}
    for index, reason in missed.items():
        together.setdefault(reason, []).append(index)
    return "; ".join(f"{_numbers(indices)} ({reason})" for reason, indices in together.items())


def _numbers(indices: list[int]) -> str:
    return ", ".join(str(index + 1) for index in indices) or "none"
