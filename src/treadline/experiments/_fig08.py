"""Fig. 8: excite, identify, and the impulse response of what was identified.

Paper: Section IV, Section VI.B, Fig. 8. Heading comes from the vision, angular velocity from the IMU. A second
recording as long, with another seed, is the validation record.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from treadline.core.angles import DEG
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.experiments.plan import Ground, excitation
from treadline.identification import IdentificationOptions, identify
from treadline.identification.validate import h_step_rmse, impulse_response
from treadline.run.excitation_run import PERIOD_S, recorded_excitation
from treadline.run.resolve import Opener, PlantName
from treadline.scenario.scenario import Scenario

IMPULSE_S = 20.0
"""Duration of the drawn impulse response [s]; after the first second the integrator keeps its value."""
AHEAD_S = 5.0
"""Horizon of the heading forecast [s]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExciteJob:
    """One recording of random track speeds."""

    ground: Ground
    samples: int
    seed: int
    runs: Path
    """Folder of the run folders."""
    image_every: int = 0
    scenario: Scenario | None = None
    """Scenario of the run; None for the excitation scenario of the ground."""
    open_plant: Opener | PlantName = "mujoco"

    @property
    def name(self) -> str:
        """Name of the run folder."""
        return f"excite-{self.ground.name}-seed{self.seed}"

    def run(self) -> "ExcitationRun":
        """Drive and return the record."""
        excited = recorded_excitation(
            self.runs / self.name,
            self.scenario or excitation(self.ground),
            samples=self.samples,
            period_s=PERIOD_S,
            seed=self.seed,
            image_every=self.image_every,
            open_plant=self.open_plant,
        )
        return ExcitationRun(
            ground=self.ground,
            seed=self.seed,
            record=excited.record,
            verdict=excited.run.verdict,
            cpu_s_per_s=excited.run.cpu_s / excited.run.scores.duration_s,
            name=self.name,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExcitationRun:
    """Record of an excitation run, with ground, seed and verdict."""

    ground: Ground
    seed: int
    record: InputOutputRecord
    verdict: str
    cpu_s_per_s: float
    name: str


def evaluate(fitted: ExcitationRun, fresh: InputOutputRecord | None) -> tuple[LinearModel, dict[str, Any]]:
    """Return the model of one ground, which names it, and Fig. 8's figures for it."""
    found = identify(fitted.record, IdentificationOptions(method="okid-era", validation=fresh))
    origin = {"slope_deg": fitted.ground.slope_deg, "friction": list(fitted.ground.friction), "seed": fitted.seed}
    model, report = replace(found.model, provenance=found.model.provenance | {"identified_on": origin}), found.report
    values = np.asarray(report.singular_values, dtype=float)
    steps = round(IMPULSE_S / model.dt_s)
    response = impulse_response(model, steps)
    ahead = h_step_rmse(model, fresh if fresh is not None else fitted.record, round(AHEAD_S / model.dt_s))
    figures = {
        "slope_deg": fitted.ground.slope_deg,
        "friction": list(fitted.ground.friction),
        "singular_values": values.tolist(),
        "rank": report.order,
        "lags": report.lags,
        "sigma2_over_sigma3": float(values[1] / values[2]),
        "yaw_rate_vaf_percent": report.one_step_vaf_percent["yaw_rate_rad_s"],
        "heading_5s_rmse_deg": float(ahead[0]) / DEG,
        "poles": report.poles,
        "fit_percent": report.fit_percent,
        "one_step_vaf_percent": report.one_step_vaf_percent,
        "whiteness_p": report.whiteness_p,
        "warnings": list(report.warnings),
        "impulse": {
            "t_s": (np.arange(steps) * model.dt_s).tolist(),
            "heading_rad": {name: response[:, 0, j].tolist() for j, name in enumerate(model.input_names)},
            "yaw_rate_rad_s": {name: response[:, 1, j].tolist() for j, name in enumerate(model.input_names)},
        },
        "samples": len(fitted.record),
        "seed": fitted.seed,
        "run": fitted.name,
        "conditions": f"{len(fitted.record)} samples at {model.dt_s:g} s, seed {fitted.seed}; "
        + ("validated on another recording" if fresh is not None else "validated on the same recording"),
    }
    return model, figures
