"""Arming of a real chair: sensors speak, axes and signs are right, the battery is charged, the dead-man switch works.

``LinkError`` names the first check that fails and its remedy. Nothing moves but for the wiggle of one belt at 0.05 m/s, while a
person holds the dead-man switch: each belt alone, forward and back, is compared with its own report and with the gyro.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import fmean
from typing import Any

from treadline.core.angles import DEG, tilt_of
from treadline.core.errors import LinkError
from treadline.core.signals import (
    TICK_S,
    FlipperReading,
    HeadingFault,
    HeadingHealth,
    ImuSample,
    OperatorInput,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.estimation import StuckGyroDetector, StuckRule
from treadline.guard import SILENCE_S, GuardConfig
from treadline.hardware._guard_client import GuardClient
from treadline.hardware._links import REARM_S
from treadline.hardware._robot_plant import CameraThread, RobotPlant
from treadline.hardware.robot_file import RobotFile
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription

SPEAK_S = 3.0
"""Longest wait for the first reading of each sensor [s]: a BNO055 fuses 0.65 s after its reset, a camera streams after 2 s."""
PERSON_S = 60.0
"""Longest wait for a person's hand [s]."""
WIGGLE_S, SETTLE_S = 1.0, 0.2
"""Duration of each movement, and the time after which it is measured [s]: the guard holds for a belt that
does not follow after 0.2 s more than the lag of its drive."""
TILT_RAD = 5.0 * DEG
"""Largest tilt of a chair on level ground, and largest angle between its attitude and its specific force [rad]."""
SHARE = 0.4
"""Share of the commanded speed above which a belt moves, and of the kinematic turn above which the chair turns: half of the 0.79
that tracks turn on a floor (guard, level share); lifted ones do not turn at all."""


class BenchSession:
    """Ticks of a chair without a mission: the heartbeat, the readings, commanded belt speeds, and the gyro's health.

    Args:
        client: The guard process.
        config: Limits of the session.
        cause: Why the guard holds until the first re-arm.
        log: Receives each reading and event, with its mission time [s].
        camera: Camera whose frames are readings as well.
        rearms: Whether a person can re-arm.
    """

    def __init__(
        self,
        client: GuardClient,
        config: GuardConfig,
        cause: str,
        log: Callable[[Any, float], None] = lambda _signal, _t_s: None,
        *,
        camera: CameraThread | None = None,
        rearms: bool = True,
    ) -> None:
        self._client, self._log = client, log
        self._plant = RobotPlant(client, client.begin(config, cause, rearms=rearms), camera)
        self._gyro = StuckGyroDetector(StuckRule())
        self._ticks = 0
        self.newest: dict[type, Any] = {}
        """Newest reading of each type."""

    @property
    def t_s(self) -> float:
        """Mission time [s]."""
        return self._ticks * TICK_S

    def tick(self, left_m_s: float = 0.0, right_m_s: float = 0.0) -> list[Any]:
        """Propose belt speeds and return the readings of one tick.

        Raises:
            LinkError: If a link or the guard process is lost.
        """
        client = self._client
        self._ticks += 1
        self._plant.advance(self.t_s)
        if client.lost is not None:
            raise LinkError(client.lost)
        readings = self._plant.read()
        for signal in (*readings, *client.take_events()):
            self._log(signal, self.t_s)
        self.newest |= {type(reading): reading for reading in readings}
        self._watch_gyro(readings)
        client.propose(TrackCommand(t_s=self.t_s, left_m_s=left_m_s, right_m_s=right_m_s))
        client.step(self.t_s, None)
        return readings

    def _watch_gyro(self, readings: Sequence[Any]) -> None:
        """Report to the guard whether the gyro is frozen, by the rule of the heading filter: on the bench no filter runs."""
        no_heading = {"disagreement_rad": 0.0, "unseen_s": 0.0, "bias_rad_s": 0.0, "scale": 1.0, "walk_rad_rts": 0.0}
        for reading in readings:
            match reading:
                case TrackReading():
                    self._gyro.belts(reading)
                case ImuSample(t_s=t_s):
                    stuck_s = self._gyro.stuck_s(reading)
                    fault: HeadingFault | None = "stuck" if stuck_s > 0.0 else None
                    found_s = t_s - stuck_s + StuckRule().for_s
                    self._client.on_message(HeadingHealth(t_s=t_s, fault=fault, since_s=found_s, cause=None, **no_heading))

    def settled(self, left_m_s: float, right_m_s: float, for_s: float) -> list[Any]:
        """Drive for a time [s], or until the guard holds; return the readings after the first ``SETTLE_S``."""
        start_s, readings = self.t_s, list[Any]()
        while self.t_s < start_s + for_s and (self._client.holding is None or left_m_s == right_m_s == 0.0):
            new = self.tick(left_m_s, right_m_s)
            readings += new if self.t_s > start_s + SETTLE_S else []
        return readings

    def wait(self, what: str, limit_s: float, until: Callable[[], bool]) -> None:
        """Tick until a condition holds.

        Raises:
            LinkError: With ``what`` is missing, if it does not within ``limit_s``.
        """
        end_s = self.t_s + limit_s
        while not until():
            if self.t_s > end_s:
                raise LinkError(f"arming: {what} (waited {limit_s:g} s)")
            self.tick()


