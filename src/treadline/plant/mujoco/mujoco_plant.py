"""Simulated chair on a stair: a ``TruthPlant`` based on MuJoCo.

Mission time advances in ticks of 10 ms: belts and actuators change at ticks, sensors are sampled at ticks, physics runs in between.
All random numbers derive from the seed, with an independent stream per sensor, so that a change of one sensor leaves the others
unchanged.
"""

import copy
import ctypes
import math
from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float, Shaped

from treadline.core.angles import DEG
from treadline.core.errors import SettingsError, SimulationDiverged
from treadline.core.ports import Reading, Truth
from treadline.core.rotations import Rotation, Vector3, quaternion_of, rotation_of
from treadline.core.signals import TICK_S
from treadline.plant._actuators import FLIPPER_FRICTION_N_M_S_RAD
from treadline.plant._motors_and_battery_kernels import SEAT_MOTOR
from treadline.plant.faults._damage import OUT_OF_THE_WAY_M, Damage, Surroundings, with_box
from treadline.plant.mujoco import _step_kernels as kernels
from treadline.plant.mujoco._mjcf_scene import friction_table, model_xml, roughened, seat_stiffness
from treadline.plant.mujoco._native import contact_layout, contact_list, load_library, noslip_address, pointer_offsets
from treadline.plant.mujoco.contact._parameters import NOMINAL, Physics, fit_lugs
from treadline.plant.sensors._instruments import SETTLE_TICKS, SUPPORT_TICKS, ChairState, InstrumentedPlant, look
from treadline.plant.sensors.camera.solids import SceneBox
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription
from treadline.scenario.scenario import Scenario
from treadline.vehicle.bodies import SIDES, vehicle
from treadline.vehicle.staircase import up_W
from treadline.vehicle.start_pose import standing

SETTLE_FRICTION = 4.0
"""Friction coefficient during settling."""
CONTACTS_MAX = 128
"""Largest supported number of contacts."""


