"""Places that frames show, counted by share: a detector that flickers does not hide what it shows now and then.

``place seen in a frame, strip in view -> nearest place that is there``. Places are distances along the way of the belts, so that
they stay where they are while the chair drives and nothing is in view.
"""

from dataclasses import dataclass

from treadline.guard._guard_config import SAME_M


@dataclass(slots=True)
class _Sighting:
    """One place, with its count."""

    place_m: float
    count: int


class Sightings:
    """Places, each of which gains with a frame that shows it and loses one with a frame that should show it and does not.

    A place that a share p of the frames show is found for good once p > 1 / (1 + gain); what a single frame shows is not.

    Args:
        gain: Gain of a frame that shows the place.
        least: Count from which a place is there: more than the gain.
        most: Largest count; with the loss of one a frame, the number of frames for which a place is remembered at most.
    """

    def __init__(self, gain: int, least: int, most: int) -> None:
        self._gain, self._least, self._most = gain, least, most
        self._places: list[_Sighting] = []

    def look(self, seen_m: float | None, from_m: float, to_m: float) -> None:
        """Update with the place that one frame shows, if any, and the strip in which it would show others."""
        same = next((known for known in self._places if seen_m is not None and abs(seen_m - known.place_m) < SAME_M), None)
        for sighting in self._places:
            if seen_m is not None and sighting is same:
                sighting.place_m, sighting.count = seen_m, min(sighting.count + self._gain, self._most)
            elif from_m < sighting.place_m < to_m:
                sighting.count -= 1
        self._places = [sighting for sighting in self._places if sighting.count > 0]
        if seen_m is not None and same is None:
            self._places.append(_Sighting(seen_m, self._gain))

    def forget(self, before_m: float) -> None:
        """Forget places that the chair has passed."""
        self._places = [sighting for sighting in self._places if sighting.place_m >= before_m]

    @property
    def is_empty(self) -> bool:
        """Whether no place has a count."""
        return not self._places

    def nearest_m(self) -> float | None:
        """Return the nearest place that is there [m], or None."""
        return min((sighting.place_m for sighting in self._places if sighting.count >= self._least), default=None)
