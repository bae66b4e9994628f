"""Parameter ranges of random views, for ``draw_view``."""

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np

from treadline.core.camera_images import DepthSensor

STAIR_SCENES = ("up", "top", "foot", "down", "edge", "bottom")
"""Scenes with a stair: the chair is on the flight, near its top or on the floor before it, facing up; or on the flight, on the
landing before its edge or near its foot, facing down."""
ROOM_SCENES = (
    "floor", "wall", "corridor", "corner", "shelf", "table", "boxes", "ramp", "landing", "steep", "ladder", "threshold", "stripes",
    "bench", "pallets",
)  # fmt: skip
"""Scenes without a stair: floors, walls, furniture, ramps, ladders and single steps."""
STEPPED_SCENES = ("carton_steps", "pallet_steps", "drawers", "escalator")
"""Scenes that are stairs by shape; width and context distinguish them from a flight."""
STAIRLESS_SCENES = (
    *ROOM_SCENES, *STEPPED_SCENES, "blinds", "radiator", "chairs", "sofa", "cable_ladder", "crates", "rubble", "corrugated",
    "relief", "kerb", "ramp_turn", "street", "terrace", "podium", "fence",
)  # fmt: skip
"""All scenes without a stair to climb; the later ones have repeated edges: furniture, goods, building parts, street furniture."""
CLUTTER = ("rail_left", "rail_right", "legs", "mat", "bag", "strips", "shadow", "wet")
"""Names of the kinds of clutter."""
TEXTURES = ("wood", "concrete", "carpet", "terrazzo", "dark")
Range = tuple[float, float]
"""Smallest and largest value of a uniform distribution."""
PLACES_M: dict[str, Range] = {
    "up": (0.3, 3.0),
    "top": (0.9, 2.2),
    "foot": (0.8, 1.8),
    "down": (0.3, 3.0),
    "edge": (0.8, 1.3),
    "bottom": (0.9, 2.2),
}
"""Default range of ``place_m`` for each scene [m]."""
ALONE: dict[str, tuple[str, ...]] = {
    "bow_m": ("worn_m", "edge_holes_m", "treads", "runner"),
    "treads": ("worn_m", "edge_holes_m", "runner"),
    "edge_holes_m": ("worn_m", "runner"),
}
"""Shapes of steps that exclude others, because their solids are built from whole boxes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRecipe:
    """Parameter ranges of a view. A range (a, a) fixes the value; of several words one is drawn."""

    scenes: tuple[str, ...] = ("up",)
    slope_deg: Range = (25.0, 35.0)
    rise_m: Range = (0.14, 0.19)
    run_m: Range | None = None
    """Run of the steps. None: run from rise and slope; otherwise the slope follows from rise and run."""
    steps: tuple[int, int] = (14, 22)
    width_m: Range = (1.0, 1.6)
    landing_m: Range = (1.2, 2.5)
    back_wall_deg: Range = (-20.0, 20.0)
    """Yaw of the wall behind the landing."""
    walls: tuple[str, ...] = ("none", "left", "right", "both")
    open_risers: bool = False
    rise_jitter_m: float = 0.0
    run_jitter_m: float = 0.0
    nosing_yaw_jitter_deg: float = 0.0
    tread_tilt_deg: float = 0.0
    """Standard deviation of the tilt of each step about the middle of its nosing, along and across the flight."""
    worn_m: float = 0.0
    """Largest nosing radius of worn steps, which varies along the nosing; zero: sharp nosings."""
    bow_m: Range = (0.0, 0.0)
    """Sagitta of the nosings over the width; positive if the middle protrudes towards the foot of the flight."""
    edge_holes_m: float = 0.0
    """Width of the bands without depth along the edges of the treads, as on metal strips or in the shadow of a nosing."""
    treads: str = "solid"
    """Material: solid, grating, glass or glass_strips. Panes of glass return nothing; their ground front edges do, and strips."""
    runner: bool = False
    """Whether a carpet runner covers the middle of the flight."""
    heading_deg: Range = (-35.0, 35.0)
    lateral_m: Range = (-0.25, 0.25)
    place_m: Range | None = None
    """Position of the chair's middle along the direction of travel: beyond the first nosing (``up``), beyond the landing's edge
    (``down``), before the last nosing ahead (``top``, ``bottom``) or before the first (``foot``, ``edge``); None: ``PLACES_M``."""
    rock_deg: float = 0.0
    """Standard deviation of pitch and roll of the chair relative to nosings or floor."""
    readout_s: float = 0.0
    """Time from the first row to the last of a rolling shutter; zero is a global shutter. About 0.03 s in a Kinect 1."""
    speed_m_s: Range = (0.0, 0.0)
    """Speed of the chair along its own x axis during the readout."""
    turn_rate_deg_s: float = 0.0
    """Standard deviation of the rates of roll, pitch and yaw during the readout."""
    sensor: DepthSensor | Literal["ideal"] = "kinect1"
    sensor_known: bool = False
    """Whether the frame's calibration names the sensor."""
    sigma_px: float | None = None
    """Standard deviation of the disparity noise of a Kinect 1, D435 or D455 [sensor px]. None: the sensor's default."""
    edge_holes: bool = False
    """Whether a Kinect 1 loses the pixels whose correlation window contains a depth jump, as recorded frames do."""
    grain_px: float = 0.0
    """Correlation length of the depth noise, in sensor pixels, as a standard deviation; zero is white noise. About 1.2 in a Kinect
    1 due to its matching windows of nine pixels; the Kinect 2 model has its own correlation."""
    warp_px: float = 0.0
    """Smooth depth error across the image, in pixels of Kinect 1 disparity: about 0.1 with factory calibration."""
    holes: float = 0.0
    """Fraction of the depth image lost in blotches, as in sunlight."""
    missing: float = 0.0
    """Fraction of the pixels without depth, each independent of its neighbours."""
    hole_filling: str = ""
    """How the driver fills pixels without depth: one of ``bad_pixels.HOLE_FILLINGS``."""
    flying: float = 0.0
    """Fraction of the pixels next to a depth jump whose depth lies between both sides."""
    height_px: int | None = None
    """Image height. None: the sensor's default: 240, 424 for the Kinect 2, 480 for stereo, 576 for tof."""
    focal_px: float | None = None
    """Focal length. None: the sensor's default."""
    focal_error: float = 0.0
    """Standard deviation of the relative error of the calibrated focal length."""
    pitch_deg: Range | None = None
    """Downward pitch of the camera mount. None: as in the chair file."""
    mount_pitch_error_deg: Range = (0.0, 0.0)
    """Pitch of the true mount minus pitch of the calibrated mount."""
    mount_roll_error_deg: Range = (0.0, 0.0)
    """Roll of the true mount minus roll of the calibrated mount."""
    gravity_error_deg: float = 0.5
    """Error of the measured gravity direction, towards a random side."""
    textures: tuple[str, ...] = TEXTURES
    light: Range = (0.35, 1.6)
    blur_px: Range = (0.0, 0.0)
    """Length of the motion blur of the colour image."""
    clutter: tuple[str, ...] = ()
    clutter_chance: float = 1.0
    """Probability of each kind of clutter."""

    def __post_init__(self) -> None:
        """Reject shapes of steps that exclude each other."""
        given = {field.name for field in fields(self) if getattr(self, field.name) != field.default}
        for name, others in ALONE.items():
            for other in given.intersection(others) if name in given else ():
                raise ValueError(f"{name} with {other} is not supported; give one of them")


def drawn(limits: Range, rng: np.random.Generator) -> float:
    """Return a random number in a range."""
    return float(rng.uniform(*limits))
