"""Text of the panels as HTML: state, timeline, transitions, guard, events, camera. ``Tape, t -> str``."""

import base64
import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.playback import PhaseSpan
from treadline.playback.findings import SILENT_S, Moment
from treadline.report.labels import PHASES as PHASE_TERMS
from treadline.report.labels import TERMS
from treadline.vehicle.tip_over_margin import MARGIN_LIMIT_RAD
from treadline.view.colours import BAD, CONTACT, GHOST, GOOD, MISSED, RISER, SEEN, SWEPT, TREAD, TRUE, WARN
from treadline.view.orders import Handset
from treadline.view.tape import Look, Tape

PHASE_COLOURS = {
    "search": "#bbbbbb", "align": "#56b4e9", "approach": "#0072b2", "mount": "#e69f00", "traction": "#999933", "climb": "#009e73",
    "crest": "#d55e00", "land": "#cc79a7", "edge": "#d55e00", "descend": "#009e73", "leave": "#cc79a7", "back_off": "#882255",
    "drive": "#009e73", "arrived": "#44aa99", "refused": "#882255",
}  # fmt: skip
"""Colour of each phase in the timeline."""
TIMELINE_PX = 360.0
"""Width of the timeline [px]: that of the panel without its margins."""
LETTER_PX, SIDES_PX = 6.6, 8.0
"""Width of a letter of the timeline, the widest of its phases' names on average, and of both margins [px]."""
EVENTS_SHOWN = 40
"""Events of the log that are shown, the newest first."""
GREEN, ORANGE, RED = "#009e73", "#e69f00", "#d55e00"
"""Colours of cards and marks (Okabe and Ito, 2008)."""
GOOD_TEXT, BAD_TEXT = "#006b4e", "#a84300"
"""Colours of text on white: green and red, darkened to a contrast above 4.5."""
IMAGE_STYLE = "width:calc(100% - 14px);max-height:250px;object-fit:contain;object-position:left;display:block"
STYLE = "font-size:12px;line-height:1.35;margin-right:14px"
TWO_LINES = "height:2.7em;overflow:hidden;display:-webkit-box;-webkit-line-clamp:2;-webkit-box-orient:vertical"
"""Style of a text that always takes two lines, so that nothing below it moves."""


def state_html(tape: Tape, t_s: float, *, live: bool, title: str, least: str = "") -> str:
    """Return time, phase with its reason, guard and margin at an instant.

    Args:
        least: Least tip-over margin of the run with direction and time, as far as it is known.
    """
    phase, hold = tape.phase_at(t_s), tape.holding_at(t_s)
    what = "live" if live else (tape.verdict or "recorded")
    lines = [
        f'<div style="{STYLE}"><b style="font-size:15px">{t_s:.2f} s</b> of {tape.end_s:.1f} s · {escape(what)}'
        f'<br><span style="opacity:.8">{escape(title)}</span></div>'
    ]
    if live and not len(tape):
        lines.append(_card(ORANGE, "preparing the simulation", "the first run on a computer compiles its kernels once"))
    if phase is not None:
        meaning = PHASE_TERMS.get(phase.name, "")
        lines.append(
            f'<div title="{escape(meaning)}" style="{STYLE};border-left:6px solid {_colour_of(phase)};padding-left:6px;'
            f'margin:4px 14px 4px 0"><b>{escape(phase.name)}</b> since {phase.start_s:.2f} s{_two_lines(phase.cause)}</div>'
        )
    if hold is not None:
        lines.append(_card(RED, f"HOLD since {hold.t_s:.2f} s", hold.cause))
    else:
        slow = next(
            (event for event in reversed(tape.events) if event.t_s <= t_s and event.name in ("slow", "resumed", "rearmed")), None
        )
        if slow is not None and slow.name == "slow":
            lines.append(_card(ORANGE, f"guard: slowed since {slow.t_s:.2f} s", slow.cause))
        else:
            lines.append(_card(GREEN, "guard: passes commands", "no limit reached"))
    if len(tape):
        lines.append(_margin_html(tape, t_s, least, live=live))
    return "".join(lines)


def _two_lines(text: str) -> str:
    """Return a text of two lines; its tooltip has the rest."""
    return f'<div title="{escape(text)}" style="{TWO_LINES}">{escape(text)}</div>'


