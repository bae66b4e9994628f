"""Table I as it was run: the paper's parameters next to ours, read from the objects that ran."""

from typing import Any

from treadline.core import paper
from treadline.core.signals import TICK_S
from treadline.experiments.plan import SLOPES_DEG, TABLE_SPEED_M_S, turn
from treadline.plant.mujoco import CAMERA_PERIOD_S
from treadline.scenario.chair import read_chair


def rows() -> list[dict[str, Any]]:
    """Return one row per parameter of Table I.

    Paper: Table I.
    """
    scenario = turn(int(paper.SLOPE_DEG), 30, paper.FIG10_DURATION_S)
    chair = read_chair(scenario.chair.model)
    top = chair.drives.max_speed_m_s
    friction = scenario.stair.friction
    return [
        _row("Mass of the system [kg]", paper.MASS_KG, chair.masses.chassis_kg),
        _row("Mass of the payload [kg]", paper.PAYLOAD_KG, scenario.chair.payload_kg),
        _row("Friction μ, μ₂", ", ".join(map(str, paper.FRICTION)), ", ".join(map(str, friction))),
        _row("Staircase angle β [°]", paper.SLOPE_DEG, ", ".join(map(str, SLOPES_DEG))),
        _row("Track speed, largest [m/s]", paper.MAX_SPEED_M_S, top),
        _row(
            "Turn rate, largest [rad/s]",
            paper.MAX_TURN_RATE_RAD_S,
            round(2.0 * top / chair.tracks.gauge_m, 3),
        ),
        _row("IMU [Hz]", paper.IMU_RATE_HZ, 1.0 / TICK_S),
        _row("Camera [Hz]", paper.CAMERA_RATE_HZ, 1.0 / CAMERA_PERIOD_S),
        _row("Control [Hz]", paper.CONTROL_RATE_HZ, paper.CONTROL_RATE_HZ),
        _row("Climb speed [m/s]", "not given", TABLE_SPEED_M_S),
    ]


def _row(parameter: str, printed: object, ours: object) -> dict[str, Any]:
    return {"parameter": parameter, "paper": str(printed), "ours": str(ours)}
