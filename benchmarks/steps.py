"""Steps of turned stairs, kerbs and drops, found and false: ``python benchmarks/steps.py [--only turns] [--frames N] [--seed S]``.

turns     Stairs that turn, seen with three, two and one straight nosings in view before the turn, and at it: frames accepted as a
          straight flight, edges claimed that are not there, turns named, and turned edges measured.
winding   Winding stairs by radius: accepted as straight, edges that are not there, winding named.
kerbs     Kerbs and drops by size, at 1.0 to 1.9 m: found, and their errors.
rooms     Drawn rooms, and recorded frames without a stair: what is reported though it is not there.
intervals Straight flights by sensor and angle: squared errors relative to the declared variance, and shares inside the interval.

Frames come from ``turned_stairs``. Recorded frames: the folder in ``--recorded``, or in ``TREADLINE_STAIRLESS``, holds the files of
``stairless_frames.toml``. The detector is asked in ``claims_of`` alone.
"""

import math
import os
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scenes.scores import percent
from tables import frame_options, markdown, seeds_of
from turned_stairs import STAIRS, StepFrame, TrueStep, draw_frame

from treadline.core.angles import DEG
from treadline.core.camera_images import PinholeCamera, RgbdFrame, black
from treadline.core.rotations import Vector3
from treadline.perception import DetectorConfig, StairDetector
from treadline.perception.free_ground import SWEPT_HALF_M, ground_ahead
from treadline.perception.steps import SeenStep

