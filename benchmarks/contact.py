"""Contact of the tracked chair on a stair in Drake and in MuJoCo: ``python benchmarks/contact.py [--quick]``.

The same chair runs with the same belt speeds under Drake's discrete contact approximations "lagged" and "sap", in treadline's
MuJoCo plant with and without the contact correction, and in the quasi-static Coulomb model. The heading gained per nosing pitch at
three belt speeds is compared with the Coulomb model with the chair's inertia (``tests/plant/mujoco/oracles/dynamic_coulomb.py``).
"""

# ruff: noqa: SLF001 - the uncorrected solver and MuJoCo's contact list are no part of the plant's interface

import argparse
import importlib
import importlib.metadata
import itertools
import logging
import math
import platform
import sys
import time
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.rotations import rotation_of, rotation_y
from treadline.core.signals import TICK_S, SeatCommand, TrackCommand
from treadline.plant.mujoco import MujocoPlant
from treadline.plant.mujoco import _step_kernels as kernels
from treadline.scenario.chair import GRAVITY_M_S2, read_chair
from treadline.scenario.scenario import Chair, Stair
from treadline.vehicle.bodies import centre_of_mass, flipper_turns, vehicle
from treadline.vehicle.quasi_static import QuasiStaticRun, quasi_static_run
from treadline.vehicle.stair_solids import stair_solids

sys.path.append(str(Path(__file__).parents[1] / "tests" / "plant" / "mujoco"))
from oracles.dynamic_coulomb import dynamic_run
from oracles.plant_runs import plant_on

MISSING = "benchmarks/contact.py needs Drake, which is no dependency of treadline: pip install drake"
MU = 0.62
"""Friction coefficient along and across the belt. Drake's Coulomb friction is isotropic."""
RUN_M = 0.30
FROM_S, UNTIL_S = 1.0, 4.0
"""Evaluation interval [s] after the belts start."""
SETTLE_S = 1.0
"""Time in Drake with belts at rest before the run [s], as in the plant."""
STEP_S = 0.002
"""Drake's time step [s]; MuJoCo's has the same default."""
EDGE_M = 0.002
"""Width of the contact geometry along each edge of a belt [m]: one contact point per edge and nosing."""
STICTION_M_S = 1e-5
"""Slip speed of a sticking contact in Drake under its full friction [m/s]; at the default, 1e-4 m/s, the chair turns by 0.027 °/s
where it should stick."""
THEORY_STEP_S = 0.005
"""Step of the Coulomb models [s]; halving it changes the heading gained per pitch by less than 0.3 %."""
SPEED_SHARES = (1.0, 0.5, 0.25)
"""Belt speeds of the comparison per nosing pitch, as shares of the first case's."""
BELT_KG = 10.0
"""Mass of a belt in Drake [kg], taken off the chassis; its centre is that of the whole chair. Drake regularises static friction in
proportion to the time step and to the inverse mass of the touching bodies: belts of 0.1 kg creep by 1.4 mm/s on 28°."""
LIGHT_BELTS_KG = (0.1, 1.0)
"""Lighter belts [kg], to show how much this mass matters."""
BELT_GAIN_N_S_M = 1e7
"""Velocity gain of the belt's implicit actuator [N·s/m]: 200 N of traction change the belt speed by 0.02 mm/s."""
BEHIND, AHEAD = 4, 4
"""Nosings behind and ahead of the front pulley at the start: as many as the belts pass in a run."""
CHAIR, LOADING = read_chair("wheelchair"), Chair(belt_mismatch=0.0)

EDGES_M = tuple(
    side * 0.5 * CHAIR.tracks.gauge_m + edge * 0.5 * (CHAIR.tracks.belt_width_m - EDGE_M) for side in (1, -1) for edge in (1, -1)
)
"""Lateral place of the contact geometry along the belts' edges [m], the left belt's first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A slope and two belt speeds."""

    slope_deg: float
    left_m_s: float
    right_m_s: float

    @property
    def name(self) -> str:
        """Row label."""
        return f"{self.slope_deg:.0f}° {self.left_m_s:g}/{self.right_m_s:g}"


CASES = (
    Case(slope_deg=25.0, left_m_s=0.15, right_m_s=0.25),
    Case(slope_deg=20.0, left_m_s=0.15, right_m_s=0.25),
    Case(slope_deg=28.0, left_m_s=0.15, right_m_s=0.25),
    Case(slope_deg=28.0, left_m_s=0.2, right_m_s=0.2),
)


