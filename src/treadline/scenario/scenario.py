"""Scenario files: typed and checked settings of one run. Simulator and experiments read the scenario; the mission never does."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from treadline.core.errors import SettingsError, closest
from treadline.core.files import DATA
from treadline.core.printing import Printable
from treadline.core.settings import Settings, parse_toml, settings_of
from treadline.core.signals import CLIMB_MOST_M_S
from treadline.scenario.camera_file import read_camera
from treadline.scenario.chair import ChairDescription, Faces, read_chair
from treadline.scenario.faults import Fault
from treadline.scenario.flight import StairFlight
from treadline.scenario.operator_actions import OperatorAct, act_problem
from treadline.scenario.shipped_files import CAMERAS, CHAIRS, file_named
from treadline.scenario.sill import Sill, sill_problem
from treadline.scenario.stair import Stair, StepOverride, flight_problem, step_problem

__all__ = [
    "SEAT_SHIFT_M", "SHIPPED", "Chair", "Control", "DriveSettings", "Scenario", "Sensors", "Stair",
    "Start", "StepOverride", "is_sweep", "read_scenario", "scenario_of", "shipped_scenarios", "with_values",
]  # fmt: skip

SHIPPED = DATA / "scenarios"
SEAT_SHIFT_M = (-0.3, 0.3)
"""Range of the seat position along the chair [m]."""


Offset = Annotated[float, Field(ge=-0.5, le=0.5)]
Lean = Annotated[float, Field(ge=-0.3, le=0.3)]
Sway = Annotated[float, Field(ge=0.0, le=0.15)]


class Chair(Settings):
    """Chair model and payload."""

    model: str | dict[str, Any] = "wheelchair"
    """Name of a shipped chair, path of a chair's TOML file, or what such a file holds, as tables."""
    faces: Faces | None = None
    """Where the occupant looks on the stair, up or down. Unset: as the chair's file says."""
    payload_kg: Annotated[float, Field(ge=0.0, le=200.0)] = 50.0
    """Mass of the passenger."""
    payload_offset_m: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.0)
    """Offset of the passenger's centre of mass from the nominal position in the seat: forward, left, up."""
    lean_m: tuple[Lean, Lean] = (0.0, 0.0)
    """Constant lean of the passenger during the run: offset of the centre of mass forward and left. Unknown to the operator."""
    sway_m: tuple[Sway, Sway] = (0.0, 0.0)
    """Amplitude of the passenger's sway about the lean, forward and left; MuJoCo only."""
    sway_period_s: Annotated[float, Field(ge=1.0, le=20.0)] = 3.0
    """Period of the passenger's sway."""
    entered_payload_kg: Annotated[float, Field(ge=0.0, le=200.0)] | None = None
    """Mass of the passenger entered by the operator, used by check and mission. Unset: the true mass."""
    entered_payload_offset_m: tuple[Offset, Offset, Offset] | None = None
    """Offset of the passenger entered by the operator, used by check. Unset: the true offset."""
    seat_shift_m: Annotated[float, Field(ge=SEAT_SHIFT_M[0], le=SEAT_SHIFT_M[1])] = 0.0
    """Position of the seat along the chair, uphill positive; ``treadline check`` proposes a value."""
    belt_mismatch: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.005
    """Relative speed excess of the right belt over its command."""

    @property
    def entered(self) -> "Chair":
        """Chair with the payload entered by the operator, as used by check and mission."""
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

    def sway_at(self, t_s: float) -> float:
        """Return the sway at a time from -1 to 1 of its amplitude; zero without sway."""
        return math.cos(math.tau * t_s / self.sway_period_s) if self.sways else 0.0

    def leaning(self, sway: float = 0.0) -> "Chair":
        """Return the chair with lean and a fraction of the sway (-1 to 1) added to the passenger's offset."""
        x, y, z = self.payload_offset_m
        moved = (x + self.lean_m[0] + sway * self.sway_m[0], y + self.lean_m[1] + sway * self.sway_m[1], z)
        return self.model_copy(update={"payload_offset_m": moved})

    def moved(self, by_m: tuple[float, float, float]) -> "Chair":
        """Return the chair with the passenger's centre of mass moved [m]: forward, left, up."""
        (x, y, z), (dx, dy, dz) = self.payload_offset_m, by_m
        return self.model_copy(update={"payload_offset_m": (x + dx, y + dy, z + dz)})


