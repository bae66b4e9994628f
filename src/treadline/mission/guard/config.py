"""The guard's limits, each with its reason."""

from dataclasses import dataclass

from treadline.angles import DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardConfig:
    """Limits, each with its reason; "row" is one of the table of hazards in docs/decisions/0014."""

    belt_limit_m_s: float = 1.0
    """Table I: v_system(max)."""
    cruise_limit_m_s: float = 0.30
    """Mean of the belts when square to the stair: what can be stopped within a step."""
    turn_limit_m_s: float = 0.55
    """Mean of the belts while turning back to square: a turn with one belt at its limit needs it."""
    turning_rad: float = 5.0 * DEG
    """Beyond this heading the turn limit holds instead of the cruise limit."""
    blind_limit_m_s: float = 0.10
    """Mean of the belts while a sense is missing, or something is wrong that may pass."""
    edge_limit_m_s: float = 0.10
    """Mean of the belts where the chair pitches: mounting, over crest and edge, off the last step (row 18)."""
    plan_margin: float = 0.25
    """By how much the mean may exceed the plan's speed: steering on a stair adds to it."""
    plan_spare_m_s: float = 0.02

    imu_timeout_s: float = 0.05
    """Five samples of 100 Hz: a late one is no loss (row 6)."""
    vision_only_s: float = 1.0
    """Without IMU (row 6)."""
    frame_timeout_s: float = 0.3
    """Three frames of 10 Hz (row 1)."""
    blind_timeout_s: float = 3.0
    """Without any frame."""
    blind_travel_m: float = 0.5
    """Of the belts, without any frame."""
    ahead_s: float = 0.1
    """A message stamped further ahead of the guard's clock is rejected: ten ticks, so that a late tick rejects nothing, and a third
    of the shortest timeout, so that no stamp hides a silence for long."""
    plan_timeout_s: float = 0.3
    """Age of a plan, as of an estimate and of the operator's link: beyond it the planner has failed."""
    estimate_timeout_s: float = 0.3
    """Between the estimate's own time and now, either way: a clock that leapt, a gyro that is dead."""
    lost_timeout_s: float = 12.0
    """Frames arrive but none shows a stair: the gyro carries the heading this long."""
    disagreement_s: float = 0.5
    """Vision and gyro differ, and nobody knows who errs (row 7)."""
    blind_turn_rad: float = 3.0 * DEG
    """Largest turn by the belts while no stair is seen; without a fault it is at most 1.9° in runs at 22 and 28° with friction
    0.62/0.5 and 0.9/0.5 (row 7: true error of 5°)."""
    gyro_drift_rad_s: float = 1.5 * DEG
    """Largest drift of the gyro that may go undetected, half as much again as in row 7."""
    blind_turn_s: float = 6.0
    """Over which: what a steady load asks of the belts adds up slowly."""
    max_heading_error_rad: float = 5.0 * DEG
    """Heading where the chair pitches: it comes there square, and without a fault turns by 3° at most."""
    driver_timeout_s: float = 0.75
    """Three control periods: without a command or a tick for half of them the belts ramp down, then the guard holds (row 11)."""
    readings_timeout_s: float = 0.3
    """Of belts, seat or flipper that have spoken once: as long as the actuators' own watchdog waits for a command."""
    heartbeat_timeout_s: float = 0.75
    """Of a process that has spoken once (row 22)."""
    link_timeout_s: float = 0.3
    """Of an operator who has spoken once (row 21)."""
    clock_jump_s: float = 1.0
    """A clock that leaps further is no longer believed (row 10)."""
    frozen_travel_m: float = 0.05
    """Of the belts, under headings or maps that repeat themselves (row 2)."""

    valid_least: float = 0.15
    """Share of a depth image without which nothing is seen in it (row 4)."""
    valid_least_dark: float = 0.3
    """The same where the colours do not help (row 3)."""
    alive_least: float = 0.02
    """Share of a depth image below which a camera is dead, even over a crest, where it looks across a landing and sees no stair."""
    dark: float = 0.02
    """Mean of the colours below which, or above one less which, they say nothing."""
    contrast_least: float = 0.008
    """Standard deviation of the colours below which they say nothing: two of 256 steps, a sensor's own noise."""

    drive_lag_s: float = 0.15
    drive_acceleration_m_s2: float = 4.0
    """The belts' drives: what they may lag behind a command."""
    mismatch: float = 0.3
    """Share by which a belt's speed may differ from what its drive should make of the command (rows 13 and 14)."""
    mismatch_spare_m_s: float = 0.03
    mismatch_s: float = 0.2
    """For which it must last: longer than a drive's lag of 0.15 s."""
    slip: float = 0.3
    """Share of the belts' travel that the nosings do not show (row 14): a sound chair that drives straight shows 1 mm in 60."""
    slip_s: float = 0.5
    """Over which slip is measured, and for which it may last."""

    slip_turn_rad: float = 0.25 * DEG
    """A chair that turns by more meanwhile skids, as all tracks do: what slips is not told from it."""
    roll_back_m: float = 0.25
    """By the nosings, turning or not: 0.30 m when it stands."""

    pitch_rate_rad_s: float = 25.0 * DEG
    """Row 18: never above."""
    front_up_rad: float = 40.0 * DEG
    """The steepest flight of 32° and what a chair rocks when it mounts."""
    front_down_rad: float = 15.0 * DEG
    """Nothing on a stair lowers the front: it is backed down, and the crest is let down to the level."""
    roll_rad: float = 20.0 * DEG
    """At 35° across a flight of 30° it is 17°."""
    seat_steady_m_s: float = 0.02
    """Of the seat's stroke on the level and on the flight itself: a seat that follows each rocking of the chair on uneven steps
    drives it (a payload of 104 kg to 33 °/s, where 10 °/s are left without)."""
    seat_near_rad: float = 2.0 * DEG
    """Off level by more, it has all its actuator gives."""
    seat_rad: float = 5.0 * DEG
    """Off level for ``seat_s``, which the table of hazards asks for (row 19): 1.8° is the most in a thousand sound traversals."""
    seat_s: float = 1.0

    front_m: float = 0.995
    """From mid-track to the foremost part of the chair, its flipper laid in line with the belts."""
    rear_m: float = 0.55
    """From mid-track to the rearmost part of the tracks."""
    gauge_m: float = 0.65
    """Between the belts: how far they turn the chair goes with its inverse."""
    track_span_m: float = 0.95
    """Flat run: three neighbouring nosings lie closer together, or the track would rest on one (row 17)."""
    gap_clear_m: float = 0.2
    """Before a gap."""
    obstacle_clear_m: float = 0.34
    """Before whatever stands in the way (row 25): 0.3 m is asked, and its distance is known to some centimetres."""
    stopping_s: float = 0.4
    """Two frames' time, a control tick and the brake: the way of the chair in it is added to both."""

    needs_heading: bool = True
    """False only for runs whose purpose is to drive without: open loop. Senses and attitude are not watched then."""
    watches_slip: bool = True
    """False where a chair is meant to skid: random belts, the paper's allocation."""
    watches_motion: bool = True
    """False only where no command moves the chair: a recording."""
