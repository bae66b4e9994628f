"""Accuracy of the stair perception: ``python benchmarks/perception.py [--quick] [--only heading] [--frames N] [--seed S]``.

Every call draws new seeds, which no tuning has used, and prints them, so that a run can be repeated. Eleven tables:

heading    error of the heading by slope, heading, light, sensor, place, clutter and calibration error
sensors    the same by depth sensor, noise, image size and distance
conditions the same by kinds of stair, motion and mount that break an assumption, with the sides of the flight
pixels     the same with pixels missing at random or in blotches, holes filled by the driver, and mixed depths at edges
geometry   error of slope, rise, run, nosings, walls and the flight's end
axes       error of the stair's axes in the camera frame, the input of the mount calibration
drives     heading by vision and fused with a gyro, and the mount's calibration, over a minute on a flight
ground     edges of landings, docks and kerbs ahead, and drops reported where there are none
stairless  number of scenes without a stair in which a stair is detected (target: none)
paper      Algorithm 1 as printed, and again with 90° taken off: with it Eq. (2) is an arcsine
real       recorded frames with a reference, if available

Frames with less than 15 % stair do not count. Fractions have 95 % intervals (Wilson). Times are CPU time of one core.
"""

import argparse
import math
import secrets
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from ground import FLOOR_COLUMNS, GROUND_COLUMNS, edge_rows, floor_rows
from perception_cases import LIFELIKE, Case, condition_cases, fixed, percent, pixel_cases, sensor_cases
from real_frames import RECORDED, RealFrame, crops_of, mirrored, phases_of, real_frames
from scenes import STAIRLESS_SCENES, RecordedDrive, StairTruth, View, ViewRecipe, draw_view
from scenes.recipe import STEPPED_SCENES
from scenes.scores import wilson

from treadline.core.angles import DEG
from treadline.core.rotations import Vector3, rotation_of
from treadline.core.signals import StairMap
from treadline.estimation import HeadingFilter, MountCalibrator, MountConfig
from treadline.perception import DetectorConfig, StairDetection, StairDetector
from treadline.plant.sensors.imu import IMUS, Imu

