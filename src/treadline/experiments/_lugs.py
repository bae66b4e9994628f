"""Belt lugs next to smooth belts: turns on each slope of Table II and a whole traversal, the rubber's stiffness bracketed.

Every figure of the paper is reproduced with smooth belts, on which the dead zone rests. These runs show how comfort and roll-back
change with lugs of 15 mm every 80 mm. The seed draws the phase of the lugs; ``benchmarks/uncertainty.py`` varies the phase alone.
"""

from pathlib import Path
from typing import Any, Literal

from treadline.core.models import ControllerDesign
from treadline.experiments._job_pool import RunJob
from treadline.experiments.plan import FIG10_SLOPE, PASSENGER, STARTS_DEG, ReproducePlan, turn, without_images
from treadline.plant.mujoco import NOMINAL
from treadline.scenario.scenario import Belts, Scenario, read_scenario

LUG: Literal["15/80"] = "15/80"
NOMINAL_RUBBER_S = NOMINAL.contact_time_constant_s
RUBBER_S = (0.5 * NOMINAL_RUBBER_S, NOMINAL_RUBBER_S, 2.0 * NOMINAL_RUBBER_S)
"""Contact time constants of the belts' rubber [s]: the nominal one between the ends of its bracket (``[belts] stiffness_s``)."""
SMOOTH = Belts()
LUGGED = {rubber_s: Belts(lug=LUG, stiffness_s=rubber_s) for rubber_s in RUBBER_S}
TURN_S = 4.0
"""Duration of a turn [s]. The roll-back of a turn from 30° ends within 2 s; a longer run only adds nosings."""
TRAVERSAL = "up-28"
KEPT = ("rms_heading_deg", "roll_back_m", "max_contact_force_share", "duration_s", "verdict", "cause", "seed", "run")
"""Run scores that a row holds under their own names."""


def lugged_turn(slope_deg: int, belts: Belts) -> Scenario:
    """Return the turn from 30° on a slope, with the statistical camera."""
    return without_images(turn(slope_deg, max(STARTS_DEG), TURN_S)).model_copy(update={"belts": belts})


def lugged_traversal(belts: Belts) -> Scenario:
    """Return the whole traversal, with the statistical camera."""
    return without_images(read_scenario(TRAVERSAL)).model_copy(update={"belts": belts})


def jobs(plan: ReproducePlan, controller: ControllerDesign, runs: Path) -> list[RunJob]:
    """Return the runs: a traversal and a turn on each slope with smooth belts and with lugs; none in a quick plan.

    The rubber's bracket is run on the turns alone.
    """
    if plan.quick:
        return []
    traversals = [(TRAVERSAL, FIG10_SLOPE, belts, lugged_traversal(belts)) for belts in (SMOOTH, LUGGED[NOMINAL_RUBBER_S])]
    turns = [
        (f"turn-{slope}", slope, belts, lugged_turn(slope, belts))
        for slope in plan.slopes_deg
        for belts in (SMOOTH, *LUGGED.values())
    ]
    return [_job(plan, controller, runs, *case) for case in (*traversals, *turns)]


def _job(
    plan: ReproducePlan, controller: ControllerDesign, runs: Path, course: str, slope_deg: int, belts: Belts, scenario: Scenario
) -> RunJob:
    surface = "smooth" if belts.stiffness_s is None else f"lugs-{LUG.replace('/', '-')}-{1000.0 * belts.stiffness_s:g}ms"
    return RunJob(
        name=f"{course}-{surface}",
        title=f"belts with lugs, {course}, {surface}",
        scenario=scenario,
        seed=plan.seeds[0],
        controller=controller,
        runs=runs,
        labels={
            "kind": "lugs",
            "course": course,
            "slope_deg": slope_deg,
            "friction": list(scenario.stair.friction),
            "lug": belts.lug,
            "rubber_s": belts.stiffness_s,
        },
    )


def rows(results: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one row per run; ``rubber_s`` is None with smooth belts, which have the nominal contact."""
    kept = ("course", "slope_deg", "friction", "lug", "rubber_s", *KEPT)
    named = PASSENGER | {"pitch_rate_deg_s": "max_pitch_rate_deg_s", "margin_deg": "min_stability_margin_deg"}
    return [{name: run[name] for name in kept} | {key: run[score] for key, score in named.items()} for run in results]
