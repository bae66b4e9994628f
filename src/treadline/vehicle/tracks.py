"""Tracks: sections of the belts, pulleys, road wheels, length on the nosings, minimum track length.

Paper: Section II.A, Fig. 3(b). "Wheelchair tracks must be in contact with at least two stair edges": L > 2√(h² + w²).
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import BeltSection, ChairDescription, Flipper, Tracks

IN_LINE_M = 0.005
"""Height of a section's lower face above that of the flat run up to which it bears with it [m]: half a nosing's radius."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """Section of the belts of both sides, between two axes."""

    name: str
    start_m: tuple[float, float]
    """Axis of its first pulley in B, forward and up; its joint, if it has one."""
    length_m: float
    """Distance of its axes."""
    radii_m: tuple[float, float]
    """Radii of its first and last pulley."""
    gauge_m: float
    width_m: float
    zero_rad: float = 0.0
    """Direction of its end from its start above B's x axis, with the joint at zero [rad]."""
    raises: float = 1.0
    """Sign with which raising its end turns that direction: -1 where it points rearward."""
    stays_rad: float = 0.0
    """Angle of a section that does not follow the flipper's [rad]."""
    motor: Flipper | None = None
    """Motor of its joint; None: fixed to the chassis."""
    follows: bool = False
    """Whether its joint turns as the flipper does."""

    @property
    def mass_kg(self) -> float:
        """Mass of a section with a joint [kg]; 0 of a fixed one, which is part of the chassis."""
        return 0.0 if self.motor is None else self.motor.mass_kg

    @property
    def com_m(self) -> float:
        """Distance of the centre of mass of a section with a joint from its start, along the section [m]."""
        return 0.5 * self.length_m if self.motor is None or self.motor.com_m is None else self.motor.com_m

    def direction_rad(self, flipper_rad: float) -> float:
        """Return the direction of its end from its start above B's x axis at an angle of the flipper [rad]."""
        return self.zero_rad + self.raises * (flipper_rad if self.follows else self.stays_rad)

    def end_m(self, flipper_rad: float) -> tuple[float, float]:
        """Return the axis of its last pulley in B, forward and up [m]."""
        direction = self.direction_rad(flipper_rad)
        return self.start_m[0] + self.length_m * math.cos(direction), self.start_m[1] + self.length_m * math.sin(direction)


def sections(chair: ChairDescription) -> tuple[Section, ...]:
    """Return the sections of a chair's belts: the flat run, the approach, which a flipper's motor turns, and all further ones."""
    tracks, flipper = chair.tracks, chair.flipper
    half_m, radius_m = 0.5 * tracks.flat_run_m, tracks.pulley_radius_m
    flat = Section(
        name="flat",
        start_m=(-half_m, radius_m),
        length_m=tracks.flat_run_m,
        radii_m=(radius_m, radius_m),
        gauge_m=tracks.gauge_m,
        width_m=tracks.belt_width_m,
    )
    approach = replace(
        flat,
        name="approach",
        start_m=(half_m, radius_m),
        length_m=tracks.approach_m,
        radii_m=(radius_m, tracks.nose_radius_m or radius_m),
        stays_rad=tracks.approach_angle_deg * DEG,
        motor=flipper,
        follows=flipper is not None,
    )
    return (flat, approach, *(_further(section, tracks) for section in chair.belt))


def _further(section: BeltSection, tracks: Tracks) -> Section:
    ahead_m, up_m = (end - start for start, end in zip(section.start_m, section.end_m, strict=True))
    return Section(
        name=section.name,
        start_m=section.start_m,
        length_m=section.length_m,
        radii_m=section.radii_m,
        gauge_m=section.gauge_m or tracks.gauge_m,
        width_m=section.width_m or tracks.belt_width_m,
        zero_rad=math.atan2(up_m, ahead_m),
        raises=math.copysign(1.0, ahead_m),
        stays_rad=section.angle_deg * DEG,
        motor=section.flipper,
        follows=section.follows,
    )


def minimum_track_length(rise_m: float, run_m: float) -> float:
    """Return 2√(h² + w²) [m], the lower bound of the track length L on the stair.

    Paper: Section II.A, the inequality L > 2√(h² + w²). A track of one nosing pitch touches at least one nosing, a track of two
    pitches at least two at every phase.
    """
    return 2.0 * math.hypot(rise_m, run_m)


def nosings_touched(length_m: float, pitch_m: float, phase_m: float) -> int:
    """Return the number of nosings under a straight track.

    Args:
        phase_m: Distance from the track's rear end to the first nosing ahead.
    """
    if not 0.0 <= phase_m <= pitch_m:
        raise MechanicsError(f"a phase of {phase_m} m lies outside one pitch of {pitch_m} m")
    return math.floor((length_m - phase_m) / pitch_m) + 1 if phase_m <= length_m else 0


def pulley_centres(chair: ChairDescription) -> Float[np.ndarray, "3 2"]:
    """Return the centres (x, z) in B of rear, front and nose pulley."""
    half, radius = 0.5 * chair.tracks.flat_run_m, chair.tracks.pulley_radius_m
    return np.array([(-half, radius), (half, radius), chair.nose_m[::2]])


def road_wheels(tracks: Tracks) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Return the places of a belt's road wheels along B's x axis [m], and their stiffnesses relative to a pulley's.

    The stiffnesses are the weights of the trapezoid rule: a rigid flat run on n wheels carries like an even elastic bed. Equal
    stiffnesses load the ends too much, so that the chair turns too slowly. All wheels of a belt are as stiff as two pulleys.
    """
    half_m = 0.5 * tracks.flat_run_m
    stiffness = np.full(tracks.road_wheels, 2.0 / (tracks.road_wheels - 1))
    stiffness[[0, -1]] *= 0.5
    return np.linspace(-half_m, half_m, tracks.road_wheels), stiffness


def track_on_stair_m(chair: ChairDescription) -> float:
    """Return the length of the track in the nosing plane [m]: the flat run, and the section in line with it.

    A flipper always reaches that angle (its range includes 0°); a fixed section does only if it is built at 0°.
    """
    return float(np.ptp(bearing_ends_m(chair))) + (0.0 if chair.flipper is None else chair.tracks.approach_m)


def bearing_ends_m(chair: ChairDescription) -> tuple[float, float]:
    """Return the places of the first and the last axis of the sections that bear in line with the flat run, along B's x [m]."""
    places = []
    for section in sections(chair):
        axes = section.start_m, section.end_m(0.0)
        if not section.follows and all(abs(z - r) < IN_LINE_M for (_, z), r in zip(axes, section.radii_m, strict=True)):
            places += [x for x, _ in axes]
    return min(places), max(places)
