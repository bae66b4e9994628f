"""Evaluation of frames for ``treadline see``: frames in; JSON values and pictures, a table and a summary of many frames out."""

import csv
import json
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import chain, islice
from pathlib import Path
from statistics import median
from typing import Any, Literal

import numpy as np
from jaxtyping import UInt8

from treadline.core.angles import DEG, degrees_or_none, radians_hint
from treadline.core.camera_images import NamedFrame, PinholeCamera, RgbdFrame
from treadline.core.errors import ImageError, SettingsError
from treadline.core.printing import plain
from treadline.io.frames.single_frame import ground_with
from treadline.perception.calibration_gate import FRAMES, CalibrationEvidence, calibration_evidence, gated
from treadline.perception.detection import StairDetection, ThresholdRule, refused
from treadline.perception.detector import DetectorConfig, StairDetector
from treadline.perception.overlay import overlay, write_picture, write_stages
from treadline.perception.paper.printed_heading import heading_about

NO_MOUNT = (
    "the calibration names no mount, so the camera is taken to look level and straight ahead: heading_deg is about the camera's "
    "own axis; the chair's heading is heading_on_flight_deg where it stands on the flight, heading_on_level_deg on floor or "
    "landing, if the camera is not turned sideways; give mount_pitch_deg (0 if it does look level), mount_roll_deg and "
    "mount_yaw_deg in the camera file"
)
"""Message for a missing mount calibration. Gravity cannot replace the mount: on a flight, z of the chair is not vertical."""


SQUARE_DEG = {"robust": 0.0, "paper": 90.0}
"""Heading that each method reports for a chair square to the stair [deg]: Eq. (2) as printed is the arccosine of one leg over the
other, and has no sign."""

COLUMNS = ("name", "t_s", "accepted", "heading_deg", "sigma_deg", "edges", "ms", "reason")
"""Columns of the table that are values of a frame."""
STAIR_COLUMNS = ("direction", "rise_m", "run_m", "slope_deg", "distance_m")
"""Columns of the table that are values of a frame's stair."""
ENDINGS = (".csv", ".jsonl")
"""File name endings of tables: CSV, and one JSON object per line."""
_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?")


class FrameEvaluator:
    """Detector whose results are JSON values, with the time of each frame; frames of a faulty calibration are refused."""

    def __init__(self, method: Literal["paper", "robust"], threshold: ThresholdRule = "median", *, warm_up: bool = True) -> None:
        """Make the detector.

        Args:
            threshold: Rule for Canny's thresholds in Algorithm 1.
            warm_up: Process the first accepted and the first rejected frame twice, so that their times exclude loading the
                compiled kernels.
        """
        self._method = method
        self._threshold = threshold
        self._detector = StairDetector(DetectorConfig(method=method, threshold=threshold))
        self._loaded = set[bool]() if warm_up else {False, True}
        """Results, accepted or not, whose kernels are loaded."""
        self._detections: dict[int, tuple[StairDetection, float]] = {}
        """Detection and time [ms] of frames that were tested and are not evaluated yet, by the frame's identity."""
        self._evidence: dict[PinholeCamera, CalibrationEvidence] = {}
        self._is_tested = False
        """Whether evidence is complete before frames are evaluated; otherwise each evaluated frame adds its own."""

    @property
    def findings(self) -> list[str]:
        """Faults of the calibration, one sentence each."""
        return [fault.text for evidence in self._evidence.values() if (fault := evidence.fault) is not None]

    def tested(self, frames: Iterable[NamedFrame]) -> Iterator[NamedFrame]:
        """Yield frames after the calibration has been tested on the first ``FRAMES``."""
        rest = iter(frames)
        first = list(islice(rest, FRAMES))
        for named in first:
            if named.frame is not None and self._method == "robust":
                self._detections[id(named)] = sight, _ = self._timed_look(named, named.frame)
                self._test(named, named.frame.camera, sight)
        self._is_tested = True
        yield from chain(first, rest)

    def _timed_look(self, named: NamedFrame, frame: RgbdFrame) -> tuple[StairDetection, float]:
        """Return the detection in a frame, and its time [ms]."""
        started = time.perf_counter()
        sight = self._detector.look(frame, named.gravity_C)
        spent_ms = (time.perf_counter() - started) * 1e3
        if sight.accepted in self._loaded:
            return sight, spent_ms
        self._loaded.add(sight.accepted)
        return self._timed_look(named, frame)

    def _test(self, named: NamedFrame, camera: PinholeCamera, sight: StairDetection) -> None:
        """Add the evidence of a frame, up to that of ``FRAMES`` frames of its camera."""
        known = self._evidence.get(camera)
        new = calibration_evidence(sight, camera, named.gravity_C) if known is None or known.frames < FRAMES else None
        if new is not None:
            self._evidence[camera] = new if known is None else known + new

    def evaluate(self, named: NamedFrame) -> tuple[StairDetection, dict[str, Any]]:
        """Return the detection in a frame, and its values with the keys of the JSON output.

        Raises:
            ImageError: If Algorithm 1 has no colour image.
        """
        if named.frame is None:
            sight = refused(named.reason or "no image")
            return sight, _answer(named, sight, 0.0, SQUARE_DEG[self._method])
        if self._method == "paper" and not named.has_colour:
            raise ImageError(f"{named.name}: no colour image; Algorithm 1 finds its edges in colour: leave --method paper out")
        known = self._detections.pop(id(named), None)
        sight, spent_ms = self._timed_look(named, named.frame) if known is None else known
        if not self._is_tested:
            self._test(named, named.frame.camera, sight)
        seen = gated(sight, self._evidence.get(named.frame.camera))
        ground = _ground(named, sight) if seen is sight else []
        return seen, _answer(named, seen, spent_ms, SQUARE_DEG[self._method], ground)

    def write_pictures(self, named: NamedFrame, sight: StairDetection, folder: Path) -> None:
        """Write the six stages of Fig. 5, if the frame has colour, and the detections of the robust method."""
        prefix = Path(named.name).stem
        if named.frame is not None and named.has_colour:
            printed = StairDetector(DetectorConfig(method="paper", threshold=self._threshold))
            shown = printed.look(named.frame, named.gravity_C, stages=True)
            if shown.stages is not None:
                write_stages(shown.stages, folder, prefix=prefix)
        if self._method == "robust":
            write_seen(named, sight, folder / f"{prefix}-seen.png")


