"""Panels of the page as HTML: state, timeline, answers, phases, events, camera, handset, fork. ``Session -> str``."""

import base64
import time
from collections.abc import Callable, Mapping, Sequence
from html import escape

from treadline.core.rotations import rotation_of
from treadline.playback import SILENT_S, Moment, holding_at, in_runs, perceived_text
from treadline.report.labels import PHASES as PHASE_TERMS
from treadline.report.labels import TERMS
from treadline.report.plot_table import SIGNS, phase_colour
from treadline.view._messages import ShownFrame
from treadline.view._session import Session

TIMELINE_PX, LETTER_PX = 1000.0, 6.6
"""Width of the timeline on a page of 1,024 pixels [px], and of a letter in it: the widest of the phases' names on average."""
EVENTS_SHOWN = 40
"""Events of the log that are shown, the newest first."""
GREEN, ORANGE, RED = (str(SIGNS[state]["colour"]) for state in ("good", "near", "bad"))
"""Colours of cards and marks."""
GOOD_TEXT, BAD_TEXT = "#006b4e", "#a84300"
"""Colours of text on white: green and red, darkened to a contrast above 4.5."""
PREPARING = "preparing the simulation; the first run on a computer compiles its kernels once, which takes a minute or two"
"""Sentence about a simulation that has not sent anything yet."""
NO_FORK = (
    "This run cannot be repeated: its log comes without scenario and seed, or it used plug-ins. "
    "Run folders of treadline climb can be forked."
)
"""Sentence about a run that cannot be forked."""
IMAGE_STYLE = "width:calc(100% - 14px);max-height:250px;object-fit:contain;object-position:left;display:block"
STYLE = "font-size:12px;line-height:1.35;margin-right:14px"
TWO_LINES = "height:2.7em;overflow:hidden;display:-webkit-box;-webkit-line-clamp:2;-webkit-box-orient:vertical"
"""Style of a text that always takes two lines, so that nothing below it moves."""


def state_html(session: Session) -> str:
    """Return time, phase with its reason, guard and margin at the cursor."""
    run, t_s, is_live = session.run, session.cursor_s, session.is_live
    phase, hold = run.phase_at(t_s), holding_at(run.events, t_s)
    what = "live" if is_live else (run.outcome or "recorded")
    lines = [
        f'<div style="{STYLE}"><b style="font-size:15px">{t_s:.2f} s</b> of {session.feed.end_s:.1f} s · {escape(what)}'
        f'<br><span style="opacity:.8">{escape(session.feed.error or session.title)}</span></div>'
    ]
    if is_live and session.feed.is_empty:
        lines.append(_card(ORANGE, "preparing the simulation", "the first run on a computer compiles its kernels once"))
    if phase is not None:
        meaning = PHASE_TERMS.get(phase.name, "")
        lines.append(
            f'<div title="{escape(meaning)}" style="{STYLE};border-left:6px solid {phase_colour(phase.name)};padding-left:6px;'
            f'margin:4px 14px 4px 0"><b>{escape(phase.name)}</b> since {phase.start_s:.2f} s{_two_lines(phase.cause)}</div>'
        )
    guard = [event for event in run.events if event.t_s <= t_s and event.name in ("slow", "resumed", "rearmed")]
    if hold is not None:
        lines.append(_card(RED, f"HOLD since {hold.t_s:.2f} s", hold.cause))
    elif guard and guard[-1].name == "slow":
        lines.append(_card(ORANGE, f"guard: slowed since {guard[-1].t_s:.2f} s", guard[-1].cause))
    else:
        lines.append(_card(GREEN, "guard: passes commands", "no limit reached"))
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


def answers_html(session: Session) -> str:
    """Return the answers to the usual questions about a run; those with a time lead to it."""
    colours = {"hold": RED, "fault": ORANGE, "missed": ORANGE, "perception": ORANGE}
    style = "background:#f1f3f5;color:#000;border-radius:3px;padding:3px 7px;margin:3px 0"
    rows = []
    for answer in session.moments.answers:
        leads, colour = answer["t"] is not None, colours.get(str(answer["kind"]), SIGNS["true"]["colour"])
        rows.append(
            f'<div {_jump(answer["t"])} title="{escape(str(answer["note"]))}" style="border-left:4px solid {colour};{style};'
            f'cursor:{"pointer" if leads else "auto"}">{"▸ " if leads else ""}{escape(str(answer["label"]))}</div>'
        )
    head = "up to now, renewed every few seconds" if session.is_live else "of the whole run; click to go there"
    return f'<div style="{STYLE}">{head}{"".join(rows)}</div>'


def _jump(t_s: float | None, span_s: float | None = None) -> str:
    """Return the attributes of an element that leads to a time, or over a span by the place of the click."""
    if t_s is None:
        return ""
    span = "" if span_s is None else f' data-span="{span_s:.3f}"'
    return f'data-jump="{t_s:.3f}"{span} tabindex="0" role="button"'


