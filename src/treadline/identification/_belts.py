"""The difference of a skid-steer vehicle's belt speeds as only input, identified by names.

A vehicle with left-right symmetry turns only with the difference of its belt speeds: mirrored, left and right swap and a
turn changes sign. A one-sided load, a cross slope or a worn belt breaks the symmetry, so the data decide. With the symmetry
half of the input coefficients need no estimation, and the other half is not disturbed by the common speed, which
dominates normal driving.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.turning import belt_signs, radians, turn_channels
from treadline.identification._gram import Gram, Units, gram_of, units_of
from treadline.identification._intervals import ConfidenceIntervals
from treadline.identification._limits import ROUNDING
from treadline.identification._model_order import min_bic

DIFFERENCE = "right_less_left"
"""Name of the difference of two belt speeds."""


def turn_rate(y: Float[np.ndarray, "T p"], output_names: Sequence[str], dt_s: float) -> Float[np.ndarray, " T1"]:
    """Return the yaw rate [rad/s]; without one the heading's difference to the next row takes its place, a row less."""
    turn = turn_channels(output_names)
    if turn.yaw_rate is not None:
        return np.asarray(y[:, turn.yaw_rate] * radians(output_names[turn.yaw_rate]))
    heading = turn.heading or 0
    return np.asarray(np.diff(y[:, heading]) * radians(output_names[heading]) / dt_s)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DifferentialInput:
    """Two belt speeds replaced by their difference."""

    names: tuple[str, str]
    """Names of the belts."""
    signs: Float[np.ndarray, "1 2"]
    """Signs of the belts in the difference, right minus left."""

    def difference(self, records: Sequence[InputOutputRecord]) -> list[InputOutputRecord]:
        """Return the records with the difference as input."""
        return [replace(record, u=record.u @ self.signs.T, input_names=(DIFFERENCE,)) for record in records]

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

    def intervals(self, intervals: ConfidenceIntervals) -> ConfidenceIntervals:
        """Return the intervals of the model with both belts as inputs, in the unit of the difference."""
        units = intervals.units
        both = Units(shift=np.append(0.0, units.shift), scale=np.append(units.input_scale, units.scale), input_count=2)
        return intervals.through(self.signs, both)


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
    differential = named_differential(records[0])
    if differential is None:
        return None
    alone = differential.difference(records)
    units = differential.units(alone, data.units)
    if not units.input_scale[0] > ROUNDING**0.5 * float(data.units.input_scale.min()):
        return None
    by_difference = min_bic(gram_of(alone, data.lags, units), lags, feedthrough)
    return differential if by_difference < min_bic(data, lags, feedthrough) else None


def named_differential(record: InputOutputRecord) -> DifferentialInput | None:
    """Return the difference identified by names: a left and a right belt, and only turn outputs."""
    if not record.output_names or turn_channels(record.output_names).count < len(record.output_names):
        return None
    return named_belts(record.input_names)


def named_belts(inputs: Sequence[str]) -> DifferentialInput | None:
    """Return the belts of a skid-steer vehicle: the only inputs, a left and a right one with otherwise the same name."""
    signs = belt_signs(inputs)
    return None if signs is None else DifferentialInput(names=(inputs[0], inputs[1]), signs=signs[None])
