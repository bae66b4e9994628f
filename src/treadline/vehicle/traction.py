"""Friction of belts on a stair: is it enough, with which reserve, how far can the belts turn the chair, how much slip is normal.

Paper: Section II.A, Table I (μ = 0.62 along, μ₂ = 0.5 across). Gravity pulls down the slope with tan β per unit of normal force;
at a heading ψ the components are cos ψ along the belts and sin ψ across. The chair holds inside the friction ellipse (cos ψ tan β /
μ)² + (sin ψ tan β / μ₂)² < 1.

The one judge: ``check`` applies it to the friction that a scenario names, up and down; the traction test to the friction that is
measured; the planner to steering with no stair in view; the guard's limits of turn and slip come from here.

Going down, a landing shows nothing of the flight's friction: to show tan 28° on the level a chair would have to accelerate with
5.2 m/s², beyond its drives and its passenger. What is known before the edge is the scenario's friction, which ``check`` judges; on
the flight the guard measures slip.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from functools import cache

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.core.paper import FRICTION, SLOPE_DEG
from treadline.scenario.chair import ChairDescription
from treadline.vehicle.loading import Loading, centre_of_mass_level
from treadline.vehicle.quasi_static import Centre, Stance, floor_stance, stair_stance, steady_motion

RESERVE = 0.05
"""Required friction in excess of tan β, as a share of tan β: a reserve for jolts at the nosings."""
TEST_EXCESS = 0.006
"""Excess of the friction that a traction test measures, as a share of tan β: the rear stands on the floor, and the drives lag.
Simulated at 22 and 28° with three seeds, 1.05 tan β measures 1.060 to 1.076, and 1.03 tan β, which must be refused, 1.045 to 1.053:
what ``check`` lets in passes the test."""
NORMAL_SLIP = 0.3
"""Largest normal slip ratio of a chair that drives straight: Coulomb friction is rate independent, so that a sound chair slips by
1 mm in 60, and one whose friction is used up by all of its travel."""
DEAD_SHARE = 0.05
"""Share of the turn of belts that do not skid, up to which belts do not turn the chair: less than a load to one side does."""


def friction_needed(slope_rad: float, reserve: float = RESERVE) -> float:
    """Return the friction along the belts that a slope needs, with reserve."""
    return (1.0 + reserve) * math.tan(slope_rad)


def friction_use(slope_rad: float, heading_rad: float, friction: tuple[float, float]) -> float:
    """Return the used fraction of the friction ellipse at a heading; the chair slides at 1."""
    along, across = friction
    pull = math.tan(slope_rad)
    return math.hypot(math.cos(heading_rad) * pull / along, math.sin(heading_rad) * pull / across)


def largest_heading_rad(slope_rad: float, friction: tuple[float, float]) -> float:
    """Return the largest heading at which friction holds the chair on a slope [rad]; π/2 without a limit.

    Raises:
        MechanicsError: If the chair slides even at zero heading.
    """
    if friction_use(slope_rad, 0.0, friction) >= 1.0:
        raise MechanicsError(
            f"friction {friction[0]:.2f} cannot hold a slope that needs {math.tan(slope_rad):.2f}; roughen the nosings"
        )
    pull = math.tan(slope_rad)
    lengthwise, sidewise = (pull / friction[0]) ** 2, (pull / friction[1]) ** 2
    if sidewise <= 1.0:
        return 0.5 * math.pi
    # lengthwise cos² + sidewise sin² = 1, solved for sin².
    return math.asin(math.sqrt((1.0 - lengthwise) / (sidewise - lengthwise)))


def shortage(slope_rad: float, heading_rad: float, friction: tuple[float, float], less_steep: Callable[[float], str]) -> str | None:
    """Return why friction does not hold the chair on a stair or kerb, with the number and the remedy; None if it does.

    Args:
        less_steep: Names a stair or kerb below a slope.
    """
    along, needed = friction[0], friction_needed(slope_rad)
    if along < needed:
        remedy = f"roughen the nosings or take {less_steep(math.atan(along / (1.0 + RESERVE)))}"
        return f"friction {along:.2f} is below {1.0 + RESERVE:g} × tan β = {needed:.2f}; {remedy}"
    use = friction_use(slope_rad, heading_rad, friction)
    if use < 1.0:
        return None
    squarer = f"start squarer than {largest_heading_rad(slope_rad, friction) / DEG:.0f}°"
    return f"at a heading of {heading_rad / DEG:.0f}° the chair slides (friction use {use:.2f}); {squarer}"


def turn_share(stance: Stance, gauge_m: float, friction: tuple[float, float]) -> float:
    """Return the turn of a chair by belts of different speeds, as a share of that of belts that do not skid."""
    slow_m_s, fast_m_s = 0.1, 0.2  # friction is rate independent: the ratio counts, which is that of a chair near straight
    return abs(steady_motion(stance, friction, fast_m_s, slow_m_s).mean[2]) * gauge_m / (fast_m_s - slow_m_s)


@cache
def level_turn_share(chair: ChairDescription, payload_kg: float) -> float:
    """Return the turn share on a level floor with the friction of Table I."""
    return turn_share(floor_stance(chair, _centre(chair, payload_kg)), chair.tracks.gauge_m, FRICTION)


@cache
def dead_zone_rad(chair: ChairDescription, payload_kg: float) -> float:
    """Return the largest heading error at which belts of different speeds turn the chair by no more than ``DEAD_SHARE`` [rad].

    The friction is the least with which a chair climbs, that of the reserve: a traction test shows no more. There the dead
    zone hardly depends on the slope (9 to 10° from 22 to 30° for both shipped chairs), so that it is computed once for each chair.
    """
    centre, slope_rad = _centre(chair, payload_kg), SLOPE_DEG * DEG
    along, pitch_m = friction_needed(slope_rad), 0.30 / math.cos(slope_rad)
    friction = along, along * FRICTION[1] / FRICTION[0]
    with suppress(MechanicsError):  # belts do not steer a chair that slides or tips
        for heading_deg in range(1, 20):
            stance = stair_stance(chair, centre, slope_rad, pitch_m, heading_deg * DEG, phases=20)
            if turn_share(stance, chair.tracks.gauge_m, friction) > DEAD_SHARE:
                break
    return (heading_deg - 1) * DEG


def _centre(chair: ChairDescription, payload_kg: float) -> Centre:
    """Return the assumed centre of mass of a chair whose level seat has turned by an angle."""
    loading = Loading(chair=chair, payload_kg=payload_kg)

    def at(seat_rad: float) -> tuple[float, float, float]:
        x, z = centre_of_mass_level(loading, seat_rad)
        return x, 0.0, z

    return at