@dataclass(slots=True, kw_only=True)
class Track:
    """Samples of a run: pose, total normal force, and the CPU time of the physics."""

    t_s: list[float] = field(default_factory=list)
    yaw_rad: list[float] = field(default_factory=list)
    place_m: list[float] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    """Total normal force over the weight across the slope."""
    largest: float = 0.0
    airborne: float = 0.0
    """Share of time steps without contact force."""
    cpu: float = 0.0
    """CPU seconds per simulated second."""

    def add(self, t_s: float, yaw_rad: float, place_m: float, force: float) -> None:
        """Append a sample."""
        for series, value in ((self.t_s, t_s), (self.yaw_rad, yaw_rad), (self.place_m, place_m), (self.force, force)):
            series.append(value)

    def row(self) -> tuple[str, ...]:
        """Return the table's figures."""
        span = (np.array(self.t_s) > FROM_S - 1e-9) & (np.array(self.t_s) < UNTIL_S + 1e-9)
        yaw, place, force = np.unwrap(self.yaw_rad)[span], np.array(self.place_m)[span], np.array(self.force)[span]
        duration_s = UNTIL_S - FROM_S
        return (
            f"{(yaw[-1] - yaw[0]) / duration_s / DEG:.3f}",
            f"{(place[-1] - place[0]) / duration_s:.4f}",
            f"{100.0 * self.airborne:.1f}",
            f"{100.0 * force.std():.2f}",
            f"{self.largest:.3f}",
            f"{self.cpu:.3f}",
        )


def started(case: Case, *, corrected: bool = True) -> MujocoPlant:
    """Return a plant at rest on its nosings."""
    plant = plant_on(case.slope_deg, (MU, MU))
    plant._corrected[0] = corrected
    plant.start()
    return plant


def yaw_and_place(plant: MujocoPlant, R_WB: np.ndarray, p_WB: np.ndarray) -> tuple[float, float]:
    """Return heading [rad] and distance up the flight [m] in the stair's frame."""
    R_SW = plant.staircase.R_WS.T
    R_SB = R_SW @ R_WB
    return math.atan2(R_SB[1, 0], R_SB[0, 0]), float((R_SW @ (p_WB - plant.staircase.p_WS))[0])


def load_n(plant: MujocoPlant, case: Case) -> float:
    """Return the weight's component across the slope [N]."""
    return plant._weight_n * math.cos(case.slope_deg * DEG)


def run_mujoco(case: Case, *, corrected: bool, until_s: float = UNTIL_S) -> tuple[Track, Float[np.ndarray, "n 2"]]:
    """Return the plant's run and its belt speeds at each tick. The force is sampled in the last step of each tick."""
    plant, track, belts = started(case, corrected=corrected), Track(), []
    plant.write(TrackCommand(t_s=0.0, left_m_s=case.left_m_s, right_m_s=case.right_m_s), SeatCommand(t_s=0.0, rate_m_s=0.0))
    airborne, steps, weight = 0.0, 0, load_n(plant, case)
    for tick in range(1, round(until_s / TICK_S) + 1):
        began = time.process_time()
        plant.advance(tick * TICK_S)
        track.cpu += (time.process_time() - began) / until_s
        data, row = plant._data, plant._pending[-1][1]
        rows = data.contact.efc_address
        force = float(data.efc_force[rows[rows >= 0]].sum()) / weight
        track.add(tick * TICK_S, *yaw_and_place(plant, rotation_of(data.qpos[3:7]), data.qpos[:3]), force)
        belts.append(row["belts"].copy())
        if tick * TICK_S > FROM_S:
            airborne, steps = airborne + row["airborne"], steps + plant._physics.substeps
            track.largest = max(track.largest, row["force_max"] / weight)
    track.airborne = airborne / steps
    return track, np.array(belts)


