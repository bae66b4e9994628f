"""Pitch rate of the chair and acceleration of the passenger, which a run's log holds and its series does not."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.core.angles import DEG
from treadline.core.errors import LogFormatError
from treadline.core.ports import Truth
from treadline.io.mcap_read import read_log
from treadline.io.runs import LOG
from treadline.vehicle.comfort import COMFORT_TICKS, lasting, passenger_acceleration

TRUTH = "/truth"
READ_BYTES = 512 * 1024**2
"""Largest log that is read for two curves [bytes]; a log with images is decompressed up to the ground truth."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Ground truth of a log at 100 Hz, as means over 50 ms."""

    t_s: Float[np.ndarray, " T"]
    pitch_rate_deg_s: Float[np.ndarray, " T"]
    accelerated_t_s: Float[np.ndarray, " a"]
    passenger_m_s2: Float[np.ndarray, " a"]
    """Magnitude of the passenger's acceleration [m/s²]."""


def read_motion(folder: Path) -> tuple[Motion | None, str | None]:
    """Return the motion from the log of a run folder, or None and the reason."""
    path = folder / LOG
    if not path.is_file():
        return None, "no log was kept"
    if path.stat().st_size > READ_BYTES:
        return None, f"{LOG} is longer than {READ_BYTES // 1024**2} MB"
    try:
        truth = [sample for sample in read_log(path, TRUTH.__eq__) if isinstance(sample, Truth)]
    except LogFormatError as error:
        return None, f"{LOG} cannot be read: {str(error).removeprefix(f'{path}: ')}"
    if len(truth) < 2 * COMFORT_TICKS:
        return None, f"{LOG} holds no truth"
    t, rate, yaw, *place_W = np.array(
        [[s.t_s, s.pitch_rate_rad_s, s.yaw_rad, s.passenger_x_m, s.passenger_y_m, s.passenger_z_m] for s in truth]
    ).T
    acceleration = passenger_acceleration(np.stack(place_W), yaw, np.diff(t))
    return Motion(
        t_s=t[COMFORT_TICKS - 1 :],
        pitch_rate_deg_s=lasting(rate) / DEG,
        accelerated_t_s=t[1 + COMFORT_TICKS :],
        passenger_m_s2=np.linalg.norm(acceleration, axis=0),
    ), None
