"""Seat linkage (slider-bar mechanism): actuator stroke against seat angle, in closed form.

Paper: Section II.B, Fig. 4. The seat rotates about a hinge; a bar joins a pin on the seat, ``lever_arm_m`` in front of the hinge,
to a slider on a rail below. The linear actuator pushes the slider rearward (stroke increases), the bar pulls the pin down and the
seat leans forward against the slope: at a chassis pitch β, an angle of β levels the seat.

``stroke [m] <-> angle [rad]``; seat pitch = chassis pitch - angle.
"""

import math

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError
from treadline.scenario.chair import Seat


class SeatLinkage:
    """Planar four-bar linkage (hinge, pin, bar, slider) of a chair's seat.

    Raises:
        MechanicsError: If the actuator's stroke passes through a dead point, or exceeds the reach of the bar.
    """

    def __init__(self, seat: Seat) -> None:
        self._lever_arm, self._bar, self._drop = seat.lever_arm_m, seat.bar_m, seat.slider_drop_m
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
        """Return the forward lean of the seat relative to the chassis [rad] at a stroke.

        Raises:
            MechanicsError: If the bar is too short or too long for the stroke.
        """
        to_slider = math.hypot(stroke_m, self._drop)
        # Triangle hinge - pin - slider: the angle at the hinge by the law of cosines.
        cosine = (self._lever_arm**2 + to_slider**2 - self._bar**2) / (2.0 * self._lever_arm * to_slider)
        if not abs(cosine) <= 1.0:  # not ">": NaN must fail too
            raise MechanicsError(
                f"a bar of {self._bar} m does not join a slider at {stroke_m:.3f} m to a pin {self._lever_arm} m from the hinge"
            )
        slider_direction = math.atan2(-self._drop, -stroke_m)
        return -(slider_direction + math.acos(cosine))

    def nearest_angle(self, stroke_m: float) -> float:
        """Return the angle [rad] at a stroke, or at the nearest end of the actuator: a measured stroke may exceed the range."""
        low, high = self.stroke_range
        return self.angle(min(max(stroke_m, low), high))

    def stroke(self, angle_rad: float) -> float:
        """Return the stroke [m] for an angle.

        Raises:
            MechanicsError: If the angle is outside the range of the linkage.
        """
        low, high = self.angle_range
        if not low - 1e-9 <= angle_rad <= high + 1e-9:
            raise MechanicsError(
                f"a seat angle of {angle_rad / DEG:.1f}° is outside the linkage's {low / DEG:.1f}…{high / DEG:.1f}°"
            )
        below = self._drop - self._lever_arm * math.sin(angle_rad)
        return math.sqrt(self._bar**2 - below**2) - self._lever_arm * math.cos(angle_rad)

    def rate_ratio(self, stroke_m: float) -> float:
        """Return d(angle)/d(stroke) [rad/m] at a stroke."""
        along, lever = self._along_and_lever(stroke_m)
        return along / lever

    def _along_and_lever(self, stroke_m: float) -> tuple[float, float]:
        """Return the bar's component along the rail [m], and the lever arm times the bar's component across the lever arm [m²].

        The bar length is constant: differentiating along² + below² = bar² gives along d(stroke) = lever d(angle). A zero of either
        factor is a dead point, at which slider or seat reverses.
        """
        angle = self.angle(stroke_m)
        along = stroke_m + self._lever_arm * math.cos(angle)
        below = self._drop - self._lever_arm * math.sin(angle)
        return along, self._lever_arm * (along * math.sin(angle) + below * math.cos(angle))
