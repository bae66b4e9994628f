"""The stair detector: one frame in, one heading or a reason out.

Paper: Algorithm 1 and Section III-A (mode ``paper``); mode ``robust`` is what the chair drives with.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from treadline.perception.algorithm import look_paper
from treadline.perception.edges import Rule
from treadline.perception.robust import look_robust
from treadline.perception.sight import Sight
from treadline.signals import HeadingMeasurement, RgbdFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorConfig:
    """How a detector looks at a frame."""

    method: Literal["paper", "robust"] = "robust"
    thresholds: Rule = "median"
    """Rule for Canny's thresholds in mode ``paper``."""


class StairDetector:
    """Finds the stair in an RGB-D frame and the chair's heading on it."""

    def __init__(self, config: DetectorConfig) -> None:
        self._config = config

    def look(
        self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None, *, stages: bool = False
    ) -> Sight:
        """Return the whole answer.

        Args:
            frame: Colour and depth, registered.
            gravity_C: Vector that points down, in C; mode ``robust`` refuses without it.
            stages: Keep the six pictures of Fig. 5 (mode ``paper``).
        """
        if self._config.method == "paper":
            return look_paper(frame, rule=self._config.thresholds, stages=stages)
        return look_robust(frame, gravity_C)

    def step(self, frame: RgbdFrame, gravity_C: Float[np.ndarray, " 3"] | None = None) -> HeadingMeasurement | None:
        """Return the heading, or None when the frame is refused."""
        sight = self.look(frame, gravity_C)
        if sight.heading_rad is None or sight.sigma_rad is None:
            return None
        return HeadingMeasurement(
            t_s=frame.t_s, heading_rad=sight.heading_rad, sigma_rad=sight.sigma_rad, edge_count=sight.edge_count
        )