def coulomb(case: Case, start: Track, belts_m_s: tuple[float, float], duration_s: float, *, has_inertia: bool) -> QuasiStaticRun:
    """Return the run of the Coulomb model from the pose of a run at ``FROM_S``, quasi-static or with the chair's inertia."""
    k, slope, radius_m = int(np.searchsorted(start.t_s, FROM_S - 1e-9)), case.slope_deg * DEG, Stair().nosing_radius_m
    # A nosing touches the belt where the axis of its round bar lies, a little up the slope from the sharp edge.
    place = {
        "heading_rad": start.yaw_rad[k],
        "nosing_ahead_m": radius_m * (math.cos(slope) - math.sin(slope)) - start.place_m[k],
        "step_s": THEORY_STEP_S,
    }
    chair, pitch_m = (CHAIR, LOADING, slope), RUN_M / math.cos(slope)
    if has_inertia:
        return dynamic_run(*chair, pitch_m, (MU, MU), belts_m_s, duration_s, **place)
    return quasi_static_run(
        CHAIR, partial(centre_of_mass, CHAIR, LOADING), slope, pitch_m, (MU, MU), *belts_m_s, duration_s, **place
    )


def theory(case: Case, start: Track, *, has_inertia: bool) -> tuple[str, str]:
    """Return yaw rate and speed of a Coulomb model, from the pose of a run at ``FROM_S``."""
    run = coulomb(case, start, (case.left_m_s, case.right_m_s), UNTIL_S - FROM_S, has_inertia=has_inertia)
    return f"{run.yaw_rad_s / DEG:.3f}", f"{run.climb_m_s:.4f}"


