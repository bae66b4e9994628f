"""What a scenario file says, typed and checked. The simulator and the experiments read it; the mission never does."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal, TypeGuard

from pydantic import Field, model_validator

from treadline.chair_files import CHAIRS, chair_file
from treadline.errors import SettingsError
from treadline.faults import Fault
from treadline.models import Reconstruct
from treadline.settings import Settings, parse_toml, settings_of

SHIPPED = Path(__file__).parent / "data" / "scenarios"
RISE_M, RUN_M, SLOPE_DEG = (0.05, 0.30), (0.15, 0.60), (5.0, 45.0)
"""What a staircase's rise, run and slope may be."""
RUN_DEFAULT_M = 0.30
SEAT_SHIFT_M = (-0.3, 0.3)
"""How far the seat may be moved along the chair."""


class Stair(Settings):
    """The staircase: ``rise_m`` and ``run_m``, or ``slope_deg`` with ``run_m``.

    The slope is only another way to write the rise: it is turned into one as the file is read, and is not kept. Several flights
    are alike and go straight on, with a landing between any two.
    """

    rise_m: Annotated[float, Field(ge=RISE_M[0], le=RISE_M[1])] = 0.16
    """Height of a step."""
    run_m: Annotated[float, Field(ge=RUN_M[0], le=RUN_M[1])] = RUN_DEFAULT_M
    """Depth of a step, from nosing to nosing."""
    slope_deg: Annotated[float, Field(ge=SLOPE_DEG[0], le=SLOPE_DEG[1])] | None = Field(default=None, exclude=True)
    """In place of ``rise_m``."""
    steps: Annotated[int, Field(ge=2, le=2000)] = 20
    """Of each flight; the uppermost is its landing."""
    flights: Annotated[int, Field(ge=1, le=20)] = 1
    between_m: Annotated[float, Field(ge=0.5, le=20.0)] = 2.5
    """Depth of the landing between two flights, from the nosing of one to the first nosing of the next."""
    width_m: Annotated[float, Field(ge=0.8, le=60.0)] = 1.2
    landing_m: Annotated[float, Field(ge=0.0, le=20.0)] = 1.5
    """Depth of the landing above the last flight."""
    open_risers: bool = False
    """Whether one can look through between the treads."""
    nosing_radius_m: Annotated[float, Field(ge=0.002, le=0.03)] = 0.01
    rise_jitter_m: Annotated[float, Field(ge=0.0, le=0.03)] = 0.0
    """Standard deviation of a step's height."""
    nosing_yaw_jitter_deg: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    """Standard deviation by which a nosing is turned about the vertical."""
    friction: tuple[Annotated[float, Field(gt=0.0, le=2.0)], Annotated[float, Field(gt=0.0, le=2.0)]] = (
        0.62,
        0.5,
    )
    """Along the belt and across it."""
    missing_steps: tuple[Annotated[int, Field(ge=0)], ...] = ()
    """Counted from the floor over all flights, from 0."""
    texture: Literal["wood", "concrete", "carpet", "terrazzo", "dark"] = "wood"
    """What it is made of, as the camera sees it."""
    walls: Literal["none", "left", "right", "both"] = "left"
    light: Annotated[float, Field(ge=0.35, le=1.6)] = 1.0
    """Gain of the light: 1 as usual, less is darker."""

    @model_validator(mode="before")
    @classmethod
    def _rise_from_slope(cls, tables: object) -> object:
        """Turn ``slope_deg`` into a rise, so that only one of the two can be the truth."""
        if not isinstance(tables, dict) or tables.get("slope_deg") is None:
            return tables
        if "rise_m" in tables:
            raise ValueError("give rise_m or slope_deg, not both")
        slope, run = tables["slope_deg"], tables.get("run_m", RUN_DEFAULT_M)
        if not (_within(SLOPE_DEG, slope) and _within(RUN_M, run)):
            return tables  # the fields' own checks say what is wrong with them
        rise = run * math.tan(math.radians(slope))
        if not _within(RISE_M, rise):
            raise ValueError(
                f"slope_deg = {slope:g} with run_m = {run:g} is a rise of {rise:.3f} m; it must be from "
                f"{RISE_M[0]:g} to {RISE_M[1]:g} m"
            )
        return {key: value for key, value in tables.items() if key != "slope_deg"} | {"rise_m": rise}

    @model_validator(mode="after")
    def _steps_exist(self) -> "Stair":
        count = self.flights * self.steps
        beyond = [index for index in self.missing_steps if index >= count or (index + 1) % self.steps == 0]
        if beyond and self.flights == 1:
            raise ValueError(
                f"missing_steps names step {beyond[0]} of a flight of {self.steps} steps; the last that can be missing "
                f"is {self.steps - 2}, for the one above it is the landing"
            )
        if beyond:
            raise ValueError(
                f"missing_steps names step {beyond[0]} of {self.flights} flights of {self.steps} steps, counted over all from the "
                f"floor; it must be below {count - 1} and no flight's uppermost, for that is its landing"
            )
        return self

    @property
    def slope_rad(self) -> float:
        """Angle of the nosing plane."""
        return math.atan2(self.rise_m, self.run_m)