LUGS_MM: Mapping[str, tuple[float, float, float, float]] = {
    "none": (0.0, 60.0, 20.0, 10.0),
    "8/60": (8.0, 60.0, 20.0, 10.0),
    "15/80": (15.0, 80.0, 24.0, 14.0),
    "20/80": (20.0, 80.0, 24.0, 14.0),
}
"""Height, pitch, tip width and flank length of each named lug profile [mm]."""
STIFFNESS_S = (0.004, 0.05)
"""Bounds of the contact time constant [s]: two physics steps of 2 ms (integration stability), and a soft tyre."""


class Belts(Settings):
    """Lug profile and contact stiffness of the belts. Each explicit dimension overrides the named profile."""

    lug: Literal["none", "8/60", "15/80", "20/80"] = "none"
    """Named lug profile, height/pitch [mm]; none is a smooth belt."""
    height_m: Annotated[float, Field(ge=0.0, le=0.05)] | None = None
    """Height of the lug tips above the belt surface."""
    pitch_m: Annotated[float, Field(ge=0.01, le=0.3)] | None = None
    """Distance between adjacent lugs along the belt."""
    tip_m: Annotated[float, Field(ge=0.0, le=0.3)] | None = None
    """Width of the lug tip along the belt."""
    flank_m: Annotated[float, Field(gt=0.0, le=0.1)] | None = None
    """Length of each lug flank along the belt (half-cosine profile)."""
    stiffness_s: float | None = None
    """Time constant of the belt contact; 0.005 to 0.02 s covers rubber and brackets the force peaks. Unset: 0.01 s."""

    @property
    def measures_m(self) -> tuple[float, float, float, float]:
        """Height, pitch, tip width and flank length of the lugs [m]."""
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
    """Pose of the chair at t = 0."""

    place: Literal["floor", "flight", "landing"] = "floor"
    step: Annotated[int, Field(ge=0)] = 4
    """Index of the nosing under the front pulley for a start on the flight."""
    heading_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    """Initial heading, zero square to the nosings and facing up, positive anticlockwise seen from above."""
    lateral_m: Annotated[float, Field(ge=-5.0, le=5.0)] = 0.0
    """Initial lateral position, left of the middle of the flight."""
    seat: Literal["level", "chassis"] = "level"
    """Initial seat attitude: level, or parallel to the chassis (Fig. 11)."""


class DriveSettings(Settings):
    """Direction, speed and time limit of the run."""

    direction: Literal["up", "down"] = "up"
    check: bool = True
    """Whether ``treadline check`` must pass before the chair moves, and the mission refuses stairs beyond the chair's limits before
    entry. Without the check, only traction test and guard stop the chair."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=CLIMB_MOST_M_S)] = 0.2
    """Belt speed on the flight."""
    duration_s: Annotated[float, Field(gt=0.0, le=3600.0)] = 80.0
    """Time limit of the run; a traversal also ends on arrival."""


class Control(Settings):
    """Structure of the control loop."""

    loop: Literal["closed", "open"] = "closed"
    """Closed loop, or open loop: both belts run at the same speed at any heading."""
    vision: Literal["robust", "paper", "truth"] = "robust"
    """Source of the heading: the robust detector, Algorithm 1 as printed, or simulator ground truth for the stair in view."""
    allocation: Literal["climb-safe", "paper"] = "climb-safe"
    """Distribution of a turn between the belts: without roll-back of the chair (climb-safe), or as printed (paper)."""
    reconstruct: Literal["observer", "static"] | None = None
    """Method of state reconstruction. Unset: as stored in the controller file (observer by default)."""


MODELS = ("ideal", "statistical")
"""Models that ``sensors.camera`` may name in place of a camera."""


class Sensors(Settings):
    """Error models of the sensors."""

    camera: str | dict[str, Any] = "kinect1"
    """Camera: kinect1, kinect2, d435, d455 or tof, the path of a camera file, or its tables.
    kinect1 has the lens that the chair's file names, if it names one. The former values ideal and statistical are a kinect1 with
    that model."""
    model: Literal["rendered", "statistical", "ideal"] = "rendered"
    """Model of the camera: rendered images with the errors of its sensor, images without errors (ideal), or statistical: headings
    and maps with errors fitted to its kind of sensor, without images."""
    image_height_px: Literal[240, 480] | None = None
    """Image height. Unset: 240 rows of a kinect1 (320×240 pixels), all rows of another camera."""
    imu: Literal["mpu6050", "mpu9250", "ideal"] = "mpu6050"
    """IMU model: noise and bias of the named sensor."""
    gravity_error_deg: Annotated[float, Field(ge=0.0, le=5.0)] = 0.0
    """Attitude error of a chair at rest due to accelerometer bias, in a random direction."""

    @property
    def camera_name(self) -> str | dict[str, Any]:
        """Name, path or tables of the camera."""
        return "kinect1" if self.camera in MODELS else self.camera

    @property
    def camera_model(self) -> str:
        """Model of the camera: rendered, statistical or ideal."""
        return self.camera if isinstance(self.camera, str) and self.camera in MODELS and self.model == "rendered" else self.model

    @property
    def rows_px(self) -> int | None:
        """Image height [px]; None: all rows of the camera."""
        return 240 if self.image_height_px is None and self.camera_name == "kinect1" else self.image_height_px


EncoderError = Annotated[float, Field(ge=-0.1, le=0.1)]


class Realism(Settings):
    """Transport of camera readings, resolution of the encoders, limits of the motors, charge of the battery.

    Each default is typical of the class of hardware; docs/realism.md gives the source and the effect of each. Zero, or ``false``,
    makes the part ideal.
    """

    camera_latency_s: Annotated[float, Field(ge=0.0, le=0.5)] = 0.06
    """Mean time from exposure to delivery of a camera's readings [s]; they are delivered at the next tick. Typical, assumed: two
    frames of a depth camera at 30 Hz over USB."""
    camera_jitter_s: Annotated[float, Field(ge=0.0, le=0.2)] = 0.01
    """Standard deviation of the latency [s]; readings keep their order. Typical, assumed: scheduling without a real-time kernel."""
    camera_drop_rate: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.01
    """Probability that a frame never arrives. Typical, assumed: USB transfers lost under load."""
    encoder_counts_m: Annotated[float, Field(ge=0.0, le=1e8)] = 109_000.0
    """Encoder counts per metre of belt [1/m]; a speed is counts per 10 ms. Typical: a 500-line encoder (HEDS-5540: 2000 counts per
    turn) on a motor geared 24:1 to a pulley of 0.07 m, 2000 · 24 / (2π · 0.07 m). Zero reports exact speeds."""
    encoder_error: tuple[EncoderError, EncoderError] = (0.0, 0.0)
    """Relative error of the left and the right encoder's scale, unknown to the mission: a worn belt is 1 to 2 % shorter."""
    motor_limits: bool = True
    """Whether motors and brakes have the limits in the chair's file; without, belts follow their speeds at any load."""
    battery_charge: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """State of charge at the start, 1 full."""


