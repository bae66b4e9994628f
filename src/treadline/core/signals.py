"""Signals exchanged between blocks at each tick.

All are frozen dataclasses in SI units, with the unit in the name. ``t_s`` is the mission-clock time of a measurement (sensors) or
of a computation (commands). A missing measurement is ``None``, never NaN or zero.

Frames (see docs/frames.md): W world, z up, x up the flight, origin on the floor below the first nosing, mid-width; S stair, x up
the flight in the plane of the nosings, y left along the nosings, z normal to the plane, origin on the first nosing; B chair, x
forward, y left, z up, origin mid-track on the lower line of the belts; C camera, x right, y down, z forward.

Heading: rotation of the chair about the normal of the nosing plane, zero when square to the nosings and facing up the flight,
positive anticlockwise seen from above.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, Generic, Literal, TypeVar

from treadline.core.angles import tilt_of
from treadline.core.errors import RecordError, ShapeMismatch

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""Unit quaternion (w, x, y, z)."""
Direction = Literal["up", "down"]
"""Direction of a traversal, or of the flight ahead: rising or falling."""
SideKind = Literal["wall", "open"]
"""What follows beyond the side of a flight: a wall or rail, or a drop."""

TICK_S = 0.01
"""Base period of mission and plant [s]: the sample period of the IMU (Table I: 100 Hz)."""
STATE_TICKS = 10
"""Ticks between two messages of the plant's state, and of the ground truth on a bus, which no node subscribes to."""
PERIOD_ROUNDING_S = 1e-9
"""Largest difference between two equal periods after rounding [s]."""
ROUNDING_S = 1e-6
"""Largest difference between two time stamps of the same tick after rounding [s]."""


def on_the_tick(period_s: float) -> bool:
    """Return whether a period is an integer multiple of the tick."""
    return (
        isinstance(period_s, Real)
        and 0.5 * TICK_S < period_s < math.inf
        and abs(round(period_s / TICK_S) * TICK_S - period_s) <= PERIOD_ROUNDING_S
    )


def _numbers(name: str, given: Iterable[Any], count: int) -> tuple[Any, ...]:
    """Return so many numbers, of an array or another sequence, as a tuple of floats.

    Raises:
        RecordError: If one is not a number.
        ShapeMismatch: If there are more or fewer.
    """
    try:
        values = tuple(map(float, given))
    except (TypeError, ValueError):
        raise RecordError(f"{name} is {given!r}; wanted {count} numbers") from None
    if len(values) != count:
        raise ShapeMismatch(f"{name} has {len(values)} numbers; wanted {count}")
    return values


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuSample:
    """One sample of the chair's IMU, expressed in the chair frame B. Arrays are accepted, and kept as tuples.

    Raises:
        RecordError: If a field is not of numbers.
        ShapeMismatch: If a field has another length.
    """

    t_s: float
    orientation: Quaternion
    """Attitude of B in a horizontal frame whose yaw has an arbitrary zero and drifts."""
    angular_velocity_rad_s: Vector
    linear_acceleration_m_s2: Vector
    """Specific force [m/s²]: +g along z at rest on horizontal ground."""

    @property
    def pitch_rad(self) -> float:
        """Pitch of the chair from horizontal [rad], front up positive."""
        return tilt_of(self.orientation)[0]

    def __post_init__(self) -> None:
        for name, count in (("orientation", 4), ("angular_velocity_rad_s", 3), ("linear_acceleration_m_s2", 3)):
            given = getattr(self, name)
            if type(given) is not tuple or len(given) != count:
                object.__setattr__(self, name, _numbers(name, given, count))


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatReading:
    """Pitch of the seat's own IMU and stroke of the seat actuator. Pitch is positive when the seat leans back (front up)."""

    t_s: float
    pitch_rad: float
    stroke_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackReading:
    """Belt speeds reported by the motor drives."""

    t_s: float
    left_m_s: float
    right_m_s: float
    brake_on: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipperReading:
    """Angle and motor torque of the flipper, the front track section on the front pulley's axis.

    The angle is zero in line with the flat run of the belt and positive above it; a positive torque raises the flipper.
    """

    t_s: float
    angle_rad: float
    torque_n_m: float
    """Motor torque after the gear, both sides together [N m]."""


