"""What a traversal up and one down share: search, refusal, walls, sides, and a chair that wakes up on a flight."""

import math
from dataclasses import replace
from typing import Any

import pytest
from world import CHAIR, CONFIG, SLOPE_RAD, World, steeper

from .test_ascent import Foot, on_a_flight
from .test_descent import EDGE_M, Landing

AT_THE_END = pytest.mark.parametrize("make", [Foot, Landing], ids=["up", "down"])
ENTER_FROM_M = 0.25
"""Distance of the leading pulley before the flight at which the chair is about to enter."""


@AT_THE_END
def test_where_there_is_no_stair_it_looks_to_both_sides_and_then_holds(make: Any) -> None:
    world: World = make(spoil=lambda _: None, knows=False)
    turned = []
    while world.tick().hold is None:
        turned.append(world.heading_rad)
        assert world.t_s < 40.0
    assert world.phases == ["search"]
    assert max(turned) > 0.61  # 35°
    assert min(turned) < -0.61
    assert all(plan.speed_m_s == 0.0 and not plan.needs_stair for plan in world.plans)
    assert world.plans[-1].hold in ("no stair in view, to neither side", "no stair in view behind, to neither side")
    assert world.plans[-1].turn_m_s == 0.0
    # A person has re-armed: it looks again, and what was said is not said any more.
    assert world.tick().hold is None
    assert world.tick().turn_m_s != 0.0


@pytest.mark.parametrize(("make", "other"), [(Foot, "down"), (Landing, "up")], ids=["up", "down"])
def test_a_flight_of_the_other_direction_is_no_stair_to_go(make: Any, other: str) -> None:
    world: World = make(spoil=lambda seen: replace(seen, direction=other))
    world.run(limit_s=0.5)
    assert world.phases == ["search"]


@AT_THE_END
def test_what_mechanics_forbid_is_refused_before_the_flight_with_its_number(make: Any) -> None:
    world: World = make(spoil=steeper)
    assert "36.5°" in world.run("refused").cause
    world.run(limit_s=2.0)
    assert world.phases == ["search", "align", "refused"]
    assert all(plan.speed_m_s == 0.0 for plan in world.plans)
    assert world.plans[-1].turn_m_s == 0.0
    tried: World = make(spoil=steeper, planner=type(world.planner)(replace(CONFIG, check=False)))
    assert tried.run("mount", "edge", "refused").phase in ("mount", "edge")


@AT_THE_END
@pytest.mark.parametrize(
    ("sides", "cause"),
    [
        ({"left_edge_m": 0.35, "left_side": "open", "left_seen_m": 0.35}, "left side is open 0.35 m"),
        ({"right_edge_m": 0.30, "right_side": "open", "right_seen_m": 0.30}, "right side is open 0.30 m"),
        ({"right_seen_m": 0.20}, "right side was in view up to 0.20 m"),
        ({"left_seen_m": -0.10}, "left side was in view up to 0.00 m"),
    ],
)
def test_a_flight_is_not_entered_unless_it_was_seen_to_bear_the_chair(make: Any, sides: dict[str, Any], cause: str) -> None:
    """Test: an open side nearer than the chair sweeps, or a side not seen so far. Expected result: HOLD with the distance before
    the flight, for an open side as soon as it is known."""
    world = make(spoil=lambda seen: replace(seen, **sides))
    plan = world.run(limit_s=20.0)
    assert cause in plan.hold
    assert f"needs {CHAIR.swept_half_m + 0.02:.2f} m" in plan.hold  # 2 cm: the largest error of a measured side
    assert plan.phase == "approach"
    assert world.before_m > (ENTER_FROM_M if "seen" not in str(sides) else 0.0)


@AT_THE_END
@pytest.mark.parametrize(("left_m", "right_m", "wall"), [(0.327, 0.87, "left"), (None, 0.327, "right")])
def test_a_chair_that_does_not_fit_past_a_wall_is_held_before_the_stair(
    make: Any, left_m: float | None, right_m: float, wall: str
) -> None:
    """Test: a wall nearer than half the chair. Expected result: HOLD, with what would help; moved and re-armed, it goes on."""
    walls = {"left_wall_m": left_m, "right_wall_m": right_m}
    world: World = make(spoil=lambda seen: replace(seen, **walls))
    world.run("approach")
    cause = world.until_held()
    assert world.phases[-1] == "approach"
    # Half of the chair's width of 0.75 m.
    assert f"the {wall} wall is 0.33 m from the chair's middle, which needs 0.38 m: set the chair 0.10 m" in cause
    assert cause.endswith("right" if wall == "left" else "left")
    walls.update(left_wall_m=0.60, right_wall_m=0.60)
    world.run(limit_s=0.2)
    assert world.run("climb", "edge").hold is None


@pytest.mark.parametrize(
    ("make", "goes"), [(on_a_flight, "climb"), (lambda **given: Landing(x_m=0.5 * EDGE_M, **given), "descend")]
)
def test_a_chair_that_wakes_up_on_a_flight_stands_until_it_has_a_heading_then_goes(make: Any, goes: str) -> None:
    world: World = make(knows=False)
    assert world.pitch_rad == SLOPE_RAD
    world.run(limit_s=2.0)
    assert {plan.phase for plan in world.plans} == {"search"}
    assert all((plan.speed_m_s, plan.turn_m_s) == (0.0, 0.0) for plan in world.plans)
    world.knows = True
    assert "on a flight" in world.run(goes).cause
    assert world.flipper_rad <= math.radians(2.0)  # laid
    if goes == "descend":
        world.run("leave", "arrived")
