"""Chair description from a file: tracks with three pulleys, masses, seat, drives and camera mounts.

Paper: Section II, Table I. All positions are in B: x forward, y left, z up, origin mid-track on the lower line of the belts.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.errors import SettingsError
from treadline.core.settings import Pairs, Settings, read_toml, settings_of
from treadline.core.signals import TICK_S
from treadline.scenario.camera_file import KINECT_1, CameraFile, Degrees, read_camera
from treadline.scenario.shipped_files import CHAIRS, file_named

GRAVITY_M_S2 = 9.81
"""Acceleration of gravity [m/s²]."""
EMPTY_SEAT_KG = 0.5
"""Mass of the seat shell, which rotates with the payload [kg]."""
ROUNDING = 1e-9
"""Relative rounding of moments of inertia in a file."""
SWEPT_SPARE_M = 0.025
"""Clearance on either side of a chair within which an object counts as an obstacle [m]."""


def _a_tick_or_more(lag_s: float) -> float:
    """Return a lag after checking that it is at least one tick."""
    if lag_s < TICK_S:
        raise ValueError(
            f"a lag of {lag_s:g} s is below the tick of {TICK_S:g} s; give {TICK_S:g} s or more: drives are integrated once a "
            "tick, and a shorter lag has no effect"
        )
    return lag_s


def _above_zero(torque_n_m: float) -> float:
    """Return a torque limit after checking that it is positive."""
    if torque_n_m <= 0.0:
        raise ValueError(
            f"a torque limit of {torque_n_m:g} N·m; give more than 0: the limit holds in both directions, and a motor without "
            "torque is no [flipper] at all"
        )
    return torque_n_m


def _two_or_more(road_wheels: int) -> int:
    """Return a number of road wheels after checking that both ends of the flat run stand on one."""
    if road_wheels < 2:
        raise ValueError(
            f"{road_wheels} road wheel under each flat run; give 2 or more: both ends stand on a wheel, and a chair on one wheel "
            "a side falls over"
        )
    return road_wheels


# Bounds far beyond any chair, so that a slipped unit or digit shows.
Length = Annotated[float, Field(gt=0.0, le=10.0)]
Place = Annotated[float, Field(ge=-10.0, le=10.0)]
Mass = Annotated[float, Field(gt=0.0, le=1000.0)]
Speed = Annotated[float, Field(gt=0.0, le=10.0)]
Lag = Annotated[float, Field(le=10.0), AfterValidator(_a_tick_or_more)]
Torque = Annotated[float, Field(le=1e4), AfterValidator(_above_zero)]
Point = tuple[Place, Place, Place]
Faces = Literal["up", "down"]
"""Where an occupant looks on a stair, on the way up as on the way down."""
Size = tuple[Length, Length, Length]


class Tracks(Settings):
    """Two belts, each over a rear, a front and a raised nose pulley (three-pulley mechanism, Fig. 3b)."""

    flat_run_m: Length
    """Distance between the centres of rear and front pulley: the part in contact with the stair."""
    approach_m: Length
    """Distance between the centres of front and nose pulley."""
    approach_angle_deg: Annotated[float, Field(ge=0.0, le=80.0)]
    """Angle of attack: angle of the nose section above the flat run."""
    pulley_radius_m: Length
    nose_radius_m: Length | None = None
    """Radius of the nose pulley. Unset: that of the others."""
    gauge_m: Length
    """Distance between the belts' centre lines."""
    belt_width_m: Length
    road_wheels: Annotated[int, Field(le=20), AfterValidator(_two_or_more)] = 6
    """Number of wheels that carry each flat run on level ground, evenly spaced, the end ones below the pulleys. From 6 on, even or
    odd, the chair turns within 4 % of a belt loaded along its whole length; 2 wheels load its ends alone."""


