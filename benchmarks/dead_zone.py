"""Steering on a flight by Coulomb friction alone: ``python benchmarks/dead_zone.py [slope_deg [along across]]``."""

import math
import sys
from functools import partial

import numpy as np
from tables import table

from treadline.core.angles import DEG
from treadline.core.paper import FRICTION
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Stair
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import Stance, SteadyMotion, stair_stance, steady_motion

CHAIR = read_chair("wheelchair")
CENTRE = partial(centre_of_mass, CHAIR, Chair())
SLOW_M_S = 0.1
HEADINGS_DEG = (0.0, 5.0, 10.0, 15.0, 30.0)
DIFFERENCES_M_S = (-1.0, -0.6, -0.4, -0.2, -0.1, -0.05, -0.02, 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 1.0)
FRICTIONS = (FRICTION, (0.7, 0.5), (0.8, 0.5), (0.9, 0.5), (0.62, 0.3))


def turning_share(motion: SteadyMotion, least_rad_s: float) -> float:
    """Return the fraction of the nosing phases with a yaw rate above a limit."""
    return float((np.abs(motion.yaw_rad_s) > least_rad_s).mean())


def yaw_rate_deg_s(stance: Stance, friction: tuple[float, float], difference_m_s: float) -> float:
    """Return the yaw rate, averaged over the nosing phases, at right less left belt speed; the slower belt runs at ``SLOW_M_S``."""
    left, right = SLOW_M_S + max(-difference_m_s, 0.0), SLOW_M_S + max(difference_m_s, 0.0)
    return steady_motion(stance, friction, left, right).mean[2] / DEG


def print_table(slope_deg: float, friction: tuple[float, float]) -> None:
    slope, rows = slope_deg * DEG, []
    for heading_deg in HEADINGS_DEG:
        stance = stair_stance(CHAIR, CENTRE, slope, Stair().run_m / math.cos(slope), heading_deg * DEG)
        rates = [yaw_rate_deg_s(stance, friction, difference) for difference in DIFFERENCES_M_S]
        rows.append([f"{heading_deg:.0f}°", *(f"{round(rate, 2) + 0.0:.2f}" for rate in rates)])
    case = f"slower belt {SLOW_M_S} m/s, {slope_deg:g}°, friction {friction[0]}/{friction[1]}"
    heads = ["heading", *(f"{difference:+g}" for difference in DIFFERENCES_M_S)]
    table(f"Yaw rate [°/s] over right less left belt speed [m/s]; {case}", heads, rows)


def turning_room_m(slope_rad: float, friction: tuple[float, float], gauge_m: float) -> float:
    """Return the mean distance of the carrying contacts from their median below which a chair square to the flight turns [m].

    The slow belt sticks, and the chair starts to turn about the median of that belt's contacts at a rate ω. The fast belt slides
    lengthwise; its drag across is of second order in ω. With half the load on either belt, friction under the fast belt gains
    μ_along B ω/2, the chair's rise costs tan β B ω/2, and dragging the slow belt's contacts across costs μ_across m̄ ω/2, with m̄
    their mean distance from the median. Hence the chair turns if (μ_along - tan β) B > μ_across m̄. The condition is sufficient,
    not necessary: a few more phases turn about other centres of rotation, found by ``steady_motion``.
    """
    return (friction[0] - math.tan(slope_rad)) * gauge_m / friction[1]


def mean_distance_m(stance: Stance) -> np.ndarray:
    """Return the load-weighted mean distance of the contacts from their median along the belts, for each nosing phase."""
    order = np.argsort(stance.x_m, axis=1)
    x, load = np.take_along_axis(stance.x_m, order, axis=1), np.take_along_axis(stance.load, order, axis=1)
    middle = np.argmax(np.cumsum(load, axis=1) >= 0.5 - 1e-9, axis=1)
    return (load * np.abs(x - np.take_along_axis(x, middle[:, None], axis=1))).sum(axis=1)


def print_shares() -> None:
    rows = []
    for friction in FRICTIONS:
        cells: list[str] = []
        for slope_deg in (25.0, 28.0, 30.0):
            slope = slope_deg * DEG
            stance = stair_stance(CHAIR, CENTRE, slope, Stair().run_m / math.cos(slope))
            motion = steady_motion(stance, friction, 0.15, 0.25)
            room = mean_distance_m(stance) < turning_room_m(slope, friction, CHAIR.tracks.gauge_m)
            shares = (turning_share(motion, 1e-3 * DEG), turning_share(motion, 1.0 * DEG), float(room.mean()))
            cells.append("/".join(f"{100.0 * share:.0f}" for share in shares))
        rows.append([f"{friction[0]}/{friction[1]}", *cells])
    title = "Nosing phases [%] that turn at heading 0 with 0.15/0.25 m/s: at all / above 1 °/s / by the sufficient condition"
    table(title, ["friction", "25°", "28°", "30°"], rows)


if __name__ == "__main__":
    given = [float(word) for word in sys.argv[1:]]
    print_table(given[0] if given else 28.0, (given[1], given[2]) if len(given) == 3 else FRICTION)
    print_shares()
