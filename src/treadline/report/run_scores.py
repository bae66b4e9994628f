"""A run's scores in words: what each figure of ``result.json`` means, with its unit, in groups."""

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
"""Decimals by unit; below a tenth one more."""

SMALL = 0.1


@dataclass(frozen=True, slots=True)
class Word:
    """What a score is called for people."""

    label: str
    unit: str = ""
    absent: str = "–"
    """Said where the run did not come to it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreRow:
    """One figure, written."""

    label: str
    value: str
    key: str
    """Its name in ``result.json``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoreGroup:
    """Figures that belong together."""

    title: str
    rows: list[ScoreRow]
    aside: bool = False
    """Whether they are not what this run was for."""


SEAT = {
    "settle_s": Word("within 1° of level for good after", "s", "never"),
    "start_deg": Word("off level at the start", "°"),
    "steady_error_deg": Word("off level on average, from 20 s on", "°"),
    "steady_rms_deg": Word("off level, RMS, from 20 s on", "°"),
    "max_error_deg": Word("furthest off level once settled", "°"),
}
"""Of the seat alone (Fig. 11)."""
GROUPS: dict[str, dict[str, Word]] = {
    "Heading (0° is square to the stair)": {
        "rms_heading_deg": Word("RMS over the whole run", "°"),
        "rms_yaw_deg": Word("RMS about gravity, over the whole run", "°"),
        "settle_s": Word("within ±2° for good after", "s", "never"),
        "steady_rms_heading_deg": Word("RMS from 20 s on", "°", "ended before 20 s"),
        "aligned_s": Word("square to the stair and off towards it after", "s"),
        "aligned_rms_heading_deg": Word("RMS from when it was square on", "°"),
        "aligned_max_heading_deg": Word("largest from when it was square on", "°"),
        "max_abs_heading_deg": Word("largest", "°"),
        "final_heading_deg": Word("at the end", "°"),
    },
    "Way": {
        "duration_s": Word("simulated time", "s"),
        "climbed_m": Word("way along the flight, up positive", "m"),
        "roll_back_m": Word("largest retreat along the flight", "m"),
        "lateral_m": Word("furthest aside from where it started", "m"),
    },
    "Comfort (means over 50 ms)": {
        "max_pitch_rate_deg_s": Word("largest pitch rate of the chair", "°/s"),
        "max_pitch_jolt_deg_s": Word("largest pitch rate of a single 10 ms sample", "°/s"),
        "passenger_max_m_s2": Word("largest acceleration of the passenger, three axes together", "m/s²"),
        "passenger_vertical_m_s2": Word("vertical acceleration of the passenger", "m/s²"),
        "passenger_longitudinal_m_s2": Word("acceleration of the passenger along the chair", "m/s²"),
        "passenger_lateral_m_s2": Word("acceleration of the passenger across the chair", "m/s²"),
        "passenger_jerk_m_s3": Word("jerk of the passenger, 99th percentile", "m/s³"),
        "seat_rms_deg": Word("seat off level, RMS", "°", "no seat linkage"),
        "seat_max_deg": Word("seat off level, largest", "°", "no seat linkage"),
    },
    "Safety": {
        "min_stability_margin_deg": Word("smallest tip-over margin that lasts 0.1 s", "°"),
        "seconds_below_7_deg": Word("tip-over margin below 7° for", "s"),
        "held_creep_mm_min": Word("creep while held", "mm/min"),
        "max_contact_force_share": Word("largest contact force over the weight"),
        "airborne_share": Word("share of the steps without contact"),
        "unconverged_share": Word("share of the ticks whose contact residual exceeds 0.01 m/s²"),
        "max_belt_force_n": Word("largest traction of one belt", "N"),
        "max_friction_use": Word("largest share of the friction used (1 slides)"),
    },
    "Energy (belts alone)": {
        "energy_wh": Word("drawn from the battery", "Wh"),
        "peak_power_w": Word("largest power", "W"),
    },
    "Replay against the recording": {
        "frames": Word("camera frames played"),
        "accepted": Word("headings given to the fusion"),
        "rejected": Word("of these refused by the fusion's gate"),
        "rms_difference_deg": Word("heading, RMS from the estimate of then", "°"),
        "largest_difference_deg": Word("heading, furthest from the estimate of then", "°"),
        "commands_compared": Word("belt commands compared"),
        "largest_command_gap_m_s": Word("belt commands, furthest apart", "m/s"),
        "largest_seat_gap_m_s": Word("seat commands, furthest apart", "m/s"),
        "brakes_differ": Word("commands whose brake differs"),
    },
    "Replay against the simulator's truth": {
        "rms_error_deg": Word("heading, RMS error", "°"),
        "largest_error_deg": Word("heading, largest error", "°"),
        "recorded_rms_error_deg": Word("heading, RMS error of then", "°"),
        "vision_rms_error_deg": Word("vision alone, RMS error", "°"),
        "vision_largest_error_deg": Word("vision alone, largest error", "°"),
        "normalised_error_squared": Word("heading, mean squared error over its variance (1 is right)"),
        "vision_normalised_error_squared": Word("vision, mean squared error over its variance (1 is right)"),
    },
    "Computing": {
        "ms_per_frame": Word("vision per frame, median", "ms"),
        "ms_per_frame_p95": Word("vision per frame, 95th percentile", "ms"),
        "real_time_factor": Word("simulated or recorded time over computing time", "×"),
    },
}
WORDS = {key: word for words in GROUPS.values() for key, word in words.items()}
OF_HEADING = tuple(next(iter(GROUPS.values())).values())
OTHERS = "Other figures of result.json"
OF_NO_SEAT = ("Safety", "Computing")
"""Groups that are also about a run of the seat alone; the others score a chair that stands where it was put."""


def score_name(key: str) -> str:
    """Return what a score is called where its group is not said; its key where it has no words."""
    word = WORDS.get(key)
    return key if word is None else f"heading, {word.label}" if word in OF_HEADING else word.label


def score_groups(result: RunResult) -> list[ScoreGroup]:
    """Return all numbers of a run's result, each once, in groups; those of the seat first where it was run alone."""
    figures, seat = result.figures, result.seat
    groups = [ScoreGroup(title=title, rows=_rows(figures, words)) for title, words in GROUPS.items()]
    unknown = {key: Word(key) for key in figures if key not in WORDS}
    groups.append(ScoreGroup(title=OTHERS, rows=_rows(figures, unknown)))
    if seat is not None:
        groups = [ScoreGroup(title=g.title, rows=g.rows, aside=g.title not in OF_NO_SEAT) for g in groups]
        own = [ScoreRow(label=r.label, value=r.value, key=f"seat.{r.key}") for r in _rows(seat.model_dump(), SEAT)]
        groups = [ScoreGroup(title="Seat", rows=own), *sorted(groups, key=lambda group: group.aside)]
    return [group for group in groups if group.rows]


def _rows(figures: Mapping[str, int | float | None], words: Mapping[str, Word]) -> list[ScoreRow]:
    return [
        ScoreRow(label=word.label, value=_written(figures[key], word), key=key) for key, word in words.items() if key in figures
    ]


def _written(value: int | float | None, word: Word) -> str:  # noqa: PYI041 - to the tests' type checker an int is no float
    if value is None:
        return word.absent
    if isinstance(value, int):
        return f"{value}{suffix(word.unit)}"
    digits = DIGITS[word.unit] + (abs(value) < SMALL)
    return f"{round(value, digits) + 0.0:.{digits}f}{suffix(word.unit)}"
