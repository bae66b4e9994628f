"""Robustness of the detector: ``python benchmarks/robustness.py [--frames N] [--looks N] [--seed S]``.

Recorded frames, if available, and lifelike drawn ones, each seen otherwise (``variations``): smaller, cropped, turned, mirrored,
with a wrong gravity, or in another size. No frame may end in an exception, an accepted heading may leave its 99 % interval in one
frame of a hundred, and a scene of another size is accepted with its own rise and run or rejected.

``--folders N``: the calibration gate instead, on N folders before a flight and N on it for each fault, and on 14 N sound ones.
"""

import functools
import operator
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scenes.scores import percent
from tables import frame_options, markdown, seeds_of
from variations import (
    FAULTS,
    KINDS,
    Kind,
    KnownFrame,
    drawn_folder,
    drawn_frame,
    recorded_frames,
    seen_otherwise,
    with_fault,
)

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera
from treadline.core.rotations import Vector3
from treadline.perception import StairDetection, StairDetector
from treadline.perception.calibration_gate import CalibrationEvidence, Cause, calibration_evidence

WITHIN_99 = 2.576
"""Half width of a 99 % interval of a normal distribution, in standard deviations."""
SAME_SIZE = 0.1
"""Largest relative error of an accepted rise."""


@dataclass(slots=True)
class Tally:
    """What became of the frames of one kind."""

    frames: int = 0
    accepted: int = 0
    outside: int = 0
    other_size: int = 0
    sized: int = 0
    worst_deg: float = 0.0
    failures: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, known: KnownFrame, sight: StairDetection) -> None:
        """Count a result."""
        self.frames += 1
        if not sight.accepted or sight.heading_rad is None or sight.sigma_rad is None:
            return
        self.accepted += 1
        # Edges have no sense of direction.
        off_rad = (sight.heading_rad - heading_of(known.edge_C, known.frame.camera) + 0.5 * np.pi) % np.pi - 0.5 * np.pi
        error_deg = abs(off_rad) / DEG
        sigma_deg = float(np.hypot(sight.sigma_rad, known.edge_sigma_rad)) / DEG
        if error_deg > WITHIN_99 * sigma_deg:
            self.outside += 1
            self.notes.append(f"{known.name}: {error_deg:.2f}° off, sigma {sigma_deg:.2f}°")
        self.worst_deg = max(self.worst_deg, error_deg)
        if known.rise_m is not None and sight.shape is not None:
            self.sized += 1
            if abs(sight.shape.rise_m / known.rise_m - 1.0) > SAME_SIZE:
                self.other_size += 1
                self.notes.append(f"{known.name}: rise {1e3 * sight.shape.rise_m:.0f} of {1e3 * known.rise_m:.0f} mm")

    def row(self, label: str) -> str:
        """Return the row of a table."""
        return (
            f"| {label} | {self.frames} | {percent(self.accepted, self.frames)} | {percent(self.outside, self.accepted)} | "
            f"{self.worst_deg:.2f}° | {self.other_size} of {self.sized} | {len(self.failures)} |"
        )


FOLDER_FRAMES, SOUND_FRAMES = 5, 3
"""Number of frames of a folder with each fault, and of a sound one."""
SOUND_SCENES = ("up", "foot", "top", "down", "bottom")
GATE_COLUMNS = "| | folders with the right cause | others | frames with the right cause | others |"
COLUMNS = "| | frames | accepted | outside the 99 % interval | worst | rise off by more than 10 % | exceptions |"


def heading_of(edge_C: Vector3, camera: PinholeCamera) -> float:
    """Return the heading about the declared mount of a chair before edges of a direction."""
    edge_B = camera.R_BC @ edge_C
    return float(np.arctan2(-edge_B[0], -edge_B[1]))


def _measured(known: KnownFrame) -> KnownFrame:
    """Return a recorded frame with the rise that the frame as recorded gives: a frame of another size is judged by it."""
    shape = StairDetector().look(known.frame, known.gravity_C).shape
    return known if shape is None else replace(known, rise_m=shape.rise_m)


