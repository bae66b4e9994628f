"""Runs of a real chair: recording without motion, the bench, and a drive with mission and guard.

``RobotFile -> run folder``: ``manifest.json``, ``log.mcap`` and ``result.json``, and of a drive ``series.csv``, as of a simulated
run but without ground truth.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from treadline.core.angles import DEG
from treadline.core.camera_images import RgbdFrame
from treadline.core.errors import SettingsError
from treadline.core.models import ControllerDesign
from treadline.core.processes import LOOP, real_time
from treadline.core.signals import Event
from treadline.estimation import StuckRule
from treadline.guard import GuardConfig
from treadline.hardware._arming import Arming, BenchSession
from treadline.hardware._guard_client import GuardClient
from treadline.hardware._links import open_driver
from treadline.hardware._robot_plant import CameraThread, RobotPlant
from treadline.hardware.robot_file import RobotFile
from treadline.io.live import CAMERAS
from treadline.io.live.stream import LiveFrames
from treadline.io.mcap_log import RunLog
from treadline.io.runs import LOG, begin_run, log_metadata, write_result, write_series
from treadline.mission.loop import Mission, Tick
from treadline.mission.mission_blocks import build_blocks, guard_config, warm_up
from treadline.mission.mission_config import MissionConfig
from treadline.playback import read_recording
from treadline.run.scene_log import SceneLog
from treadline.scenario.camera_file import read_camera
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair
from treadline.scenario.shipped_files import shipped_controller

BENCH_PERIOD_S = 0.25
"""Control period of a session without a mission [s]: Table I, 4 Hz."""


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A chair as it is driven: its file, its limits and its mission."""

    file: RobotFile
    mission: MissionConfig
    """Mission, with the limits of the robot file where these are lower than those of the chair."""

    @classmethod
    def of(cls, file: RobotFile) -> "Robot":
        """Return the chair of a robot file.

        Raises:
            SettingsError: If chair or controller are missing or invalid.
        """
        chair, asked = read_chair(file.mission.chair), file.mission
        speed_m_s = min(chair.drives.max_speed_m_s, file.limits.belt_m_s)
        acceleration_m_s2 = min(chair.drives.max_acceleration_m_s2, file.limits.acceleration_m_s2)
        limited = chair.changed(drives={"max_speed_m_s": speed_m_s, "max_acceleration_m_s2": acceleration_m_s2})
        design = shipped_controller(chair.name) if asked.controller is None else ControllerDesign.load(Path(asked.controller))
        mission = MissionConfig(
            chair=limited,
            controller=design,
            direction=asked.direction,
            payload_kg=asked.payload_kg,
            climb_speed_m_s=min(asked.speed_m_s, speed_m_s),
            flights=asked.flights,
            reports_ground=True,
        )
        return cls(file=file, mission=mission)

    def bench_config(self) -> GuardConfig:
        """Limits of the guard without a mission: a person commands the belts, slowly."""
        config = self._config(replace(self.mission, loop="open", reports_ground=False), BENCH_PERIOD_S)
        slow_m_s = min(config.slow_limit_m_s, config.belt_limit_m_s)
        return replace(config, belt_limit_m_s=slow_m_s, has_planner=False, needs_heading=True, has_camera=False)

    def drive_config(self, period_s: float, frame_s: float) -> GuardConfig:
        """Limits of the guard for a drive.

        A chair whose camera is silent holds soon, from the moment at which its next frame is due (row 1 of the table of hazards).

        Args:
            period_s: Control period [s].
            frame_s: Period of the camera's frames [s].
        """
        config = self._config(self.mission, period_s)
        return replace(config, blind_timeout_s=frame_s + config.silence_s)

    def _config(self, mission: MissionConfig, period_s: float) -> GuardConfig:
        """Limits of the guard of a real chair, which holds soon where the inertial sensor is silent or frozen.

        Driving on by one sensor alone, as the simulated chair does, was never tried on a real one. A part of the time is taken to
        detect a frozen gyro (row 8 of the table of hazards).
        """
        config = guard_config(mission, period_s)
        vision_only_s = config.silence_s - StuckRule().for_s
        return replace(config, battery_least_v=self.file.limits.battery_least_v, vision_only_s=vision_only_s)


def camera_of(file: RobotFile) -> CameraThread:
    """Return the running camera of a chair.

    Raises:
        SettingsError: If the robot file names none.
        LinkError: If its class does not exist.
    """
    if file.camera is None:
        raise SettingsError("no [camera] in the robot file, and only --bench drives without one; add source and calibration")
    source, options = file.camera.source, file.camera.model_extra or {}
    camera = open_driver("camera", {"class": ":".join(CAMERAS.get(source, [source])), "options": options})
    return CameraThread(LiveFrames(camera, calibration=read_camera(Path(file.camera.calibration)), colour=True))


@contextmanager
def _recorded(robot: Robot, out: Path, config: GuardConfig, images: int) -> Iterator[SceneLog]:
    """Begin a run folder and yield its log."""
    settings = {"robot": robot.file.model_dump(mode="json")}
    manifest = begin_run(out, settings, 0, robot.mission.controller, guard=asdict(config))
    with (
        RunLog(out / LOG, image_every=images, metadata=log_metadata(manifest, None, out)) as log,
        SceneLog(log, robot.mission.chair, Chair(payload_kg=robot.mission.payload_kg)) as scene,
    ):
        yield scene


