"""How a recording's camera sits on its chair: ``RgbdFrame | ImuSample | TrackReading -> CalibrationStudy``, and a camera.toml out.

The log is read as a replay reads it; the IMU must be the chair's, for one that is fixed to the camera turns with the mount and
cannot tell it. Frames are looked at without gravity: a detector that is told down through the mount would confirm the mount.
"""

import json
import math
import re
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.angles import DEG, rotation_of
from treadline.camera_file import CameraFile
from treadline.errors import ImageError, LogFormatError
from treadline.estimation import MountCalibrator, MountConfig, MountEstimate
from treadline.estimation.mount import PAIRED_S, STANDING_M_S
from treadline.experiments.replay_source import source_of
from treadline.io.sensor_log import SensorLog
from treadline.mission.replay import ReplayPlant
from treadline.models import write_whole
from treadline.perception import StairDetector
from treadline.settings import settings_of
from treadline.signals import TICK_S, ImuSample, PinholeCamera, Reading, RgbdFrame, StairAxes, TrackReading

ANGLES = ("pitch", "roll", "yaw")
GOOD_SHARE = 0.5
"""Of the frames that must count for more of the same to help."""
MOUNT = (*(f"mount_{name}_rad" for name in ANGLES), "mount_m")
TURNED_RAD = 5.0 * DEG
"""Between the tenths of headings furthest left and right. In less, the few frames of a first turn decide the yaw, and one bump
among them turns it by a degree (seen on a climb that was square after two seconds)."""
_NUMBER = re.compile(r"(?<!\()[+-]?\d+(\.\d+)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationStudy:
    """What a recording taught."""

    camera: CameraFile
    """As used: the mount as it was meant."""
    estimate: MountEstimate | None
    reason: str | None
    """Why there is no estimate."""
    frames: int
    counted: int
    """Of them, in the estimate; where there is none, good for one."""
    left_out: dict[str, int]
    """Frames that do not count, by reason."""
    dropped: dict[str, int]
    """Messages that could not be used, by topic and reason."""
    topics: dict[str, str | None]

    @property
    def learned(self) -> CameraFile:
        """The calibration with the mount as learned; what was not told stays."""
        found = {f"mount_{name}_deg": round(value, 4) for name in ANGLES if (value := self._deg(name)) is not None}
        return self.camera.model_copy(update=found)

    def summary(self) -> dict[str, Any]:
        """Return the study as JSON values."""
        told = {f"{name}_deg": self._deg(name) for name in ANGLES}
        sigmas = {f"{name}_sigma_deg": self._deg(f"{name}_sigma") for name in ANGLES}
        change = {
            name: None if (value := told[f"{name}_deg"]) is None else value - getattr(self.camera, f"mount_{name}_deg")
            for name in ANGLES
        }
        return {
            "accepted": self.estimate is not None,
            "reason": self.reason,
            **told,
            **sigmas,
            "change_deg": change,
            "frames": self.frames,
            "counted": self.counted,
            "left_out": self.left_out,
            "dropped": self.dropped,
            "topics": self.topics,
        }

    def write(self, path: Path) -> None:
        """Write the calibration with the learned mount, whole."""
        values = self.summary()
        known = ", ".join(
            f"{name} ±{1.96 * values[f'{name}_sigma_deg']:.3f}" for name in ANGLES if values[f"{name}_sigma_deg"] is not None
        )
        lines = [f"# Mount learned from {values['counted']} frames: {known} degrees (95 %); what is not named here is as it was."]
        # JSON's numbers, words and lists are TOML's, too.
        table = self.learned.model_dump(mode="json", exclude_none=True)
        write_whole(path, "\n".join([*lines, *(f"{key} = {json.dumps(value)}" for key, value in table.items())]) + "\n")

    def _deg(self, name: str) -> float | None:
        value = getattr(self.estimate, f"{name}_rad", None)
        return None if value is None else value / DEG


class MountStudy:
    """One recording, read once, a second of it held at a time.

    Raises:
        TreadlineError: If the log is damaged, or has no images, no calibration or no IMU.
    """

    def __init__(self, log: Path, *, camera: CameraFile | None = None, topics: dict[str, str] | None = None) -> None:
        """Survey a log.

        Args:
            camera: The calibration that counts instead of the log's; what it leaves out of the mount is as the chair's file says.
            topics: Topics by role, where the log's types do not tell.
        """
        source = source_of(log)
        self._log = log
        self._meant = source.base.chair.camera_at()
        self._given = camera
        self._used: PinholeCamera | None = None
        with _in_words_of_mount():
            self._recording = SensorLog(
                source.log,
                named=topics,
                sealed=source.sealed,
                depth_unit_m=self._depth_unit_m,
                calibrate=self._calibrate,
            )
        found = self._recording.topics
        if found.depth is None:
            raise LogFormatError(
                f"{log}: no images, and a mount shows in nothing else; record depth (treadline climb --log-images)"
            )
        if found.imu is None:
            raise LogFormatError(
                f"{log}: no IMU, and without one the camera cannot tell a flight from a ramp; record sensor_msgs/Imu"
            )
        self._t_s = 0.0
        self._detector = StairDetector()
        self._calibrator: MountCalibrator | None = None
        self._estimate: MountEstimate | None = None
        self._felt: ImuSample | None = None
        self._driven: TrackReading | None = None
        self._frames = self._taken = self._solved = 0
        self._blocks: set[int] = set()
        self._headings: deque[float] = deque(maxlen=MountConfig(camera=self._meant).memory_frames)
        self._left_out: Counter[str] = Counter()

    @property
    def share(self) -> float:
        """How much of the recording has been read."""
        return self._t_s / max(self._recording.duration_s, TICK_S)

    def readings(self) -> Iterator[Reading]:
        """Yield what the sensors read, each once it has been learned from."""
        plant = ReplayPlant(self._recording.arrivals(lambda _: None))
        with _in_words_of_mount():
            plant.start()
            tick = 0
            while not plant.over:
                plant.advance(tick * TICK_S)
                for reading in plant.read():
                    self._learn(reading)
                    yield reading
                tick += 1

    def calibration(self) -> CalibrationStudy:
        """Return what has been learned so far."""
        config = MountConfig(camera=self._meant if self._used is None else self._used)
        left_out, estimate = Counter(self._left_out), self._estimate
        reason = None
        if estimate is None:
            often = "".join(f"; {count} ×: {why}" for why, count in left_out.most_common(2))
            reason = (
                f"{self._taken} of {self._frames} frames count, in {len(self._blocks)} stretches of {config.block_s:.0f} s of "
                f"driving on a flight, of {config.least_blocks} needed{self._remedy(config)}{often}"
            )
        else:
            turned = float(np.ptp(np.quantile(self._headings, (0.1, 0.9))))
            if turned < TURNED_RAD:
                estimate = replace(estimate, yaw_rad=None, yaw_sigma_rad=None)
            kept = min(self._solved, config.memory_frames)
            left_out["unlike the others"] = kept - estimate.frame_count
            left_out["in the second after the last solution"] = self._taken - self._solved
            left_out[f"older than the last {config.memory_frames} that count"] = self._solved - kept
        return CalibrationStudy(
            camera=self._camera_file(config.camera),
            estimate=estimate,
            reason=reason,
            frames=self._frames,
            counted=self._taken if estimate is None else estimate.frame_count,
            left_out={why: count for why, count in left_out.most_common() if count > 0},
            dropped=dict(self._recording.dropped),
            topics=asdict(self._recording.topics),
        )

    def _remedy(self, config: MountConfig) -> str:
        """Return what helps a drive that is good but for its length."""
        more_s = (config.least_blocks - len(self._blocks)) * config.block_s
        if more_s <= 0.0 or self._taken < GOOD_SHARE * self._frames:
            return ""
        return f": drive and record at least {more_s:.0f} s more on the flight"

    def _learn(self, reading: Reading) -> None:
        self._t_s = reading.t_s
        match reading:
            case RgbdFrame():
                self._look(reading)
                return
            case ImuSample():
                self._felt = reading
            case TrackReading():
                self._driven = reading
            case _:
                return
        if self._calibrator is not None:
            self._calibrator.step(reading)

    def _look(self, frame: RgbdFrame) -> None:
        self._frames += 1
        if self._calibrator is None:
            self._calibrator = MountCalibrator(MountConfig(camera=frame.camera))
            for before in (self._felt, self._driven):
                if before is not None:
                    self._calibrator.step(before)
        sight = self._detector.look(frame)
        if sight.axes is None:
            self._left_out[_NUMBER.sub("#", sight.reason or "no tread to tell the slope by")] += 1
            return
        dropped_count = self._calibrator.dropped_count
        estimate = self._calibrator.step(sight.axes)
        if self._calibrator.dropped_count > dropped_count:
            self._left_out[self._doubt(sight.axes, frame.camera)] += 1
            return
        self._taken += 1
        self._headings.append(sight.heading_rad or 0.0)
        self._blocks.add(int(frame.t_s // MountConfig(camera=frame.camera).block_s))
        if estimate is not self._estimate:
            self._estimate, self._solved = estimate, self._taken

    def _doubt(self, axes: StairAxes, camera: PinholeCamera) -> str:
        """Return for people why the calibrator did not take a frame."""
        config = MountConfig(camera=camera)
        if self._driven is not None and max(abs(self._driven.left_m_s), abs(self._driven.right_m_s)) < STANDING_M_S:
            return "the chair stands"
        if self._felt is None or axes.t_s - self._felt.t_s > PAIRED_S:
            return "no attitude of the IMU at its time"
        seen, felt, off = (
            math.acos(min(max(cosine, -1.0), 1.0))
            for cosine in (
                -float(axes.normal_C @ axes.down_C),
                float(rotation_of(self._felt.orientation)[2, 2]),
                float((camera.R_BC @ axes.normal_C)[2]),
            )
        )
        if off > config.mount_gate_rad:
            return f"the nosings' plane is more than {config.mount_gate_rad / DEG:.0f}° from where the mount as meant has it"
        if abs(seen - felt) > config.slope_gate_rad:
            return f"the slope seen is more than {config.slope_gate_rad / DEG:.0f}° from the one felt: not on the flight it sees"
        return "the chair rocks, or the stair's directions are not sure enough"

    @property
    def _depth_unit_m(self) -> float:
        return 0.001 if self._given is None else self._given.depth_unit_m

    def _calibrate(self, logged: PinholeCamera | None, size: tuple[int, int]) -> PinholeCamera | None:
        """Return the calibration given, else the log's own; what neither says of the mount is as the chair's file says."""
        del size
        known = logged if self._given is None else self._given.camera
        if known is None:
            return None
        said = set() if self._given is None else {name.replace("_deg", "_rad") for name in self._given.model_fields_set}
        mount: dict[str, Any] = {name: getattr(self._meant, name) for name in MOUNT if name not in said}
        self._used = replace(known, **mount)
        return self._used

    def _camera_file(self, camera: PinholeCamera) -> CameraFile:
        mount: dict[str, Any] = {f"mount_{name}_deg": getattr(camera, f"mount_{name}_rad") / DEG for name in ANGLES}
        mount["mount_m"] = camera.mount_m
        if self._given is not None:
            return self._given.model_copy(update=mount)
        intrinsics = {name: getattr(camera, name) for name in ("fx_px", "fy_px", "cx_px", "cy_px")}
        sizes = {"width": camera.width_px, "height": camera.height_px, "depth_unit_m": self._depth_unit_m}
        return settings_of(sizes | intrinsics | mount, CameraFile, where=str(self._log))


@contextmanager
def _in_words_of_mount() -> Iterator[None]:
    """Reword the remedies of a replay, which has a key for what is here said by a file."""
    try:
        yield
    except (ImageError, LogFormatError) as error:
        raise type(error)(str(error).replace("--set camera.", "--camera FILE with ")) from None
