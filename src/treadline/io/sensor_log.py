"""A log as a source of sensor readings, and of the recorded commands and estimates for comparison.

A reading of our own logs is due at its log time, the mission time at which the run took it: late camera frames stay late. So is one
of a bag that holds our topics and whose log times are of the clock of its stamps, as ``treadline record`` writes it. The log time
of any other log is a recorder's wall clock; there a reading is due at its stamp.

Logs are not trusted. A message whose stamp is not later than the previous one on its topic is dropped, and so is a sample that is
not finite; both are counted and reported. The recording ends where its clock leaps, or where nothing was recorded for
``SILENCE_S``. One second of the log is held in memory, to sort it.
"""

import heapq
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from treadline.core.camera_images import PinholeCamera
from treadline.core.ports import Reading
from treadline.core.signals import Event, HeadingMeasurement, ImuSample, TrackReading
from treadline.io.images import MILLIMETRE, Pairing
from treadline.io.mcap_read import has_arrivals
from treadline.io.message_types import seconds_of
from treadline.io.messages import OWN
from treadline.io.standard_messages import EVENTS, HEADINGS, LOOKED, OURS, imu, signal_reader
from treadline.io.topics import Received, damaged_message, packets, received, roles, survey

BELTS = OWN[TrackReading].read
HORIZON_S = 1.0
"""Window in which readings of several topics are sorted by time [s]; a larger jump of a topic's stamps is a leap of its clock."""
SILENCE_S = 60.0
"""Longest gap within one recording [s]."""
EVENTS_MAX = 20
"""Largest number of events per topic and reason; further ones are only counted."""


