"""Random track speeds on the stair and the measured response: data for the identification.

Paper: Section VI.B. The heading comes from the camera (Section III), the angular velocity from the IMU; 1000 samples.
"""

from dataclasses import asdict
from pathlib import Path

import numpy as np

from treadline.core import paper
from treadline.core.models import InputOutputRecord
from treadline.core.signals import HeadingEstimate, MotionPlan, TrackCommand
from treadline.identification.excitation_signal import Excitation, ExcitationConfig
from treadline.io.records import write_record
from treadline.io.runs import INPUTS, OUTPUTS, RECORD
from treadline.run.episode import Traverse, Watch, run_episode
from treadline.run.recorded_run import recorded_run
from treadline.run.resolve import Opener, PlantName, resolve
from treadline.scenario.scenario import Scenario

PERIOD_S = 1.0 / paper.CONTROL_RATE_HZ


class _ExcitationDriver:
    """Driver that proposes random belt speeds and records inputs and measured outputs of every sample."""

    follows_plan = False

    def __init__(self, excitation: Excitation, period_s: float) -> None:
        self._excitation = excitation
        self.period_s = period_s
        self.t_s: list[float] = []
        self._u: list[tuple[float, float]] = []
        self._y: list[tuple[float, float]] = []

    def step(self, estimate: HeadingEstimate | None, t_s: float, plan: MotionPlan) -> TrackCommand:
        """Return the next random speeds; the recorded outputs precede their effect."""
        del plan
        heading = 0.0 if estimate is None else estimate.heading_rad
        left, right = self._excitation.step(heading)
        if estimate is not None:
            self.t_s.append(t_s)
            self._u.append((left, right))
            self._y.append((estimate.heading_rad, estimate.heading_rate_rad_s))
        return TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right)

    def record(self, samples: int) -> InputOutputRecord:
        """Return the record of at most ``samples``."""
        return InputOutputRecord(
            u=np.array(self._u[:samples]).reshape(-1, len(INPUTS)),
            y=np.array(self._y[:samples]).reshape(-1, len(OUTPUTS)),
            dt_s=self.period_s,
            input_names=INPUTS,
            output_names=OUTPUTS,
        )


def excite(
    scenario: Scenario,
    *,
    samples: int,
    period_s: float,
    seed: int,
    folder: Path | None = None,
    image_every: int = 0,
    watch: Watch | None = None,
    open_plant: Opener | PlantName = "mujoco",
) -> tuple[InputOutputRecord, Traverse]:
    """Return ``samples`` of random driving, about the scenario's speed, on a flight made long enough for them, and the run.

    Args:
        samples: Number of input-output samples.
        period_s: Time between samples [s].
        folder: Run folder to write, ``record.csv`` included; None: nothing is written.
        image_every: Keep every n-th frame in the log of the run folder; 0 keeps none.
        watch: Receives each tick as it ends.

    Raises:
        TreadlineError: Before anything is written, if the chair cannot be read.
    """
    config = ExcitationConfig(mean_m_s=scenario.drive.speed_m_s)
    driver = _ExcitationDriver(Excitation(config, np.random.default_rng([seed, 5])), period_s)
    setup = resolve(long_enough(scenario, (samples + 1) * period_s), driver, seed, open_plant=open_plant)
    if folder is None:
        run = run_episode(setup, watch=watch)
    else:
        run = recorded_run(folder, setup, {"excitation": asdict(config)}, image_every=image_every, watch=watch)
    record = driver.record(samples)
    if folder is not None:
        write_record(folder / RECORD, record, driver.t_s[0] if driver.t_s else 0.0)
    return record, run


def long_enough(scenario: Scenario, duration_s: float, spare_m: float = 3.0) -> Scenario:
    """Return the scenario with a flight on which ``duration_s`` of climbing never reaches the top."""
    stair = scenario.stair
    pitch_m = float(np.hypot(stair.rise_m, stair.run_m))
    needed = scenario.start.step + 2 + int(np.ceil((1.1 * duration_s * scenario.drive.speed_m_s + spare_m) / pitch_m))
    return scenario.changed(stair={"steps": max(stair.steps, needed)}, drive={"duration_s": duration_s})
