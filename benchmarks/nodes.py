"""Loss and delay of signals between processes: ``python benchmarks/nodes.py zenoh|ros1 [SECONDS]``.

Measures loss and delay of 10 Hz RGB-D at 320×240 and of 100 Hz IMU, over loopback, in wall time. Then runs the node graph on the
MuJoCo plant in real time and measures the delay from a frame's arrival to the first guard command that uses the heading of this
frame, both as received by an observer process. The driver sends at 4 Hz, the guard at 100 Hz; only guard commands count.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import HeadingEstimate, HeadingMeasurement, ImuSample, TrackCommand
from treadline.ros import channels as on
from treadline.ros.wire import WireTransport

ENDPOINT = "tcp/127.0.0.1:17469"
SCENARIO = """
[stair]
steps = 66
width_m = 2.4
[start]
place = "flight"
step = 6
heading_deg = 10
[drive]
duration_s = 600
"""


def wire(kind: str, name: str, *, listen: bool = False) -> WireTransport:
    if kind == "ros1":
        from treadline.ros.ros1 import Ros1Transport

        return Ros1Transport(name)
    from treadline.ros.zenoh import ZenohTransport

    return ZenohTransport(name, endpoint=ENDPOINT, listen=listen)


def source(kind: str, seconds: float) -> None:
    """Speak as a chair's drivers do; stamps are the wall's."""
    out = wire(kind, "source")
    camera = PinholeCamera(width_px=320, height_px=240, fx_px=287.5, fy_px=287.5, cx_px=159.5, cy_px=119.5)
    rng = np.random.default_rng(0)
    rgb = rng.integers(0, 255, (240, 320, 3), dtype=np.uint8)
    depth = rng.uniform(0.5, 4.0, (240, 320)).astype(np.float32)
    zeros, level = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    out.announce(on.CAMERA)
    out.announce(on.IMU)
    time.sleep(2.0)
    began = time.monotonic()
    for k in range(round(100 * seconds)):
        out.publish(
            on.IMU, ImuSample(t_s=time.time(), orientation=level, angular_velocity_rad_s=zeros, linear_acceleration_m_s2=zeros)
        )
        if k % 10 == 0:
            out.publish(on.CAMERA, RgbdFrame(t_s=time.time(), rgb=rgb, depth_m=depth, camera=camera))
        time.sleep(max(0.0, began + (k + 1) / 100 - time.monotonic()))
    time.sleep(1.0)
    out.close()


def sink(kind: str, seconds: float) -> None:
    """Count what comes, and how late."""
    delays: dict[str, list[float]] = {on.IMU: [], on.CAMERA: []}
    into = wire(kind, "sink", listen=True)
    into.spare = 100  # a recorder's room: what is counted is the wire's loss, not the pictures that gave way to newer ones
    for channel, kept in delays.items():
        into.subscribe(channel, lambda signal, kept=kept: kept.append(1e3 * (time.time() - signal.t_s)))
    speaker = subprocess.Popen([sys.executable, __file__, kind, str(seconds), "source"])
    while speaker.poll() is None:
        into.deliver(0.05)
    while into.deliver(0.2):
        pass
    into.close()
    for channel, rate in ((on.CAMERA, 10), (on.IMU, 100)):
        report(f"{kind}: {channel}: {len(delays[channel])} of {round(rate * seconds)} came", delays[channel])


class FrameToCommand:
    """Delays from a frame's arrival to its measured heading, and to the guard's first command after the estimate with it [ms]."""

    def __init__(self, watch: WireTransport) -> None:
        self.to_heading: list[float] = []
        self.to_command: list[float] = []
        self.frames: dict[float, float] = {}
        self.t_s = 0.0
        self._seen: float | None = None
        self._known: float | None = None
        takers = (
            (on.CAMERA, self._frame),
            (on.MEASURED, self._measured),
            (on.ESTIMATE, self._estimated),
            (on.TRACKS_CMD, self._done),
        )
        for channel, take in takers:
            watch.subscribe(channel, take)

    def _frame(self, picture: RgbdFrame) -> None:
        self.frames[picture.t_s] = time.monotonic()

    def _measured(self, seen: HeadingMeasurement) -> None:
        self._seen, self._known = self.frames.get(seen.t_s), None
        if self._seen is not None:
            self.to_heading.append(1e3 * (time.monotonic() - self._seen))

    def _estimated(self, estimate: HeadingEstimate) -> None:
        self.t_s, self._known = estimate.t_s, self._seen

    def _done(self, _: TrackCommand) -> None:
        if self._known is not None:
            self.to_command.append(1e3 * (time.monotonic() - self._known))
            self._seen = self._known = None


def graph(kind: str, seconds: float) -> None:
    """Drive, and watch how long a frame takes to become a command."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder) / "climb.toml"
        scenario.write_text(SCENARIO)
        options = ["--transport", kind, "--endpoint", ENDPOINT, "--duration", str(seconds)]
        started = subprocess.Popen([sys.executable, "-m", "treadline", "nodes", str(scenario), *options], stderr=subprocess.DEVNULL)
        watch = wire(kind, "bystander")
        delays = FrameToCommand(watch)
        while started.poll() is None:
            watch.deliver(0.05)
        took_s = time.monotonic() - min(delays.frames.values(), default=0.0)
        watch.close()
    report(f"{kind}: camera to heading seen, {len(delays.to_heading)} frames", delays.to_heading[3:])
    frames = len(delays.to_command)
    report(f"{kind}: camera to command, {frames} frames, {seconds / took_s:.2f} × real time", delays.to_command[3:])


def report(what: str, delays_ms: list[float]) -> None:
    median, p95, worst = np.percentile(delays_ms, (50, 95, 100)) if delays_ms else (np.nan, np.nan, np.nan)
    print(f"{what}: median {median:.1f} ms, p95 {p95:.1f} ms, worst {worst:.1f} ms", flush=True)


if __name__ == "__main__":
    transport = sys.argv[1] if len(sys.argv) > 1 else "zenoh"
    if transport not in ("zenoh", "ros1"):
        sys.exit(__doc__)
    length_s = float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    roles = {"source": source, "sink": sink, "graph": graph}
    if len(sys.argv) > 3:
        roles[sys.argv[3]](transport, length_s)
    else:  # a process is one node of ROS 1, and no more
        for role in ("sink", "graph"):
            subprocess.run([sys.executable, __file__, transport, str(length_s), role], check=True)
