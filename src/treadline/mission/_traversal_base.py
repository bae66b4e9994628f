"""Base class of the planners up and down: sensor state, search, next flight, flipper and steering on the flight, plan.

``ascent_states`` and ``descent_states`` add their phases; see docs/decisions/0019.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from treadline.core.angles import DEG
from treadline.core.signals import (
    FlipperCommand,
    FlipperReading,
    HeadingEstimate,
    ImuSample,
    MotionPlan,
    Phase,
    StairMap,
    TrackReading,
)
from treadline.estimation.stair_tracker import Side, StairTracker
from treadline.mission._flat_ground_steering import LevelConfig, LevelSteering
from treadline.mission._flipper_planner import LIFTED_HEADING_RAD, FlipperPlanner, turning_share
from treadline.mission._skid_monitor import SkidMonitor
from treadline.mission._tip_over import TipOverFeedforward
from treadline.mission.entry_check import certain_reject_reason, reject_reason
from treadline.mission.planner import PlannerInput
from treadline.scenario.chair import ChairDescription

LEVEL_RAD = 2.0 * DEG
"""Absolute pitch below which the chair is horizontal [rad]."""
STUCK_SHARE, STUCK_M = 1.5, 0.5
"""Ratio of belt travel to the distance to go, and additional belt travel [m], above which something blocks the chair."""
NARROW_MAPS, NARROW_M, ASIDE_M = 10, 0.02, 0.05
"""Number of consecutive maps in which a wall is nearer than half the chair's width less ``NARROW_M`` [m], and lateral shift
proposed in excess of that width [m]. Measured walls err by 5 cm for half a second. In a stair 1.2 m wide a chair that started with
30° of heading error, 0.15 m off the middle, drove onto the wall's end and rolled by 21°."""
SIDE_MARGIN_M = 0.02
"""Margin of the swept half width to an open side [m]: the largest error of a measured side (``tests/perception/test_form.py``)."""
BLIND_RAD = 1.0 * DEG
"""Heading error that is not corrected on the flight while no stair is in view [rad]. Belts that follow a drifting gyro turn the
chair; with a belt that has lost friction they turn nothing, which the guard cannot distinguish from gyro drift."""


def beside(before_m: float) -> str:
    """Return a distance in words: before a pulley if positive, behind the pulley if negative."""
    return f"{before_m:.2f} m before" if before_m > 0.0 else f"{-before_m:.2f} m behind"


def on_the_tip(load_n: float) -> str:
    """Return the load on the flipper's tip in words."""
    return f"{max(load_n, 0.0):.0f} N on the flipper's tip"


@dataclass(frozen=True, slots=True, kw_only=True)
class TraversalConfig:
    """Chair, entered payload, speeds and distances common to both directions; distances along the belts."""

    chair: ChairDescription
    payload_kg: float
    """Weight of the passenger as entered by the operator [kg]."""
    cruise_m_s: float = 0.2
    """Mean belt speed on the flight [m/s]."""
    flights: int | None = None
    """Number of flights to traverse; None continues while another flight is seen across a landing."""
    look_m: float = 2.5
    """Travel over a landing to find the next flight [m]: from further away only its first step is in view, or its edge hides it."""
    slow_m_s: float = 0.1
    """Mean belt speed onto the stair and off the stair [m/s]."""
    gap_m: float = 0.45
    """Distance of the leading pulley before the nosing at a missing step at which the chair stops for good [m]."""