def whole_chair(seat_rad: float, flipper_rad: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, centre of mass and inertia about it of chassis, seat, payload and flipper as one body, in B."""
    parts, com = [], np.array(centre_of_mass(CHAIR, LOADING, seat_rad, flipper_rad))
    chair = vehicle(CHAIR, LOADING)
    turns = {"chair": 0.0, chair.seat.name: seat_rad, **flipper_turns(CHAIR, flipper_rad)}
    for body in chair.bodies:
        R = rotation_y(turns[body.name])
        parts.append((body.mass_kg, np.array(body.origin_m) + R @ np.array(body.com_m), R @ np.diag(body.inertia) @ R.T))
    inertia = np.zeros((3, 3))
    for mass, place, own in parts:
        d = place - com
        inertia += own + mass * (d @ d * np.eye(3) - np.outer(d, d))
    return sum(mass for mass, _, _ in parts), com, inertia


@dataclass(frozen=True, slots=True, kw_only=True)
class Softness:
    """Point contact in Drake: as deep under the weight as MuJoCo's, critically damped in the vertical bounce."""

    depth_m: float
    stiffness_n_m: float
    dissipation_s_m: float
    """Hunt and Crossley, for "lagged"."""
    relaxation_s: float
    """Linear, for "sap"."""


def softness(plant: MujocoPlant, case: Case) -> Softness:
    """Derive it from the depth in MuJoCo: ω² = g cos β / depth, stiffness and damping from ω and the number of points."""
    depth_m = float(-plant._data.contact.dist.mean())
    points = len(plant._data.contact.dist)
    omega = math.sqrt(GRAVITY_M_S2 * math.cos(case.slope_deg * DEG) / depth_m)
    return Softness(
        depth_m=depth_m,
        stiffness_n_m=load_n(plant, case) / (points * depth_m),
        dissipation_s_m=2.0 / (depth_m * omega),
        relaxation_s=2.0 / omega,
    )


def _fixed(name: str, world: object, place: np.ndarray) -> object:
    """Return a frame of Drake at a place of the world."""
    from pydrake.math import RigidTransform
    from pydrake.multibody.tree import FixedOffsetFrame

    return FixedOffsetFrame(f"{name}_place", world.body_frame(), RigidTransform(place))


class DrakeChair:
    """The chair in Drake: a free body, and two belts on prismatic joints whose positions are reset after each step."""

    def __init__(
        self, plant: MujocoPlant, case: Case, approximation: str, step_s: float, belt_kg: float, stiction_m_s: float
    ) -> None:
        from pydrake.geometry import AddContactMaterial, ProximityProperties
        from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
        from pydrake.systems.analysis import Simulator
        from pydrake.systems.framework import DiagramBuilder

        self._reference, self._case, self._step_s, self._belt_kg = plant, case, step_s, belt_kg
        soft, self._surface = softness(plant, case), ProximityProperties()
        # Drake puts the two surfaces' stiffnesses in series and adds their relaxation times.
        AddContactMaterial(
            dissipation=soft.dissipation_s_m,
            point_stiffness=2.0 * soft.stiffness_n_m,
            friction=CoulombFriction(MU, MU),
            properties=self._surface,
        )
        self._surface.AddProperty("material", "relaxation_time", 0.5 * soft.relaxation_s)
        builder = DiagramBuilder()
        config = MultibodyPlantConfig(
            time_step=step_s,
            discrete_contact_approximation=approximation,
            contact_model="point",
            stiction_tolerance=stiction_m_s,
        )
        self._plant, _ = AddMultibodyPlant(config, builder)
        self._plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY_M_S2])
        self._build_stair()
        self._build_chair()
        self._plant.Finalize()
        self._simulator = Simulator(builder.Build())
        self._context = self._plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._pose()

    def _build_stair(self) -> None:
        """Add a sphere for each nosing under each edge of a belt.

        Drake's penetration query of box and cylinder (EPA) returns normals along the belt where a nosing passes the belt's end. The
        query of box and sphere is exact. Each sphere has the nosing's radius, stands still (its joint is locked), and is put
        under the belt's edge before each step: the contact point is that of the nosing's cylinder.
        """
        from pydrake.geometry import Sphere
        from pydrake.math import RigidTransform
        from pydrake.multibody.tree import PrismaticJoint, SpatialInertia

        self._spheres, world = [], self._plant.world_body()
        front = self._reference._scenario.start.step
        for solid, edge in itertools.product(stair_solids(self._reference.staircase), range(4)):
            bar = solid.nosing
            if bar is None or not -BEHIND <= bar.index - front <= AHEAD:
                continue
            name, axis = f"nosing_{bar.index}_{edge}", np.array([bar.left_W[0], 0.0, bar.left_W[2]])
            body = self._plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, bar.radius_m))
            place = self._plant.AddFrame(_fixed(name, world, axis))
            joint = self._plant.AddJoint(PrismaticJoint(name, place, body.body_frame(), np.array([0.0, 1.0, 0.0])))
            self._plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(bar.radius_m), name, self._surface)
            x_m = axis[0] - bar.radius_m * math.sin(self._case.slope_deg * DEG)
            self._spheres.append((joint, x_m, EDGES_M[edge]))

    def _put_nosings_under_the_edges(self) -> None:
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._chassis)
        R, p = pose.rotation().matrix(), pose.translation()
        for joint, x_m, y_m in self._spheres:
            along = (x_m - p[0] - R[0, 1] * y_m) / R[0, 0]
            joint.set_translation(self._context, p[1] + R[1, 0] * along + R[1, 1] * y_m)

    def _build_chair(self) -> None:
        from pydrake.geometry import Box
        from pydrake.math import RigidTransform
        from pydrake.multibody.tree import PdControllerGains, PrismaticJoint, SpatialInertia, UnitInertia

        pose = self._reference._data.qpos
        mass, com, inertia = whole_chair(float(pose[7]), float(pose[kernels.FLIPPER_QPOS + 1]))
        mass -= 2.0 * self._belt_kg
        moments, products = np.diag(inertia) / mass, inertia[[0, 0, 1], [1, 2, 2]] / mass
        about_com = UnitInertia(*moments, *products)
        about_origin = about_com.ShiftFromCenterOfMass(-com)
        self._chassis = self._plant.AddRigidBody("chair", SpatialInertia(mass, com, about_origin))
        small = UnitInertia.SolidSphere(0.01).ShiftFromCenterOfMass(-com)
        self._belts = []
        for side, edges in (("left", EDGES_M[:2]), ("right", EDGES_M[2:])):
            belt = self._plant.AddRigidBody(side, SpatialInertia(self._belt_kg, com, small))
            joint = self._plant.AddJoint(
                PrismaticJoint(side, self._chassis.body_frame(), belt.body_frame(), np.array([1.0, 0.0, 0.0]))
            )
            self._plant.AddJointActuator(side, joint).set_controller_gains(PdControllerGains(p=0.0, d=BELT_GAIN_N_S_M))
            self._belts.append(joint)
            for number, edge_y in enumerate(edges):
                box, height = Box(CHAIR.tracks.flat_run_m, EDGE_M, CHAIR.tracks.pulley_radius_m), CHAIR.tracks.pulley_radius_m
                place = RigidTransform([0.0, edge_y, 0.5 * height])
                self._plant.RegisterCollisionGeometry(belt, place, box, f"{side}_{number}", self._surface)

    def _pose(self) -> None:
        from pydrake.math import RigidTransform, RotationMatrix

        pose = self._reference._data.qpos
        start = RigidTransform(RotationMatrix(rotation_of(pose[3:7])), pose[:3])
        self._plant.SetFreeBodyPose(self._context, self._chassis, start)
        self._port = self._plant.get_desired_state_input_port(self._chassis.model_instance())
        self._port.FixValue(self._context, np.zeros(4))
        for joint, _, _ in self._spheres:
            joint.Lock(self._context)
        self._put_nosings_under_the_edges()
        self._simulator.Initialize()

    def step(self, number: int, belts_m_s: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, float]:
        """Take a time step and return rotation, place and total normal force [N]."""
        self._port.FixValue(self._context, np.array([0.0, 0.0, -belts_m_s[0], -belts_m_s[1]]))
        self._simulator.AdvanceTo(number * self._step_s)
        for joint in self._belts:
            joint.set_translation(self._context, 0.0)
        self._put_nosings_under_the_edges()
        results = self._plant.get_contact_results_output_port().Eval(self._context)
        infos = [results.point_pair_contact_info(i) for i in range(results.num_point_pair_contacts())]
        force = sum(abs(float(info.contact_force() @ info.point_pair().nhat_BA_W)) for info in infos)
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._chassis)
        return pose.rotation().matrix(), pose.translation(), force


