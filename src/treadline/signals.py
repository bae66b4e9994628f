"""The values that travel between blocks each tick.

All are frozen, in SI units with the unit in the name, and carry ``t_s``, the time on the mission clock at which the
value was true (sensors) or computed (commands). "No measurement" is ``None``, never NaN and never zero.

Frames (see docs/frames.md): W world, z up, x up the flight, origin on the floor below the first nosing, mid-width;
S stair, x up the flight in the plane of the nosings, y left along them, z its normal, origin on the first nosing;
B chair, x forward, y left, z up, origin mid-track on the belts' lower line; C camera, x right, y down, z forward.

Heading: rotation of the chair about the nosing plane's normal, zero when square to the nosings and facing up the
flight, positive anticlockwise seen from above.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from numbers import Real
from typing import Literal

import numpy as np
from jaxtyping import Float, Float32, UInt8

from treadline import paper
from treadline.angles import rotation_x, rotation_y, rotation_z, tilt_of
from treadline.arrays import shaped

TICK_S = 1.0 / paper.IMU_RATE_HZ
"""Base period of mission and plant: the IMU's."""
PERIOD_ROUNDING_S = 1e-9
"""By which two periods that are meant to be one may differ."""

CAMERA_AXES_IN_CHAIR = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation of C in B for a camera that looks straight ahead: columns are x_C (right), y_C (down), z_C (forward)."""
CAMERA_AXES_IN_CHAIR.setflags(write=False)

IMU_ARRAYS = ("orientation", "angular_velocity_rad_s", "linear_acceleration_m_s2")
IMU_SHAPES = ((4,), (3,), (3,))
"""Of an IMU's sample: a quaternion and two vectors."""