class Traversal:
    """Sensor state, phase and plan of one traversal."""

    DIRECTION: ClassVar[Literal["up", "down"]]
    """Direction of the flights in view of the camera in use; maps of the other direction are ignored."""
    WAY: ClassVar[float]
    """Sign of the speed: 1 climbing, -1 backing down."""
    ROLLING: ClassVar[frozenset[Phase]]
    """Phases that begin without a stop."""
    CATCHES: ClassVar[bool]
    """Whether the flipper follows a chair that falls onto its front."""
    RIDES_RAD: ClassVar[float]
    """Angle command of a riding flipper relative to the belts [rad]; nosings push the flipper up, as a spring and damper."""

    def __init__(self, config: TraversalConfig) -> None:
        chair = config.chair
        self._config = config
        self._flipper_planner = FlipperPlanner(chair, self.RIDES_RAD)
        self._tip_over = TipOverFeedforward()
        self._pivot_m = 0.5 * chair.tracks.flat_run_m
        self._half_width_m = chair.half_width_m
        self._needs_m = chair.swept_half_m + SIDE_MARGIN_M
        """Half width that the flight must have on either side of the chair's middle [m]."""
        self._face_flight()
        self._phase: Phase = "search"
        self._cause = "start of the run"
        self._flights_done = 0
        self._from_m = 0.0
        """Travel at which the phase began [m]."""
        self._ran_m = 0.0
        """Absolute belt travel since the phase began [m], slip included."""
        self._to_go_m = math.inf
        """Belt travel expected for the phase when it began [m]; infinite if unknown."""
        self._imu: ImuSample | None = None
        self._tracks: TrackReading | None = None
        self._turned_rad = 0.0

    def _face_flight(self) -> None:
        """Reset everything that belongs to one flight."""
        self._where = StairTracker()
        self._level = LevelSteering(LevelConfig(gauge_m=self._config.chair.tracks.gauge_m))
        self._skid = SkidMonitor()
        self._narrow_maps = 0
        self._judged = (0, False)
        """Number of maps when the stair was last judged, and whether the chair was about to enter."""
        self._flipper_planner.forget()

    def update(self, signal: PlannerInput) -> None:
        """Update with one signal."""
        match signal:
            case ImuSample():
                dt_s = 0.0 if self._imu is None else signal.t_s - self._imu.t_s
                self._turned_rad += dt_s * signal.angular_velocity_rad_s[2]
                self._imu = signal
                self._tip_over.update(signal)
                self._where.update(signal)
            case TrackReading():
                dt_s = 0.0 if self._tracks is None else signal.t_s - self._tracks.t_s
                self._ran_m += 0.5 * dt_s * abs(signal.left_m_s + signal.right_m_s)
                self._tracks = signal
                if signal.brake_on:  # held: belts and flipper do not follow commands
                    self._level.rest()
                    self._flipper_planner.forget()
                self._where.update(signal)
            case StairMap():
                if signal.direction == self.DIRECTION:
                    self._where.update(signal)
                    self._narrow_maps = self._narrow_maps + 1 if self._free_m() < self._half_width_m - NARROW_M else 0
            case FlipperReading():
                self._flipper_planner.update(signal)

    def _free_m(self) -> float:
        """Return the distance from the chair's middle to the nearer wall [m]; infinite without a wall in view."""
        return min((wall for wall in (self._where.left_wall_m, self._where.right_wall_m) if wall is not None), default=math.inf)

    def _narrow(self) -> str | None:
        """Return the wall that the chair, square to the stair, does not clear, with the remedy; None if the chair fits."""
        if self._narrow_maps < NARROW_MAPS:
            return None
        free_m, needs_m = self._free_m(), self._half_width_m
        wall, other = ("left", "right") if free_m == self._where.left_wall_m else ("right", "left")
        remedy = f"set the chair {needs_m + ASIDE_M - free_m:.2f} m further to the {other}"
        return f"the {wall} wall is {free_m:.2f} m from the chair's middle, which needs {needs_m:.2f} m: {remedy}"

    def _open_side(self, *, enters: bool) -> str | None:
        """Return the side on which the flight does not bear the chair, or was not seen to, with the remedy; None if both do.

        Args:
            enters: Whether the chair is about to drive onto the flight: a side that was not in view does not count as wide enough.
                A side whose width no map has measured is not checked.
        """
        sides: tuple[Side, Side] = ("left", "right")
        for side, other in zip(sides, sides[::-1], strict=True):
            seen_m, open_m = self._where.side_m(side)
            needs = f"the chair's middle, which needs {self._needs_m:.2f} m"
            if open_m is not None and open_m < self._needs_m:
                remedy = f"set the chair {self._needs_m - open_m:.2f} m further to the {other}, or take another way"
                return f"the flight's {side} side is open {open_m:.2f} m from {needs}: {remedy}"
            if enters and open_m is None and seen_m is not None and seen_m < self._needs_m:
                shown = f"was in view up to {max(seen_m, 0.0):.2f} m from" if math.isfinite(seen_m) else "was not in view from"
                return f"the flight's {side} side {shown} {needs}: start further away, or take another way"
        return None

    def _infeasible(self, *, enters: bool) -> str | None:
        """Return the reason why the chair must not enter the measured stair, once for each map; None if it may.

        Args:
            enters: Whether the chair is about to drive onto the flight: the measured rise and run then count as they are. Further
                away a stair is refused only if none that may be the true one can be entered, because the measurement improves
                on the way.
        """
        config, where, judged = self._config, self._where, (self._where.map_count, enters)
        if judged == self._judged:
            return None
        self._judged = judged
        if enters:
            return reject_reason(config.chair, config.payload_kg, where.rise_m, where.run_m, where.slope_rad)
        sigmas_m = (where.rise_sigma_m, where.run_sigma_m)
        return certain_reject_reason(config.chair, config.payload_kg, where.rise_m, where.run_m, sigmas_m)

    def _missing(self, within_m: float) -> str | None:
        """Return the missing step within ``within_m`` of the leading pulley, as a reason to stop; None if there is none."""
        sides = [(self.WAY * low - self._pivot_m, self.WAY * high - self._pivot_m) for low, high in self._where.gaps_ahead_m()]
        gap = min(((min(pair), max(pair)) for pair in sides if max(pair) > 0.0), default=None)
        if gap is None or gap[0] > within_m:
            return None
        (near_m, far_m), leading = gap, "front" if self.WAY > 0.0 else "rear"
        return f"a step is missing: {far_m - near_m:.2f} m from nosing to nosing, the first {beside(near_m)} the {leading} pulley"

    def _sweep(self, t_s: float, nowhere: str) -> MotionPlan:
        """Return the plan that turns to both sides to find the stair; at the end it holds with the reason ``nowhere``."""
        turned, self._turned_rad = self._turned_rad, 0.0
        turn = self._level.sweep(t_s, turned)
        return self._plan(t_s, 0.0, turn_m_s=turn or 0.0, needs_stair=False, hold=nowhere if turn is None else None)

    @property
    def _goes_on(self) -> bool:
        """Whether another flight follows the landing."""
        flights = self._config.flights
        return self._where.shows_another if flights is None else self._flights_done + 1 < flights

    def _look_on(self, t_s: float, estimate: HeadingEstimate | None, touched_rad: float) -> MotionPlan:
        """Return the plan that drives on over a landing until the next flight is in view, or the chair's pitch shows it."""
        config, gone_m = self._config, self.WAY * self._where.travel_m
        if gone_m > config.look_m or self._where.pitch_rad > touched_rad:
            view = "view" if self.WAY > 0.0 else "view behind"
            return self._stand(t_s, f"no flight in {view} within {gone_m:.1f} m on the landing", needs_stair=False)
        return self._plan(t_s, self.WAY * config.slow_m_s, turn_m_s=self._level.keep(estimate), needs_stair=False)

    def _begin_next(self, t_s: float, on_the_way: str = "") -> MotionPlan:
        """Return the plan that starts again with the flight across the landing."""
        seen = "seen" if self._where.shows_another else "not yet seen"
        self._face_flight()
        self._flights_done += 1
        return self._begin(t_s, "search", f"on a landing, flight {self._flights_done + 1}{on_the_way} {seen}")

    @property
    def _flipper(self) -> FlipperReading | None:
        return self._flipper_planner.reading

    @property
    def _step_m(self) -> float:
        """Distance from nosing to nosing [m]; 0 while no stair is known."""
        return math.hypot(self._where.rise_m, self._where.run_m)

    @property
    def _stepping_rad(self) -> float:
        """Flipper angle at which the tip clears a step [rad]."""
        return self._flipper_planner.clears(self._where.rise_m)

    def _lie(self, t_s: float, estimate: HeadingEstimate | None, square_rad: float = 0.0) -> FlipperCommand | None:
        """Return the flipper command on the flight: riding on the nosings while the chair is square, lifted above them to turn."""
        share = self._turning_share(estimate, square_rad)
        catches = self.CATCHES and self._may_follow(t_s, share)
        return self._flipper_planner.ride(t_s, self._step_m, share, falls_rad_s=self._tip_over.rate_rad_s if catches else 0.0)

    def _pitch_feedforward(
        self, t_s: float, estimate: HeadingEstimate | None, square_rad: float = 0.0, *, allowed: bool = True
    ) -> float:
        """Return the tip-over feed-forward [m/s]; no speed is added to a turning or slipping chair."""
        return self._tip_over.step(t_s, allowed=allowed and self._may_follow(t_s, self._turning_share(estimate, square_rad)))

    def _may_follow(self, t_s: float, share: float) -> bool:
        """Return whether flipper and belts may follow a fall: not while the chair turns, nor after the belts have slipped."""
        return share < 1.0 and self._has_grip(t_s)

    def _turning_share(self, estimate: HeadingEstimate | None, square_rad: float) -> float:
        off_rad = LIFTED_HEADING_RAD if estimate is None else abs(estimate.heading_rad - square_rad)
        return turning_share(off_rad, 0.0 if self._tracks is None else abs(self._tracks.right_m_s - self._tracks.left_m_s))

    def _has_grip(self, t_s: float) -> bool:
        """Return whether the belts have not slipped on this flight."""
        del t_s
        return True

    def _is_laid(self, t_s: float, estimate: HeadingEstimate) -> bool:
        """Return whether a chair that starts on a flight may drive; a held chair may not, since its flipper cannot move."""
        if self._tracks is not None and self._tracks.brake_on:
            return False
        return self._flipper_planner.is_laid(t_s, self._step_m, turning_share(abs(estimate.heading_rad), 0.0))

    @property
    def _on_a_flight(self) -> str:
        """Observations of a chair that starts on a flight, in words."""
        flipper = "" if self._flipper is None else f", flipper {self._flipper.angle_rad / DEG:+.0f}° off the belts"
        return f"on a flight, pitched by {self._where.pitch_rad / DEG:.1f}°{flipper}, the stair in view"

    def _steering(
        self, t_s: float, estimate: HeadingEstimate | None, square_rad: float = 0.0, *, climbs: bool = False, blind: bool = False
    ) -> float | None:
        """Return the turn on the flight: None for the heading controller to steer, 0 while steering is suspended.

        Args:
            t_s: Mission time.
            estimate: Latest heading estimate, if any.
            square_rad: Heading set point.
            climbs: Whether slip and roll-back suspend steering too, so that belts at equal speeds grip again.
            blind: Whether no stair is in view.
        """
        slip_m_s, roll_back_m = (self._where.slip_m_s(t_s), self._where.roll_back_m(t_s) or 0.0) if climbs else (0.0, 0.0)
        spared = blind and estimate is not None and abs(estimate.heading_rad - square_rad) < BLIND_RAD
        return (
            None
            if self._skid.steering_allowed(t_s, self._tracks, estimate, square_rad, slip_m_s, roll_back_m) and not spared
            else 0.0
        )

    def _stuck(self) -> str | None:
        """Return the reason to stop a chair that does not arrive where it drives to, or None; each re-arm allows another try."""
        ran_m, to_go_m = self._ran_m, self._to_go_m
        if ran_m < STUCK_SHARE * to_go_m + STUCK_M:
            return None
        self._ran_m = 0.0
        return f"the belts ran {ran_m:.1f} m for the {to_go_m:.1f} m to go: something is in the chair's way"

    def _stand(self, t_s: float, hold: str | None = None, *, needs_stair: bool = True) -> MotionPlan:
        """Return the plan that stops the belts."""
        return self._plan(t_s, 0.0, turn_m_s=0.0, needs_stair=needs_stair, hold=hold)

    def _begin(self, t_s: float, phase: Phase, cause: str, to_go_m: float = math.inf) -> MotionPlan:
        """Enter a phase and return the plan of this tick: the belts keep their speed, or stop."""
        self._phase, self._cause, self._from_m = phase, cause, self._where.travel_m
        self._ran_m, self._to_go_m = 0.0, to_go_m
        return self._plan(t_s, self._where.speed_m_s if phase in self.ROLLING else 0.0, turn_m_s=0.0)

    def _plan(
        self,
        t_s: float,
        speed_m_s: float,
        *,
        turn_m_s: float | None = None,
        heading_rad: float = 0.0,
        min_inner_speed_ratio: float | None = None,
        pitch_feedforward_m_s: float = 0.0,
        flipper: FlipperCommand | None = None,
        needs_stair: bool = True,
        hold: str | None = None,
    ) -> MotionPlan:
        """Return the plan of this tick; ``hold`` is repeated at each tick, so that it holds again after a re-arm if still valid."""
        return MotionPlan(
            t_s=t_s,
            phase=self._phase,
            speed_m_s=speed_m_s,
            turn_m_s=turn_m_s,
            heading_rad=heading_rad,
            min_inner_speed_ratio=min_inner_speed_ratio,
            pitch_feedforward_m_s=pitch_feedforward_m_s,
            flipper=flipper,
            needs_stair=needs_stair,
            cause=self._cause,
            hold=hold,
        )