def tallies(bases: list[KnownFrame], looks: int, rng: np.random.Generator) -> dict[str, Tally]:
    """Return what becomes of frames seen otherwise, by kind of variation."""
    detector, found = StairDetector(), {kind: Tally() for kind in KINDS}
    for number in range(looks):
        kind = KINDS[number % len(KINDS)]
        known = seen_otherwise(bases[int(rng.integers(len(bases)))], kind, rng)
        known = replace(known, name=f"{kind}: {known.name}")
        try:
            found[kind].add(known, detector.look(known.frame, known.gravity_C))
        except Exception:  # noqa: BLE001 - what the table counts
            found[kind].failures.append(f"{known.name}: " + traceback.format_exc(limit=-1).strip().replace("\n", " "))
    return found


def gate_rows(first: int, folders: int) -> Iterator[str]:
    """Yield the rows of sound folders and of each fault: the causes that the gate gives for folders and for their frames."""
    kinds: tuple[Kind, ...] = ("plain", "smaller", "cropped", "mirrored")
    rng = np.random.default_rng(first)
    recorded = [known for known in recorded_frames() if known.gravity_C is not None]
    seen = [[seen_otherwise(known, kinds[n % len(kinds)], rng)] for n in range(2 * folders) for known in recorded]
    yield _gate_row("sound, recorded", None, [[_evidence(known) for known in folder] for folder in seen])
    many = range(first + folders, first + 11 * folders)
    drawn = (drawn_folder(seed, SOUND_SCENES[seed % len(SOUND_SCENES)], SOUND_FRAMES) for seed in many)
    yield _gate_row("sound, drawn", None, [[_evidence(known) for known in folder] for folder in drawn])
    for scene in ("foot", "up"):
        sound = [drawn_folder(seed, scene, FOLDER_FRAMES) for seed in range(first, first + folders)]
        for fault in FAULTS:
            found = [[_evidence(with_fault(known, fault)) for known in folder] for folder in sound]
            yield _gate_row(f"{fault}, {scene}", FAULTS[fault], found)


def _evidence(known: KnownFrame) -> CalibrationEvidence | None:
    sight = StairDetector().look(known.frame, known.gravity_C)
    return calibration_evidence(sight, known.frame.camera, known.gravity_C)


def _gate_row(label: str, right: Cause | None, folders: list[list[CalibrationEvidence | None]]) -> str:
    """Return the row of a fault; None is the right cause of sound folders."""
    cells = []
    kept = [[one for one in folder if one is not None] for folder in folders]
    for groups in (
        [functools.reduce(operator.add, folder) for folder in kept if folder],
        [one for folder in kept for one in folder],
    ):
        causes = Counter(None if (fault := one.fault) is None else fault.cause for one in groups)
        others = ", ".join(f"{count} {cause or 'not refused'}" for cause, count in causes.items() if cause != right)
        cells += [f"{causes[right]} of {len(groups)}", others or "–"]
    return f"| {label} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = frame_options(__doc__, 80, "drawn frames that are varied")
    parser.add_argument("--looks", type=int, default=4000, help="varied frames")
    parser.add_argument("--folders", type=int, default=0, help="folders of the calibration gate for each fault")
    arguments = parser.parse_args()
    seeds = seeds_of(arguments)
    if arguments.folders:
        markdown(GATE_COLUMNS, gate_rows(seeds.start, arguments.folders), "Calibration gate")
        return
    recorded = [_measured(known) for known in recorded_frames()]
    for label, bases in (("recorded", recorded), ("drawn", [drawn_frame(seed) for seed in seeds])):
        if not bases:
            continue
        found = tallies(bases, arguments.looks // 2, np.random.default_rng(seeds.start))
        markdown(COLUMNS, (tally.row(kind) for kind, tally in found.items()), f"{len(bases)} {label} frames")
        for tally in found.values():
            for line in [*tally.notes, *Counter(tally.failures)]:
                print("-", line)


if __name__ == "__main__":
    main()