def write_seen(named: NamedFrame, sight: StairDetection, path: Path) -> None:
    """Write the picture of the detections, on the depth image where there is no colour."""
    if named.frame is not None:
        frame = named.frame if named.has_colour else replace(named.frame, rgb=_depth_in_grey(named.frame))
        write_picture(overlay(frame, sight), path)


def _depth_in_grey(frame: RgbdFrame) -> UInt8[np.ndarray, "h w 3"]:
    """Return the depth image as grey values, near is bright; pixels without a return are black."""
    depth = frame.depth_m
    known = np.isfinite(depth)
    if not known.any():
        return frame.rgb
    near, far = np.percentile(depth[known], (2.0, 98.0))
    share = np.clip((far - depth) / max(float(far - near), 1e-3), 0.0, 1.0)
    grey = np.where(known, 60.0 + 180.0 * np.where(known, share, 0.0), 0.0).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def _answer(
    named: NamedFrame, sight: StairDetection, spent_ms: float, square_deg: float, ground: Sequence[str] = ()
) -> dict[str, Any]:
    return {
        "name": named.name,
        **({} if named.t_s is None else {"t_s": named.t_s}),
        "accepted": sight.accepted,
        "reason": sight.reason,
        "heading_deg": degrees_or_none(sight.heading_rad),
        "square_deg": square_deg,
        "sigma_deg": degrees_or_none(sight.sigma_rad),
        "edge_direction": None if sight.edge_direction_C is None else sight.edge_direction_C.tolist(),
        "edges": sight.edge_count,
        "box_px": sight.box_px,
        "stair": _stair(sight),
        "steps": [asdict(step) for step in sight.steps],
        "turn": None if sight.turn is None else f"the flight {sight.turn}",
        "ground": list(ground),
        "ms": spent_ms,
        "mount_known": named.mount_known,
        "warning": _calibration_warning(named),
        **({} if named.mount_known else _without_mount(sight)),
    }


def _ground(named: NamedFrame, sight: StairDetection) -> list[str]:
    """Return what is on the ground of a frame without an accepted flight, in words; it takes gravity and a mount."""
    if sight.accepted or named.frame is None or named.gravity_C is None or not named.mount_known:
        return []
    rows = ground_with(sight, named.frame, named.gravity_C).printed()[1]
    return [f"{name} {text}" if name != "step" else text for name, text in rows]