def text_on(colour: str) -> str:
    """Return black or white, whichever has the larger contrast on a colour: at least 4.58 on any."""
    channels = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels)  # WCAG 2.2
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    return "#000" if (luminance + 0.05) ** 2 > 1.05 * 0.05 else "#fff"


def _card(colour: str, head: str, text: str) -> str:
    return (
        f'<div style="{STYLE};background:{colour};color:{text_on(colour)};border-radius:4px;padding:3px 7px;margin:4px 14px 4px 0">'
        f'<b title="{escape(TERMS["guard"]["text"])}">{escape(head)}</b>{_two_lines(text)}</div>'
    )


def _margin_html(tape: Tape, t_s: float, least: str, *, live: bool) -> str:
    """Return the margin now, and the least of a whole run, or of a live run up to now."""
    now = tape.at(t_s)["margin_rad"]
    if math.isnan(now):
        return ""
    if not least:
        lowest = int(np.nanargmin(tape.column("margin_rad")))
        least = f"least {tape.column('margin_rad')[lowest] / DEG:.1f}° at {tape.column('t_s')[lowest]:.2f} s"
    colour = BAD_TEXT if np.nanmin(tape.column("margin_rad")) < MARGIN_LIMIT_RAD else "inherit"
    span = "so far" if live else "of the whole run"
    said = least.replace("least tip-over margin", "least")
    return (
        f'<div title="{escape(TERMS["tip-over margin"]["text"])}" style="{STYLE};height:2.7em">tip-over margin '
        f'<b>{now / DEG:.1f}°</b> now (7° is required)<br>{span}: <b style="color:{colour}">{escape(said)}</b></div>'
    )


def answers_html(answers: Iterable[Mapping[str, Any]], *, live: bool) -> str:
    """Return the answers to the usual questions about a run; those with a time lead to it.

    Args:
        answers: Text, time, kind and note of each, as the player page has them.
    """
    colours = {"hold": RED, "fault": ORANGE, "missed": ORANGE, "perception": ORANGE}
    style = "background:#f1f3f5;color:#000;border-radius:3px;padding:3px 7px;margin:3px 0"
    rows = []
    for answer in answers:
        leads, colour = answer["t"] is not None, colours.get(str(answer["kind"]), "#0072b2")
        rows.append(
            f'<div {_jump(answer["t"])} title="{escape(str(answer["note"]))}" style="border-left:4px solid {colour};{style};'
            f'cursor:{"pointer" if leads else "auto"}">{"▸ " if leads else ""}{escape(str(answer["label"]))}</div>'
        )
    head = "up to now, renewed every few seconds" if live else "of the whole run; click to go there"
    return f'<div style="{STYLE}">{head}{"".join(rows)}</div>'


def _jump(t_s: float | None, span_s: float | None = None) -> str:
    """Return the attributes of an element that leads to a time, or over a span by the place of the click."""
    if t_s is None:
        return ""
    span = "" if span_s is None else f' data-span="{span_s:.3f}"'
    return f'data-jump="{t_s:.3f}"{span} tabindex="0" role="button"'


def timeline_html(tape: Tape, t_s: float, fork_s: float | None = None, moments: Iterable[Moment] = ()) -> str:
    """Return the phases as a bar, with holds, faults, camera silence, the cursor, and the instant of a fork."""
    end_s = max(tape.end_s, 1e-3)
    bars = []
    for span in tape.phases:
        share = (span.end_s - span.start_s) / end_s
        name = escape(span.name) if share * TIMELINE_PX > LETTER_PX * len(span.name) + SIDES_PX else ""
        colour = _colour_of(span)
        bars.append(
            f'<div {_jump(span.start_s, span.end_s - span.start_s)} title="{span.start_s:.2f} s {escape(span.name)}: '
            f'{escape(span.cause)}" style="position:absolute;left:{100.0 * span.start_s / end_s:.2f}%;width:{100.0 * share:.2f}%;'
            f"height:22px;background:{colour};color:{text_on(colour)};font-size:11px;overflow:hidden;white-space:nowrap;"
            f'cursor:pointer">&nbsp;{name}</div>'
        )
    marks = [
        _mark(event.t_s, end_s, "#d00000" if event.name == "hold" else "#00a000", f"{event.t_s:.2f} s {event.name}: {event.cause}")
        for event in tape.events
        if event.name in ("hold", "rearmed")
    ]
    marks += [_strip(moment, end_s) for moment in moments if moment.kind in ("fault", "perception")]
    if fork_s is not None:
        marks.append(_mark(fork_s, end_s, "#56b4e9", f"{fork_s:.2f} s: the fork begins"))
    cursor = _mark(t_s, end_s, "#000", f"{t_s:.2f} s", leads=False)
    inside = "".join([*bars, *marks, cursor])
    return f'<div style="position:relative;height:30px;margin:2px 14px 2px 0;border-radius:3px">{inside}</div>'


