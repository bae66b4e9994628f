"""What one frame says: a heading with its uncertainty, or a reason why not."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from treadline.angles import DEG
from treadline.perception.nosings import Direction, Nosing
from treadline.perception.planes import Blocks, Surface
from treadline.printing import Printable
from treadline.signals import StairAxes, StairMap

SWEPT_HALF_M = 0.40
"""Half the width that the shipped wheelchair sweeps: where no chair is told, as of a folder of frames."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StairShape:
    """The stair's measures as far as one frame shows them."""

    rise_m: float
    run_m: float
    slope_rad: float
    distance_m: float
    """From the camera to the nearest nosing in view, level and square to it."""
    direction: Direction
    """Whether the flight that the camera looks at rises or falls."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stages:
    """The six stages of Fig. 5, each as a picture, and the line segments kept."""

    pictures: tuple[UInt8[np.ndarray, "h w 3"], ...]
    nosings_px: Float[np.ndarray, "n 4"]
    """u1, v1, u2, v2 of each merged edge, left end first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parts:
    """What the robust estimator found in a frame: for pictures, and for whoever asks why."""

    blocks: Blocks
    risers: tuple[Surface, ...]
    treads: tuple[Surface, ...]
    flight: tuple[Nosing, ...]
    aside: Float[np.ndarray, " 3"]
    """Unit vector in C along which the nosings' ``sides_m`` count: the edges' direction as first guessed, not as it was found."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Sight(Printable):
    """The answer to one frame."""

    accepted: bool
    reason: str | None
    """Why there is no heading; None when accepted."""
    heading_rad: float | None
    sigma_rad: float | None
    edge_direction_C: Float[np.ndarray, " 3"] | None
    """Unit vector along the stair's edges in C, pointing to the chair's right."""
    edge_count: int
    box_px: tuple[int, int, int, int] | None
    """Smallest and largest column and row of the stair: u0, v0, u1, v1."""
    shape: StairShape | None
    stages: Stages | None
    planes_against_lines_rad: float | None = None
    """The edges' angle about the vertical by risers less that by lines; None unless both are seen."""
    axes: StairAxes | None = None
    parts: Parts | None = None
    draw_map: Callable[[float], StairMap] | None = None
    """Makes the map at its first call, for a chair that sweeps so much to either side."""
    swept_half_m: float = SWEPT_HALF_M

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the heading with its uncertainty and the geometry of the stair, or why there is no heading."""
        if self.heading_rad is None or self.sigma_rad is None:
            return f"no heading: {self.reason}", []
        rows = [("edges", str(self.edge_count))]
        if self.shape is not None:
            shape = self.shape
            rows += [
                ("flight", f"{shape.direction}, slope {shape.slope_rad / DEG:.1f}°"),
                ("rise, run", f"{shape.rise_m:.3f} m, {shape.run_m:.3f} m"),
                ("distance", f"{shape.distance_m:.2f} m to the nearest nosing"),
            ]
        return f"heading {self.heading_rad / DEG:+.2f}° ± {1.96 * self.sigma_rad / DEG:.2f}° (95 %)", rows

    @property
    def stair_map(self) -> StairMap | None:
        """What lies ahead, made when it is first asked for: who wants the heading alone need not wait for it."""
        return None if self.draw_map is None else self.draw_map(self.swept_half_m)


def refused(reason: str, *, edge_count: int = 0, stages: Stages | None = None) -> Sight:
    """Return a sight without a heading."""
    return Sight(
        accepted=False,
        reason=reason,
        heading_rad=None,
        sigma_rad=None,
        edge_direction_C=None,
        edge_count=edge_count,
        box_px=None,
        shape=None,
        stages=stages,
    )
