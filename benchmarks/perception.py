"""Accuracy of the stair perception: ``python benchmarks/perception.py [--only heading] [--frames N] [--seed S]``.

Every call draws new seeds, which no tuning has used, and prints them, so that a run can be repeated. Eight tables:

heading    error of the heading by place, clutter, warp and calibration error
sensors    the same by depth sensor, noise, image size and distance
conditions the same by kinds of stair, motion and mount that break an assumption
pixels     the same with pixels missing at random or in blotches, holes filled by the driver, and mixed depths at edges
geometry   error of slope, rise and run
stairless  number of scenes without a stair in which a stair is detected (target: none)
paper      Algorithm 1 as printed, and again with 90° taken off: with it Eq. (2) is an arcsine
real       recorded frames with a reference, if available

Turned stairs, kerbs and drops are in ``steps.py``. Frames with less than 15 % stair do not count. Fractions have 95 % intervals
(Wilson). Times are CPU time of one core.
"""

import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from perception_cases import LIFELIKE, Case, condition_cases, fixed, pixel_cases, sensor_cases
from real_frames import RealFrame, crops_of, mirrored, phases_of, real_frames
from scenes import STAIR_SCENES, STAIRLESS_SCENES, View
from scenes.recipe import STEPPED_SCENES
from scenes.scores import percent
from tables import frame_options, markdown, seeds_of

from treadline.core.angles import DEG
from treadline.perception import DetectorConfig, StairDetection, StairDetector

FIELD: dict[str, object] = {"clutter": ("legs", "mat", "bag", "strips", "shadow", "wet", "rail_left", "rail_right")}
"""Recipe with all kinds of clutter, each of which may be present."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One frame, what was made of it, and how long that took."""

    view: View
    sight: StairDetection
    spent_ms: float


def heading_cases() -> Iterator[Case]:
    """Yield the rows of the heading table."""
    for scene in STAIR_SCENES:
        yield Case(label=f"{scene}, with what real ones add", recipe=LIFELIKE | {"scenes": (scene,)})
    yield Case(label="noise alike over 1.2 px of the sensor", recipe={"grain_px": 1.2})
    for warp_px in (0.05, 0.1):
        yield Case(label=f"depth warped, {warp_px:g} px of disparity", recipe={"grain_px": 1.2, "warp_px": warp_px})
    for name in ("legs", "mat", "bag", "strips", "shadow", "wet"):
        yield Case(label=f"with {name}", recipe={"clutter": (name,)})
    yield Case(label="rails at both sides, no walls", recipe={"clutter": ("rail_left", "rail_right"), "walls": ("none",)})
    yield Case(label="all sorts, each there or not", recipe=FIELD | {"clutter_chance": 0.35, "worn_m": 0.01})
    for yaw_deg in (0.3, 1.0):
        yield Case(label=f"nosings turned, σ {yaw_deg:g}°", recipe={"nosing_yaw_jitter_deg": yaw_deg})
    yield Case(label="gravity not known, facing down", recipe={"scenes": ("down",)}, knows_down=False)
    yield Case(label="focal length σ 2 % off", recipe={"focal_error": 0.02})


def paper_cases() -> Iterator[Case]:
    """Yield the rows of Algorithm 1."""
    for name, taken_off_deg in (("as printed", 0.0), ("less 90°", 90.0)):
        yield Case(label=name, method="paper", taken_off_deg=taken_off_deg)
    for treads in ("grating", "glass", "glass_strips"):
        yield Case(label=f"less 90°, {treads} treads", method="paper", taken_off_deg=90.0, recipe={"treads": treads})
    far = {"sensor": "d455", "scenes": ("foot",), "place_m": fixed(4.0), "pitch_deg": fixed(10.0)}
    label = "less 90°, D455, 4 m before the flight"
    yield Case(label=label, method="paper", taken_off_deg=90.0, recipe=far, least_share=0.01)


