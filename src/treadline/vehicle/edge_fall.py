"""Fall of a vehicle without flippers over the upper edge of a flight: ``Scenario, ChairDescription -> words``."""

import math

import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.rest_poses import rest_chair

PLACES = 101
"""Number of places from the slope to the landing at which a vehicle is set down: nearer to each other than those of a way."""


def falls_at_the_edge(scenario: Scenario, chair: ChairDescription) -> str:
    """Return how far a chair without flippers falls over the edge of a plane as steep as the flight, and what would carry it.

    A flipper square to the belts is long enough if it reaches the landing as the centre of mass passes the edge.
    """
    load, slope_rad = scenario.chair.entered, scenario.stair.slope_rad
    loaded = rest_chair(chair, load.payload_kg, offset_m=chair.in_chair(load.payload_offset_m), seat_shift_m=load.seat_shift_m)
    half_m, fixed = 0.5 * chair.tracks.flat_run_m, (chair.tracks.approach_angle_deg * DEG,)
    far_m = 10.0 * half_m
    edge = np.array([[-far_m, -far_m * math.tan(slope_rad), 0.0], [0.0, 0.0, 0.0], [far_m, 0.0, 0.0]])
    falls = []
    try:
        resting = pose = loaded.at(edge, -2.0 * half_m, fixed, slope_rad)
        for x_m in np.linspace(-2.0, 2.0, PLACES).tolist():
            pose, fall = loaded.moved(edge, pose, x_m * half_m, fixed)
            falls.append(0.0 if fall is None else fall.angle_rad / DEG)
    except MechanicsError:
        return "it would turn over at its edge"
    ahead, above = resting.com_m[0] - resting.x_m, resting.com_m[1] - resting.height_m
    c, s = math.cos(slope_rad), math.sin(slope_rad)
    along_m, up_m = ahead * c + above * s, above * c - ahead * s
    reach_m = (half_m - along_m + up_m * math.tan(slope_rad)) * math.tan(slope_rad)
    cure = f"a flipper of {reach_m:.2f} m that turns down to -90° would carry it"
    return f"over the edge it would fall by {max(falls):.0f}°, and {cure}"
