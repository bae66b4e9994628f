"""Link to a lab's own base, which stops by a time-out of its own: ``cmd_vel`` and odometry of ROS 2, or VESC drives on CAN.

Robot file: ``link = "base"`` or ``"vesc"``, with the keys of ``treadline_ros2.base:RosWire`` or ``_vesc_wire:VescWire``; an own
``wire`` is a class with the methods of ``BaseWire``. The time-out of such a base is commonly 0.5 to 1 s, and nothing reports it:
the first ``rearm`` measures it. The base is driven at ``PROBE_M_S`` until its odometry follows, then left without a command until
it stands; then it is driven back and commanded to zero. Limits and the host's watchdog are kept here, in the guard process.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from treadline.core.errors import LinkError
from treadline.core.files import own_module
from treadline.hardware.ports import DriveLimits, DriveState

PROBE_M_S = 0.05
"""Speed of the measurement [m/s]: that of the arming list's wiggle."""
STOPS_S = 0.5
"""Longest time from the last command, and from zero, to standing [s]: 0.025 m at the measurement's speed, 0.15 m at 0.3 m/s."""
FOLLOWS_S = 1.0
"""Longest time until the odometry follows a command, and for which it is watched in silence [s]: the longest time-outs of bases."""
STANDS_M_S = 0.2 * PROBE_M_S
"""Speed below which a base stands [m/s]."""
SILENT_S = 0.25
"""Longest time between two messages of the odometry [s]: five at 20 Hz."""
JUMP_M = 0.2
"""Largest step of the odometry's place beyond its own speed [m]: a quarter of a tread more than a lost message at 0.3 m/s."""


class BaseOdometry(NamedTuple):
    """One message of the odometry."""

    frame: str
    """Frame that moves: ``child_frame_id``."""
    sender: str
    """Id of the publisher; empty where it is not known."""
    place_m: tuple[float, float]
    """Place on the ground; zeros where it is not measured."""
    left_m_s: float
    right_m_s: float
    voltage_v: float | None = None


class BaseWire(Protocol):
    """Carrier of belt speeds and odometry; no call waits."""

    def read(self) -> Sequence[tuple[float, BaseOdometry]]:
        """Return the odometry since the last call, with the monotonic time of its arrival [s].

        Raises:
            LinkError: If the wire has gone.
        """

    def write(self, left_m_s: float, right_m_s: float) -> None:
        """Send the belt speeds."""

    def close(self) -> None:
        """Release the wire."""


@dataclass(slots=True)
class Probe:
    """What is measured of a base before it is driven."""

    lag_s: float = math.nan
    """Time until the odometry shows half of a commanded speed."""
    silent_s: float = math.nan
    """Time from the last command to standing: the base's own time-out, with its ramp."""
    zero_s: float = math.nan
    """Time from a command of zero to standing."""

    def __str__(self) -> str:
        return (
            f"base: lag {self.lag_s:.2f} s, stands {self.silent_s:.2f} s after the last command and {self.zero_s:.2f} s after zero"
        )