TABLES = ("heading", "sensors", "conditions", "pixels", "geometry", "axes", "drives", "ground", "stairless", "paper", "real")
GRAVITY_ERROR_RAD = 0.5 * DEG
"""Angle of the IMU's error of the gravity direction on a drive [rad], in a random direction."""
NEXT_NOSING_M = 1.4
"""Largest distance along the chair's x axis at which the nearest nosing found counts as the next nosing [m]."""
SEEN_M = 2.5
"""Distance along x [m] up to which nosings and flight ends count as missed if they are not reported."""
SAME_NOSING_M = 0.08
"""Largest distance between a nosing found and its true nosing [m]: half of the smallest step. Others count as false."""
FIELD: dict[str, object] = {"clutter": ("legs", "mat", "bag", "strips", "shadow", "wet", "rail_left", "rail_right")}
"""Recipe with all kinds of clutter, each of which may be present."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """One frame, what was made of it, and how long that took."""

    view: View
    sight: StairDetection
    spent_ms: float
    stages_ms: dict[str, float]


def heading_cases() -> Iterator[Case]:
    """Yield the rows of the heading table."""
    yield Case(label="**all of |ψ| ≤ 35°, 25–35°**")
    yield Case(label="**the same with what real ones add**", recipe=LIFELIKE)
    for scene in ("top", "foot", "down", "edge", "bottom"):
        yield Case(label=f"{scene}, with what real ones add", recipe=LIFELIKE | {"scenes": (scene,)})
    for slope in (25.0, 28.0, 30.0, 35.0):
        yield Case(label=f"slope {slope:.0f}°", recipe={"slope_deg": fixed(slope)})
    for low, high in ((0.0, 5.0), (5.0, 15.0), (15.0, 25.0), (25.0, 35.0)):
        yield Case(label=f"heading {low:.0f} to {high:.0f}°", recipe={"heading_deg": (low, high)})
    for light in (0.35, 1.0, 1.6):
        yield Case(label=f"light {light:g}", recipe={"light": fixed(light)})
    for texture in ("dark", "terrazzo"):
        yield Case(label=f"texture {texture}", recipe={"textures": (texture,)})
    yield Case(label="no noise, 320×240", recipe={"sensor": "ideal"})
    yield Case(label="noise alike over 1.2 px of the sensor", recipe={"grain_px": 1.2})
    yield Case(label="depth warped, 0.05 px of disparity", recipe={"grain_px": 1.2, "warp_px": 0.05})
    yield Case(label="depth warped, 0.1 px: not calibrated", recipe={"grain_px": 1.2, "warp_px": 0.1})
    yield Case(label="Kinect 1, 640×480", recipe={"height_px": 480})
    yield Case(label="Kinect 2, 512×424", recipe={"sensor": "kinect2"})
    for scene, where in (
        ("top", "near the top, facing up"),
        ("foot", "on the floor before the flight"),
        ("down", "on the flight, facing down"),
        ("edge", "on the landing before the edge"),
        ("bottom", "near the foot, facing down"),
    ):
        yield Case(label=f"{scene}: {where}", recipe={"scenes": (scene,)})
    yield Case(label="down, 640×480", recipe={"scenes": ("down",), "height_px": 480})
    yield Case(label="open risers", recipe={"open_risers": True})
    yield Case(label="open risers, facing down", recipe={"open_risers": True, "scenes": ("down",)})
    for name in ("rail_left", "legs", "mat", "bag", "strips", "shadow", "wet"):
        yield Case(label=f"with {name.replace('_', ' ')}", recipe={"clutter": (name,)})
    yield Case(label="rails at both sides, no walls", recipe={"clutter": ("rail_left", "rail_right"), "walls": ("none",)})
    yield Case(label="all sorts, each there or not", recipe=FIELD | {"clutter_chance": 0.35, "worn_m": 0.01})
    yield Case(label="nosings worn, up to 10 mm", recipe={"worn_m": 0.010})
    yield Case(label="nosings worn, up to 25 mm", recipe={"worn_m": 0.025})
    yield Case(label="nosings turned, σ 0.3°", recipe={"nosing_yaw_jitter_deg": 0.3})
    yield Case(label="nosings turned, σ 1°", recipe={"nosing_yaw_jitter_deg": 1.0})
    yield Case(label="rise and run uneven, σ 5 mm", recipe={"rise_jitter_m": 0.005, "run_jitter_m": 0.005})
    yield Case(label="treads tilted, σ 0.5°", recipe={"tread_tilt_deg": 0.5})
    yield Case(label="a third of the depth lost", recipe={"holes": 0.33})
    yield Case(label="motion blur, 6 to 12 px", recipe={"blur_px": (6.0, 12.0)})
    yield Case(label="chair rocks, σ 2°", recipe={"rock_deg": 2.0})
    yield Case(label="gravity exact", recipe={"gravity_error_deg": 0.0})
    yield Case(label="gravity 1.5° off", recipe={"gravity_error_deg": 1.5})
    yield Case(label="gravity not known", knows_down=False)
    yield Case(label="gravity not known, facing down", recipe={"scenes": ("down",)}, knows_down=False)
    yield Case(label="mount pitched by 1°", recipe={"mount_pitch_error_deg": fixed(1.0)})
    yield Case(label="mount rolled by 1°", recipe={"mount_roll_error_deg": fixed(1.0)})
    yield Case(label="focal length σ 2 % off", recipe={"focal_error": 0.02})


def paper_cases() -> Iterator[Case]:
    """Yield the rows of Algorithm 1."""
    for name, taken_off_deg in (("as printed", 0.0), ("less 90°", 90.0)):
        for slope in (25.0, 28.0, 30.0):
            recipe = {"slope_deg": fixed(slope)}
            yield Case(label=f"{name}, slope {slope:.0f}°", method="paper", taken_off_deg=taken_off_deg, recipe=recipe)
        for heading in (0.0, 10.0, 20.0, 30.0, 35.0):
            recipe = {"heading_deg": fixed(heading)}
            yield Case(label=f"{name}, heading {heading:.0f}°", method="paper", taken_off_deg=taken_off_deg, recipe=recipe)
    for treads in ("grating", "glass", "glass_strips"):
        yield Case(label=f"less 90°, {treads} treads", method="paper", taken_off_deg=90.0, recipe={"treads": treads})
    for distance in (4.0, 5.0):
        far = {"sensor": "d455", "scenes": ("foot",), "place_m": fixed(distance), "pitch_deg": fixed(10.0)}
        label = f"less 90°, D455, {distance:.0f} m before the flight"
        yield Case(label=label, method="paper", taken_off_deg=90.0, recipe=far, least_share=0.01)
    for scene in ("down", "edge"):
        yield Case(label=f"less 90°, {scene}", method="paper", taken_off_deg=90.0, recipe={"scenes": (scene,)})


def geometry_cases() -> Iterator[Case]:
    """Yield the rows of the geometry table."""
    for scene in ("up", "top", "foot", "down", "edge", "bottom"):
        yield Case(label=scene, recipe={"scenes": (scene,)})
    yield Case(label="up, 640×480", recipe={"height_px": 480})
    yield Case(label="up, Kinect 2", recipe={"sensor": "kinect2"})
    yield Case(label="up, open risers", recipe={"open_risers": True})
    yield Case(label="up, worn to 10 mm", recipe={"worn_m": 0.01})
    yield Case(label="up, with what real ones add", recipe=LIFELIKE)
    yield Case(label="down, with what real ones add", recipe=LIFELIKE | {"scenes": ("down",)})
    yield Case(label="up, rail at the left", recipe={"clutter": ("rail_left",), "walls": ("none",)})
    yield Case(label="up, legs", recipe={"clutter": ("legs",), "heading_deg": (-15.0, 15.0)})
    yield Case(label="up, bag", recipe={"clutter": ("bag",), "heading_deg": (-15.0, 15.0)})
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


def axes_cases() -> Iterator[Case]:
    """Yield the rows of the axes' table."""
    for scene in ("up", "top", "foot", "down", "edge", "bottom"):
        yield Case(label=scene, recipe={"scenes": (scene,)})
    yield Case(
        label="up, mount pitched and rolled by 1°", recipe={"mount_pitch_error_deg": (1.0, 1.0), "mount_roll_error_deg": (1.0, 1.0)}
    )
    yield Case(label="up, with what real ones add", recipe=LIFELIKE)
    yield Case(label="down, with what real ones add", recipe=LIFELIKE | {"scenes": ("down",)})