def record(file: RobotFile, out: Path, seconds: float) -> dict[str, Any]:
    """Record all sensors without motion, with every frame, for ``treadline replay``.

    Raises:
        TreadlineError: If a device does not open, or is lost.
    """
    robot = Robot.of(file.model_copy(update={"handset": None}))
    config, count = robot.bench_config(), 0
    camera = None if file.camera is None else camera_of(file)
    with _connected(robot, camera) as client, _recorded(robot, out, config, 1) as scene:
        session = BenchSession(client, config, "recording without motion", scene, camera=camera, rearms=False)
        with suppress(KeyboardInterrupt):
            while session.t_s < seconds:
                count += sum(isinstance(reading, RgbdFrame) for reading in session.tick())
    return _ended(out, "time_up", None, session.t_s, []) | {"frames": count}


def bench(file: RobotFile, out: Path, seconds: float, say: Callable[[str], None]) -> dict[str, Any]:
    """Run the arming list, then drive its belts by the handset's stick, at most 0.1 m/s.

    Raises:
        TreadlineError: If a device does not open, arming fails, or a link is lost.
    """
    config = Robot.of(file).bench_config()
    limits = file.limits.model_copy(update={"belt_m_s": config.belt_limit_m_s})  # for the box as well
    file = file.model_copy(update={"limits": limits})
    robot = Robot.of(file)
    events: list[Event] = []
    with _connected(robot, None, say) as client, _recorded(robot, out, config, 0) as scene:
        session = BenchSession(client, config, "not armed", _declared(scene, events, say))
        arming = Arming(session, client, file, robot.mission.chair, say)
        arming.sensors(None)
        arming.dead_man()
        arming.signs()
        say(f"bench: the stick (keyboard: hold w, s, a, d) drives at most {config.belt_limit_m_s:g} m/s; Ctrl-C ends")
        end_s = session.t_s + seconds
        with suppress(KeyboardInterrupt):
            while session.t_s < end_s:
                speed, turn = client.stick.speed, client.stick.turn
                session.tick(config.belt_limit_m_s * (speed - turn), config.belt_limit_m_s * (speed + turn))
    return _ended(out, "time_up", None, session.t_s, events)


def drive(file: RobotFile, out: Path, seconds: float, say: Callable[[str], None], *, images: int = 0) -> dict[str, Any]:
    """Run the arming list, then drive the mission until it arrives, refuses, or the chair can no longer be driven.

    Args:
        images: Keep every n-th frame in the log; 0 keeps none.

    Raises:
        TreadlineError: If a device does not open, or arming fails.
    """
    robot = Robot.of(file)
    blocks = build_blocks(robot.mission)
    warm_up(robot.mission)
    if robot.mission.chair.flipper is None:
        say("no flipper: floors, ramps and kerbs within its limits; a flight beyond them is refused before it is entered")
    events: list[Event] = []
    camera, t_s = camera_of(file), 0.0
    with _connected(robot, camera, say) as client:
        arming = Arming(BenchSession(client, robot.bench_config(), "not armed"), client, file, robot.mission.chair, say)
        arming.sensors(camera)
        arming.dead_man()
        if not arming.signs():
            raise SettingsError("the belts are lifted: put the chair on the floor, or run --bench")
        config = robot.drive_config(blocks.driver.period_s, camera.period_s)
        with _recorded(robot, out, config, images) as scene:
            say("armed; release the dead-man switch, then hold it and re-arm: the chair drives")
            start_s = client.begin(config, "armed: waits for a re-arm")
            mission = Mission(RobotPlant(client, start_s, camera), replace(blocks, guard=client), _declared(scene, events, say))
            over: tuple[str, str | None] | None = None
            with mission.watchdog, suppress(KeyboardInterrupt):
                while over is None:
                    tick = mission.tick()
                    t_s = tick.t_s
                    scene.plan(tick.plan)
                    over = _ending(tick, client.lost, seconds)
    return _ended(out, *(over or ("ended", "by the operator")), t_s, events)


def _ending(tick: Tick, lost: str | None, seconds: float) -> tuple[str, str | None] | None:
    """Return verdict and cause of a drive that is over."""
    if lost is not None:
        return "held", lost
    if tick.plan.phase in ("arrived", "refused"):
        return tick.plan.phase, tick.plan.cause or None
    return ("time_up", None) if tick.t_s > seconds else None


def _declared(sink: Callable[[Any, float], None], events: list[Event], say: Callable[[str], None]) -> Callable[[Any, float], None]:
    """Return a sink that also keeps events, and reports them to the person."""

    def take(signal: Any, t_s: float) -> None:
        if isinstance(signal, Event):
            events.append(signal)
            say(f"{t_s:7.2f} s {signal.name}: {signal.cause}")
        sink(signal, t_s)

    return take


@contextmanager
def _connected(robot: Robot, camera: CameraThread | None, say: Callable[[str], None] = lambda _: None) -> Iterator[GuardClient]:
    """Yield the guard process; the chair is stopped, and process and camera are released, at the end, however it comes."""
    with ExitStack() as stack:
        if camera is not None:
            stack.callback(camera.close)
        client = GuardClient(robot.file)
        stack.callback(client.close)
        say(f"loop: {stack.enter_context(real_time(LOOP))}; guard: {client.note}")
        yield client


def _ended(out: Path, verdict: str, cause: str | None, duration_s: float, events: list[Event]) -> dict[str, Any]:
    """Write the result of a run and the time series that its page draws, as far as they were measured; return the result."""
    values = {"verdict": verdict, "cause": cause, "duration_s": duration_s, "events": [asdict(event) for event in events]}
    write_result(out, values)
    run = read_recording(out)
    (left_m_s, right_m_s), angles = run.belt_m_s.T, ("estimate", "pitch", "seat_pitch")
    degrees = {f"{name}_deg": getattr(run, f"{name}_rad") / DEG for name in angles}
    write_series(out, {"t_s": run.t_s, **degrees, "left_m_s": left_m_s, "right_m_s": right_m_s})
    return values
