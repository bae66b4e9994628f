"""What the belts of a tracked vehicle do alike turns nothing: left out of the data, put back into the model.

Seen in a mirror, left and right change places and a turn changes its sign. A vehicle that is its own mirror image is turned by the
difference of its belts alone. That is asked of the data and not taken for granted: with a load on one side, on a slope across, with
one belt worn both belts count. Where it holds, half of the inputs' coefficients need not be told by the data, and the
others no longer by what the belts have in common, which is most of how a vehicle is driven.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.identification.gram import Gram, Units, gram_of, units_of
from treadline.identification.intervals import Intervals
from treadline.identification.structure import least_schwarz
from treadline.models import InputOutputRecord, LinearModel

LEFT, RIGHT = "left", "right"
TURNS = ("yaw", "heading")
"""How the names of outputs begin that change their sign in a mirror."""
TURNS_IN_BAGS = ("angular_velocity.z", "angular.z")
"""How they end in messages of ROS."""
STILL = 1e-6
"""Deviation of the difference over that of the belts, below which it is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mirror:
    """Two belts whose difference is the input."""

    names: tuple[str, str]
    """Of the belts."""
    signs: Float[np.ndarray, "1 2"]
    """Theirs in the difference, right less left."""

    def difference(self, records: Sequence[InputOutputRecord]) -> list[InputOutputRecord]:
        """Return the records with the difference for their input."""
        left = self.names[int(np.argmin(self.signs))]
        return [replace(record, u=record.u @ self.signs.T, input_names=(f"{RIGHT}_less_{left}",)) for record in records]

    def units(self, difference: Sequence[InputOutputRecord], units: Units) -> Units:
        """Return the difference's units, the outputs' being those of the belts: what is judged must not change with its units.

        Args:
            units: Of the belts.
        """
        of_input = units_of(difference).scale[:1]
        return Units(
            shift=np.concatenate([self.signs @ units.shift[:2], units.shift[2:]]),
            scale=np.concatenate([of_input, units.output_scale]),
            input_count=1,
        )

    def model(self, model: LinearModel, about: Float[np.ndarray, " 2"]) -> LinearModel:
        """Return the model of both belts.

        Args:
            model: Of their difference.
            about: Speeds that the operating point is to be near.
        """
        apart = model.input_offset - self.signs @ about
        return replace(
            model,
            B=model.B @ self.signs,
            D=model.D @ self.signs,
            input_offset=about + 0.5 * self.signs.T @ apart,
            input_names=self.names,
            provenance={**model.provenance, "inputs": "difference"},
        )

    def intervals(self, intervals: Intervals, units: Units) -> Intervals:
        """Return the intervals of the model of both belts.

        Args:
            units: Of the belts.
        """
        return intervals.through(self.signs * units.input_scale / intervals.units.input_scale[:, None], units)


def mirror_of(records: Sequence[InputOutputRecord], data: Gram, lags: int | None, feedthrough: bool | None) -> Mirror | None:
    """Return the mirror in which a vehicle is its own image, or None where nobody says so or the data speak against it.

    Names say which inputs are the belts and that all outputs are turns; of the belts and of their difference Schwarz's criterion
    then takes what is worth its coefficients.

    Args:
        data: Sums of the records.
        lags: Lags that are asked for.
        feedthrough: Whether an input may act within its own sample; open where it is None.
    """
    mirror = _named(records[0])
    if mirror is None:
        return None
    alone = mirror.difference(records)
    units = mirror.units(alone, data.units)
    if not units.input_scale[0] > STILL * float(data.units.input_scale.min()):
        return None
    by_difference = least_schwarz(gram_of(alone, data.lags, units), lags, feedthrough)
    return mirror if by_difference < least_schwarz(data, lags, feedthrough) else None


def _named(record: InputOutputRecord) -> Mirror | None:
    """Return what the names say: a left and a right input that are called alike, and outputs that are turns."""
    inputs, outputs = record.input_names, [name.lower().rsplit("/", 1)[-1] for name in record.output_names]
    if len(inputs) != 2 or not outputs:
        return None
    one, other = (name.lower() for name in inputs)
    is_left = [LEFT in one and one.replace(LEFT, RIGHT) == other, LEFT in other and other.replace(LEFT, RIGHT) == one]
    if sum(is_left) != 1 or not all(name.startswith(TURNS) or name.endswith(TURNS_IN_BAGS) for name in outputs):
        return None
    return Mirror(names=(inputs[0], inputs[1]), signs=np.where(is_left, -1.0, 1.0)[None])
