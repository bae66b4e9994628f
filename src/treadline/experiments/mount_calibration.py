"""Camera mount calibration from a recording: ``RgbdFrame | ImuSample | TrackReading -> values, camera.toml``.

The log is read as in a replay. The IMU must be on the chair: an IMU on the camera turns with the mount and does not observe it. The
detector receives no gravity: gravity transformed by the assumed mount would confirm the assumption.
"""

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.core.camera_images import MOUNT_FIELDS, PinholeCamera, RgbdFrame
from treadline.core.errors import LogFormatError
from treadline.core.files import write_whole
from treadline.core.ports import Reading
from treadline.core.signals import TICK_S, ImuSample, TrackReading
from treadline.estimation import MountCalibrator, MountConfig, MountEstimate
from treadline.experiments.replay import kind_of, source_of
from treadline.io.sensor_log import SensorLog
from treadline.mission.replay_plant import ReplayPlant
from treadline.perception import StairDetector
from treadline.scenario.camera_file import MOUNT_ANGLES, CameraFile

ANGLES = ("pitch", "roll", "yaw")
GOOD_SHARE = 0.5
"""Smallest share of used frames at which a longer recording is proposed as the remedy."""
TURNED_RAD = 5.0 * DEG
"""Smallest range between the 10th and 90th percentile of the headings at which the yaw is reported [rad]. In a smaller range the
few frames of the first turn determine the yaw, and one bump changed it by a degree (a climb that was square after two seconds)."""


def write_calibration(path: Path, values: dict[str, Any], camera: CameraFile) -> None:
    """Write a calibration with the estimated mount, as ``MountStudy.result`` returns both."""
    known = ", ".join(
        f"{name} ±{1.96 * values[f'{name}_sigma_deg']:.3f}" for name in ANGLES if values[f"{name}_sigma_deg"] is not None
    )
    lines = [f"# Mount estimated from {values['counted']} frames: {known} degrees (95 %); other angles are unchanged."]
    write_whole(path, "\n".join([*lines, camera.text]))


