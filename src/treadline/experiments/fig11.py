"""Fig. 11: the seat levels itself on a 28° stair.

Paper: Section II.B, Section VI.C.3, Fig. 11 (hardware; here the simulated linkage and actuator). The chair stands on
the flight with its brake on, the seat parallel to the chassis; at t = 0 the loop is closed.
"""

from pathlib import Path
from typing import Any

import numpy as np

from treadline import paper
from treadline.angles import DEG, rms
from treadline.experiments.plan import turn
from treadline.experiments.recorded import recorded_run
from treadline.experiments.scores import settling_time
from treadline.mission.drivers import ConstantSpeed
from treadline.scenario import Scenario

DURATION_S = 40.0
"""Fig. 11's time axis."""
STEADY_FROM_S = 20.0
SETTLED_RAD = 1.0 * DEG


def scenario() -> Scenario:
    """Return a chair at rest on 28°, its seat parallel to the chassis."""
    standing = turn(int(paper.FIG11_SLOPE_DEG), 0, DURATION_S)
    control = standing.control.model_copy(update={"loop": "open", "vision": "truth"})
    start = standing.start.model_copy(update={"seat": "chassis"})
    return standing.model_copy(update={"control": control, "start": start})


def level_seat(folder: Path, seed: int) -> dict[str, Any]:
    """Run it and return the figure's numbers."""
    driver = ConstantSpeed(0.0, 1.0 / paper.CONTROL_RATE_HZ)
    run = recorded_run(folder, scenario(), controller=None, seed=seed, driver=driver)
    t, pitch = run.trace["t_s"], run.trace["seat_pitch_rad"]
    steady = pitch[t > STEADY_FROM_S]
    settle = settling_time(t, pitch, SETTLED_RAD)
    return {
        "settle_s": settle,
        "start_deg": float(pitch[0]) / DEG,
        "steady_error_deg": float(np.mean(steady)) / DEG,
        "steady_rms_deg": rms(steady) / DEG,
        "max_error_deg": float(np.abs(pitch[t > (settle or 0.0)]).max()) / DEG,
        "run": folder.name,
        "seed": seed,
        "conditions": f"{paper.FIG11_SLOPE_DEG:g}° stair, chair at rest, settled means within 1°, seed {seed}",
    }