def measured_stair(seen: Sequence[Mapping[str, Any]]) -> str:
    """Return the ``[stair]`` table of a scenario from the accepted frames of one stair: medians, and the steps that were in view.

    Raises:
        SettingsError: If no frame was accepted.
    """
    stairs = [values["stair"] for values in seen if values["accepted"] and values["stair"] is not None]
    if not stairs:
        raise SettingsError("--stair: no frame shows a stair whose steps could be written")
    steps = max(len(stair["nosings_m"]) for stair in stairs)
    has_end = any(stair["ends"] for stair in stairs)
    lines = [f"{name} = {median(stair[name] for stair in stairs):.3f}" for name in ("rise_m", "run_m")]
    widths_m = [stair["width_m"] for stair in stairs if stair["width_m"] is not None]
    lines += [f"width_m = {median(widths_m):.2f}"] if widths_m else []
    end = "its end was in view" if has_end else "its end was not in view: there may be more"
    return "\n".join(["[stair]", *lines, f"steps = {steps}  # in view of one frame; {end}", ""])


def _calibration_warning(named: NamedFrame) -> str | None:
    """Return what is missing or improbable in the mount of the camera."""
    if not named.mount_known:
        return NO_MOUNT
    return None if named.frame is None else radians_hint("mount_pitch_deg", named.frame.camera.mount_pitch_rad / DEG)


def _without_mount(sight: StairDetection) -> dict[str, float | None]:
    """Return the heading at camera yaw 0, for a chair on the flight and for one on horizontal ground."""
    up = {} if sight.axes is None else {"heading_on_flight_deg": sight.axes.normal_C, "heading_on_level_deg": -sight.axes.down_C}
    headings = {
        name: degrees_or_none(heading_about(normal, sight.axes.edge_C)) for name, normal in up.items() if sight.axes is not None
    }
    return {"heading_on_flight_deg": None, "heading_on_level_deg": None} | headings


def _stair(sight: StairDetection) -> dict[str, Any] | None:
    """Return the dimensions of the stair and, in the chair frame, the map."""
    shape, seen = sight.shape, sight.stair_map
    if shape is None:
        return None
    measures: dict[str, Any] = {name: getattr(shape, name) for name in ("direction", "rise_m", "run_m")}
    measures |= {"slope_deg": degrees_or_none(shape.slope_rad), "distance_m": shape.distance_m}
    if seen is not None:
        measures["nosings_m"] = [list(place) for place in seen.nosings_B]
        measures |= {name: getattr(seen, name) for name in ("ends", "width_m", "left_wall_m", "right_wall_m", "obstacle_m")}
    return measures


@contextmanager
def heading_table(path: Path) -> Iterator[Callable[[Mapping[str, Any]], None]]:
    """Open a file with a row per frame, written row by row, so that an interrupted run leaves a readable table.

    Yields:
        The function that appends the row of a frame.

    Raises:
        SettingsError: If the ending of the name is neither .csv nor .jsonl.
    """
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise SettingsError(f"--headings {path}: unknown format '{path.suffix}'; give .csv or .jsonl")
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        if suffix == ".csv":
            rows.writerow((*COLUMNS, *STAIR_COLUMNS))

        def write(values: Mapping[str, Any]) -> None:
            if suffix == ".csv":
                stair = values["stair"] or {}
                rows.writerow([values.get(column) for column in COLUMNS] + [stair.get(column) for column in STAIR_COLUMNS])
            else:
                file.write(json.dumps(plain(values), allow_nan=False) + "\n")
            file.flush()

        yield write


class Summary:
    """Counts of accepted frames and of rejection reasons, and the processing times."""

    def __init__(self) -> None:
        self._accepted = 0
        self._times_ms: list[float] = []
        self._reasons: dict[str, tuple[str, int]] = {}

    def add(self, values: Mapping[str, Any]) -> None:
        """Count a frame."""
        self._times_ms.append(float(values["ms"]))
        if values["accepted"]:
            self._accepted += 1
            return
        reason = str(values["reason"])
        # Reasons that differ in their numbers only are one reason; the first one is the example.
        kind = _NUMBER.sub("#", reason)
        example, count = self._reasons.get(kind, (reason, 0))
        self._reasons[kind] = example, count + 1

    @property
    def values(self) -> dict[str, Any]:
        """Summary with the keys of the JSON output."""
        count = len(self._times_ms)
        ordered = sorted(self._reasons.values(), key=lambda item: -item[1])
        return {
            "count": count,
            "accepted": self._accepted,
            "accepted_share": self._accepted / count if count else None,
            "rejections": dict(ordered),
            "median_ms": float(np.median(self._times_ms)) if count else None,
        }

    @property
    def lines(self) -> list[str]:
        """Summary for people."""
        count = len(self._times_ms)
        share = f" ({100.0 * self._accepted / count:.0f} %), median {np.median(self._times_ms):.1f} ms" if count else ""
        first = f"{self._accepted} of {count} frames accepted{share}"
        return [first, *(f"  rejected {times}: {reason}" for reason, times in self.values["rejections"].items())]
