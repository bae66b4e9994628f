"""Inputs that do not move, or only move with others, left out of a record; the difference of belts that move together."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from treadline.core.errors import PoorExcitation
from treadline.core.models import InputOutputRecord
from treadline.identification._belts import DifferentialInput, named_differential
from treadline.identification._checks import channel_names
from treadline.identification._limits import ROUNDING


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DriveLog:
    """Records to be fitted, without inputs that do not move or only move with others."""

    records: list[InputOutputRecord]
    kept: Bool[np.ndarray, " m"] | None = None
    """Mask of the inputs that remain; None for all."""
    differential: DifferentialInput | None = None
    """Belts of which only the difference can be fitted."""
    findings: tuple[str, ...] = ()
    """What was left out, and why."""

    def other(self, record: InputOutputRecord) -> InputOutputRecord:
        """Return another record, such as the one for validation, with the same inputs left out."""
        kept = self.kept
        return record if kept is None or record.u.shape[1] != len(kept) else _with_inputs(record, kept)


def without_dependent_inputs(records: list[InputOutputRecord], *, name_prior: bool) -> DriveLog | None:
    """Return the log without constant and collinear inputs, or with the difference of such belts; None if all inputs are needed.

    Raises:
        PoorExcitation: If no input moves, or belts always differ by the same speed and only turns are measured.
    """
    u = np.vstack([record.u[record.whole] for record in records])
    names = channel_names(records[0])[: u.shape[1]]
    mean, moved = u.mean(axis=0), u - u.mean(axis=0)
    still = ~(moved.std(axis=0) > 1e-12 * np.abs(mean))
    kept = _independent(moved / np.where(still, 1.0, moved.std(axis=0)), ~still)
    if kept.all():
        return None
    if still.all():
        raise PoorExcitation(f"no input moves ({', '.join(names)}); give a record with motion")
    belts = named_differential(records[0]) if name_prior else None
    if belts is not None:
        return _by_difference(records, belts, moved, still)
    findings = []
    for j in np.flatnonzero(~kept):
        if still[j]:
            findings.append(
                f"constant input: '{names[j]}' is constant at {mean[j]:.4g} and left out; its effect is part of the offset"
            )
        else:
            before = np.flatnonzero(kept[:j])
            share = np.linalg.lstsq(moved[:, before], moved[:, j], rcond=None)[0] * moved[:, before].std(axis=0)
            partners = " and ".join(f"'{names[i]}'" for i in before[np.abs(share) > ROUNDING**0.5 * moved[:, j].std()])
            findings.append(
                f"collinear input: '{names[j]}' always moves with {partners} and is left out; the model holds only while it does"
            )
    return DriveLog(records=[_with_inputs(record, kept) for record in records], kept=kept, findings=tuple(findings))


def _independent(scaled: Float[np.ndarray, "T m"], moving: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Return the mask of the moving inputs that are no linear combination of those before them."""
    kept, basis = moving.copy(), np.empty((len(scaled), 0))
    for j in np.flatnonzero(moving):
        rest = scaled[:, j] - basis @ (basis.T @ scaled[:, j])
        rest -= basis @ (basis.T @ rest)
        kept[j] = rest @ rest > ROUNDING * len(scaled)
        if kept[j]:
            basis = np.column_stack([basis, rest / np.linalg.norm(rest)])
    return kept


def _by_difference(
    records: list[InputOutputRecord], belts: DifferentialInput, moved: Float[np.ndarray, "T 2"], still: Bool[np.ndarray, " 2"]
) -> DriveLog:
    one, other = (f"'{name}'" for name in belts.names)
    if not np.std(moved @ belts.signs.T) > ROUNDING**0.5 * np.std(moved):
        raise PoorExcitation(
            f"collinear inputs: {one} and {other} always differ by the same speed: nothing turns the vehicle; drive curves"
        )
    cause = (
        f"constant input: {(one, other)[int(np.argmax(still))]} is constant"
        if still.any()
        else (f"collinear inputs: {one} and {other} always move together")
    )
    finding = f"{cause}: the difference of both is the only input, as in a vehicle whose sides are equal; move each belt by itself"
    return DriveLog(records=records, differential=belts, findings=(finding,))


def _with_inputs(record: InputOutputRecord, kept: Bool[np.ndarray, " m"]) -> InputOutputRecord:
    given = channel_names(record)[: len(kept)]
    names = tuple(name for name, stays in zip(given, kept, strict=True) if stays)
    return replace(record, u=record.u[:, kept], input_names=names)