class MujocoPlant(InstrumentedPlant):
    """Simulation of a chair, its stair and its sensors."""

    def __init__(self, scenario: Scenario, seed: int, chair: ChairDescription, physics: Physics = NOMINAL) -> None:
        super().__init__(scenario, chair, seed)
        self._physics, self._substeps = physics, physics.substeps
        self._around = Surroundings(self.staircase, chair, self._camera, 1 if scenario.drive.direction == "up" else -1)
        self._state = self._drives.state
        self._damage = Damage()
        self._friction: Shaped[np.ndarray, " g"]
        self._sway: Shaped[np.ndarray, " s"]
        self._build_physics(self._physics_draws)
        self._settled: tuple[mujoco.MjData, Shaped[np.ndarray, ""], Shaped[np.ndarray, ""]] | None = None
        """Physics, actuators and battery at ``t = 0``, of the first start; None before it."""
        self._tick = 0
        self._pending: list[tuple[int, np.void]] = []

    @property
    def _seats(self) -> int:
        """Number of joints before that of the first flipper."""
        return 0 if self._chair.seat is None else 1

    def start(self) -> None:
        """Place the chair on its nosings, belts at rest, at ``t = 0``; a further start restores the state of the first."""
        self._model.opt.noslip_iterations = 0  # still active after a run that ended with the brake on
        self._model.geom_surfacevel[self._belts] = 0.0
        self._sway["phase"] = self._sway["omega"] = 0.0  # at rest until t = 0, at one end of the sway
        self._lugs.travel_m[:] = self._lugs.start_m
        if self._settled is None:
            self._pose()
            self.set_damage(Damage())
            self._settle()
            self._data.time = 0.0
            self._settled = copy.copy(self._data), self._drives.state.copy(), self._drives.electric.copy()
        else:
            data, self._state[...], self._drives.electric[...] = self._settled
            mujoco.mj_copyData(self._data, self._model, data)
            self.set_damage(Damage())
            self._drives.command[:] = 0.0
        self._sway["omega"] = math.tau / self._scenario.chair.sway_period_s
        self._tick = 0
        self._forget()
        self._instruments.start(self._data.qvel[:3].copy())
        self._row = self._log_row()
        self._pending = [(0, self._row)]

    def advance(self, until_s: float) -> None:
        """Step the physics until ``until_s``.

        Raises:
            SimulationDiverged: On a MuJoCo warning, time that does not advance, or a non-finite state.
        """
        ticks = round(until_s / TICK_S) - self._tick
        if ticks <= 0:
            return
        log = np.empty(ticks, kernels.ROW)
        self._run(ticks, log, self._friction)
        self._pending.extend(enumerate(log, start=self._tick + 1))
        self._tick, self._row = self._tick + ticks, log[-1]

    def drive(self, ticks: int) -> tuple[ChairState, Truth]:
        """Step the physics by some ticks; return state and ground truth of the last one.

        Readings and ground truth of the ticks are not kept: a loop of millions of steps needs constant memory.

        Raises:
            SimulationDiverged: As ``advance``.
        """
        log = np.empty(ticks, kernels.ROW)
        self._run(ticks, log, self._friction)
        self._tick, self._row = self._tick + ticks, log[-1]
        self._pending.clear()
        state = self.state
        return state, self._instruments.truth_of(state, 0.5 * sum(self._damage.grip))

    @property
    def state(self) -> ChairState:
        """State of the chair at the last tick."""
        return self._state_of(self._tick, self._row)

    def set_friction(self, friction: float) -> None:
        """Set one belt friction coefficient in all directions and on all ground, also beyond the range of a scenario's stair."""
        self._friction = roughened(self._friction, friction)

    def set_damage(self, damage: Damage) -> None:
        """Replace the present damage of the chair."""
        for flag in ("stalled", "power_cut", "seat_stuck", "flipper_stuck"):
            self._state[flag] = getattr(damage, flag)
        self._grip[self._belts] = np.array(damage.grip)[:, None]
        self._model.body_ipos[self._seat_body] = rest_m = self._payload_rest_m + self._chair.in_chair(damage.payload_m)
        self._sway["rest"] = rest_m[:2]  # the sway sets the centre of mass before the next step
        if self._chair.flipper is not None:
            self._state["flipper_lost"] = damage.flipper_lost
            limit = 0.0 if damage.flipper_lost else self._chair.flipper.torque_n_m
            self._model.actuator_forcerange[self._seats] = (-limit, limit)
            self._model.dof_damping[kernels.FLIPPER_QVEL + self._seats] = FLIPPER_FRICTION_N_M_S_RAD
        self._damage = damage
        self._around.change(damage, *self._pose_WB())
        if self._model.nmocap:
            box = self._around.box
            self._data.mocap_pos[0] = OUT_OF_THE_WAY_M if box is None else box.centre_W
            self._data.mocap_quat[0] = quaternion_of(np.eye(3) if box is None else box.R_WK)

    @property
    def obstacle(self) -> SceneBox | None:
        """Box in the path of the chair; None without an obstacle."""
        return self._around.box

    @property
    def gap_m(self) -> float | None:
        """Distance along the belts from the leading end to the obstacle [m]; None without an obstacle."""
        return self._around.gap_m(*self._pose_WB())

    def contacts(self) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Return points [m] and normal forces on the chair [N], both in W, of the loaded contacts in the last step.

        The run is not affected.
        """
        contact, force = self._data.contact, np.zeros(6)
        normal_n = np.empty(self._data.ncon)
        for number in range(self._data.ncon):
            mujoco.mj_contactForce(self._model, self._data, number, force)
            normal_n[number] = force[0]
        loaded = normal_n > 0.0
        # The normal points from the first geom to the second, and the force acts on the second.
        is_chair = self._model.body_rootid[self._model.geom_bodyid[contact.geom[loaded, 1]]] == 1
        sign = np.where(is_chair, 1.0, -1.0)
        return contact.pos[loaded], (sign * normal_n[loaded])[:, None] * contact.frame[loaded, :3]

    def close(self) -> None:
        """Do nothing; the plant holds no external resources."""

    def _build_physics(self, draws: np.random.Generator) -> None:
        load_library()
        stair, loading = self.staircase, self._scenario.chair.leaning()
        scene = model_xml(stair, self._chair, loading, self._physics, friction=stair.friction, paired=False)
        if any(fault.kind == "obstacle" for fault in self._scenario.fault):
            scene = with_box(scene)
        self._model = mujoco.MjModel.from_xml_string(scene)
        if self._scenario.stair.side_slope_deg:
            self._model.opt.gravity = -GRAVITY_M_S2 * up_W(self._scenario.stair)
        self._data = mujoco.MjData(self._model)
        parts = ["rear", "front", "nose", "flat", "approach"]
        parts += [f"wheel_{number}" for number in range(self._chair.tracks.road_wheels)]
        parts += [f"{section.name}{part}" for section in self._chair.belt for part in ("_axis", "_tip", "_run")]
        self._is_belt = np.zeros(self._model.ngeom, dtype=np.bool_)
        self._belts = np.array([[self._model.geom(f"{side}_{part}").id for part in parts] for side in SIDES])
        self._is_belt[self._belts] = True
        self._lugs = fit_lugs(self._scenario.belts, self._chair, self._model, self._belts, draws)
        self._grip = np.ones(self._model.ngeom)
        self._friction = friction_table(self._model, self.staircase)
        self._seat_body = self._model.body(vehicle(self._chair, self._scenario.chair).seat.name).id
        if self._model.body_sameframe[self._seat_body] == mujoco.mjtSameFrame.mjSAMEFRAME_BODY:
            # MuJoCo ignores the centre of mass of a body that was compiled with it at the origin.
            self._model.body_sameframe[self._seat_body] = mujoco.mjtSameFrame.mjSAMEFRAME_BODYROT
        self._payload_rest_m = self._model.body_ipos[self._seat_body].copy()
        loading, (x_m, y_m, _) = self._scenario.chair, self._model.body_ipos[self._seat_body]
        sway_m = self._chair.in_chair((*loading.sway_m, 0.0))[:2]
        sway = (0.0, 0.0, self._physics.timestep_s, self._model.body_mass[self._seat_body], sway_m, (x_m, y_m))
        self._sway = np.array([sway] if loading.sways else [], kernels.SWAY)
        self._corrected = np.array([True])
        """Whether contact forces are corrected to Coulomb's law; False keeps MuJoCo's convex solution, for comparison."""
        self._weight_n = float(self._model.body_subtreemass[1]) * GRAVITY_M_S2

    def _pose(self) -> None:
        tracks = self._chair.tracks
        start = standing(self.staircase, tracks, self._scenario.start)
        self._data.qpos[:3] = start.p_WB
        mujoco.mju_mat2Quat(self._data.qpos[3:7], np.ascontiguousarray(start.R_WB).ravel())
        rest = tracks.approach_angle_deg * DEG
        self._drives.rest(start.seat_rad, rest)
        for number, limits in enumerate(self._drives.flipper, start=self._seats):
            angle_rad = rest if limits["follows"] else limits["stays"]
            self._data.qpos[kernels.FLIPPER_QPOS + number] = self._data.ctrl[number] = angle_rad
        if self._chair.seat is not None:
            self._data.qpos[kernels.SEAT_QPOS] = self._data.ctrl[0] = start.seat_rad

    def _pose_WB(self) -> tuple[Rotation, Vector3]:
        return rotation_of(self._data.qpos[3:7]), self._data.qpos[:3].copy()

    def _settle(self) -> None:
        mujoco.mj_forward(self._model, self._data)
        self._attach()
        self._drives.command[:] = (0.0, 0.0, 1.0, 0.0, 0.0)
        log = np.empty(SETTLE_TICKS, kernels.ROW)
        self._run(SETTLE_TICKS, log, roughened(self._friction, SETTLE_FRICTION))
        self._settled_reach = log["support"][-SUPPORT_TICKS:].max(axis=0)
        self._data.qvel[:] = 0.0
        self._drives.command[:] = 0.0

    def _attach(self) -> None:
        """Map arrays onto MuJoCo's memory for the compiled loop; all addresses, including the contact list, are constant."""
        layout = contact_layout()
        # A chair may start slightly above the stair without contact; it falls until the first contact.
        for _ in range(200):
            if self._data.ncon > 0:
                break
            mujoco.mj_step(self._model, self._data)
        belt_side = np.full(self._model.ngeom, -1)
        belt_side[self._belts] = [[0], [1]]
        base, data, model = contact_list(self._data), self._data, self._model
        self._memory = (
            np.uintp(model._address),  # noqa: SLF001 - the binding's only way to the struct
            np.uintp(data._address),  # noqa: SLF001 - as above
            _view(data._address + layout.count_offset, 1, 1, np.int32)[0],  # noqa: SLF001 - as above
            _view(base, CONTACTS_MAX, layout.stride // 8, np.float64),
            _view(base, CONTACTS_MAX, layout.stride // 4, np.int32),
            np.array([layout.frame // 8, layout.friction // 8, layout.surfacevel // 8, layout.geom // 4, layout.efc_address // 4]),
            (
                self._corrected,
                _view(noslip_address(model), 1, 1, np.int32)[0],
                tuple(_view(data._address + offset, 1, 1, np.uint64)[0] for offset in pointer_offsets()),  # noqa: SLF001 - as above
                data.qacc,
                data.qacc_warmstart,
                np.zeros((CONTACTS_MAX, 2)),
            ),
            (self._lugs.parameters, self._lugs.travel_m, self._lugs.part_of, self._chair.tracks.approach_angle_deg * DEG),
            self._is_belt,
            data.xmat[1],
            self._grip,
            self._drives.command,
            self._drives.limits,
            self._drives.mismatch,
            self._state[()],
            self._belts,
            model.geom_surfacevel,
            # A lug's contact lies midway between its foot and its tip.
            np.where(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX, 0.0, model.geom_size[:, 0] + 0.5 * self._lugs.parameters.height),
            self._drives.seat,
            self._drives.angles,
            self._drives.flipper,
            model.dof_damping,
            data.actuator_force,
            data.ctrl,
            data.qpos,
            data.qvel,
            data.warning.number,
            self._sway,
            model.body_ipos[self._seat_body],
            data.xfrc_applied[self._seat_body],
            data.xmat[self._seat_body],
            self._substeps,
            (self._physics.tolerance_m_s2, self._physics.max_solves),
            belt_side,
            self._drives.motor,
            self._drives.electric[()],
            self._seat_actuator(),
            model.actuator_forcerange,
        )

    def _seat_actuator(self) -> Shaped[np.ndarray, " n"]:
        """Return the limits of the seat actuator for the compiled loop, one record; none without limits."""
        seat = self._chair.seat
        if (
            seat is None
            or seat.push_n is None
            or seat.no_load_m_s is None
            or seat.hold_n is None
            or not self._scenario.realism.motor_limits
        ):
            return np.zeros(0, SEAT_MOTOR)
        self._model.actuator_forcelimited[0] = True
        stiffness, damping = seat_stiffness(vehicle(self._chair, self._scenario.chair).seat)
        return np.array([(seat.push_n, seat.no_load_m_s, seat.hold_n, stiffness, damping / stiffness)], SEAT_MOTOR)

    def _run(self, ticks: int, log: Shaped[np.ndarray, " n"], friction: Shaped[np.ndarray, " g"]) -> None:
        """Run the physics and check the result.

        Raises:
            SimulationDiverged: If the result is numerically invalid.
        """
        began_s = self._data.time
        expected_s = began_s + ticks * self._substeps * self._physics.timestep_s
        fault = kernels.advance(ticks, friction, log, log.view(np.float64), *self._memory)
        in_time = abs(self._data.time - expected_s) <= 1e-6 * max(1.0, expected_s)
        if fault == kernels.SOUND and in_time:
            return
        where = f"at {self._tick * TICK_S:.2f}…{(self._tick + ticks) * TICK_S:.2f} s"
        if fault == kernels.WARNED:
            numbers = np.flatnonzero(self._data.warning.number)
            warned = [str(mujoco.mjtWarning(i).name) for i in numbers if i < len(self._data.warning)]
            raise SimulationDiverged(f"MuJoCo warned of {', '.join(warned)} {where}")
        if fault == kernels.NOT_FINITE:
            raise SimulationDiverged(f"the state is not finite {where}")
        if not in_time:
            raise SimulationDiverged(f"time went from {began_s:.3f} s to {self._data.time:.3f} s {where}")
        raise SimulationDiverged(f"more than {CONTACTS_MAX} contacts {where}")

    def _log_row(self) -> np.void:
        row: np.void = np.zeros(1, kernels.ROW)[0]
        row["qpos"][: 7 + self._seats] = self._data.qpos[: 7 + self._seats]
        row["qvel"][: 6 + self._seats] = self._data.qvel[: 6 + self._seats]
        row["seat"], row["support"] = self._state["stroke"], self._settled_reach
        row["rotation"] = rotation_of(self._data.qpos[3:7])
        if self._chair.flipper is not None:
            row["flipper"] = self._data.qpos[kernels.FLIPPER_QPOS + self._seats]
            row["flipper_torque"] = self._data.actuator_force[self._seats]
        return row

    def _passed(self) -> Iterator[tuple[ChairState, float]]:
        pending, self._pending = self._pending, []
        grip = 0.5 * sum(self._damage.grip)
        for tick, row in pending:
            yield self._state_of(tick, row), grip

    def _state_of(self, tick: int, row: np.void) -> ChairState:
        pose, velocity = row["qpos"], row["qvel"]
        return ChairState(
            tick=tick,
            p_WB=pose[:3],
            R_WB=row["rotation"],
            velocity_W=velocity[:3],
            rate_B=velocity[3:6],
            seat_rad=float(pose[7]),
            stroke_m=float(row["seat"]),
            belts_m_s=row["belts"],
            brake_on=bool(row["brake"] > 0.5),
            flipper_rad=float(row["flipper"]),
            flipper_torque_n_m=float(row["flipper_torque"]),
            reach_m=row["support"],
            contact_force_share=float(row["force_max"]) / self._weight_n,
            airborne_share=float(row["airborne"]) / self._substeps,
            contact_residual_m_s2=float(row["residual"]),
            hull_contacts=int(row["hull"]),
            traction_n=row["traction"],
            power_w=float(row["power"]),
            payload_shift_m=self._chair.in_chair(self._damage.payload_m),
        )

    def _look(self, state: ChairState) -> Sequence[Reading]:
        return [self._around.with_obstacle(seen, state.R_WB, state.p_WB) for seen in look(self._around.camera, state)]


def _view(address: int, rows: int, columns: int, kind: Any) -> np.ndarray:
    """Return an array mapped onto MuJoCo's memory."""
    size = rows * columns * np.dtype(kind).itemsize
    return np.frombuffer((ctypes.c_char * size).from_address(address), dtype=kind).reshape(rows, columns)


def open_plant(
    scenario: Scenario, seed: int = 0, *, chair: ChairDescription | None = None, physics: Physics = NOMINAL
) -> MujocoPlant:
    """Return a simulated chair on the scenario's stair.

    Args:
        chair: Actual chair, if different from the scenario's chair file used by the mission.
        physics: Step size and contact stiffness.

    Raises:
        SettingsError: If the argument is a scenario name instead of a Scenario.
    """
    if not isinstance(scenario, Scenario):
        raise SettingsError(f"open_plant is given {scenario!r}; wanted a Scenario: read_scenario returns one for a name or file")
    return MujocoPlant(scenario, seed, scenario.read_chair() if chair is None else chair, physics)
