"""Policies: baselines, plug-ins (``module:Class``, ``file.py:Class``) and ONNX files.

A policy is a class, or a function, that takes ``Spaces`` and returns a function ``observation -> action``, a new one for each
episode.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError, did_you_mean
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


def random_actions(spaces: Spaces) -> Policy:
    """Return the baseline of uniformly distributed actions."""
    rng = np.random.default_rng(0)
    return lambda _: rng.uniform(-1.0, 1.0, len(spaces.action))


def proportional(spaces: Spaces, gain: float = 1.0) -> Policy:
    """Return the baseline of a proportional heading controller at constant speed, with a level seat and a flipper that stays.

    Args:
        gain: Belt action per heading error [1/rad], on each belt with opposite signs.
    """

    def policy(observation: np.ndarray) -> Float[np.ndarray, " a"]:
        seen = dict(zip(spaces.observation, observation.tolist(), strict=True))
        speed, turn = SPEED * seen["direction"], gain * seen["heading_rad"]
        asked = {"left_m_s": speed + turn, "right_m_s": speed - turn, "seat_m_s": SEAT_GAIN * seen["seat_pitch_rad"]}
        return np.clip([asked.get(name, 0.0) for name in spaces.action], -1.0, 1.0)

    return policy


def onnx_policy(path: str) -> Policy:
    """Return the policy of an ONNX file: one input of a batch of observations, whose first output is a batch of actions.

    Raises:
        SettingsError: If onnxruntime is missing, or the file is no model.
    """
    try:
        import onnxruntime

        session = onnxruntime.InferenceSession(Path(path).read_bytes(), providers=["CPUExecutionProvider"])
    except ModuleNotFoundError:
        raise SettingsError(f"{path}: needs onnxruntime; pip install 'treadline[onnx]'") from None
    except Exception as error:  # onnxruntime has an error class for each cause
        raise SettingsError(f"{path}: no ONNX model: {error}") from error
    name = session.get_inputs()[0].name
    return lambda observation: session.run(None, {name: observation[None].astype(np.float32)})[0][0]


BASELINES: Mapping[str, PolicyMaker] = {
    "random": random_actions,
    "straight": partial(proportional, gain=0.0),
    "proportional": proportional,
}
"""Baselines by name; ``SHIPPED`` is one more."""


@cache
def load_policy(source: str) -> PolicyMaker:
    """Return the policy behind a baseline's name, ``module:Class``, ``file.py:Class`` or an ONNX file.

    Raises:
        SettingsError: If there is none, or it cannot be loaded.
    """
    if source in BASELINES:
        return BASELINES[source]
    if source.endswith(".onnx"):
        policy = onnx_policy(source)
        return lambda _: policy
    if ":" not in source and not source.endswith(".py"):
        known = [*BASELINES, SHIPPED]
        raise SettingsError(
            f"policy '{source}': neither module:Class, file.py:Class, FILE.onnx, nor one of {', '.join(known)}"
            f"{did_you_mean(source, known)}"
        )
    maker: PolicyMaker = load_plugin("policy", source)
    return maker
