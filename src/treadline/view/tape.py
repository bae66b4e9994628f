"""Tape: what a run did, tick by tick, in the quantities that scene and plots show. A live run appends to its tape."""

from bisect import bisect_right
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from treadline.core.signals import TICK_S, Event
from treadline.playback import Limits, PhaseSpan
from treadline.playback.findings import ROUNDING_S, SILENT_S, holding_at
from treadline.playback.recording import SLIP_WINDOW_S, phases_of, slip_ratio

COLUMNS = (
    "t_s", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "seat_rad", "flipper_rad", "left_m_s", "right_m_s", "left_travel_m",
    "right_travel_m", "heading_rad", "estimate_rad", "sigma_rad", "pitch_rad", "pitch_rate_rad_s", "seat_pitch_rad", "margin_rad",
    "command_left_m_s", "command_right_m_s", "brake", "slip", "friction_use", "force_share", "left_force_n", "right_force_n",
    "payload_forward_m", "payload_left_m", "payload_up_m",
)  # fmt: skip
"""Quantities of a row, in SI units: pose of B in W, joint angles, belts, heading, attitude, margins, commands, forces, shift of
the passenger's centre of mass in the seat. NaN where a quantity is unknown."""
NUMBER = {name: number for number, name in enumerate(COLUMNS)}
"""Position of each column."""
PLACE, ATTITUDE = slice(NUMBER["x_m"], NUMBER["z_m"] + 1), slice(NUMBER["qw"], NUMBER["qz"] + 1)
"""Columns of position and attitude."""
DEPTH_STEP = 4
"""Pixels between the depths that are kept: 10 kB per frame, and 1 cm on a nosing at 1 m."""
GROWTH_ROWS = 4096
"""Least number of rows by which the memory of a tape grows: 41 s at 100 Hz."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """Result of the detector for one camera frame."""

    t_s: float
    """Time of the exposure."""
    taken_s: float
    """Time at which the mission received the frame."""
    reason: str | None
    """Reason of a rejected or unconfirmed frame; None if accepted."""
    heading_rad: float | None
    sigma_rad: float | None
    edge_count: int
    nosings_B: Float[np.ndarray, "n 3"]
    """Perceived nosings in the chair frame of the exposure [m]."""
    summary: str
    """One line for people."""
    is_judged: bool = True
    """Whether a detector has judged the frame; the images of a ROS bag are shown as they are."""
    treads_B: Float[np.ndarray, "k 4 3"] = field(default_factory=lambda: np.zeros((0, 4, 3)))
    """Corners of the detected treads in the chair frame of the exposure [m]."""
    risers_B: Float[np.ndarray, "m 4 3"] = field(default_factory=lambda: np.zeros((0, 4, 3)))
    """Corners of the detected risers in the chair frame of the exposure [m]."""
    picture: bytes | None = None
    """Image with overlay as JPEG; None if no image is kept."""
    depth_m: Float[np.ndarray, "h w"] | None = None
    """Every ``DEPTH_STEP``-th row and column of the depth image [m], kept as long as the picture."""


@dataclass(slots=True, kw_only=True)
class Obstacle:
    """Box in the path from ``t_s``; without a place it has been removed."""

    t_s: float
    centre_W: tuple[float, float, float] | None
    half_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactForces:
    """Normal forces of stair and obstacle on the chair at a tick."""

    t_s: float
    points_W: Float[np.ndarray, "n 3"]
    """Contact points [m]."""
    forces_W: Float[np.ndarray, "n 3"]
    """Forces on the chair [N]."""


@dataclass(slots=True, kw_only=True)
class Tape:
    """Rows, events, phases and camera frames of a run in order of time."""

    events: list[Event] = field(default_factory=list)
    looks: list[Look] = field(default_factory=list)
    obstacles: list[Obstacle] = field(default_factory=list)
    contacts: list[ContactForces] = field(default_factory=list)
    """Contact forces of the ticks at which they were asked for."""
    verdict: str | None = None
    """Verdict of a run that has ended, with its cause; None while it runs or if the log has none."""
    limits: Limits = field(default_factory=Limits)
    """Limits of the run, which plots draw."""
    _memory: Float[np.ndarray, "m c"] = field(default_factory=lambda: np.empty((0, len(COLUMNS))))
    _count: int = 0

    def append(self, rows: Float[np.ndarray, "n c"]) -> None:
        """Append rows, in the order of ``COLUMNS``; the slip ratio follows from the other columns."""
        count = self._count + len(rows)
        if count > len(self._memory):
            grown = np.empty((max(count, 2 * len(self._memory), GROWTH_ROWS), len(COLUMNS)))
            grown[: self._count] = self._memory[: self._count]
            self._memory = grown
        self._memory[self._count : count] = rows
        first = int(np.searchsorted(self._memory[: self._count, 0], float(rows[0, 0]) - 2.0 * SLIP_WINDOW_S)) if len(rows) else 0
        new, self._count = self._count - first, count
        known = self._memory[first:count]
        columns = [known[:, NUMBER[name]] for name in ("left_travel_m", "right_travel_m")]
        slip = slip_ratio(known[:, 0], known[:, PLACE], known[:, ATTITUDE], 0.5 * (columns[0] + columns[1]))
        known[new:, NUMBER["slip"]] = slip[new:]

    def __len__(self) -> int:
        return self._count

    def column(self, name: str) -> Float[np.ndarray, " n"]:
        """Return one quantity of all rows."""
        return self._memory[: self._count, NUMBER[name]]

    @property
    def rows(self) -> Float[np.ndarray, "n c"]:
        """All rows."""
        return self._memory[: self._count]

    @property
    def end_s(self) -> float:
        """Time of the last row [s]; 0 without rows."""
        return float(self._memory[self._count - 1, 0]) if self._count else 0.0

    def index(self, t_s: float) -> int:
        """Return the number of the last row at or before a time; the first row before its time."""
        return max(int(np.searchsorted(self.column("t_s"), t_s + 1e-6, side="right")) - 1, 0)

    def at(self, t_s: float) -> dict[str, float]:
        """Return the quantities of the last row at or before a time.

        Raises:
            IndexError: If the tape is empty.
        """
        return dict(zip(COLUMNS, self._memory[: self._count][self.index(t_s)].tolist(), strict=True))

    @property
    def phases(self) -> tuple[PhaseSpan, ...]:
        """Phases so far; the present one lasts to the last row."""
        return phases_of(self.events, self.end_s)

    def phase_at(self, t_s: float) -> PhaseSpan | None:
        """Return the phase at a time, None before the first."""
        return next((span for span in reversed(self.phases) if span.start_s <= t_s + 1e-6), None)

    def look_at(self, t_s: float) -> Look | None:
        """Return the newest camera frame that the mission had received at a time, None before the first."""
        number = bisect_right([look.taken_s for look in self.looks], t_s + 1e-6)
        return self.looks[number - 1] if number else None

    def fresh_look_at(self, t_s: float) -> Look | None:
        """Return the newest camera frame that the mission had received at a time; None if the camera is silent since then."""
        look = self.look_at(t_s)
        return look if look is not None and t_s - look.taken_s <= SILENT_S + ROUNDING_S else None

    def obstacle_at(self, t_s: float) -> Obstacle | None:
        """Return the obstacle at a time, None without one."""
        number = bisect_right([box.t_s for box in self.obstacles], t_s + 1e-6)
        found = self.obstacles[number - 1] if number else None
        return None if found is None or found.centre_W is None else found

    def contacts_at(self, t_s: float) -> ContactForces | None:
        """Return the contact forces of the last tick at or before a time, None if they were not asked for then."""
        number = bisect_right([found.t_s for found in self.contacts], t_s + 1e-6)
        found = self.contacts[number - 1] if number else None
        return found if found is not None and t_s - found.t_s < 1.5 * TICK_S else None

    def holding_at(self, t_s: float) -> Event | None:
        """Return the event of the hold that lasts at a time, None if the guard does not hold."""
        return holding_at(self.events, t_s)