def geometry_cases() -> Iterator[Case]:
    """Yield the rows of the geometry table."""
    yield Case(label="up, open risers", recipe={"open_risers": True})
    yield Case(label="up, with what real ones add", recipe=LIFELIKE)
    yield Case(label="down, with what real ones add", recipe=LIFELIKE | {"scenes": ("down",)})
    for sensor in ("d435", "d455", "kinect2", "tof"):
        for is_lifelike in (False, True):
            label = f"up, {sensor}" + (", lifelike" if is_lifelike else "")
            yield Case(label=label, recipe={"sensor": sensor}, is_lifelike=is_lifelike)
    for sensor, furthest in (("kinect1", 4), ("d435", 4), ("d455", 4), ("tof", 3)):
        for distance in range(1, furthest + 1):
            pitch = fixed(25.0 if distance == 1 else 10.0)  # the foot of a flight 1 m away is out of view at 10°
            far = {"sensor": sensor, "scenes": ("foot",), "place_m": fixed(float(distance)), "pitch_deg": pitch, "height_px": 480}
            yield Case(label=f"{sensor}, {distance} m before the flight", recipe=far, least_share=0.01)
            label = f"{sensor}, {distance} m before the flight, lifelike"
            yield Case(label=label, recipe=far, is_lifelike=True, least_share=0.01)


def looks(case: Case, seeds: range) -> Iterator[Look]:
    """Yield what a method makes of the frames of a row."""
    detector = StairDetector(DetectorConfig(method=case.method))
    for view in case.views(seeds):
        if case.method == "paper":
            view.frame.rgb  # noqa: B018 - painted before the clock runs
        started = time.process_time()
        sight = detector.look(view.frame, view.gravity_C if case.knows_down else None)
        spent_ms = (time.process_time() - started) * 1e3
        yield Look(view=view, sight=sight, spent_ms=spent_ms)


HEADING_COLUMNS = (
    "| | frames | accepted | of those that show two treads | RMSE | p95 | max | in declared 95 % | mean NEES | ms (median) |"
)
PAIRED_COLUMNS = f"{HEADING_COLUMNS} lifelike: accepted | RMSE | in declared 95 % | mean NEES |"
"""Columns of the tables of sensors and conditions. A declared interval has to hold for real stairs and cameras: an interval that
knows the stair to be regular and the camera to have no warp would be several times too narrow for these."""


def heading_row(case: Case, seeds: range) -> str:
    """Return one row of the heading table."""
    return f"| {case.label} | {' | '.join(heading_cells(case, seeds))} |"


def paired_row(case: Case, seeds: range) -> str:
    """Return one row of the tables of sensors and conditions: perfect stairs and cameras, then lifelike ones."""
    perfect = heading_cells(case, seeds)
    _, accepted, _, error, *_, inside, strain, _ = heading_cells(replace(case, is_lifelike=True), seeds)
    return f"| {case.label} | {' | '.join([*perfect, accepted, error, inside, strain])} |"


def heading_cells(case: Case, seeds: range) -> list[str]:
    """Return the cells of ``HEADING_COLUMNS`` after the label."""
    errors, strains, enough, spent = [], [], [], []
    for look in looks(case, seeds):  # one at a time: who keeps all frames waits for memory, and the clock runs
        spent.append(look.spent_ms)
        # One tread alone is a doorstep's, or the end of a shelf.
        enough += [look.sight.accepted] if look.view.stair is not None and look.view.stair.treads_in_view >= 2 else []
        if look.sight.heading_rad is not None and look.sight.sigma_rad is not None and look.view.stair is not None:
            error = look.sight.heading_rad - case.taken_off_deg * DEG - look.view.stair.heading_rad
            errors.append(error / DEG)
            strains.append(error / look.sight.sigma_rad)
    if not spent:
        return ["0", *8 * [""]]
    spent_ms = f"{np.median(spent):.1f}"
    if not errors:
        return [f"{len(spent)}", percent(0, len(spent)), *6 * [""], spent_ms]
    size, strain = np.abs(errors), np.array(strains)
    return [
        f"{len(spent)}",
        percent(len(errors), len(spent)),
        f"{percent(sum(enough), len(enough))} of {len(enough)}" if enough else "",
        f"{np.sqrt(np.mean(size**2)):.3f}°",
        f"{np.quantile(size, 0.95):.3f}°",
        f"{size.max():.3f}°",
        percent(int(np.count_nonzero(np.abs(strain) < 1.96)), len(errors)),
        f"{np.mean(strain**2):.2f}",
        spent_ms,
    ]