def timeline_html(session: Session) -> str:
    """Return the phases as a bar, with holds, faults, camera silence, the cursor, and the instant of a fork."""
    run, t_s, end_s = session.run, session.cursor_s, max(session.feed.end_s, 1e-3)
    bars = []
    for span in run.phases:
        share = (span.end_s - span.start_s) / end_s
        name = escape(span.name) if share * TIMELINE_PX > LETTER_PX * len(span.name) + 8.0 else ""  # 4 px on either side
        colour = phase_colour(span.name)
        bars.append(
            f'<div {_jump(span.start_s, span.end_s - span.start_s)} title="{span.start_s:.2f} s {escape(span.name)}: '
            f'{escape(span.cause)}" style="position:absolute;left:{100.0 * span.start_s / end_s:.2f}%;width:{100.0 * share:.2f}%;'
            f"height:22px;background:{colour};color:{text_on(colour)};font-size:11px;overflow:hidden;white-space:nowrap;"
            f'cursor:pointer">&nbsp;{name}</div>'
        )
    marks = [
        _mark(event.t_s, end_s, "#d00000" if event.name == "hold" else "#00a000", f"{event.t_s:.2f} s {event.name}: {event.cause}")
        for event in run.events
        if event.name in ("hold", "rearmed")
    ]
    marks += [_strip(moment, end_s) for moment in session.moments.listed if moment.kind in ("fault", "perception")]
    fork = session.ghost  # a client may remove it at any time
    if fork is not None:
        marks.append(_mark(fork.from_s, end_s, "#56b4e9", f"{fork.from_s:.2f} s: the fork begins"))
    cursor = _mark(t_s, end_s, "#000", f"{t_s:.2f} s", leads=False)
    inside = "".join([*bars, *marks, cursor])
    return f'<div style="position:relative;height:30px">{inside}</div>'


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


def events_html(session: Session) -> str:
    """Return events, faults, camera silence and other moments up to the cursor, the newest first."""
    found = [(event.t_s, event.name, event.cause) for event in session.run.events]
    found += [(moment.t_s, moment.name, moment.cause) for moment in session.moments.listed if moment.kind != "event"]
    past = sorted(entry for entry in found if entry[0] <= session.cursor_s + 1e-6)[-EVENTS_SHOWN:]
    colours = {
        "hold": RED, "slow": ORANGE, "rearmed": GREEN, "hull_contact": RED, "rejected": ORANGE, "fault": RED,
        "no camera frame": ORANGE, "no stair perceived": ORANGE, "slip": ORANGE,
    }  # fmt: skip
    name_style = "border-left:4px solid {};padding:0 6px;max-width:110px"
    rows = [
        f'<tr {_jump(t_s)} title="{escape(PHASE_TERMS.get(name, ""))}" style="vertical-align:top;cursor:pointer">'
        f'<td style="text-align:right;white-space:nowrap;padding-right:6px">{t_s:.2f} s</td>'
        f'<td style="{name_style.format(colours.get(name) or phase_colour(name))}">{escape(name)}</td>'
        f"<td>{escape(cause)}</td></tr>"
        for t_s, name, cause in reversed(past)
    ]
    table = f'<table style="{STYLE};border-collapse:collapse;width:100%">{"".join(rows)}</table>'
    return table if rows else f'<div style="{STYLE}">no event yet</div>'


def handset_html(session: Session) -> str:
    """Return the state of the handset and the distance travelled by the belts."""
    run, state = session.run, session.handset
    travelled_m = 0.0 if session.feed.is_empty else float(run.belt_travel_m[run.index_at(session.cursor_s)].mean())
    asked = "the planner drives"
    if state.manual:
        switch = "held" if state.dead_man else "released"
        asked = f"dead-man switch <b>{switch}</b>; speed {state.speed_m_s:+.2f} m/s, turn {state.turn_m_s:+.2f} m/s"
    return f'<div style="{STYLE}">{asked}; belts travelled {travelled_m:.2f} m</div>'


def contacts_html(session: Session) -> str:
    """Return where the contact forces come from, if they are shown."""
    return f'<div style="font-size:12px">{session.contacts_note if session.shows.get("contacts") else ""}</div>'


