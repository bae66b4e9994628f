"""Runs of the shipped plant on a wide flight or floor, from its log, and the Coulomb model's run from the same pose."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from oracles.dynamic_coulomb import dynamic_run

from treadline.core.angles import DEG
from treadline.core.ports import Truth
from treadline.core.rotations import rotation_of
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import NOMINAL, MujocoPlant, Physics, open_plant
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Chair, Scenario
from treadline.vehicle.bodies import centre_of_mass
from treadline.vehicle.quasi_static import QuasiStaticRun, SteadyMotion, stair_stance, steady_motion

TABLE_I = (0.62, 0.5)
RUN_M = 0.30
STILL = SeatCommand(t_s=0.0, rate_m_s=0.0)
TICKS_A_SECOND = 100


def plant_on(
    slope_deg: float = 28.0,
    friction: tuple[float, float] = TABLE_I,
    heading_deg: float = 0.0,
    *,
    seed: int = 1,
    physics: Physics = NOMINAL,
    description: ChairDescription | None = None,
    steps: int = 30,
    stair: Mapping[str, object] | None = None,
    start: Mapping[str, object] | None = None,
    tables: Mapping[str, object] | None = None,
    **chair: object,
) -> MujocoPlant:
    """Return a started plant on a wide flight, or in front of one where the slope is zero; ideal except for the given settings.

    ``description`` replaces the chair's file; ``stair``, ``start`` and keywords add to these tables of the scenario, ``tables`` has
    further ones.
    """
    rise = RUN_M * math.tan((slope_deg or 28.0) * DEG)
    flat: dict[str, object] = {"rise_m": rise, "steps": steps, "friction": friction, "width_m": 10.0, "walls": "none"}
    place = {"place": "flight", "step": 6, "heading_deg": heading_deg} if slope_deg else {"place": "floor"}
    scenario = Scenario.model_validate(
        {
            "stair": flat | dict(stair or {}),
            "chair": {"belt_mismatch": 0.0} | chair,
            "start": place | dict(start or {}),
            "control": {"vision": "truth"},
            **(tables or {}),
        }
    )
    plant = open_plant(scenario, seed, chair=description, physics=physics)
    plant.start()
    if not slope_deg:
        plant._data.qpos[0] -= 1.0  # a turn on the spot must not meet the first step
    return plant


def held(plant: MujocoPlant, left_m_s: float, right_m_s: float, until_s: float, *, brake: bool = False) -> list[Truth]:
    """Hold one command until a time and return the truth."""
    plant.write(TrackCommand(t_s=0.0, left_m_s=left_m_s, right_m_s=right_m_s, brake=brake), STILL)
    plant.advance(until_s)
    return list(plant.truth())


def heading_and_place(plant: MujocoPlant, row: np.void) -> tuple[float, float]:
    """Return heading and distance up the flight in the stair's frame at a row of the log."""
    pose = row["qpos"]
    R_SB = plant.staircase.R_WS.T @ rotation_of(np.ascontiguousarray(pose[3:7]))
    p_SB = plant.staircase.R_WS.T @ (pose[:3] - plant.staircase.p_WS)
    return math.atan2(R_SB[1, 0], R_SB[0, 0]), float(p_SB[0])


def theory_from(
    plant: MujocoPlant,
    row: np.void,
    slope_deg: float,
    friction: tuple[float, float],
    belts: tuple[float, float],
    duration_s: float,
) -> QuasiStaticRun:
    """Return the run of the Coulomb model with the chair's inertia that begins at a row of the plant's log."""
    slope = slope_deg * DEG
    heading, place = heading_and_place(plant, row)
    # A nosing is touched where its round bar's axis lies under the belt, a little up the slope from the sharp edge.
    edge_m = plant.staircase.nosing_radius_m * (math.cos(slope) - math.sin(slope))
    return dynamic_run(
        read_chair("wheelchair"),
        Chair(),
        slope,
        plant.staircase.pitch_m,
        friction,
        belts,
        duration_s,
        heading_rad=heading,
        nosing_ahead_m=edge_m - place,
    )


