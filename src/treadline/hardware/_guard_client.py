"""The guard as the loop sees it: the loop's side of the guard process.

It admits readings by the same rules as the guard does, passes messages and proposals on, and returns the commands and the hold that
the guard process has reported. It decides nothing.
"""

import select
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any

from treadline.core.errors import LinkError
from treadline.core.ports import Reading
from treadline.core.signals import Event, FrameQuality, FreeGround, HeadingEstimate, HeadingMeasurement, SeatCommand, TrackCommand
from treadline.guard import SILENCE_S, Commands, GuardConfig, ReadingAdmission
from treadline.hardware._process_messages import received, send
from treadline.hardware.ports import DriveState, StickReading
from treadline.hardware.robot_file import RobotFile
from treadline.mission.loop import GuardMessage

OPEN_S = 30.0
"""Longest time to open all links [s]: a busy machine starts Python in seconds, and a vendor's driver resets its device."""
CLOSE_S = 2.0
"""Longest time for the guard process to stop the box and release the devices [s]."""


class GuardClient:
    """Guard in a process of its own.

    Args:
        robot: Robot file whose links the process opens.

    Raises:
        LinkError: If a device does not open.
    """

    def __init__(self, robot: RobotFile) -> None:
        self._channel, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "treadline.hardware._guard_process", str(theirs.fileno())]
        self.process = subprocess.Popen(command, pass_fds=[theirs.fileno()])  # noqa: S603 - our own command
        theirs.close()
        self.note = ""
        """Scheduling that the process was granted."""
        self.config: GuardConfig
        self.holding: str | None = None
        """Cause of the guard's hold as last reported, or None."""
        self.stick: StickReading
        """Newest deflection of the handset's stick."""
        self.state: DriveState | None = None
        """Newest state of the drives."""
        self.lost: str | None = None
        """Why the chair can no longer be driven: a link was lost, or the guard process is gone or silent; None while all work."""
        self._events: list[Event] = []
        self._readings: list[Any] = []
        self._calls: list[tuple[str, Any]] = []
        try:
            self._open(robot)
        except LinkError:
            self.close()
            raise

    def _open(self, robot: RobotFile) -> None:
        links = {port: table.request for port, table in robot.tables.items()}
        send(self._channel, {"links": links, "limits": robot.drive_limits, "signs": robot.signs.model_dump()})
        if not select.select([self._channel], [], [], OPEN_S)[0]:
            raise LinkError(f"the guard process did not open the links within {OPEN_S:g} s; is a driver waiting for its device?")
        try:
            answer = next(received(self._channel))
        except EOFError:
            raise LinkError("the guard process ended while it opened the links; see its messages above") from None
        if "failed" in answer:
            raise LinkError(answer["failed"])
        self.note = answer["opened"]

    def begin(self, config: GuardConfig, cause: str, *, rearms: bool = True) -> float:
        """Begin a session with a new guard, which holds for ``cause`` until a person re-arms.

        Args:
            config: Limits of the session.
            cause: Why the guard holds.
            rearms: Whether a person can re-arm; False for a session without motion.

        Returns:
            The monotonic time at which the session's mission clock is zero [s].
        """
        self._start_s = self._heard_s = time.monotonic()
        self.config, self.holding, self.stick = config, cause, StickReading(t_s=0.0, speed=0.0, turn=0.0)
        self._admission = ReadingAdmission(config)
        self._commands = Commands(TrackCommand.stop(0.0), SeatCommand(t_s=0.0, rate_m_s=0.0), None)
        self._events, self._readings, self._calls = [], [], []
        session = {"config": config, "start_s": self._start_s, "note": self.note, "cause": cause, "rearms": rearms}
        send(self._channel, {"session": session})
        return self._start_s

    def receive(self) -> None:
        """Take the reports that have arrived; those of an earlier session are left out."""
        now_s = time.monotonic()
        try:
            for report in received(self._channel):
                self._heard_s = now_s
                self._take(report)
        except EOFError:
            self.lost = self.lost or "the guard process has ended; the box's watchdog has stopped the belts"
        silent_s = now_s - self._heard_s
        if silent_s > SILENCE_S:
            self.lost = self.lost or f"the guard process is silent for {silent_s:.2f} s; the box's watchdog has stopped the belts"
        self.holding = self.holding or self.lost

    def readings(self, until_s: float) -> list[Any]:
        """Return the readings stamped up to a mission time, in order of arrival."""
        taken = [reading for reading in self._readings if reading.t_s <= until_s]
        self._readings = [reading for reading in self._readings if reading.t_s > until_s]
        return taken

    # The calls of the loop, as to a guard in its own process

    def advance(self, t_s: float) -> None:
        """Set the clock that stamps are compared with."""
        self._admission.advance(t_s)

    def admit(self, reading: Reading) -> bool:
        """Return whether other blocks may use a reading; those of the camera are passed on, the others came from there."""
        if isinstance(reading, FrameQuality | FreeGround):
            self._calls.append(("admit", reading))
        return self._admission.admit(reading)

    def on_message(self, message: HeadingMeasurement | GuardMessage) -> None:
        """Pass on a message that other blocks computed from readings."""
        self._calls.append(("on_message", message))

    def propose(self, command: TrackCommand | SeatCommand) -> None:
        """Pass on a proposal of the driver or of the seat's leveller."""
        self._calls.append(("propose", command))

    def hold(self, cause: str) -> None:
        """Hold, at once; waits for no lock."""
        send(self._channel, {"hold": cause})

    def step(self, t_s: float, estimate: HeadingEstimate | None) -> Commands:
        """Send the messages of the tick, which are the loop's heartbeat; return the newest commands of the guard."""
        del t_s
        send(self._channel, {"calls": self._calls, "estimate": estimate})
        self._calls = []
        return self._commands

    def take_events(self) -> Sequence[Event]:
        """Return the guard's events since the last call."""
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Stop the box, release the devices and end the process."""
        send(self._channel, {"end": "the run is over"})
        self._channel.close()
        try:
            self.process.wait(CLOSE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _take(self, report: dict[str, Any]) -> None:
        self.state = report["state"]
        self.lost = self.lost or report["failed"]
        if "commands" not in report or report["start_s"] != self._start_s:
            return  # from before this session
        self._commands = Commands(*report["commands"])
        self.holding = report["holding"]
        self._events += report["events"]
        for reading in report["readings"]:
            if isinstance(reading, StickReading):
                self.stick = reading
            else:
                self._readings.append(reading)