GEOMETRY_COLUMNS = "| | frames | maps | direction right | slope RMSE | rise, run RMSE | squared errors of slope, rise, run |"


def geometry_row(case: Case, seeds: range) -> str:
    """Return one row of the geometry table."""
    seen = list(looks(case, seeds))
    strains = shape_strains(seen)
    pairs = [
        (seen_map, look.view.stair)
        for look in seen
        if look.view.stair is not None and (seen_map := look.sight.stair_map) is not None
    ]
    if not pairs:
        return f"| {case.label} | {len(seen)} | 0 |" + " |" * 4
    names = ("slope_rad", "rise_m", "run_m")
    errors = np.array([[getattr(found, name) - getattr(truth, name) for name in names] for found, truth in pairs])
    slope, rise, run = np.sqrt(np.mean(errors**2, axis=0)) / (DEG, 1e-3, 1e-3)
    right = np.mean([found.direction == truth.direction for found, truth in pairs])
    return (
        f"| {case.label} | {len(seen)} | {100 * len(pairs) / len(seen):.0f} % | {100 * right:.0f} % | {slope:.2f}° | "
        f"{rise:.1f}, {run:.1f} mm | {strains} |"
    )


def shape_strains(seen: list[Look]) -> str:
    """Return the means of the squared errors of slope, rise and run over their declared variances; 1 is consistent."""
    squares = [
        (
            (shape.slope_rad - truth.slope_rad) / shape.slope_sigma_rad,
            (shape.rise_m - truth.rise_m) / shape.rise_sigma_m,
            (shape.run_m - truth.run_m) / shape.run_sigma_m,
        )
        for look in seen
        if (shape := look.sight.shape) is not None and (truth := look.view.stair) is not None
    ]
    return ", ".join(f"{mean:.2f}" for mean in np.mean(np.square(squares), axis=0)) if squares else ""


STAIRLESS_COLUMNS = (
    "| | frames | accepted | without gravity | with the chair ±3° of heading | 95 % interval of all | ms (median) | "
    "seeds of those accepted |"
)


def stairless_rows(seeds: range) -> Iterator[str]:
    """Yield how many frames of each scene without a stair are taken for one, and the sums."""
    totals = {"**stairs by shape**": (0, 0), "**all others**": (0, 0)}
    for scene in STAIRLESS_SCENES:
        recipe = {
            "scenes": (scene,),
            "pitch_deg": (10.0, 50.0),
            "lateral_m": (-0.5, 0.5),
            "textures": ("wood", "carpet", "terrazzo"),
        }
        upright = list(looks(Case(label=scene, recipe=recipe), seeds))
        blind = list(looks(Case(label=scene, recipe=recipe, knows_down=False), seeds))
        at_an_angle = list(looks(Case(label=scene, recipe=recipe | {"rock_deg": 3.0}), seeds))
        groups = (upright, blind, at_an_angle)
        counts, frames = [sum(look.sight.accepted for look in group) for group in groups], sum(map(len, groups))
        # Nothing is left out of these rows, so that looks and seeds run side by side.
        taken = [seed for group in groups for seed, look in zip(seeds, group, strict=True) if look.sight.accepted]
        kind = "**stairs by shape**" if scene in STEPPED_SCENES else "**all others**"
        totals[kind] = (totals[kind][0] + sum(counts), totals[kind][1] + frames)
        yield (
            f"| {scene} | {len(upright)} | {counts[0]} | {counts[1]} | {counts[2]} | {percent(sum(counts), frames)} | "
            f"{np.median([look.spent_ms for look in upright]):.1f} | {', '.join(map(str, sorted(set(taken))[:5]))} |"
        )
    for kind, (hits, frames) in totals.items():
        yield f"| {kind} | {frames} | {hits} | | | {percent(hits, frames, 2)} | | |"


