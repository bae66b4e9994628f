"""Labels and units of the scores in ``result.json``, in groups."""

from collections.abc import Mapping
from dataclasses import dataclass

from treadline.report.channels import suffix
from treadline.report.results import RunResult

DIGITS = {
    "": 2,
    "°": 2,
    "s": 2,
    "m": 3,
    "°/s": 2,
    "m/s": 3,
    "m/s²": 2,
    "m/s³": 1,
    "mm/min": 3,
    "N": 0,
    "Wh": 2,
    "W": 0,
    "ms": 1,
    "×": 1,
}
"""Decimals by unit."""

SMALL = 0.1
"""Magnitude below which one more decimal is shown."""


@dataclass(frozen=True, slots=True)
class ScoreLabel:
    """Label and unit of a score."""

    label: str
    unit: str = ""
    absent: str = "–"
    """Text for a score that the run does not have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreRow:
    """Score of a run, formatted."""

    label: str
    value: str
    key: str
    """Key in ``result.json``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreGroup:
    """Group of related scores."""

    title: str
    rows: list[ScoreRow]
    aside: bool = False
    """Whether the group is secondary for this kind of run."""


SEAT = {
    "settle_s": ScoreLabel("settling time to ±1° of horizontal", "s", "not settled"),
    "start_deg": ScoreLabel("seat pitch at the start", "°"),
    "steady_error_deg": ScoreLabel("seat pitch, mean from 20 s on", "°"),
    "steady_rms_deg": ScoreLabel("seat pitch, RMS from 20 s on", "°"),
    "max_error_deg": ScoreLabel("largest seat pitch after settling", "°"),
}
"""Labels of the scores of a seat run (Fig. 11)."""
GROUPS: dict[str, dict[str, ScoreLabel]] = {
    "Heading (0° is square to the stair)": {
        "rms_heading_deg": ScoreLabel("RMS over the whole run", "°"),
        "rms_yaw_deg": ScoreLabel("RMS yaw about gravity over the whole run", "°"),
        "settle_s": ScoreLabel("settling time to ±2°", "s", "not settled"),
        "steady_rms_heading_deg": ScoreLabel("RMS from 20 s on", "°", "ended before 20 s"),
        "aligned_s": ScoreLabel("start of the approach, square to the stair", "s"),
        "aligned_rms_heading_deg": ScoreLabel("RMS from the start of the approach", "°"),
        "aligned_max_heading_deg": ScoreLabel("largest from the start of the approach", "°"),
        "max_abs_heading_deg": ScoreLabel("largest", "°"),
        "final_heading_deg": ScoreLabel("at the end", "°"),
    },
    "Distance": {
        "duration_s": ScoreLabel("simulated time", "s"),
        "climbed_m": ScoreLabel("distance along the flight, up positive", "m"),
        "roll_back_m": ScoreLabel("largest roll-back along the flight", "m"),
        "lateral_m": ScoreLabel("largest lateral distance from the start", "m"),
    },
    "Comfort (means over 50 ms)": {
        "max_pitch_rate_deg_s": ScoreLabel("largest pitch rate of the chair", "°/s"),
        "max_pitch_jolt_deg_s": ScoreLabel("largest pitch rate of a single 10 ms sample", "°/s"),
        "passenger_max_m_s2": ScoreLabel("largest acceleration of the passenger, three axes together", "m/s²"),
        "passenger_vertical_m_s2": ScoreLabel("vertical acceleration of the passenger", "m/s²"),
        "passenger_longitudinal_m_s2": ScoreLabel("acceleration of the passenger along the chair", "m/s²"),
        "passenger_lateral_m_s2": ScoreLabel("acceleration of the passenger across the chair", "m/s²"),
        "passenger_jerk_m_s3": ScoreLabel("jerk of the passenger, 99th percentile", "m/s³"),
        "seat_rms_deg": ScoreLabel("seat pitch, RMS", "°", "no seat linkage"),
        "seat_max_deg": ScoreLabel("seat pitch, largest", "°", "no seat linkage"),
    },
    "Safety": {
        "min_stability_margin_deg": ScoreLabel("smallest tip-over margin that lasts 0.1 s", "°"),
        "seconds_below_7_deg": ScoreLabel("tip-over margin below 7° for", "s"),
        "held_creep_mm_min": ScoreLabel("creep while held", "mm/min"),
        "max_contact_force_share": ScoreLabel("largest contact force over the weight"),
        "airborne_share": ScoreLabel("share of the steps without contact"),
        "unconverged_share": ScoreLabel("share of the ticks whose contact residual exceeds 0.01 m/s²"),
        "max_belt_force_n": ScoreLabel("largest traction of one belt", "N"),
        "max_friction_use": ScoreLabel("largest share of the friction used (1 slides)"),
    },
    "Energy (belts alone)": {
        "energy_wh": ScoreLabel("drawn from the battery", "Wh"),
        "peak_power_w": ScoreLabel("largest power", "W"),
    },
    "Replay against the recording": {
        "frames": ScoreLabel("camera frames"),
        "accepted": ScoreLabel("headings passed to the fusion"),
        "rejected": ScoreLabel("headings rejected by the fusion's gate"),
        "rms_difference_deg": ScoreLabel("heading, RMS difference to the recorded estimate", "°"),
        "largest_difference_deg": ScoreLabel("heading, largest difference to the recorded estimate", "°"),
        "commands_compared": ScoreLabel("belt commands compared"),
        "largest_command_gap_m_s": ScoreLabel("belt commands, largest difference", "m/s"),
        "largest_seat_gap_m_s": ScoreLabel("seat commands, largest difference", "m/s"),
        "brakes_differ": ScoreLabel("commands whose brake differs"),
    },
    "Replay against ground truth": {
        "rms_error_deg": ScoreLabel("heading, RMS error", "°"),
        "largest_error_deg": ScoreLabel("heading, largest error", "°"),
        "recorded_rms_error_deg": ScoreLabel("recorded heading, RMS error", "°"),
        "vision_rms_error_deg": ScoreLabel("vision alone, RMS error", "°"),
        "vision_largest_error_deg": ScoreLabel("vision alone, largest error", "°"),
        "normalised_error_squared": ScoreLabel("heading, normalised estimation error squared (consistent: 1)"),
        "vision_normalised_error_squared": ScoreLabel("vision, normalised estimation error squared (consistent: 1)"),
    },
    "Computing": {
        "ms_per_frame": ScoreLabel("vision per frame, median", "ms"),
        "ms_per_frame_p95": ScoreLabel("vision per frame, 95th percentile", "ms"),
        "real_time_factor": ScoreLabel("simulated or recorded time over computing time", "×"),
    },
}
WORDS = {key: word for words in GROUPS.values() for key, word in words.items()}
OF_HEADING = tuple(next(iter(GROUPS.values())).values())
OTHERS = "Other figures of result.json"
OF_NO_SEAT = ("Safety", "Computing")
"""Groups that also apply to a run of the seat alone; the chair does not move in such a run."""


