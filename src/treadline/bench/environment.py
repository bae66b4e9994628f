"""Environment of a task: actions of belts, flipper and seat in; observation, reward and the end of an episode out.

``Action (50 Hz) -> commands -> plant (100 Hz ticks) -> ground truth -> observation, reward``. The plant is the simulator's own.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from jaxtyping import Float, UInt8

from treadline.bench.observers import LIMITS, Oracle, Tracker
from treadline.bench.tasks import See, draw, task_named
from treadline.core.angles import DEG
from treadline.core.errors import SettingsError, SimulationDiverged
from treadline.core.ports import Truth
from treadline.core.signals import TICK_S, FlipperCommand, SeatCommand, TrackCommand
from treadline.plant.mujoco import FAST, NOMINAL, ChairState, MujocoPlant, Physics, open_plant
from treadline.run.ending import Ending
from treadline.run.episode import Sink
from treadline.scenario.chair import ChairDescription, read_chair
from treadline.vehicle.comfort import SETTLED_RAD

TICKS = 2
"""Ticks of the plant in a step: 50 Hz."""
BELT_M_S = 0.3
"""Belt speed of an action of 1 [m/s]: the largest ``drive.speed_m_s`` of a scenario."""
PHYSICS: Mapping[str, Physics] = {"nominal": NOMINAL, "fast": FAST}
"""Numerical settings by name."""
BEYOND = 1.0 + 1e-6
"""Largest magnitude of an action: 1, rounded to single precision."""

Observation = Float[np.ndarray, " n"]


def action_scales(chair: ChairDescription) -> dict[str, float]:
    """Return the names of a vehicle's actions, and the command of an action of 1.

    ``left_m_s`` and ``right_m_s`` are belt speeds, positive up the flight; ``flipper_rad_s`` raises the flipper, with all sections
    that follow it; ``seat_m_s`` lengthens the seat's stroke, which leans the seat forward.
    """
    belt_m_s = min(BELT_M_S, chair.drives.max_speed_m_s)
    scales = {"left_m_s": belt_m_s, "right_m_s": belt_m_s}
    if chair.flipper is not None:
        scales["flipper_rad_s"] = chair.flipper.max_rate_deg_s * DEG
    return scales if chair.seat is None else scales | {"seat_m_s": chair.seat.max_rate_m_s}


class StairEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """A tracked vehicle on a stair.

    The reward of a step is the share of the way that is newly covered; the end of an episode that is no arrival costs 1.

    Args:
        task: Name of the task.
        see: Source of the observation.
        vehicle: Shipped chair, or path of a chair's file.
        physics: Numerical settings: ``fast`` to learn, ``nominal`` for scores.
        friction: Belt friction coefficient in place of the scenario's, also beyond its range; FTR-Bench has 10.
        changes: Values in place of the drawn ones, by dotted key of a scenario.
        episodes_per_stair: Number of episodes between two draws of a scenario.
        render_mode: Render mode of gymnasium.

    Raises:
        SettingsError: If an argument is not allowed, or the vehicle lacks what the task needs.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / (TICKS * TICK_S))}  # noqa: RUF012 - gymnasium's form

    def __init__(
        self,
        task: str = "StairUp",
        *,
        see: See = "oracle",
        vehicle: str = "wheelchair",
        physics: str = "fast",
        friction: float | None = None,
        changes: Mapping[str, object] | None = None,
        episodes_per_stair: int = 1,
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        for name, given, allowed in (("see", see, ("oracle", "tracker")), ("physics", physics, tuple(PHYSICS))):
            if given not in allowed:
                raise SettingsError(f"{name} is '{given}'; allowed: {', '.join(allowed)}")
        if friction is not None and not 0.0 < friction < np.inf:
            raise SettingsError(f"friction is {friction:g}; it must be above 0 and finite")
        self.task, self.see, self.render_mode = task_named(task), see, render_mode
        self._draw: Callable[[int], Any] = lambda seed: draw(task, seed, see=see, vehicle=vehicle, changes=changes)
        self._physics, self._friction, self._episodes_per_stair = PHYSICS[physics], friction, episodes_per_stair
        chair = read_chair(vehicle)
        if see == "tracker":
            chair.mount_of(rear="down" in self.task.fixed.values())
        self.scales = action_scales(chair)
        self.observation_space = gymnasium.spaces.Box(-LIMITS.astype(np.float32), LIMITS.astype(np.float32), dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (len(self.scales),), np.float32)
        self.sink: Sink | None = None
        """Receives all readings and the ground truth of each tick, for a recording; steps without a sink are faster."""
        self._plant: MujocoPlant | None = None
        self._observer: Oracle | Tracker
        self._episodes = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; a seed draws the scenario of that seed."""
        super().reset(seed=seed, options=options)
        if seed is not None or self._plant is None or self._episodes >= self._episodes_per_stair:
            self._open(int(self.np_random.integers(2**31)) if seed is None else seed)
        self._episodes += 1
        plant, scenario = self._opened(), self.scenario
        plant.start()
        sign, self._step = 1.0 if scenario.drive.direction == "up" else -1.0, 0
        self._ending.restart()
        if self.see == "tracker":
            self._observer = Tracker(sign, 0.5 * self.chair.tracks.flat_run_m)
        state, truth = self._sense()
        self.way_m = self._ending.way_m(truth.x_m, on_flight=self.task.on_flight)
        self._sign, self._furthest_m = sign, sign * truth.x_m
        self._latest = truth
        return self._observation(state, truth), {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Drive for 20 ms.

        Raises:
            SettingsError: If the action is not finite, out of bounds, or of the wrong shape, or no episode has begun.
        """
        plant = self._opened()
        self._command(plant, self._checked(action))
        self._step += 1
        try:
            state, truth = self._advance(plant)
        except SimulationDiverged as error:
            return self._last, -1.0, True, False, {"verdict": "diverged", "cause": str(error)}
        self._latest = truth
        over = self._over(truth)
        onward_m = max(self._sign * truth.x_m - self._furthest_m, 0.0)
        self._furthest_m += onward_m
        reward = onward_m / self.way_m - float(over is not None and over[0] != "arrived")
        late = over is None and self._step * TICKS * TICK_S >= self.scenario.drive.duration_s
        info = {"verdict": "time_up", "cause": None} if late else {}
        if over is not None:
            info = {"verdict": over[0], "cause": over[1]}
        return self._observation(state, truth), reward, over is not None, late, info

    def render(self) -> UInt8[np.ndarray, "h w 3"] | None:
        """Return the side view of the chair on the ground as an image; None without a render mode."""
        if self.render_mode is None:
            return None
        from treadline.report.walk_figure import side_image
        from treadline.vehicle.ground_profile import ground_profile
        from treadline.vehicle.rest_poses import rest_chair

        plant, truth = self._opened(), self._latest
        return side_image(
            ground_profile(plant.staircase),
            rest_chair(self.chair, self.scenario.chair.payload_kg),
            (truth.chassis_x_m, truth.chassis_z_m, truth.pitch_rad),
            plant.state.flipper_rad,
        )

    def close(self) -> None:
        """Release the plant; a second call does nothing."""
        self._plant = None

    def _open(self, seed: int) -> None:
        self.scenario, self._episodes = self._draw(seed), 0
        self.chair: ChairDescription = self.scenario.read_chair()
        self._plant = open_plant(self.scenario, seed, chair=self.chair, physics=self._physics)
        self._ending = Ending(self.scenario, self.chair)
        self._observer = Oracle(self._plant.staircase, 1.0 if self.scenario.drive.direction == "up" else -1.0)
        if self._friction is not None:
            self._plant.set_friction(self._friction)

    def _opened(self) -> MujocoPlant:
        if self._plant is None:
            raise SettingsError("the environment has no episode; call reset before step and render")
        return self._plant

    def _checked(self, action: np.ndarray) -> Float[np.ndarray, " a"]:
        """Return an action within bounds."""
        given = np.asarray(action, dtype=float) if np.ndim(action) == 1 else np.asarray(action)
        if given.shape != self.action_space.shape:
            names = ", ".join(self.scales)
            raise SettingsError(f"the action has shape {given.shape}; wanted {self.action_space.shape}: {names}")
        if not np.abs(given).max() <= BEYOND:  # also where one is NaN
            wrong = int(np.flatnonzero(~(np.abs(given) <= BEYOND))[0])
            raise SettingsError(f"action {wrong} ({list(self.scales)[wrong]}) is {given[wrong]:g}; it must be from -1 to 1")
        return given

    def _command(self, plant: MujocoPlant, action: Float[np.ndarray, " a"]) -> None:
        t_s = self._step * TICKS * TICK_S
        asked = {name: scale * part for (name, scale), part in zip(self.scales.items(), action.tolist(), strict=True)}
        plant.write(
            TrackCommand(t_s=t_s, left_m_s=asked["left_m_s"], right_m_s=asked["right_m_s"]),
            SeatCommand(t_s=t_s, rate_m_s=asked.get("seat_m_s", 0.0)),
            FlipperCommand(t_s=t_s, rate_rad_s=asked.get("flipper_rad_s", 0.0)),
        )

    def _advance(self, plant: MujocoPlant) -> tuple[ChairState, Truth]:
        if self.sink is None and self.see == "oracle":
            return plant.drive(TICKS)
        plant.advance(self._step * TICKS * TICK_S)
        return self._sense()

    def _sense(self) -> tuple[ChairState, Truth]:
        """Take the readings and the ground truth since the last call."""
        plant = self._opened()
        readings, truths = plant.read(), plant.truth()
        for reading in readings:
            self._observer.update(reading)
        if self.sink is not None:
            for signal in (*readings, *truths):
                self.sink(signal, truths[-1].t_s)
        return plant.state, truths[-1]

    def _observation(self, state: ChairState, truth: Truth) -> np.ndarray:
        seen = self._observer.observe(state, truth)
        self._last = np.minimum(np.maximum(seen, -LIMITS), LIMITS).astype(np.float32)
        return self._last

    def _over(self, truth: Truth) -> tuple[str, str | None] | None:
        """Return verdict and cause of the end of the episode; None while it goes on."""
        if (fallen := self._ending.fall(truth)) is not None:
            return fallen
        if not self.task.on_flight:
            return ("arrived", None) if self._ending.is_beyond(truth) else None
        if truth.x_m < self._ending.end_x_m:
            return None
        if abs(truth.heading_rad) <= SETTLED_RAD:
            return "arrived", None
        return "not_square", f"{abs(truth.heading_rad) / DEG:.1f}° off at the last nosing; at most {SETTLED_RAD / DEG:g}°"


class ThreadVectorEnv(SyncVectorEnv):
    """Environments side by side, stepped by threads: the simulator's loop runs outside Python's lock.

    An episode that ends is followed by the next one in the same step.

    Args:
        makers: Functions that return the environments.
        threads: Number of threads.
    """

    def __init__(self, makers: Sequence[Callable[[], gymnasium.Env[np.ndarray, np.ndarray]]], threads: int = 2) -> None:
        super().__init__(makers, autoreset_mode=AutoresetMode.SAME_STEP)
        self._shares = np.array_split(np.arange(self.num_envs), min(threads, self.num_envs))
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


def make_vec(task: str, num_envs: int, threads: int = 2, **options: Any) -> ThreadVectorEnv:
    """Return environments of a task side by side.

    Args:
        num_envs: Number of environments.
        threads: Number of threads, at most that of the cores.
        options: Further arguments of ``StairEnv``.
    """
    return ThreadVectorEnv([lambda: StairEnv(task, **options)] * num_envs, threads)
