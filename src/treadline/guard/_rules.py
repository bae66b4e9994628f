"""All rules of the guard: what each hears, what it guarantees, and how the chair stops for it.

The guard, its re-arm, the page of hazards (``docs/tools/hazards.py``) and the tests loop over ``RULES``; the first cause in their
order is the one that a person reads.
"""

from collections.abc import Callable
from dataclasses import dataclass

from treadline.core.signals import (
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    PlantState,
    SeatReading,
    StairMap,
    TrackReading,
)
from treadline.guard._attitude_limits import SeatMonitor, TiltMonitor
from treadline.guard._belt_monitor import BeltMonitor
from treadline.guard._drop_monitor import DropMonitor
from treadline.guard._guard_config import GuardConfig
from treadline.guard._gyro_only_turn import GyroOnlyTurn, TurnedOver
from treadline.guard._half_cosine_stop import Stop
from treadline.guard._known import Monitor
from treadline.guard._obstacle_monitor import AheadMonitor
from treadline.guard._pace import Pace, PlantFault
from treadline.guard._sensor_timeouts import BothSenses, FilterHealth, Senses
from treadline.guard._silence import BlockSilence, Heartbeat, MapMonitor, Silence
from treadline.guard._slip_monitor import SlipMonitor

CAMERA = (FrameQuality, HeadingMeasurement, StairMap)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rule:
    """One rule: its name, its rows in the table of hazards, its monitor, and what the page says of it."""

    name: str
    rows: str
    guarantee: str
    """What holds the chair, or slows it."""
    time: str
    """Time from the fault to the hold, or the distance that is left."""
    not_covered: str = "–"
    stop: Stop
    hears: tuple[type, ...] = ()
    """Types of the messages that the monitor hears."""
    build: Callable[[GuardConfig], Monitor]
    applies: Callable[[GuardConfig], bool] = lambda _: True
    """Whether the rule applies to a run of this kind."""
    awaits: str = ""
    """Name of the limit that says whether a block sends what the rule needs; empty if it needs nothing of the kind."""
    unwatched: tuple[str, str] = ("", "")
    """Event of the first tick where that block does not: its name, and what is not watched."""

    def is_watched(self, limits: GuardConfig) -> bool:
        """Return whether the blocks send what the rule needs."""
        return not self.awaits or bool(getattr(limits, self.awaits))


def _judges_heading(limits: GuardConfig) -> bool:
    return limits.needs_heading


def _judges_motion(limits: GuardConfig) -> bool:
    return limits.watches_motion


def _drives(limits: GuardConfig) -> Monitor:
    """Return the monitor of the drives that the chair has."""
    names = {TrackReading: "readings of the belts", SeatReading: "readings of the seat", FlipperReading: "readings of the flipper"}
    rates = (limits.belt_limit_m_s, limits.seat_rate_m_s, limits.flipper_rate_rad_s)
    return Silence(limits, names, [name for name, rate in zip(names.values(), rates, strict=True) if rate is not None])


BELTS = Rule(
    name="belts",
    rows="13, 24",
    guarantee="a belt stalls, runs away or runs backwards, the brake is on without a command; also flickering, if bad for a share "
    "p > 1/2 of the time",
    time="0.2 s, divided by 2p − 1",
    not_covered="deviations below 30 % and 0.03 m/s",
    stop=Stop.BRAKE,  # a faulty drive follows no ramp
    hears=(TrackReading,),
    build=BeltMonitor,
)
SEAT = Rule(
    name="seat",
    rows="19",
    guarantee="seat 5° off level without improvement: the seat is frozen",
    time="1 s",
    stop=Stop.RAMP,
    hears=(SeatReading,),
    build=SeatMonitor,
    applies=_judges_motion,
)

