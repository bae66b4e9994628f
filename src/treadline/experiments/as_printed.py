"""The paper's controller as printed, Eq. (11b), (12), (14) at Ts = 1 s, on the simulated chair; and Table I next to ours.

Eq. (14) follows from (12) and (13), so the printed matrices agree with each other. The belt speed that they command at 30° exceeds
the limit of Table I. The climb speed is added as an input offset, without which u = -Kx stops the chair.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from treadline.control import lqr_gain
from treadline.control.lqr import static_reconstruction
from treadline.core import paper
from treadline.core.angles import DEG
from treadline.core.models import ControllerDesign, LinearModel
from treadline.core.signals import TICK_S
from treadline.experiments._job_pool import RunJob
from treadline.experiments.plan import FIG10_SLOPE, SLOPES_DEG, TABLE_SPEED_M_S, ReproducePlan, turn
from treadline.scenario.camera_file import KINECT_1
from treadline.scenario.scenario import Scenario


def paper_model(climb_speed_m_s: float = 0.0) -> LinearModel:
    """Return Eq. (12) as a model, around a climb speed."""
    return LinearModel(
        A=paper.A.copy(),
        B=paper.B.copy(),
        C=paper.C.copy(),
        D=paper.D.copy(),
        dt_s=paper.SAMPLING_TIME_S,
        input_offset=np.full(2, climb_speed_m_s),
        output_offset=np.zeros(2),
        input_names=("left_m_s", "right_m_s"),
        output_names=("heading_rad", "yaw_rate_rad_s"),
        provenance={"source": "Eq. (12)"},
    )


def paper_controller(climb_speed_m_s: float) -> ControllerDesign:
    """Return the controller of Eq. (11b), (12), (14)."""
    return ControllerDesign(
        model=paper_model(climb_speed_m_s),
        K=paper.K.copy(),
        observer_gain=np.zeros((2, 2)),
        period_s=paper.SAMPLING_TIME_S,
        reconstruct="static",
        provenance={"source": "Eq. (11b), (12), (14)"},
    )


def asked_at(heading_deg: float) -> Float[np.ndarray, " 2"]:
    """Return the belt speeds (left, right) [m/s] that Eq. (11) asks at rest at a heading.

    Paper: Eq. (11a), (11b), (12), (14).
    """
    y = np.array([heading_deg * DEG, 0.0])
    return np.asarray(-paper.K @ static_reconstruction(paper.C, paper.D, paper.K) @ y)


def facts() -> dict[str, Any]:
    """Return the gain that follows from the printed matrices, its gap to the printed gain, and the belt speeds commanded at 30°."""
    K = lqr_gain(paper.A, paper.B, paper.Q, paper.R)
    return {
        "K": K.tolist(),
        "max_gap_to_print": float(np.abs(K - paper.K).max()),
        "asked_m_s": asked_at(30.0).tolist(),
        "max_speed_m_s": paper.MAX_SPEED_M_S,
    }


def as_printed_turn(duration_s: float) -> Scenario:
    """Return the turn from +30° at 28° in which the printed controller drives: Eq. (11b), belts clipped at their limit."""
    return turn(FIG10_SLOPE, 30, duration_s, allocation="paper").changed(control={"reconstruct": "static"})


def job(plan: ReproducePlan, runs: Path) -> RunJob:
    """Return the run of the printed controller from +30° at 28°, with clipping at the track's limit."""
    return RunJob(
        name="literal-28",
        title="Eq. (13) as printed, 28°, from +30°",
        scenario=as_printed_turn(plan.turn_s),
        seed=plan.seeds[0],
        controller=paper_controller(TABLE_SPEED_M_S),
        runs=runs,
        labels={"kind": "literal", "slope_deg": FIG10_SLOPE, "start_heading_deg": 30},
    )


def table1() -> list[dict[str, Any]]:
    """Return Table I as it was run, one row per parameter: the paper's next to ours, read from the objects that ran.

    Paper: Table I.
    """
    scenario = turn(int(paper.SLOPE_DEG), 30, paper.FIG10_DURATION_S)
    chair = scenario.read_chair()
    top = chair.drives.max_speed_m_s
    friction = scenario.stair.friction
    rows: list[tuple[str, object, object]] = [
        ("Mass of the system [kg]", paper.MASS_KG, chair.masses.chassis_kg),
        ("Mass of the payload [kg]", paper.PAYLOAD_KG, scenario.chair.payload_kg),
        ("Friction μ, μ₂", ", ".join(map(str, paper.FRICTION)), ", ".join(map(str, friction))),
        ("Staircase angle β [°]", paper.SLOPE_DEG, ", ".join(map(str, SLOPES_DEG))),
        ("Track speed, largest [m/s]", paper.MAX_SPEED_M_S, top),
        ("Turn rate, largest [rad/s]", paper.MAX_TURN_RATE_RAD_S, round(2.0 * top / chair.tracks.gauge_m, 3)),
        ("IMU [Hz]", paper.IMU_RATE_HZ, 1.0 / TICK_S),
        ("Camera [Hz]", paper.CAMERA_RATE_HZ, KINECT_1.rate_hz),
        ("Control [Hz]", paper.CONTROL_RATE_HZ, paper.CONTROL_RATE_HZ),
        ("Climb speed [m/s]", "not given", TABLE_SPEED_M_S),
    ]
    return [{"parameter": parameter, "paper": str(printed), "ours": str(ours)} for parameter, printed, ours in rows]
