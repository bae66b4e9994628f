"""Closed path of a belt's outline around its pulleys: ``chair, flipper angle -> points and directions by arc length``.

The arc length σ and the lug positions follow the plant's lug model: σ = 0 is mid-track on the flat run, and σ grows in the
direction in which the belt moves while the chair drives forward, rearward on the flat run. The outline runs through the lugs' tips.
On a chair with a flipper the belt runs along the flipper and back: it wraps the front pulley on the convex side, and bends around a
small idler on the concave side, drawn as a corner.
"""

import math

import numpy as np
from jaxtyping import Float

from treadline.scenario.chair import ChairDescription


class BeltPath:
    """Straight lines and arcs of a belt's outline in the plane (x, z) of B.

    Args:
        chair: Chair with its pulleys.
        flipper_rad: Angle of the flipper; None, or a chair without flipper: the approach angle.
    """

    def __init__(self, chair: ChairDescription, flipper_rad: float | None = None) -> None:
        tracks = chair.tracks
        rest = math.radians(tracks.approach_angle_deg)
        angle = rest if flipper_rad is None or chair.flipper is None else flipper_rad
        run, out, r = tracks.flat_run_m, tracks.approach_m, tracks.pulley_radius_m
        # Each piece: length, curvature (negative to the right), and turn in place before the piece.
        pieces = (_around_three if chair.flipper is None else _along_flipper)(run, out, r, angle)
        starts: list[tuple[float, float, float, float, float]] = []
        sigma, x, z, heading = 0.0, 0.0, 0.0, math.pi
        for length, curvature, corner in pieces:
            heading += corner
            starts.append((sigma, x, z, heading, curvature))
            x, z, heading = _advanced(x, z, heading, curvature, length)
            sigma += length
        self._starts = np.array(starts)
        self.length_m = sigma
        """Length of the outline [m]."""

    def at(self, sigma_m: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Return points (x, z) and directions of motion at arc lengths.

        Returns:
            Points in B [m], and the angle of the belt's direction of motion from x towards z [rad].
        """
        wrapped = np.mod(sigma_m, self.length_m)
        s0, x0, z0, heading, curvature = self._starts[np.searchsorted(self._starts[:, 0], wrapped, side="right") - 1].T
        along = wrapped - s0
        turned = heading + curvature * along
        # The chord of an arc has the mean direction, and its length by sin(x)/x.
        chord = along * np.sinc(0.5 * curvature * along / math.pi)
        middle = 0.5 * (heading + turned)
        return np.column_stack([x0 + chord * np.cos(middle), z0 + chord * np.sin(middle)]), turned


def _around_three(run: float, out: float, r: float, angle: float) -> list[tuple[float, float, float]]:
    """Return the pieces of a belt over rear, front and nose pulley."""
    across, up = run + out * math.cos(angle), out * math.sin(angle)
    upper = math.atan2(up, across)
    return [
        (0.5 * run, 0.0, 0.0),
        (r * (math.pi - upper), -1.0 / r, 0.0),
        (math.hypot(across, up), 0.0, 0.0),
        (r * (math.pi + upper - angle), -1.0 / r, 0.0),
        (out, 0.0, 0.0),
        (r * angle, -1.0 / r, 0.0),
        (0.5 * run, 0.0, 0.0),
    ]


def _along_flipper(run: float, out: float, r: float, angle: float) -> list[tuple[float, float, float]]:
    """Return the pieces of a belt over rear and front pulley and along a flipper."""
    cut = r * math.tan(0.5 * abs(angle))
    half, half_turn, wrap = (0.5 * run, 0.0, 0.0), (math.pi * r, -1.0 / r, 0.0), (r * abs(angle), -1.0 / r, 0.0)
    if angle >= 0.0:
        return [half, half_turn, (run - cut, 0.0, 0.0), (out - cut, 0.0, angle), half_turn, (out, 0.0, 0.0), wrap, half]
    beneath = [(out - cut, 0.0, 0.0), (0.5 * run - cut, 0.0, -angle)]
    return [half, half_turn, (run, 0.0, 0.0), wrap, (out, 0.0, 0.0), half_turn, *beneath]


def _advanced(x: float, z: float, heading: float, curvature: float, length: float) -> tuple[float, float, float]:
    turned = heading + curvature * length
    chord = length * float(np.sinc(0.5 * curvature * length / math.pi))
    middle = 0.5 * (heading + turned)
    return x + chord * math.cos(middle), z + chord * math.sin(middle), turned
