"""What each part of the edge fit brings: ``python benchmarks/ablation.py [--frames N] [--seed S]``.

parts    Each part is switched off in turn, on the same surfaces of the same lifelike frames: differences of the number of headings,
         of the RMSE where both ways give one, of the share inside the 95 % interval, and the ratio of the declared deviations.
winding  Probability of a winding flight, on straight, curved and winding flights.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import Any
from unittest import mock

import numpy as np
from perception_cases import ROLLING, Case, condition_cases, fixed, sensor_cases
from scenes import View
from tables import frame_options, markdown, seeds_of

from treadline.core.angles import DEG
from treadline.perception import _edge_fit, _form, _robust_method

Patch = tuple[Any, str, Any]
Answer = tuple[float, float]
"""Error of the heading and its declared standard deviation [rad]; NaN without a heading."""
SWEPT_HALF_M = 0.3
"""Half width of a flight that is wide enough [m]."""
OTHERS = (
    Case(label="D435 from 30 to 42° aside", recipe={"sensor": "d435", "heading_deg": (30.0, 42.0)}),
    Case(label="D455 from 30 to 42° aside, down", recipe={"sensor": "d455", "heading_deg": (30.0, 42.0), "scenes": ("down",)}),
    Case(label="D435, rolling shutter", recipe=ROLLING | {"sensor": "d435"}),
)
"""Rows next to those of the tables of sensors and conditions."""
CURVES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("straight, Kinect 1", {}),
    ("straight, D455", {"sensor": "d455"}),
    ("straight, D455 3 m away", {"sensor": "d455", "scenes": ("foot",), "place_m": fixed(3.0), "pitch_deg": fixed(10.0)}),
    *((f"radius {radius:.0f} m", {"radius_m": fixed(radius)}) for radius in (12.0, 6.0, 3.0)),
    ("winders", {"winder_radius_m": (0.55, 0.9), "width_m": (0.8, 1.0)}),
)
"""Flights of the table of winding."""


def grids(sizes: np.ndarray, logs: np.ndarray) -> list[Patch]:
    """Return the patches of other sizes of irregularity, warp and motion."""
    return [(_edge_fit, "SIZES", sizes), (_edge_fit, "LOGS", logs)]


def without(part: int) -> list[Patch]:
    """Return the patches that leave out one of the covariances that normals share."""
    equations = _edge_fit.normal_equations

    def fewer(noise: Any, shared: Any, squares: Any, right: Any) -> Any:
        return equations(noise, shared, squares * (np.arange(squares.shape[1]) != part), right)

    return [(_edge_fit, "normal_equations", fewer)]


def parts() -> Mapping[str, Sequence[Patch]]:
    """Return the patches that switch off each part."""
    sizes, logs = _edge_fit.SIZES, _edge_fit.LOGS
    flat = _form.Bow(curvature_1_m=0.0, sigma_1_m=math.inf, seen_aside_m=0.0)
    return {
        "rotation of steps": without(0),
        "tilt of steps": without(1),
        "warp": without(2),
        "motion": without(3),
        "spread and detour": without(4),
        "as drawn": grids(sizes[:-1], logs[:-1]),
        "winding": [(_edge_fit, "WINDING", 1e-12)],
        "outliers by evidence": [(_edge_fit, "_of_the_stair", lambda rows: np.ones(len(rows.value), dtype=bool))],
        "bow": [(_robust_method, "bow_of", lambda *_: flat)],
    }


def answers(view: View, gravity_C: Any, variants: Mapping[str, Sequence[Patch]]) -> dict[str, Answer]:
    """Return the answer with each variant; blocks, surfaces and lattice are those of the first."""
    known: dict[Any, Any] = {}
    found: dict[str, Answer] = {}
    with ExitStack() as stack:
        for name in ("surface_blocks", "uncertain_blocks", "scene_of", "flight_in"):
            stack.enter_context(mock.patch.object(_robust_method, name, remembered(getattr(_robust_method, name), known)))
        for label, patches in variants.items():
            with ExitStack() as patched:
                for patch in patches:
                    patched.enter_context(mock.patch.object(*patch))
                sight = _robust_method.detect_stair(view.frame, gravity_C, SWEPT_HALF_M)
            has = sight.heading_rad is not None and sight.sigma_rad is not None and view.stair is not None
            found[label] = (sight.heading_rad - view.stair.heading_rad, sight.sigma_rad) if has else (math.nan, math.nan)
    return found


def remembered(function: Callable[..., Any], known: dict[Any, Any]) -> Callable[..., Any]:
    """Return a function that keeps its results, for arguments that stay alive."""

    def kept(*arguments: Any, **options: Any) -> Any:
        key = (function, *(part.tobytes() if isinstance(part, np.ndarray) else id(part) for part in arguments), str(options))
        if key not in known:
            known[key] = function(*arguments, **options), arguments
        return known[key][0]

    return kept


def difference(base: Sequence[Answer], other: Sequence[Answer]) -> str:
    """Return the cells of one part."""
    a, b = np.array(base), np.array(other)
    both = np.isfinite(a[:, 0]) & np.isfinite(b[:, 0])
    rmse = [math.sqrt(float(np.mean(c[both, 0] ** 2))) / DEG for c in (a, b)]
    inside = [100.0 * float(np.mean(np.abs(c[both, 0] / c[both, 1]) < 1.96)) for c in (a, b)]
    count = int(np.isfinite(b[:, 0]).sum() - np.isfinite(a[:, 0]).sum())
    ratio = float(np.median(b[both, 1] / a[both, 1]))
    return f"{count:+d} | {rmse[1] - rmse[0]:+.3f}° | {inside[1] - inside[0]:+.1f} % | {ratio:.2f}"


def print_parts(seeds: range) -> None:
    """Print the table of parts."""
    variants: dict[str, Sequence[Patch]] = {"all": (), **parts()}
    found: dict[str, list[Answer]] = {label: [] for label in variants}
    for case in (*sensor_cases(), *condition_cases(), *OTHERS):
        lifelike = Case(label=case.label, recipe=case.recipe, least_share=case.least_share, is_lifelike=True)
        for view in lifelike.views(seeds):
            for label, answer in answers(view, view.gravity_C if case.knows_down else None, variants).items():
                found[label].append(answer)
    count = int(np.isfinite(np.array(found["all"])[:, 0]).sum())
    print(f"\n{count} headings in {len(found['all'])} frames.")
    lines = (f"| {label} | {difference(found['all'], found[label])} |" for label in list(variants)[1:])
    markdown("| without | headings | RMSE | inside | σ |", lines)


def recorded(function: Callable[..., Any], results: list[Any]) -> Callable[..., Any]:
    """Return a function that appends its results to a list."""

    def appending(*arguments: Any, **options: Any) -> Any:
        results.append(function(*arguments, **options))
        return results[-1]

    return appending


def winding_rows(seeds: range) -> Iterator[str]:
    """Yield the rows of the table of winding."""
    for label, recipe in CURVES:
        fits: list[_edge_fit.EdgeFit] = []
        headings = 0
        with mock.patch.object(_robust_method, "fit_edges", recorded(_edge_fit.fit_edges, fits)):
            for view in Case(label=label, recipe=recipe, least_share=0.01, is_lifelike=True).views(seeds):
                headings += _robust_method.detect_stair(view.frame, view.gravity_C, SWEPT_HALF_M).heading_rad is not None
        shares = [fit.winding for fit in fits]
        counts = np.histogram(shares, [0.0, 0.05, 0.5, 0.95, 1.001])[0]
        yield f"| {label} | {len(shares)} | {' | '.join(str(count) for count in counts)} | {headings} |"


def main() -> None:
    """Print both tables."""
    parser = frame_options(__doc__, 12, "per row")
    parser.add_argument("--only", choices=("parts", "winding"), help="this table")
    arguments = parser.parse_args()
    seeds = seeds_of(arguments)
    if arguments.only != "winding":
        print_parts(seeds)
    if arguments.only != "parts":
        markdown("| | fits | below 5 % | 5 to 50 % | 50 to 95 % | above 95 % | headings |", winding_rows(seeds))


if __name__ == "__main__":
    main()