def camera_html(session: Session) -> str:
    """Return the camera image with its overlay, the detector's answer, and the nosings by number.

    The last frame before a silence is dimmed, below a sentence about a silent camera or a stair that is not perceived.
    """
    frame, warning = session.feed.frame_at(session.cursor_s), camera_warning(session)
    alarm = "" if warning is None else _card(ORANGE, "camera", warning)
    if frame is None:
        return alarm or f'<div style="{STYLE}">no camera frame yet</div>'
    picture = ""
    if frame.picture is not None:
        data = base64.b64encode(frame.picture).decode("ascii")
        style = IMAGE_STYLE + (";opacity:.4" if warning else "")
        picture = f'<img alt="camera image with detected nosings" style="{style}" src="data:image/jpeg;base64,{data}">'
    if not frame.is_judged:
        return f'{picture}{alarm}<div style="{STYLE}"><b>image of {frame.t_s:.2f} s</b><br>{escape(frame.summary)}</div>'
    head = f"frame of {frame.t_s:.2f} s: " + ("accepted" if frame.reason is None else f"rejected, {frame.reason}")
    if warning is not None:
        return f'{picture}{alarm}<div style="{STYLE}">last {escape(head)}</div>'
    colour = BAD_TEXT if frame.reason is not None else GOOD_TEXT
    found, missed = _nosings_of(session, frame)
    said = f"{perceived_text(len(frame.nosings_B), found)}; " + (
        f'<b style="color:{BAD_TEXT}">missed: {escape(_reasons(missed))}</b>' if missed else "none missed in view"
    )
    summary = "" if frame.reason is not None and frame.reason in frame.summary else f"{escape(frame.summary)}<br>"
    return f'{picture}<div style="{STYLE}"><b style="color:{colour}">{escape(head)}</b><br>{summary}{said}</div>'


def _nosings_of(session: Session, frame: ShownFrame) -> tuple[Sequence[int], dict[int, str]]:
    """Return the numbers of the nosings that were perceived in a frame, and of the missed ones, each with the reason."""
    if session.feed.is_empty:
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
    if session.feed.fresh_frame_at(t_s) is not None or t_s - since_s <= SILENT_S:
        return None
    if silent is None and spans:
        return f"no stair perceived for {t_s - spans[0].t_s:.1f} s; {spans[0].cause}"
    return f"no frame for {t_s - since_s:.1f} s, since {since_s:.2f} s: the camera is silent"


def outcome_html(session: Session) -> str:
    """Return how a fork went, next to the run."""
    fork = session.ghost  # a client may remove it at any time
    if fork is None:
        return "" if session.can_repeat else f'<div style="font-size:12px">{NO_FORK}</div>'
    ghost, run, end_s = fork.feed, session.run, fork.feed.end_s
    outcome = ghost.recording.outcome
    ended = "still runs" if run.outcome is None else "ended"
    other = f"{ended} at {session.feed.end_s:.2f} s" + ("" if run.outcome is None else f": {escape(run.outcome)}")
    if ghost.error is not None:
        said = f'<span style="color:{BAD_TEXT}">{escape(ghost.error)}</span>'
    elif ghost.is_empty:
        said = f"{PREPARING} ({time.perf_counter() - fork.began_at:.0f} s so far)"
    elif outcome is None:
        said = f"simulated to {end_s:.1f} s of about {session.feed.end_s:.1f} s"
    else:
        said = f"ended at {end_s:.2f} s: <b>{escape(outcome)}</b>"
        hold = next((event for event in reversed(ghost.recording.events) if event.name == "hold"), None)
        if hold is not None and hold.cause not in outcome:
            said += f"<br>hold at {hold.t_s:.2f} s: {escape(hold.cause)}"
        said, other = (
            f"{text}<br>{escape(moments.margin)}" if moments.margin else text
            for text, moments in ((said, fork.moments), (other, session.moments))
        )
        if session.cursor_s > end_s:
            said += f"<br><b>the fork ended {session.cursor_s - end_s:.1f} s before the cursor</b>; its chair stays there"
    head = f"<b>fork at {fork.from_s:.2f} s: {escape(fork.name)}</b>"
    return f'<div style="{STYLE}">{head}<br>{said}<br><b>run</b>: {other}</div>'


def _reasons(missed: Mapping[int, str]) -> str:
    """Return the numbers of missed nosings with their reasons; nosings with the same reason are named together."""
    together: dict[str, list[int]] = {}
    for index, reason in missed.items():
        together.setdefault(reason, []).append(index)
    return "; ".join(f"{in_runs(indices)} ({reason})" for reason, indices in together.items())


def legend_of_scene() -> str:
    """Return the colours of the scene with their meanings."""
    rows = [
        f'<div style="display:flex;gap:6px;margin:2px 0"><span style="flex:none;width:14px;height:14px;border-radius:2px;'
        f'background:{sign["colour"]}"></span><span>{escape(", ".join(sign["means"]))}</span></div>'
        for sign in SIGNS.values()
        if "means" in sign
    ]
    return f'<div style="{STYLE};margin-top:6px"><b>Colours of the scene</b>{"".join(rows)}</div>'


def terms_html() -> str:
    """Return the explanation of the terms on the page, folded."""
    terms = [(name, term["text"]) for name, term in TERMS.items()] + list(PHASE_TERMS.items())
    rows = "".join(f"<div><b>{escape(name)}</b>: {escape(text)}</div>" for name, text in terms)
    return f'<details style="{STYLE};margin-top:6px"><summary><b>Terms</b></summary>{rows}</details>'


PANELS: Mapping[str, Callable[[Session], str]] = {
    "state": state_html,
    "camera": camera_html,
    "answers": answers_html,
    "events": events_html,
    "handset": handset_html,
    "contacts": contacts_html,
    "outcome": outcome_html,
}
"""Panels by name."""
