"""Sensor models of the chair: state at a tick in, readings and ground truth out; independent of the simulator.

Camera frames reach the mission late, unevenly or never, belt speeds as encoder counts. Readings keep the stamp of their exposure;
only the tick of their delivery is later.
"""

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Shaped

from treadline.core.angles import DEG
from treadline.core.ports import Reading, Truth
from treadline.core.rotations import Rotation, Vector3, rotation_x
from treadline.core.signals import (
    TICK_S,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    ImuSample,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.plant._actuators import Actuators
from treadline.plant.sensors import _pose_kernels as kernels
from treadline.plant.sensors._free_ground import SIGMA_M, GroundAhead
from treadline.plant.sensors.camera import Camera
from treadline.plant.sensors.imu import IMUS, Imu
from treadline.plant.sensors.statistical_camera import EXACT_PLACE_M, StatisticalCamera
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Chair, Realism, Scenario
from treadline.vehicle.bodies import payload_com, payload_origin
from treadline.vehicle.stair_solids import bearing_edges, stair_surfaces
from treadline.vehicle.staircase import Staircase, build_staircase, up_W
from treadline.vehicle.tip_over_margin import ROCKING
from treadline.vehicle.tracks import sections
from treadline.vehicle.traction import friction_use


class CameraLink:
    """Delay line of the camera's readings, first in, first out."""

    def __init__(self, realism: Realism, rng: np.random.Generator) -> None:
        self._realism = realism
        self._rng = rng
        self._queue: deque[tuple[int, Sequence[Reading]]] = deque()
        self._last_due = 0

    def clear(self) -> None:
        """Forget what is under way."""
        self._queue.clear()
        self._last_due = 0

    def is_dropped(self) -> bool:
        """Decide whether the next frame is lost."""
        return bool(self._rng.random() < self._realism.camera_drop_rate)

    def send(self, tick: int, readings: Sequence[Reading]) -> None:
        """Accept the readings of a frame exposed at a tick.

        The first frame, of ``t = 0``, arrives at once: the chair has stood at its start before, and its camera has run.
        """
        latency_s = self._realism.camera_latency_s + self._realism.camera_jitter_s * float(self._rng.standard_normal())
        if tick == 0:
            latency_s = 0.0
        # A frame cannot arrive before its exposure, nor overtake the frame before it.
        self._last_due = max(tick + math.ceil(latency_s / TICK_S - 1e-9), tick, self._last_due)
        self._queue.append((self._last_due, readings))

    def arrived(self, tick: int) -> list[Reading]:
        """Return the readings that arrive until a tick."""
        readings: list[Reading] = []
        while self._queue and self._queue[0][0] <= tick:
            readings.extend(self._queue.popleft()[1])
        return readings


class Encoder:
    """Belt speed from the counts of an incremental encoder in one tick."""

    def __init__(self, counts_m: float, error: float = 0.0) -> None:
        self._counts_m = counts_m
        self._scale = 1.0 + error
        self._travel_counts = 0.0

    def speed_m_s(self, actual_m_s: float) -> float:
        """Return the measured speed of a belt that ran at ``actual_m_s`` since the last tick; the rest of a count carries over."""
        if self._counts_m == 0.0:
            return self._scale * actual_m_s
        before = math.floor(self._travel_counts)
        self._travel_counts += self._scale * actual_m_s * TICK_S * self._counts_m
        return (math.floor(self._travel_counts) - before) / (self._counts_m * TICK_S)


SETTLE_TICKS = 100
"""Duration of the physics before t = 0 on a stair of high friction [ticks], until the chair rests on its nosings."""
SUPPORT_TICKS = 25
"""Number of ticks during which a contact counts as support: contacts of a rocking chair are intermittent, and a chair drives 5 cm
in a quarter of a second."""
SEAT_PITCH_NOISE_RAD = 0.05 * DEG
"""Standard deviation of the seat pitch reading [rad]."""
FLIPPER_TORQUE_NOISE_N_M = 2.0
"""Standard deviation of the flipper torque estimated from motor current [N m]: 1 % of full torque."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ChairState:
    """State of a simulated chair and its actuators at a tick."""

    tick: int
    p_WB: Vector3
    R_WB: Rotation
    velocity_W: Vector3
    rate_B: Vector3
    seat_rad: float
    stroke_m: float
    belts_m_s: Float[np.ndarray, " 2"]
    """Actual belt speeds [m/s], mismatch included."""
    brake_on: bool
    flipper_rad: float
    flipper_torque_n_m: float
    reach_m: Float[np.ndarray, " 4"]
    """Reach of the belt contacts since the last tick from B [m]: front, rear, left, right, each positive outward."""
    contact_force_share: float = math.nan
    """Contact force over weight, see ``Truth``; NaN if the simulator does not report it."""
    airborne_share: float = math.nan
    contact_residual_m_s2: float = math.nan
    hull_contacts: int = 0
    """Largest simultaneous number of contacts of hull, seat and passenger since the last tick; 0 if the simulator does not model
    these contacts."""
    traction_n: Float[np.ndarray, " 2"] = field(default_factory=lambda: np.zeros(2))
    """Forward force of the stair on each belt [N], mean over the last tick; zero if the simulator does not report it."""
    power_w: float = 0.0
    """Electric power drawn from the battery [W]."""
    payload_shift_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Shift of the payload's centre of mass by faults [m], in the axes of the seat's frame."""

    @property
    def t_s(self) -> float:
        """Mission time [s]."""
        return self.tick * TICK_S


@dataclass(frozen=True, slots=True, kw_only=True)
class Streams:
    """Independent random generators, one per sensor, so that a change of one sensor leaves the others unchanged."""

    imu: np.random.Generator
    seat: np.random.Generator
    flipper: np.random.Generator
    link: np.random.Generator
    """Generator of latency and loss of camera readings."""


CameraModel = Camera | StatisticalCamera
"""Rendered or statistical camera."""
Look = Callable[[ChairState], Sequence[Reading]]
"""Camera model: readings from a chair state."""


class Instruments:
    """Simulated sensors: converts chair states into readings and ground truth."""

    def __init__(self, scenario: Scenario, chair: ChairDescription, staircase: Staircase, streams: Streams, look: Look) -> None:
        self._scenario, self._chair, self._staircase = scenario, chair, staircase
        self._seated = np.array(payload_com(chair, scenario.chair.leaning()))
        self._numbers = chair_numbers(chair, scenario.chair)
        self._sections = section_numbers(chair)
        self._imu = Imu(IMUS[scenario.sensors.imu], scenario.sensors.gravity_error_deg * DEG, streams.imu)
        self._streams = streams
        self._look = look
        frames = [staircase.stair_frame(k) for k in range(len(staircase.plans))]
        self._frames = [(np.ascontiguousarray(R_WS.T), p_WS, along_m) for R_WS, p_WS, along_m in frames]
        device = chair.mount_of(rear=scenario.drive.direction == "down").device
        self._frames_per_tick = TICK_S * device.rate_hz
        late = {} if device.latency_s is None else {"camera_latency_s": device.latency_s}
        self._link = CameraLink(scenario.realism.model_copy(update=late), streams.link)
        left, right = scenario.realism.encoder_error
        self._encoders = Encoder(scenario.realism.encoder_counts_m, left), Encoder(scenario.realism.encoder_counts_m, right)
        self._up_W = up_W(scenario.stair)
        self._R_GW = rotation_x(scenario.stair.side_slope_deg * DEG)
        """Rotation from W into the axes of gravity G, whose z points up."""
        self._nosings_W = staircase.nosings_W
        self._edges_W = bearing_edges(staircase)
        self._surfaces = stair_surfaces(staircase)
        there = [k for k, steps in enumerate(staircase.flights) for step in steps if not step.missing]
        self._nosings_x_m = np.array(
            [
                self._frames[k][2] + self._frames[k][0][0] @ (p - self._frames[k][1])
                for k, p in zip(there, self._nosings_W, strict=True)
            ]
        )
        grips = np.array([np.min(step.friction, axis=0) for step in staircase.steps if not step.missing])
        self._grips = None if np.all(grips == staircase.friction) else grips
        self._velocity_W = np.zeros(3)
        self._reaches = np.zeros((SUPPORT_TICKS, 4))
        """Ring buffer of recent contact reaches [m]."""
        self._ticks = 0

    def start(self, velocity_W: Vector3) -> None:
        """Reset all memory at the start of a run."""
        self._velocity_W = velocity_W
        self._ticks = 0
        self._link.clear()

    def read(self, state: ChairState, grip: float) -> tuple[list[Reading], Truth]:
        """Return the readings at a tick, and the ground truth.

        Args:
            grip: Remaining fraction of the stair's friction.
        """
        truth, t_s = self.truth_of(state, grip), state.t_s
        readings: list[Reading] = [self._imu_sample(state)]
        if self._chair.seat is not None:
            pitch = truth.seat_pitch_rad + SEAT_PITCH_NOISE_RAD * float(self._streams.seat.standard_normal())
            readings.append(SeatReading(t_s=t_s, pitch_rad=pitch, stroke_m=state.stroke_m))
        left = self._encoders[0].speed_m_s(truth.left_m_s)
        right = self._encoders[1].speed_m_s(truth.right_m_s / (1.0 + self._scenario.chair.belt_mismatch))
        readings.append(TrackReading(t_s=t_s, left_m_s=left, right_m_s=right, brake_on=state.brake_on))
        if self._chair.flipper is not None:
            torque = state.flipper_torque_n_m + FLIPPER_TORQUE_NOISE_N_M * float(self._streams.flipper.standard_normal())
            readings.append(FlipperReading(t_s=t_s, angle_rad=state.flipper_rad, torque_n_m=torque))
        now, before = (math.floor(tick * self._frames_per_tick + 1e-9) for tick in (state.tick, state.tick - 1))
        if now > before and not self._link.is_dropped():
            self._link.send(state.tick, self._look(state))
        readings.extend(self._link.arrived(state.tick))
        return readings, truth

    def _imu_sample(self, state: ChairState) -> ImuSample:
        acceleration = (state.velocity_W - self._velocity_W) / TICK_S
        self._velocity_W = state.velocity_W
        left, right = state.belts_m_s.tolist()
        moving = abs(left) + abs(right) > 0.01
        if self._scenario.stair.side_slope_deg:
            return self._imu.sample(state.t_s, self._R_GW @ state.R_WB, state.rate_B, self._R_GW @ acceleration, moving=moving)
        return self._imu.sample(state.t_s, state.R_WB, state.rate_B, acceleration, moving=moving)

    def _payload_at(self, state: ChairState) -> Vector3:
        """Return the payload's centre in the seat frame with sway and shift [m]; comfort is judged without them."""
        chair = self._scenario.chair
        if not chair.sways:
            return self._seated + state.payload_shift_m if any(state.payload_shift_m) else self._seated
        return np.array(payload_com(self._chair, chair.leaning(chair.sway_at(state.t_s)))) + state.payload_shift_m

    def _friction_at(self, x_m: float) -> tuple[float, float]:
        """Return the least friction (along, across) of the steps under the flat run, or the stair's default without steps."""
        if self._grips is None:
            return self._staircase.friction
        under = np.abs(self._nosings_x_m - x_m) <= 0.5 * self._chair.tracks.flat_run_m
        if not under.any():
            return self._staircase.friction
        along, across = self._grips[under].min(axis=0)
        return float(along), float(across)

    def truth_of(self, state: ChairState, grip: float) -> Truth:
        """Return the ground truth of a state; contacts since the last calls count as support. Arguments as of ``read``."""
        R_SW, p_WS, along_m = self._frames[self._staircase.flight_at(state.p_WB, state.R_WB)]
        place, self._ticks = self._ticks % SUPPORT_TICKS if self._ticks else -1, self._ticks + 1
        heading, yaw, heading_rate, pitch, roll, x_m, y_m, seat_pitch, margin, *passenger = kernels.truth(
            R_SW,
            p_WS,
            state.R_WB,
            state.p_WB,
            state.rate_B,
            state.seat_rad,
            state.flipper_rad,
            state.reach_m,
            place,
            self._reaches,
            self._edges_W,
            self._surfaces,
            self._numbers,
            self._sections,
            self._seated,
            self._payload_at(state),
            ROCKING,
            self._up_W,
        )
        x_m += along_m
        along, across = self._friction_at(x_m)
        (left_m_s, right_m_s), (left_n, right_n) = state.belts_m_s.tolist(), state.traction_n.tolist()
        chassis_x_m, chassis_y_m, chassis_z_m = state.p_WB.tolist()
        return Truth(
            t_s=state.t_s,
            heading_rad=heading,
            yaw_rad=yaw,
            heading_rate_rad_s=heading_rate,
            pitch_rad=pitch,
            roll_rad=roll,
            pitch_rate_rad_s=-float(state.rate_B[1]),
            x_m=x_m,
            y_m=y_m,
            seat_pitch_rad=math.nan if self._chair.seat is None else seat_pitch,
            left_m_s=left_m_s,
            right_m_s=right_m_s,
            stability_margin_rad=margin,
            friction_use=friction_use(self._staircase.slope_rad, heading, (along * grip, across * grip)),
            passenger_x_m=passenger[0],
            passenger_y_m=passenger[1],
            passenger_z_m=passenger[2],
            contact_force_share=state.contact_force_share,
            airborne_share=state.airborne_share,
            contact_residual_m_s2=state.contact_residual_m_s2,
            hull_contacts=float(state.hull_contacts),
            left_force_n=left_n,
            right_force_n=right_n,
            power_w=state.power_w,
            chassis_x_m=chassis_x_m,
            chassis_y_m=chassis_y_m,
            chassis_z_m=chassis_z_m,
        )


def chair_numbers(chair: ChairDescription, loading: Chair) -> kernels.ChairNumbers:
    """Return the parameters of a loaded chair for ``kernels.truth``."""
    return kernels.ChairNumbers(
        half_run=0.5 * chair.tracks.flat_run_m,
        hinge=payload_origin(chair, loading),
        seat_kg=chair.empty_seat_kg + loading.payload_kg,
        chassis_kg=chair.masses.chassis_kg,
        chassis=chair.masses.chassis_com_m,
    )


def section_numbers(chair: ChairDescription) -> Shaped[np.ndarray, " n"]:
    """Return the sections of a chair's belts for ``kernels.truth``."""
    rows = []
    for one in sections(chair):
        turns = (one.zero_rad, one.raises, one.stays_rad, float(one.follows), one.mass_kg, one.com_m / one.length_m)
        rows.append((one.start_m, one.length_m, one.radii_m, 0.5 * one.gauge_m, *turns))
    return np.array(rows, kernels.SECTION)


class InstrumentedPlant(ABC):
    """Common part of the plants of both simulators: commands to the actuators, readings and ground truth from the states.

    A simulator moves the bodies. The seed alone determines stair and noise, whatever the simulator.
    """

    virtual_time = True
    """Time advances in ``advance`` alone: a loop that stands still stops the simulation with it."""

    def __init__(self, scenario: Scenario, chair: ChairDescription, seed: int) -> None:
        stair, imu, seat, statistical, render, flipper, link, self._physics_draws = np.random.default_rng(seed).spawn(8)
        self._scenario, self._chair = scenario, chair
        self.staircase: Staircase = build_staircase(scenario.stair, stair, scenario.step, scenario.sill)
        self._camera = self._camera_of(statistical, render)
        self._drives = Actuators(scenario, chair)
        streams = Streams(imu=imu, seat=seat, flipper=flipper, link=link)
        self._instruments = Instruments(scenario, chair, self.staircase, streams, self._look)
        self._readings: list[Reading] = []
        self._truth: list[Truth] = []

    def read(self) -> Sequence[Reading]:
        """Return the samples that arrived since the last call, each kind in time order, camera readings with a delay."""
        self._sense()
        readings, self._readings = self._readings, []
        return readings

    def truth(self) -> Sequence[Truth]:
        """Return the ground truth of each tick since the last call."""
        self._sense()
        truth, self._truth = self._truth, []
        return truth

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        """Set the commands; they hold until the next call."""
        self._drives.take(tracks, seat, flipper)

    @abstractmethod
    def _passed(self) -> Iterator[tuple[ChairState, float]]:
        """Yield the states since the last call, each with the remaining fraction of the stair's friction."""

    def _camera_of(self, statistical: np.random.Generator, render: np.random.Generator) -> CameraModel:
        """Return the camera: a rendering camera, or a statistical model of the detector's output."""
        sensors, stair, vision = self._scenario.sensors, self._scenario.stair, self._scenario.control.vision
        rear = self._scenario.drive.direction == "down"
        calibration, device = self._chair.camera_at(sensors.rows_px, rear=rear), self._chair.mount_of(rear=rear).device
        if vision != "truth" and sensors.camera_model != "statistical":
            kind = "ideal" if sensors.camera_model == "ideal" else device.kind
            return Camera(
                self.staircase, calibration, kind=kind, device=device, texture=stair.texture, light=stair.light, rng=render
            )
        sigma_m, draws = EXACT_PLACE_M if vision == "truth" else SIGMA_M, statistical.spawn(1)[0]
        ground = GroundAhead(self.staircase, self._chair, calibration, draws, sigma_m)
        return StatisticalCamera(
            self.staircase, calibration, statistical, sensor=device.kind, exact=vision == "truth", ground=ground
        )

    def _look(self, state: ChairState) -> Sequence[Reading]:
        """Return the camera's readings at a state."""
        return look(self._camera, state)

    def _forget(self) -> None:
        """Discard all unread samples at a restart."""
        self._readings.clear()
        self._truth.clear()

    def _sense(self) -> None:
        for state, grip in self._passed():
            readings, truth = self._instruments.read(state, grip)
            self._readings.extend(readings)
            self._truth.append(truth)


def look(camera: CameraModel, state: ChairState) -> Sequence[Reading]:
    """Return the readings of the camera at the state of the chair."""
    t_s, R_WB, p_WB = state.t_s, state.R_WB, state.p_WB
    if isinstance(camera, StatisticalCamera):
        arrived = FrameQuality(t_s=t_s, fingerprint=state.tick, brightness=0.5, contrast=0.2, valid_share=1.0)
        return [arrived, *camera.look(t_s, R_WB, p_WB)]
    calibration = camera.calibration
    return [camera.frame(t_s, R_WB @ calibration.R_BC, p_WB + R_WB @ np.array(calibration.mount_m))]
