"""Random track speeds on the stair and the measured response: data for the identification.

Paper: Section VI.B. The heading comes from the camera (Section III), the angular velocity from the IMU; 1000 samples.
"""

from dataclasses import dataclass

import numpy as np

from treadline.core import paper
from treadline.core.models import InputOutputRecord
from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand
from treadline.identification.excitation_signal import Excitation, ExcitationConfig
from treadline.run.episode import Sink, Traverse, Watch, traverse
from treadline.run.resolve import Opener, PlantName
from treadline.scenario.scenario import Scenario

PERIOD_S = 1.0 / paper.CONTROL_RATE_HZ
INPUTS = ("left_m_s", "right_m_s")
OUTPUTS = ("heading_rad", "yaw_rate_rad_s")


class ExcitationDriver:
    """Driver that proposes random belt speeds and records inputs and measured outputs of every sample."""

    follows_plan = False

    def __init__(self, excitation: Excitation, period_s: float) -> None:
        self._excitation = excitation
        self._period_s = period_s
        self.t_s: list[float] = []
        self.u: list[tuple[float, float]] = []
        self.y: list[tuple[float, float]] = []

    @property
    def period_s(self) -> float:
        """Sampling period [s]."""
        return self._period_s

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        """Return the next random speeds; the recorded outputs precede their effect."""
        del plan
        heading = 0.0 if estimate is None else estimate.heading_rad
        left, right = self._excitation.step(heading)
        if estimate is not None:
            self.t_s.append(t_s)
            self.u.append((left, right))
            self.y.append((estimate.heading_rad, estimate.heading_rate_rad_s))
        return TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Excited:
    """Record of an excitation, and its run."""

    record: InputOutputRecord
    first_t_s: float
    run: Traverse


def excite(
    scenario: Scenario,
    *,
    samples: int,
    period_s: float,
    seed: int,
    sink: Sink | None = None,
    watch: Watch | None = None,
    open_plant: Opener | PlantName = "mujoco",
) -> Excited:
    """Return ``samples`` of random driving on a flight made long enough for them."""
    driver = ExcitationDriver(
        Excitation(excitation_of(scenario), np.random.default_rng([seed, 5])),
        period_s,
    )
    whole = long_enough(scenario, (samples + 1) * period_s)
    run = traverse(whole, seed=seed, driver=driver, sink=sink, watch=watch, open_plant=open_plant)
    count = min(samples, len(driver.u))
    record = InputOutputRecord(
        u=np.array(driver.u[:count]).reshape(-1, len(INPUTS)),
        y=np.array(driver.y[:count]).reshape(-1, len(OUTPUTS)),
        dt_s=period_s,
        input_names=INPUTS,
        output_names=OUTPUTS,
    )
    return Excited(record=record, first_t_s=driver.t_s[0] if driver.t_s else 0.0, run=run)


def excitation_of(scenario: Scenario) -> ExcitationConfig:
    """Return the excitation settings: random speeds about the scenario's speed, with feedback of the heading."""
    return ExcitationConfig(mean_m_s=scenario.drive.speed_m_s)


def long_enough(scenario: Scenario, duration_s: float, spare_m: float = 3.0) -> Scenario:
    """Return the scenario with a flight on which ``duration_s`` of climbing never reaches the top."""
    stair = scenario.stair
    pitch_m = float(np.hypot(stair.rise_m, stair.run_m))
    needed = scenario.start.step + 2 + int(np.ceil((1.1 * duration_s * scenario.drive.speed_m_s + spare_m) / pitch_m))
    return scenario.model_copy(
        update={
            "stair": stair.model_copy(update={"steps": max(stair.steps, needed)}),
            "drive": scenario.drive.model_copy(update={"duration_s": duration_s}),
        }
    )