def on_the_tick(period_s: float) -> bool:
    """Say whether a period is some whole number of ticks."""
    return (
        isinstance(period_s, Real)
        and 0.5 * TICK_S < period_s < math.inf
        and abs(round(period_s / TICK_S) * TICK_S - period_s) <= PERIOD_ROUNDING_S
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PinholeCamera:
    """A camera's calibration and its mount on the chair. Pixel centres are integers."""

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    mount_pitch_rad: float = 0.0
    """Down from the chair's forward axis."""
    mount_roll_rad: float = 0.0
    mount_yaw_rad: float = 0.0
    """The mount turns yaw, then pitch, then roll."""
    mount_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of C in B."""

    @property
    def R_BC(self) -> Float[np.ndarray, "3 3"]:
        """Rotation of the camera in the chair's frame."""
        return _turned(self.mount_yaw_rad, self.mount_pitch_rad, self.mount_roll_rad).copy()


@lru_cache(maxsize=64)
def _turned(yaw_rad: float, pitch_rad: float, roll_rad: float) -> Float[np.ndarray, "3 3"]:
    """Return the rotation of a mount, which every frame of a camera asks for."""
    return np.asarray(rotation_z(yaw_rad) @ rotation_y(pitch_rad) @ rotation_x(roll_rad) @ CAMERA_AXES_IN_CHAIR)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RgbdFrame:
    """Colour and depth of one instant, registered to each other."""

    t_s: float
    rgb: UInt8[np.ndarray, "h w 3"]
    depth_m: Float32[np.ndarray, "h w"]
    """Distance along the optical axis; NaN where there was no return."""
    camera: PinholeCamera


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImuSample:
    """One reading of the chair's IMU, in the chair's frame."""

    t_s: float
    orientation: Float[np.ndarray, " 4"]
    """Unit quaternion (w, x, y, z) of B in a level frame whose yaw has an arbitrary zero and drifts."""
    angular_velocity_rad_s: Float[np.ndarray, " 3"]
    linear_acceleration_m_s2: Float[np.ndarray, " 3"]
    """Specific force: +g along z when at rest and level."""

    @property
    def pitch_rad(self) -> float:
        """Of the chair against the level, front up positive."""
        return tilt_of(self.orientation.tolist())[0]

    def __post_init__(self) -> None:
        try:
            shapes = self.orientation.shape, self.angular_velocity_rad_s.shape, self.linear_acceleration_m_s2.shape
        except AttributeError:
            shapes = None
        if shapes != IMU_SHAPES:
            for name, shape in zip(IMU_ARRAYS, IMU_SHAPES, strict=True):
                object.__setattr__(self, name, shaped(name, getattr(self, name), shape, f"{shape[0]} numbers"))


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatReading:
    """The seat's own IMU and its actuator. Pitch is positive when the seat leans back (front up)."""

    t_s: float
    pitch_rad: float
    stroke_m: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackReading:
    """Belt speeds as the drives report them."""

    t_s: float
    left_m_s: float
    right_m_s: float
    brake_on: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipperReading:
    """The front track section as its drive reports it: a flipper on the front pulley's axis.

    The angle is zero in line with the flat run and positive above it; a positive torque raises the flipper.
    """

    t_s: float
    angle_rad: float
    torque_n_m: float
    """Of the motor, both sides together, after its gear."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OperatorInput:
    """What the person in charge holds or presses."""

    t_s: float
    dead_man: bool = True
    stop: bool = False
    rearm: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingMeasurement:
    """Heading seen in one frame."""

    t_s: float
    heading_rad: float
    sigma_rad: float
    edge_count: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairAxes:
    """The stair's directions as one frame shows them, in C: what is believed of the mount has no part in them."""

    t_s: float
    edge_C: Float[np.ndarray, " 3"]
    """Unit vector along the nosings, pointing right."""
    down_C: Float[np.ndarray, " 3"]
    """Unit vector square to the treads and to ``edge_C``: where gravity points on a stair that is level."""
    normal_C: Float[np.ndarray, " 3"]
    """Unit vector square to the plane through the nosings, pointing away from the stair."""
    edge_sigma_rad: float
    """Of the edge's direction about ``normal_C``."""
    down_sigma_rad: float
    """Of ``down_C`` about the edge."""
    normal_sigma_rad: float
    """Of ``normal_C`` about the edge."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StairMap:
    """The stair ahead as one frame shows it, in the chair's frame B."""

    t_s: float
    direction: Literal["up", "down"]
    """Whether the flight ahead rises or falls."""
    nosings_B: Float[np.ndarray, "n 3"]
    """Where each nosing seen meets the chair's middle plane (y = 0), the nearest first [m]."""
    rise_m: float
    run_m: float
    slope_rad: float
    ends: bool
    """Whether the last of ``nosings_B`` is the flight's last: beyond it lies a landing or a floor."""
    left_wall_m: float | None
    """Free width from the chair's middle to the wall or rail at the left, square to it; None if none is seen."""
    right_wall_m: float | None
    obstacle_m: float | None
    """Along x, to the side that the camera looks to, from B to the nearest thing that stands in the volume the chair will sweep;
    None if that is free."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameQuality:
    """What tells a frame worth looking at from one that is dark, frozen or empty."""

    t_s: float
    fingerprint: int
    """Equal for frames whose depths are equal, and for no others that a camera makes."""
    brightness: float
    """Mean of the colour image, 0 to 1; one half where depth alone is enough and nobody looked."""
    contrast: float
    """Standard deviation of the colour image, 0 to 0.5; a quarter where nobody looked."""
    valid_share: float
    """Of the depth image that has a depth, 0 to 1."""
    obstacle_m: float | None = None
    """How far ahead of mid-track something stands on the ground where the camera looks; None if nothing, or not asked."""


Source = Literal["vision", "gyro"]
"""What a heading rests on: the gyro while it coasts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingEstimate:
    """Heading carried between frames."""

    t_s: float
    heading_rad: float
    heading_rate_rad_s: float
    sigma_rad: float
    source: Source


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackCommand:
    """Belt speeds asked of the two tracks.

    Positive drives the chair up the stair. Turning left (heading grows) needs ``right_m_s > left_m_s``.
    """

    t_s: float
    left_m_s: float
    right_m_s: float
    brake: bool = False

    @classmethod
    def stop(cls, t_s: float) -> "TrackCommand":
        """Return zero speed with the brake on."""
        return cls(t_s=t_s, left_m_s=0.0, right_m_s=0.0, brake=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeatCommand:
    """Rate asked of the seat's actuator; positive lengthens the stroke."""

    t_s: float
    rate_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class FlipperCommand:
    """Rate asked of the front track section; positive raises it."""

    t_s: float
    rate_rad_s: float


Phase = Literal[
    "search", "align", "approach", "mount", "traction", "climb", "crest", "land",
    "edge", "descend", "leave", "back_off", "drive", "arrived", "refused",
]  # fmt: skip
"""Where a traversal is. ``drive`` is the flight alone, for experiments; the last two are ends."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionPlan:
    """What a traversal is about now, and what it asks of belts and flipper."""

    t_s: float
    phase: Phase
    speed_m_s: float
    """Mean of the belts; negative backs down."""
    turn_m_s: float | None = None
    """Half the belts' difference, right less left; None leaves steering to the heading controller."""
    heading_rad: float = 0.0
    """What the heading controller steers to."""
    min_inner_speed_ratio: float | None = None
    """Of the speed, kept by the slower belt of a chair that climbs and turns: less turns faster and slides further. None leaves it
    to the heading controller."""
    pitch_feedforward_m_s: float = 0.0
    """Added to both belts at each tick, whoever steers: they go with a chair that falls over a nosing."""
    flipper: FlipperCommand | None = None
    needs_stair: bool = True
    """Whether a stair should be in view: not over the crest, on a landing or on the last steps."""
    cause: str = ""
    """Why this phase began: what was seen, with its number."""
    hold: str | None = None
    """Why the chair must stop for good, where the plan knows no further; the guard latches it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something worth telling a person: a refusal, a hold, a limit reached."""

    t_s: float
    name: str
    """``hold``, ``rearmed``, ``slow``, ``resumed``, ``re-referenced``, ``vision_dim``, ``vision_clear``, ``seat_shifted``,
    ``refused``, or the phase that begins; ``dropped`` and ``ended`` in a recording; others on the same topic say
    what they like."""
    cause: str
    """What was seen, with its number."""


Reading = (
    RgbdFrame
    | ImuSample
    | SeatReading
    | TrackReading
    | FlipperReading
    | HeadingMeasurement
    | StairMap
    | FrameQuality
    | OperatorInput
)
"""What a plant can hand over; a camera that looks for itself gives ``FrameQuality``, ``HeadingMeasurement`` and ``StairMap``."""