@dataclass(frozen=True, slots=True, kw_only=True)
class Wiggle:
    """Response to one belt that was commanded alone, forward less back, half of it."""

    asked_m_s: float
    """Commanded speed of the belt."""
    own_m_s: float
    """Reported speed of the belt."""
    other_m_s: float
    """Reported speed of the other belt."""
    turn_rad_s: float
    """Rate of the gyro about the vertical, positive to the left."""


def report_fault(name: str, wiggle: Wiggle, deviation: float, *, whole: bool = True) -> str | None:
    """Return the fault of a belt's report, with its remedy; None if it follows the command.

    Args:
        name: The belt.
        wiggle: Response to it.
        deviation: Largest deviation of the report, as a share of the command: the guard would hold on the first metre beyond it.
        whole: Whether the guard let the wiggle end; the speed of a belt on its way is no scale.
    """
    asked_m_s = wiggle.asked_m_s
    if abs(wiggle.other_m_s) > SHARE * asked_m_s:
        return f"the other belt reports when the {name} one is commanded: motor or encoder lines are crossed at the box"
    if wiggle.own_m_s < -SHARE * asked_m_s:
        return f"the report of the {name} belt has the wrong sign: reverse its encoder at the box"
    if whole and abs(wiggle.own_m_s / asked_m_s - 1.0) > deviation:
        seen = f"the {name} belt reports {wiggle.own_m_s:.3f} m/s where {asked_m_s:g} is commanded"
        return f"{seen}: correct wheel radius, gear or supply"
    return None


def turn_fault(left: Wiggle, right: Wiggle, gauge_m: float) -> tuple[str | None, bool]:
    """Return the fault of the belts' direction by the gyro, with its remedy, or None, and whether the chair stands on its belts.

    Args:
        left: Response to the left belt, whose report is right.
        right: Response to the right belt.
        gauge_m: Distance between the belts [m].
    """
    ideal_rad_s = left.asked_m_s / gauge_m
    turns = {"left": -left.turn_rad_s / ideal_rad_s, "right": right.turn_rad_s / ideal_rad_s}
    if min(map(abs, turns.values())) < SHARE:
        return None, False
    backward = [name for name, turn in turns.items() if turn < 0.0]
    if len(backward) == 2:
        return "the chair turns the wrong way: the belts are swapped (signs.swapped = true), or both run backwards", True
    return f"the {backward[0]} belt runs backwards: set signs.{backward[0]} = -1 in the robot file" if backward else None, True


