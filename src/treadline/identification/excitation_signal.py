"""Random track speeds for identification that keep the chair on the stair.

Paper: Section VI.B, "a set of random velocities". Each period draws new speeds around the climb speed. A weak
proportional steering towards zero heading bounds the drift of the heading. The inputs then depend on past outputs, a
closed loop that OKID's observer form tolerates as long as the random part dominates.
"""

from dataclasses import dataclass

import numpy as np

from treadline.core.angles import DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationConfig:
    """Amplitudes of the random track speeds."""

    mean_m_s: float = 0.2
    amplitude_m_s: float = 0.1
    """Half width of each belt's uniform distribution [m/s]."""
    pull_m_s_per_rad: float = 0.3
    """Steering gain: belt speed difference per heading [m/s/rad]; about a tenth of the random part at 5°."""
    window_rad: float = 5.0 * DEG
    """Heading beyond which the steering gain doubles [rad]."""


class Excitation:
    """Generator of one pair of belt speeds per call."""

    def __init__(self, config: ExcitationConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng

    def step(self, heading_rad: float) -> tuple[float, float]:
        """Return belt speeds (left, right) [m/s] for a heading [rad]."""
        config = self._config
        left, right = self._rng.uniform(-config.amplitude_m_s, config.amplitude_m_s, 2)
        strength = config.pull_m_s_per_rad * (2.0 if abs(heading_rad) > config.window_rad else 1.0)
        pull = 0.5 * strength * heading_rad
        return float(config.mean_m_s + left + pull), float(config.mean_m_s + right - pull)
