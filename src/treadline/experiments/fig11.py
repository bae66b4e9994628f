"""Fig. 11: the seat levels itself on a 28° stair.

Paper: Section II.B, Section VI.C.3, Fig. 11 (hardware; here the simulated linkage and actuator). The chair stands on
the flight with its brake on, the seat parallel to the chassis; at t = 0 the loop is closed.
"""

from pathlib import Path
from typing import Any

import numpy as np

from treadline.core import paper
from treadline.core.angles import DEG
from treadline.core.arrays import rms
from treadline.experiments.plan import turn
from treadline.io.runs import write_result
from treadline.mission.belt_controllers import ConstantSpeed
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import resolve
from treadline.run.run_scores import Trace, settling_time
from treadline.scenario.scenario import Scenario
from treadline.vehicle.comfort import STEADY_FROM_S

DURATION_S = 40.0
"""Fig. 11's time axis."""
SETTLED_RAD = 1.0 * DEG


def at_rest(scenario: Scenario) -> Scenario:
    """Return a scenario's chair standing on its flight, the seat parallel to the chassis."""
    control, start = {"loop": "open", "vision": "truth"}, {"seat": "chassis", "place": "flight"}
    standing = scenario.changed(control=control, start=start, drive={"direction": "up", "duration_s": DURATION_S})
    return standing.model_copy(update={"fault": ()})


def level_seat(folder: Path, seed: int, scenario: Scenario | None = None) -> dict[str, Any]:
    """Run it and return the figure's numbers: on the paper's 28° stair, or on a scenario's."""
    standing = at_rest(turn(int(paper.FIG11_SLOPE_DEG), 0, DURATION_S) if scenario is None else scenario)
    driver = ConstantSpeed(0.0, 1.0 / paper.CONTROL_RATE_HZ)
    setup = resolve(standing, driver, seed)
    setup.chair.levelled_seat  # noqa: B018 - rejects a chair without a seat linkage before anything is written
    run = recorded_run(folder, setup)
    figures, slope_deg = seat_figures(run.trace), standing.stair.slope_rad / DEG
    # A table of its own: the run's own settle_s is the heading's.
    write_result(folder, run.summary() | {"seat": figures})
    return {
        **figures,
        "run": folder.name,
        "seed": seed,
        "conditions": f"{slope_deg:.3g}° stair, chair at rest, settled means within 1°, seed {seed}",
    }


def seat_figures(trace: Trace) -> dict[str, float | None]:
    """Return settling time, start and errors of the seat's pitch over a run."""
    t, pitch = trace["t_s"], trace["seat_pitch_rad"]
    steady = pitch[t > min(STEADY_FROM_S, 0.5 * float(t[-1]))]  # a chair that slid off its stair ended early
    settle = settling_time(t, pitch, SETTLED_RAD)
    return {
        "settle_s": settle,
        "start_deg": float(pitch[0]) / DEG,
        "steady_error_deg": float(np.mean(steady)) / DEG,
        "steady_rms_deg": rms(steady) / DEG,
        "max_error_deg": float(np.abs(pitch[t > (settle or 0.0)]).max()) / DEG,
    }
