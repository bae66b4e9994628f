"""What a chair climbs: a flight, or a single nosing (kerb, threshold, dock): its steepest pitch and the distance of its nosings."""

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
    is_flight: bool
    """Whether there are two nosings or more; floor and landing bear the belts' ends at a single one."""
    pitch_m: float
    """Distance between neighbouring nosings by design [m]."""
    half_run_m: float
    """Half of the belts' flat run [m]."""

    @property
    def name(self) -> str:
        """Name in messages."""
        return "stair" if self.is_flight else "kerb"

    @property
    def steepness(self) -> str:
        """Clause that states the pitch."""
        if self.is_flight:
            return f"the stair is {self.slope_rad / DEG:.1f}° steep"
        return f"over the kerb of {self.rise_m:.2f} m the chair pitches by {self.slope_rad / DEG:.1f}°"

    def below(self, slope_rad: float) -> str:
        """Return a stair or kerb below a pitch, in words."""
        if self.is_flight:
            return f"a stair below {slope_rad / DEG:.1f}°"
        return f"a kerb below {self.half_run_m * math.sin(slope_rad):.2f} m"


def climb_of(scenario: Scenario, chair: ChairDescription) -> Climb:
    """Return what the chair of a scenario climbs: its steepest flight."""
    stair, half_run_m = scenario.stair, 0.5 * chair.tracks.flat_run_m
    sizes_m = [size_m for flight, size_m in zip(stair.each, stair.sizes_m, strict=True) if flight.steps > 1]
    rise_m, run_m = max(sizes_m, key=lambda size_m: math.atan2(*size_m), default=(stair.rise_m, stair.run_m))
    pitch_m = math.hypot(rise_m, run_m)
    if sizes_m:
        return Climb(rise_m=rise_m, slope_rad=math.atan2(rise_m, run_m), is_flight=True, pitch_m=pitch_m, half_run_m=half_run_m)
    rise_m = max(step.rise_m for step in as_designed(stair, scenario.step, scenario.sill).steps)
    # The rear end stands on the floor, the middle of the flat run on the nosing.
    pitch_rad = math.asin(min(rise_m / half_run_m, 1.0))
    return Climb(rise_m=rise_m, slope_rad=pitch_rad, is_flight=False, pitch_m=pitch_m, half_run_m=half_run_m)
