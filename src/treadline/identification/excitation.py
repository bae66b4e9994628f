"""Random track speeds that excite the chair and keep it on the stair.

Paper: Section VI.B, "a set of random velocities". Speeds are drawn anew each period around the climb speed; a weak
pull towards zero heading keeps an integrator from walking off (the fit then sees inputs that depend on the past
output, which OKID's observer takes in its stride as long as the random part is much larger).
"""

from dataclasses import dataclass

import numpy as np

from treadline.angles import DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcitationConfig:
    """Size of the random speeds."""

    mean_m_s: float = 0.2
    amplitude_m_s: float = 0.1
    """Half width of each belt's uniform distribution."""
    pull_m_s_per_rad: float = 0.3
    """Belt difference against the heading: about a tenth of the random part at 5°."""
    window_rad: float = 5.0 * DEG
    """Beyond this heading the pull is doubled."""


class Excitation:
    """Draws one pair of belt speeds per call."""

    def __init__(self, config: ExcitationConfig, rng: np.random.Generator) -> None:
        self._config = config
        self._rng = rng

    def step(self, heading_rad: float) -> tuple[float, float]:
        """Return belt speeds (left, right) [m/s]."""
        config = self._config
        left, right = self._rng.uniform(-config.amplitude_m_s, config.amplitude_m_s, 2)
        strength = config.pull_m_s_per_rad * (2.0 if abs(heading_rad) > config.window_rad else 1.0)
        pull = 0.5 * strength * heading_rad
        return float(config.mean_m_s + left + pull), float(config.mean_m_s + right - pull)
