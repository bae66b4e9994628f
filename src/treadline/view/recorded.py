"""Tape of a recorded run, and recording of a live one: ``Recording <-> Tape``."""

import numpy as np
from jaxtyping import Float

from treadline.playback import PerceivedStair, Recording
from treadline.scenario.chair import ChairDescription
from treadline.scenario.faults import payload_shift_m
from treadline.scenario.scenario import Scenario
from treadline.view.tape import COLUMNS, NUMBER, Look, Tape


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
        "friction_use": recording.friction_use,
    }
    for name, values in columns.items():
        rows[:, NUMBER[name]] = values
    faults = () if recording.scenario is None else recording.scenario.fault
    shift = NUMBER["payload_forward_m"]
    rows[:, shift : shift + 3] = [payload_shift_m(faults, t_s) for t_s in recording.t_s.tolist()] if faults else 0.0
    tape = Tape(
        limits=recording.limits,
        events=list(recording.events),
        looks=[_look(seen.t_s, seen.taken_s, seen.nosings_B) for seen in recording.maps],
    )
    tape.append(rows)
    if recording.verdict is not None:
        tape.verdict = recording.verdict + (f": {recording.cause}" if recording.cause else "")
    return tape


SAME = (
    "seat_rad", "flipper_rad", "heading_rad", "estimate_rad", "sigma_rad", "pitch_rad", "pitch_rate_rad_s", "seat_pitch_rad",
    "margin_rad", "friction_use",
)  # fmt: skip
"""Quantities with the same name in both."""


def recording_of(tape: Tape, chair: ChairDescription, scenario: Scenario, seed: int) -> Recording:
    """Return the recording of what a tape holds so far; an accepted frame with nosings is a perceived stair.

    Args:
        scenario: Scenario with the faults that were injected so far.
    """

    def columns(*names: str) -> Float[np.ndarray, "n k"]:
        return np.column_stack([tape.column(name) for name in names])

    place = columns("x_m", "y_m", "z_m")
    return Recording.of_curves(
        tape.column("t_s").copy(),
        chair,
        **{name: tape.column(name).copy() for name in SAME},
        p_WB=place,
        quat_WB=columns("qw", "qx", "qy", "qz"),
        belt_m_s=columns("left_m_s", "right_m_s"),
        belt_travel_m=columns("left_travel_m", "right_travel_m"),
        command_m_s=columns("command_left_m_s", "command_right_m_s"),
        events=tuple(tape.events),
        phases=tape.phases,
        maps=tuple(
            PerceivedStair(
                t_s=look.t_s,
                taken_s=look.taken_s,
                nosings_B=look.nosings_B,
                nosings_W=np.full_like(look.nosings_B, np.nan),
                ends=False,
            )
            for look in tape.looks
            if look.is_judged and len(look.nosings_B)
        ),
        scenario=scenario,
        seed=seed,
        limits=tape.limits,
    )


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