def _strip(moment: Moment, end_s: float) -> str:
    """Return a span below the phases: a fault in red, without frames or stair in orange."""
    last_s = moment.t_s if moment.end_s is None else moment.end_s
    colour = RED if moment.kind == "fault" else ORANGE
    left, width = 100.0 * moment.t_s / end_s, 100.0 * (last_s - moment.t_s) / end_s
    title = escape(f"{moment.t_s:.2f} s {moment.name}: {moment.cause}")
    return (
        f'<div {_jump(moment.t_s)} title="{title}" style="position:absolute;left:{left:.2f}%;width:max({width:.2f}%, 3px);top:24px;'
        f'height:6px;background:{colour};cursor:pointer"></div>'
    )


def _mark(t_s: float, end_s: float, colour: str, title: str, *, leads: bool = True) -> str:
    """Return a vertical line at a time; without ``leads`` it lets clicks pass to the phase below."""
    left, jump = 100.0 * min(t_s / end_s, 1.0), _jump(t_s) if leads else ""
    return (
        f'<div {jump} title="{escape(title)}" style="position:absolute;left:calc({left:.2f}% - 1px);width:2px;'
        f'height:30px;background:{colour};outline:1px solid #fff8;{"cursor:pointer" if leads else "pointer-events:none"}"></div>'
    )


def transitions_html(tape: Tape, t_s: float) -> str:
    """Return the table of transitions: time, phase, reason; the present phase is bold."""
    present = tape.phase_at(t_s)
    rows = [_row(span.start_s, span.name, span.cause, bold=span == present, colour=_colour_of(span)) for span in tape.phases]
    return _table(rows)


def _colour_of(span: PhaseSpan) -> str:
    return PHASE_COLOURS.get(span.name, "#888")


def events_html(tape: Tape, t_s: float, moments: Iterable[Moment] = ()) -> str:
    """Return events, faults, camera silence and other moments up to an instant, the newest first.

    Args:
        moments: Moments of the run besides its events, as far as they are known.
    """
    found = [(event.t_s, event.name, event.cause) for event in tape.events]
    found += [(moment.t_s, moment.name, moment.cause) for moment in moments if moment.kind != "event"]
    past = sorted(entry for entry in found if entry[0] <= t_s + 1e-6)[-EVENTS_SHOWN:]
    colours = {
        "hold": RED, "slow": ORANGE, "rearmed": GREEN, "hull_contact": RED, "rejected": ORANGE, "fault": RED,
        "no camera frame": ORANGE, "no stair perceived": ORANGE, "slip": ORANGE,
    }  # fmt: skip
    rows = [
        _row(then_s, name, cause, bold=name in ("hold", "no camera frame"), colour=colours.get(name, "#888"))
        for then_s, name, cause in past
    ]
    return _table(rows[::-1]) if rows else f'<div style="{STYLE}">no event yet</div>'


