"""Robot file: the links, limits and mission of a real chair, as strictly typed TOML.

``ROBOT.toml -> RobotFile``. Speed limits have no default: a person who puts a chair on its belts enters them.
"""

from os.path import realpath
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from treadline.core.angles import DEG
from treadline.core.settings import Settings, read_toml
from treadline.core.signals import CLIMB_MOST_M_S
from treadline.hardware.ports import DriveLimits
from treadline.scenario.camera_file import Positive
from treadline.scenario.chair import read_chair

LINKS = {
    "serial": "treadline.hardware._serial_link:SerialLink",
    "can": "treadline.hardware._can_link:CanSimpleLink",
    "base": "treadline.hardware._base_link:BaseLink",
    "vesc": "treadline.hardware._base_link:BaseLink",
    "bno055": "treadline.hardware._bno055:Bno055Link",
    "keyboard": "treadline.hardware._handset:Keyboard",
    "gamepad": "treadline.hardware._handset:Gamepad",
}
"""Class of each link that has a name."""
MORE = {"vesc": {"wire": "treadline.hardware._vesc_wire:VescWire"}}
"""Options that a name stands for."""
SHARED = ("drives", "imu")
"""Tables whose device may carry other ports as well."""
Sign = Literal[-1, 1]


class LimitsTable(Settings):
    """Limits that the box at the drives enforces whatever the host sends."""

    belt_m_s: Annotated[float, Field(gt=0.0, le=1.0)]
    """Largest speed of one belt; Table I of the paper has 1 m/s."""
    acceleration_m_s2: Annotated[float, Field(gt=0.0, le=10.0)]
    """Largest change of a belt speed."""
    watchdog_s: Annotated[float, Field(gt=0.0, le=0.1)] = 0.1
    """Time without a command after which the box stops by itself."""
    battery_least_v: Positive | None = None
    """Battery voltage below which the chair is not armed, and held after 1 s. Unset: not checked."""


class LinkTable(Settings):
    """Link to a device: its name, and the options of its class."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False, strict=True)

    link: str
    """Name of ``LINKS``, or module:Class; drives or imu where that table's link reads it."""

    @model_validator(mode="after")
    def _has_a_class(self) -> "LinkTable":
        if self.link not in (*LINKS, *SHARED) and ":" not in self.link:
            raise ValueError(f"'{self.link}' is no link; give {', '.join((*LINKS, *SHARED))}, or module:Class of your own driver")
        return self

    @property
    def request(self) -> dict[str, object]:
        """Class of the link and its options."""
        return {"class": LINKS.get(self.link, self.link), "options": MORE.get(self.link, {}) | (self.model_extra or {})}


class SignsTable(Settings):
    """Result of the guided wiggle: what the host changes between the chair's belts and those of the box."""

    swapped: bool = False
    """Whether the box's left output drives the right belt."""
    left: Sign = 1
    """-1 if the left belt (after a swap) runs backwards."""
    right: Sign = 1


class CameraTable(Settings):
    """Live depth camera; further keys are options of an own camera's class."""

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False, strict=True)

    source: str
    """Name or class: realsense, orbbec, oak, or module:Class of an own camera."""
    calibration: str
    """Camera file with intrinsics and the mount on the chair."""


class MissionTable(Settings):
    """Traversal as the operator enters it."""

    chair: str = "wheelchair"
    """Name of a shipped chair, or path of a chair's TOML file."""
    controller: str | None = None
    """Controller file that treadline tune wrote. Unset: the one shipped for the chair."""
    direction: Literal["up", "down"] = "up"
    payload_kg: Annotated[float, Field(ge=0.0, le=200.0)]
    """Mass on the seat. Sand bags: no person may sit on this chair."""
    speed_m_s: Annotated[float, Field(gt=0.0, le=CLIMB_MOST_M_S)] = 0.1
    """Climb speed."""
    flights: Annotated[int, Field(ge=1)] | None = None
    """Number of flights. Unset: as many as are seen across a landing."""


class RobotFile(Settings):
    """A real chair: its links, its limits and its mission."""

    name: str
    limits: LimitsTable
    drives: LinkTable
    imu: LinkTable
    joints: LinkTable | None = None
    """Seat and flipper. None: a chair without them."""
    handset: LinkTable | None = None
    """Required for a drive and the bench; a recording needs none."""
    signs: SignsTable = SignsTable()
    camera: CameraTable | None = None
    """Required for a drive; the bench needs none."""
    mission: MissionTable

    @model_validator(mode="after")
    def _each_device_has_one_link(self) -> "RobotFile":
        seen: dict[str, str] = {}
        opened: set[str] = set()
        for name, table in self.tables.items():
            if table.link in SHARED and table.link not in opened:
                raise ValueError(f"{name}.link is '{table.link}', which is no table before; give serial, can, or module:Class")
            opened.add(name)
            port = (table.model_extra or {}).get("port")
            if table.link not in SHARED and port is not None and (other := seen.setdefault(realpath(str(port)), name)) != name:
                raise ValueError(f"{name}.port is '{port}', which {other} opens; write {name}.link = '{other}'")
        return self

    @property
    def tables(self) -> dict[str, LinkTable]:
        """The links by port."""
        found = {"drives": self.drives, "imu": self.imu, "joints": self.joints, "handset": self.handset}
        return {name: table for name, table in found.items() if table is not None}

    @property
    def drive_limits(self) -> DriveLimits:
        """Limits for the box, which rejects any larger command; those of seat and flipper are the chair file's."""
        limits, chair = self.limits, read_chair(self.mission.chair)
        seat, flipper = (None, None) if self.joints is None else (chair.seat, chair.flipper)
        return DriveLimits(
            speed_m_s=limits.belt_m_s,
            acceleration_m_s2=limits.acceleration_m_s2,
            watchdog_s=limits.watchdog_s,
            seat_m_s=0.0 if seat is None else seat.max_rate_m_s,
            flipper_rad_s=0.0 if flipper is None else flipper.max_rate_deg_s * DEG,
        )


def read_robot(path: Path) -> RobotFile:
    """Return the robot in a file.

    Raises:
        SettingsError: If the file is missing or invalid; one line with file, key and remedy.
    """
    return read_toml(path, RobotFile)
