"""Speed of the plant alone, without camera: ``python benchmarks/physics.py``."""

import math
import statistics
import time

from treadline.angles import DEG
from treadline.scenario import Chair, Control, Scenario, Stair, Start
from treadline.signals import SeatCommand, TrackCommand
from treadline.sim import MujocoPlant, open_plant

SEED = 0
SIMULATED_S = 30.0
REPEATS = 5


def climbing(slope_deg: float) -> MujocoPlant:
    """Return a started plant that climbs at 0.2 m/s with a belt mismatch of 2 %."""
    scenario = Scenario(
        stair=Stair(rise_m=0.30 * math.tan(slope_deg * DEG), steps=60, width_m=10.0, walls="none"),
        chair=Chair(belt_mismatch=0.02),
        start=Start(place="flight", step=6),
        control=Control(vision="truth"),
    )
    plant = open_plant(scenario, SEED)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
    return plant


def factors(slope_deg: float) -> tuple[float, float]:
    """Return simulated seconds per processor second: physics alone, and with IMU, seat, drives and truth read."""
    plant = climbing(slope_deg)
    started = time.process_time()
    plant.advance(SIMULATED_S)
    physics_s = time.process_time() - started
    plant.read()
    plant.truth()
    all_s = time.process_time() - started
    return SIMULATED_S / physics_s, SIMULATED_S / all_s


def main() -> None:
    climbing(25.0).advance(1.0)  # the first run compiles, or loads what was compiled
    print(f"plant at 500 Hz, {SIMULATED_S:.0f} s of climbing, seed {SEED}, one core; real-time factor, median of {REPEATS}")
    for slope_deg in (25.0, 28.0, 30.0):
        physics, sensed = zip(*(factors(slope_deg) for _ in range(REPEATS)), strict=True)
        print(
            f"  {slope_deg:.0f}°   physics {statistics.median(physics):5.0f} ({min(physics):.0f}…{max(physics):.0f})"
            f"   with sensors and truth {statistics.median(sensed):4.0f} ({min(sensed):.0f}…{max(sensed):.0f})"
        )


if __name__ == "__main__":
    main()
