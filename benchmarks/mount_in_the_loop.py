"""Mount monitor in rendered climbs: headings with a camera mount that is rolled and pitched against its calibration.

Run: ``python benchmarks/mount_in_the_loop.py [--seeds N]`` (about two minutes of CPU). Each row is one mount error on one scenario:
share of headings inside their declared 95 % interval, largest error before and after the correction, and the events. The first row
of each scenario has a sound mount and no event.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from treadline.core.angles import DEG
from treadline.core.images import RgbdFrame
from treadline.core.ports import Reading, Truth, TruthPlant
from treadline.core.signals import Event, HeadingMeasurement
from treadline.plant.mujoco import open_plant
from treadline.run.episode import run_episode
from treadline.run.resolve import resolve
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Scenario

ERRORS_DEG = ((0.0, 0.0), (3.0, 0.0), (5.0, 0.0), (-5.0, 3.0))
"""Roll and pitch of the mount against its calibration [°]."""
SCENARIOS = ("up-28", "paper-28")
REPORTS = ("camera_mount", "imu_axes", "imu_tilt")


class WrongCalibration:
    """A plant whose frames carry a calibration that the mount differs from."""

    def __init__(self, plant: TruthPlant, roll_deg: float, pitch_deg: float) -> None:
        self._plant = plant
        self._roll_rad, self._pitch_rad = roll_deg * DEG, pitch_deg * DEG

    def __getattr__(self, name: str) -> object:
        return getattr(self._plant, name)

    def read(self) -> Sequence[Reading]:
        """Return the plant's readings, frames with the wrong calibration."""
        return [self._recalibrated(reading) if isinstance(reading, RgbdFrame) else reading for reading in self._plant.read()]

    def _recalibrated(self, frame: RgbdFrame) -> RgbdFrame:
        camera = frame.camera
        roll_rad, pitch_rad = camera.mount_roll_rad - self._roll_rad, camera.mount_pitch_rad - self._pitch_rad
        return replace(frame, camera=replace(camera, mount_roll_rad=roll_rad, mount_pitch_rad=pitch_rad))


def row(name: str, roll_deg: float, pitch_deg: float, seed: int) -> str:
    """Return one row of the table."""

    def opener(scenario: Scenario, seed: int) -> TruthPlant:
        plant = open_plant(scenario, seed, chair=read_chair(scenario.chair.model))
        wrong: TruthPlant = WrongCalibration(plant, roll_deg, pitch_deg) if roll_deg or pitch_deg else plant  # type: ignore[assignment]
        return wrong

    signals: list[object] = []
    run = run_episode(resolve(name, None, seed, open_plant=opener), sink=lambda signal, _: signals.append(signal))
    truth = [signal for signal in signals if isinstance(signal, Truth)]
    seen = [signal for signal in signals if isinstance(signal, HeadingMeasurement)]
    events = [signal for signal in signals if isinstance(signal, Event) and signal.name in REPORTS]
    corrected_s = min((event.t_s for event in events if event.name == "camera_mount"), default=0.0)
    times = np.array([signal.t_s for signal in seen])
    true = np.interp(times, [at.t_s for at in truth], [at.heading_rad for at in truth])
    errors = np.array([signal.heading_rad for signal in seen]) - true
    inside = np.mean(np.abs(errors) <= 1.96 * np.array([signal.sigma_rad for signal in seen]))
    before = np.abs(errors[times < corrected_s]).max(initial=0.0) / DEG
    after = np.abs(errors[times >= corrected_s]).max(initial=0.0) / DEG
    reports = "; ".join(f"{event.t_s:.1f} s {event.cause}" for event in events) or "none"
    verdict = run.verdict if run.cause is None else f"{run.verdict}: {run.cause}"
    return f"| {name} | {roll_deg:+g}°, {pitch_deg:+g}° | {verdict} | {inside:.1%} | {before:.2f}° | {after:.3f}° | {reports} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=1, help="runs per mount error")
    parser.add_argument("--seed", type=int, default=0, help="first seed")
    arguments = parser.parse_args()
    print("| scenario | roll, pitch | verdict | inside 95 % | error before | error after | events |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for name in SCENARIOS:
        for roll_deg, pitch_deg in ERRORS_DEG:
            for seed in range(arguments.seed, arguments.seed + arguments.seeds):
                print(row(name, roll_deg, pitch_deg, seed), flush=True)


if __name__ == "__main__":
    main()
