"""Steering on a flight by Coulomb friction alone: ``python benchmarks/dead_zone.py [slope_deg [along across]]``."""

import math
import sys

from tables import table

from treadline.core.angles import DEG
from treadline.core.paper import FRICTION
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.scenario.stair import RUN_DEFAULT_M
from treadline.vehicle.dead_zone import DIFFERENCES_M_S, HEADINGS_RAD, dead_zone_table, mean_distance_m, turning_room_m
from treadline.vehicle.quasi_static import steady_motion
from treadline.vehicle.stance import stair_stance

SLOW_M_S = 0.1
FRICTIONS = (FRICTION, (0.7, 0.5), (0.8, 0.5), (0.9, 0.5), (0.62, 0.3))


def print_table(slope_deg: float, friction: tuple[float, float]) -> None:
    rows = dead_zone_table(read_chair("wheelchair"), Chair(), slope_deg * DEG, RUN_DEFAULT_M, friction, slow_m_s=(SLOW_M_S,))
    signed = [-difference for difference in reversed(DIFFERENCES_M_S)] + list(DIFFERENCES_M_S)
    yaw = {(row.heading_rad, row.difference_m_s): row.yaw_rad_s / DEG for row in rows}
    case = f"slower belt {SLOW_M_S} m/s, {slope_deg:g}°, friction {friction[0]}/{friction[1]}"
    table(
        f"Yaw rate [°/s] over right less left belt speed [m/s]; {case}",
        ["heading", *(f"{difference:+g}" for difference in signed)],
        [
            [f"{heading / DEG:.0f}°", *(f"{round(yaw[heading, difference], 2) + 0.0:.2f}" for difference in signed)]
            for heading in HEADINGS_RAD
        ],
    )


def print_shares() -> None:
    rows = []
    for friction in FRICTIONS:
        cells: list[str] = []
        for slope_deg in (25.0, 28.0, 30.0):
            slope = slope_deg * DEG
            stance = stair_stance(read_chair("wheelchair"), Chair(), slope, RUN_DEFAULT_M / math.cos(slope))
            motion = steady_motion(stance, friction, 0.15, 0.25)
            room = mean_distance_m(stance) < turning_room_m(slope, friction, read_chair("wheelchair").tracks.gauge_m)
            shares = (motion.turning_share(1e-3 * DEG), motion.turning_share(1.0 * DEG), float(room.mean()))
            cells.append("/".join(f"{100.0 * share:.0f}" for share in shares))
        rows.append([f"{friction[0]}/{friction[1]}", *cells])
    title = "Nosing phases [%] that turn at heading 0 with 0.15/0.25 m/s: at all / above 1 °/s / by the sufficient condition"
    table(title, ["friction", "25°", "28°", "30°"], rows)


if __name__ == "__main__":
    given = [float(word) for word in sys.argv[1:]]
    print_table(given[0] if given else 28.0, (given[1], given[2]) if len(given) == 3 else FRICTION)
    print_shares()