REAL_COLUMNS = "| | accepted | RMSE | worst | declared σ (median) | in the 95 % interval of both | most frequent reason |"


def real_rows(_: range) -> Iterator[str]:
    """Yield the errors of the edge direction in recorded frames, shifted by pixels, halved, cut and mirrored."""
    for real in real_frames():
        mirror = mirrored(real)
        kinds = {
            "": [real],
            ", 24 phases": phases_of(real, 1),
            ", halved, 24 phases": phases_of(real, 2),
            ", cut": crops_of(real),
            ", mirrored, 24 phases": phases_of(mirror, 1),
        }
        for label, frames in kinds.items():
            yield f"| {real.name}{label} | {' | '.join(real_cells(list(frames)))} |"


def real_cells(frames: Sequence[RealFrame]) -> list[str]:
    """Return the cells of ``REAL_COLUMNS`` after the label."""
    errors, inside, sigmas, reasons = [], 0, [], Counter[str]()
    for real in frames:
        sight = StairDetector().look(real.frame, real.gravity_C)
        if not sight.accepted or sight.edge_direction_C is None or sight.sigma_rad is None:
            reasons[sight.reason or ""] += 1
            continue
        errors.append(real.error_deg(sight.edge_direction_C))
        sigmas.append(sight.sigma_rad / DEG)
        inside += errors[-1] < 1.96 * math.hypot(sigmas[-1], real.uncertainty_deg)
    reason = "".join(f"{count} ×: {text}" for text, count in reasons.most_common(1))
    if not errors:
        return [percent(0, len(frames)), "", "", "", "", reason]
    size = np.array(errors)
    counts = (
        percent(len(errors), len(frames)),
        f"{np.sqrt(np.mean(size**2)):.2f}°",
        f"{size.max():.2f}°",
        f"{np.median(sigmas):.2f}°",
    )
    return [*counts, percent(inside, len(errors)), reason]


def by_case(row: Callable[[Case, range], str], cases: Callable[[], Iterator[Case]]) -> Callable[[range], Iterator[str]]:
    """Return the function that yields a row for each case."""
    return lambda seeds: (row(case, seeds) for case in cases())


TABLES: dict[str, tuple[str, str, Callable[[range], Iterator[str]]]] = {
    "heading": ("Heading, robust method", HEADING_COLUMNS, by_case(heading_row, heading_cases)),
    "sensors": ("Heading by sensor", PAIRED_COLUMNS, by_case(paired_row, sensor_cases)),
    "conditions": ("Heading by condition", PAIRED_COLUMNS, by_case(paired_row, condition_cases)),
    "pixels": ("Heading with bad pixels", PAIRED_COLUMNS, by_case(paired_row, pixel_cases)),
    "geometry": ("Geometry", GEOMETRY_COLUMNS, by_case(geometry_row, geometry_cases)),
    "stairless": ("Places without a stair", STAIRLESS_COLUMNS, stairless_rows),
    "paper": ("Heading, Algorithm 1", HEADING_COLUMNS, by_case(heading_row, paper_cases)),
    "real": ("Recorded frames, with gravity where it is known", REAL_COLUMNS, real_rows),
}
"""Title, columns and rows of each table."""


def main() -> None:
    """Print the tables."""
    parser = frame_options(__doc__, 60, "per row")
    parser.add_argument("--only", choices=TABLES, action="append", help="this table; may be given again")
    arguments = parser.parse_args()
    seeds = seeds_of(arguments)
    print("Kinect 1 noise at 320×240 and gravity 0.5° off unless said")
    for _ in looks(Case(label="loads what is compiled"), range(1)):
        pass
    for name in arguments.only or TABLES:
        title, columns, rows = TABLES[name]
        markdown(columns, rows(seeds), title)


if __name__ == "__main__":
    main()
