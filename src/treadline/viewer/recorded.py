"""Tape of a recorded run: ``Recording -> Tape``."""

import numpy as np
from jaxtyping import Float

from treadline.angles import rotation_of
from treadline.faults import payload_shift_m
from treadline.playback import Recording
from treadline.viewer.tape import COLUMNS, LEAST_BELT_M, NUMBER, ROUNDING_S, SLIP_WINDOW_S, Look, PhaseEntry, Tape


def tape_of(recording: Recording) -> Tape:
    """Return a recording as a tape; a quantity that the log does not hold is NaN."""
    count = len(recording.t_s)
    rows = np.full((count, len(COLUMNS)), np.nan)
    columns = {
        "t_s": recording.t_s,
        **{name: recording.p_WB[:, k] for k, name in enumerate(("x_m", "y_m", "z_m"))},
        **{name: recording.quat_WB[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))},
        "seat_rad": recording.seat_rad,
        "flipper_rad": recording.flipper_rad,
        "left_m_s": recording.belt_m_s[:, 0],
        "right_m_s": recording.belt_m_s[:, 1],
        "left_travel_m": recording.belt_travel_m[:, 0],
        "right_travel_m": recording.belt_travel_m[:, 1],
        "heading_rad": recording.heading_rad,
        "estimate_rad": recording.estimate_rad,
        "sigma_rad": recording.sigma_rad,
        "pitch_rad": recording.pitch_rad,
        "pitch_rate_rad_s": recording.pitch_rate_rad_s,
        "seat_pitch_rad": recording.seat_pitch_rad,
        "margin_rad": recording.margin_rad,
        "command_left_m_s": recording.command_m_s[:, 0],
        "command_right_m_s": recording.command_m_s[:, 1],
        "slip": slip_of(recording),
        "friction_use": recording.friction_use,
    }
    for name, values in columns.items():
        rows[:, NUMBER[name]] = values
    faults = () if recording.scenario is None else recording.scenario.fault
    shift = NUMBER["payload_forward_m"]
    rows[:, shift : shift + 3] = [payload_shift_m(faults, t_s) for t_s in recording.t_s.tolist()] if faults else 0.0
    tape = Tape(
        events=list(recording.events),
        phases=[PhaseEntry(t_s=span.start_s, phase=span.name, cause=span.cause) for span in recording.phases],
        looks=[_look(seen.t_s, seen.taken_s, seen.nosings_B) for seen in recording.maps],
    )
    tape.append(rows)
    if recording.verdict is not None:
        tape.verdict = recording.verdict + (f": {recording.cause}" if recording.cause else "")
    return tape


def _look(t_s: float, taken_s: float, nosings_B: Float[np.ndarray, "n 3"]) -> Look:
    return Look(
        t_s=t_s,
        taken_s=taken_s,
        reason=None,
        heading_rad=None,
        sigma_rad=None,
        edge_count=len(nosings_B),
        nosings_B=nosings_B,
        summary=f"stair map with {len(nosings_B)} nosings (from the log)",
    )


def slip_of(recording: Recording) -> Float[np.ndarray, " T"]:
    """Return the slip ratio as ``SlipMeter`` gives it during a live run."""
    before = np.searchsorted(recording.t_s, recording.t_s - SLIP_WINDOW_S - ROUNDING_S)
    belts_m = recording.belt_travel_m.mean(axis=1)
    asked_m = belts_m - belts_m[before]
    forward = np.array([rotation_of(quaternion)[:, 0] for quaternion in recording.quat_WB])
    gone_m = ((recording.p_WB - recording.p_WB[before]) * forward).sum(axis=1)
    driven = np.abs(asked_m) >= LEAST_BELT_M
    return np.where(driven, 1.0 - gone_m / np.where(driven, asked_m, 1.0), np.nan)