class Scenario(Printable, Settings):
    """Complete settings of one run.

    Examples:
        >>> import treadline as tl
        >>> tl.Scenario.model_validate({"stair": {"steps": 6}, "start": {"heading_deg": 5}})
        scenario: the defaults, and
          stair.steps        6
          start.heading_deg  5
    """

    stair: Stair = Stair()
    chair: Chair = Chair()
    belts: Belts = Belts()
    start: Start = Start()
    drive: DriveSettings = DriveSettings()
    control: Control = Control()
    sensors: Sensors = Sensors()
    flight: tuple[StairFlight, ...] = ()
    step: tuple[StepOverride, ...] = ()
    sill: tuple[Sill, ...] = ()
    operator: tuple[OperatorAct, ...] = ()
    realism: Realism = Realism()
    fault: tuple[Fault, ...] = ()

    def __str__(self) -> str:
        return repr(self)

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the values that differ from the defaults, by dotted key."""
        from treadline.core.overrides import leaves

        changed = self.model_dump(exclude_defaults=True)
        return "scenario: the defaults, and", [
            (".".join(keys), f"{value:g}" if isinstance(value, float) else str(value)) for keys, value in leaves(changed).items()
        ]

    def read_chair(self) -> ChairDescription:
        """Return the chair with the camera in use: its lens at both mounts; a mount in its file replaces that of the camera ahead.

        Raises:
            SettingsError: If no such chair or camera exists, or its file is invalid.
        """
        own = {} if self.chair.faces is None else {"faces": self.chair.faces}
        chair = read_chair(self.chair.model).model_copy(update=own)
        if self.sensors.camera_name == "kinect1":
            return chair
        camera = self.sensors.camera_name
        device = read_camera(file_named(camera, CAMERAS) if isinstance(camera, str) else camera)
        ahead = "rear_camera" if self.drive.direction == "down" else "camera"
        mounts = [mount for mount in ("camera", "rear_camera") if getattr(chair, mount) is not None]
        lens = {"calibration": device, "file": None}
        return chair.changed(**{mount: lens | (device.mount if mount == ahead else {}) for mount in mounts})

    @model_validator(mode="after")
    def _tables_agree(self) -> "Scenario":
        if (problem := flight_problem(self.stair, self.flight)) is not None:
            raise ValueError(problem)
        object.__setattr__(self, "stair", self.stair.with_flights(self.flight))
        problem = step_problem(self.stair, self.step) or sill_problem(self.stair, self.sill) or act_problem(self.operator)
        if problem is not None:
            raise ValueError(problem)
        if self.start.place == "flight" and self.start.step >= self.stair.steps:
            raise ValueError(
                f"start.step is {self.start.step}, the flight has {self.stair.steps} steps; give one from 0 to "
                f"{self.stair.steps - 1}"
            )
        return self


def read_scenario(name: str | Path, values: Mapping[str, object] | None = None) -> Scenario:
    """Return the scenario in a file, or the shipped scenario of that name.

    Args:
        values: Values by dotted key, in place of the file's: ``{"stair.slope_deg": 30}``. A key that cannot stand next to one of
            them is left out, as here ``rise_m``.

    Raises:
        SettingsError: If no such scenario exists, or the file or a value is invalid.
    """
    path, shipped = Path(name), shipped_scenarios()
    if not path.is_file() and str(name) in shipped:
        path = shipped[str(name)]  # a run folder of the same name may exist next to it
    elif not str(name):
        raise SettingsError(f"no scenario is named; give a file, or a shipped one: {', '.join(sorted(shipped))}")
    elif not path.exists() and path.suffix == "" and len(path.parts) == 1:
        if (SHIPPED / f"{name}.toml").is_file():
            raise SettingsError(f"{name}: a shipped sweep, not one scenario; run it with treadline sweep {name}")
        known, meant = ", ".join(sorted(shipped)), closest(str(name), shipped)
        remedy = "" if meant is None else f"; did you mean {meant}?"
        raise SettingsError(f"{name}: no such file, and no shipped scenario of that name (shipped: {known}){remedy}")
    tables = parse_toml(path)
    if "draw" in tables:
        raise SettingsError(f"{path}: a sweep, not one scenario; run it with treadline sweep {name}")
    if "tracks" in tables:
        raise SettingsError(f"{path}: a vehicle, not a scenario; name it in a scenario file: [chair] model = '{path.name}'")
    scenario = scenario_of(tables, path, where=str(path))
    return with_values(tables, values, path, name) if values else scenario


def with_values(
    tables: Mapping[str, object], values: Mapping[str, object], path: Path = Path(), name: str | Path = "the scenario"
) -> Scenario:
    """Return the scenario given by parsed tables, with values by dotted key as in ``read_scenario``.

    Raises:
        SettingsError: If a value is invalid.
    """
    from treadline.core.overrides import overridden

    return scenario_of(overridden(tables, values, Scenario), path, where=f"{name}, as changed")


def scenario_of(tables: Mapping[str, object], path: Path, *, where: str) -> Scenario:
    """Return the scenario given by parsed tables; files of chair and camera are looked up next to ``path`` first.

    Raises:
        SettingsError: With ``where``, if the tables are invalid or the file of chair or camera does not exist.
    """
    scenario = settings_of(tables, Scenario, where=where, file=path if where == str(path) else None)
    named = (("chair", "model", CHAIRS, scenario.chair.model), ("sensors", "camera", CAMERAS, scenario.sensors.camera_name))
    own: dict[str, dict[str, str]] = {}
    for table, key, shipped_in, name in named:
        if isinstance(name, str):
            try:
                found = file_named(name, shipped_in, path.parent)
            except SettingsError as error:
                raise SettingsError(f"{where}: {error}") from None
            own |= {} if found.parent == shipped_in else {table: {key: str(found)}}
    return scenario.changed(**own) if own else scenario


def shipped_scenarios() -> dict[str, Path]:
    """Return name and path of each scenario shipped with the package, sweeps excluded."""
    return {found.stem: found for found in sorted(SHIPPED.glob("*.toml")) if not is_sweep(found)}


def is_sweep(path: Path) -> bool:
    """Return whether a shipped file is a sweep (with ``[[draw]]`` tables) instead of a scenario."""
    return "\n[[draw]]" in path.read_text(encoding="utf-8")


def chair_of_run(settings: Mapping[str, Any], where: str) -> ChairDescription:
    """Return the chair of a run's manifest: of its scenario, of the log that was replayed, or of a real chair's robot file.

    Raises:
        SettingsError: If the settings name no chair.
    """
    match settings:
        case {"robot": {"mission": {"chair": str(name)}}}:
            return read_chair(name)
        case {"robot": _}:
            raise SettingsError(f"{where}.robot names no chair; make the run again")
    # Of a log without a manifest, the chair is the default.
    scenario = settings.get("scenario") or {} if "replay" in settings else settings
    return settings_of(scenario, Scenario, where=where).read_chair()