class BaseLink:
    """Drive link to a base with a time-out of its own.

    Args:
        wire: Class of the carrier as ``module:Class``.
        limits: Limits of the commands.
        frame: Frame of the base in its odometry.
        options: Further keys, for the carrier.

    Raises:
        LinkError: If the wire does not open.
    """

    def __init__(
        self, *, limits: DriveLimits, wire: str = "treadline_ros2.base:RosWire", frame: str = "base_link", **options: Any
    ) -> None:
        module, _, name = wire.partition(":")
        self._wire: BaseWire = getattr(own_module(module), name)(**options)
        self._limits, self._frame = limits, frame
        self.probe = Probe()
        self._phase, self._since_s = "latched", time.monotonic()
        """latched; starting, silent, again, stopping: the measurement; armed."""
        self._sent_s, self._sent = -math.inf, (0.0, 0.0)
        self._newest: tuple[float, BaseOdometry] | None = None
        self._tripped, self._obeys_zero = False, True
        self.stop()

    def poll(self) -> Sequence[DriveState]:
        """Return the states since the last call; carry on with the measurement, and keep the watchdog.

        Raises:
            LinkError: If the base does not answer, is another, moves by itself, or stops too late.
        """
        arrived = self._wire.read()
        for t_s, odometry in arrived:
            self._check(t_s, odometry)
            self._newest = t_s, odometry
            self._measure(t_s, (odometry.left_m_s, odometry.right_m_s))
        self._watch(time.monotonic())
        return [self._state(t_s, odometry) for t_s, odometry in arrived]

    def send(self, left_m_s: float, right_m_s: float) -> None:
        """Set the belt speeds within the limits. A speed that is not a number stops the base."""
        if not (math.isfinite(left_m_s) and math.isfinite(right_m_s)):
            self.stop()
        elif self._phase == "armed":
            now_s, limit_m_s = time.monotonic(), self._limits.speed_m_s
            step_m_s = self._limits.acceleration_m_s2 * (now_s - self._sent_s)
            asked = (max(-limit_m_s, min(speed, limit_m_s)) for speed in (left_m_s, right_m_s))
            left, right = (max(was - step_m_s, min(to, was + step_m_s)) for was, to in zip(self._sent, asked, strict=True))
            self._sent, self._sent_s = (left, right), now_s
            self._wire.write(left, right)

    def hold(self) -> None:
        """Ramp to zero."""
        self.send(0.0, 0.0)

    def stop(self) -> None:
        """Command zero, latched until ``rearm``; a base that ignores zero stops by its time-out."""
        if self._phase != "latched":
            self._enter("latched")
        if self._obeys_zero:
            self._wire.write(0.0, 0.0)

    def rearm(self) -> None:
        """Measure the base where that is not done yet; then end the latched stop. A base that moves by itself stays latched."""
        self._tripped = False
        if math.isfinite(self.probe.zero_s):
            self._enter("armed")
        elif self._newest is not None and max(abs(self._newest[1].left_m_s), abs(self._newest[1].right_m_s)) < STANDS_M_S:
            self._enter("starting")

    def close(self) -> None:
        """Stop the base and release the wire."""
        self.stop()
        self._wire.close()

    def _check(self, t_s: float, odometry: BaseOdometry) -> None:
        """Raise where a message is of another base or frame, or jumps."""
        if odometry.frame != self._frame:
            raise LinkError(f"the base's odometry is of frame '{odometry.frame}', not '{self._frame}'; set frame in [drives]")
        speeds = odometry.left_m_s, odometry.right_m_s
        if not all(map(math.isfinite, (*odometry.place_m, *speeds))):
            raise LinkError("the base's odometry holds a number that is none; see its driver")
        if self._newest is None:
            return
        before_s, before = self._newest
        if before.sender != odometry.sender:
            raise LinkError(f"two bases publish odometry ({before.sender} and {odometry.sender}); stop one, or give it a namespace")
        moved_m = math.dist(odometry.place_m, before.place_m)
        if moved_m > JUMP_M + max(map(abs, speeds)) * (t_s - before_s):
            raise LinkError(f"the base's odometry jumps by {moved_m:.2f} m in {t_s - before_s:.2f} s; see its driver")

    def _measure(self, t_s: float, belts: tuple[float, float]) -> None:
        """Carry on with the measurement by the newest speeds."""
        passed_s, stands = t_s - self._since_s, max(map(abs, belts)) < STANDS_M_S
        match self._phase:
            case "starting" | "again":
                self._follow(passed_s, belts, 1.0 if self._phase == "starting" else -1.0)
            case "silent" if stands:
                self.probe.silent_s = passed_s
                self._require(passed_s, "after the last command", "shorten its time-out")
                self._enter("again")
            case "stopping" if stands:
                self.probe.zero_s = passed_s
                self._require(passed_s, "after zero", "raise its deceleration")
                self._enter("armed")
            case "silent" | "stopping" | "latched" if passed_s > FOLLOWS_S and not stands:
                causes = {"silent": "has no time-out", "stopping": "ignores zero", "latched": "moves by itself"}
                self._obeys_zero = self._phase != "stopping"
                seen = f"{max(belts, key=abs):+.2f} m/s {passed_s:.1f} s after the last command"
                raise LinkError(f"the base {causes[self._phase]}: {seen}; is another program driving it?")

    def _follow(self, passed_s: float, belts: tuple[float, float], sign: float) -> None:
        """Go on where both belts follow; raise where they do not in time."""
        if min(sign * speed for speed in belts) > 0.5 * PROBE_M_S:
            self.probe.lag_s = passed_s
            self._enter("silent" if sign > 0.0 else "stopping")
        elif passed_s > FOLLOWS_S:
            reported = f"reports {belts[0]:+.3f} and {belts[1]:+.3f} m/s where {sign * PROBE_M_S:+.3f} is commanded"
            raise LinkError(f"the base {reported}; is it enabled, and are its signs right?")

    def _require(self, took_s: float, when: str, remedy: str) -> None:
        if took_s > STOPS_S:
            raise LinkError(f"the base stands {took_s:.2f} s {when}, and {STOPS_S:g} s are allowed; {remedy}")

    def _watch(self, now_s: float) -> None:
        """Repeat what the phase asks for; stop without commands of the guard, raise without odometry."""
        if self._newest is not None and now_s - self._newest[0] > SILENT_S:
            raise LinkError(f"the base's odometry is silent for {now_s - self._newest[0]:.2f} s; is it powered?")
        if self._phase in ("starting", "again"):
            speed_m_s = PROBE_M_S if self._phase == "starting" else -PROBE_M_S
            self._wire.write(speed_m_s, speed_m_s)
        elif self._phase == "stopping":
            self._wire.write(0.0, 0.0)
        elif self._phase == "armed" and now_s - self._sent_s > self._limits.watchdog_s:
            self._tripped = True
            self.stop()

    def _enter(self, phase: str) -> None:
        self._phase, self._sent = phase, (0.0, 0.0)
        self._since_s = self._sent_s = time.monotonic()

    def _state(self, t_s: float, odometry: BaseOdometry) -> DriveState:
        """Return the state; the motion of the measurement is this link's own, and not reported."""
        is_driven = self._phase in ("latched", "armed")
        return DriveState(
            t_s=t_s,
            box_s=None,
            left_m_s=odometry.left_m_s * is_driven,
            right_m_s=odometry.right_m_s * is_driven,
            watchdog_tripped=self._tripped,
            latched=self._phase != "armed",
            error=None,
            voltage_v=odometry.voltage_v,
            note=str(self.probe) if math.isfinite(self.probe.zero_s) else None,
        )
