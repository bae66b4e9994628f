"""Schema of ``results.json`` and of a run's files, checked before a page is drawn: typed, finite, no path in a name.

A report may be drawn from a folder of unknown origin, so every value is validated. An absent part was not measured; a
present part is complete.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from treadline.core import paper
from treadline.core.errors import SettingsError
from treadline.core.files import read_json

PAPER_FRICTION = list(paper.FRICTION)
"""Table I's friction along the belt and across, as JSON has it."""
RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")]
"""A folder's bare name: no separator, no leading dot."""
Numbers = Annotated[list[float], Field(min_length=1)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]


class Part(BaseModel):
    """Base of every part: strict and finite; further keys are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", strict=True, allow_inf_nan=False)


class Parameter(Part):
    """One row of Table I."""

    parameter: str
    paper: str
    ours: str


class FrameFigure(Part):
    """Fig. 5: headings by both methods on one frame."""

    heading_deg: float | None
    robust_heading_deg: float | None
    robust_sigma_deg: float | None
    true_heading_deg: float
    edges: int
    reason: str | None
    conditions: str


class BeltResponse(Part):
    """Response to an impulse on each belt."""

    left_m_s: Numbers
    right_m_s: Numbers


class Impulse(Part):
    """Fig. 8's four panels."""

    t_s: Numbers
    heading_rad: BeltResponse
    yaw_rate_rad_s: BeltResponse

    @model_validator(mode="after")
    def _of_one_length(self) -> "Impulse":
        parts = (self.heading_rad, self.yaw_rate_rad_s)
        lengths = {len(self.t_s), *(len(values) for part in parts for values in (part.left_m_s, part.right_m_s))}
        if len(lengths) > 1:
            raise ValueError("t_s and the responses differ in length")
        return self


class ModelFigures(Part):
    """The model of one slope and friction."""

    slope_deg: float
    friction: Pair = PAPER_FRICTION
    """Friction coefficients along and across the belt; Table I's in older files without the key."""
    singular_values: Annotated[list[Annotated[float, Field(ge=0.0)]], Field(min_length=1)]
    rank: int
    sigma2_over_sigma3: float
    yaw_rate_vaf_percent: float
    heading_5s_rmse_deg: float
    poles: list[Pair]
    whiteness_p: float | None
    warnings: list[str] = []
    conditions: str


class Fig08(ModelFigures):
    """The slope the controller was made on, and all slopes."""

    impulse: Impulse
    slopes: list[ModelFigures]


class Steered(Part):
    """One row of the dead zone: yaw rate for a belt difference at a heading, simulated and by theory."""

    slope_deg: float
    heading_deg: float
    difference_m_s: float
    yaw_rate_deg_s: float
    theory_deg_s: float


class Straight(Part):
    """Fig. 9: one run."""

    slope_deg: float
    loop: Literal["open", "closed"]
    duration_s: float
    rms_heading_deg: float
    final_heading_deg: float
    max_abs_heading_deg: float
    lateral_m: float
    verdict: str
    seed: int
    run: RunName


class Turn(Part):
    """Fig. 10: one run."""

    slope_deg: float
    start_heading_deg: float
    verdict: str = "time_up"
    seed: int
    run: RunName


class Cell(Part):
    """Table II: one slope, friction and start, over all seeds."""

    slope_deg: float
    friction: Pair = PAPER_FRICTION
    start_heading_deg: float
    paper_label: str
    paper_deg: float | None
    rms_heading_deg: float | None
    """Mean of the completed runs, as of ``rms_yaw_deg``; None if every run ended early."""
    sd: float | None
    seeds: int
    averaged: int | None = None
    """Number of completed runs, which the means are of; None in results of an earlier version."""
    ended_early: list[str] = []
    """The other runs, each with its end in words."""
    rms_yaw_deg: float | None
    settle_s: float | None
    steady_rms_heading_deg: float | None
    worst_steady_rms_heading_deg: float | None
    roll_back_m: float
    lateral_m: float
    min_stability_margin_deg: float
    margin_deg: float | None = None
    """Smallest tip-over margin that lasts 0.1 s; from here on None in results of an earlier version."""
    seconds_below_7_deg: float | None = None
    passenger_m_s2: float | None = None
    """Largest acceleration of the passenger, three axes together, 50 ms means; then each axis."""
    vertical_m_s2: float | None = None
    longitudinal_m_s2: float | None = None
    lateral_m_s2: float | None = None
    max_friction_use: float
    airborne_share: float | None = None
    max_contact_force_share: float | None = None
    belt_force_n: float | None = None
    belt_power_w: float | None = None
    verdicts: list[str]
    conditions: str