def _within(limits: tuple[float, float], value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and limits[0] <= value <= limits[1]


Offset = Annotated[float, Field(ge=-0.5, le=0.5)]


class Chair(Settings):
    """Which chair, and what sits in it."""

    model: str = "wheelchair"
    """The name of a shipped chair, or the path of a chair's TOML file."""
    payload_kg: Annotated[float, Field(ge=0.0, le=200.0)] = 50.0
    """What the passenger weighs."""
    payload_offset_m: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.0)
    """Of the passenger's centre of mass from its place in the seat: forward, left, up."""
    seat_shift_m: Annotated[float, Field(ge=SEAT_SHIFT_M[0], le=SEAT_SHIFT_M[1])] = 0.0
    """Of the seat along the chair, uphill positive; ``treadline check`` proposes one."""
    belt_mismatch: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.005
    """By which share the right belt is faster than asked."""


LUGS_MM: Mapping[str, tuple[float, float, float, float]] = {
    "none": (0.0, 60.0, 20.0, 10.0),
    "8/60": (8.0, 60.0, 20.0, 10.0),
    "15/80": (15.0, 80.0, 24.0, 14.0),
    "20/80": (20.0, 80.0, 24.0, 14.0),
}
"""Height, pitch, tip and flank of the named lugs [mm]."""
STIFFNESS_S = (0.004, 0.05)
"""Bounds of the contact's time constant: two physics steps of 2 ms, which is the least that integrates, and a soft tyre."""


class Belts(Settings):
    """Surface and rubber of the belts. Each explicit measure replaces the one of the named lug."""

    lug: Literal["none", "8/60", "15/80", "20/80"] = "none"
    """Height and pitch of the lugs [mm]; none is a smooth belt."""
    height_m: Annotated[float, Field(ge=0.0, le=0.05)] | None = None
    """Depth of the belt between lugs below their tips."""
    pitch_m: Annotated[float, Field(ge=0.01, le=0.3)] | None = None
    """Distance from lug to lug along the belt."""
    tip_m: Annotated[float, Field(ge=0.0, le=0.3)] | None = None
    """Width of a lug's tip along the belt."""
    flank_m: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """Length of each flank along the belt, a half-cosine."""
    stiffness_s: float = 0.01
    """Time constant of the belts' contact [s]; rubber of 0.005 to 0.02 s brackets the peaks of force."""

    @property
    def measures_m(self) -> tuple[float, float, float, float]:
        """Height, pitch, tip and flank."""
        named = LUGS_MM[self.lug]
        given = (self.height_m, self.pitch_m, self.tip_m, self.flank_m)
        height, pitch, tip, flank = (1e-3 * mm if own is None else own for mm, own in zip(named, given, strict=True))
        return height, pitch, tip, flank

    @model_validator(mode="after")
    def _is_a_profile(self) -> "Belts":
        _, pitch, tip, flank = self.measures_m
        if tip + 2.0 * flank > pitch + 1e-12:
            raise ValueError(
                f"a lug's tip of {tip:.3f} m and its two flanks of {flank:.3f} m are longer than the pitch of {pitch:.3f} m: lugs "
                f"would overlap; give belts.pitch_m of at least {tip + 2.0 * flank:.3f}"
            )
        if not STIFFNESS_S[0] <= self.stiffness_s <= STIFFNESS_S[1]:
            raise ValueError(
                f"belts.stiffness_s is {self.stiffness_s}, the contact's time constant; physics steps of 2 ms integrate from "
                f"{STIFFNESS_S[0]} s (two steps), and rubber is stiffer than {STIFFNESS_S[1]} s"
            )
        return self


class Start(Settings):
    """Where the chair stands at t = 0."""

    place: Literal["floor", "flight", "landing"] = "floor"
    step: Annotated[int, Field(ge=0)] = 4
    """Nosing under the front pulley, when on the flight."""
    heading_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    """Zero square to the nosings, facing up; positive anticlockwise, seen from above."""
    lateral_m: Annotated[float, Field(ge=-5.0, le=5.0)] = 0.0
    """Left of the flight's middle."""
    seat: Literal["level", "chassis"] = "level"
    """The seat at t = 0: level, or parallel to the chassis (Fig. 11)."""