def looks(case: Case, seeds: range) -> Iterator[Look]:
    """Yield what a method makes of the frames of a row."""
    detector = StairDetector(DetectorConfig(method=case.method))
    for seed in seeds:
        view = draw_view(np.random.default_rng(seed), case.recipe_of(seed))
        if view.stair is not None and view.stair.share < case.least_share:
            continue
        if case.method == "paper":
            view.frame.rgb  # noqa: B018 - painted before the clock runs
        started = time.process_time()
        sight = detector.look(view.frame, view.gravity_C if case.knows_down else None)
        spent_ms = (time.process_time() - started) * 1e3
        yield Look(view=view, sight=sight, spent_ms=spent_ms, stages_ms=dict(detector.timings))


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


GEOMETRY_COLUMNS = (
    "| | frames | maps | direction right | slope RMSE | rise, run RMSE | squared errors of slope, rise, run | "
    "next nosing RMSE (n) | nosings in view found | "
    "false nosings | walls RMSE (n), missed | end: seen, missed, false | obstacle: found, missed, false, RMSE |"
)


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
        return f"| {case.label} | {len(seen)} | 0 |" + " |" * 10
    slope = rms([(found.slope_rad - truth.slope_rad) / DEG for found, truth in pairs])
    rise = rms([(found.rise_m - truth.rise_m) * 1e3 for found, truth in pairs])
    run = rms([(found.run_m - truth.run_m) * 1e3 for found, truth in pairs])
    right = np.mean([found.direction == truth.direction for found, truth in pairs])
    following, hit, asked, false, told = nosings(pairs)
    walls, missed = wall_errors(pairs)
    found = f"{100 * hit / max(asked, 1):.0f} % of {asked} | {100 * false / max(told, 1):.1f} %"
    return (
        f"| {case.label} | {len(seen)} | {100 * len(pairs) / len(seen):.0f} % | {100 * right:.0f} % | {slope:.2f}° | "
        f"{rise:.1f}, {run:.1f} mm | {strains} | {rms(following) * 1e3:.1f} mm ({len(following)}) | {found} | "
        f"{rms(walls) * 1e3:.0f} mm ({len(walls)}), {missed} | {ends(pairs)} | {obstacles(pairs)} |"
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


AXES_COLUMNS = "| | frames | edge RMSE, NEES | down RMSE, NEES | normal RMSE, NEES |"


def axes_row(case: Case, seeds: range) -> str:
    """Return errors of the stair's axes in the camera's frame: what the mount is calibrated by."""
    errors: dict[str, list[tuple[float, float]]] = {"edge": [], "down": [], "normal": []}
    seen = [look for look in looks(case, seeds) if look.sight.axes is not None]
    for look in seen:
        found, truth = look.sight.axes, look.view.stair
        assert found is not None  # noqa: S101 - for the type checker
        assert truth is not None  # noqa: S101
        down = look.view.true_gravity_C
        errors["edge"].append((turned(truth.edge_C, found.edge_C, truth.normal_C), found.edge_sigma_rad))
        errors["down"].append((turned(down, found.down_C, truth.edge_C), found.down_sigma_rad))
        errors["normal"].append((turned(truth.normal_C, found.normal_C, truth.edge_C), found.normal_sigma_rad))
    cells = [
        f"{rms([error for error, _ in pairs]) / DEG:.3f}°, {np.mean([(e / s) ** 2 for e, s in pairs]):.2f}" if pairs else ""
        for pairs in errors.values()
    ]
    return f"| {case.label} | {len(seen)} | {' | '.join(cells)} |"


def turned(true: Vector3, found: Vector3, about: Vector3) -> float:
    """Return by how much a direction is turned about an axis."""
    return float(np.arctan2(about @ np.cross(true, found), true @ found))


def rms(values: list[float]) -> float:
    """Return the root of the mean square, 0 of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values else 0.0


def nosings(pairs: list[tuple[StairMap, StairTruth]]) -> tuple[list[float], int, int, int, int]:
    """Return errors of the next nosing and counts of nosings: in view and found, in view, false, reported."""
    following, hit, asked, false, told = [], 0, 0, 0, 0
    for found, truth in pairs:
        if not len(truth.nosings_B):
            continue
        ahead = np.array([place for place in found.nosings_B if place[0] > 0.1]).reshape(
            -1, 3
        )  # the truth knows none behind the chair's middle
        asked_for = truth.nosing_in_view & (truth.nosings_B[:, 0] < SEEN_M)
        gaps = np.linalg.norm(ahead[:, None, ::2] - truth.nosings_B[None, :, ::2], axis=2)
        told += len(gaps)
        false += int((gaps.min(axis=1) > SAME_NOSING_M).sum()) if len(gaps) else 0
        asked += int(asked_for.sum())
        if len(gaps):
            hit += int((gaps.min(axis=0)[asked_for] < SAME_NOSING_M).sum())
            if ahead[0, 0] < NEXT_NOSING_M and gaps[0].min() < SAME_NOSING_M:
                following.append(float(gaps[0].min()))
    return following, hit, asked, false, told


def wall_errors(pairs: list[tuple[StairMap, StairTruth]]) -> tuple[list[float], int]:
    """Return errors of the reported wall distances and the number of missed walls."""
    errors, missed = [], 0
    for found, truth in pairs:
        for told, true in ((found.left_wall_m, truth.left_wall_m), (found.right_wall_m, truth.right_wall_m)):
            if told is not None and true is not None:
                errors.append(told - true)
            missed += told is None and true is not None
    return errors, missed


def ends(pairs: list[tuple[StairMap, StairTruth]]) -> str:
    """Return counts of the flight's end: in view and near, missed among these, and falsely reported."""
    there = [found.ends for found, truth in pairs if truth.end_in_view and truth.nosings_B[-1:, 0].max(initial=0.0) < SEEN_M]
    absent = [found.ends for found, truth in pairs if not truth.end_in_view]
    return f"{len(there)}, {there.count(False)}, {absent.count(True)}"


def obstacles(pairs: list[tuple[StairMap, StairTruth]]) -> str:
    """Return how many obstacles were found, missed and made up, and their error where found."""
    both = [(f.obstacle_m, t.obstacle_m) for f, t in pairs if f.obstacle_m is not None and t.obstacle_m is not None]
    missed = sum(found.obstacle_m is None and truth.obstacle_m is not None for found, truth in pairs)
    false = sum(found.obstacle_m is not None and truth.obstacle_m is None for found, truth in pairs)
    return f"{len(both)}, {missed}, {false}, {rms([told - true for told, true in both]) * 1e3:.0f} mm"


SIDES_COLUMNS = "| | maps | sides reported | error of reported sides RMSE | wall or open right | width RMSE (n), true width |"


def sides_row(case: Case, seeds: range) -> str:
    """Return how well the sides of the flight are reported."""
    pairs = [(look.sight.stair_map, look.view.stair) for look in looks(case, seeds)]
    found = [(seen, truth) for seen, truth in pairs if seen is not None and truth is not None]
    errors, right, widths = [], [], []
    for seen, truth in found:
        both = []
        for side in ("left", "right"):
            edge_m = getattr(seen, f"{side}_edge_m")
            if edge_m is not None:
                both.append(edge_m)
                errors.append(edge_m - getattr(truth, f"{side}_edge_m"))
                right.append(getattr(seen, f"{side}_side") == getattr(truth, f"{side}_side"))
        widths += [(sum(both), truth.width_m)] if len(both) == 2 else []
    width = f"{rms([told - true for told, true in widths]) * 1e3:.0f} mm ({len(widths)})" if widths else ""
    return (
        f"| {case.label} | {len(found)} | {percent(len(errors), 2 * len(found))} | {rms(errors) * 1e3:.0f} mm | "
        f"{percent(sum(right), len(right))} | {width} |"
    )


STAIRLESS_COLUMNS = (
    "| | frames | accepted | without gravity | with the chair ±3° askew | 95 % interval of all | ms (median) | "
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
        askew = list(looks(Case(label=scene, recipe=recipe | {"rock_deg": 3.0}), seeds))
        groups = (upright, blind, askew)
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
        low, high = wilson(hits, frames)
        yield f"| {kind} | {frames} | {hits} | | | {100 * hits / frames:.2f} % [{100 * low:.2f}, {100 * high:.2f}] | | |"


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """One row of the table of drives: 60 s at 0.2 m/s, turning to and fro."""

    label: str
    recipe: dict[str, Any] = field(default_factory=dict)
    blind_s: tuple[float, float] = (0.0, 0.0)
    """Start and end of the interval in which the camera is covered [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Driven:
    """What one drive gave: errors [rad] and, for the mount, its own idea of their size."""

    vision: list[float]
    fused: list[float]
    fused_sigma: list[float]
    mount: list[tuple[float, float]]


def drive_cases() -> Iterator[Way]:
    """Yield the rows of the table of drives."""
    askew = {"mount_pitch_error_deg": (-2.0, 2.0), "mount_roll_error_deg": (-2.0, 2.0)}
    yield Way(label="up")
    yield Way(label="up, with what real ones add", recipe=LIFELIKE)
    yield Way(label="up, with what real ones add, blind from 20 to 50 s", recipe=LIFELIKE, blind_s=(20.0, 50.0))
    yield Way(label="down, with what real ones add", recipe=LIFELIKE | {"scenes": ("down",)})
    yield Way(label="up, mount up to 2° off", recipe=askew)
    yield Way(label="up, mount up to 2° off, with what real ones add", recipe=askew | LIFELIKE)


DRIVE_COLUMNS = (
    "| | drives | vision RMS | fused RMS | fused max | fused NEES | mount pitch, roll RMSE (n) | mount max | mount NEES |"
)


def drive_row(way: Way, seeds: range) -> str:
    """Return what vision, fusion and the mount's calibration make of some drives."""
    driven = [drive(way, seed) for seed in seeds]
    vision = [error for one in driven for error in one.vision]
    fused = np.array([error for one in driven for error in one.fused])
    sigma = np.array([value for one in driven for value in one.fused_sigma])
    mount = np.array([one.mount for one in driven if one.mount])
    told = (
        f"{rms(mount[:, 0, 0].tolist()) / DEG:.3f}, {rms(mount[:, 1, 0].tolist()) / DEG:.3f}° ({len(mount)}) | "
        f"{np.abs(mount[:, :, 0]).max() / DEG:.3f}° | {np.mean((mount[:, :, 0] / mount[:, :, 1]) ** 2):.2f}"
        if len(mount)
        else "(0) | |"
    )
    return (
        f"| {way.label} | {len(driven)} | {rms(vision) / DEG:.3f}° | {rms(fused.tolist()) / DEG:.3f}° | "
        f"{np.abs(fused).max() / DEG:.3f}° | {np.mean((fused / sigma) ** 2):.2f} | {told} |"
    )


def drive(way: Way, seed: int) -> Driven:
    """Return the errors of one drive; the first two seconds do not count."""
    rng = np.random.default_rng(seed)
    recipe = ViewRecipe(**{"scenes": ("up",), "steps": (48, 50), "place_m": (0.3, 0.5), "gravity_error_deg": 0.0} | way.recipe)
    road, imu = RecordedDrive(rng, recipe), Imu(IMUS["mpu6050"], GRAVITY_ERROR_RAD, rng)
    detector, filter_, mount = StairDetector(), HeadingFilter(), None
    swing, phase = rng.uniform(5.0, 20.0) * DEG, rng.uniform(0.0, 6.28)
    result = Driven(vision=[], fused=[], fused_sigma=[], mount=[])
    calibration = None
    for tick in range(6000):
        t_s = 0.01 * tick
        angle = 0.3 * t_s + phase
        heading, rate = swing * math.sin(angle), 0.3 * swing * math.cos(angle)
        pose = road.pose(0.2 * t_s, heading)
        felt = imu.sample(t_s, pose.R_WB, np.array([0.0, 0.0, rate]), np.zeros(3), moving=True)
        estimate = filter_.step(felt)
        calibration = calibration if mount is None else mount.step(felt)
        if tick % 10 == 0 and not way.blind_s[0] <= t_s < way.blind_s[1]:
            view = road.view(t_s, pose)
            camera = view.frame.camera
            seen = detector.step(view.frame, -camera.R_BC.T @ rotation_of(felt.orientation)[2])
            if seen is not None:
                result.vision.append(seen.heading_rad - heading)
                estimate = filter_.step(seen)
            if tick % 50 == 0:  # twice a second is enough, and must be looked at anew: without gravity
                mount = mount or MountCalibrator(MountConfig(camera=camera))
                axes = detector.look(view.frame).axes
                calibration = calibration if axes is None else mount.step(axes)
            true = view.true_camera
        if estimate is not None and t_s > 2.0:
            result.fused.append(estimate.heading_rad - heading)
            result.fused_sigma.append(estimate.sigma_rad)
    if calibration is not None:
        result.mount.append((calibration.pitch_rad - true.mount_pitch_rad, calibration.pitch_sigma_rad))
        result.mount.append((calibration.roll_rad - true.mount_roll_rad, calibration.roll_sigma_rad))
    return result


REAL_COLUMNS = "| | accepted | RMSE | worst | declared σ (median) | in the 95 % interval of both | most frequent reason |"


def real_rows() -> Iterator[str]:
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


def stage_lines(seeds: range) -> Iterator[str]:
    """Yield the median time of each stage, if the detector reports stage times."""
    for label, recipe in (("320×240", {}), ("640×480", {"height_px": 480}), ("320×240, facing down", {"scenes": ("down",)})):
        seen = list(looks(Case(label=label, recipe=recipe), seeds))
        stages = {name: float(np.median([look.stages_ms.get(name, 0.0) for look in seen])) for name in seen[-1].stages_ms}
        if stages:
            yield f"Stages, {label}: " + ", ".join(f"{name} {value:.2f} ms" for name, value in stages.items())


def tables(seeds: range) -> dict[str, Callable[[], None]]:
    """Return what prints each table."""

    def rows(title: str, columns: str, lines: Iterator[str]) -> None:
        print(f"\n### {title}\n\n{columns}\n|{' --- |' * (columns.count('|') - 1)}")
        for line in lines:
            print(line, flush=True)

    def heading() -> None:
        rows("Heading, robust method", HEADING_COLUMNS, (heading_row(case, seeds) for case in heading_cases()))
        for line in stage_lines(seeds[: max(len(seeds) // 3, 5)]):
            print(f"\n{line}")

    def conditions() -> None:
        rows("Heading by condition", PAIRED_COLUMNS, (paired_row(case, seeds) for case in condition_cases()))
        sided = [case for case in condition_cases() if "wide" in case.label or case.label in ("plain", "open risers")]
        rows("Sides of the flight", SIDES_COLUMNS, (sides_row(case, seeds) for case in sided))

    def real() -> None:
        if not RECORDED.exists():
            print(f"\n### Recorded frames\n\nskipped: no folder {RECORDED.relative_to(RECORDED.parents[3])} beside the project")
            return
        rows("Recorded frames, with gravity where it is known", REAL_COLUMNS, real_rows())

    def ground() -> None:
        rows("Edges ahead", GROUND_COLUMNS, edge_rows(seeds))
        rows("Ground without an edge", FLOOR_COLUMNS, floor_rows(seeds))

    return {
        "heading": heading,
        "sensors": lambda: rows("Heading by sensor", PAIRED_COLUMNS, (paired_row(case, seeds) for case in sensor_cases())),
        "conditions": conditions,
        "pixels": lambda: rows("Heading with bad pixels", PAIRED_COLUMNS, (paired_row(case, seeds) for case in pixel_cases())),
        "geometry": lambda: rows("Geometry", GEOMETRY_COLUMNS, (geometry_row(case, seeds) for case in geometry_cases())),
        "axes": lambda: rows("The stair's axes in the camera's frame", AXES_COLUMNS, (axes_row(c, seeds) for c in axes_cases())),
        "drives": lambda: rows(
            "Drives of a minute, 10 Hz of frames and 100 Hz of IMU",
            DRIVE_COLUMNS,
            (drive_row(way, seeds[: max(len(seeds) // 15, 1)]) for way in drive_cases()),
        ),
        "ground": ground,
        "stairless": lambda: rows("Places without a stair", STAIRLESS_COLUMNS, stairless_rows(seeds)),
        "paper": lambda: rows("Heading, Algorithm 1", HEADING_COLUMNS, (heading_row(case, seeds) for case in paper_cases())),
        "real": real,
    }


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=None, help="per row; 60, or 12 with --quick")
    parser.add_argument("--seed", type=int, default=None, help="first seed; drawn if not given")
    parser.add_argument("--quick", action="store_true", help="a few frames per row: to see that all runs")
    parser.add_argument("--only", choices=TABLES, action="append", help="this table; may be given again")
    arguments = parser.parse_args()
    frames = arguments.frames or (12 if arguments.quick else 60)
    first = secrets.randbelow(2**31) if arguments.seed is None else arguments.seed
    seeds = range(first, first + frames)
    only = "".join(f" --only {name}" for name in arguments.only or ())
    print(f"Kinect 1 noise at 320×240 and gravity 0.5° off unless said; seeds {seeds.start} to {seeds.stop - 1}:")
    print(f"repeat with --seed {first} --frames {frames}{only}")
    for _ in looks(Case(label="loads what is compiled"), range(1)):
        pass
    for name, show in tables(seeds).items():
        if not arguments.only or name in arguments.only:
            show()


if __name__ == "__main__":
    main()