class Arming:
    """The arming list of one chair.

    Args:
        session: BenchSession with the bench limits.
        client: The guard process.
        robot: The robot file.
        chair: The chair.
        say: Receives each line for the person.
    """

    def __init__(
        self, session: BenchSession, client: GuardClient, robot: RobotFile, chair: ChairDescription, say: Callable[[str], None]
    ) -> None:
        self._session, self._client, self._robot, self._chair, self._say = session, client, robot, chair, say

    def sensors(self, camera: CameraThread | None) -> None:
        """Wait until every sensor has spoken; check the battery and the axes of the inertial sensor.

        Raises:
            LinkError: If one is silent, or a value is wrong.
        """
        session, chair, limits = self._session, self._chair, self._robot.limits
        has_joints = chair.seat is not None or chair.flipper is not None
        _require(self._robot.handset is not None, "no [handset] in the robot file, and only --record needs none; add the table")
        lacks = f"{chair.name} has a seat or a flipper, and the robot file no [joints]"
        _require(self._robot.joints is not None or not has_joints, f"{lacks}; add the table, or give mission.chair without them")
        wanted: dict[type, str] = {TrackReading: "drives", ImuSample: "imu", OperatorInput: "handset"}
        wanted |= {} if chair.seat is None else {SeatReading: "joints (seat)"}
        wanted |= {} if chair.flipper is None else {FlipperReading: "joints (flipper)"}
        for kind, name in wanted.items():
            silent = f"no reading of {name}; is it plugged in and powered?"
            session.wait(silent, SPEAK_S, partial(session.newest.__contains__, kind))
        if camera is not None:
            self._check_camera(camera)
        volts = None if self._client.state is None else self._client.state.voltage_v
        measured, least_v = "not measured" if volts is None else f"{volts:.1f} V", limits.battery_least_v or 0.0
        _require(least_v <= (volts or 0.0), f"the battery is at {measured}, and {least_v:g} V are asked for; charge it")
        self._check_axes()
        self._say(f"sensors speak, chair level, gravity along +z, battery {measured}")
        self._say("not checked, because level ground does not show them: the signs of pitch and roll")

    def dead_man(self) -> None:
        """Wait until the dead-man switch was seen released, and then held with a re-arm.

        Raises:
            LinkError: If no person does so in time.
        """
        session = self._session
        session.wait("the dead-man switch is held; release it", PERSON_S, lambda: not session.newest[OperatorInput].dead_man)
        self._say("hold the dead-man switch and re-arm (keyboard: hold r); each belt will move a few centimetres")
        session.wait("no re-arm with the dead-man switch held", PERSON_S, lambda: self._client.holding is None)
        newest, client = session.newest, self._client
        stays = "the drives stay latched after the re-arm"
        session.wait(stays, REARM_S, lambda: client.holding is not None or not newest[TrackReading].brake_on)
        if self._client.state is not None and self._client.state.note is not None:
            self._say(self._client.state.note)

    def signs(self) -> bool:
        """Wiggle each belt; return whether the chair stands on its belts.

        Raises:
            LinkError: If a sign or a scale is wrong, with the remedy.
        """
        client, wiggles = self._client, dict[str, Wiggle]()
        for name, left, right in (("left", 1.0, 0.0), ("right", 0.0, 1.0)):
            while name not in wiggles or client.holding is not None:
                if client.holding is not None:
                    self._say(f"held: {client.holding}; release the dead-man switch and re-arm")
                wiggles[name] = self._wiggle(left, right)
                fault = report_fault(name, wiggles[name], client.config.deviation, whole=client.holding is None)
                _require(fault is None, str(fault))
        fault, on_floor = turn_fault(wiggles["left"], wiggles["right"], self._chair.tracks.gauge_m)
        _require(fault is None, str(fault))
        lifted = "belts lifted; did the left one move first, forward?"
        self._say("belts on the floor, signs right by the gyro" if on_floor else lifted)
        if on_floor:
            turned_rad_s = wiggles["right"].turn_rad_s - wiggles["left"].turn_rad_s
            self._say(f"by the gyro the chair turns as with a gauge of {2.0 * self._speed_m_s / turned_rad_s:.2f} m")
        return on_floor

    @property
    def _speed_m_s(self) -> float:
        """Belt speed of the wiggle [m/s]: half of the bench's limit."""
        return 0.5 * self._client.config.belt_limit_m_s

    def _wiggle(self, left: float, right: float) -> Wiggle:
        ahead = self._moved(left, right)
        # A guard that holds has seen a belt that does not follow: the way there shows which.
        back = [-value for value in ahead] if self._client.holding is not None else self._moved(-left, -right)
        own, other, turn = (0.5 * (one - two) for one, two in zip(ahead, back, strict=True))
        return Wiggle(asked_m_s=self._speed_m_s, own_m_s=own, other_m_s=other, turn_rad_s=turn)

    def _moved(self, left: float, right: float) -> tuple[float, float, float]:
        """Return the means of a movement: speeds of the moved and of the other belt [m/s], gyro rate [rad/s]."""
        client, speed_m_s = self._client, self._speed_m_s
        self._session.wait("the guard holds, and no person re-armed", PERSON_S, lambda: client.holding is None)
        readings = self._session.settled(left * speed_m_s, right * speed_m_s, WIGGLE_S)
        belts = [reading for reading in readings if isinstance(reading, TrackReading)]
        rates = [reading.angular_velocity_rad_s[2] for reading in readings if isinstance(reading, ImuSample)]
        if not belts or not rates:
            return (left + right) * speed_m_s, 0.0, 0.0  # held before the belt moved: the wiggle is repeated
        means = fmean(reading.left_m_s for reading in belts), fmean(reading.right_m_s for reading in belts)
        own, other = means if left else means[::-1]
        return own, other, fmean(rates)

    def _check_camera(self, camera: CameraThread) -> None:
        """Raise where the camera is silent, or too slow for a chair that holds ``SILENCE_S`` after a frame was due."""
        wait = self._session.wait
        wait("no frame of the camera", SPEAK_S, lambda: camera.count > 0 or camera.error is not None)
        wait("too few frames of the camera", SPEAK_S, lambda: camera.is_measured or camera.error is not None)
        _require(camera.error is None, f"camera: {camera.error}")
        seen = f"sends a frame each {camera.period_s:.2f} s, up to {camera.lateness_s:.2f} s late"
        remedy = "a lost frame would hold the chair; raise its rate, or close programs"
        _require(camera.period_s + camera.lateness_s <= SILENCE_S, f"the camera {seen}: {remedy}")

    def _check_axes(self) -> None:
        """Raise where gravity is not along +z of a chair on level ground, or the attitude contradicts it."""
        samples = [reading for reading in self._session.settled(0.0, 0.0, 2.0 * SETTLE_S) if isinstance(reading, ImuSample)]
        _require(bool(samples), "the imu fell silent; is it plugged in and powered?")
        x, y, z = (fmean(sample.linear_acceleration_m_s2[axis] for sample in samples) for axis in range(3))
        size, deviation = math.hypot(x, y, z), self._client.config.deviation
        is_up = z >= math.cos(TILT_RAD) * size and abs(size / GRAVITY_M_S2 - 1.0) <= deviation
        seen, wanted = f"the specific force is ({x:.1f}, {y:.1f}, {z:.1f}) m/s²", "(0, 0, 9.8) is at rest on level ground"
        _require(is_up, f"{seen} where {wanted}; correct the axes of the inertial sensor, or stand level")
        pitch_rad, roll_rad = tilt_of(samples[-1].orientation)
        agrees = max(abs(pitch_rad - math.asin(x / size)), abs(roll_rad - math.asin(y / size))) <= TILT_RAD
        seen = f"the attitude has {pitch_rad / DEG:.0f}° pitch and {roll_rad / DEG:.0f}° roll, gravity says otherwise"
        _require(agrees, f"{seen}; correct the axes of the inertial sensor's attitude")


def _require(condition: object, otherwise: str) -> None:
    """Raise where a condition of the arming list does not hold."""
    if not condition:
        raise LinkError(f"arming: {otherwise}")
