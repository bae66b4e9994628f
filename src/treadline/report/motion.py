"""What a run's log knows and its series does not: how fast the chair pitched, and what its passenger felt."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from treadline.angles import DEG
from treadline.errors import LogFormatError
from treadline.io.mcap_read import read_log
from treadline.io.runs import LOG
from treadline.mechanics.comfort import COMFORT_TICKS, lasting, passenger_acceleration
from treadline.ports import Truth

TRUTH = "/truth"
READ_BYTES = 512 * 1024**2
"""Of a log with images, which are unpacked on the way to the truth: more is not read for two curves."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Truth of a log at 100 Hz, as means over 50 ms."""

    t_s: Float[np.ndarray, " T"]
    pitch_rate_deg_s: Float[np.ndarray, " T"]
    accelerated_t_s: Float[np.ndarray, " a"]
    passenger_m_s2: Float[np.ndarray, " a"]
    """Acceleration of the passenger, all three axes together."""


def read_motion(folder: Path) -> tuple[Motion | None, str | None]:
    """Return the motion that the log of a run folder holds, or None and why there is none."""
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
