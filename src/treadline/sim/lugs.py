"""Lugs of a scenario's belts, as the compiled loop takes them: ``belts, tracks, model -> Lugs``."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from treadline.errors import SettingsError
from treadline.mechanics.chair import Tracks
from treadline.mechanics.lugs import oversized_lugs
from treadline.scenario import Belts
from treadline.sim import lug_kernels

DMAX = 0.99
"""Largest impedance of a contact: the scene's solimp."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lugs:
    """Numbers and state of both belts' lugs; the arrays stay where they are."""

    numbers: Float[np.ndarray, " n"]
    """Entries as in ``lug_kernels``; empty for smooth belts."""
    start_m: Float[np.ndarray, " 2"]
    """Travel at which each belt starts, drawn from the seed."""
    travel_m: Float[np.ndarray, " 2"]
    part_of: Int[np.ndarray, " g"]
    """Part of each geom."""

    def start(self) -> None:
        """Put the belts where they start."""
        self.travel_m[:] = self.start_m


def fit_lugs(
    settings: Belts, tracks: Tracks, model: mujoco.MjModel, belts: Int[np.ndarray, "2 5"], draws: np.random.Generator
) -> Lugs:
    """Give a model's belts their rubber's stiffness and lugs.

    Raises:
        SettingsError: If the lugs are larger than the chair's pulleys bear.
    """
    height, pitch, tip, flank = settings.measures_m
    part_of = np.full(model.ngeom, lug_kernels.SMOOTH)
    part_of[belts] = np.arange(belts.size).reshape(belts.shape)
    if settings.stiffness_s is not None:
        model.geom_solref[belts, 0] = settings.stiffness_s
    time_constant_s = float(model.geom_solref[belts[0, 0], 0])
    if height == 0.0:
        return Lugs(numbers=np.array([]), start_m=np.zeros(2), travel_m=np.zeros(2), part_of=part_of)
    refusal = oversized_lugs(settings, tracks)
    if refusal is not None:
        raise SettingsError(refusal)
    _shrink(model, belts, height)
    numbers = np.zeros(11)
    numbers[:5] = height, pitch, tip, flank, 2.0 * DMAX * time_constant_s
    numbers[5:10] = tracks.flat_run_m, tracks.approach_m, tracks.pulley_radius_m, 0.5 * tracks.belt_width_m, tracks.gauge_m
    numbers[lug_kernels.STEP_S] = model.opt.timestep
    return Lugs(numbers=numbers, start_m=draws.uniform(0.0, pitch, 2), travel_m=np.zeros(2), part_of=part_of)


def _shrink(model: mujoco.MjModel, belts: Int[np.ndarray, "2 5"], height: float) -> None:
    """Draw the belts' solids back by the lugs' height, and let contacts begin at the tips: cores never meet a nosing deeply."""
    model.geom_margin[belts] = height
    model.geom_size[belts[:, :3], 0] -= height  # pulleys
    for geom in belts[:, 3:].ravel():
        # A box keeps its upper face: only its lower one is the belt's outside.
        model.geom_size[geom, 2] -= 0.5 * height
        up = np.zeros(3)
        mujoco.mju_rotVecQuat(up, np.array([0.0, 0.0, 0.5 * height]), model.geom_quat[geom])
        model.geom_pos[geom] += up
