"""Dead time of the inputs, removed from the records before the fit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from treadline.core.errors import SettingsError
from treadline.core.models import InputOutputRecord


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