def run_drake(
    case: Case,
    approximation: str,
    belts: Float[np.ndarray, "n 2"],
    step_s: float = STEP_S,
    belt_kg: float = BELT_KG,
    stiction_m_s: float = STICTION_M_S,
) -> Track:
    """Return a run in Drake with the belt speeds that the plant's drives had."""
    reference, track = started(case), Track()
    chair, weight = DrakeChair(reference, case, approximation, step_s, belt_kg, stiction_m_s), load_n(reference, case)
    settle, count, per_tick = round(SETTLE_S / step_s), len(belts) * round(TICK_S / step_s), round(TICK_S / step_s)
    for number in range(1, settle + 1):
        chair.step(number, (0.0, 0.0))
    began, forces = time.process_time(), []
    for number in range(1, count + 1):
        left, right = belts[(number - 1) // per_tick]
        R_WB, p_WB, force = chair.step(settle + number, (left, right))
        track.add(number * step_s, *yaw_and_place(reference, R_WB, p_WB), force / weight)
        if number * step_s > FROM_S:
            forces.append(force / weight)
    track.cpu = (time.process_time() - began) / (len(belts) * TICK_S)
    track.largest, track.airborne = max(forces), float(np.mean(np.array(forces) == 0.0))
    return track


def show(case: Case, engine: str, figures: tuple[str, ...]) -> None:
    cells = itertools.chain((case.name, engine), figures, itertools.repeat("–", 6 - len(figures)))
    print("| " + " | ".join(cells) + " |", flush=True)


def compare(case: Case) -> Float[np.ndarray, "n 2"]:
    """Print a case's rows and return the belt speeds."""
    corrected, belts = run_mujoco(case, corrected=True)
    show(case, "Drake lagged", run_drake(case, "lagged", belts).row())
    show(case, "Drake sap", run_drake(case, "sap", belts).row())
    show(case, "MuJoCo corrected", corrected.row())
    show(case, "MuJoCo uncorrected", run_mujoco(case, corrected=False)[0].row())
    show(case, "Coulomb, quasi-static", theory(case, corrected, has_inertia=False))
    show(case, "Coulomb, with inertia", theory(case, corrected, has_inertia=True))
    return belts


def gained_deg(track: Track, case: Case) -> tuple[float, float]:
    """Return the heading gained in one nosing pitch after ``FROM_S`` less the creep [°], and the creep [°/s].

    The chair sticks in seven eighths of a pitch, so that the median yaw rate is the creep's.
    """
    t_s, yaw = np.array(track.t_s), np.unwrap(track.yaw_rad)
    span = (t_s > FROM_S - 1e-9) & (t_s < FROM_S + pitch_s(case) + 1e-9)
    t_s, yaw = t_s[span], yaw[span] / DEG
    creep = float(np.median(np.diff(yaw) / np.diff(t_s)))
    return float(yaw[-1] - yaw[0] - creep * (t_s[-1] - t_s[0])), creep


def pitch_s(case: Case) -> float:
    """Return the time in which the slower belt runs over a nosing pitch, whole ticks [s]."""
    return math.floor(RUN_M / math.cos(case.slope_deg * DEG) / min(case.left_m_s, case.right_m_s) / TICK_S) * TICK_S


def per_pitch() -> None:
    """Print the heading that each engine and each model gains in the same nosing pitch, at three belt speeds."""
    print("\n| belts m/s | engine | gained ° | creep °/s |")
    print("| --- | --- | --- | --- |")
    for share in SPEED_SHARES:
        case = replace(CASES[0], left_m_s=share * CASES[0].left_m_s, right_m_s=share * CASES[0].right_m_s)
        plant, belts = run_mujoco(case, corrected=True, until_s=FROM_S + pitch_s(case) + 5 * TICK_S)
        gained = {"MuJoCo corrected": "{:.3f} | {:.4f}".format(*gained_deg(plant, case))}
        for step_s, stiction_m_s in itertools.product((STEP_S, 0.0005), (1e-4, STICTION_M_S)):
            track = run_drake(case, "lagged", belts, step_s, stiction_m_s=stiction_m_s)
            name = f"Drake lagged, {1e3 * step_s:g} ms, stiction {stiction_m_s:g} m/s"
            gained[name] = "{:.3f} | {:.4f}".format(*gained_deg(track, case))
        for name, has_inertia in (("Coulomb, with inertia", True), ("Coulomb, quasi-static", False)):
            run = coulomb(case, plant, (float(belts[-1][0]), float(belts[-1][1])), pitch_s(case), has_inertia=has_inertia)
            gained[name] = f"{(run.heading_rad[-1] - run.heading_rad[0]) / DEG:.3f} | –"
        for name, figures in gained.items():
            print(f"| {case.left_m_s:g}/{case.right_m_s:g} | {name} | {figures} |", flush=True)


def conditions(cases: tuple[Case, ...]) -> None:
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("drake", "mujoco", "numpy", "treadline"))
    mass, com, _ = whole_chair(0.0, CHAIR.tracks.approach_angle_deg * DEG)
    print(f"{versions}, Python {platform.python_version()}, {platform.machine()}")
    print(f"chair {CHAIR.name}, {mass:.1f} kg, centre of mass with the seat level with the chassis {np.round(com, 3).tolist()} m")
    print(f"friction {MU}/{MU}; run {RUN_M:.2f} m; evaluated over {FROM_S:g} to {UNTIL_S:g} s after the belts start")
    print(f"time step {1e3 * STEP_S:g} ms; belt mass {BELT_KG} kg, belt gain {BELT_GAIN_N_S_M:g} N·s/m")
    for slope_deg in dict.fromkeys(case.slope_deg for case in cases):
        case = next(case for case in cases if case.slope_deg == slope_deg)
        soft = softness(started(case), case)
        print(
            f"contact at {slope_deg:.0f}°: depth in MuJoCo {1e3 * soft.depth_m:.3f} mm; in Drake {soft.stiffness_n_m:.3g} N/m a "
            f"point, Hunt-Crossley {soft.dissipation_s_m:.3g} s/m (lagged), relaxation time {1e3 * soft.relaxation_s:.3g} ms (sap)"
        )
    print("\n| case | engine | yaw °/s | speed m/s | no contact % | force s.d. % | force max | CPU s/s |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--quick", action="store_true", help="run the first case only, without the rows of smaller time steps and lighter belts"
    )
    quick = parser.parse_args().quick
    try:
        importlib.import_module("pydrake.multibody.plant")
    except ImportError:
        raise SystemExit(MISSING) from None
    logging.getLogger("drake").setLevel(logging.ERROR)
    cases = CASES[:1] if quick else CASES
    conditions(cases)
    belts = [compare(case) for case in cases]
    per_pitch()
    if not quick:
        print()
        for number, step_s in itertools.product((0, 2), (0.001, 0.0005)):
            track = run_drake(CASES[number], "lagged", belts[number], step_s)
            show(CASES[number], f"Drake lagged, {1e3 * step_s:g} ms", track.row())
        for number, approximation, belt_kg in itertools.product((0, 3), ("lagged", "sap"), LIGHT_BELTS_KG):
            track = run_drake(CASES[number], approximation, belts[number], belt_kg=belt_kg)
            show(CASES[number], f"Drake {approximation}, belts of {belt_kg:g} kg", track.row())


if __name__ == "__main__":
    main()
