"""The guard's limits, each with its reason, and the groups of the traversal's phases that its rules name."""

from dataclasses import dataclass

from treadline.core.angles import DEG
from treadline.core.signals import MEMORY_S, View
from treadline.core.step_sizes import OBSTACLE_CLEAR_M, TURN_CLEAR_M

SILENCE_S = 0.3
"""Longest silence of what must speak, and longest standstill of a loop [s]: more than a control period of 0.25 s, and within the
0.8 s of rows 11 and 22 less the stopping time of the belts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardConfig:
    """Limits of the guard, each with its reason; "row" is a row of the table of hazards in docs/explanation/safety.md.

    The fields without a default come from the chair file and from the controller.
    """

    belt_limit_m_s: float
    """Largest speed of one belt [m/s]: Table I, v_system(max). A reading beyond twice this speed is not physical: a chair that runs
    away down 28° at this speed gains 0.9 m/s until the runaway is found."""
    drive_lag_s: float
    """Time constant of the belt drives [s]."""
    drive_acceleration_m_s2: float
    """Largest acceleration of the belt drives [m/s²]."""
    seat_rate_m_s: float | None
    """Largest rate of the seat's stroke [m/s]; None for a chair without a seat linkage."""
    flipper_rate_rad_s: float | None
    """Largest rate of the flipper [rad/s]; None for a chair without a flipper."""
    front_m: float
    """Distance from mid-track to the foremost part of the chair, with the flipper in line with the belts [m]."""
    rear_m: float
    """Distance from mid-track to the rearmost part of the tracks [m]."""
    gauge_m: float
    """Distance between the belts' centre lines [m]; the turn by the belts is inversely proportional to it."""
    track_span_m: float
    """Flat run of the belts [m]: three nosings that lie closer together always bear it (row 17)."""
    track_on_stair_m: float
    """Length of the track on a flight, with a flipper in line [m]: two steps are shorter (paper, Section II.A; row 17)."""
    level_turn_share: float
    """Turn by the belts on flat ground, as a share of that of belts that do not skid (``vehicle.traction``)."""
    normal_slip: float
    """Largest slip ratio by the nosings of a sound chair that drives straight (row 14, ``vehicle.traction``)."""
    driver_timeout_s: float
    """Time without a command, or without a tick, after which the guard holds [s]: three control periods. From half of this time the
    belts ramp down (row 11)."""

    cruise_limit_m_s: float = 0.30
    """Largest mean belt speed of a chair square to the stair [m/s]: it can stop within one step."""
    turn_limit_m_s: float = 0.55
    """Largest mean belt speed while turning back to square [m/s]: a turn with one belt at its limit needs this speed."""
    square_rad: float = 5.0 * DEG
    """Heading error up to which a chair is square to the stair [rad]: the cruise limit holds. Over crest and edge a larger error is
    a fault: the chair arrives there square, and turns by 3° at most without a fault."""
    slow_limit_m_s: float = 0.10
    """Largest mean belt speed under a speed restriction (a missing sensor, slip, a gap ahead), and while the chair pitches:
    mounting, crest, edge, last step (row 18) [m/s]."""
    plan_margin: float = 0.25
    """Largest mean belt speed above the planned speed, as a share of the planned speed: steering on a stair adds to the mean."""
    plan_spare_m_s: float = 0.02
    """Absolute part of that margin [m/s]."""

    ahead_s: float = 0.1
    """Largest lead of a stamp over the guard's clock [s]; a message with a larger lead is rejected. Ten ticks, so that a late tick
    rejects nothing, and a third of the silences, so that no stamp conceals a silence for long. Rate commands to seat and flipper,
    which are repeated at each tick, are valid as long."""
    clock_jump_s: float = 1.0
    """Largest leap of a clock [s]; a larger one is a fault (row 10)."""
    silence_s: float = SILENCE_S
    """Longest silence of what must speak: frames, belts, seat, flipper, plan, estimate, operator's link [s]. Three frames at 10 Hz
    (row 1), the timeout of the actuators' own watchdog, and row 21. Belt speeds are integrated over no longer gap."""
    imu_timeout_s: float = 0.05
    """Time without an IMU sample after which the IMU counts as missing [s], and duration of a pitch, roll or pitch rate beyond its
    limit after which it is a fault: five samples at 100 Hz (row 6), longer than a shock, shorter than a fall."""
    vision_only_s: float = 1.0
    """Time without the IMU after which the guard holds [s] (row 6)."""
    blind_timeout_s: float = MEMORY_S
    """Time without a frame after which the guard holds [s] (row 1): the longest of the timeouts. A message older than this is
    rejected, a younger one is placed where the chair was then, and an image that repeats within this time is frozen."""
    blind_travel_m: float = 0.5
    """Belt travel without a frame after which the guard holds [m] (row 1)."""
    lost_timeout_s: float = 12.0
    """Time with frames but without a stair after which the guard holds [s]; the gyro carries the heading meanwhile."""
    heartbeat_timeout_s: float = 0.75
    """Longest silence of a process after its first heartbeat [s] (row 22)."""
    processes: tuple[str, ...] = ()
    """Processes of the graph, whose silence is a fault; nobody awaits the heartbeat of another."""
    lasting_s: float = 0.5
    """Duration after which slip, or a disagreement between camera and gyro, is a fault (rows 7 and 14), and window of the slip
    ratio [s]."""
    frozen_travel_m: float = 0.05
    """Belt travel with unchanged headings or maps above which the camera counts as frozen [m] (row 2)."""

    blind_turn_rad: float = 3.0 * DEG
    """Largest turn by the belts while no stair is in view [rad]. Without a fault it is at most 1.9° in runs at 22 and 28° with
    friction 0.62/0.5 and 0.9/0.5 (row 7: true heading error of 5°)."""
    gyro_drift_rad_s: float = 1.5 * DEG
    """Largest gyro drift that may go undetected [rad/s]: half as much again as in row 7."""
    blind_turn_s: float = 6.0
    """Window of that turn [s]: a constant load causes a slowly growing turn by the belts."""

    valid_least: float = 0.15
    """Smallest share of valid depth pixels of a frame (row 4)."""
    valid_least_dark: float = 0.3
    """Smallest share of valid depth pixels of a frame without usable colours (row 3)."""
    alive_least: float = 0.02
    """Share of valid depth pixels below which, without usable colours, a camera counts as dead. Over a crest the camera looks
    across a landing and detects no stair, but is alive."""
    dark: float = 0.02
    """Mean colour, 0 to 1, below which a frame is too dark, and above one minus which it is too bright, for its colours to be
    used."""
    contrast_least: float = 0.008
    """Standard deviation of the colours, 0 to 1, below which they are not used: two of 256 steps, the noise of a sensor."""

    deviation: float = 0.3
    """Largest deviation of a belt from the speed expected of its drive, as a share of that speed (row 13)."""
    mismatch_spare_m_s: float = 0.03
    """Absolute part of the deviation of a belt, and speed up to which a belt stands [m/s]."""
    mismatch_s: float = 0.2
    """Duration of a deviation of a belt after which it is a fault [s]: longer than the drives' lag of 0.15 s."""
    slip_turn_rad: float = 0.25 * DEG
    """Change of heading in ``lasting_s`` above which the chair turns [rad]: what it skids by then is no slip."""
    roll_back_m: float = 0.25
    """Largest roll-back by the nosings, turning or not [m]; the chair then stops within 0.30 m."""

    pitch_rate_rad_s: float = 25.0 * DEG
    """Largest pitch rate [rad/s] (row 18)."""
    front_up_rad: float = 40.0 * DEG
    """Largest pitch [rad]: the steepest flight, 32°, and the rocking of a chair that mounts."""
    front_down_rad: float = 15.0 * DEG
    """Largest negative pitch [rad]. No phase lowers the front below horizontal: the chair descends rearwards, and the crest ends
    horizontally."""
    roll_rad: float = 20.0 * DEG
    """Largest roll [rad]; a chair with 35° of heading on a flight of 30° has 17°."""
    level_rad: float = 2.0 * DEG
    """Pitch within which chassis or seat is level, and change of the seat's error that is judged [rad]: less than the seat's limit,
    more than its sensor's noise."""
    seat_steady_m_s: float = 0.02
    """Largest rate of the seat's stroke, nearly level, on flat ground and on the flight [m/s]. A seat that follows the rocking on
    uneven steps excites it: to 33 °/s with a payload of 104 kg, 10 °/s with this limit."""
    seat_rad: float = 5.0 * DEG
    """Largest seat pitch over ``seat_s`` [rad], from the table of hazards (row 19); a thousand sound traversals had at most
    1.8°."""
    seat_s: float = 1.0
    """Duration of a larger seat pitch after which it is a fault [s]."""

    battery_least_v: float | None = None
    """Least voltage of the battery (row 28), from the robot file [V]; None: not watched."""
    battery_s: float = 1.0
    """Duration of a lower voltage after which the battery is empty [s]: longer than the dip when the belts start."""

    turn_outline_m: tuple[float, float, float] | None = None
    """Distances from mid-track to the rear, the front and a side of a chair that turns on a landing, its flipper folded [m]; None:
    it does not turn."""
    turn_centre_m: float = 0.0
    """Distance of the centre of turns on the spot ahead of mid-track [m]."""
    turn_clear_m: float = TURN_CLEAR_M
    """Distance to keep from an edge or a wall on a landing on which the chair turns [m]."""
    gap_clear_m: float = 0.2
    """Distance to keep from a gap, in addition to the stopping distance [m]."""
    obstacle_clear_m: float = OBSTACLE_CLEAR_M
    """Distance to keep from an obstacle or an end of the ground, in addition to the stopping distance [m] (row 25)."""
    stopping_s: float = 0.4
    """Time of the stopping distance [s]: two frames, a control tick and the brake."""

    awaits_ground: bool = False
    """Whether the camera reports where the ground ends (``FreeGround``): the chair then drives only over known ground, and stops
    before a drop."""
    awaits_map: bool = False
    """Whether the detector sends a stair map with each heading; headings without one then hold the chair."""
    awaits_health: bool = False
    """Whether the estimator sends its health; it is then awaited from the first measured heading on."""
    view: View = "front"
    """Viewing direction of the camera: what frames and maps show is ahead of the chair in this direction."""
    needs_heading: bool = True
    """Whether sensor timeouts, attitude and heading are monitored; False for open-loop runs."""
    has_camera: bool = True
    """Whether frames are awaited; False on the bench, where the inertial sensor alone is monitored."""
    has_planner: bool = True
    """Whether plans must arrive; False where a person drives."""
    watches_slip: bool = True
    """Whether slip is monitored; False for runs that skid by design: excitation, and the paper's allocation."""
    watches_motion: bool = True
    """Whether motion is compared with the commands; False for recordings, in which commands have no effect."""


SAME_M = 0.14
"""Largest distance between a nosing and its expected position, and between two sightings of one gap [m]: less than half of the
shortest pitch."""
FLIGHT = ("drive", "climb", "descend")
"""Phases on the flight; the cruise limit holds instead of the planned speed, because steering adds to the mean."""
TIPPING = ("crest", "edge")
"""Phases on one nosing and the flipper's tip; without a measured pitch the chair must stop at once."""
OVER = (*TIPPING, "land", "leave")
"""Phases from the end of the flight to flat ground, with no stair in view."""
PITCHING = ("mount", *TIPPING, "leave")
"""Phases in which the chair pitches; the mean belt speed stays low even during a turn."""
STEADY = ("search", "align", "approach", *FLIGHT)
"""Phases with constant pitch; a seat near horizontal moves slowly."""
ENDS = ("arrived", "refused")
"""Final phases."""
