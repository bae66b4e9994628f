"""What one traversal knows at a tick, as one frozen value: its states' conditions and behaviours are functions of it.

``SituationTracker``, ``Crosser``, ``Motions`` -> ``Situation``. A condition (``_before_the_flight``, ``_on_the_flight``,
``_over_the_end``) returns the observation that ends a state, or None; see docs/decisions/0019.
"""

import math
from dataclasses import dataclass

from treadline.control.flipper import OFF_RAD
from treadline.core.angles import DEG, to_side
from treadline.core.signals import Direction, FlipperReading, HeadingEstimate, ImuSample, MotionPlan, Phase, TrackReading
from treadline.core.step_sizes import ON_A_FLIGHT_RAD
from treadline.estimation.known_nosings import KnownNosings
from treadline.estimation.stair_tracker import StairTracker
from treadline.mission._traction_test import TractionTest
from treadline.mission.follow import FollowCommand
from treadline.mission.mission_config import KnownSill, MissionConfig
from treadline.vehicle.flight_plan import FlightPlan
from treadline.vehicle.loading import Loading

LEVEL_RAD = 2.0 * DEG
"""Absolute pitch below which the chair is horizontal [rad]."""
ASIDE_M = 0.05
"""Lateral shift proposed in excess of half the chair's width [m]. Measured walls err by 5 cm for half a second."""
SIDE_M = 0.02
"""Largest error of a measured side, wall or drop [m] (``tests/perception/test_form.py``)."""
ENTER_FROM_M = 0.25
"""Distance of a pulley before a nosing from which it counts as being reached [m]: the first one of the flight, the last one in any
map, and the one at which the flipper of a chair that leaves is lifted."""
KEEPS_M = 0.5
"""Distance that a chair keeps from a missing step, at which it has slowed down before the foot of a flight, and which it goes away
from a flight [m]."""


@dataclass(frozen=True, slots=True)
class Way:
    """Direction of a traversal."""

    direction: Direction
    """Direction of the flights in view of the camera in use; maps of the other direction are ignored."""
    sign: float
    """Sign of the speed: 1 climbing, -1 backing down."""
    rides_rad: float
    """Angle of a riding flipper relative to the belts [rad]; nosings push the flipper up, as a spring and damper."""


