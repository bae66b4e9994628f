"""Follower of a way: belts and flipper over the ends of a flight, by the table of ways looked up from what is measured.

``ImuSample, FlipperReading, TrackReading, Terrain -> FollowCommand``. The ground is drawn from the known nosings, and a table of
ways over it (``vehicle.way``) is filled a portion a tick. Each tick looks the measured place, flipper angle and pitch up in it:
there is no stored path, and no case for kerb, foot, crest or edge. The pitch shows by how much place and flipper angle differ from
those on the table's ground. A contact that the table predicts must be measured before more weight goes onto it.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from treadline.control.flipper import PATIENCE_S, UNLOADED_SHARE, FlipperRate, Tip, flipper_of
from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.signals import TICK_S, FlipperCommand, FlipperReading, ImuSample, TrackReading
from treadline.estimation.known_nosings import KnownNosings
from treadline.vehicle.loading import Loading
from treadline.vehicle.rest_poses import Ground, RestChair, RestPose, nosings_of, rest_chair
from treadline.vehicle.traction import friction_needed
from treadline.vehicle.way import FLIPPER_RAD_S, PITCH_RAD_S, SPEED_M_S, WayState, WayTable, steepest_rad

Place = Literal["before", "foot", "ride", "top", "past"]
"""Where a chair is: before the flight, over its foot, on it with the flipper riding, over its upper end, or past it."""

Outline = Sequence[tuple[float, float]]
"""Vertices of a sill: distance away from the flight and height above the ground at its end [m], the nearest first."""
NOSING_RADIUS_M = 0.01
"""Radius of a nosing that is not known better [m]."""
UNSEEN_STEPS = 8
"""Number of steps by which a flight goes on where its end is not known: more than a chair reaches."""
REACH_M = 2.0
"""Length of a way that is planned [m]: a chair with its flipper and a step."""
BEFORE_M = 0.3
"""Distance before the reach of flipper or belts at which the follower takes over [m]: the time in which the flipper turns by 50°.
A way ends half as far beyond an end."""
CLEARS_M = 0.1
"""Distance beyond the landing's edge of the front pulley, from which the belts lie on the flight on the way down, and of the tip,
from which the flipper rides; half of it before the front pulley reaches the edge the flipper reaches down on the way up [m]."""
NEAR_M, SLOW_FROM_M = 1.2, 0.5
"""Distance of the nosings that concern a chair, and distance before an end at which it slows down [m]."""
MOVED_M = 0.008
"""Change of a nosing against its neighbours that asks for another way [m]: three standard deviations of a nosing in view."""
REPLANS_S, PORTIONS_PER_S = 1.0, 100.0
"""Least time between two plannings [s], and portions of a table that are filled in a second [1/s]: one a tick."""
LOOK_S = 0.5
"""Time along the way to the state towards which belts and flipper move [s]."""
PACE_PER_S, STOPS_RAD_S = 1.0, 4.0 * DEG
"""Rate at which a chair takes up its pace [1/s], and change of the pitch rate on the way ahead from which it is slower [rad/s]: a
contact ends the pitch's motion at once, at 5 cm/s at the seat."""
PRESS_RAD_S = 10.0 * DEG
"""Rate at which the tip is pressed down where a contact is not measured [rad/s]."""
CONTACT_SHARE, LIFTED_RAD, TIP_FRICTION = 0.5, 0.7 * DEG, 1.0
"""Share of its load from which a contact counts as measured, angle by which a tip that bears lifts the chair [rad], and friction of
rubber on dry ground at most, by which a tip that reaches far down stands without torque."""
PLACE_SIGMA_M, ANGLE_SIGMA_RAD, PITCH_SIGMA_RAD = 0.015, 1.3 * DEG, 0.1 * DEG
"""Standard deviations of a chair's place by the tracker [m], of the flipper's angle on the ground, 10 mm at its tip, and of the
pitch [rad]."""
LEANS_SIGMA_M, LOAD_SHARE, LEANS_M, LEANS_S = 0.10, 0.2, 0.07, 0.5
"""Standard deviations of the payload's place along the chair [m] and of the tip's load, as a share: friction of a tip that slides
or stands; change of that place that asks for another way [m], and time constant of its correction [s]."""
CORRECTS_S, CONTACT_RAD_S, AGREES_RAD = 0.2, 5.0 * DEG, 2.0 * DEG
"""Time constant of the correction by the pitch [s], rate by which the angle is corrected where one of tip and table alone bears
[rad/s], and difference of the pitch of another rest pose [rad]; at twice of it for ``LOOK_S`` the chair stands."""
IDLE_RAD, IDLE_S = 12.0 * DEG, 3.0
"""Angle by which a flipper may lag behind its commands [rad]: six times a motor's lag; and time after which a command
is forgotten [s]."""
WAITS = f"nothing carried the flipper in {PATIENCE_S:.0f} s: its motor is dead, or the landing is not there"
SLIPS = f"the chair stayed for {PATIENCE_S:.0f} s while the belts ran: they slip on the last nosing"
STALLS = f"the chair stayed for {PATIENCE_S:.0f} s while its flipper pressed on the ground: its motor is too weak for this load"
TICK_MAX_S = 10.0 * TICK_S
"""Longest time step [s]; a longer pause does not count as waiting for belts or flipper."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowCommand:
    """Belt speed and flipper rate at a tick, and where the chair is on its way."""

    place: Place
    speed_m_s: float
    """Speed of both belts [m/s]; negative backs down."""
    flipper: FlipperCommand
    tip_n: float
    """Load on the flipper's tip from motor torque [N]."""
    is_unloaded: bool
    """Whether nothing leans on the tip."""
    state: WayState | None = None
    """State of the table that is nearest to the chair; None while it does not follow a way."""
    table: WayTable | None = field(default=None, repr=False, compare=False)
    """Table that was filled last; None before the first."""
    is_slow: bool = False
    """Whether the end of the flight is near."""
    barred: str = ""
    """Why the chair does not come further; empty while it does."""
    slips: bool = False
    """Whether it does not come further because its belts slip."""

    @property
    def way(self) -> str:
        """Least margin to tipping and largest torque of the way, in words."""
        if self.table is None:
            return "no way yet"
        way = self.table.path(self.table.start)
        if way is None:
            return "no way over it"
        return f"on its way at least {way.margin_rad / DEG:.0f}° to tipping, at most {way.torque_n_m:.0f} N m at the flipper"

    @property
    def leads(self) -> bool:
        """Whether belts and flipper follow the way here."""
        return self.place in ("foot", "top")