def heading_rad(plant: MujocoPlant, row: np.void) -> float:
    """Return the heading in the stair's frame, or on the floor in the world's, of which the stair's frame is tilted."""
    if plant._scenario.start.place != "floor":
        return heading_and_place(plant, row)[0]
    R_WB = rotation_of(np.ascontiguousarray(row["qpos"][3:7]))
    return math.atan2(R_WB[1, 0], R_WB[0, 0])


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantRun:
    """A run of the plant at one command, the start included."""

    plant: MujocoPlant
    log: np.ndarray
    """One record ``kernels.ROW`` per tick."""
    settle_s: float

    @property
    def settled(self) -> np.ndarray:
        """Rows after settling."""
        return self.log[round(self.settle_s * TICKS_A_SECOND) + 1 :]

    @property
    def begin(self) -> np.void:
        """Row at which settling ends."""
        return self.log[round(self.settle_s * TICKS_A_SECOND)]

    @property
    def duration_s(self) -> float:
        return len(self.settled) / TICKS_A_SECOND

    @property
    def yaw_deg_s(self) -> float:
        turned = heading_rad(self.plant, self.log[-1]) - heading_rad(self.plant, self.begin)
        return turned / self.duration_s / DEG

    @property
    def climb_m_s(self) -> float:
        went = heading_and_place(self.plant, self.log[-1])[1] - heading_and_place(self.plant, self.begin)[1]
        return went / self.duration_s

    @property
    def load(self) -> np.ndarray:
        """Largest sum of the normal forces in each tick, over the weight."""
        return self.settled["force_max"] / self.plant._weight_n

    @property
    def airborne(self) -> int:
        """Number of physics steps without contact."""
        return int(self.settled["airborne"].sum())


def plant_run(plant: MujocoPlant, belts: tuple[float, float], duration_s: float, settle_s: float = 1.0) -> PlantRun:
    """Hold one command from the start, and keep what is logged."""
    plant.write(TrackCommand(t_s=0.0, left_m_s=belts[0], right_m_s=belts[1]), STILL)
    plant.advance(settle_s + duration_s)
    return PlantRun(plant=plant, log=np.array([row for _, row in plant._pending]), settle_s=settle_s)


def over_a_pitch(slope_deg: float, friction: tuple[float, float], belts: tuple[float, float], heading: float = 0.0) -> SteadyMotion:
    """Return the quasi-static motion in 200 evenly spaced nosing phases."""
    slope, chair = slope_deg * DEG, read_chair("wheelchair")
    stance = stair_stance(chair, partial(centre_of_mass, chair, Chair()), slope, RUN_M / math.cos(slope), heading)
    return steady_motion(stance, friction, *belts)


def over_time(motion: SteadyMotion) -> tuple[float, float]:
    """Return speed along the belts and yaw rate averaged over time: a faster phase has a shorter duration."""
    along, yaw = (float(np.average(value, weights=1.0 / motion.climb_m_s)) for value in (motion.along_m_s, motion.yaw_rad_s))
    return along, yaw


def drift_rad(slope_deg: float, friction: tuple[float, float], belts: tuple[float, float], times_s: Sequence[float]) -> np.ndarray:
    """Return the heading that Coulomb friction gives a chair that starts square to the flight, averaged over the nosing phases.

    A pitch takes about 2 s, in which a chair of so small a yaw rate turns by less than 1.5°.
    """
    grid = np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0]) * DEG
    rates = [over_time(over_a_pitch(slope_deg, friction, belts, float(heading)))[1] for heading in grid]
    heading, headings, step_s = 0.0, [0.0], 0.1
    for _ in range(round(max(times_s) / step_s)):
        heading += step_s * float(np.interp(heading, grid, rates))
        headings.append(heading)
    return np.interp(times_s, step_s * np.arange(len(headings)), headings)
