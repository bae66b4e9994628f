"""The seat's slider-bar linkage: actuator stroke against seat angle, in closed form.

Paper: Section II.B, Fig. 4. The seat turns about a hinge; a bar joins a pin on the seat, ``arm`` in front of the hinge,
to a slider on a rail below it. The linear actuator pushes the slider rearward (stroke grows), the bar pulls the pin
down and the seat leans forward against the slope: at a chassis pitch β, an angle of β makes the seat level.

``stroke [m] <-> angle [rad]``; seat pitch = chassis pitch - angle.
"""

import math

from treadline.angles import DEG
from treadline.errors import MechanicsError
from treadline.mechanics.chair import Seat


class SeatLinkage:
    """The plane four-link (hinge, pin, bar, slider) of one chair's seat.

    Raises:
        MechanicsError: If the actuator's stroke passes through a dead point, or leaves what the bar can reach.
    """

    def __init__(self, seat: Seat) -> None:
        self._arm, self._bar, self._drop = seat.arm_m, seat.bar_m, seat.slider_drop_m
        self.stroke_range = seat.stroke_m
        low, high = seat.stroke_m
        if not low < high:
            raise MechanicsError(f"the seat's stroke runs from {low} to {high} m; the first must be the smaller")
        self.angle_range = (self.angle(low), self.angle(high))
        for step in range(201):
            stroke = low + (high - low) * step / 200
            if min(self._along_and_lever(stroke)) <= 0.0:
                raise MechanicsError(f"the seat's linkage passes a dead point at a stroke of {stroke:.3f} m; shorten the stroke")

    def angle(self, stroke_m: float) -> float:
        """Return how far the seat leans forward against the chassis [rad] at a stroke.

        Raises:
            MechanicsError: If the bar does not reach.
        """
        to_slider = math.hypot(stroke_m, self._drop)
        # Triangle hinge - pin - slider: the angle at the hinge by the law of cosines.
        cosine = (self._arm**2 + to_slider**2 - self._bar**2) / (2.0 * self._arm * to_slider)
        if not abs(cosine) <= 1.0:  # not ">": NaN must fail too
            raise MechanicsError(
                f"a bar of {self._bar} m does not join a slider at {stroke_m:.3f} m to a pin {self._arm} m from the hinge"
            )
        slider_direction = math.atan2(-self._drop, -stroke_m)
        return -(slider_direction + math.acos(cosine))

    def stroke(self, angle_rad: float) -> float:
        """Return the stroke [m] that gives an angle.

        Raises:
            MechanicsError: If the angle is outside the linkage's range.
        """
        low, high = self.angle_range
        if not low - 1e-9 <= angle_rad <= high + 1e-9:
            raise MechanicsError(
                f"a seat angle of {angle_rad / DEG:.1f}° is outside the linkage's {low / DEG:.1f}…{high / DEG:.1f}°"
            )
        below = self._drop - self._arm * math.sin(angle_rad)
        return math.sqrt(self._bar**2 - below**2) - self._arm * math.cos(angle_rad)

    def rate_ratio(self, stroke_m: float) -> float:
        """Return d(angle)/d(stroke) [rad/m] at a stroke."""
        along, lever = self._along_and_lever(stroke_m)
        return along / lever

    def _along_and_lever(self, stroke_m: float) -> tuple[float, float]:
        """Return the bar's part along the rail [m], and the arm times the bar's part across the arm [m²].

        The bar's length is constant: along² + below² = bar², differentiated, gives along d(stroke) = lever d(angle).
        Either is zero at a dead point: there the slider, or the seat, turns back.
        """
        angle = self.angle(stroke_m)
        along = stroke_m + self._arm * math.cos(angle)
        below = self._drop - self._arm * math.sin(angle)
        return along, self._arm * (along * math.sin(angle) + below * math.cos(angle))
