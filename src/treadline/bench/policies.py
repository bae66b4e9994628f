"""Policies: baselines, plug-ins (``module:Class``, ``file.py:Class``) and ONNX files.

A policy is a class, or a function, that takes ``Spaces`` and returns a function ``observation -> action``, a new one for each
episode.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError, closest
from treadline.mission.plugins import load_plugin

Policy = Callable[[np.ndarray], np.ndarray]
"""Function of an observation that returns an action."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Spaces:
    """Names of the numbers that a policy receives and returns; each action is from -1 to 1."""

    observation: tuple[str, ...]
    action: tuple[str, ...]


PolicyMaker = Callable[[Spaces], Policy]
SHIPPED = "shipped"
"""Policy that is the mission with the shipped controller and planners, which reads sensors itself."""
SPEED = 2.0 / 3.0
"""Belt speed of the baselines as an action: 0.2 m/s, the speed of the tasks."""
SEAT_GAIN = 2.0
"""Seat action per seat pitch [1/rad]: 0.12 m/s per rad at the shipped wheelchair's actuator, less than its leveller has."""


class RandomActions:
    """Baseline of uniformly distributed actions."""

    def __init__(self, spaces: Spaces) -> None:
        self._count, self._rng = len(spaces.action), np.random.default_rng(0)

    def __call__(self, observation: np.ndarray) -> Float[np.ndarray, " a"]:
        """Return an action."""
        del observation
        return self._rng.uniform(-1.0, 1.0, self._count)


class Proportional:
    """Baseline of a proportional heading controller at constant speed, with a level seat and a flipper that stays.

    Args:
        gain: Belt action per heading error [1/rad], on each belt with opposite signs.
    """

    def __init__(self, spaces: Spaces, gain: float = 1.0) -> None:
        self._spaces, self._gain = spaces, gain

    def __call__(self, observation: np.ndarray) -> Float[np.ndarray, " a"]:
        """Return an action."""
        seen = dict(zip(self._spaces.observation, observation.tolist(), strict=True))
        speed, turn = SPEED * seen["direction"], self._gain * seen["heading_rad"]
        asked = {"left_m_s": speed + turn, "right_m_s": speed - turn, "seat_m_s": SEAT_GAIN * seen["seat_pitch_rad"]}
        return np.clip([asked.get(name, 0.0) for name in self._spaces.action], -1.0, 1.0)


def straight(spaces: Spaces) -> Policy:
    """Return the baseline of equal belt speeds."""
    return Proportional(spaces, gain=0.0)


BASELINES: Mapping[str, PolicyMaker] = {"random": RandomActions, "straight": straight, "proportional": Proportional}
"""Baselines by name; ``SHIPPED`` is one more."""


class OnnxPolicy:
    """Policy of an ONNX file: one input of a batch of observations, whose first output is a batch of actions.

    The file's metadata may hold ``observation`` and ``action``, the names of its numbers with commas between; they must agree.

    Raises:
        SettingsError: If onnxruntime is missing, the file is no model, or it was made for other numbers.
    """

    def __init__(self, path: Path, spaces: Spaces) -> None:
        try:
            import onnxruntime
        except ModuleNotFoundError:
            raise SettingsError(f"{path}: needs onnxruntime; pip install 'treadline[onnx]'") from None
        if not path.is_file():
            raise SettingsError(f"{path}: no such file; correct the path")
        try:
            self._session = onnxruntime.InferenceSession(path.read_bytes(), providers=["CPUExecutionProvider"])
        except Exception as error:
            raise SettingsError(f"{path}: no ONNX model: {error}") from error
        made_for = self._session.get_modelmeta().custom_metadata_map
        for kind, names in (("observation", spaces.observation), ("action", spaces.action)):
            if made_for.get(kind, ",".join(names)) != ",".join(names):
                raise SettingsError(f"{path}: made for the {kind} {made_for[kind]}; this vehicle has {','.join(names)}")
        given = self._session.get_inputs()[0]
        if given.shape[-1] not in {len(spaces.observation), None} and not isinstance(given.shape[-1], str):
            raise SettingsError(f"{path}: takes {given.shape[-1]} numbers; an observation has {len(spaces.observation)}")
        self._input = given.name

    def __call__(self, observation: np.ndarray) -> Float[np.ndarray, " a"]:
        """Return an action."""
        return np.asarray(self._session.run(None, {self._input: observation[None].astype(np.float32)})[0])[0]


@cache
def load_policy(source: str) -> PolicyMaker:
    """Return the policy behind a baseline's name, ``module:Class``, ``file.py:Class`` or an ONNX file.

    Raises:
        SettingsError: If there is none, or it cannot be loaded.
    """
    if source in BASELINES:
        return BASELINES[source]
    if source.endswith(".onnx"):
        return lambda spaces: OnnxPolicy(Path(source), spaces)
    if ":" not in source and not source.endswith(".py"):
        known = [*BASELINES, SHIPPED]
        close = closest(source, known)
        meant = "" if close is None else f"; did you mean '{close}'?"
        raise SettingsError(
            f"policy '{source}': neither module:Class, file.py:Class, FILE.onnx, nor one of {', '.join(known)}{meant}"
        )
    maker: PolicyMaker = load_plugin("policy", source)
    return maker
