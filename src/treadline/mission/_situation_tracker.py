"""Situation tracker of one traversal: keeps its situation up to date by signals, ticks and states.

``PlannerInput, HeadingEstimate -> Situation``.
"""

import math
from dataclasses import replace

from treadline.control.flipper import LIES_RAD
from treadline.core.signals import FlipperReading, HeadingEstimate, ImuSample, OperatorInput, Phase, StairMap, TrackReading
from treadline.estimation.stair_tracker import SAME, StairTracker
from treadline.mission._situation import SIDE_M, Crossing, Situation, Way
from treadline.mission.entry_check import certain_reject_reason, reject_reason
from treadline.mission.mission_config import MissionConfig
from treadline.mission.planner import PlannerInput
from treadline.vehicle.loading import Loading

FURTHER_M = 0.1
"""Distance along the flight by which a chair has come further [m]: three standard deviations of the tracker's place on approach."""
NARROW_MAPS = 10
"""Number of consecutive maps in which a wall is nearer than half the chair's width less ``SIDE_M``. In a stair 1.2 m wide a chair
that started with 30° of heading error, 0.15 m off the middle, drove onto the wall's end and rolled by 21°."""


class SituationTracker:
    """Memory of what the signals of one traversal have shown.

    Args:
        config: Mission, of which chair, payload and number of flights count.
        way: Direction.
    """

    def __init__(self, config: MissionConfig, way: Way) -> None:
        loading = Loading(chair=config.chair, payload_kg=config.payload_kg)
        self.now = Situation(
            way=way, config=config, loading=loading, stair=StairTracker(), t_s=0.0, stalled_s=0.0, from_m=0.0, flights_done=0
        )
        self._goes, self._furthest_m = way.sign, -math.inf
        """Sign of the state's motion up the flight, and furthest place of the chair in that direction since it began [m]."""
        self._waiting: StairMap | None = None
        self._narrow_maps = 0
        self._judged = (0, False)
        """Number of maps when the stair was last judged, and whether the chair was about to enter."""
        self._first_rise_m = 0.0
        """Rise of the first step above the floor on which the chair stood before it [m]; 0 if it stood on none."""

    def face_next_flight(self) -> None:
        """Begin with the flight across the landing."""
        self._narrow_maps, self._judged, self._first_rise_m = 0, (0, False), 0.0
        now = replace(self.now, flights_done=self.now.flights_done + 1, stair=StairTracker(), crossing=Crossing())
        self.now = replace(now, is_narrow=False, has_entered=False, goes_back=False, presses=False)

    def update(self, signal: PlannerInput) -> None:
        """Update with one signal."""
        match signal:
            case ImuSample():
                self.now = replace(self.now, imu=signal)
                self.now.stair.update(signal)
            case TrackReading():
                self.now = replace(self.now, tracks=signal, presses=self.now.presses and not signal.brake_on)
                self.now.stair.update(signal)
            case FlipperReading():
                self.now = replace(self.now, flipper=signal)
            case StairMap() if signal.direction == self.now.way.direction:
                # Without a heading the distances of a map along the chair are not those up the flight: it waits for one.
                self._waiting = signal
                self._place_map(self.now.estimate)
            case OperatorInput():
                self.now = replace(self.now, goes_back=self.now.goes_back or signal.go_back)
                if signal.flight_ends:
                    self.now.stair.declare_end(self.now.way.direction)

    def begin_tick(self, t_s: float, estimate: HeadingEstimate | None) -> None:
        """Take time and heading of a tick."""
        before, stair = self.now, self.now.stair
        stalled_s = before.stalled_s + (0.0 if before.is_held else max(t_s - before.t_s, 0.0))
        if estimate is not None:
            if before.estimate is None:
                stair.forget_poses()
            stair.heading_rad = estimate.heading_rad
        self._place_map(estimate)
        here_m = self._goes * stair.up_m
        if here_m > self._furthest_m + FURTHER_M:
            self._furthest_m, stalled_s = here_m, 0.0
        around = stair.around(before.pivot_m)
        if around is not None:
            # The first step may have a floor covering, of 20 mm: maps measure it from a chair before it, behind no sill.
            first, pitch = around.nosings[0], around.pitch_rad
            is_before = abs(pitch) < LIES_RAD and first.ahead_m > before.config.chair.reach_m
            if is_before and not any(sill.end == "foot" for sill in before.sills):
                first_m = first.ahead_m * math.sin(pitch) + first.above_m * math.cos(pitch)
                # Twice the rise: the first step is not in view.
                self._first_rise_m = first_m if abs(first_m - around.rise_m) < SAME * around.rise_m else 0.0
            around = replace(around, rise_m=self._first_rise_m or around.rise_m)
        self.now = replace(self.now, t_s=t_s, estimate=estimate, stalled_s=stalled_s, around=around)

    def _place_map(self, estimate: HeadingEstimate | None) -> None:
        """Give the newest map to the tracker once a heading is known."""
        if self._waiting is None or estimate is None:
            return
        self.now.stair.update(self._waiting)
        self._waiting = None
        is_near = self.now.free_m < self.now.config.chair.half_width_m - SIDE_M
        self._narrow_maps = self._narrow_maps + 1 if is_near else 0
        self.now = replace(self.now, is_narrow=self._narrow_maps >= NARROW_MAPS)

    def enter(self, phase: Phase, cause: str, *, back: bool) -> None:
        """Begin a state that goes along the traversal, or against it."""
        from_m, has_entered = self.now.stair.travel_m, self.now.has_entered or phase == "approach"
        self.now = replace(self.now, phase=phase, cause=cause, from_m=from_m, has_entered=has_entered, is_off_heading=False)
        self._goes = -self.now.way.sign if back else self.now.way.sign
        self.try_again()

    def try_again(self) -> None:
        """Restart the time of the state: a person who re-arms the chair allows another try."""
        self.now = replace(self.now, stalled_s=0.0)
        self._furthest_m = self._goes * self.now.stair.up_m

    def judge(self) -> None:
        """Judge before the flight whether the measured steps exceed a limit of the chair; each map is judged once.

        Before the chair enters, the measured rise and run count as they are. Further away a stair is refused only if none that may
        be the true one can be entered, because the measurement improves on the way. At a single step the chair is pitched no more
        than with its rear on the floor, whatever run the map names.
        """
        now, config, stair, around = self.now, self.now.config, self.now.stair, self.now.around
        if not config.check or now.phase not in ("align", "approach") or self._judged == (stair.map_count, now.enters):
            return
        self._judged = (stair.map_count, now.enters)
        if around is not None and (now.enters or (len(around.nosings) == 1 and stair.top_ends)):
            slope_rad = min(stair.slope_rad, around.floor_rad(now.pivot_m, config.chair.tracks.pulley_radius_m))
            refusal = reject_reason(config.chair, config.payload_kg, stair.rise_m, stair.run_m, slope_rad)
        else:
            sigmas_m = (stair.rise_sigma_m, stair.run_sigma_m)
            refusal = certain_reject_reason(config.chair, config.payload_kg, stair.rise_m, stair.run_m, sigmas_m)
        self.now = replace(now, refusal=refusal)