CLIMB_MOST_M_S = 0.3
"""Largest speed of the belts on a flight that scenario, robot file and exported controller accept [m/s]."""
BUTTONS = ("stop", "rearm", "flight_ends", "go_back")
"""Buttons of the operator's handset, as named in ``OperatorInput`` and, after the dead-man switch, in its messages."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorInput:
    """State of the operator's handset: dead-man switch, buttons for stop and re-arm, and two answers to the planner."""

    t_s: float
    dead_man: bool = True
    stop: bool = False
    rearm: bool = False
    flight_ends: bool = False
    """Button "this is the end": the nosing that the planner knows as the last one is the last of the flight."""
    go_back: bool = False
    """Button "go back": leave the flight to where the traversal began."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """State of the actuators: their watchdog, and their battery."""

    t_s: float
    fault: str | None
    """Reason for which the plant braked by itself; None without one."""
    battery_v: float | None = None
    """Voltage of the battery; None if it is not measured."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingMeasurement:
    """Heading measured from one camera frame."""

    t_s: float
    heading_rad: float
    sigma_rad: float
    edge_count: int
    correction_rad: float = 0.0
    """Heading by the corrected camera mount minus the heading by the mount of the frame before, from this frame [rad]; 0 unless the
    correction changed with this frame. Earlier headings had this error."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StairMap:
    """Map of the stair ahead measured from one frame, in the chair frame B. Arrays are accepted, and kept as tuples.

    Raises:
        RecordError: If a nosing is not of numbers.
        ShapeMismatch: If a nosing has not three coordinates.
    """

    t_s: float
    direction: Direction
    """Direction of the flight ahead: rising or falling."""
    nosings_B: tuple[Vector, ...]
    """Intersections of the visible nosings with the chair's middle plane (y = 0), nearest first [m]."""
    rise_m: float
    run_m: float
    slope_rad: float
    ends: bool
    """Whether the last of ``nosings_B`` is the last nosing of the flight: a landing or a floor follows."""
    left_wall_m: float | None
    """Free width from the chair's middle plane to the wall or rail on the left [m]; None if none is visible."""
    right_wall_m: float | None
    """Free width from the chair's middle plane to the wall or rail on the right [m]; None if none is visible."""
    obstacle_m: float | None
    """Distance along x in the camera's viewing direction from B to the nearest obstacle in the volume swept by the chair [m]; None
    if free."""
    left_edge_m: float | None = None
    """Distance from the chair's middle plane to the flight's left side [m]; None if it is not in view, which is no width."""
    right_edge_m: float | None = None
    """Distance from the chair's middle plane to the flight's right side [m]; None if it is not in view."""
    left_side: SideKind | None = None
    """What follows beyond the left side: a wall or rail, or a drop; None if the side is not in view."""
    right_side: SideKind | None = None
    """What follows beyond the right side; None if it is not in view."""
    left_seen_m: float | None = None
    """Distance from the chair's middle plane to which nosings are in view on the left [m], a lower bound of the width; negative if
    they are in view on the right alone. None if the detector does not measure it: the mission then does not check the width of this
    side before it enters the flight."""
    right_seen_m: float | None = None
    """The same on the right [m]."""
    turn_rad: float | None = None
    """Turn of the step that follows the last of ``nosings_B`` relative to the flight, positive to the left [rad]; None unless one
    is in view. Without ``ends`` no landing lies before it: the steps that follow are winders."""

    def __post_init__(self) -> None:
        if type(self.nosings_B) is not tuple:
            object.__setattr__(self, "nosings_B", tuple(_numbers("a nosing", place, 3) for place in self.nosings_B))

    @property
    def width_m(self) -> float | None:
        """Width of the flight [m]; None unless both sides are in view."""
        if self.left_edge_m is None or self.right_edge_m is None:
            return None
        return self.left_edge_m + self.right_edge_m


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameQuality:
    """Quality measures of one frame, for the detection of dark, frozen and empty images."""

    t_s: float
    fingerprint: int
    """Hash of the depth image: equal for equal images, different for all other images of a camera."""
    brightness: float
    """Mean of the colour image, 0 to 1; 0.5 if the colour image was not evaluated."""
    contrast: float
    """Standard deviation of the colour image, 0 to 0.5; 0.25 if the colour image was not evaluated."""
    valid_share: float
    """Fraction of depth pixels with a return, 0 to 1."""
    obstacle_m: float | None = None
    """Distance from mid-track to the nearest obstacle on the ground ahead of the camera [m]; None if free or not evaluated."""


