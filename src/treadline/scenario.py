"""What a scenario file says, typed and checked. The simulator and the experiments read it; the mission never does."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from treadline.attendant import OperatorAct, act_problem
from treadline.chair_files import CHAIRS, chair_file
from treadline.errors import SettingsError
from treadline.faults import Fault
from treadline.models import Reconstruct
from treadline.realism import Realism
from treadline.settings import Settings, parse_toml, settings_of
from treadline.stair_settings import RISE_M, RUN_M, SLOPE_DEG, Stair, StepOverride
from treadline.step_rules import step_problem

__all__ = [
    "RISE_M", "RUN_M", "SEAT_SHIFT_M", "SHIPPED", "SLOPE_DEG", "Chair", "Control", "DriveSettings", "Scenario", "Sensors", "Stair",
    "Start", "StepOverride", "is_sweep", "read_scenario", "scenario_of", "shipped_scenarios",
]  # fmt: skip

SHIPPED = Path(__file__).parent / "data" / "scenarios"
SEAT_SHIFT_M = (-0.3, 0.3)
"""How far the seat may be moved along the chair."""


Offset = Annotated[float, Field(ge=-0.5, le=0.5)]
Lean = Annotated[float, Field(ge=-0.3, le=0.3)]
Sway = Annotated[float, Field(ge=0.0, le=0.15)]


class Chair(Settings):
    """Which chair, and what sits in it."""

    model: str = "wheelchair"
    """The name of a shipped chair, or the path of a chair's TOML file."""
    payload_kg: Annotated[float, Field(ge=0.0, le=200.0)] = 50.0
    """What the passenger weighs."""
    payload_offset_m: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.0)
    """Of the passenger's centre of mass from its place in the seat: forward, left, up."""
    lean_m: tuple[Lean, Lean] = (0.0, 0.0)
    """Lean of the passenger: the centre of mass is so much further forward and left during the run. No operator enters it."""
    sway_m: tuple[Sway, Sway] = (0.0, 0.0)
    """Amplitude by which the passenger sways about that, forward and left; MuJoCo only."""
    sway_period_s: Annotated[float, Field(ge=1.0, le=20.0)] = 3.0
    """Period of the sway."""
    entered_payload_kg: Annotated[float, Field(ge=0.0, le=200.0)] | None = None
    """Weight of the passenger as the operator entered it: check and mission go by it. Unset: the true one."""
    entered_payload_offset_m: tuple[Offset, Offset, Offset] | None = None
    """Offset of the passenger as the operator entered it, for check. Unset: the true one."""
    seat_shift_m: Annotated[float, Field(ge=SEAT_SHIFT_M[0], le=SEAT_SHIFT_M[1])] = 0.0
    """Of the seat along the chair, uphill positive; ``treadline check`` proposes one."""
    belt_mismatch: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.005
    """By which share the right belt is faster than asked."""

    @property
    def entered(self) -> "Chair":
        """The chair as the operator entered it: what check and mission know."""
        kg, offset_m = self.entered_payload_kg, self.entered_payload_offset_m
        known = {
            "payload_kg": self.payload_kg if kg is None else kg,
            "payload_offset_m": self.payload_offset_m if offset_m is None else offset_m,
        }
        return self.model_copy(update=known)

    @property
    def sways(self) -> bool:
        """Whether the passenger moves during the run."""
        return any(self.sway_m)

    def leaning(self, sway: float = 0.0) -> "Chair":
        """Return the chair with its passenger's centre of mass where the lean puts it, plus a share of the sway, from -1 to 1."""
        x, y, z = self.payload_offset_m
        moved = (x + self.lean_m[0] + sway * self.sway_m[0], y + self.lean_m[1] + sway * self.sway_m[1], z)
        return self.model_copy(update={"payload_offset_m": moved})


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
    stiffness_s: float | None = None
    """Time constant of the belts' contact [s]; rubber of 0.005 to 0.02 s brackets the peaks of force. Unset: 0.01 s."""

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
        if self.stiffness_s is not None and not STIFFNESS_S[0] <= self.stiffness_s <= STIFFNESS_S[1]:
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


class DriveSettings(Settings):
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
    """Tilt error of a level chair's attitude by the bias of the accelerometer, in a direction drawn from the seed."""


class Scenario(Settings):
    """One run, whole."""

    stair: Stair = Stair()
    chair: Chair = Chair()
    belts: Belts = Belts()
    start: Start = Start()
    drive: DriveSettings = DriveSettings()
    control: Control = Control()
    sensors: Sensors = Sensors()
    step: tuple[StepOverride, ...] = ()
    operator: tuple[OperatorAct, ...] = ()
    realism: Realism = Realism()
    fault: tuple[Fault, ...] = ()

    @model_validator(mode="after")
    def _tables_of_lists_agree(self) -> "Scenario":
        problem = step_problem(self.stair, self.step) or act_problem(self.operator)
        if problem is not None:
            raise ValueError(problem)
        return self

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
