"""How fast the simulator is without camera and vision: simulated seconds per CPU second."""

import statistics
import time

from treadline.core.ports import TruthPlant
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.experiments.plan import straight
from treadline.plant.mujoco import open_plant

SPAN_S = 10.0
REPEATS = 5


def physics_real_time_factor() -> float:
    """Return the median of several spans of climbing at 28° with the physics alone."""
    plant = open_plant(straight(28, "open", SPAN_S * (REPEATS + 1)), seed=0)
    try:
        plant.start()
        _climb(plant, 0.0)  # caches and branch predictors warm up
        return statistics.median(_climb(plant, SPAN_S * (i + 1)) for i in range(REPEATS))
    finally:
        plant.close()


def _climb(plant: TruthPlant, from_s: float) -> float:
    plant.write(TrackCommand(t_s=from_s, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=from_s, rate_m_s=0.0))
    started = time.process_time()
    plant.advance(from_s + SPAN_S)
    return SPAN_S / (time.process_time() - started)