View = Literal["front", "rear"]
"""Viewing direction of a camera: that of the chair's x axis, or the opposite."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeGround:
    """Ground ahead of a camera, from one frame: how far it was seen, and where it ends.

    Ground bears the chair on its present level: floor, landing, or what rises from them (a riser, a wall). It ends at a drop: the
    uppermost nosing of a falling flight, the rim of a landing or a dock, a kerb. Distances are horizontal, from mid-track in the
    viewing direction, and hold over the whole width that the chair sweeps. Ground that was not seen is not free.
    """

    t_s: float
    view: View
    blind_m: float
    """Distance from which on ground can be in view [m]; nearer ground is below the image."""
    seen_m: float
    """Distance up to which ground was seen without a gap from ``blind_m`` on [m]; ``blind_m`` if none was seen."""
    end_m: float | None = None
    """Distance of the nearest point of the edge where the ground ends [m]; None if no end is in view."""
    end_sigma_m: float | None = None
    """Standard deviation of ``end_m`` [m]; None without an end."""
    direction_rad: float | None = None
    """Rotation of that edge about the vertical [rad]: zero square to the viewing direction, positive anticlockwise seen from above.
    None if the edge does not cross the whole width."""
    direction_sigma_rad: float | None = None
    """Standard deviation of ``direction_rad`` [rad]; None without it."""
    drop_m: float | None = None
    """Depth of what is in view below the edge [m]; None if nothing is."""
    sides_B: tuple[Vector, ...] = ()
    """Ends of the sides of a landing in view, two of each side: edges, walls and risers, horizontal from mid-track [m]."""

    def __post_init__(self) -> None:
        if type(self.sides_B) is not tuple:
            object.__setattr__(self, "sides_B", tuple(_numbers("a side's end", place, 3) for place in self.sides_B))


Source = Literal["vision", "gyro"]
"""Sensor behind a heading estimate: vision, or the gyro between accepted vision measurements."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingEstimate:
    """Output of the heading filter at one tick."""

    t_s: float
    heading_rad: float
    heading_rate_rad_s: float
    sigma_rad: float
    source: Source


HeadingFault = Literal["stuck", "disagreement", "drift", "jump"]
"""Kinds of sensor faults in descending severity; the most severe active fault is reported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingHealth:
    """State of the heading filter's fault detection at one instant."""

    t_s: float
    fault: HeadingFault | None
    """Most severe active fault. ``drift``: step of the gyro bias; ``jump``: jump of the gyro; ``stuck``: constant gyro reading
    while the belts move. These three are corrected as far as vision permits. ``disagreement``: vision and gyro differ, cause
    unknown."""
    since_s: float | None
    """Time at which the fault was detected [s]."""
    cause: str | None
    """Description of the evidence, with its number."""
    disagreement_rad: float
    """Last vision heading minus prediction [rad] if rejected, else zero."""
    unseen_s: float
    """Time since the last accepted heading [s]."""
    bias_rad_s: float
    scale: float
    walk_rad_rts: float
    """Estimated gyro angle random walk [rad/√s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackCommand:
    """Commanded speeds of the two belts.

    Positive drives the chair up the stair. Turning left (heading increases) needs ``right_m_s > left_m_s``.
    """

    t_s: float
    left_m_s: float
    right_m_s: float
    brake: bool = False
    sender: str = field(default="chair", compare=False)
    """Frame name of the message: the id of the guard that sent the command; ``chair`` in one process."""

    @classmethod
    def stop(cls, t_s: float) -> "TrackCommand":
        """Return zero speed with the brake on."""
        return cls(t_s=t_s, left_m_s=0.0, right_m_s=0.0, brake=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityCommand:
    """Speed and turn rate of a joystick or another planner, ROS's ``/cmd_vel``."""

    t_s: float
    speed_m_s: float
    """Speed of mid-track, positive forwards [m/s]."""
    turn_rad_s: float
    """Rate of turn, positive anticlockwise seen from above [rad/s]."""


