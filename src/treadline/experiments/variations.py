"""One-at-a-time variations of the simulated chair, its stair and its numerics, each with a stated size.

A variation changes the plant alone: the mission keeps the nominal chair file and the weight that the operator entered, as in a
building where nobody has measured the friction.
"""

from dataclasses import dataclass
from functools import partial

from treadline.plant.mujoco import MujocoPlant
from treadline.plant.mujoco.physics import NOMINAL, Physics
from treadline.run.resolve import Opener
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """One change of the plant; factors of 1 and shifts of 0 change nothing."""

    name: str
    group: str
    """Source of uncertainty; the largest move of a group counts."""
    physics: Physics = NOMINAL
    friction: tuple[float, float] = (1.0, 1.0)
    """Factors on the friction along the belt and across."""
    chassis: float = 1.0
    """Factor on the mass of the chassis."""
    payload: float = 1.0
    """Factor on the passenger's mass; the operator entered the nominal one."""
    com_m: tuple[float, float] = (0.0, 0.0)
    """Shift of the centre of mass, chassis and passenger alike: forward and up."""
    lag: float = 1.0
    """Factor on the lag of the belts' drives."""
    lug_phase: float = 0.0
    """Shift of both belts' lugs along the belt, as a share of the lug pitch; no effect on smooth belts."""
    seed: int = 0

    def scenario(self, nominal: Scenario) -> Scenario:
        """Return the scenario on this friction with this passenger."""
        along, across = nominal.stair.friction
        stair = nominal.stair.model_copy(update={"friction": (along * self.friction[0], across * self.friction[1])})
        entered = nominal.chair.entered.payload_kg
        weight = {"payload_kg": nominal.chair.payload_kg * self.payload, "entered_payload_kg": entered}
        return nominal.model_copy(update={"stair": stair, "chair": nominal.chair.model_copy(update=weight)})

    def chair(self, model: str) -> ChairDescription:
        """Return the chair as it is, where its file gives the nominal one."""
        nominal = read_chair(model)
        forward_m, up_m = self.com_m

        def moved(place: tuple[float, float, float]) -> tuple[float, float, float]:
            return place[0] + forward_m, place[1], place[2] + up_m

        masses, seat, drives = nominal.masses, nominal.levelled_seat, nominal.drives
        heavier = {"chassis_kg": masses.chassis_kg * self.chassis, "chassis_com_m": moved(masses.chassis_com_m)}
        return nominal.model_copy(
            update={
                "masses": masses.model_copy(update=heavier),
                "seat": seat.model_copy(update={"payload_com_m": moved(seat.payload_com_m)}),
                "drives": drives.model_copy(update={"lag_s": drives.lag_s * self.lag}),
            }
        )

    def opener(self, model: str) -> Opener:
        """Return what makes the varied plant of a scenario and a seed."""
        return partial(_ShiftedLugsPlant, chair=self.chair(model), physics=self.physics, lug_phase=self.lug_phase)


class _ShiftedLugsPlant(MujocoPlant):
    """Plant whose lugs start further along the belts than the seed puts them."""

    def __init__(self, scenario: Scenario, seed: int, chair: ChairDescription, physics: Physics, lug_phase: float) -> None:
        super().__init__(scenario, seed, chair, physics)
        if self._lugs.numbers.size:
            pitch_m = scenario.belts.measures_m[1]
            self._lugs.start_m[:] = (self._lugs.start_m + lug_phase * pitch_m) % pitch_m


NOMINAL_VARIATION = Variation(name="nominal", group="nominal")
SEED_GROUP = "seed"
"""Another seed: sensor noise and uneven steps alone. A move that is no larger is no effect of its source; not in the sum."""
COARSE_GROUP = "coarse step"
"""A step of 5 ms, the largest that the contact's nominal time constant allows; not in the sum. Steps of 4 ms do not fill a tick."""
PARTS_OF_FRICTION = ("friction along", "friction across")
"""Parts of the group friction, in which both change together; not in the sum."""
LUG_GROUP = "lug phase"
"""Phase of the lugs, on runs with lugs alone; a quarter and half of the lug pitch."""
MASS, COM_M, FRICTION = 0.1, 0.02, 0.2


def _friction(group: str, along: bool, across: bool) -> tuple[Variation, ...]:
    return tuple(
        Variation(
            name=f"{group} {100.0 * change:+.0f} %",
            group=group,
            friction=(1.0 + change * along, 1.0 + change * across),
        )
        for change in (-FRICTION, FRICTION)
    )


VARIATIONS = (
    NOMINAL_VARIATION,
    Variation(name="step 1 ms", group="step", physics=Physics(timestep_s=0.001)),
    Variation(name="step 2.5 ms", group="step", physics=Physics(timestep_s=0.0025)),
    Variation(name="contact 0.005 s", group="stiffness", physics=Physics(contact_time_constant_s=0.005)),
    Variation(name="contact 0.02 s", group="stiffness", physics=Physics(contact_time_constant_s=0.02)),
    *_friction("friction", along=True, across=True),
    Variation(name="seed 1", group=SEED_GROUP, seed=1),
    Variation(name="seed 2", group=SEED_GROUP, seed=2),
    Variation(name="residual 0.001 m/s²", group="residual", physics=Physics(tolerance_m_s2=0.001)),
    Variation(name="residual 0.1 m/s²", group="residual", physics=Physics(tolerance_m_s2=0.1)),
    Variation(name="3 solves", group="solves", physics=Physics(max_solves=3)),
    Variation(name="20 solves", group="solves", physics=Physics(max_solves=20)),
    *(Variation(name=f"chassis {s * 10:+d} %", group="chassis mass", chassis=1.0 + s * MASS) for s in (-1, 1)),
    *(Variation(name=f"passenger {s * 10:+d} %", group="passenger mass", payload=1.0 + s * MASS) for s in (-1, 1)),
    *(Variation(name=f"centre of mass {s * 2:+d} cm along", group="centre along", com_m=(s * COM_M, 0.0)) for s in (-1, 1)),
    *(Variation(name=f"centre of mass {s * 2:+d} cm up", group="centre up", com_m=(0.0, s * COM_M)) for s in (-1, 1)),
    Variation(name="drive lag ×0.5", group="lag", lag=0.5),
    Variation(name="drive lag ×2", group="lag", lag=2.0),
    *_friction("friction along", along=True, across=False),
    *_friction("friction across", along=False, across=True),
    Variation(name="step 5 ms", group=COARSE_GROUP, physics=Physics(timestep_s=0.005)),
    Variation(name="lugs a quarter pitch on", group=LUG_GROUP, lug_phase=0.25),
    Variation(name="lugs half a pitch on", group=LUG_GROUP, lug_phase=0.5),
)
MAIN_SOURCES = ("step", "stiffness", "friction")
"""Sources that ``results.json`` shows next to each figure."""
SOURCES = tuple(dict.fromkeys(item.group for item in VARIATIONS if item is not NOMINAL_VARIATION))
SUMMED = tuple(group for group in SOURCES if group not in (SEED_GROUP, COARSE_GROUP, *PARTS_OF_FRICTION))
"""Independent sources, which enter the root sum of squares."""
QUICK_VARIATIONS = tuple(item for item in VARIATIONS if item.name in ("nominal", "step 2.5 ms", "contact 0.02 s", "friction +20 %"))