def score_name(key: str) -> str:
    """Return the label of a score outside its group; the key if there is no label."""
    word = WORDS.get(key)
    return key if word is None else f"heading, {word.label}" if word in OF_HEADING else word.label


def score_groups(result: RunResult) -> list[ScoreGroup]:
    """Return all scores of a run in groups; those of the seat first in a run of the seat alone."""
    figures, seat = result.figures, result.seat
    groups = [ScoreGroup(title=title, rows=_rows(figures, words)) for title, words in GROUPS.items()]
    unknown = {key: ScoreLabel(key) for key in figures if key not in WORDS}
    groups.append(ScoreGroup(title=OTHERS, rows=_rows(figures, unknown)))
    if seat is not None:
        groups = [ScoreGroup(title=g.title, rows=g.rows, aside=g.title not in OF_NO_SEAT) for g in groups]
        own = [ScoreRow(label=r.label, value=r.value, key=f"seat.{r.key}") for r in _rows(seat.model_dump(), SEAT)]
        groups = [ScoreGroup(title="Seat", rows=own), *sorted(groups, key=lambda group: group.aside)]
    return [group for group in groups if group.rows]


def _rows(figures: Mapping[str, int | float | None], words: Mapping[str, ScoreLabel]) -> list[ScoreRow]:
    return [
        ScoreRow(label=word.label, value=_written(figures[key], word), key=key) for key, word in words.items() if key in figures
    ]


def _written(value: int | float | None, word: ScoreLabel) -> str:  # noqa: PYI041 - to the tests' type checker an int is no float
    if value is None:
        return word.absent
    if isinstance(value, int):
        return f"{value}{suffix(word.unit)}"
    digits = DIGITS[word.unit] + (abs(value) < SMALL)
    return f"{round(value, digits) + 0.0:.{digits}f}{suffix(word.unit)}"