class Masses(Settings):
    """Mass and inertia of the chassis without payload, seat included."""

    chassis_kg: Mass
    chassis_com_m: Point
    chassis_size_m: Size
    """Edges of the box that touches the stair; of a uniform one with the inertia of the chassis, unless that is given."""
    hull_m: Point | None = None
    """Centre of that box. Unset: the centre of mass."""
    inertia_kg_m2: tuple[float, float, float, float, float, float] | None = None
    """Moments and products of inertia of the chassis about its centre of mass, along B's axes: xx, yy, zz, xy, xz, yz."""

    @model_validator(mode="after")
    def _a_body_has_this_inertia(self) -> "Masses":
        if self.inertia_kg_m2 is None:
            return self
        xx, yy, zz, xy, xz, yz = self.inertia_kg_m2
        low, middle, high = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]).tolist()
        if low <= 0.0 or high > (low + middle) * (1.0 + ROUNDING):
            raise ValueError(
                f"masses.inertia_kg_m2 has principal moments of {low:.4g}, {middle:.4g} and {high:.4g}; of a body each is above 0 "
                "and none is larger than the two others together"
            )
        return self

    @property
    def hull_centre_m(self) -> Point:
        """Centre of the box that touches the stair [m]."""
        return self.hull_m or self.chassis_com_m


class Seat(Settings):
    """Seat, its hinge and the slider-bar linkage for levelling (Section II.B)."""

    hinge_m: Point
    payload_com_m: Point
    """Centre of mass of the payload relative to the hinge, with the seat parallel to the chassis."""
    payload_size_m: Size
    bar_m: Length
    """Length of the bar from slider to seat."""
    lever_arm_m: Length
    """Distance from the hinge to the bar's pin on the seat."""
    slider_drop_m: Length
    """Height of the hinge above the slider rail."""
    stroke_m: tuple[Place, Place]
    """Slider positions at the two ends of the actuator, measured rearward from below the hinge."""
    max_rate_m_s: Speed
    lag_s: Lag
    """First-order lag of the actuator."""
    push_n: Annotated[float, Field(gt=0.0, le=1e5)] | None = None
    """Stall force of the actuator, decreasing linearly to zero at ``no_load_m_s``. None: no force limit."""
    no_load_m_s: Speed | None = None
    hold_n: Annotated[float, Field(gt=0.0, le=1e5)] | None = None
    """Holding force of the actuator's screw at standstill."""

    @model_validator(mode="after")
    def _a_limit_is_whole(self) -> "Seat":
        given = [value is not None for value in (self.push_n, self.no_load_m_s, self.hold_n)]
        if any(given) and not all(given):
            raise ValueError("give push_n, no_load_m_s and hold_n together, or none: they are one actuator")
        if self.no_load_m_s is not None and self.no_load_m_s < self.max_rate_m_s:
            raise ValueError(
                f"seat.no_load_m_s is {self.no_load_m_s:g}, below max_rate_m_s of {self.max_rate_m_s:g}: the actuator never "
                "reaches that rate"
            )
        return self


class Payload(Settings):
    """Payload of a chair without a seat linkage: a box fixed to the chassis."""

    com_m: Point
    """Centre of mass of the payload in B."""
    size_m: Size
    """Edges of the uniform box with the inertia of the payload."""


class Drives(Settings):
    """Belt motors with their inner speed loop."""

    max_speed_m_s: Speed
    lag_s: Lag
    """First-order lag from command to belt speed."""
    max_acceleration_m_s2: Annotated[float, Field(gt=0.0, le=100.0)]
    brake_hold_n: Annotated[float, Field(gt=0.0, le=1e5)]
    """Holding force of each belt's brake."""


class Motor(Settings):
    """Motor and gear of one belt: the belt force decreases linearly from stall to no load."""

    peak_force_n: Annotated[float, Field(gt=0.0, le=1e5)]
    """Belt force at stall and nominal voltage."""
    no_load_speed_m_s: Speed
    """Belt speed without load at nominal voltage."""
    continuous_force_n: Annotated[float, Field(gt=0.0, le=1e5)]
    """Belt force at thermal equilibrium; the limit of a hot motor."""
    thermal_time_s: Annotated[float, Field(ge=1.0, le=1e5)]
    """Time constant of the motor's heating."""
    moving_mass_kg: Mass
    """Equivalent mass at the belt of rotor, gear and belt."""
    nominal_v: Annotated[float, Field(gt=0.0, le=1000.0)]