RULES: tuple[Rule, ...] = (
    Rule(
        name="pace",
        rows="11",
        guarantee="no command or no tick; a clock of ticks that stands still, or leaps by 1 s",
        time="ramp from 1.5 control periods, hold at 3; 0.3 s; 1 tick",
        stop=Stop.BRAKE,
        build=Pace,
    ),
    Rule(
        name="plant",
        rows="22",
        guarantee="the plant braked by itself: silence, a second guard",
        time="1 tick",
        not_covered="drives that ignore their command",
        stop=Stop.BRAKE,
        hears=(PlantState,),
        build=PlantFault,
        applies=_judges_motion,
    ),
    Rule(
        name="operator link",
        rows="21",
        guarantee="the operator's handset is silent once heard, also one whose stamps are rejected",
        time="0.3 s",
        not_covered="a handset that was never connected",
        stop=Stop.BRAKE,  # a lost link is an operator's stop
        hears=(OperatorInput,),
        build=lambda limits: Silence(limits, {OperatorInput: "operator link"}, after=OperatorInput),
    ),
    Rule(
        name="process",
        rows="22",
        guarantee="a process that has sent heartbeats ends",
        time="0.75 s",
        stop=Stop.BRAKE,
        hears=(Heartbeat,),
        build=lambda limits: Silence(limits, {}, timeout_s=limits.heartbeat_timeout_s),
    ),
    Rule(
        name="plan",
        rows="22",
        guarantee="the plan is silent, from the first tick",
        time="0.3 s",
        stop=Stop.RAMP,  # an old plan leaves time for a ramp
        hears=(MotionPlan,),
        build=lambda limits: Silence(limits, {MotionPlan: "plan"}, ["plan"]),
        applies=lambda limits: limits.has_planner,
    ),
    Rule(
        name="tilt",
        rows="18",
        guarantee="pitch beyond +40° or −15°, roll beyond 20°, pitch rate beyond 25 °/s; also flickering, if beyond for a share "
        "p > 1/2 of the time",
        time="50 ms, divided by 2p − 1",
        not_covered="a fall that no brake stops",
        stop=Stop.BRAKE,  # the chair tips, and each centimetre may add to it
        hears=(ImuSample,),
        build=TiltMonitor,
        applies=lambda limits: limits.watches_motion and limits.needs_heading,
    ),
    SEAT,
    Rule(
        name="drives",
        rows="13",
        guarantee="belts, seat or flipper are silent, from the first tick; time in which the guard itself did not run counts up to "
        "0.3 s",
        time="0.3 s",
        stop=Stop.BRAKE,
        hears=(TrackReading, SeatReading, FlipperReading),
        build=_drives,
        applies=_judges_motion,
    ),
    BELTS,
    Rule(
        name="slip",
        rows="14",
        guarantee="slip above 0.3 against the nosings; roll-back of 0.25 m",
        time="slow, hold after 0.5 s; at once",
        not_covered="slip while no nosing is in view",
        stop=Stop.BRAKE,  # 0.25 m of the roll-back of 0.30 m are gone
        hears=(StairMap, MotionPlan),
        build=SlipMonitor,
        applies=lambda limits: limits.watches_motion and limits.watches_slip,
    ),
    Rule(
        name="estimate",
        rows="7",
        guarantee="the heading estimate is silent, from the first measured heading",
        time="0.3 s",
        stop=Stop.RAMP,  # belts 0.1 m/s apart turn the chair by 0.3° more over a ramp, of 5° allowed
        hears=(HeadingEstimate, HeadingMeasurement),
        build=lambda limits: BlockSilence(limits, {HeadingEstimate: "heading estimate"}, after=HeadingMeasurement),
        applies=_judges_heading,
    ),
    Rule(
        name="both senses",
        rows="9",
        guarantee="camera and IMU lost together",
        time="0.3 s",
        stop=Stop.BRAKE,  # held within 0.5 s, of which the silence takes 0.3 s
        hears=(ImuSample, *CAMERA, MotionPlan, HeadingHealth),
        build=BothSenses,
        applies=_judges_heading,
    ),
    Rule(
        name="senses",
        rows="1–4, 6, 8",
        guarantee="camera lost, frozen (an image of the last 3 s again), dark or without depth; IMU lost, not a number, or stuck; "
        "no stair in view where the plan needs one, or where a person drives without a planner",
        time="camera: at most 0.10 m/s after 0.3 s, hold after 3 s or 0.5 m; IMU: at most 0.10 m/s after 50 ms, hold after 1 s, at "
        "once over crest and edge; no stair: 12 s",
        not_covered="a loop of recorded images longer than 3 s",
        stop=Stop.RAMP,
        hears=(ImuSample, *CAMERA, MotionPlan, HeadingHealth),
        build=Senses,
        applies=_judges_heading,
    ),
    Rule(
        name="disagreement",
        rows="7",
        guarantee="camera and gyro disagree for most of the time, whatever time the message claims",
        time="0.5 s",
        not_covered="both wrong alike",
        stop=Stop.RAMP,
        hears=(HeadingHealth,),
        build=FilterHealth,
        applies=_judges_heading,
    ),
    Rule(
        name="health",
        rows="7",
        guarantee="the estimator's health is silent, from the first measured heading, if the estimator declares it",
        time="0.3 s",
        stop=Stop.RAMP,
        hears=(HeadingHealth, HeadingMeasurement),
        build=lambda limits: BlockSilence(limits, {HeadingHealth: "health of the heading"}, after=HeadingMeasurement),
        applies=_judges_heading,
        awaits="awaits_health",
        unwatched=("health_unwatched", "the estimator does not report its health: no hold for a gyro that errs"),
    ),
    Rule(
        name="maps",
        rows="25",
        guarantee="headings without a stair map, if the detector declares maps",
        time="3 s",
        stop=Stop.RAMP,  # without maps nothing watches the flight for obstacles and gaps
        hears=(HeadingMeasurement, StairMap),
        build=MapMonitor,
        applies=_judges_heading,
        awaits="awaits_map",
        unwatched=("map_unwatched", "the detector sends no maps: no stop before what stands on the flight, or a gap"),
    ),
    Rule(
        name="blind turn",
        rows="7",
        guarantee="the belts turn the chair by more than 3° in 6 s with no stair in view",
        time="at 3°",
        not_covered="drift below 1.5 °/s while the belts run alike",
        stop=Stop.RAMP,
        hears=(HeadingMeasurement, ImuSample, TrackReading),
        build=GyroOnlyTurn,
        applies=_judges_heading,
    ),
    Rule(
        name="square",
        rows="7, 18",
        guarantee="heading beyond 5° over crest, edge and the ends of a flight",
        time="1 tick",
        stop=Stop.RAMP,
        build=TurnedOver,
        applies=_judges_heading,
    ),
    Rule(
        name="ahead",
        rows="17, 25",
        guarantee="obstacle in a third of the maps or frames, in every phase, but no step that maps have shown; gap between "
        "nosings longer than the flat run",
        time="0.34 m before an obstacle, 0.2 m before a gap, for messages up to 3 s late",
        not_covered="what the camera does not see",
        stop=Stop.BRAKE,
        hears=(StairMap, FrameQuality),
        build=AheadMonitor,
    ),
    Rule(
        name="ground",
        rows="27",
        guarantee="the ground ends, on floors and landings, but not where the plan enters an edge and the guard's own maps show "
        "its nosing; ground that was neither seen nor driven over",
        time="0.34 m and the deviation before an end, from the leading pulley; before the pulley leaves known ground",
        not_covered="turning on the spot next to a drop; own plants that do not declare frames or the ground (`drop_unwatched` "
        "says so); edges nearer than the image begins, 0.8 m from mid-track, unless seen before; drops below 4 cm, at 2 m below "
        "5.5 cm; travel is that of the belts, slip included",
        stop=Stop.BRAKE,
        hears=(ImuSample, FreeGround, StairMap),
        build=DropMonitor,
        applies=_judges_motion,
        awaits="awaits_ground",
        unwatched=("drop_unwatched", "the camera does not report where the ground ends: no stop before a drop"),
    ),
)