SENSORS = ("stereo", "kinect1", "tof")
IMAGES = ((640, 480), (320, 240), (640, 480))
"""Sizes of images, which alternate with the seeds as the sensors do."""
AT_M, ALIKE_RAD = 0.08, 10.0 * DEG
"""Largest distance and angle between a claimed edge and the true one that it is."""
VISIBLE = 0.4
"""Least visible share of an edge that a detector can be expected to measure."""
WITHIN_95 = 1.96
"""Half width of a 95 % interval of a normal distribution, in standard deviations."""
KERBS_M = (0.04, 0.06, 0.08, 0.10, 0.14, 0.20)
DROPS_M = (0.08, 0.10, 0.15, 0.20, 0.30, 0.60)
RADII_M = (1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimedEdge:
    """Edge that a detector reports, in plan axes of the levelled chair from mid-track."""

    at_m: tuple[float, float]
    """A point of it: right, ahead."""
    direction_rad: float | None
    """Direction of the way across it, positive to the left."""
    rise_m: float | None
    sigma_rad: float = math.inf
    """Standard deviation of the direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Claims:
    """What a detector says of a frame."""

    is_flight: bool
    """Whether a straight flight is accepted."""
    edges: tuple[ClaimedEdge, ...] = ()
    """Edges of the flight or the kerb."""
    drop: ClaimedEdge | None = None
    end_known: bool = False
    """Whether the last edge of the flight is known to be the last."""
    names_turn: bool = False
    measured: tuple[float, float, float, float] | None = None
    """Heading [rad] and rise [m] of the flight, each with its standard deviation."""
    spent_ms: float = 0.0


def claims_of(frame: RgbdFrame, gravity_C: Vector3, swept_half_m: float | None) -> Claims:
    """Return what the detector, and with a swept width the search for the end of the ground, say of a frame."""
    started = time.process_time()
    sight = StairDetector(DetectorConfig(swept_half_m=swept_half_m)).look(frame, gravity_C)
    stair = sight.stair_map if sight.accepted else None
    ground = None if swept_half_m is None else ground_ahead(frame, gravity_C, swept_half_m).free
    spent_ms = 1e3 * (time.process_time() - started)
    drop = None
    if ground is not None and ground.end_m is not None:
        turn_rad = ground.direction_rad or 0.0
        middle_m = ground.end_m + SWEPT_HALF_M * abs(math.tan(turn_rad))
        drop = ClaimedEdge(
            at_m=(0.0, middle_m), direction_rad=ground.direction_rad, rise_m=None if ground.drop_m is None else -ground.drop_m
        )
    edges = tuple(_claimed(step) for step in sight.steps)
    is_named = sight.turn is not None or any(word in (sight.reason or "") for word in ("wind", "not straight"))
    said = Claims(is_flight=False, edges=edges, drop=drop, names_turn=is_named, spent_ms=spent_ms)
    if stair is None or sight.heading_rad is None or sight.sigma_rad is None or sight.shape is None:
        return said
    shape = sight.shape
    measured = (sight.heading_rad, sight.sigma_rad, shape.rise_m, shape.rise_sigma_m)
    ends = stair.ends or stair.turn_rad is not None
    return replace(said, is_flight=math.isfinite(shape.run_sigma_m), end_known=ends, measured=measured)


def _claimed(step: SeenStep) -> ClaimedEdge:
    ahead_m, left_m = np.mean(step.edge_m, axis=0).tolist()
    return ClaimedEdge(at_m=(-left_m, ahead_m), direction_rad=step.direction_rad, sigma_rad=step.sigma_rad, rise_m=step.rise_m)


def matches(claim: ClaimedEdge, true: TrueStep, view: StepFrame) -> bool:
    """Return whether a claimed edge is a true one: near its line, between its ends or 0.5 m next to them, and turned alike."""
    left, right = true.edge + view.camera_at[:2]
    along = (right - left) / np.linalg.norm(right - left)
    offset = np.array(claim.at_m) - left
    along_m, across = float(offset @ along), float(offset[0] * along[1] - offset[1] * along[0])
    turned = 0.0 if claim.direction_rad is None else abs(claim.direction_rad - true.direction_rad)
    return abs(across) < AT_M and -0.5 < along_m < float(np.linalg.norm(right - left)) + 0.5 and turned < ALIKE_RAD


def views(name: str, seeds: range, **options: Any) -> Iterator[StepFrame]:
    """Yield frames of a scene whose sensor and size alternate, unless given."""
    for seed in seeds:
        drawn: dict[str, Any] = {"sensor": SENSORS[seed % 3], "image": IMAGES[seed // 3 % 3]} | options
        yield draw_frame(seed, name, **drawn)


TURN_COLUMNS = (
    "| | frames | accepted as straight | with an edge that is not there | end not known | turn named | turned edges measured "
    "| error, median and 90 % | within 1° | in 95 % | ms (median) |"
)


def turn_row(label: str, frames: Iterator[StepFrame]) -> str:
    """Return what is made of stairs that turn."""
    counts, spent, turned, errors = np.zeros(5, int), [], 0, list[tuple[float, float]]()
    for view in frames:
        said = claims_of(view.frame, view.gravity_C, None)
        spent.append(said.spent_ms)
        is_false = any(not any(matches(edge, true, view) for true in view.steps) for edge in said.edges)
        flight = said.is_flight
        counts += [1, flight, flight and is_false, flight and not said.end_known, said.names_turn]
        for true in view.steps:
            if true.visible > VISIBLE and abs(true.direction_rad - view.steps[0].direction_rad) > ALIKE_RAD:
                turned += 1
                found = [edge for edge in said.edges if edge.direction_rad is not None and matches(edge, true, view)]
                off_rad = found[0].direction_rad - true.direction_rad if found and found[0].direction_rad is not None else 0.0
                errors += [(abs(off_rad) / DEG, abs(off_rad) / found[0].sigma_rad)] if found else []
    count, straight, false, endless, named = counts.tolist()
    off_deg, sigmas = np.array(errors).reshape(-1, 2).T
    size = f"{np.median(off_deg):.2f}°, {np.quantile(off_deg, 0.9):.2f}°" if errors else ""
    shares = (
        f"{percent(int(np.sum(off_deg <= 1.0)), len(errors))} | {percent(int(np.sum(sigmas < 1.96)), len(errors))}"
        if errors
        else " | "
    )
    cells = (percent(straight, count), percent(false, count), f"{endless} of {straight}", percent(named, count))
    return f"| {label} | {count} | {' | '.join(cells)} | {len(errors)} of {turned} | {size} | {shares} | {np.median(spent):.1f} |"


def turn_rows(seeds: range) -> Iterator[str]:
    """Yield a row for each kind of turn and view; a straight flight first."""
    for name in STAIRS:
        for before in (3, 2, 1, 0):
            yield turn_row(f"{name}, {before} before" if before else f"{name}, at it", views(name, seeds, before=before))


def winding_rows(seeds: range) -> Iterator[str]:
    """Yield a row for each radius."""
    for radius in RADII_M:
        yield turn_row(f"{radius:g} m", views(f"winding {radius:g}", seeds))


KERB_COLUMNS = "| | frames | found | at the right place | place RMSE | direction RMSE | size RMSE (n) | taken for a flight |"


def kerb_rows(seeds: range) -> Iterator[str]:
    """Yield a row for each size of a kerb and of a drop."""
    for name, sizes_m in (("kerb", KERBS_M), ("drop", DROPS_M)):
        for size_m in sizes_m:
            yield f"| {name} of {100.0 * size_m:.0f} cm | {kerb_cells(name, list(views(name, seeds, size_m=size_m)))} |"


def kerb_cells(name: str, frames: list[StepFrame]) -> str:
    """Return the cells of ``KERB_COLUMNS`` after the label."""
    flights, places, turns, sizes = 0, list[float](), list[float](), list[float]()
    for view in frames:
        said = claims_of(view.frame, view.gravity_C, SWEPT_HALF_M)
        flights += said.is_flight
        edge = said.drop if name == "drop" else next(iter(() if said.is_flight else said.edges), None)
        if edge is None:
            continue
        true = view.steps[0]
        left, right = true.edge + view.camera_at[:2]
        place_m = np.interp(edge.at_m[0], (left[0], right[0]), (left[1], right[1]))
        places.append(edge.at_m[1] - place_m)
        turns += [] if edge.direction_rad is None else [edge.direction_rad - true.direction_rad]
        sizes += [] if edge.rise_m is None else [edge.rise_m - true.rise_m]
    right_count = int(np.sum(np.abs(places) < AT_M))
    figures = (f"{1e3 * rms(places):.0f} mm", f"{rms(turns) / DEG:.2f}°", f"{1e3 * rms(sizes):.0f} mm ({len(sizes)})")
    shares = (percent(len(places), len(frames)), percent(right_count, len(frames)))
    return f"{len(frames)} | {' | '.join((*shares, *figures))} | {flights}"


def rms(values: list[float]) -> float:
    """Return the root of the mean square, NaN of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else math.nan


ROOM_COLUMNS = "| | frames | flights of any width | as wide as the chair | kerbs | drops | ms (median) |"


def room_rows(seeds: range, folder: Path | None) -> Iterator[str]:
    """Yield what is reported of drawn rooms, ten for each seed, and of recorded frames."""
    rooms = range(seeds.start, seeds.start + 25 * len(seeds))
    yield room_row(f"drawn rooms, {len(rooms)}", ((view.frame, view.gravity_C) for view in views("room", rooms)))
    if folder is None or not folder.is_dir():
        yield "| recorded frames: no folder, give --recorded | | | | | | |"
        return
    sources = tomllib.loads(Path(__file__).with_name("stairless_frames.toml").read_text(encoding="utf-8"))
    files = [folder / f"{name}.npz" for source in sources.values() for name in source["frames"]]
    missing = sum(not file.exists() for file in files)
    yield room_row(f"recorded frames, {missing} missing", (recorded(file) for file in files if file.exists()))


def recorded(file: Path) -> tuple[RgbdFrame, Vector3]:
    """Return a recorded frame and gravity, mounted so that the chair stands on the lowest that is in view: no drop can be."""
    data = np.load(file)
    depth_m, down = data["depth_m"].astype(np.float32), data["gravity_C"]
    rows, columns = depth_m.shape
    optics = dict(zip(("fx_px", "fy_px", "cx_px", "cy_px"), data["K"].tolist(), strict=True))
    camera = PinholeCamera(width_px=columns, height_px=rows, **optics)
    v, u = np.nonzero(depth_m)
    lowest_m = float(np.quantile(camera.pixel_to_point(u, v, depth_m[v, u]) @ down, 0.98))
    mount = {"mount_pitch_rad": math.asin(down[2]), "mount_roll_rad": math.atan2(down[0], down[1]), "mount_m": (0.0, 0.0, lowest_m)}
    depth_m[depth_m == 0.0] = np.nan
    return RgbdFrame(t_s=0.0, rgb=black(rows, columns), depth_m=depth_m, camera=replace(camera, **mount)), down


def room_row(label: str, frames: Iterator[tuple[RgbdFrame, Vector3]]) -> str:
    """Return how often something is reported of frames without a stair, a kerb or a drop."""
    counts, spent = np.zeros(4, int), []
    for frame, gravity_C in frames:
        said = claims_of(frame, gravity_C, SWEPT_HALF_M)
        is_kerb = bool(said.edges) and not said.is_flight
        counts += [claims_of(frame, gravity_C, None).is_flight, said.is_flight, is_kerb, said.drop is not None]
        spent.append(said.spent_ms)
    return f"| {label} | {len(spent)} | {' | '.join(map(str, counts))} | {np.median(spent):.1f} |"


INTERVAL_COLUMNS = (
    "| | frames | accepted | heading RMSE | squared error over variance | in 95 % | rise RMSE | squared error over variance "
    "| in 95 % | ms (median) |"
)
INTERVALS: dict[str, tuple[str, tuple[int, int], float | None]] = {
    "stereo, 640×480": ("stereo", (640, 480), None),
    "stereo, 848×480": ("stereo", (848, 480), None),
    "stereo, 320×240": ("stereo", (320, 240), None),
    "stereo, 30° aside": ("stereo", (848, 480), 30.0),
    "stereo, 42° aside": ("stereo", (848, 480), 42.0),
    "Kinect 1, 640×480": ("kinect1", (640, 480), None),
    "Kinect 1, 320×240": ("kinect1", (320, 240), None),
    "Kinect 1, 30° aside": ("kinect1", (640, 480), 30.0),
    "time of flight": ("tof", (640, 480), None),
    "without an error": ("exact", (640, 480), None),
}
"""Rows of the table of intervals: sensor, image, and angle aside, to the left and the right in turn."""


def interval_rows(seeds: range) -> Iterator[str]:
    """Yield a row for each sensor, half of its frames from the floor and half on the flight."""
    for label, (sensor, image, aside_deg) in INTERVALS.items():
        frames = []
        for seed in seeds:
            heading_deg = None if aside_deg is None else math.copysign(aside_deg, 0.5 - seed % 2)
            before = None if seed // 2 % 2 else 4
            frames.append(draw_frame(seed, "straight", before=before, heading_deg=heading_deg, sensor=sensor, image=image))
        yield f"| {label} | {interval_cells(frames)} |"


def interval_cells(frames: list[StepFrame]) -> str:
    """Return the cells of ``INTERVAL_COLUMNS`` after the label."""
    pairs, spent = list[list[float]](), []
    for view in frames:
        said = claims_of(view.frame, view.gravity_C, None)
        spent.append(said.spent_ms)
        if said.measured is not None:
            heading_rad, heading_sigma, rise_m, rise_sigma = said.measured
            true_m = np.average([true.rise_m for true in view.steps], weights=[true.visible for true in view.steps])
            pairs.append([heading_rad - view.heading_to(view.steps[0]), heading_sigma, rise_m - true_m, rise_sigma])
    figures = [""] * 6
    if pairs:
        errors, sigmas = np.array(pairs)[:, ::2], np.array(pairs)[:, 1::2]
        squares, inside = np.mean((errors / sigmas) ** 2, axis=0), np.sum(np.abs(errors / sigmas) < WITHIN_95, axis=0)
        sizes = np.sqrt(np.mean(errors**2, axis=0))
        texts = f"{sizes[0] / DEG:.3f}°", f"{1e3 * sizes[1]:.1f} mm"
        figures = [cell for k in (0, 1) for cell in (texts[k], f"{squares[k]:.2f}", percent(int(inside[k]), len(pairs)))]
    return f"{len(frames)} | {percent(len(pairs), len(frames))} | {' | '.join(figures)} | {np.median(spent):.1f}"


def main() -> None:
    """Print the tables and the time of each row."""
    parser = frame_options(__doc__, 40, "per row; 25 times as many rooms")
    parser.add_argument("--only", choices=("turns", "winding", "kerbs", "rooms", "intervals"), action="append", help="this table")
    parser.add_argument("--recorded", type=Path, default=os.environ.get("TREADLINE_STAIRLESS"), help="folder of recorded frames")
    arguments = parser.parse_args()
    seeds, folder = seeds_of(arguments), arguments.recorded and Path(arguments.recorded)
    tables = {
        "turns": ("Stairs that turn", TURN_COLUMNS, turn_rows),
        "winding": ("Winding stairs by radius", TURN_COLUMNS, winding_rows),
        "kerbs": ("Kerbs and drops", KERB_COLUMNS, kerb_rows),
        "rooms": ("Places without a stair", ROOM_COLUMNS, partial(room_rows, folder=folder)),
        "intervals": ("Declared intervals", INTERVAL_COLUMNS, interval_rows),
    }
    for name in arguments.only or tables:
        title, columns, rows = tables[name]
        started = time.monotonic()
        markdown(columns, rows(seeds), title)
        print(f"\n{time.monotonic() - started:.0f} s")


if __name__ == "__main__":
    main()
