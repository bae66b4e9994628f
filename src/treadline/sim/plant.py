"""The simulated chair on its stair: a ``TruthPlant`` on MuJoCo.

Mission time runs in ticks of 10 ms: belts and actuators change at ticks, sensors are sampled at ticks, physics runs in
between. All chance comes from the seed; each sensor has a stream of its own, so that one may change without the others.
"""

import ctypes
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from jaxtyping import Float

from treadline.angles import DEG, quaternion_of, rotation_of, rotation_y, rotation_z
from treadline.devices.imu import IMUS, TICK_S, Imu
from treadline.devices.statistical import StatisticalCamera
from treadline.errors import SimulationDiverged
from treadline.mechanics.chair import Arm, ChairDescription, read_chair
from treadline.mechanics.linkage import SeatLinkage
from treadline.mechanics.stability import centre_of_mass
from treadline.mechanics.staircase import Staircase, build_staircase
from treadline.mechanics.tipping import Support, tipping_margins
from treadline.mechanics.traction import friction_use
from treadline.ports import Truth
from treadline.scenario import Scenario
from treadline.signals import (
    ArmCommand,
    ArmReading,
    FrameQuality,
    ImuSample,
    Reading,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.sim import kernels
from treadline.sim.camera import Camera
from treadline.sim.faults.damage import Damage
from treadline.sim.faults.things import OUT_OF_THE_WAY_M, Surroundings, with_box
from treadline.sim.native import contact_layout, contact_list, load_library
from treadline.sim.scene import ARM_FRICTION_N_M_S_RAD, ARM_LAG_S, ARM_STIFFNESS_N_M_RAD, TIMESTEP_S, scene_xml

CAMERA_TICKS = 10
CAMERA_PERIOD_S = CAMERA_TICKS * TICK_S
"""Table I: 10 Hz."""
BRAKE_M_S2 = 10.0
"""Deceleration of a belt when the brake falls in."""
SETTLE_S = 1.0
"""Physics before t = 0, on a stair of high friction, until the chair rests on its nosings."""
SETTLE_FRICTION = 4.0
SUPPORT_TICKS = 25
"""How long a contact counts as support: on a rocking chair contacts come and go, in a quarter of a second it drives 5 cm."""
ROCKING_M = 0.015
"""Between a nosing and the belts, at which it still counts as support: the chair tips onto it within a degree and a half."""
FLOOR_START_M, LANDING_START_M, LANDING_SPARE_M = 1.0, 0.6, 0.1
"""Of the nearer pulley from the first nosing or the edge at the start, and what of a short landing stays free behind the chair."""
SEAT_PITCH_NOISE_RAD = 0.05 * DEG
ARM_TORQUE_NOISE_N_M = 2.0
"""Of the torque that the arm's drive tells from its current: 1 % of full torque."""
CONTACTS_MAX = 128
TABLE_SIZE = 257


class MujocoPlant:
    """A chair, its stair and its sensors."""

    def __init__(self, scenario: Scenario, seed: int, chair: ChairDescription) -> None:
        streams = np.random.default_rng(seed).spawn(6)
        self._scenario = scenario
        self._chair = chair
        self.staircase: Staircase = build_staircase(scenario.stair, streams[0])
        gravity_error = scenario.sensors.gravity_error_deg * DEG
        self._imu = Imu(IMUS[scenario.sensors.imu], gravity_error, streams[1])
        self._seat_rng = streams[2]
        self._vision_rng = streams[3]
        way = 1 if scenario.drive.direction == "up" else -1
        self._around = Surroundings(self.staircase, chair, self._camera(streams[4]), way)
        self._arm_rng = streams[5]
        self._linkage = SeatLinkage(chair.seat)
        self._R_SW = self.staircase.R_WS.T
        self._nosings_W = self.staircase.nosings_W
        self._damage = Damage()
        self._build_physics()
        self._tick = 0
        self._pending: list[tuple[int, Float[np.ndarray, " c"]]] = []
        self._readings: list[Reading] = []
        self._truth: list[Truth] = []
        self._command = np.zeros(5)
        self._velocity_W = np.zeros(3)
        self._reaches: deque[Float[np.ndarray, " 4"]] = deque(maxlen=SUPPORT_TICKS)

    def start(self) -> None:
        """Put the chair on its nosings, belts at rest, at ``t = 0``."""
        mujoco.mj_resetData(self._model, self._data)
        self._model.geom_surfacevel[self._belts] = 0.0
        self._pose()
        self.suffer(Damage())
        self._settle()
        self._data.time = 0.0
        self._tick = 0
        self._readings.clear()
        self._truth.clear()
        self._reaches.clear()
        self._velocity_W = self._data.qvel[:3].copy()
        self._pending = [(0, self._log_row())]

    def advance(self, until_s: float) -> None:
        """Step the physics until ``until_s``.

        Raises:
            SimulationDiverged: On a warning of MuJoCo, time that does not advance, or a state that is not finite.
        """
        ticks = round(until_s / TICK_S) - self._tick
        if ticks <= 0:
            return
        log = np.empty((ticks, kernels.COLUMNS))
        self._run(ticks, log, self._friction)
        self._check(ticks, log)
        self._pending.extend(enumerate(log, start=self._tick + 1))
        self._tick += ticks

    def read(self) -> Sequence[Reading]:
        """Return the samples since the last call, in time order."""
        self._sense()
        readings, self._readings = self._readings, []
        return readings

    def write(self, tracks: TrackCommand, seat: SeatCommand, arm: ArmCommand | None = None) -> None:
        """Take the commands; they hold until the next call."""
        rate = 0.0 if arm is None else arm.rate_rad_s
        command = (tracks.left_m_s, tracks.right_m_s, float(tracks.brake), seat.rate_m_s, rate)
        if not all(math.isfinite(value) for value in command):
            raise SimulationDiverged(f"a command is not finite at {tracks.t_s:.2f} s: {command}")
        self._command[:] = command

    def truth(self) -> Sequence[Truth]:
        """Return the truth of every tick since the last call."""
        self._sense()
        truth, self._truth = self._truth, []
        return truth

    def lose_arm_motor(self) -> None:
        """Let the arm's motor die: no torque from now on, and the damping of its shorted windings."""
        self.suffer(replace(self._damage, arm_lost=True))

    def suffer(self, damage: Damage) -> None:
        """Be as broken as this from now on, and no more."""
        self._state[kernels.STALLED : kernels.STALLED + 2] = damage.stalled
        self._state[kernels.POWER_CUT] = damage.power_cut
        self._state[kernels.SEAT_STUCK] = damage.seat_stuck
        self._state[kernels.ARM_STUCK] = damage.arm_stuck
        self._grip[self._belts] = np.array(damage.grip)[:, None]
        if self._chair.arm is not None:
            self._state[kernels.ARM_LOST] = damage.arm_lost
            limit = 0.0 if damage.arm_lost else self._chair.arm.torque_n_m
            self._model.actuator_forcerange[kernels.ARM_SERVO] = (-limit, limit)
            self._model.dof_damping[kernels.ARM_QVEL] = ARM_FRICTION_N_M_S_RAD
        self._damage = damage
        self._around.change(damage, *self._whereabouts())
        if self._model.nmocap:
            box = self._around.box
            self._data.mocap_pos[0] = OUT_OF_THE_WAY_M if box is None else box.centre_W
            self._data.mocap_quat[0] = quaternion_of(np.eye(3) if box is None else box.R_WK)

    @property
    def gap_m(self) -> float | None:
        """From the leading end to what stands in the way, along the belts; None where nothing does."""
        return self._around.gap_m(*self._whereabouts())

    @property
    def passenger_height_m(self) -> float:
        """Of the payload's centre above the floor, now: what comfort is judged by."""
        return float(self._data.body("seat").xipos[2])

    def close(self) -> None:
        """Nothing is held open."""

    def _camera(self, rng: np.random.Generator) -> Camera | StatisticalCamera:
        sensors, stair, vision = self._scenario.sensors, self._scenario.stair, self._scenario.control.vision
        calibration = self._chair.camera_at(sensors.image_height_px, rear=self._scenario.drive.direction == "down")
        if vision == "truth" or sensors.camera == "statistical":
            return StatisticalCamera(self.staircase, calibration, self._vision_rng, exact=vision == "truth")
        return Camera(self.staircase, calibration, kind=sensors.camera, texture=stair.texture, light=stair.light, rng=rng)

    def _build_physics(self) -> None:
        load_library()
        chair, drives, seat = self._chair, self._chair.drives, self._chair.seat
        scene = scene_xml(self.staircase, chair, self._scenario.chair)
        if any(fault.kind == "obstacle" for fault in self._scenario.fault):
            scene = with_box(scene)
        self._model = mujoco.MjModel.from_xml_string(scene)
        self._data = mujoco.MjData(self._model)
        self._is_belt = np.zeros(self._model.ngeom, dtype=np.bool_)
        self._belts = np.array(
            [
                [self._model.geom(f"{side}_{part}").id for part in ("rear", "front", "nose", "flat", "approach")]
                for side in ("left", "right")
            ]
        )
        self._is_belt[self._belts] = True
        self._grip = np.ones(self._model.ngeom)
        self._friction = np.array(self.staircase.friction)
        self._mismatch = np.array([0.0, self._scenario.chair.belt_mismatch])
        self._drives = np.array(
            [
                drives.max_speed_m_s,
                1.0 - math.exp(-TICK_S / drives.lag_s),
                drives.max_acceleration_m_s2 * TICK_S,
                BRAKE_M_S2 * TICK_S,
                1.0 - math.exp(-TICK_S / seat.lag_s),
                seat.max_rate_m_s,
            ]
        )
        low, high = self._linkage.stroke_range
        strokes = np.linspace(low, high, TABLE_SIZE)
        self._seat = np.array([low, high, strokes[1] - strokes[0]])
        self._angles = np.array([self._linkage.angle(float(stroke)) for stroke in strokes])
        self._state = np.zeros(kernels.DRIVES)
        self._arm = np.array([]) if chair.arm is None else _arm_limits(chair.arm)

    def _pose(self) -> None:
        scenario, tracks = self._scenario, self._chair.tracks
        heading = scenario.start.heading_deg * DEG
        slope = self.staircase.slope_rad if scenario.start.place == "flight" else 0.0
        R_WB = rotation_y(-slope) @ rotation_z(heading)
        along = 0.5 * tracks.flat_run_m * math.cos(heading)
        if scenario.start.place == "flight":
            step = self.staircase.steps[scenario.start.step]
            radius = self.staircase.nosing_radius_m
            # The nosing plane touches the rounded nosings a little below their sharp edges.
            drop = radius * (math.sin(slope) + math.cos(slope) - 1.0)
            p_WS = np.array([step.x_m, 0.0, step.z_m])
            p_WB = p_WS + self.staircase.R_WS @ np.array([-along, scenario.start.lateral_m, 0.001 - drop])
        elif scenario.start.place == "floor":
            p_WB = np.array([-along - FLOOR_START_M, scenario.start.lateral_m, 0.001])
        else:
            top = self.staircase.steps[-1]
            room = self.staircase.landing_m - tracks.flat_run_m - LANDING_SPARE_M
            p_WB = np.array([top.x_m + along + min(max(room, 0.2), LANDING_START_M), scenario.start.lateral_m, top.z_m + 0.001])
        self._set_pose(p_WB, R_WB)
        angle = slope if scenario.start.seat == "level" else 0.0
        self._state[:] = 0.0
        if self._chair.arm is not None:
            rest = tracks.approach_angle_deg * DEG
            self._state[kernels.ARM_TARGET] = self._data.qpos[kernels.ARM_QPOS] = rest
            self._data.ctrl[kernels.ARM_SERVO] = rest
        self._state[kernels.STROKE] = self._linkage.stroke(angle)
        self._data.qpos[7] = angle
        self._data.ctrl[0] = angle

    def _whereabouts(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
        return rotation_of(self._data.qpos[3:7]), self._data.qpos[:3].copy()

    def _set_pose(self, p_WB: Float[np.ndarray, " 3"], R_WB: Float[np.ndarray, "3 3"]) -> None:
        self._data.qpos[:3] = p_WB
        mujoco.mju_mat2Quat(self._data.qpos[3:7], np.ascontiguousarray(R_WB).ravel())

    def _settle(self) -> None:
        mujoco.mj_forward(self._model, self._data)
        self._attach()
        self._command = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
        ticks = round(SETTLE_S / TICK_S)
        log = np.empty((ticks, kernels.COLUMNS))
        self._run(ticks, log, np.full(2, SETTLE_FRICTION))
        self._check(ticks, log)
        self._settled_reach = log[-SUPPORT_TICKS:, kernels.SUPPORT : kernels.SUPPORT + 4].max(axis=0)
        self._data.qvel[:] = 0.0
        self._command[:] = 0.0

    def _attach(self) -> None:
        """Lay arrays over MuJoCo's contact list, which stays where it is."""
        layout = contact_layout()
        # A chair that starts a hair above the stair touches nothing yet: let it fall until it does.
        for _ in range(200):
            if self._data.ncon > 0:
                break
            mujoco.mj_step(self._model, self._data)
        base = contact_list(self._data)
        self._count = _view(self._data._address + layout.count_offset, 1, 1, np.int32)[0]  # noqa: SLF001 - the binding's only way
        self._real = _view(base, CONTACTS_MAX, layout.stride // 8, np.float64)
        self._whole = _view(base, CONTACTS_MAX, layout.stride // 4, np.int32)
        self._layout = np.array([layout.frame // 8, layout.friction // 8, layout.surfacevel // 8, layout.geom // 4])

    def _run(self, ticks: int, log: Float[np.ndarray, "n c"], friction: Float[np.ndarray, " 2"]) -> None:
        data, model = self._data, self._model
        self._began_s = data.time
        kernels.advance(
            np.uintp(model._address),  # noqa: SLF001 - the binding's only way to the struct
            np.uintp(data._address),  # noqa: SLF001 - as above
            ticks,
            self._count,
            self._real,
            self._whole,
            self._layout,
            self._is_belt,
            data.xmat[1],
            friction,
            self._grip,
            self._command,
            self._drives,
            self._mismatch,
            self._state,
            self._belts,
            model.geom_surfacevel,
            self._chair.tracks.pulley_radius_m,
            self._seat,
            self._angles,
            self._arm,
            model.dof_damping,
            data.actuator_force,
            data.ctrl,
            data.qpos,
            data.qvel,
            log,
        )

    def _check(self, ticks: int, log: Float[np.ndarray, "n c"]) -> None:
        where = f"at {self._tick * TICK_S:.2f}…{(self._tick + ticks) * TICK_S:.2f} s"
        warned = [str(mujoco.mjtWarning(i).name) for i in np.flatnonzero(self._data.warning.number) if i < len(self._data.warning)]
        if warned:
            raise SimulationDiverged(f"MuJoCo warned of {', '.join(warned)} {where}")
        if not np.isfinite(log).all():
            raise SimulationDiverged(f"the state is not finite {where}")
        began = self._began_s
        expected = began + ticks * kernels.SUBSTEPS * TIMESTEP_S
        if abs(self._data.time - expected) > 1e-6 * max(1.0, expected):
            raise SimulationDiverged(f"time went from {began:.3f} s to {self._data.time:.3f} s {where}")
        if log[:, kernels.CONTACTS].max() > CONTACTS_MAX:
            raise SimulationDiverged(f"more than {CONTACTS_MAX} contacts {where}")

    def _log_row(self) -> Float[np.ndarray, " c"]:
        row = np.zeros(kernels.COLUMNS)
        row[kernels.QPOS : kernels.QPOS + 8] = self._data.qpos[:8]
        row[kernels.QVEL : kernels.QVEL + 7] = self._data.qvel[:7]
        row[kernels.SEAT] = self._state[kernels.STROKE]
        row[kernels.SUPPORT : kernels.SUPPORT + 4] = self._settled_reach
        if self._chair.arm is not None:
            row[kernels.ARM] = self._data.qpos[kernels.ARM_QPOS]
            row[kernels.ARM_TORQUE] = self._data.actuator_force[kernels.ARM_SERVO]
        return row

    def _sense(self) -> None:
        """Turn the states not yet looked at into truth and sensor samples, in time order."""
        for tick, row in self._pending:
            self._record(tick, row)
        self._pending.clear()

    def _record(self, tick: int, row: Float[np.ndarray, " c"]) -> None:
        t_s = tick * TICK_S
        R_WB = rotation_of(row[kernels.QPOS + 3 : kernels.QPOS + 7])
        truth = self._truth_of(t_s, row, R_WB)
        self._truth.append(truth)
        self._readings.append(self._imu_sample(t_s, row, R_WB))
        pitch = truth.seat_pitch_rad + SEAT_PITCH_NOISE_RAD * float(self._seat_rng.standard_normal())
        self._readings.append(SeatReading(t_s=t_s, pitch_rad=pitch, stroke_m=float(row[kernels.SEAT])))
        belts = row[kernels.BELTS : kernels.BELTS + 2] / (1.0 + self._mismatch)
        self._readings.append(
            TrackReading(t_s=t_s, left_m_s=float(belts[0]), right_m_s=float(belts[1]), brake_on=bool(row[kernels.BRAKE] > 0.5))
        )
        if self._chair.arm is not None:
            torque = float(row[kernels.ARM_TORQUE]) + ARM_TORQUE_NOISE_N_M * float(self._arm_rng.standard_normal())
            self._readings.append(ArmReading(t_s=t_s, angle_rad=float(row[kernels.ARM]), torque_n_m=torque))
        if tick % CAMERA_TICKS == 0:
            self._readings.extend(self._look(t_s, row, R_WB))

    def _imu_sample(self, t_s: float, row: Float[np.ndarray, " c"], R_WB: Float[np.ndarray, "3 3"]) -> ImuSample:
        velocity = row[kernels.QVEL : kernels.QVEL + 3]
        acceleration = (velocity - self._velocity_W) / TICK_S
        self._velocity_W = velocity
        moving = bool(abs(row[kernels.BELTS]) + abs(row[kernels.BELTS + 1]) > 0.01)
        rate_B = row[kernels.QVEL + 3 : kernels.QVEL + 6]
        return self._imu.sample(t_s, R_WB, rate_B, acceleration, moving=moving)

    def _look(self, t_s: float, row: Float[np.ndarray, " c"], R_WB: Float[np.ndarray, "3 3"]) -> Sequence[Reading]:
        p_WB = row[kernels.QPOS : kernels.QPOS + 3]
        eye = self._around.eye
        if isinstance(eye, StatisticalCamera):
            arrived = FrameQuality(t_s=t_s, fingerprint=round(t_s / TICK_S), brightness=0.5, contrast=0.2, valid_share=1.0)
            return [arrived, *(self._around.told(seen, R_WB, p_WB) for seen in eye.look(t_s, R_WB, p_WB))]
        camera = eye.calibration
        return [eye.frame(t_s, R_WB @ camera.R_BC, p_WB + R_WB @ np.array(camera.mount_m))]

    def _support_of(self, row: Float[np.ndarray, " c"], R_WB: Float[np.ndarray, "3 3"]) -> Support:
        """Return what the chair stands on: what it touched of late, and nosings under its belts that it rocks onto in a moment."""
        reach = row[kernels.SUPPORT : kernels.SUPPORT + 4]
        self._reaches.append(reach)
        front, rear, left, right = (float(most) for most in np.max(self._reaches, axis=0))
        x, z = ((self._nosings_W - row[kernels.QPOS : kernels.QPOS + 3]) @ R_WB[:, [0, 2]]).T
        under = x[(np.abs(z) < ROCKING_M) & (np.abs(x) < 0.5 * self._chair.tracks.flat_run_m)]
        if under.size:
            front, rear = max(front, float(under.max())), max(rear, -float(under.min()))
        return Support(front_m=front, rear_m=rear, left_m=left, right_m=right)

    def _grip_left(self) -> tuple[float, float]:
        share = 0.5 * sum(self._damage.grip)
        return self.staircase.friction[0] * share, self.staircase.friction[1] * share

    def _truth_of(self, t_s: float, row: Float[np.ndarray, " c"], R_WB: Float[np.ndarray, "3 3"]) -> Truth:
        R_SB = self._R_SW @ R_WB
        p_SB = self._R_SW @ (row[kernels.QPOS : kernels.QPOS + 3] - self.staircase.p_WS)
        rate_B = row[kernels.QVEL + 3 : kernels.QVEL + 6]
        angle = float(row[kernels.QPOS + 7])
        # About the chair's own z: the nosing plane's normal on the flight, gravity on floor and landing.
        heading = math.atan2(R_SB[1, 0], R_SB[1, 1])
        pitch = math.asin(max(-1.0, min(1.0, R_WB[2, 0])))
        roll = math.asin(max(-1.0, min(1.0, R_WB[2, 1])))
        return Truth(
            t_s=t_s,
            heading_rad=heading,
            yaw_rad=math.atan2(R_WB[1, 0], R_WB[0, 0]),
            heading_rate_rad_s=float(R_SB[2] @ rate_B),
            pitch_rad=pitch,
            roll_rad=roll,
            pitch_rate_rad_s=-float(rate_B[1]),
            x_m=float(p_SB[0]),
            y_m=float(p_SB[1]),
            seat_pitch_rad=math.asin(max(-1.0, min(1.0, R_WB[2, 0] * math.cos(angle) - R_WB[2, 2] * math.sin(angle)))),
            left_m_s=float(row[kernels.BELTS]),
            right_m_s=float(row[kernels.BELTS + 1]),
            stability_margin_rad=tipping_margins(
                centre_of_mass(self._chair, self._scenario.chair, angle, float(row[kernels.ARM])),
                (float(R_WB[2, 0]), float(R_WB[2, 1]), float(R_WB[2, 2])),
                self._support_of(row, R_WB),
            ).worst,
            friction_use=friction_use(self.staircase.slope_rad, heading, self._grip_left()),
        )


def _arm_limits(arm: Arm) -> Float[np.ndarray, " n"]:
    """Return the arm's numbers as the compiled loop takes them."""
    low, high = (angle * DEG for angle in arm.range_deg)
    wind_up = arm.torque_n_m / ARM_STIFFNESS_N_M_RAD
    return np.array([low, high, arm.max_rate_deg_s * DEG, wind_up, ARM_LAG_S, arm.lost_damping_n_m_s_rad, ARM_FRICTION_N_M_S_RAD])


def _view(address: int, rows: int, columns: int, kind: Any) -> np.ndarray:
    """Return an array laid over memory that MuJoCo owns."""
    size = rows * columns * np.dtype(kind).itemsize
    return np.frombuffer((ctypes.c_char * size).from_address(address), dtype=kind).reshape(rows, columns)


def open_plant(scenario: Scenario, seed: int = 0, *, chair: ChairDescription | None = None) -> MujocoPlant:
    """Return a simulated chair on the scenario's stair."""
    return MujocoPlant(scenario, seed, read_chair(scenario.chair.model) if chair is None else chair)
