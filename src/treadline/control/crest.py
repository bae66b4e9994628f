"""Over the crest on an arm: the front track section reaches the landing first and lets the chair down onto it.

Paper: Section II.A, Fig. 3(b) ("variable angle of attack"); sequence and figures are ours, see
docs/decisions/0013-the-front-section-is-an-arm.md. ``ImuSample, ArmReading, TrackReading -> CrestCommand``.

Without an arm a chair whose centre of mass passes the last nosing falls freely onto its front. With it, five stages:
climb; slow down and lay the arm in line with the belts; stand still and reach down until the tip carries; drive on, the
arm keeping its hold, until the centre of mass has passed; lead the pitch down. The tip's load is told by motor torque.
"""

import math
from dataclasses import dataclass
from typing import Literal

from treadline.angles import DEG
from treadline.errors import MechanicsError
from treadline.mechanics.chair import Arm, ChairDescription
from treadline.signals import ArmCommand, ArmReading, ImuSample, TrackReading

Stage = Literal["climb", "slow", "reach", "carry", "lead", "land", "done"]

G_M_S2 = 9.81
CARRIES_N = 80.0
"""Load from which the tip counts as standing: five times what torque noise and the arm's weight leave in doubt."""
CARRIES_SHARE, PRESS_SHARE = 0.2, 0.3
"""Of the chair's weight, where that is less: a light chair would be lifted off its last nosing."""
CARRIES_S = 0.1
"""For so long: a stop of the rotor is over by then."""
UNLOADED_N = 30.0
LATER_M = 0.03
"""Of the centre of mass past the nosing before the lead; as much further before the next try, if the chair did not follow."""
NEAR_M = 0.06
"""Of the centre of mass before the nosing: no further while the tip is unloaded."""
ARM_RAD_S2 = 120.0 * DEG
"""Change of the arm's rate: the rotor's inertia then stays under 2 N·m and is no load."""
SMALL_RAD = 8.0 * DEG
"""Below this pitch the arm's angle tells the pivot's distance no more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CrestConfig:
    """The chair, what is believed of its load, and the pace."""

    chair: ChairDescription
    payload_kg: float
    com_error_m: float = 0.0
    """Added to the centre of mass along the chair: what a belief is off by, in tests."""
    cruise_m_s: float = 0.2
    crest_m_s: float = 0.1
    lead_m_s: float = 0.03
    """While the pitch goes down: the further the chair goes, the more the arm has to carry."""
    slow_within_m: float = 0.5
    """Of the centre of mass before the nosing."""
    reach_from_m: float = 0.25
    """Of the front pulley past the nosing: an arm that reaches down clears the nosing even 15 cm too early, and the centre
    of mass (0.5 m behind the pulley's passing) is not there yet 10 cm too late."""
    reach_rad_s: float = 25.0 * DEG
    lead_rad_s: float = 10.0 * DEG
    lead_rad_s2: float = 30.0 * DEG
    """How fast the lead begins: half a metre from the nosing this is 0.3 m/s² at the passenger."""
    soften_per_s: float = 2.5
    """Lead per angle that is left: the last 4° go slower."""
    touch_rad_s: float = 4.0 * DEG
    """At which the belts touch the landing: 5 cm/s at the seat."""
    press_n: float = 130.0
    """Load that the tip keeps while the chair drives on."""
    press_rad_s_n: float = 0.1 * DEG
    """Arm rate per newton that is missing."""
    trim_per_s: float = 2.0
    """Arm rate per angle by which the pitch is behind its lead."""
    behind_rad: float = 2.0 * DEG
    """A lead never runs further ahead of the pitch."""
    level_rad: float = 0.7 * DEG
    stow_rad_s: float = 12.0 * DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class CrestCommand:
    """What the crest asks of belts and arm."""

    t_s: float
    stage: Stage
    speed_m_s: float
    """Of both belts."""
    arm: ArmCommand
    tip_n: float
    """Load on the arm's tip, as the torque tells it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmGeometry:
    """Chair, arm and landing in the plane: belts on the last nosing, tip on the landing."""

    pivot_m: float
    """Of the front pulley's axis ahead of mid-track."""
    radius_m: float
    arm_m: float

    def depression(self, pitch_rad: float, past_m: float) -> float:
        """Return the arm's angle below the level when its tip stands on the landing.

        Args:
            past_m: Of the pivot beyond the nosing, along the belts.
        """
        drop = past_m * math.sin(pitch_rad) - self.radius_m * (1.0 - math.cos(pitch_rad))
        return math.asin(min(max(drop / self.arm_m, -0.99), 0.99))

    def past(self, pitch_rad: float, angle_rad: float) -> float:
        """Return how far the pivot is beyond the nosing when the tip stands at this angle of the arm: the inverse."""
        drop = self.arm_m * math.sin(-(angle_rad + pitch_rad))
        return (drop + self.radius_m * (1.0 - math.cos(pitch_rad))) / math.sin(pitch_rad)

    def rates(self, pitch_rad: float, past_m: float) -> tuple[float, float]:
        """Return the arm's change of angle per pitch, and per metre past the nosing [rad/m], tip on the landing."""
        level = self.arm_m * math.cos(self.depression(pitch_rad, past_m))
        per_pitch = (past_m * math.cos(pitch_rad) - self.radius_m * math.sin(pitch_rad)) / level
        return -(1.0 + per_pitch), -math.sin(pitch_rad) / level


class Crest:
    """Sequencer of one crossing.

    Args:
        nosing_ahead_m: Of the last nosing ahead of mid-track along the belts, at the first step; from the stair map.
    """

    def __init__(self, config: CrestConfig, nosing_ahead_m: float) -> None:
        self._config = config
        self._arm = _arm_of(config.chair)
        tracks = config.chair.tracks
        self._geometry = ArmGeometry(pivot_m=0.5 * tracks.flat_run_m, radius_m=tracks.pulley_radius_m, arm_m=tracks.approach_m)
        self._stage: Stage = "climb"
        self._ahead_m = nosing_ahead_m
        self._t_s: float | None = None
        weight = G_M_S2 * (config.chair.masses.chassis_kg + self._arm.mass_kg + config.payload_kg)
        self._carries_n = min(CARRIES_N, CARRIES_SHARE * weight)
        self._press_n = min(config.press_n, PRESS_SHARE * weight)
        self._tip_n = 0.0
        self._carried_s = 0.0
        self._rate_rad_s = 0.0
        self._lead_from_m = LATER_M
        self._lead_rad = 0.0
        self._lead_rad_s = 0.0

    def nosing_seen(self, ahead_m: float) -> None:
        """Take a better place of the last nosing, as long as no contact tells it."""
        if self._stage in ("climb", "slow"):
            self._ahead_m = ahead_m

    def step(self, imu: ImuSample, arm: ArmReading, tracks: TrackReading) -> CrestCommand:
        """Answer one tick's readings."""
        dt_s = 0.0 if self._t_s is None else max(imu.t_s - self._t_s, 0.0)
        self._t_s = imu.t_s
        speed = 0.5 * (tracks.left_m_s + tracks.right_m_s)
        self._ahead_m -= speed * dt_s
        pitch = pitch_of(imu)
        self._tip_n += (self._load(pitch, arm) - self._tip_n) * (1.0 - math.exp(-dt_s / 0.05))
        self._carried_s = self._carried_s + dt_s if self._tip_n > self._carries_n else 0.0
        self._sequence(pitch, arm)
        belts, rate = self._act(pitch, arm, speed, dt_s)
        limit, change = self._arm.max_rate_deg_s * DEG, ARM_RAD_S2 * dt_s
        rate = min(max(rate, self._rate_rad_s - change), self._rate_rad_s + change)
        self._rate_rad_s = min(max(rate, -limit), limit)
        return CrestCommand(
            t_s=imu.t_s,
            stage=self._stage,
            speed_m_s=belts,
            arm=ArmCommand(t_s=imu.t_s, rate_rad_s=self._rate_rad_s),
            tip_n=self._tip_n,
        )

    @property
    def _past_m(self) -> float:
        return self._geometry.pivot_m - self._ahead_m

    def _sequence(self, pitch: float, arm: ArmReading) -> None:
        config = self._config
        beyond = self._com_beyond(pitch)
        match self._stage:
            case "climb" if beyond > -config.slow_within_m or self._past_m > -self._geometry.arm_m:
                self._stage = "slow"
            case "slow" if self._past_m > config.reach_from_m:
                self._stage = "reach"
            case "reach" if self._carried_s > CARRIES_S:
                self._stage = "carry"
                self._ahead_m = self._geometry.pivot_m - self._geometry.past(pitch, arm.angle_rad)
            case "carry" if self._carried_s > CARRIES_S and beyond > self._lead_from_m:
                self._stage = "lead"
                self._lead_rad = pitch
                self._lead_rad_s = 0.0
            case "lead" if self._tip_n < UNLOADED_N and pitch > SMALL_RAD:
                # The chair has not followed: its centre of mass is further back than believed. Reach for the landing again.
                self._stage = "carry"
                self._lead_from_m = beyond + LATER_M
            case "carry" | "lead" if pitch < config.level_rad:
                self._stage = "land"
            case "land" if self._ahead_m < -self._geometry.pivot_m:
                self._stage = "done"
            case _:
                pass

    def _act(self, pitch: float, arm: ArmReading, speed: float, dt_s: float) -> tuple[float, float]:
        """Return belt speed and arm rate."""
        config = self._config
        match self._stage:
            case "climb":
                return config.cruise_m_s, 0.0
            case "slow":
                # A little above the belt line: in line with the belts it would carry on the nosings.
                return config.crest_m_s, 2.0 * (5.0 * DEG - arm.angle_rad)
            case "reach":
                return 0.0, -config.reach_rad_s
            case "carry":
                return self._carry(pitch, arm, speed, dt_s)
            case "lead":
                return config.lead_m_s, self._lead(pitch, arm, speed, dt_s)
            case _:
                return config.crest_m_s, min(2.0 * (self._rest_rad - arm.angle_rad), config.stow_rad_s)

    def _carry(self, pitch: float, arm: ArmReading, speed: float, dt_s: float) -> tuple[float, float]:
        self._refine(pitch, arm, dt_s)
        config = self._config
        _, per_metre = self._geometry.rates(pitch, self._past_m)
        missing = max(self._press_n - self._tip_n, 0.0)
        rate = (per_metre * speed if missing > 0.0 else 0.0) - config.press_rad_s_n * missing
        waits = self._tip_n < UNLOADED_N and self._com_beyond(pitch) > -NEAR_M
        return (0.0 if waits else config.crest_m_s), rate

    def _lead(self, pitch: float, arm: ArmReading, speed: float, dt_s: float) -> float:
        config = self._config
        if self._tip_n < UNLOADED_N:  # freeze: the chair has not followed
            self._lead_rad, self._lead_rad_s = pitch, 0.0
            return 0.0
        self._refine(pitch, arm, dt_s)
        softly = max(config.soften_per_s * pitch, config.touch_rad_s)
        self._lead_rad_s = min(self._lead_rad_s + config.lead_rad_s2 * dt_s, config.lead_rad_s, softly)
        self._lead_rad = max(self._lead_rad - self._lead_rad_s * dt_s, pitch - config.behind_rad)
        per_pitch, per_metre = self._geometry.rates(pitch, self._past_m)
        trim = config.trim_per_s * (self._lead_rad - pitch)
        return per_pitch * (trim - self._lead_rad_s) + per_metre * speed

    def _refine(self, pitch: float, arm: ArmReading, dt_s: float) -> None:
        """Let the arm's angle tell where the nosing is: belts on it, tip on the landing."""
        if pitch > SMALL_RAD and self._tip_n > UNLOADED_N:
            seen = self._geometry.pivot_m - self._geometry.past(pitch, arm.angle_rad)
            self._ahead_m += (seen - self._ahead_m) * (1.0 - math.exp(-dt_s / 0.2))

    @property
    def _rest_rad(self) -> float:
        return self._config.chair.tracks.approach_angle_deg * DEG

    def _load(self, pitch: float, arm: ArmReading) -> float:
        """Return the tip's load from the motor's torque: what holds the arm up, less its weight."""
        lever = self._geometry.arm_m * math.cos(arm.angle_rad + pitch)
        if lever < 0.3 * self._geometry.arm_m:
            return 0.0
        return 0.5 * self._arm.mass_kg * G_M_S2 - arm.torque_n_m / lever

    def _com_beyond(self, pitch: float) -> float:
        """Return how far the plumb line through the centre of mass is beyond the nosing, along the belts."""
        x, z = centre_of_mass_level(self._config, pitch)
        return x - z * math.tan(pitch) - self._ahead_m


def centre_of_mass_level(config: CrestConfig, pitch_rad: float) -> tuple[float, float]:
    """Return the believed centre of mass (x, z) in B while the seat is level."""
    chair, c, s = config.chair, math.cos(pitch_rad), math.sin(pitch_rad)
    (hx, _, hz), (px, _, pz) = chair.seat.hinge_m, chair.seat.payload_com_m
    chassis, (cx, _, cz) = chair.masses.chassis_kg, chair.masses.chassis_com_m
    # The arm reaches ahead and down, its own centre not far from its axis when the plumb line passes the nosing.
    arm, pivot = 0.0 if chair.arm is None else chair.arm.mass_kg, 0.5 * chair.tracks.flat_run_m
    total = chassis + arm + config.payload_kg
    x = (chassis * cx + arm * pivot + config.payload_kg * (hx + c * px + s * pz)) / total
    z = (chassis * cz + arm * chair.tracks.pulley_radius_m + config.payload_kg * (hz - s * px + c * pz)) / total
    return x + config.com_error_m, z


def pitch_of(imu: ImuSample) -> float:
    """Return the chassis' pitch, front up positive."""
    w, x, y, z = (float(q) for q in imu.orientation)
    return math.asin(min(max(2.0 * (x * z - w * y), -1.0), 1.0))


def _arm_of(chair: ChairDescription) -> Arm:
    if chair.arm is None:
        raise MechanicsError(
            f"chair {chair.name!r} has no driven front section, and falls over a crest at 120 degrees a second; "
            "use wheelchair, or end the run before the last nosing"
        )
    return chair.arm
