"""What ``reproduce`` runs: slopes, starts, seeds and durations, whole and quick.

The seeds reported here were used for nothing else: weights and thresholds were chosen on seeds from 100 on.
"""

from dataclasses import dataclass

from treadline import paper
from treadline.experiments.excite import long_enough
from treadline.scenario import Chair, Control, Drive, Scenario, Sensors, Stair, Start

SLOPES_DEG = (25, 28, 30)
STARTS_DEG = (30, -30)
TABLE_SPEED_M_S = 0.2
GRAVITY_ERROR_DEG = 0.5
"""Tilt of the IMU's idea of down in the runs that are reported: what a cheap IMU has after calibration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How much of the paper is run."""

    quick: bool
    slopes_deg: tuple[int, ...]
    seeds: tuple[int, ...]
    excite_slopes_deg: tuple[int, ...]
    samples: int
    straight_s: float
    turn_s: float


WHOLE = Plan(
    quick=False,
    slopes_deg=SLOPES_DEG,
    seeds=(0, 1, 2, 3, 4),
    excite_slopes_deg=SLOPES_DEG,
    samples=paper.SAMPLES,
    straight_s=paper.FIG9_DURATION_S,
    turn_s=paper.FIG10_DURATION_S,
)
QUICK = Plan(
    quick=True,
    slopes_deg=SLOPES_DEG,
    seeds=(0,),
    excite_slopes_deg=(28,),
    samples=400,
    straight_s=60.0,
    turn_s=30.0,
)
FIG10_SLOPE = int(paper.FIG10_SLOPE_DEG)
CONTROLLER_SLOPE_DEG = FIG10_SLOPE
"""The slope whose model the controller is tuned on: the middle one, as in Fig. 10."""


def excitation(slope_deg: int) -> Scenario:
    """Return the scenario in which random speeds are tried (Section VI.B)."""
    return _flight(slope_deg, heading_deg=0.0, duration_s=300.0, mismatch=0.005)


def turn(slope_deg: int, start_deg: int, duration_s: float, *, allocation: str = "climb-safe") -> Scenario:
    """Return a start at ±30° (Fig. 10, Table II)."""
    scenario = _flight(slope_deg, heading_deg=float(start_deg), duration_s=duration_s, mismatch=0.005)
    control = Control.model_validate(scenario.control.model_dump() | {"allocation": allocation})
    return scenario.model_copy(update={"control": control})


def straight(slope_deg: int, loop: str, duration_s: float) -> Scenario:
    """Return a start at 0° with a 2 % faster right belt (Fig. 9).

    The open loop looks at nothing, so no frames are rendered for it.
    """
    scenario = _flight(slope_deg, heading_deg=0.0, duration_s=duration_s, mismatch=0.02)
    # So wide that a drifting chair meets neither a wall nor the flight's side.
    stair = scenario.stair.model_copy(update={"width_m": 40.0, "walls": "none"})
    control = Control.model_validate({"loop": loop, "vision": "truth" if loop == "open" else "robust"})
    return scenario.model_copy(update={"control": control, "stair": stair})


def _flight(slope_deg: int, *, heading_deg: float, duration_s: float, mismatch: float) -> Scenario:
    scenario = Scenario(
        stair=Stair.model_validate({"slope_deg": float(slope_deg), "run_m": 0.30, "width_m": 2.4}),
        chair=Chair(payload_kg=paper.PAYLOAD_KG, belt_mismatch=mismatch),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        drive=Drive(speed_m_s=TABLE_SPEED_M_S, duration_s=duration_s),
        sensors=Sensors(gravity_error_deg=GRAVITY_ERROR_DEG),
    )
    return long_enough(scenario, duration_s, spare_m=6.0)
