"""Feasibility of a staircase with ``[[step]]`` tables: rules that join several tables.

``Stair, StepOverrides -> the first problem, in one line``, or None.
"""

import math
from collections.abc import Sequence

from treadline.core.angles import DEG
from treadline.scenario.stair import LEAST_SIDE_DEPTH_M, Stair, StepOverride


def step_problem(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    """Return why a staircase cannot be built, or None."""
    for check in (_outside, _given_twice, _landing_depth, _shape_of_winder, _overhang, _steep_tread, _crossing_nosings):
        problem = check(stair, overrides)
        if problem is not None:
            return problem
    return None


def place_of(stair: Stair, override: StepOverride) -> int:
    """Return the index of a step from the floor; negative ones count from the top."""
    return override.index % stair.count if -stair.count <= override.index < stair.count else override.index


def value_at(stair: Stair, overrides: Sequence[StepOverride], key: str, index: int, usual: float) -> float:
    """Return a step's value: its override, or the usual value."""
    for override in overrides:
        if place_of(stair, override) == index and getattr(override, key) is not None:
            return float(getattr(override, key))
    return usual


def run_of(stair: Stair, overrides: Sequence[StepOverride], index: int) -> float:
    """Return the depth of a step to the next nosing, across a landing too."""
    if index == stair.count - 1:
        return max(stair.landing_m, stair.run_m)
    return value_at(stair, overrides, "run_m", index, stair.between_m if stair.is_landing(index) else stair.run_m)


def _outside(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    for number, override in enumerate(overrides):
        if not -stair.count <= override.index < stair.count:
            return (
                f"step.{number}: index is {override.index}, the stair has {stair.count} steps; give one from {-stair.count} (from "
                f"the top) to {stair.count - 1}"
            )
    return None


def _given_twice(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    given: dict[tuple[int, str], int] = {}
    for number, override in enumerate(overrides):
        index = place_of(stair, override)
        for key in type(override).model_fields:
            if key == "index" or getattr(override, key) is None:
                continue
            same = ("friction", key) if key in ("friction_left", "friction_right") else (key,)
            same = (*same, "friction_left", "friction_right") if key == "friction" else same
            for other in same:
                if (index, other) in given:
                    return (
                        f"step.{number}: {key} of step {index} is given by step.{given[index, other]} already ({other}); remove one"
                    )
            given[index, key] = number
    return None


def _landing_depth(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    for number, override in enumerate(overrides):
        index = place_of(stair, override)
        if override.run_m is not None and stair.is_landing(index):
            name = "landing_m" if index == stair.count - 1 else "between_m"
            return f"step.{number}: run_m is {override.run_m:g}, but step {index} is a landing; its depth is stair.{name}"
    return None


def _shape_of_winder(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    """Return which override would change the plan of a winder."""
    for number, override in enumerate(overrides):
        index = place_of(stair, override)
        ends_one = index > 0 and stair.is_winder(index - 1)
        for key in ("run_m", "yaw_deg", "tread_slope_deg"):
            value = getattr(override, key)
            if value is None:
                continue
            if stair.is_winder(index):
                return f"step.{number}: {key} is {value:g}, but step {index} is a winder: stair.winders shapes it; remove it"
            if ends_one and key == "yaw_deg":
                return f"step.{number}: yaw_deg is {value:g}, but the nosing of step {index} ends the last winder; remove it"
    return None


def _overhang(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    for number, override in enumerate(overrides):
        if not override.overhang_m:
            continue
        index = place_of(stair, override)
        if stair.open_risers:
            return f"step.{number}: overhang_m is {override.overhang_m:g}, but stair.open_risers leaves no riser to hang over"
        run_m = run_of(stair, overrides, index)
        if override.overhang_m >= run_m:
            return (
                f"step.{number}: overhang_m is {override.overhang_m:g}; it must be below the run of {run_m:g} m, for the riser "
                "stands under the tread"
            )
    return None


def _steep_tread(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    """Return where the back of a tread would rise above the next nosing."""
    for number, override in enumerate(overrides):
        index = place_of(stair, override)
        if not override.tread_slope_deg or index == stair.count - 1:
            continue
        climb_m = run_of(stair, overrides, index) * math.tan(override.tread_slope_deg * DEG)
        rise_m = value_at(stair, overrides, "rise_m", index + 1, stair.rise_m)
        if climb_m >= rise_m:
            return (
                f"step.{number}: tread_slope_deg is {override.tread_slope_deg:g}, so the tread rises {climb_m:.3f} m to its "
                f"back; the next nosing is only {rise_m:g} m higher"
            )
    return None


def _crossing_nosings(stair: Stair, overrides: Sequence[StepOverride]) -> str | None:
    """Return where turned nosings meet within the stair's width."""
    turned = {place_of(stair, override) for override in overrides if override.yaw_deg is not None}
    for index in sorted({*turned, *(turn - 1 for turn in turned)}):
        if not 0 <= index < stair.count - 1:
            continue
        before, after = (math.tan(value_at(stair, overrides, "yaw_deg", i, 0.0) * DEG) for i in (index, index + 1))
        depth_m = run_of(stair, overrides, index) - 0.5 * stair.width_m * abs(after - before)
        if depth_m < LEAST_SIDE_DEPTH_M:
            return (
                f"step: between the nosings of steps {index} and {index + 1} the tread is {depth_m:.3f} m deep at its narrow side; "
                f"it must be at least {LEAST_SIDE_DEPTH_M:g} m: give a larger run_m, a smaller yaw_deg or a narrower stair"
            )
    return None
