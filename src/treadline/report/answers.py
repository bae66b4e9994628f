"""Answers to the usual questions about a run, for the player page and the live view. ``Recording, Findings -> answers``."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.playback import Findings, Moment, Recording, missed_text, on_flight, phases_at

MOST_SPANS = 3
"""Largest number of spans without a frame or a stair among the answers."""
SHOWN = ("tips over the top edge", "level on the landing", "level on the floor", "slip")
"""Names of the motions among the answers."""


def moments_of(recording: Recording, findings: Findings) -> list[dict[str, Any]]:
    """Return the answers to the usual questions, each with the time to which it leads.

    Holds with their faults, least margin, ends of the flight, missed nosings, spans without camera or stair, and extremes.
    """
    found: list[dict[str, Any]] = []
    for hold in findings.holds:
        faults = [moment for moment in hold.chain if moment.kind == "fault"]
        found += [_answer(f"fault at {moment.t_s:.2f} s: {moment.cause}", moment.t_s, "fault") for moment in faults]
        found.append(_answer(f"hold at {hold.start_s:.2f} s: {hold.cause}", hold.start_s, "hold"))
    if findings.margin is not None:
        found.append(_answer(findings.margin_text, findings.margin[0]))
    shown = [moment for moment in findings.moments if moment.name in SHOWN]
    found += [_answer(f"{moment.name} at {moment.t_s:.2f} s", moment.t_s, note=moment.cause) for moment in shown]
    if findings.nosings:
        first_s = next((frame.t_s for frame in findings.nosings if frame.missed), None)
        found.append(_answer(missed_text(findings.nosings), first_s, "" if first_s is None else "missed"))
    found += [_answer(f"{moment.name} {moment.cause}", moment.t_s, "perception") for moment in _longest(findings.moments)]
    use = np.where(on_flight(recording), recording.friction_use, np.nan)
    needed = _friction_needed(recording, use)
    found += _extreme(recording.t_s, 100.0 * use, "highest friction use on the flight", " %", digits=0, more=needed)
    found += _extreme(recording.t_s, recording.pitch_rate_rad_s / DEG, "fastest pitch", "°/s")
    # During a turn on a landing, the heading changes from that of one flight to that of the next.
    turns = phases_at(recording.t_s, [(span.start_s, span.name) for span in recording.phases]) == "turn"
    error_rad = np.where(turns, np.nan, recording.estimate_rad - recording.heading_rad)
    return found + _extreme(recording.t_s, error_rad / DEG, "largest heading error of the estimate", "°")


def _longest(moments: Sequence[Moment]) -> list[Moment]:
    """Return the longest spans without a frame or without a stair, in order of time; the list of events has all."""
    unseen = [moment for moment in moments if moment.kind == "perception"]
    longest = sorted(unseen, key=lambda moment: moment.t_s - (moment.end_s or moment.t_s))[:MOST_SPANS]
    return sorted(longest, key=lambda moment: moment.t_s)


def _answer(label: str, t_s: float | None, kind: str = "", note: str = "") -> dict[str, Any]:
    """Return an answer: its text, the time to which it leads, its kind as a style, and a note for its tooltip."""
    return {"label": label, "t": t_s, "kind": kind, "note": note}


def _extreme(
    t_s: Float[np.ndarray, " T"], values: Float[np.ndarray, " T"], words: str, unit: str, *, digits: int = 1, more: str = ""
) -> list[dict[str, Any]]:
    """Return the value of the largest magnitude with its time, or nothing if no value is known."""
    if not np.isfinite(values).any():
        return []
    k = int(np.nanargmax(np.abs(values)))
    value = f"{values[k]:.{digits}f}".replace("-", "−")
    return [_answer(f"{words} {value}{unit} at {t_s[k]:.2f} s{more}", float(t_s[k]))]


def _friction_needed(recording: Recording, use: Float[np.ndarray, " T"]) -> str:
    """Return below which friction the chair would slide; empty if it slides, or if the friction is unknown."""
    if recording.scenario is None or not np.isfinite(use).any() or not 0.0 < (most := float(np.nanmax(use))) < 1.0:
        return ""
    along = recording.scenario.stair.friction[0]
    return f"; the chair slides on steps with friction below {most * along:.2f} (here {along:g})"