class Battery(Settings):
    """Battery of both motors."""

    full_v: Annotated[float, Field(gt=0.0, le=1000.0)]
    """Open-circuit voltage of a full battery; linear in the charge down to ``empty_v``."""
    empty_v: Annotated[float, Field(gt=0.0, le=1000.0)]
    resistance_ohm: Annotated[float, Field(ge=0.0, le=100.0)]
    """Internal resistance, cables included."""
    capacity_wh: Annotated[float, Field(gt=0.0, le=1e6)]


class Flipper(Settings):
    """Motor on the front pulley's axis that rotates the approach section: a variable angle of attack.

    The section itself is described in ``tracks``: ``approach_m`` is the flipper's length, ``approach_angle_deg`` its rest angle.
    """

    range_deg: tuple[Annotated[float, Field(ge=-90.0, le=0.0)], Annotated[float, Field(ge=0.0, le=90.0)]]
    """Lowest and highest angle relative to the flat run."""
    torque_n_m: Torque
    """Largest torque of the motor, both sides together."""
    max_rate_deg_s: Annotated[float, Field(gt=0.0, le=1000.0)]
    no_load_deg_s: Annotated[float, Field(gt=0.0, le=10000.0)] | None = None
    """No-load rate of the motor; the torque decreases linearly to zero at this rate. None: full torque at any rate."""
    lost_damping_n_m_s_rad: Annotated[float, Field(ge=0.0, le=1e4)]
    """Damping of rising motion with a dead motor: a diode shorts its windings in one direction only."""
    mass_kg: Mass
    com_m: Place | None = None
    """Distance of its centre of mass from its axis, along the section. Unset: half its length."""
    inertia_kg_m2: Size | None = None
    """Moments of inertia of both sides about that centre: along the section, across, and upright to both. Unset: of two rods."""


TAKEN = ("chair", "seat", "load", "flat", "approach", "flipper", "track", "bar", "slider", "world")
"""Names of the bodies, sections and drawn parts that every vehicle may have."""


class BeltSection(Settings):
    """Further section of the belts, on both sides, between two axes: a second pair of flippers, or a fixed ramp.

    It is driven with the belt of its side. A section with a joint turns about its start.
    """

    name: Annotated[str, Field(pattern="^[a-z][a-z0-9_]*$")]
    start_m: tuple[Place, Place]
    """Axis of its first pulley in B, forward and up."""
    end_m: tuple[Place, Place]
    """Axis of its last pulley, with the joint at zero."""
    radii_m: tuple[Length, Length]
    """Radii of its first and last pulley."""
    gauge_m: Length | None = None
    """Distance between the centre lines of both sides. Unset: that of the tracks."""
    width_m: Length | None = None
    """Width of its belt. Unset: that of the tracks."""
    angle_deg: Annotated[float, Field(ge=-90.0, le=90.0)] = 0.0
    """Angle at which it stays, raised from the line of its axes at zero."""
    flipper: Flipper | None = None
    """Joint with its motor. None: fixed."""
    follows: bool = False
    """Whether the joint turns as the ``[flipper]`` does, raised as far as that, in place of staying at ``angle_deg``."""

    @model_validator(mode="after")
    def _is_a_section(self) -> "BeltSection":
        if self.length_m <= abs(self.radii_m[0] - self.radii_m[1]):
            raise ValueError(f"belt '{self.name}' has its axes {self.length_m:g} m apart, so that one pulley holds the other")
        if self.follows and self.flipper is None:
            raise ValueError(f"belt '{self.name}' follows the flipper, and has no [belt.flipper], its joint")
        low_deg, high_deg = (-90.0, 90.0) if self.flipper is None else self.flipper.range_deg
        if not low_deg <= self.angle_deg <= high_deg:
            raise ValueError(
                f"belt '{self.name}': angle_deg is {self.angle_deg:g}, outside its range of {low_deg:g} to {high_deg:g}"
            )
        return self

    @property
    def length_m(self) -> float:
        """Distance of its axes [m]."""
        return math.dist(self.start_m, self.end_m)

    def reach_m(self, sign: float) -> float:
        """Return the distance from mid-track to its foremost part, or to its rearmost with sign -1, with its joint at zero [m]."""
        return max(sign * axis[0] + radius for axis, radius in zip((self.start_m, self.end_m), self.radii_m, strict=True))


