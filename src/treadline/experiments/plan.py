"""What ``reproduce`` runs: slopes, friction, starts, seeds and durations. A quick plan has fewer items.

Two frictions: Table I's (0.62 along the belt, 0.5 across), with which no belt difference turns a chair that is square to a stair of
28° or 30° (the dead zone), and 0.9/0.5, rubber that grips better along than across, with which it turns everywhere. The model is
therefore identified at 20° on Table I's friction, and again at 28° on the better grip.

The seeds reported here were used for nothing else: weights and thresholds were chosen on seeds from 100 on.
"""

from dataclasses import dataclass, replace

from treadline.core import paper
from treadline.report.comparison import TILT_DEG
from treadline.run.excitation_run import long_enough
from treadline.scenario.scenario import Chair, DriveSettings, Scenario, Sensors, Stair, Start

SLOPES_DEG = tuple(dict.fromkeys(slope for slope, _ in paper.TABLE_II))
STARTS_DEG = tuple(paper.TABLE_II_AVERAGE)
TABLE_SPEED_M_S = 0.2
PASSENGER = {
    "passenger_m_s2": "passenger_max_m_s2",
    "vertical_m_s2": "passenger_vertical_m_s2",
    "longitudinal_m_s2": "passenger_longitudinal_m_s2",
    "lateral_m_s2": "passenger_lateral_m_s2",
}
"""Run score of the passenger's acceleration that a key of ``results.json`` holds."""

Friction = tuple[float, float]
"""Friction coefficients along the belt and across."""
PAPER_FRICTION: Friction = paper.FRICTION
GOOD_GRIP: Friction = (0.9, 0.5)
FRICTIONS = (PAPER_FRICTION, GOOD_GRIP)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """Slope and friction of the stair on which an identification record is taken."""

    slope_deg: int
    friction: Friction = PAPER_FRICTION

    @property
    def name(self) -> str:
        """Name of the ground in folder names."""
        return f"{self.slope_deg}{suffix_of(self.friction)}"


def suffix_of(friction: Friction) -> str:
    """Return the suffix of folder names for a friction, empty for Table I's."""
    return "" if friction == PAPER_FRICTION else f"-mu{friction[0]:g}-{friction[1]:g}"


def text_of(friction: Friction) -> str:
    """Return the addition to a title for a friction, empty for Table I's."""
    return "" if friction == PAPER_FRICTION else f", friction {friction[0]:g}/{friction[1]:g}"


CONTROLLER_GROUND = Ground(slope_deg=20)
"""Where the shipped and the reproduced controller are identified: Table I's friction, on a slope where it lets the belts turn the
chair (yaw rate explained one step ahead: 97 %; at 28°: 8 %)."""
GROUNDS = (
    CONTROLLER_GROUND,
    Ground(slope_deg=28, friction=GOOD_GRIP),
    Ground(slope_deg=25),
    Ground(slope_deg=28),
    Ground(slope_deg=30),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReproducePlan:
    """Extent of a reproduction: slopes, seeds, grounds and durations."""

    quick: bool
    """Whether the plan has the shortest list of items: no straight climbs, no turns with roll-back allowed, no lugs."""
    slopes_deg: tuple[int, ...]
    seeds: tuple[int, ...]
    grounds: tuple[Ground, ...]
    """Grounds of the excitations; the controller is tuned on the first."""
    frictions: tuple[Friction, ...]
    """Friction coefficients of Table II."""
    samples: int
    straight_s: float
    turn_s: float


FIG10_SLOPE = int(paper.FIG10_SLOPE_DEG)
WHOLE = ReproducePlan(
    quick=False,
    slopes_deg=SLOPES_DEG,
    seeds=(0, 1),
    grounds=GROUNDS,
    frictions=FRICTIONS,
    samples=paper.SAMPLES,
    straight_s=paper.FIG9_DURATION_S,
    turn_s=paper.FIG10_DURATION_S,
)
QUICK = replace(WHOLE, quick=True, slopes_deg=(FIG10_SLOPE,), seeds=(0,), grounds=(CONTROLLER_GROUND,), frictions=(PAPER_FRICTION,))


def excitation(ground: Ground) -> Scenario:
    """Return the scenario of an excitation with random track speeds (Section VI.B)."""
    scenario = _flight(ground.slope_deg, heading_deg=0.0, duration_s=300.0, mismatch=0.005)
    return scenario.changed(stair={"friction": ground.friction})


def without_images(scenario: Scenario) -> Scenario:
    """Return the scenario with the statistical camera: heading and map with the stair detector's errors, nothing rendered."""
    return scenario.changed(sensors={"camera": scenario.sensors.camera_name, "model": "statistical"})


def turn(
    slope_deg: int, start_deg: int, duration_s: float, *, allocation: str = "climb-safe", friction: Friction = PAPER_FRICTION
) -> Scenario:
    """Return a start at ±30° (Fig. 10, Table II)."""
    scenario = _flight(slope_deg, heading_deg=float(start_deg), duration_s=duration_s, mismatch=0.005)
    return scenario.changed(stair={"friction": friction}, control={"allocation": allocation})


def straight(slope_deg: int, loop: str, duration_s: float) -> Scenario:
    """Return a start at 0° with a 2 % faster right belt (Fig. 9).

    The open loop looks at nothing, so no frames are rendered for it.
    """
    scenario = _flight(slope_deg, heading_deg=0.0, duration_s=duration_s, mismatch=0.02)
    # So wide that a drifting chair meets neither a wall nor the flight's side.
    stair = {"width_m": 40.0, "walls": "none"}
    return scenario.changed(stair=stair, control={"loop": loop, "vision": "truth" if loop == "open" else "robust"})


def _flight(slope_deg: int, *, heading_deg: float, duration_s: float, mismatch: float) -> Scenario:
    scenario = Scenario(
        stair=Stair.model_validate({"slope_deg": float(slope_deg), "run_m": 0.30, "width_m": 2.4}),
        chair=Chair(payload_kg=paper.PAYLOAD_KG, belt_mismatch=mismatch),
        start=Start(place="flight", step=6, heading_deg=heading_deg),
        drive=DriveSettings(speed_m_s=TABLE_SPEED_M_S, duration_s=duration_s),
        sensors=Sensors(gravity_error_deg=TILT_DEG),
    )
    return long_enough(scenario, duration_s, spare_m=6.0)