def _row(t_s: float, name: str, cause: str, *, bold: bool, colour: str) -> str:
    style = f"font-weight:{'bold' if bold else 'normal'};vertical-align:top;cursor:pointer"
    return (
        f'<tr {_jump(t_s)} title="{escape(PHASE_TERMS.get(name, ""))}" style="{style}">'
        f'<td style="text-align:right;white-space:nowrap;padding-right:6px">{t_s:.2f} s</td>'
        f'<td style="border-left:4px solid {colour};padding:0 6px;max-width:110px">{escape(name)}</td>'
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


def camera_html(look: Look | None, seen: Sequence[int], missed: Mapping[int, str], warning: str | None) -> str:
    """Return the camera image with its overlay, the detector's answer, and the nosings by number.

    Args:
        missed: Numbers of the missed nosings, each with the reason.
        warning: Sentence about a silent camera or a stair that is not perceived; the frame before is dimmed.
    """
    alarm = "" if warning is None else _card(ORANGE, "camera", warning)
    if look is None:
        return alarm or f'<div style="{STYLE}">no camera frame yet</div>'
    picture = ""
    if look.picture is not None:
        data = base64.b64encode(look.picture).decode("ascii")
        style = IMAGE_STYLE + (";opacity:.4" if warning else "")
        picture = f'<img alt="camera image with detected nosings" style="{style}" src="data:image/jpeg;base64,{data}">'
    if not look.is_judged:
        return f'{picture}{alarm}<div style="{STYLE}"><b>image of {look.t_s:.2f} s</b><br>{escape(look.summary)}</div>'
    head = f"frame of {look.t_s:.2f} s: " + ("accepted" if look.reason is None else f"rejected, {look.reason}")
    if warning is not None:
        return f'{picture}{alarm}<div style="{STYLE}">last {escape(head)}</div>'
    colour = BAD_TEXT if look.reason is not None else GOOD_TEXT
    found = f"nosings perceived: {_numbers(seen)}; " + (
        f'<b style="color:{BAD_TEXT}">missed: {escape(_reasons(missed))}</b>' if missed else "none missed in view"
    )
    return f'{picture}<div style="{STYLE}"><b style="color:{colour}">{escape(head)}</b><br>{escape(look.summary)}<br>{found}</div>'


def camera_warning(tape: Tape, t_s: float, moments: Iterable[Moment]) -> str | None:
    """Return a sentence about a silent camera or a stair that is not perceived at a time; None while frames arrive.

    Args:
        moments: Moments of the run, as far as they are known.
    """
    look = tape.look_at(t_s)
    spans = [span for span in moments if span.kind == "perception" and span.t_s < t_s <= (span.end_s or span.t_s)]
    silent = next((span for span in spans if span.name == "no camera frame"), None)
    since_s = 0.0 if look is None else look.taken_s
    if tape.fresh_look_at(t_s) is not None or t_s - (since_s if silent is None else silent.t_s) <= SILENT_S:
        return None
    if silent is None and spans:
        return f"no stair perceived for {t_s - spans[0].t_s:.1f} s; {spans[0].cause}"
    since_s = since_s if silent is None else silent.t_s
    return f"no frame for {t_s - since_s:.1f} s, since {since_s:.2f} s: the camera is silent"


def _reasons(missed: Mapping[int, str]) -> str:
    """Return the numbers of missed nosings with their reasons; nosings with the same reason are named together."""
    together: dict[str, list[int]] = {}
    for index, reason in missed.items():
        together.setdefault(reason, []).append(index)
    return "; ".join(f"{_numbers(indices)} ({reason})" for reason, indices in together.items())


def _numbers(numbers: Sequence[int]) -> str:
    return ", ".join(str(number) for number in numbers) or "none"


SCENE_COLOURS: tuple[tuple[tuple[int, int, int], str], ...] = (
    (SEEN, "nosing that the camera perceives"),
    (TRUE, "true nosing (ground truth); true heading: line ahead of the chair"),
    (MISSED, "true nosing that was missed"),
    (WARN, "estimated heading: wedge of 95 % ahead of the chair"),
    (GOOD, "support of the belts, centre of mass and its plumb line; orange below 7° of margin, red when it tips"),
    (TREAD, "detected treads"),
    (RISER, "detected risers"),
    (CONTACT, "contact forces"),
    (BAD, "belt forces (live runs); obstacle"),
    (SWEPT, "swept volume: the space that the chair needs ahead"),
    (GHOST, "fork: the chair of the repeated run"),
)
"""Colours of the scene and their meanings."""


def legend_of_scene() -> str:
    """Return the colours of the scene with their meanings."""
    rows = [
        f'<div style="display:flex;gap:6px;margin:2px 0"><span style="flex:none;width:14px;height:14px;border-radius:2px;'
        f'background:rgb{colour}"></span><span>{escape(text)}</span></div>'
        for colour, text in SCENE_COLOURS
    ]
    return f'<div style="{STYLE};margin-top:6px"><b>Colours of the scene</b>{"".join(rows)}</div>'


def terms_html() -> str:
    """Return the explanation of the terms on the page, folded."""
    terms = [(name, term["text"]) for name, term in TERMS.items()] + list(PHASE_TERMS.items())
    rows = "".join(f"<div><b>{escape(name)}</b>: {escape(text)}</div>" for name, text in terms)
    return f'<details style="{STYLE};margin-top:6px"><summary><b>Terms</b></summary>{rows}</details>'
