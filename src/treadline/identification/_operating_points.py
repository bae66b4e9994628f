"""Second operating point: inputs about another mean, where gain and offset of a linear model no longer hold.

A plant whose static gain depends on the operating point (a motor with dead zone and saturation) has one linear model for each; a
model of both has the gain of the chord between them. What shows it: in two parts of the data the means of an input are apart, and
in one of them another gain and offset remove most of the model's error.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.core.linear_systems import fair_run, part
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.core.state_space import channel_names
from treadline.identification._limits import HALF

APART = 3.0
"""Distance of two means, in standard deviations within the parts, from which on hardly a sample of one part lies in the other. Half
of it and twice as much give the same warnings on generated and recorded sets (docs/evidence/identification.md)."""
REMOVED_LEAST = 0.1
"""Error that another gain and offset remove, as a share of an output's variance, from which on it matters: a fit below 68 %. With
0.2 half of the plants with a square root stay unnamed, with 0.05 nothing changes (docs/evidence/identification.md)."""


def second_operating_point(
    model: LinearModel, fitted: Sequence[InputOutputRecord], judged: Sequence[InputOutputRecord]
) -> list[str]:
    """Return a warning if an input moves about two means, and the model's gain and offset do not hold about one of them.

    Args:
        model: Stable model.
        fitted: Data of the fit.
        judged: Data of the validation; if they are the same, the halves of the longest record are compared.
    """
    parts, where, holds = (fitted, judged), ("in the fitted data", "in the validation data"), "the first alone"
    if judged is fitted:
        longest = max(fitted, key=len)
        half = len(longest) // 2
        parts = ([part(longest, 0, half)], [part(longest, half, len(longest))])
        where, holds = ("in the first half", "in the second half"), "neither"
    inputs, outputs = channel_names(model)
    u = [np.vstack([record.u for record in records]) for records in parts]
    means = np.stack([np.nanmean(values, axis=0) for values in u])
    gap, variance = np.abs(means[1] - means[0]), np.mean([np.nanvar(values, axis=0) for values in u], axis=0)
    apart = gap**2 > np.maximum(APART**2 * variance, 1e-18 * np.abs(means).max(axis=0) ** 2)  # rounding is no distance
    if not apart.any():
        return []
    removed, slope, offset = np.stack([_another_gain(model, records) for records in parts], axis=1)
    side, i = np.unravel_index(int(np.argmax(removed)), removed.shape)
    if not removed[side, i] > REMOVED_LEAST:
        return []
    j = int(np.argmax(apart))
    return [
        f"second operating point: '{inputs[j]}' is about {means[0, j]:.3g} {where[0]} and {means[1, j]:.3g} {where[1]}; "
        f"'{outputs[i]}' {where[side]} moves {slope[side, i]:.2g} times as far as the model, {offset[side, i]:+.2g} off; the model "
        f"holds about {holds}: fit each by itself, or give a record that covers both"
    ]


def _another_gain(model: LinearModel, records: Sequence[InputOutputRecord]) -> Float[np.ndarray, "3 p"]:
    """Return what another gain and offset of the free run remove, by output: share of the variance, gain, mean error.

    The share is zero where most of the error remains.
    """
    runs = [(record.y[scored], run[scored]) for record in records for run, scored in [fair_run(model, record)]]
    y, run = (np.vstack(values) for values in zip(*runs, strict=True))
    known = np.isfinite(y).all(axis=1) & np.isfinite(run).all(axis=1)
    y, run = y[known], run[known]
    error, about, moved = np.mean((y - run) ** 2, axis=0), y - y.mean(axis=0), run - run.mean(axis=0)
    slope = np.sum(about * moved, axis=0) / np.maximum(np.sum(moved**2, axis=0), 1e-300)
    removed = error - np.mean((about - slope * moved) ** 2, axis=0)
    share = np.where(removed > HALF * error, removed / np.maximum(np.mean(about**2, axis=0), 1e-300), 0.0)
    return np.stack([share, slope, np.mean(y - run, axis=0)])