class SensorLog:
    """Recorded sensor readings of one log, in time order.

    Raises:
        LogFormatError: If the log is missing, damaged, or holds nothing to replay.
        SettingsError: If a named topic is not in the log.
    """

    def __init__(
        self,
        path: Path,
        *,
        named: Mapping[str, str] | None = None,
        sealed: bool = False,
        depth_unit_m: float = MILLIMETRE,
        calibrate: Callable[[PinholeCamera | None, tuple[int, int]], PinholeCamera | None] = lambda logged, _size: logged,
    ) -> None:
        """Survey a log.

        Args:
            path: Log file, or folder of a bag.
            named: Topics by role, where the types are ambiguous.
            sealed: Whether the log belongs to a run folder and has checksums throughout.
            depth_unit_m: Depth per count of a 16-bit depth image [m].
            calibrate: Function from the log's calibration (None without one) and image size (width, height) to the one to use: it
                sets the camera's mount, and intrinsics that are missing or wrong in the log.
        """
        self._path = path
        self._sealed = sealed
        self._unit_m = depth_unit_m
        self._calibrate = calibrate
        self.found = survey(path, sealed=sealed)
        self.topics = roles(path, self.found, named or {}, calibrated=calibrate(None, (1, 1)) is not None)
        self.dropped: Counter[str] = Counter()
        """Number of dropped messages by topic and reason."""
        self.ended: str | None = None
        """Why the recording ended before its last message, if it did."""
        self._roles = {name: role for role, name in asdict(self.topics).items() if name is not None}
        used = [self.found[name] for name in self._roles]
        self._origin_ns = min(item.stamp_ns for item in used)
        self._has_arrivals = has_arrivals(path) or self._is_ours()
        self.duration_s = (max(item.last_ns for item in used) - min(item.first_ns for item in used)) / 1e9

    @property
    def shows_stair(self) -> bool:
        """Whether the log holds nosing positions: in images, or in stair maps of a camera without images."""
        return self.topics.depth is not None or "/stair/map/detail" in self.found

    def arrivals(self, aside: Callable[[Any], None]) -> Iterator[tuple[float, Reading]]:
        """Yield each sensor reading with the mission time at which it is due [s], in time order.

        Args:
            aside: Takes all other signals, up to a second early: commands, estimates, and events about dropped messages.
        """
        self._aside = aside
        self._last: dict[str, tuple[float, int]] = {}
        self._ready: list[tuple[float, int, str, Reading]] = []
        size = (0, 0) if self.topics.depth is None else self.found[self.topics.depth].size
        self._pairing = Pairing(
            has_colour=self.topics.color is not None,
            unit_m=self._unit_m,
            calibrate=lambda logged: self._calibrate(logged, size),
            lost=self._lost,
            is_ours=self._sealed,
        )
        self._given_s = 0.0
        self._force = (0.0, 0.0, 0.0)
        count = 0
        for topic, logged_ns, data in packets(self._path, self._wants, sealed=self._sealed):
            with damaged_message(self._path, topic.name):
                name = self._roles.get(topic.name, "")
                signal = self._decoded(name, topic.name, received(topic, data, logged_ns, self._origin_ns), logged_ns)
            if self.ended is not None:
                break
            if isinstance(signal, Reading):
                count += 1
                due_s = self._due_s(signal, logged_ns)
                heapq.heappush(self._ready, (due_s, count, topic.name, signal))
                yield from self._due(due_s - HORIZON_S)
            elif signal is not None:
                aside(signal)
        yield from self._due(math.inf)

    def _is_ours(self) -> bool:
        """Return whether the log holds our belt readings, logged by the clock that stamped them."""
        belts = self.found.get(BELTS)
        return (
            belts is not None
            and signal_reader(BELTS, belts.kind) is not None
            and abs(belts.first_ns - belts.stamp_ns) < HORIZON_S * 1e9
        )

    def _due_s(self, signal: Reading, logged_ns: int) -> float:
        """Return the time at which a reading is due [s]: its arrival, if logged, but never before its stamp."""
        return max(signal.t_s, seconds_of(logged_ns - self._origin_ns)) if self._has_arrivals else signal.t_s

    def _wants(self, name: str) -> bool:
        # A camera that processes its images itself logs stair maps instead of images.
        ours = name in OURS - {HEADINGS, EVENTS} or (name in LOOKED and self.topics.depth is None)
        return name in self._roles or (ours and signal_reader(name, self.found[name].kind) is not None)

    def _decoded(self, role: str, name: str, message: Received, logged_ns: int) -> Any | None:
        match role:
            case "depth" | "color" | "info":
                if role != "info" and not self._in_order(name, message.t_s, logged_ns):
                    return None
                return next((frame for frame, _ in self._pairing.take(role, *message)), None)
            case "accel":
                sample = imu(*message)
                if self._in_order(name, sample.t_s, logged_ns):
                    self._force = sample.linear_acceleration_m_s2
                return None
            case "imu":
                signal: Any = imu(*message)
                if self.topics.accel is not None:
                    signal = replace(signal, linear_acceleration_m_s2=self._force)
            case _:
                read = signal_reader(name if role == "" else HEADINGS, self.found[name].kind)
                signal = None if read is None else read(*message)
        if not isinstance(signal, Reading):
            return signal
        return signal if self._in_order(name, signal.t_s, logged_ns) and self._finite(name, signal) else None

    def _in_order(self, name: str, t_s: float, logged_ns: int) -> bool:
        """Return whether a message is later than the previous one of its topic; a leap of the clock ends the recording."""
        if name in self._last:
            before_s, before_ns = self._last[name]
            step_s, logged_s = t_s - before_s, (logged_ns - before_ns) / 1e9
            if step_s < -HORIZON_S or step_s - max(logged_s, 0.0) > HORIZON_S:
                self._end(before_s, f"{name}: the clock leaps by {step_s:+.3f} s at {before_s:.3f} s")
                return False
            if step_s <= 0.0:
                self._drop(before_s, name, "repeated stamp" if step_s == 0.0 else "stamp goes back", f"{step_s:+.3f} s")
                return False
        self._last[name] = t_s, logged_ns
        return True

    def _finite(self, name: str, signal: Reading) -> bool:
        match signal:
            case ImuSample():
                finite = all(map(math.isfinite, (*signal.orientation, *signal.angular_velocity_rad_s)))
            case HeadingMeasurement():
                finite = math.isfinite(signal.heading_rad) and math.isfinite(signal.sigma_rad)
            case _:
                return True  # the leveller needs a NaN of the seat, which stops the actuator
        if not finite:
            self._drop(signal.t_s, name, "not finite", f"at {signal.t_s:.3f} s")
        return finite

    def _due(self, until_s: float) -> Iterator[tuple[float, Reading]]:
        while self._ready and self._ready[0][0] <= until_s:
            t_s, _, name, signal = heapq.heappop(self._ready)
            if t_s - self._given_s > SILENCE_S:
                self._end(self._given_s, f"nothing is recorded from {self._given_s:.1f} to {t_s:.1f} s")
                self._ready.clear()
            elif t_s < self._given_s:
                self._drop(self._given_s, name, "stamps of another clock", f"{t_s - self._given_s:+.3f} s")
            else:
                self._given_s = t_s
                yield t_s, signal

    def _lost(self, t_s: float, reason: str) -> None:
        self._drop(t_s, str(self.topics.depth), reason, f"at {t_s:.3f} s")

    def _drop(self, t_s: float, name: str, reason: str, number: str) -> None:
        """Count a dropped message; the first ones of a kind also become events."""
        key = f"{name}: {reason}"
        self.dropped[key] += 1
        if self.dropped[key] <= EVENTS_MAX:
            self._aside(Event(t_s=max(t_s, 0.0), name="dropped", cause=f"{key} ({number})"))

    def _end(self, t_s: float, cause: str) -> None:
        if self.ended is None:
            self.ended = cause
            self._aside(Event(t_s=max(t_s, 0.0), name="ended", cause=cause))
