"""Direction of gravity in a camera frame, at the frame's exposure: ``ImuSample, RgbdFrame -> gravity_C``."""

import numpy as np
from jaxtyping import Float

from treadline.core.angles import rotation_of
from treadline.core.images import PinholeCamera, RgbdFrame
from treadline.core.signals import ImuSample, Recent

DOWN_W = np.array([0.0, 0.0, -1.0])


class GravityAtExposure:
    """Attitude history of the chair. A frame arrives late, and a chair that rocks has turned since its exposure."""

    def __init__(self) -> None:
        self._attitudes: Recent[ImuSample] = Recent()

    def update(self, sample: ImuSample) -> None:
        """Remember an attitude."""
        self._attitudes.add(sample.t_s, sample)

    def exposed(self, t_s: float) -> ImuSample | None:
        """Return the IMU sample at the exposure of a frame; None before the first attitude."""
        return self._attitudes.at(t_s)

    def gravity_C(self, frame: RgbdFrame) -> Float[np.ndarray, " 3"] | None:
        """Return the unit vector of gravity in the camera's axes when the frame was exposed; None before the first attitude."""
        exposed = self.exposed(frame.t_s)
        return None if exposed is None else gravity_in(exposed, frame.camera)


def gravity_in(exposed: ImuSample, camera: PinholeCamera) -> Float[np.ndarray, " 3"]:
    """Return the unit vector of gravity in the axes of a camera on the chair."""
    return np.asarray(camera.R_BC.T @ (rotation_of(exposed.orientation).T @ DOWN_W))
