"""Structure of the inputs, tested on the data, removed before the fit and restored in the model: dead times, and mirrored belts.

A vehicle with left-right symmetry turns only with the difference of its belt speeds: mirrored, left and right swap and a
turn changes sign. A one-sided load, a cross slope or a worn belt breaks the symmetry, so the data decide. With the symmetry
half of the input coefficients need no estimation, and the other half is not disturbed by the common speed, which
dominates normal driving.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.core.errors import SettingsError
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._gram import Gram, Units, gram_of, units_of
from treadline.identification._model_order import min_bic
from treadline.identification._pole_intervals import ConfidenceIntervals


def without_delays(records: Sequence[InputOutputRecord], shifts: Sequence[int]) -> list[InputOutputRecord]:
    """Return the records with each input delayed by its dead time.

    Raises:
        SettingsError: If there is not one shift per input, or a shift is negative or as long as a record.
    """
    m, most = records[0].u.shape[1], max(shifts, default=0)
    whole = all(isinstance(shift, int | np.integer) for shift in shifts)
    if not whole or len(shifts) != m or min(shifts) < 0 or most >= min(len(record) for record in records):
        raise SettingsError(f"delays are {list(shifts)}; give one integer per input ({m}), from 0 to less than a record's length")
    made = []
    for record in records:
        u = np.column_stack([record.u[most - d : len(record) - d, j] for j, d in enumerate(shifts)])
        made.append(replace(record, u=u, y=record.y[most:]))
    return made


LEFT, RIGHT = "left", "right"
TURN_PREFIXES = ("yaw", "heading")
"""Prefixes of output names that change sign under reflection."""
TURN_SUFFIXES_ROS = ("angular_velocity.z", "angular.z")
"""Suffixes of such names in ROS messages."""
DIFFERENCE_MIN = 1e-6
"""Standard deviation of the difference relative to the belts' below which only rounding remains."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DifferentialInput:
    """Two belt speeds replaced by their difference."""

    names: tuple[str, str]
    """Names of the belts."""
    signs: Float[np.ndarray, "1 2"]
    """Signs of the belts in the difference, right minus left."""

    def difference(self, records: Sequence[InputOutputRecord]) -> list[InputOutputRecord]:
        """Return the records with the difference as input."""
        left = self.names[int(np.argmin(self.signs))]
        return [replace(record, u=record.u @ self.signs.T, input_names=(f"{RIGHT}_less_{left}",)) for record in records]

    def units(self, difference: Sequence[InputOutputRecord], units: Units) -> Units:
        """Return units for the difference with unchanged output units, so that model selection is not affected.

        Args:
            difference: Records with the difference as input.
            units: Units of the belts.
        """
        of_input = units_of(difference).scale[:1]
        return Units(
            shift=np.concatenate([self.signs @ units.shift[:2], units.shift[2:]]),
            scale=np.concatenate([of_input, units.output_scale]),
            input_count=1,
        )

    def model(self, model: LinearModel, about: Float[np.ndarray, " 2"]) -> LinearModel:
        """Return the model with both belts as inputs.

        Args:
            model: Model of the difference.
            about: Belt speeds near the operating point.
        """
        offset = model.input_offset - self.signs @ about
        return replace(
            model,
            B=model.B @ self.signs,
            D=model.D @ self.signs,
            input_offset=about + 0.5 * self.signs.T @ offset,
            input_delay=2 * model.input_delay,
            input_names=self.names,
            provenance={**model.provenance, "inputs": "difference"},
        )

    def intervals(self, intervals: ConfidenceIntervals, units: Units) -> ConfidenceIntervals:
        """Return the intervals of the model with both belts as inputs.

        Args:
            intervals: Intervals of the model of the difference.
            units: Units of the belts.
        """
        return intervals.through(self.signs * units.input_scale / intervals.units.input_scale[:, None], units)


def find_differential_input(
    records: Sequence[InputOutputRecord], data: Gram, lags: int | None, feedthrough: bool | None
) -> DifferentialInput | None:
    """Return the input difference of a symmetric vehicle, or None for other channels or if the data contradict symmetry.

    The channel names identify the belts and the turn outputs; the BIC then compares models with both belts and with their
    difference.

    Args:
        records: Experiments.
        data: Gram matrix of the records.
        lags: Requested lags; chosen when None.
        feedthrough: Whether an input acts within the same sample; chosen when None.
    """
    differential = _named_differential(records[0])
    if differential is None:
        return None
    alone = differential.difference(records)
    units = differential.units(alone, data.units)
    if not units.input_scale[0] > DIFFERENCE_MIN * float(data.units.input_scale.min()):
        return None
    by_difference = min_bic(gram_of(alone, data.lags, units), lags, feedthrough)
    return differential if by_difference < min_bic(data, lags, feedthrough) else None


def _named_differential(record: InputOutputRecord) -> DifferentialInput | None:
    """Return the difference identified by names: a left and a right input with matching names, and only turn outputs."""
    inputs, outputs = record.input_names, [name.lower().rsplit("/", 1)[-1] for name in record.output_names]
    if len(inputs) != 2 or not outputs:
        return None
    one, other = (name.lower() for name in inputs)
    is_left = [LEFT in one and one.replace(LEFT, RIGHT) == other, LEFT in other and other.replace(LEFT, RIGHT) == one]
    if sum(is_left) != 1 or not all(name.startswith(TURN_PREFIXES) or name.endswith(TURN_SUFFIXES_ROS) for name in outputs):
        return None
    return DifferentialInput(names=(inputs[0], inputs[1]), signs=np.where(is_left, -1.0, 1.0)[None])