@dataclass(frozen=True, slots=True, kw_only=True)
class Terrain:
    """Known ground at a tick, in the vertical plane along the flight, by the stair tracker's coordinates."""

    ground: Ground
    x_m: float
    """Place of mid-track [m]."""
    foot_m: float
    """Place of the first nosing [m]; minus infinity while it is not known."""
    top_m: float
    """Place of the landing's edge [m]; infinity while it is not known."""


def terrain_of(
    around: KnownNosings, x_m: float, known_ends: tuple[bool, bool], *, foot: Outline = (), top: Outline = ()
) -> Terrain:
    """Return the ground by the known nosings; where its end is not known the flight goes on as it is.

    Args:
        around: Known nosings.
        x_m: Place of mid-track.
        known_ends: Whether the lowest known nosing is the first one, and whether the uppermost is the landing's edge.
        foot: Sill before the first nosing: distances and heights of its vertices.
        top: Sill behind the landing's edge.
    """
    c, s = math.cos(around.pitch_rad), math.sin(around.pitch_rad)
    places = np.array([(x_m + n.ahead_m * c - n.above_m * s, n.ahead_m * s + n.above_m * c) for n in around.nosings])
    low, high = (places[1] - places[0], places[-1] - places[-2]) if len(places) > 1 else 2 * (np.array([0.3, around.rise_m]),)
    steps = np.arange(1.0, UNSEEN_STEPS + 1.0)[:, None]
    below = places[:0] if known_ends[0] else places[0] - steps[::-1] * low
    beyond = places[:0] if known_ends[1] else places[-1] + steps * high
    nosings = np.concatenate([below, places, beyond])
    levels_m = np.concatenate([[nosings[0, 1] - around.rise_m], nosings[:, 1]])
    flight = np.zeros((2 * len(nosings), 3))
    flight[:, 0], flight[:, 1], flight[1::2, 2] = nosings[:, 0].repeat(2), levels_m.repeat(2)[1:-1], NOSING_RADIUS_M
    foot_m, top_m = float(places[0, 0]) if known_ends[0] else -math.inf, float(places[-1, 0]) if known_ends[1] else math.inf
    before = _level((nosings[0, 0], levels_m[0]), -1.0, foot if known_ends[0] else ())[::-1]
    behind = _level((nosings[-1, 0], levels_m[-1]), 1.0, top if known_ends[1] else ())
    return Terrain(ground=np.concatenate([before, flight, behind]), x_m=x_m, foot_m=foot_m, top_m=top_m)