class MountStudy:
    """Streaming calibration of one recording, with one second of readings in memory.

    Raises:
        TreadlineError: If the log is damaged, or has no images, no calibration or no IMU.
    """

    def __init__(self, log: Path, *, camera: CameraFile | None = None, topics: dict[str, str] | None = None) -> None:
        """Survey a log.

        Args:
            camera: Calibration in place of the log's; missing mount angles come from the chair file.
            topics: Topics by role, where the types in the log are ambiguous.
        """
        source = source_of(log)
        self._log = log
        self._nominal = source.base.chair.camera_at()
        self._given = camera
        self._used: PinholeCamera | None = None
        self._recording = SensorLog(
            source.log,
            named=topics,
            sealed=source.sealed,
            depth_unit_m=self._depth_unit_m,
            calibrate=self._calibrate,
        )
        found = self._recording.topics
        if found.depth is None:
            raise LogFormatError(f"{log}: no images, which alone observe the mount; record depth (treadline climb --log-images)")
        if found.imu is None:
            raise LogFormatError(f"{log}: no IMU, which distinguishes a flight from a ramp; record sensor_msgs/Imu")
        self._t_s = 0.0
        self._detector = StairDetector()
        self._calibrator: MountCalibrator | None = None
        self._estimate: MountEstimate | None = None
        self._before: dict[type, ImuSample | TrackReading] = {}
        self._frames = self._used_count = self._solved = 0
        self._blocks: set[int] = set()
        self._headings: deque[float] = deque(maxlen=MountConfig(camera=self._nominal).memory_frames)
        self._left_out: Counter[str] = Counter()

    @property
    def share(self) -> float:
        """Share of the recording that has been read."""
        return self._t_s / max(self._recording.duration_s, TICK_S)

    def readings(self) -> Iterator[Reading]:
        """Yield each sensor reading after it has updated the calibration."""
        plant = ReplayPlant(self._recording.arrivals(lambda _: None))
        plant.start()
        tick = 0
        while not plant.over:
            plant.advance(tick * TICK_S)
            for reading in plant.read():
                self._update(reading)
                yield reading
            tick += 1

    def result(self) -> tuple[dict[str, Any], CameraFile]:
        """Return the result so far as JSON values, and the calibration; an angle without an estimate stays nominal."""
        config = MountConfig(camera=self._nominal if self._used is None else self._used)
        left_out, estimate = Counter(self._left_out), self._estimate
        reason = None
        if estimate is None:
            common = "".join(f"; {count} ×: {why}" for why, count in left_out.most_common(2))
            reason = (
                f"{self._used_count} of {self._frames} frames are usable, in {len(self._blocks)} blocks of {config.block_s:.0f} s "
                f"of driving on a flight; {config.least_blocks} blocks are needed{self._remedy(config)}{common}"
            )
        else:
            turned = float(np.ptp(np.quantile(self._headings, (0.1, 0.9))))
            if turned < TURNED_RAD:
                estimate = replace(estimate, yaw_rad=None, yaw_sigma_rad=None)
            kept = min(self._solved, config.memory_frames)
            left_out["outlier"] = kept - estimate.frame_count
            left_out["after the last solution"] = self._used_count - self._solved
            left_out[f"older than the last {config.memory_frames} usable frames"] = self._solved - kept
        nominal = self._camera_file(config.camera)

        def degrees(name: str) -> float | None:
            value = getattr(estimate, f"{name}_rad", None)
            return None if value is None else value / DEG

        known = {name: angle for name in ANGLES if (angle := degrees(name)) is not None}
        values = {
            "accepted": estimate is not None,
            "reason": reason,
            **{f"{name}_deg": known.get(name) for name in ANGLES},
            **{f"{name}_sigma_deg": degrees(f"{name}_sigma") for name in ANGLES},
            "change_deg": dict.fromkeys(ANGLES)
            | {name: angle - getattr(nominal, f"mount_{name}_deg") for name, angle in known.items()},
            "frames": self._frames,
            "counted": self._used_count if estimate is None else estimate.frame_count,
            "left_out": {why: count for why, count in left_out.most_common() if count > 0},
            "dropped": dict(self._recording.dropped),
            "topics": asdict(self._recording.topics),
        }
        return values, nominal.model_copy(update={f"mount_{name}_deg": round(angle, 4) for name, angle in known.items()})

    def _remedy(self, config: MountConfig) -> str:
        """Return the remedy for a recording that is only too short, else nothing."""
        more_s = (config.least_blocks - len(self._blocks)) * config.block_s
        if more_s <= 0.0 or self._used_count < GOOD_SHARE * self._frames:
            return ""
        return f": drive and record at least {more_s:.0f} s more on the flight"

    def _update(self, reading: Reading) -> None:
        self._t_s = reading.t_s
        if isinstance(reading, RgbdFrame):
            self._detect(reading)
        elif isinstance(reading, ImuSample | TrackReading):
            self._before[type(reading)] = reading
            if self._calibrator is not None:
                self._calibrator.step(reading)

    def _detect(self, frame: RgbdFrame) -> None:
        self._frames += 1
        if self._calibrator is None:
            self._calibrator = MountCalibrator(MountConfig(camera=frame.camera))
            for reading in self._before.values():
                self._calibrator.step(reading)
        detection = self._detector.look(frame)
        if detection.axes is None:
            self._left_out[kind_of(detection.reason or "no tread visible, which the slope is measured from")] += 1
            return
        estimate = self._calibrator.step(detection.axes)
        if self._calibrator.rejection is not None:
            self._left_out[self._calibrator.rejection] += 1
            return
        self._used_count += 1
        self._headings.append(detection.heading_rad or 0.0)
        self._blocks.add(int(frame.t_s // MountConfig(camera=frame.camera).block_s))
        if estimate is not self._estimate:
            self._estimate, self._solved = estimate, self._used_count

    @property
    def _depth_unit_m(self) -> float:
        return 0.001 if self._given is None else self._given.depth_unit_m

    def _calibrate(self, logged: PinholeCamera | None, size: tuple[int, int]) -> PinholeCamera | None:
        """Return the given calibration, else the one in the log; missing mount angles come from the chair file."""
        del size
        known = logged if self._given is None else self._given.camera
        if known is None:
            return None
        given = set() if self._given is None else {name.replace("_deg", "_rad") for name in self._given.model_fields_set}
        mount: dict[str, Any] = {name: getattr(self._nominal, name) for name in MOUNT_FIELDS if name not in given}
        self._used = replace(known, **mount)
        return self._used

    def _camera_file(self, camera: PinholeCamera) -> CameraFile:
        found = CameraFile.of(camera, str(self._log), self._depth_unit_m)
        if self._given is None:
            return found
        return self._given.model_copy(update={name: getattr(found, name) for name in (*MOUNT_ANGLES, "mount_m")})
