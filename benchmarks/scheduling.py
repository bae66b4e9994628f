"""Gain scheduling: a controller designed for each slope and payload, compared with the shipped controller.

Run: ``python benchmarks/scheduling.py [--seeds N] [--samples N]`` (about ten minutes of CPU). In each cell the chair is excited
and identified, and a controller is tuned. The chair then turns from ±20° and holds its heading with one belt 2 % fast, once with
this controller and once with the shipped one. The first seed is used for the identification data, the others for the runs.
"""

import argparse
from statistics import mean

from treadline.control.tune import tune
from treadline.core.models import ControllerDesign
from treadline.identification import IdentificationOptions, identify
from treadline.run.episode import traverse
from treadline.run.excitation_run import PERIOD_S, excite, long_enough
from treadline.scenario.scenario import Chair, DriveSettings, Scenario, Sensors, Stair, Start
from treadline.scenario.shipped_files import shipped_controller

CELLS = ((20.0, 0.0), (20.0, 110.0), (25.0, 50.0), (28.0, 50.0), (30.0, 0.0), (30.0, 80.0))
"""Slope [°], payload [kg]: the corners of the envelope, and the paper's."""
HEADINGS_DEG = (20.0, -20.0)
TURN_S = 40.0


def scenario(slope_deg: float, payload_kg: float, heading_deg: float, mismatch: float) -> Scenario:
    """Return a flight that no slope of the table makes slippery, seen by the statistical camera."""
    whole = Scenario(
        stair=Stair.model_validate(
            {"slope_deg": slope_deg, "run_m": 0.30, "width_m": 2.4, "walls": "none", "friction": (0.75, 0.6)}
        ),
        chair=Chair(payload_kg=payload_kg, belt_mismatch=mismatch),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        drive=DriveSettings(speed_m_s=0.2, duration_s=TURN_S),
        sensors=Sensors.model_validate({"camera": "statistical", "gravity_error_deg": 0.5}),
    )
    return long_enough(whole, TURN_S, spare_m=6.0)


def figures(controller: ControllerDesign, slope_deg: float, payload_kg: float, seeds: range) -> tuple[float, float, float]:
    """Return RMS of the heading over the turn, from 20 s on, and the time to settle; means over starts and seeds."""
    runs = [
        traverse(scenario(slope_deg, payload_kg, heading_deg, 0.02), controller=controller, seed=seed).scores
        for heading_deg in HEADINGS_DEG
        for seed in seeds
    ]
    return (
        mean(run.rms_heading_deg for run in runs),
        mean(run.steady_rms_heading_deg or 0.0 for run in runs),
        mean(TURN_S if run.settle_s is None else run.settle_s for run in runs),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3, help="runs per start")
    parser.add_argument("--samples", type=int, default=1000, help="of random driving per cell")
    parser.add_argument("--seed", type=int, default=4100, help="of the data; the runs' follow it")
    arguments = parser.parse_args()
    seeds = range(arguments.seed + 1, arguments.seed + 1 + arguments.seeds)
    shipped = shipped_controller("wheelchair")
    print(f"{arguments.samples} samples with seed {arguments.seed}, runs with seeds {seeds.start} to {seeds.stop - 1}\n")
    print("| slope, payload | RMS over 40 s, own | shipped | from 20 s on, own | shipped | settled within 2°, own | shipped |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for slope_deg, payload_kg in CELLS:
        data = excite(
            scenario(slope_deg, payload_kg, 0.0, 0.005), samples=arguments.samples, period_s=PERIOD_S, seed=arguments.seed
        )
        own = tune(identify(data.record, IdentificationOptions(method="okid-era")).model)
        pairs = zip(*(figures(controller, slope_deg, payload_kg, seeds) for controller in (own, shipped)), strict=True)
        cells = [f"{mine:.{digits}f} | {theirs:.{digits}f}" for (mine, theirs), digits in zip(pairs, (2, 3, 1), strict=True)]
        print(f"| {slope_deg:.0f}°, {payload_kg:.0f} kg | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