class PrintedRun(Part):
    """Run of the controller as printed."""

    run: RunName | None = None
    verdict: str
    cause: str | None
    duration_s: float
    rms_heading_deg: float
    final_heading_deg: float
    roll_back_m: float


class PrintedController(Part):
    """Controller of the paper as printed, and its runs."""

    max_gap_to_print: float
    asked_m_s: Pair
    max_speed_m_s: float
    runs: list[PrintedRun]


class SeatRun(Part):
    """Fig. 11."""

    settle_s: float | None
    steady_error_deg: float
    run: RunName
    conditions: str


class Controller(Part):
    """Gain and period of the controller."""

    K: list[list[float]]
    period_s: float


class Speed(Part):
    """Speed of the simulation."""

    physics_real_time_factor: float
    loop_cpu_s_per_s: float


class Moves(Part):
    """Largest change of a figure with step size, contact stiffness and friction; None where no run of a source has the figure."""

    unit: str
    conditions: str = ""
    """Conditions of the varied runs: a row may rest on more starts and seeds."""
    step: float | None = None
    stiffness: float | None = None
    friction: float | None = None
    lost: list[str] = []
    """Variations in which the runs end without the figure."""
    exceeded: list[str] = []
    """Sources that change the figure by more than its margin to the target, in either direction."""
    missed: list[str] = []
    """Variations in which the target is missed."""


class BeltRun(Part):
    """One run with smooth belts or with lugs."""

    course: str
    """``turn-28`` and the like, or a scenario."""
    slope_deg: float
    friction: Pair
    lug: str
    """Height and pitch of the lugs [mm], as in ``15/80``; none is a smooth belt."""
    rms_heading_deg: float
    roll_back_m: float
    passenger_m_s2: float
    pitch_rate_deg_s: float
    margin_deg: float
    max_contact_force_share: float | None
    duration_s: float
    verdict: str
    cause: str | None
    seed: int
    run: RunName


class Results(Part):
    """``results.json`` of a reproduce folder; parts that are None or empty were not measured."""

    quick: bool
    table1: list[Parameter] = []
    fig05: FrameFigure | None = None
    fig08: Fig08 | None = None
    dead_zone: list[Steered] = []
    fig09: list[Straight] = []
    fig10: list[Turn] = []
    table2: list[Cell] = []
    table2_roll_back_allowed: list[Cell] = []
    lugs: list[BeltRun] = []
    literal: PrintedController | None = None
    fig11: SeatRun | None = None
    controller: Controller | None = None
    speed: Speed | None = None
    gravity_error_deg: float = 0.0
    sensitivity: dict[str, Moves] = {}
    """Sensitivities of each figure, from the uncertainty budget shipped with the package."""
    wall_s: float | None = None
    versions: dict[str, str] = {}
    git_commit: str | None = None
    command: str = "treadline"


class LoggedEvent(Part):
    """Event of a run, with its cause."""

    t_s: float
    name: str
    cause: str


class SeatFigures(Part):
    """Results of a run of the seat alone."""

    settle_s: float | None
    start_deg: float
    steady_error_deg: float
    steady_rms_deg: float
    max_error_deg: float


class RunResult(Part):
    """``result.json`` of one run; its other numbers are its scores."""

    model_config = ConfigDict(extra="allow")

    verdict: str
    cause: str | None = None
    seed: int | None = None
    events: list[LoggedEvent] = []
    seat: SeatFigures | None = None

    @property
    def figures(self) -> dict[str, int | float | None]:
        """All its numbers, a count as the integer that it is; None is one that the run did not come to."""
        extra = self.model_extra or {}
        return {name: value for name, value in extra.items() if value is None or type(value) in (int, float)}


class Manifest(Part):
    """``manifest.json`` of one run."""

    settings: dict[str, Any]
    seed: Annotated[int, Field(ge=0)]
    command: str


P = TypeVar("P", bound=Part)


def read_part(path: Path, part: type[P]) -> P:
    """Return the part that a JSON file holds.

    Raises:
        SettingsError: If the file cannot be read, or lacks or mistypes a field: one line with file, field and what is wrong.
    """
    try:
        return part.model_validate(read_json(path))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(step) for step in first["loc"]) or "the whole"
        more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
        raise SettingsError(f"{path}: {field}: {first['msg']}{more}; make the folder again") from None