class Rating(Settings):
    """Manufacturer's limits; physics may allow more."""

    slope_deg: Annotated[float, Field(ge=5.0, le=45.0)] | None = None
    """Slope of the steepest flight; no [stair] is flatter than 5°. Unset: what friction, torque and tip-over margins allow."""
    payload_kg: Mass
    """Largest payload on any flight; how steep a flight it may be follows from the flipper's torque."""


class CameraMount(Settings):
    """Position and orientation of a depth camera."""

    alternatives: ClassVar[Pairs] = (("file", "calibration"),)

    position_m: Point
    pitch_deg: Degrees
    roll_deg: Degrees = 0.0
    yaw_deg: Degrees = 0.0
    file: str | None = None
    """Camera file with the intrinsics, relative to the chair's file; the mount in it is ignored. Unset: a Kinect 1."""
    calibration: CameraFile | None = None
    """Intrinsics given in the chair's file itself, in place of ``file``."""

    @property
    def device(self) -> CameraFile:
        """Camera on the mount: a Kinect 1 if none is given."""
        return self.calibration or KINECT_1


class ChairDescription(Settings):
    """Tracked chair."""

    alternatives: ClassVar[Pairs] = (("seat", "payload"),)

    name: str
    faces: Faces = "up"
    """Where the occupant looks on a stair. Facing down, the chair climbs rear first and comes down front first. Its flipper points
    uphill either way, and with it B's x axis: what is said of the occupant (forward, left) is turned by 180° against B."""
    tracks: Tracks
    masses: Masses
    seat: Seat | None = None
    """Seat with its linkage for levelling. None: the payload is fixed to the chassis, and nothing is levelled."""
    payload: Payload | None = None
    """Place of the payload on a chair without a seat. None: inside the hull, with its centre and its edges."""
    drives: Drives
    camera: CameraMount
    rear_camera: CameraMount | None = None
    """Rear camera above the back of the chair, for the edge and the flight below. None: the chair only climbs."""
    rating: Rating | None = None
    """Manufacturer's limits. None: no limits besides mechanics."""
    flipper: Flipper | None = None
    """Flipper. None: the approach section is fixed."""
    belt: tuple[BeltSection, ...] = ()
    """Further sections of the belts besides the flat run and its approach."""
    motor: Motor | None = None
    """Motor of each belt. None: belts follow their commands at any load."""
    battery: Battery | None = None
    """Battery of the motors; required with motors."""

    @model_validator(mode="before")
    @classmethod
    def _a_list_alone_has_its_tracks(cls, tables: object) -> object:
        """Take ``[tracks]`` and ``[flipper]`` from the sections of a vehicle that is written as a list alone."""
        if not isinstance(tables, Mapping) or not tables.get("belt") or "tracks" in tables:
            return tables
        from treadline.scenario._belt_list import short_form  # few vehicles are written so

        return short_form(tables)

    @model_validator(mode="after")
    def _the_chassis_stands_on_its_tracks(self) -> "ChairDescription":
        x_m, y_m, z_m = self.masses.chassis_com_m
        half_run_m, half_width_m = 0.5 * self.tracks.flat_run_m, 0.5 * (self.tracks.gauge_m + self.tracks.belt_width_m)
        if abs(x_m) >= half_run_m or abs(y_m) >= half_width_m or z_m <= 0.0:
            raise ValueError(
                f"masses.chassis_com_m is [{x_m:g}, {y_m:g}, {z_m:g}], not above the tracks, which bear ±{half_run_m:.2f} m along "
                f"and ±{half_width_m:.2f} m across: the chassis would tip over on the floor; give metres from mid-track, above 0"
            )
        middle_m = self.masses.hull_centre_m[2]
        if (underside_m := middle_m - 0.5 * self.masses.chassis_size_m[2]) <= 0.0:
            high = f"masses.chassis_size_m is {self.masses.chassis_size_m[2]:g} high, so the chassis reaches down to"
            raise ValueError(f"{high} {underside_m:.3f} m, where it catches on each nosing; give less than {2.0 * middle_m:g}")
        return self

    @model_validator(mode="after")
    def _motors_have_a_battery(self) -> "ChairDescription":
        if self.motor is None:
            return self
        if self.battery is None:
            raise ValueError("a chair with a [motor] needs a [battery]: the motors' force depends on its voltage")
        if self.motor.no_load_speed_m_s < self.drives.max_speed_m_s:
            raise ValueError(
                f"motor.no_load_speed_m_s is {self.motor.no_load_speed_m_s:g}, below drives.max_speed_m_s of "
                f"{self.drives.max_speed_m_s:g}: the motor never reaches that speed"
            )
        return self

    @model_validator(mode="after")
    def _sections_are_apart(self) -> "ChairDescription":
        names = [section.name for section in self.belt]
        for section in self.belt:
            if names.count(section.name) > 1 or section.name in TAKEN:
                raise ValueError(f"two sections of the vehicle are called '{section.name}'; give each belt a name of its own")
            if section.follows and self.flipper is None:
                raise ValueError(f"belt '{section.name}' follows the flipper, and the vehicle has no [flipper]")
        axes = [section.start_m for section in self.belt if section.flipper is not None]
        axes += [(0.5 * self.tracks.flat_run_m, self.tracks.pulley_radius_m)] if self.flipper is not None else []
        twice = next((axis for axis in axes if axes.count(axis) > 1), None)
        if twice is not None:
            raise ValueError(
                f"two sections turn about one axis, at {twice[0]:g} m ahead and {twice[1]:g} m up; give one of them another"
            )
        return self

    @model_validator(mode="after")
    def _the_flipper_rests_within_its_range(self) -> "ChairDescription":
        rest_deg = self.tracks.approach_angle_deg
        low_deg, high_deg = (rest_deg, rest_deg) if self.flipper is None else self.flipper.range_deg
        if not low_deg <= rest_deg <= high_deg:
            allowed = f"flipper.range_deg is {low_deg:g} to {high_deg:g}"
            raise ValueError(f"tracks.approach_angle_deg is {rest_deg:g}, where the flipper rests; {allowed}")
        return self

    @property
    def levelled_seat(self) -> Seat:
        """Seat with its linkage.

        Raises:
            SettingsError: If the chair has no seat linkage.
        """
        if self.seat is None:
            raise SettingsError(f"chair {self.name!r} has no seat linkage, so there is nothing to level; describe it in [seat]")
        return self.seat

    def with_seat_shifted(self, shift_m: float) -> "ChairDescription":
        """Return the chair with its seat shifted along the chair, uphill positive [m]; without a seat, the chair itself."""
        if self.seat is None:
            return self
        x, y, z = self.seat.hinge_m
        return self.changed(seat={"hinge_m": (x + shift_m, y, z)})

    def in_chair(self, occupant_m: Point) -> Point:
        """Return in B a shift that is given in the occupant's frame: forward, left, up [m]."""
        x, y, z = occupant_m
        return occupant_m if self.faces == "up" else (-x, -y, z)

    @property
    def payload_origin_m(self) -> Point:
        """Origin of the payload's frame in B [m]: the seat's hinge, or the centre of a payload fixed to the chassis."""
        fixed_m = self.masses.hull_centre_m if self.payload is None else self.payload.com_m
        return fixed_m if self.seat is None else self.seat.hinge_m

    @property
    def payload_com_m(self) -> Point:
        """Nominal centre of mass of the payload in its frame [m]."""
        return (0.0, 0.0, 0.0) if self.seat is None else self.seat.payload_com_m

    @property
    def payload_size_m(self) -> Size:
        """Edges of the payload's box [m]."""
        fixed_m = self.masses.chassis_size_m if self.payload is None else self.payload.size_m
        return fixed_m if self.seat is None else self.seat.payload_size_m

    @property
    def empty_seat_kg(self) -> float:
        """Mass of the seat shell [kg]; zero without a seat."""
        return 0.0 if self.seat is None else EMPTY_SEAT_KG

    def mount_of(self, *, rear: bool) -> CameraMount:
        """Return the mount of the front or rear camera.

        Raises:
            SettingsError: If the chair has no rear camera.
        """
        mount = self.rear_camera if rear else self.camera
        if mount is None:
            raise SettingsError(f"chair {self.name!r} has no rear_camera, and cannot see where it backs to; it only climbs")
        return mount

    def camera_at(self, height_px: int | None = 240, *, rear: bool = False) -> PinholeCamera:
        """Return the chair's front or rear camera, its image scaled to a height.

        Args:
            height_px: Image rows; None: all of the camera. Width, focal lengths and principal point scale with it.
            rear: Whether the camera that faces backwards is asked for.

        Raises:
            SettingsError: If the chair has no rear camera.
        """
        mount = self.mount_of(rear=rear)
        return replace(
            mount.device.scaled(height_px or mount.device.height),
            mount_pitch_rad=mount.pitch_deg * DEG,
            mount_roll_rad=mount.roll_deg * DEG,
            mount_yaw_rad=mount.yaw_deg * DEG,
            mount_m=mount.position_m,
            # The detector recognises a Kinect 1 by its noise.
            sensor="auto" if mount.calibration is None else mount.calibration.sensor,
        )

    @property
    def half_width_m(self) -> float:
        """Half of the largest width over belts, chassis and passenger [m]."""
        tracks = self.tracks
        return 0.5 * max(tracks.gauge_m + tracks.belt_width_m, self.masses.chassis_size_m[1], self.payload_size_m[1])

    @property
    def swept_half_m(self) -> float:
        """Half width of the volume swept in straight motion [m]."""
        return self.half_width_m + SWEPT_SPARE_M

    @property
    def reach_m(self) -> float:
        """Distance from mid-track to the foremost part of the tracks [m]: nose, or tip of a flipper in line with the belts."""
        tracks = self.tracks
        end_m = self.nose_m[0] if self.flipper is None else 0.5 * tracks.flat_run_m + tracks.approach_m
        return max(end_m + (tracks.nose_radius_m or tracks.pulley_radius_m), *(section.reach_m(1.0) for section in self.belt), 0.0)

    @property
    def rear_m(self) -> float:
        """Distance from mid-track to the rearmost axis of the tracks, a rear flipper in line with the belts [m]."""
        return max(
            0.5 * self.tracks.flat_run_m, *(-axis[0] for section in self.belt for axis in (section.start_m, section.end_m)), 0.0
        )

    @property
    def rear_reach_m(self) -> float:
        """Distance from mid-track to the rearmost part of the tracks [m], a rear flipper in line with the belts."""
        own_m = 0.5 * self.tracks.flat_run_m + self.tracks.pulley_radius_m
        return max(own_m, *(section.reach_m(-1.0) for section in self.belt), 0.0)

    @property
    def nose_m(self) -> Point:
        """Centre of the nose pulley, mid-gauge [m]."""
        angle = self.tracks.approach_angle_deg * DEG
        return (
            0.5 * self.tracks.flat_run_m + self.tracks.approach_m * math.cos(angle),
            0.0,
            self.tracks.pulley_radius_m + self.tracks.approach_m * math.sin(angle),
        )


def read_chair(model: str | Mapping[str, object]) -> ChairDescription:
    """Return the chair in a file, the shipped chair of that name, or the chair of a file's tables.

    Raises:
        SettingsError: If no such chair exists, or the file is invalid.
    """
    if isinstance(model, str):
        path = file_named(model, CHAIRS)
        chair = read_toml(path, ChairDescription)
    else:
        path, chair = Path(), settings_of(model, ChairDescription, where="chair.model")
    mounts = {"camera": chair.camera, "rear_camera": chair.rear_camera}
    calibrated = {
        name: mount.model_copy(update={"calibration": read_camera(path.parent / mount.file), "file": None})
        for name, mount in mounts.items()
        if mount is not None and mount.file is not None
    }
    return chair.model_copy(update=calibrated) if calibrated else chair
