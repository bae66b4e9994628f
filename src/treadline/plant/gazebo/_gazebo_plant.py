"""Chair in Gazebo 11: a ``TruthPlant`` with the actuators, sensors and seeds of the MuJoCo plant and ODE's contacts.

Mission time advances in ticks of 10 ms, ten steps of ODE each. gzserver moves the bodies; actuator, sensor and camera models are
those of the MuJoCo plant.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError, SimulationDiverged
from treadline.core.rotations import Rotation, Vector3, rotation_of
from treadline.core.signals import TICK_S
from treadline.plant.gazebo import _gzserver as server
from treadline.plant.gazebo._gzserver import NO_TURN_RULE, PLUGIN, Environment, find_environment
from treadline.plant.sensors._instruments import SETTLE_TICKS, ChairState, InstrumentedPlant
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Belts, Scenario
from treadline.vehicle.sdf import Lockstep, film_meshes, sdf_world
from treadline.vehicle.start_pose import standing

STEPS = 10
"""Number of 1 ms steps per tick."""
SETTLE_FRICTION = (1.0, 1.0)
"""Friction coefficients of the stair during settling; ODE uses the smaller of the two bodies' coefficients."""


class GazeboPlant(InstrumentedPlant):
    """Simulation of a chair, its stair and its sensors in a separate gzserver."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        chair: ChairDescription,
        environment: Environment,
        *,
        turn_rule: bool = True,
        film: Path | None = None,
    ) -> None:
        """Prepare a simulation; options as of ``open_gazebo``.

        Raises:
            SettingsError: If the scenario or the chair has what Gazebo cannot simulate.
        """
        _refuse_what_gazebo_cannot(scenario, chair)
        super().__init__(scenario, chair, seed)
        self._environment, self._film = environment, film
        self._plugin = PLUGIN if turn_rule else NO_TURN_RULE
        self._start = standing(self.staircase, chair.tracks, scenario.start)
        self._server: server.GazeboServer | None = None
        self._tick = 0
        self._flipper_rad = 0.0
        self._began_s = 0.0
        self._row = np.zeros(1, server.ANSWER)[0]
        self._pending: list[ChairState] = []

    def start(self) -> None:
        """Place the chair on its nosings in a new world, belts at rest, at ``t = 0``.

        Raises:
            GazeboError: If Gazebo does not start.
        """
        self.close()
        meshes = {} if self._film is None else film_meshes(self.staircase, self._chair, self._scenario.chair.leaning())
        self._server = server.GazeboServer(self._environment, self._world, meshes)
        self._flipper_rad = self._chair.tracks.approach_angle_deg * DEG
        self._drives.rest(self._start.seat_rad, self._flipper_rad)
        self._drives.command[:] = (0.0, 0.0, 1.0, 0.0, 0.0)
        rows = [self._step(SETTLE_FRICTION) for _ in range(SETTLE_TICKS)]
        self._drives.command[:] = 0.0
        self._tick = 0
        self._began_s = float(rows[-1]["t_s"])
        self._forget()
        first = self._state_of(rows[-2], rows[-1])
        self._row = rows[-1]
        self._instruments.start(first.velocity_W)
        self._pending = [first]

    def advance(self, until_s: float) -> None:
        """Step the world until ``until_s``.

        Raises:
            SimulationDiverged: If the state is not finite, or Gazebo's time is wrong.
            GazeboError: If gzserver has exited.
        """
        while self._tick < round(until_s / TICK_S):
            row = self._step(self.staircase.friction)
            self._tick += 1
            self._check(row)
            self._pending.append(self._state_of(self._row, row))
            self._row = row

    def close(self) -> None:
        """Stop gzserver, and keep its images."""
        if self._server is not None:
            images = self._server.close()
            self._server = None
            for t_s, image in images.items():
                if self._film is not None and t_s >= self._began_s:
                    (self._film / f"{t_s - self._began_s:08.2f}.jpg").write_bytes(image)

    def _world(self, port: int, folder: str) -> str:
        lockstep = Lockstep(plugin=f"/{self._plugin}", port=port, film=None if self._film is None else folder)
        return sdf_world(self.staircase, self._chair, self._scenario.chair.leaning(), start=self._start, lockstep=lockstep)

    def _step(self, friction: tuple[float, float]) -> np.void:
        if self._server is None:
            raise SettingsError("the Gazebo plant was not started; call start() first")
        self._drives.act(self._flipper_rad)
        joints = (self._drives.state[name] for name in ("seat_angle", "flipper_target", "flipper_rate"))
        row = self._server.step(np.array([STEPS, *self._drives.belts_m_s, *joints, *friction]))
        self._flipper_rad = float(row["flipper"])
        return row

    def _check(self, row: np.void) -> None:
        t_s = self._tick * TICK_S
        if not np.isfinite(np.hstack(row.item())).all():
            raise SimulationDiverged(f"the state is not finite at {t_s:.2f} s")
        if abs(float(row["t_s"]) - self._began_s - t_s) > 1e-6 * max(1.0, t_s):
            raise SimulationDiverged(f"Gazebo's clock is at {row['t_s'] - self._began_s:.3f} s where {t_s:.2f} s was asked for")

    def _state_of(self, before: np.void, row: np.void) -> ChairState:
        """Return the state at a tick, with velocities as differences over the tick.

        ODE's own velocities jump from step to step on a chair at rest: the correction of one contact's penetration deepens another.
        """
        p_WB, R_WB = _pose_of(row)
        p_before, R_before = _pose_of(before)
        turn = R_before.T @ R_WB
        return ChairState(
            tick=self._tick,
            p_WB=p_WB,
            R_WB=R_WB,
            velocity_W=(p_WB - p_before) / TICK_S,
            rate_B=np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (2.0 * TICK_S),
            seat_rad=float(row["seat"]),
            stroke_m=float(self._drives.state["stroke"]),
            belts_m_s=self._drives.belts_m_s,
            brake_on=bool(self._drives.state["braked"] > 0.5),
            flipper_rad=float(row["flipper"]),
            flipper_torque_n_m=float(row["flipper_torque"]),
            reach_m=row["reach"],
        )

    def _passed(self) -> Iterator[tuple[ChairState, float]]:
        pending, self._pending = self._pending, []
        for state in pending:
            yield state, 1.0


def _refuse_what_gazebo_cannot(scenario: Scenario, chair: ChairDescription) -> None:
    """Reject what this plant would ignore.

    Raises:
        SettingsError: If the chair has no seat linkage or further belts, belts have lugs, the passenger sways, or friction is not
            uniform.
    """
    stair = scenario.stair
    if chair.seat is None:
        raise SettingsError(f"chair {chair.name!r} has no seat linkage, whose joint the Gazebo plugin drives; use --plant mujoco")
    if chair.belt:
        raise SettingsError(
            f"chair {chair.name!r} has [[belt]] sections; Gazebo's plugin drives one pair of flippers; use --plant mujoco"
        )
    if scenario.belts != Belts():
        raise SettingsError("the Gazebo plant has smooth belts of its own stiffness; leave out [belts], or use MuJoCo's plant")
    if stair.side_slope_deg:
        raise SettingsError(f"stair.side_slope_deg is {stair.side_slope_deg:g}: Gazebo's stairs are level; use --plant mujoco")
    if scenario.chair.sways:
        raise SettingsError(f"chair.sway_m is {scenario.chair.sway_m}: in Gazebo the passenger sits still; use --plant mujoco")
    own = [step for step in scenario.step if step.friction or step.friction_left or step.friction_right]
    if own or {stair.friction_left, stair.friction_right, stair.floor_friction} - {None, stair.friction}:
        where = f"step {own[0].index}" if own else "stair.friction_left, friction_right or floor_friction"
        raise SettingsError(
            f"{where} has a friction of its own: in Gazebo the stair has one friction, {stair.friction}; use --plant mujoco"
        )


def _pose_of(row: np.void) -> tuple[Vector3, Rotation]:
    return row["position"], rotation_of(row["orientation"])


def open_gazebo(
    scenario: Scenario, seed: int = 0, *, chair: ChairDescription | None = None, turn_rule: bool = True, film: Path | None = None
) -> GazeboPlant:
    """Return a chair in Gazebo on the scenario's stair.

    Args:
        turn_rule: Whether the plugin takes yaw rates below 0.1 rad/s and speeds below 0.1 m/s for zero, as Gazebo's own does.
        film: Folder for the images of the run, named by their mission time [s]; None: Gazebo draws nothing.

    Raises:
        GazeboError: If Gazebo is not installed.
    """
    chair = scenario.read_chair() if chair is None else chair
    return GazeboPlant(scenario, seed, chair, find_environment(), turn_rule=turn_rule, film=film)