CommandSource = Literal["driver", "velocity"]
"""Whose commands move the belts: those of the driver, or velocity commands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatCommand:
    """Commanded rate of the seat actuator; positive lengthens the stroke."""

    t_s: float
    rate_m_s: float
    sender: str = field(default="chair", compare=False)
    """Frame name of the message: the id of the guard that sent the command; ``chair`` in one process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipperCommand:
    """Commanded rate of the flipper; positive raises the flipper."""

    t_s: float
    rate_rad_s: float
    sender: str = field(default="chair", compare=False)
    """Frame name of the message: the id of the guard that sent the command; ``chair`` in one process."""


Phase = Literal[
    "search", "align", "approach", "mount", "traction", "climb", "crest", "land",
    "edge", "descend", "leave", "back_off", "drive", "arrived", "refused", "turn",
]  # fmt: skip
"""State of the traversal state machine. ``drive`` is a flight without mount and crest (experiments); ``arrived`` and ``refused``
are terminal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionPlan:
    """Phase of the traversal and the motion requested of belts and flipper."""

    t_s: float
    phase: Phase
    speed_m_s: float
    """Mean belt speed [m/s]; negative drives backwards."""
    turn_m_s: float | None = None
    """Half the difference of the belt speeds, right minus left [m/s]; None: the heading controller steers."""
    heading_rad: float = 0.0
    """Heading set point of the heading controller [rad]."""
    min_inner_speed_ratio: float | None = None
    """Smallest ratio of inner-belt speed to climb speed during a turn; a smaller ratio turns faster and rolls back further. None:
    the heading controller's own limit."""
    pitch_feedforward_m_s: float = 0.0
    """Speed added to both belts at each tick [m/s], in every steering mode, to follow a chair that tips over a nosing."""
    flipper: FlipperCommand | None = None
    """Flipper command of this tick; None stops the flipper."""
    needs_stair: bool = True
    """Whether a stair must be in view: false over the crest, on landings and on the last steps."""
    cause: str = ""
    """Reason for the transition to this phase: the observation with its value."""
    hold: str | None = None
    """Reason for a permanent stop if the planner has no further action; the guard latches it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Event for the operator: a refusal, a hold, a limit reached."""

    t_s: float
    name: str
    """Name: ``hold``, ``rearmed``, ``slow``, ``resumed``, ``re-referenced``, ``vision_dim``, ``vision_clear``, ``seat_shifted``,
    ``refused``, ``camera_calibration``, ``camera_mount``, ``imu_axes``, ``imu_tilt``, ``rejected``, ``rearm_refused``,
    ``drop_unwatched``, ``map_unwatched``, ``health_unwatched``, ``source``, ``dropped``, ``clock``, ``guard_process``, or the phase
    entered; ``ended`` in a recording. Other publishers on the topic use other names."""
    cause: str
    """Observation behind the event, with its value."""


T = TypeVar("T")
MEMORY_S = 3.0
"""Greatest age of a message that is used, and of what is remembered to place it [s]: the guard's longest timeout (hazard row 1)."""


class Recent(Generic[T]):
    """Values of a signal in the last ``MEMORY_S`` by time: the chair's state when a late frame was exposed."""

    def __init__(self) -> None:
        self._values: deque[tuple[float, T]] = deque()

    def add(self, t_s: float, value: T) -> None:
        """Append the value at ``t_s``, and forget what no message can ask for any more."""
        self._values.append((t_s, value))
        while t_s - self._values[0][0] > MEMORY_S + ROUNDING_S:
            self._values.popleft()

    def at(self, t_s: float) -> T | None:
        """Return the value whose stamp is nearest to ``t_s``, the newest of several; None before the first value."""
        nearest, least_s = None, math.inf
        for stamp_s, value in reversed(self._values):
            off_s = abs(stamp_s - t_s)
            if off_s > least_s:
                break  # older ones are further off
            if off_s < least_s:
                nearest, least_s = value, off_s
        return nearest

    def copy(self) -> "Recent[T]":
        """Return an independent history with the same values."""
        twin: Recent[T] = Recent()
        twin._values = self._values.copy()
        return twin
