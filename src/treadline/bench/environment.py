"""Environment of a task: actions of belts, flipper and seat in; observation, reward and the end of an episode out.

``Action (50 Hz) -> commands -> plant (100 Hz ticks) -> ground truth -> observation, reward``. The plant is the simulator's own.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from jaxtyping import UInt8

from treadline.bench.observers import LIMITS, Oracle, Tracker
from treadline.bench.tasks import TaskSetup
from treadline.core.angles import DEG
from treadline.core.errors import SettingsError, SimulationDiverged
from treadline.core.signals import CLIMB_MOST_M_S, TICK_S, FlipperCommand, SeatCommand, TrackCommand
from treadline.plant.mujoco import ChairState, MujocoPlant
from treadline.run.ending import Ending
from treadline.run.episode import Sink
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.scenario.scenario import Scenario
from treadline.vehicle.comfort import SETTLED_RAD
from treadline.vehicle.ground_profile import ground_profile

TICKS = 2
"""Ticks of the plant in a step: 50 Hz."""
STEP_S = TICKS * TICK_S
BEYOND = 1.0 + 1e-6
"""Largest magnitude of an action: 1, rounded to single precision."""


def action_scales(chair: ChairDescription) -> dict[str, float]:
    """Return the names of a vehicle's actions, and the command of an action of 1: of a belt, the largest speed of a scenario.

    ``left_m_s`` and ``right_m_s`` are belt speeds, positive up the flight; ``flipper_rad_s`` raises the flipper, with all sections
    that follow it; ``seat_m_s`` lengthens the seat's stroke, which leans the seat forward.
    """
    belt_m_s = min(CLIMB_MOST_M_S, chair.drives.max_speed_m_s)
    scales = {"left_m_s": belt_m_s, "right_m_s": belt_m_s}
    if chair.flipper is not None:
        scales["flipper_rad_s"] = chair.flipper.max_rate_deg_s * DEG
    return scales if chair.seat is None else scales | {"seat_m_s": chair.seat.max_rate_m_s}


class StairEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A tracked vehicle on a stair.

    The reward of a step is the share of the way that is newly covered; the end of an episode that is no arrival costs 1.

    Args:
        task: Name of the task.
        episodes_per_stair: Number of episodes between two draws of a scenario.
        render_mode: Render mode of gymnasium.
        setup: Further values of ``TaskSetup``: ``see``, ``vehicle``, ``physics``, ``friction``, ``changes``.

    Raises:
        SettingsError: If an argument is not allowed, or the vehicle lacks what the task needs.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / STEP_S)}  # noqa: RUF012 - gymnasium's form

    def __init__(
        self,
        task: str = "StairUp",
        *,
        episodes_per_stair: int = 1,
        render_mode: Literal["rgb_array"] | None = None,
        **setup: Any,
    ) -> None:
        self.setup, self.render_mode = TaskSetup(task=task, **setup), render_mode
        self.scales = action_scales(read_chair(self.setup.vehicle))
        self.observation_space = gymnasium.spaces.Box(-LIMITS.astype(np.float32), LIMITS.astype(np.float32), dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(self.scales),), np.float32)
        self.sink: Sink | None = None
        """Receives all readings and the ground truth of each tick, for a recording; steps without a sink are faster."""
        self._plant: MujocoPlant | None = None
        self._episodes_per_stair, self._episodes = episodes_per_stair, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; a seed draws the scenario of that seed, unless the options hold one as ``scenario``."""
        super().reset(seed=seed, options=options)
        if seed is not None or self._plant is None or self._episodes >= self._episodes_per_stair:
            drawn = int(self.np_random.integers(2**31)) if seed is None else seed
            self._open((options or {}).get("scenario") or self.setup.scenario(drawn), drawn)
        self._episodes += 1
        self._step = 0
        self._opened().start()
        self._ending.restart()
        tracked = self.setup.see == "tracker"
        half_m = 0.5 * self.chair.tracks.flat_run_m
        self._observer = Tracker(self._sign, half_m) if tracked else Oracle(self._ground, self._sign)
        state = self._sense()
        self._way_m, self._furthest_m = self._ending.way_m(self._latest.x_m), self._sign * self._latest.x_m
        return self._observation(state), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Drive for 20 ms.

        Raises:
            SettingsError: If the action is not finite, out of bounds, or of the wrong shape, or no episode has begun.
        """
        plant = self._opened()
        self._command(plant, action)
        self._step += 1
        try:
            state = self._advance(plant)
        except SimulationDiverged as error:
            return self._last, -1.0, True, False, {"verdict": "diverged", "cause": str(error)}
        onward_m = max(self._sign * self._latest.x_m - self._furthest_m, 0.0)
        self._furthest_m += onward_m
        reward, seen = onward_m / self._way_m, self._observation(state)
        over = self._over()
        if over is None:
            return seen, reward, False, False, {}
        verdict, cause = over
        late = verdict == "time_up"
        cost = 0.0 if late or verdict == "arrived" else 1.0
        return seen, reward - cost, not late, late, {"verdict": verdict, "cause": cause}

    def render(self) -> UInt8[np.ndarray, "h w 3"] | None:
        """Return the side view of the chair on the ground as an image; None without a render mode."""
        if self.render_mode is None:
            return None
        from treadline.report.walk_figure import side_image
        from treadline.vehicle.rest_poses import rest_chair

        plant, truth = self._opened(), self._latest
        chair = rest_chair(self.chair, self.scenario.chair.payload_kg)
        pose = truth.chassis_x_m, truth.chassis_z_m, truth.pitch_rad
        return side_image(self._ground, chair, pose, plant.state.flipper_rad)

    def close(self) -> None:
        """Release the plant; a second call does nothing."""
        self._plant = None

    def _open(self, scenario: Scenario, seed: int) -> None:
        self.scenario, self._episodes = scenario, 0
        self.chair: ChairDescription = scenario.read_chair()
        self._sign = 1.0 if scenario.drive.direction == "up" else -1.0
        self._plant = self.setup.open_plant(scenario, seed)
        self._ground = ground_profile(self._plant.staircase)
        self._ending = Ending(scenario, self.chair)

    def _opened(self) -> MujocoPlant:
        if self._plant is None:
            raise SettingsError("the environment has no episode; call reset before step and render")
        return self._plant

    def _command(self, plant: MujocoPlant, action: np.ndarray) -> None:
        """Write the commands of an action that is within bounds."""
        given = np.asarray(action, dtype=float)
        if given.shape != self.action_space.shape:
            raise SettingsError(f"the action has shape {given.shape}; wanted {self.action_space.shape}: {', '.join(self.scales)}")
        asked = dict.fromkeys(("flipper_rad_s", "seat_m_s"), 0.0)
        for number, (name, part) in enumerate(zip(self.scales, given.tolist(), strict=True)):
            if not abs(part) <= BEYOND:  # also where it is NaN
                raise SettingsError(f"action {number} ({name}) is {part:g}; it must be from -1 to 1")
            asked[name] = self.scales[name] * part
        t_s = self._step * STEP_S
        plant.write(
            TrackCommand(t_s=t_s, left_m_s=asked["left_m_s"], right_m_s=asked["right_m_s"]),
            SeatCommand(t_s=t_s, rate_m_s=asked["seat_m_s"]),
            FlipperCommand(t_s=t_s, rate_rad_s=asked["flipper_rad_s"]),
        )

    def _advance(self, plant: MujocoPlant) -> ChairState:
        if self.sink is None and self.setup.see == "oracle":
            state, self._latest = plant.drive(TICKS)
            return state
        plant.advance(self._step * STEP_S)
        return self._sense()

    def _sense(self) -> ChairState:
        """Take the readings and the ground truth since the last call."""
        plant = self._opened()
        readings, truths = plant.read(), plant.truth()
        self._latest = truths[-1]
        for reading in readings:
            self._observer.update(reading)
        if self.sink is not None:
            for signal in (*readings, *truths):
                self.sink(signal, self._latest.t_s)
        return plant.state

    def _observation(self, state: ChairState) -> np.ndarray:
        seen = self._observer.observe(state, self._latest)
        self._last = np.minimum(np.maximum(seen, -LIMITS), LIMITS).astype(np.float32)
        return self._last

    def _over(self) -> tuple[str, str | None] | None:
        """Return verdict and cause of the end of the episode; None while it goes on."""
        truth = self._latest
        if (fallen := self._ending.fall(truth)) is not None:
            return fallen
        if not self._ending.is_on_flight:
            if self._ending.is_beyond(truth):
                return "arrived", None
        elif truth.x_m >= self._ending.end_x_m:
            off_deg = abs(truth.heading_rad) / DEG
            if off_deg <= SETTLED_RAD / DEG:
                return "arrived", None
            return "not_square", f"{off_deg:.1f}° off at the last nosing; at most {SETTLED_RAD / DEG:g}°"
        return ("time_up", None) if self._step * STEP_S >= self.scenario.drive.duration_s else None


class ThreadVectorEnv(SyncVectorEnv):
    """Environments of a task side by side, stepped by threads: the simulator's loop runs outside Python's lock.

    An episode that ends is followed by the next one in the same step.

    Args:
        num_envs: Number of environments.
        threads: Number of threads, at most that of the cores.
        options: Further arguments of ``StairEnv``.
    """

    def __init__(self, task: str, num_envs: int, threads: int = 2, **options: Any) -> None:
        super().__init__([lambda: StairEnv(task, **options)] * num_envs, autoreset_mode=AutoresetMode.SAME_STEP)
        self._shares = np.array_split(np.arange(num_envs), min(threads, num_envs))
        self._pool = ThreadPoolExecutor(len(self._shares))

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Step all environments; of an episode that ended, ``final_obs`` and ``final_info`` are in the information."""
        ended = [item for found in self._pool.map(lambda share: self._step_share(share, actions), self._shares) for item in found]
        infos: dict[str, Any] = {}
        for index, final, begun in ended:
            infos = self._add_info(self._add_info(infos, final, index), begun, index)
        seen: np.ndarray = np.array(self._env_obs, dtype=np.float32)
        return seen, self._rewards.copy(), self._terminations.copy(), self._truncations.copy(), infos

    def _step_share(self, share: np.ndarray, actions: np.ndarray) -> list[tuple[int, dict[str, Any], dict[str, Any]]]:
        ended = []
        for i in share.tolist():
            seen, self._rewards[i], self._terminations[i], self._truncations[i], info = self.envs[i].step(actions[i])
            if self._terminations[i] or self._truncations[i]:
                final = {"final_obs": seen, "final_info": info}
                seen, begun = self.envs[i].reset()
                ended.append((i, final, begun))
            self._env_obs[i] = seen
        return ended

    def close_extras(self, **kwargs: Any) -> None:
        """Release threads and environments."""
        self._pool.shutdown()
        super().close_extras(**kwargs)


make_vec = ThreadVectorEnv
"""Name that gymnasium gives to the function for environments side by side."""