class Drive(Settings):
    """Direction, speed and a limit on time."""

    direction: Literal["up", "down"] = "up"
    check: bool = True
    """Whether ``treadline check`` is asked before anything moves; without it the chair finds out by itself what it can."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=0.30)] = 0.2
    """Of the belts on the flight."""
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 80.0
    """A limit; a traversal also ends on arrival."""


class Control(Settings):
    """How the loop is closed."""

    loop: Literal["closed", "open"] = "closed"
    """Open drives both belts alike, whatever the heading."""
    vision: Literal["robust", "paper", "truth"] = "robust"
    """What tells the heading: the estimator that drives, Algorithm 1 as printed, or the simulator's truth of what is in view."""
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    """How a turn is shared between the belts: so that the chair does not slide down meanwhile, or as printed."""
    reconstruct: Reconstruct | None = None
    """How the model's state is told from readings; unset leaves it to the controller's file, which says observer unless it was
    tuned otherwise."""


class Sensors(Settings):
    """Which error models the sensors follow."""

    camera: Literal["kinect1", "kinect2", "ideal", "statistical"] = "kinect1"
    """Rendered with that noise, or statistical: heading and map with fitted errors, without images."""
    image_height_px: Literal[240, 480] = 240
    """320×240 or 640×480."""
    imu: Literal["mpu6050", "mpu9250", "ideal"] = "mpu6050"
    """Whose noise and bias it has."""
    gravity_error_deg: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    """Constant tilt of the IMU's idea of down, in a direction drawn from the seed."""


class Scenario(Settings):
    """One run, whole."""

    stair: Stair = Stair()
    chair: Chair = Chair()
    belts: Belts = Belts()
    start: Start = Start()
    drive: Drive = Drive()
    control: Control = Control()
    sensors: Sensors = Sensors()
    fault: tuple[Fault, ...] = ()

    @model_validator(mode="after")
    def _starts_on_the_flight(self) -> "Scenario":
        if self.start.place == "flight" and self.start.step >= self.stair.steps:
            raise ValueError(
                f"start.step is {self.start.step}, the flight has {self.stair.steps} steps; give one from 0 to "
                f"{self.stair.steps - 1}"
            )
        return self


def read_scenario(name: str | Path) -> Scenario:
    """Return the scenario in a file, or the shipped one of that name.

    Raises:
        SettingsError: If there is none, or it says something it must not.
    """
    path, shipped = Path(name), shipped_scenarios()
    if not path.is_file() and str(name) in shipped:
        path = shipped[str(name)]  # even beside a run folder of that name
    elif not str(name):
        raise SettingsError(f"no scenario is named; give a file, or a shipped one: {', '.join(sorted(shipped))}")
    elif not path.exists() and path.suffix == "" and len(path.parts) == 1:
        if (SHIPPED / f"{name}.toml").is_file():
            raise SettingsError(f"{name}: a shipped sweep, not one scenario; fly it with treadline sweep {name}")
        known = ", ".join(sorted(shipped))
        raise SettingsError(f"{name}: no such file, and no shipped scenario of that name (shipped: {known})")
    tables = parse_toml(path)
    if "draw" in tables:
        raise SettingsError(f"{path}: a sweep, not one scenario; fly it with treadline sweep {name}")
    return scenario_of(tables, path, where=str(path))


def scenario_of(tables: Mapping[str, object], path: Path, *, where: str) -> Scenario:
    """Return the scenario that tables of a file describe; a chair's file is sought beside that file first.

    Raises:
        SettingsError: With ``where``, if they say something they must not, or there is no such chair.
    """
    scenario = settings_of(tables, Scenario, where=where, file=path if where == str(path) else None)
    try:
        found = chair_file(scenario.chair.model, path.parent)
    except SettingsError as error:
        raise SettingsError(f"{where}: {error}") from None
    if found.parent == CHAIRS:
        return scenario
    return scenario.model_copy(update={"chair": scenario.chair.model_copy(update={"model": str(found)})})


def shipped_scenarios() -> dict[str, Path]:
    """Return the scenarios that come with the package; sweeps beside them are not among them."""
    return {found.stem: found for found in sorted(SHIPPED.glob("*.toml")) if not is_sweep(found)}


def is_sweep(path: Path) -> bool:
    """Say whether a shipped file draws scenarios and is none."""
    return "\n[[draw]]" in path.read_text(encoding="utf-8")
