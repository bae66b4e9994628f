"""What a chair climbs: a flight, or a single nosing (kerb, threshold, dock): its steepest pitch and the spacing of its nosings."""

import math
from dataclasses import dataclass

from treadline.core.angles import DEG
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.staircase import as_designed


@dataclass(frozen=True, slots=True, kw_only=True)
class Climb:
    """Stair of a scenario as one chair meets it."""

    rise_m: float
    """Rise of a step by design; the height of a single nosing above the floor."""
    slope_rad: float
    """Pitch of the chair: the flight's slope; over a single nosing the pitch at which the middle of the belts passes."""
    spacing_m: float | None
    """Largest distance between neighbouring nosings [m]; None for a single one, at which floor and landing bear the belts' ends."""
    pitch_m: float
    """Distance between neighbouring nosings by design [m]."""
    half_run_m: float
    """Half of the belts' flat run [m]."""

    @property
    def name(self) -> str:
        """Name in messages."""
        return "stair" if self.spacing_m is not None else "kerb"

    @property
    def steepness(self) -> str:
        """Clause that states the pitch."""
        if self.spacing_m is not None:
            return f"the stair is {self.slope_rad / DEG:.1f}° steep"
        return f"over the kerb of {self.rise_m:.2f} m the chair pitches by {self.slope_rad / DEG:.1f}°"

    def below(self, slope_rad: float) -> str:
        """Return a stair or kerb below a pitch, in words."""
        if self.spacing_m is not None:
            return f"a stair below {slope_rad / DEG:.1f}°"
        return f"a kerb below {self.half_run_m * math.sin(slope_rad):.2f} m"


def climb_of(scenario: Scenario, chair: ChairDescription) -> Climb:
    """Return what the chair of a scenario climbs."""
    stair, half_run_m = scenario.stair, 0.5 * chair.tracks.flat_run_m
    pitch_m = math.hypot(stair.rise_m, stair.run_m)
    if stair.steps > 1:
        return Climb(
            rise_m=stair.rise_m,
            slope_rad=stair.slope_rad,
            spacing_m=widest_spacing_m(scenario, 1),
            pitch_m=pitch_m,
            half_run_m=half_run_m,
        )
    rise_m = max(step.rise_m for step in as_designed(stair, scenario.step).steps)
    # The rear end stands on the floor, the middle of the flat run on the nosing.
    pitch_rad = math.asin(min(rise_m / half_run_m, 1.0))
    return Climb(rise_m=rise_m, slope_rad=pitch_rad, spacing_m=None, pitch_m=pitch_m, half_run_m=half_run_m)


def widest_spacing_m(scenario: Scenario, neighbours: int) -> float:
    """Return the largest distance from a nosing to the next, or the next but one [m].

    Floor and landing support the track anywhere: they count as a nosing before the first and after the last, one pitch away.
    """
    stair, widest_m = scenario.stair, 0.0
    for steps in as_designed(stair, scenario.step).straight_parts:
        there = [(step.x_m, step.z_m) for step in steps if not step.missing]
        first, last = steps[0], steps[-1]
        there.insert(0, (first.x_m - stair.run_m, first.z_m - stair.rise_m))
        there.append((last.x_m + stair.run_m, last.z_m + stair.rise_m))
        widest_m = max(widest_m, *(math.dist(*pair) for pair in zip(there, there[neighbours:], strict=False)))
    return widest_m