WAYS = {
    # A lower tip of the riding flipper meets the next nosing as a step, which takes friction that the chair may not have to spare.
    "up": Way("up", 1.0, rides_rad=-0.75 * DEG),
    # Descending, nosings reach the flipper from the belts and leave it at its tip, so that they lift even a low flipper smoothly.
    "down": Way("down", -1.0, rides_rad=-2.5 * DEG),
}
"""Both ways. Driving down forwards is not supported: without a rear flipper the chair would pitch onto its front
(docs/decisions/0013)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Course over the ends of a flight."""

    command: FollowCommand | None = None
    """Command of the follower at this tick; None while it does not run."""
    gap: str | None = None
    """Missing step of the flight below the edge."""
    turned_back_for: str = ""
    """Reason for lowering the chair back onto the landing; empty if there is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnCommand:
    """Motion of a chair that turns on a landing at a tick."""

    speed_m_s: float
    rate_rad_s: float
    """Turn rate, positive to the left [rad/s]."""
    flipper_rad: float
    """Commanded angle of the flipper [rad]."""
    barred: str = ""
    """Why the chair cannot turn; empty while it can."""
    is_done: bool = False
    """Whether the chair has turned, and the next flight is in view."""
    took_s: float = 0.0
    worst_m: float = 0.0
    """Time since the turn began [s], and largest distance from its way [m]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Readings, tracked stair and state of a traversal at one tick."""

    way: Way
    config: MissionConfig
    loading: Loading
    stair: StairTracker
    """Tracker of the flight, as it is at this tick; conditions and behaviours only read it."""
    t_s: float
    stalled_s: float
    """Time with released brakes since the state began, or since the chair last came further [s]."""
    from_m: float
    """Belt travel at which the state began [m]."""
    flights_done: int
    phase: Phase = "search"
    cause: str = "start of the run"
    """Observation that began the state."""
    estimate: HeadingEstimate | None = None
    imu: ImuSample | None = None
    tracks: TrackReading | None = None
    flipper: FlipperReading | None = None
    around: KnownNosings | None = None
    """Known nosings relative to the chair."""
    is_narrow: bool = False
    """Whether a wall has stood where the chair would pass for several maps."""
    goes_back: bool = False
    """Whether the operator has sent the chair back."""
    has_entered: bool = False
    """Whether the chair came onto this flight from floor or landing: it did not start on it."""
    is_off_heading: bool = False
    """Whether the chair has been held for its heading error on the flight."""
    refusal: str | None = None
    """Limit of the chair that the measured steps exceed, as judged before the flight."""
    crossing: Crossing = Crossing()
    turn: TurnCommand | None = None
    """Motion on a landing on which the stair turns; None elsewhere."""
    is_square: bool = False
    """Whether the chair has been square to the flight for half a second."""
    has_swept: bool = False
    """Whether the search to both sides has ended."""
    presses: bool = False
    """Whether the chair stands and presses its flipper onto the nosings, because its belts slip."""
    awaited_rad: float | None = None
    """Angle by which the flipper must still turn for the chair to go on [rad]; None where the chair does not wait for it."""
    is_late: bool = False
    """Whether the flipper has exceeded the time that this takes."""
    traction: TractionTest | None = None
    """Latest pulse of the traction test; conditions only read it."""

    @property
    def is_up(self) -> bool:
        """Whether the traversal goes up."""
        return self.way.sign > 0.0

    @property
    def sills(self) -> list[KnownSill]:
        """Known sills next to this flight."""
        flight = self.flights_done if self.is_up else (self.config.flights or 1) - 1 - self.flights_done
        return [sill for sill in self.config.sills if sill.flight == flight]

    @property
    def landing(self) -> FlightPlan | None:
        """Plan of the landing after this flight; None if the stair does not turn on it."""
        plans = () if self.config.landings is None else self.config.landings.plans
        number = self.flights_done if self.is_up else len(plans) - 1 - self.flights_done
        return plans[number] if 0 <= number < len(plans) and plans[number].turn_rad else None

    @property
    def is_held(self) -> bool:
        """Whether the brake is on."""
        return self.tracks is not None and self.tracks.brake_on

    @property
    def is_on_a_flight(self) -> bool:
        """Whether the chair is pitched as on a flight."""
        return self.stair.pitch_rad > ON_A_FLIGHT_RAD

    @property
    def pivot_m(self) -> float:
        """Distance of each pulley from mid-track [m]."""
        return 0.5 * self.config.chair.tracks.flat_run_m

    @property
    def bears_m(self) -> float:
        """Distance from the rearmost axis to the front pulley [m]: twice ``pivot_m`` but for rear flippers."""
        return self.config.chair.rear_m + self.pivot_m

    @property
    def gone_m(self) -> float:
        """Belt travel since the state began [m], negative backwards."""
        return self.stair.travel_m - self.from_m

    @property
    def waits(self) -> bool:
        """Whether the flipper must still turn for the chair to go on, and has time."""
        return self.awaited_rad is None or (self.awaited_rad > 0.0 and not self.is_late)

    @property
    def free_m(self) -> float:
        """Distance from the chair's middle to the nearer wall [m]; infinite without a wall in view."""
        walls = (self.stair.left_wall_m, self.stair.right_wall_m)
        return min((wall for wall in walls if wall is not None), default=math.inf)

    @property
    def needs_m(self) -> float:
        """Half width that the flight must have on either side of the chair's middle [m]."""
        return self.config.chair.swept_half_m + SIDE_M

    @property
    def step_m(self) -> float:
        """Distance from nosing to nosing [m]; 0 while no stair is known."""
        return math.hypot(self.stair.rise_m, self.stair.run_m)

    @property
    def before_m(self) -> float:
        """Distance of the leading axis before the lowest nosing [m], along the belts going down; infinite without one."""
        foot = self.stair.first_ahead_m() if self.is_up else self.stair.bottom_ahead_m()
        return math.inf if foot is None else self.way.sign * foot - (self.pivot_m if self.is_up else self.config.chair.rear_m)

    @property
    def enters(self) -> bool:
        """Whether the chair is about to drive onto the flight: a side that was not in view does not count as wide enough."""
        if self.phase == "align":
            return False
        if self.is_up:
            return self.before_m < ENTER_FROM_M or self.stair.pitch_rad > OFF_RAD
        edge = self.stair.top_ahead_m()
        return edge is None or -edge - self.config.chair.rear_m < ENTER_FROM_M

    @property
    def tips(self) -> bool:
        """Whether the rear pulley of a chair that goes down has passed the last nosing, or the chair is level near it."""
        return self.before_m < 0.0 or (self.before_m < KEEPS_M and self.stair.pitch_rad < LEVEL_RAD)

    @property
    def is_off(self) -> bool:
        """Whether the flipper's tip of a chair that goes down has left the last nosing."""
        return self.before_m < -self.bears_m - self.config.chair.tracks.approach_m

    @property
    def still(self) -> MotionPlan:
        """Plan of this tick that stops the belts."""
        return MotionPlan(t_s=self.t_s, phase=self.phase, speed_m_s=0.0, turn_m_s=0.0, cause=self.cause)

    def missing(self, within_m: float) -> str | None:
        """Return the missing step within ``within_m`` of the leading pulley, as a reason to stop; None if there is none."""
        sign, pivot_m = self.way.sign, self.pivot_m
        sides = [(sign * low - pivot_m, sign * high - pivot_m) for low, high in self.stair.gaps_ahead_m()]
        gap = min(((min(pair), max(pair)) for pair in sides if max(pair) > 0.0), default=None)
        if gap is None or gap[0] > within_m:
            return None
        (near_m, far_m), leading = gap, "front" if self.is_up else "rear"
        return f"a step is missing: {far_m - near_m:.2f} m from nosing to nosing, the first {beside(near_m)} the {leading} pulley"

    def turns(self, within_m: float) -> str | None:
        """Return the winders within ``within_m`` of the front pulley, as a reason to stop; None if a landing lies before a turn."""
        turn = self.stair.turn_ahead() if self.is_up and not self.stair.top_ends else None
        if turn is None or turn[0] - self.pivot_m > within_m:
            return None
        where = f"{beside(turn[0] - self.pivot_m)} the front pulley"
        return f"the stair turns by {to_side(turn[1])} {where}, without a landing: take another way"


def beside(before_m: float) -> str:
    """Return a distance in words: before a pulley if positive, behind the pulley if negative."""
    return f"{before_m:.2f} m before" if before_m > 0.0 else f"{-before_m:.2f} m behind"


def on_the_tip(load_n: float) -> str:
    """Return the load on the flipper's tip in words."""
    return f"{max(load_n, 0.0):.0f} N on the flipper's tip"