def _level(end_m: tuple[float, float], sign: float, outline: Outline) -> Ground:
    """Return the ground beyond an end of a flight, the nearest vertex first."""
    vertices = [(end_m[0] + sign * out_m, end_m[1] + z_m, 0.0) for out_m, z_m in outline]
    last_m = vertices[-1] if vertices else (*end_m, 0.0)
    return np.array([*vertices, (last_m[0] + 2.0 * sign * REACH_M, last_m[1], 0.0)])


class Follower:
    """Follows the way over the ends of one flight.

    Args:
        loading: Chair and assumed load.
        sign: 1 on the way up, -1 down.

    Raises:
        MechanicsError: If the chair has no flipper.
    """

    def __init__(self, loading: Loading, sign: float) -> None:
        chair = loading.chair
        flipper, tracks = flipper_of(chair), chair.tracks
        self._sign = sign
        self._loading, self._leans_m = loading, 0.0
        """Assumed load, and by how much its centre of mass is ahead of the assumed one, by the tip's load [m]: not more than 0."""
        self._chair, self._planned_m = rest_chair(chair, loading.payload_kg), 0.0
        """Chair by which ways are planned, and by how much its load leans ahead [m]."""
        self._tip, self._rate = Tip(loading), FlipperRate(flipper)
        self._range_rad = (flipper.range_deg[0] * DEG, flipper.range_deg[1] * DEG)
        self._pivot_m, self._length_m, self._radius_m = 0.5 * tracks.flat_run_m, tracks.approach_m, tracks.pulley_radius_m
        self._rest_rad, self._rear_m = tracks.approach_angle_deg * DEG, chair.rear_m
        self._turns_back, self._barred = False, ""
        self._t_s: float | None = None
        self._forget()

    def _forget(self) -> None:
        """Forget the way."""
        self._table: WayTable | None = None
        self._filling: tuple[WayTable, Iterator[None]] | None = None
        self._made_s = -math.inf
        self._filled: WayTable | None = None
        """Table that was filled last."""
        self._ahead_m = 0.0
        """Distance by which the chair is further ahead on the table's ground than on the present one [m]."""
        self._begin()

    def _begin(self) -> None:
        """Begin to follow, from rest and without corrections."""
        self._place_m = self._offset_rad = self._pace = self._waited_s = self._elsewhere_s = 0.0
        """Corrections of place [m] and flipper angle [rad] by the pitch, share of the pace, time without progress, and at
        another pitch than that of the way [s]."""
        self._asked_rad, self._angle_rad = 0.0, math.nan
        """Angle by which the flipper lags behind its commands, and its last angle [rad]."""
        self._watched: tuple[WayTable | None, float] = (None, math.inf)
        """Table, and least cost to go on it [s]."""
        self._has_carried, self._ran_m, self._stayed_m = False, 0.0, 0.0
        """Since the chair last came further: whether the tip has carried, way of the belts, infinite once the chair was behind its
        place, and by how much the tip stayed behind its commands [m]."""

    def turn_back(self) -> None:
        """Go back to where the chair came from."""
        if not self._turns_back:
            self._turns_back = True
            self._forget()

    def step(self, imu: ImuSample, flipper: FlipperReading, tracks: TrackReading, terrain: Terrain) -> FollowCommand:
        """Return the command of a tick. While the brake is on, time does not advance."""
        since_s = 0.0 if self._t_s is None else max(imu.t_s - self._t_s, 0.0)
        tick_s = dt_s = min(since_s, TICK_MAX_S)
        self._t_s = imu.t_s
        if since_s > TICK_MAX_S:  # others have commanded the flipper
            self._asked_rad, self._angle_rad = 0.0, math.nan
        self._tip.step(imu.pitch_rad, flipper, dt_s)
        if tracks.brake_on:
            dt_s, self._barred = 0.0, ""
            self._pace = self._waited_s = self._asked_rad = 0.0
            self._rate.stop()
        place = self._place(terrain)
        self._plan(terrain, place, flipper, imu, tick_s)
        self._ran_m += 0.5 * abs(tracks.left_m_s + tracks.right_m_s) * dt_s
        state, speed, rate = self._follow(terrain, place, flipper, imu.pitch_rad, dt_s)
        return FollowCommand(
            place=place,
            speed_m_s=speed,
            flipper=FlipperCommand(t_s=imu.t_s, rate_rad_s=self._rate.step(rate, dt_s)),
            tip_n=self._tip.load_n,
            is_unloaded=self._tip.is_unloaded,
            state=state,
            table=self._filled,
            is_slow=self._is_slow(terrain),
            barred=self._barred,
            slips=self._barred == SLIPS,
        )

    # --- the way

    def _place(self, terrain: Terrain) -> Place:
        """Return where the chair is."""
        x_m, pivot_m, reach_m = terrain.x_m, self._pivot_m, self._pivot_m + self._length_m
        if self._sign > 0.0:
            starts_m = (terrain.foot_m - reach_m - BEFORE_M, terrain.foot_m + pivot_m, terrain.top_m - pivot_m - 0.5 * CLEARS_M)
            if x_m > terrain.top_m + self._rear_m:
                return "past"
            return "top" if x_m > starts_m[2] else "ride" if x_m > starts_m[1] else "foot" if x_m > starts_m[0] else "before"
        if x_m < terrain.foot_m - reach_m:
            return "past"
        if x_m > terrain.top_m + self._rear_m + BEFORE_M:
            return "before"
        return "top" if x_m > terrain.top_m - reach_m - CLEARS_M else "foot" if x_m < terrain.foot_m + pivot_m else "ride"

    def _plan(self, terrain: Terrain, place: Place, flipper: FlipperReading, imu: ImuSample, tick_s: float) -> None:
        """Fill the next table by a portion, or begin one where the ground is another than that of the table."""
        if self._filling is not None:
            table, portions = self._filling
            for _ in range(math.ceil(tick_s * PORTIONS_PER_S)):
                if next(portions, self) is self:
                    self._table = self._filled = table
                    self._filling = None
                    break
        ahead_m = None if self._table is None else self._ahead(self._table, terrain)
        self._ahead_m = self._ahead_m if ahead_m is None else ahead_m
        free = place in ("before", "ride") or self._tip.is_unloaded
        due = self._table is None or (free and ahead_m is None and imu.t_s > self._made_s + REPLANS_S)
        if self._filling is not None or not due or place == "past" or not self._is_near(terrain):
            return
        self._made_s = imu.t_s
        end_m, end_rad = self._end(terrain)
        try:
            start = self._chair.at(terrain.ground, terrain.x_m, (flipper.angle_rad,), imu.pitch_rad)
            ground = terrain.ground
            # Over a single nosing the chair is pitched with its rear before it.
            single_rad = math.atan2(float(nosings_of(ground)[-1, 1] - ground[0, 1]), self._pivot_m)
            known = friction_needed(steepest_rad(ground, single_rad))
            table = WayTable(self._chair, ground, start, end_m, self._range_rad, end_rad=end_rad, known_friction=known)
        except MechanicsError:
            return
        self._filling = table, table.fill()

    def _is_near(self, terrain: Terrain) -> bool:
        """Return whether an end of the flight is so near that a way is needed soon."""
        foot_m, top_m = terrain.x_m - terrain.foot_m, terrain.top_m - terrain.x_m
        first_m, second_m = (foot_m, top_m) if self._sign > 0.0 else (top_m, foot_m)
        early_m = 0.8 * SLOW_FROM_M  # a table is full in about two seconds
        reach_m = self._pivot_m + self._length_m + BEFORE_M + early_m
        return -reach_m < first_m < self._pivot_m or second_m < self._pivot_m + SLOW_FROM_M + early_m

    def _is_slow(self, terrain: Terrain) -> bool:
        """Return whether the end of the flight is near."""
        to_end_m = terrain.top_m - terrain.x_m if self._sign > 0.0 else terrain.x_m - terrain.foot_m
        return to_end_m < self._pivot_m + SLOW_FROM_M

    def _end(self, terrain: Terrain) -> tuple[float, float]:
        """Return place and flipper angle at the end of the way: beyond the end of the flight, or on it with the flipper riding."""
        sign = -self._sign if self._turns_back else self._sign
        if sign > 0.0:
            last_m = terrain.top_m + self._rear_m + (BEFORE_M + 0.02 if self._turns_back else 0.5 * BEFORE_M)
        else:
            last_m = terrain.foot_m - self._pivot_m - self._length_m - 0.5 * BEFORE_M
        if sign * (last_m - terrain.x_m) < 1.5 * REACH_M:
            return last_m, self._rest_rad
        return terrain.x_m + sign * REACH_M, 0.0

    def _ahead(self, table: WayTable, terrain: Terrain) -> float | None:
        """Return by how much the chair is further ahead on a table's ground than on the present one [m].

        None if the ground at the chair is another than the table's, or the way ends elsewhere.
        """
        to_end_m = abs(table.end_m - terrain.x_m)
        if to_end_m < 1.0 and abs(self._end(terrain)[0] - terrain.x_m) > to_end_m + 0.05:
            return None
        grounds = (table.ground, terrain.ground)
        old, new = (ground[(ground[:, 2] > 0.0) & (np.abs(ground[:, 0] - terrain.x_m) < NEAR_M), :2] for ground in grounds)
        if len(old) != len(new):
            return None
        if not len(old):
            return 0.0
        off = old - new
        mean = off.mean(axis=0)
        return float(mean[0]) if np.abs(off - mean).max() < MOVED_M else None

    # --- the chair on its way

    def _follow(
        self, terrain: Terrain, place: Place, flipper: FlipperReading, pitch: float, dt_s: float
    ) -> tuple[WayState | None, float, float]:
        """Return the state on the way, and belt speed and flipper rate; without a way in time the chair stands."""
        table = self._table
        if place not in ("foot", "top"):
            self._begin()
            return None, self._sign * SPEED_M_S, 0.0
        if table is None:
            self._wait(dt_s, "no way leads over the ground that is seen")
            return None, 0.0, 0.0
        x_m = terrain.x_m + self._ahead_m + self._place_m
        pose = self._correct(table, x_m, flipper, pitch, dt_s)
        node = table.nearest(x_m, flipper.angle_rad + self._offset_rad, pitch)
        if node < 0:
            self._table = None
            return None, 0.0, 0.0
        middle = table.after(node, 0.5 * LOOK_S)
        at, half, then = table.state(node), table.state(middle), table.state(table.after(middle, 0.5 * LOOK_S))
        first_s, second_s = _took(at, half), _took(half, then)
        stops = abs((half.pitch_rad - at.pitch_rad) / first_s - (then.pitch_rad - half.pitch_rad) / second_s)
        self._pace = min(self._pace + PACE_PER_S * dt_s, STOPS_RAD_S / max(stops, STOPS_RAD_S))
        later = (_rests(self._chair, table, state.x_m, state.angle_rad, state.pitch_rad) for state in (half, then))
        contact = min(self._contact(table, one) for one in (pose, *later))
        pace = self._pace * contact / (first_s + second_s)
        speed = pace * (then.x_m - at.x_m) / max(math.cos(pitch), 0.8)
        rate = pace * (then.angle_rad - at.angle_rad) - (1.0 - contact) * PRESS_RAD_S
        # Belts that slip up leave the chair behind its place by the tracker: it has not tipped as far as it would have there.
        is_behind = place == "top" and self._sign > 0.0 and pitch - at.pitch_rad > 2.0 * AGREES_RAD
        self._elsewhere_s = self._elsewhere_s + dt_s if is_behind else 0.0
        self._ran_m = math.inf if is_behind else self._ran_m
        stands = self._elsewhere_s > LOOK_S
        self._watch(table, at, flipper, 0.0 if stands else rate, dt_s, bears=pose is not None and pose.torques_n_m[0] > 0.0)
        return (at, 0.0, 0.0) if self._barred or stands else (at, speed, rate)

    def _correct(self, table: WayTable, x_m: float, flipper: FlipperReading, pitch: float, dt_s: float) -> RestPose | None:
        """Correct place and flipper angle on the table's ground, and return the pose there; None if the chair cannot stand there.

        The pitch corrects one of the two, by how it depends on either and how well either is known; a contact that is
        measured, or is not, corrects the angle.
        """
        angle, step_m, step_rad = flipper.angle_rad + self._offset_rad, 0.01, 0.5 * DEG
        steps = ((0.0, 0.0), (step_m, 0.0), (0.0, step_rad))
        pose, ahead, raised = (_rests(self._chair, table, x_m + along, angle + turn, pitch) for along, turn in steps)
        if pose is None or ahead is None or raised is None:
            return None
        gain, off = 1.0 - math.exp(-dt_s / CORRECTS_S), pitch - pose.pitch_rad
        by_place, by_angle = (ahead.pitch_rad - pose.pitch_rad) / step_m, (raised.pitch_rad - pose.pitch_rad) / step_rad
        expects_n = pose.torques_n_m[0] / self._length_m
        if self._tip.carries and expects_n <= 0.0:
            self._offset_rad -= CONTACT_RAD_S * dt_s
        elif self._tip.load_n < 0.5 * CONTACT_SHARE * expects_n:
            self._offset_rad += CONTACT_RAD_S * dt_s
        if expects_n > self._tip.carries_n and self._tip.carries and pitch - self._without_tip(table, x_m, pitch) > LIFTED_RAD:
            self._weigh(table, pose, flipper, 1.0 - math.exp(-dt_s / LEANS_S))
        variance = (by_place * PLACE_SIGMA_M) ** 2 + (by_angle * ANGLE_SIGMA_RAD) ** 2 + PITCH_SIGMA_RAD**2
        if abs(off) < AGREES_RAD:
            self._place_m += gain * off * by_place * PLACE_SIGMA_M**2 / variance
            self._offset_rad += gain * off * by_angle * ANGLE_SIGMA_RAD**2 / variance
        if expects_n <= 0.0 and self._tip.is_unloaded:
            self._offset_rad *= 1.0 - gain
        self._place_m = min(max(self._place_m, -2.0 * PLACE_SIGMA_M), 2.0 * PLACE_SIGMA_M)
        self._offset_rad = min(max(self._offset_rad, -3.0 * ANGLE_SIGMA_RAD), 3.0 * ANGLE_SIGMA_RAD)
        return pose

    def _weigh(self, table: WayTable, pose: RestPose, flipper: FlipperReading, gain: float) -> None:
        """Correct by how much the load leans back, by the torque of a tip that lifts the chair; elsewhere it asks for a new way.

        A load that leans ahead and friction under a tip that presses load the tip alike. The former only adds to the margin to the
        rear and is not guessed: with a load that seemed 0.09 to 0.14 m ahead two ways over the edge kept 2 and 3° in place of 9°.
        """
        leaning = rest_chair(self._loading.chair, self._loading.payload_kg, offset_m=(self._planned_m + 0.05, 0.0, 0.0))
        other = _rests(leaning, table, pose.x_m, pose.angles_rad[0], pose.pitch_rad)
        if other is None:
            return
        per_m = (other.torques_n_m[0] - pose.torques_n_m[0]) / 0.05
        lever_m = self._length_m * math.cos(flipper.angle_rad + pose.pitch_rad)
        expected_n_m = pose.torques_n_m[0] + per_m * (self._leans_m - self._planned_m)
        off_n_m, noise_n_m = self._tip.load_n * lever_m - expected_n_m, LOAD_SHARE * pose.torques_n_m[0]
        self._leans_m += gain * off_n_m * per_m * LEANS_SIGMA_M**2 / ((per_m * LEANS_SIGMA_M) ** 2 + noise_n_m**2)
        self._leans_m = min(max(self._leans_m, -2.0 * LEANS_SIGMA_M), 0.0)
        if abs(self._leans_m - self._planned_m) > LEANS_M:
            self._planned_m = self._leans_m
            self._chair = rest_chair(self._loading.chair, self._loading.payload_kg, offset_m=(self._leans_m, 0.0, 0.0))
            self._table = None

    def _contact(self, table: WayTable, pose: RestPose | None) -> float:
        """Return how far the contact that bears in a pose is measured, 0 to 1: its tip carries a share of that load.

        Friction at a tip that reaches far down takes load off its motor. What need not be measured: a tip without which the chair
        would turn by less than ``LIFTED_RAD``, and a contact near the flipper's axis, onto which the flipper cannot press.
        """
        if pose is None or abs(pose.pitch_rad - self._without_tip(table, pose.x_m, pose.pitch_rad)) < LIFTED_RAD:
            return 1.0
        c, s = math.cos(pose.pitch_rad), math.sin(pose.pitch_rad)
        if pose.front_m[0] - pose.x_m - self._pivot_m * c + self._radius_m * s < 0.5 * self._length_m:
            return 1.0
        shows = 1.0 - TIP_FRICTION * max(math.tan(-pose.angles_rad[0] - pose.pitch_rad), 0.0)
        wanted_n = shows * max(CONTACT_SHARE * pose.torques_n_m[0] / self._length_m, UNLOADED_SHARE * self._tip.carries_n)
        return 1.0 if wanted_n <= 0.0 else min(max(self._tip.load_n / wanted_n, 0.0), 1.0)

    def _without_tip(self, table: WayTable, x_m: float, pitch: float) -> float:
        """Return the pitch at which the chair would rest with its flipper raised [rad]; infinite where it would turn over."""
        return math.inf if (pose := _rests(self._chair, table, x_m, self._range_rad[1], pitch)) is None else pose.pitch_rad

    # --- monitors

    def _watch(self, table: WayTable, at: WayState, flipper: FlipperReading, rate: float, dt_s: float, *, bears: bool) -> None:
        """Note a flipper that does not rise, or not follow in the air, and a chair that does not come further along its way."""
        turned = 0.0 if math.isnan(self._angle_rad) else flipper.angle_rad - self._angle_rad
        self._angle_rad = flipper.angle_rad
        is_free = rate > 0.0 or (not bears and self._tip.is_unloaded)
        self._asked_rad = (self._asked_rad + rate * dt_s - turned) * math.exp(-dt_s / IDLE_S) if is_free else 0.0
        if abs(self._asked_rad) > IDLE_RAD:
            stands, asked = flipper.angle_rad / DEG, (flipper.angle_rad + self._asked_rad) / DEG
            seen = f"stands at {stands:.0f}° above the belts where {asked:.0f}° are asked"
            self._barred = f"the flipper {seen}: " + ("it does not rise" if asked > stands else "it would not carry the chair")
        watched, least_s = self._watched
        if watched is not table or at.to_go_s < least_s - 1.0:
            self._watched = table, at.to_go_s
            if watched is table:
                self._waited_s, self._has_carried, self._ran_m, self._stayed_m = 0.0, False, 0.0, 0.0
        self._has_carried |= not self._tip.is_unloaded
        self._stayed_m += self._length_m * (rate * dt_s - turned)
        carried = STALLS if self._ran_m < abs(self._stayed_m) else SLIPS
        self._wait(dt_s, carried if self._has_carried or self._ran_m == math.inf else WAITS)

    def _wait(self, dt_s: float, cause: str) -> None:
        """Note a chair that does not come further for a cause."""
        self._waited_s += dt_s
        if self._waited_s > PATIENCE_S:
            self._barred = cause


def _rests(chair: RestChair, table: WayTable, x_m: float, angle: float, pitch: float) -> RestPose | None:
    """Return the rest pose of a chair on a table's ground; None where it would turn over."""
    try:
        return chair.at(table.ground, x_m, (angle,), pitch)
    except MechanicsError:
        return None


def _took(at: WayState, to: WayState) -> float:
    """Return the time between two states of a way at the rates for which it is priced [s]."""
    turned_s = max(abs(to.angle_rad - at.angle_rad) / FLIPPER_RAD_S, abs(to.pitch_rad - at.pitch_rad) / PITCH_RAD_S)
    return max(abs(to.x_m - at.x_m) / SPEED_M_S, turned_s, 0.05)
