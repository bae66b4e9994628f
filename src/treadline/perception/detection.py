"""Detection result of one frame: a heading with its uncertainty, or the reason of a rejection."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import UInt8

from treadline.core.angles import DEG
from treadline.core.camera_images import StairAxes
from treadline.core.printing import Plottable, Printable
from treadline.core.rotations import Vector3
from treadline.core.signals import StairMap
from treadline.perception._plane_segmentation import PlanarBlocks, Surface
from treadline.perception._stair_shape import StairShape
from treadline.perception.steps import SeenStep, SeenTurn, turn_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ThresholdRule = Literal["median", "otsu", "rosin", "mad"]
"""Rule for Canny's thresholds in Algorithm 1, which the paper does not print."""
Picture = UInt8[np.ndarray, "h w 3"]
Stages = tuple[Picture, ...]
"""Six stages of Fig. 5 as images."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class StairDetection(Printable, Plottable):
    """Detection result of one frame."""

    accepted: bool
    """Whether the frame alone shows a stair. An unconfirmed detection has a heading as well."""
    reason: str | None
    """Reason of the rejection, or why the detection is unconfirmed; None if accepted."""
    heading_rad: float | None = None
    sigma_rad: float | None = None
    edge_direction_C: Vector3 | None = None
    """Unit vector along the stair's edges in C, pointing to the chair's right."""
    edge_count: int
    box_px: tuple[int, int, int, int] | None = None
    """Smallest and largest column and row of the stair: u0, v0, u1, v1 [px]."""
    shape: StairShape | None = None
    stages: Stages | None = None
    evidence: float | None = None
    """Log-evidence of a stair against a scene without one [nats]; None for a frame without even a candidate."""
    unconfirmed: bool = False
    """Whether the evidence is that of two levels and two fronts, or of a third that fits badly. Furniture before a wall can show
    it as well: the heading is that of a stair if this is one, and rise and run are hardly known."""
    axes: StairAxes | None = None
    risers: tuple[Surface, ...] = ()
    treads: tuple[Surface, ...] = ()
    blocks: PlanarBlocks | None = None
    """Planar blocks of a frame, accepted or not; None with too few of them."""
    draw_map: Callable[[], StairMap] | None = None
    """Function that returns the map, computed once."""
    find_steps: Callable[[], tuple[SeenStep, ...]] | None = None
    """Function that returns the steps, computed once."""
    draw: Callable[[], Picture] | None = None
    """Function that returns the frame with all detected objects, for ``plot``; None in a loop."""

    def __bool__(self) -> bool:
        """Return whether the frame alone shows a stair."""
        return self.accepted

    def printed(self) -> tuple[str, list[tuple[str, str]]]:
        """Return the heading with its uncertainty and the geometry of the stair, or why there is no heading."""
        if self.heading_rad is None or self.sigma_rad is None:
            return f"no heading: {self.reason}", [("step", str(step)) for step in self.steps]
        heading = f"heading {self.heading_rad / DEG:+.2f}° ± {1.96 * self.sigma_rad / DEG:.2f}° (95 %)"
        rows = [("edges", str(self.edge_count))]
        if self.unconfirmed:
            return f"{heading}, unconfirmed", [*rows, ("reason", str(self.reason))]
        if self.shape is not None:
            shape = self.shape
            rows += [
                ("flight", f"{shape.direction}, slope {shape.slope_rad / DEG:.1f}°"),
                ("rise, run", f"{shape.rise_m:.3f} m, {shape.run_m:.3f} m"),
                (
                    "nearest nosing seen",
                    f"{shape.distance_m:.2f} m; nosings nearer than {shape.blind_m:.2f} m would be out of view",
                ),
            ]
        rows += [("turn", str(self.turn))] if self.turn is not None else []
        return heading, rows

    def plot(self) -> "Figure":
        """Return the frame with treads, risers, nosings and heading, or the reason of the rejection, as a matplotlib figure."""
        return Plottable.drawer(self if self.draw is None else self.draw())

    @property
    def steps(self) -> tuple[SeenStep, ...]:
        """Steps in view, the lowest of a rising flight first, computed on first access."""
        return () if self.find_steps is None else self.find_steps()

    @property
    def turn(self) -> SeenTurn | None:
        """Where the steps in view go on in another direction; None if they do not."""
        return turn_of(self.steps)

    @property
    def stair_map(self) -> StairMap | None:
        """Map of the stair, computed on first access."""
        return None if self.draw_map is None else self.draw_map()


def refused(reason: str, *, edge_count: int = 0, stages: Stages | None = None, evidence: float | None = None) -> StairDetection:
    """Return a result without a heading."""
    return StairDetection(accepted=False, reason=reason, edge_count=edge_count, stages=stages, evidence=evidence)
