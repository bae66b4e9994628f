"""Parameters of the contacts for the compiled loop: numerical settings, and lugs of the belts.

``belts, tracks, model -> Lugs``.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int

from treadline.core.errors import SettingsError
from treadline.core.signals import TICK_S
from treadline.plant.mujoco.contact import _coulomb_kernels as coulomb
from treadline.plant.mujoco.contact import _rubber_lug_kernels as lugs
from treadline.scenario.chair import ChairDescription
from treadline.scenario.scenario import Belts
from treadline.vehicle.bodies import oversized_lugs

DMIN, DMAX, WIDTH_M = 0.95, 0.99, 0.001
"""Impedances of a contact at its surface and deeper than a width [m]: MuJoCo's ``solimp``, with 0.95 in place of its 0.9."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """Numerical settings of a plant, separate from the scenario, because results must not depend on them."""

    timestep_s: float = 0.002
    """MuJoCo time step [s]; a tick of 10 ms is an integer number of steps."""
    contact_time_constant_s: float = 0.01
    """Time constant of the critically damped contact spring [s] (MuJoCo's ``solref[0]``); the stiffness is proportional to its
    inverse square."""
    tolerance_m_s2: float = coulomb.TOLERANCE_M_S2
    """Accepted residual of the contact correction [m/s²]."""
    max_solves: int = coulomb.MAX_SOLVES
    """Largest number of contact solves per step."""

    def __post_init__(self) -> None:
        """Reject settings without a stable integration.

        Raises:
            SettingsError: One line with the setting, its value, the bound and the reason.
        """
        steps = TICK_S / self.timestep_s if self.timestep_s > 0.0 else 0.0
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-9 * steps:
            raise SettingsError(
                f"timestep_s is {self.timestep_s:g} s; a tick of {TICK_S:g} s is a whole number of steps: "
                "0.005, 0.0025, 0.002, 0.001 and so on"
            )
        bound = 2.0 * self.timestep_s
        if not self.contact_time_constant_s >= bound * (1.0 - 1e-9):
            raise SettingsError(
                f"contact_time_constant_s is {self.contact_time_constant_s:g} s; a step of {self.timestep_s:g} s integrates at "
                f"least 2 × timestep_s = {bound:g} s: a stiffer spring is unstable, and MuJoCo would soften it unasked"
            )
        if not self.tolerance_m_s2 > 0.0:
            raise SettingsError(
                f"tolerance_m_s2 is {self.tolerance_m_s2:g} m/s²; it must be above 0: an iteration reaches no residual of exactly 0"
            )
        if self.max_solves < 1:
            raise SettingsError(f"max_solves is {self.max_solves}; a step needs at least 1 contact solve")

    @property
    def substeps(self) -> int:
        """Number of MuJoCo steps per tick."""
        return round(TICK_S / self.timestep_s)


NOMINAL = Physics()
"""Default numerical settings."""
FAST = Physics(timestep_s=0.0025, tolerance_m_s2=0.3)
"""Settings for learning: turns differ from those of ``NOMINAL`` by less than 2 %, creep by less than 1 mm
(``tests/bench/test_fast_physics.py``). A step of 3.3 ms turns a chair up to 9 % too far, one of 5 ms twice as far; random actions
do not show it."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lugs:
    """Parameters and state of the lugs of both belts; the compiled loop keeps references to the arrays."""

    parameters: lugs.LugParameters
    start_m: Float[np.ndarray, " 2"]
    """Initial travel of each belt [m], drawn from the seed."""
    travel_m: Float[np.ndarray, " 2"]
    """Present travel of each belt [m]."""
    part_of: Int[np.ndarray, " g"]
    """Belt part of each geom."""


def fit_lugs(
    settings: Belts, chair: ChairDescription, model: mujoco.MjModel, belts: Int[np.ndarray, "2 g"], draws: np.random.Generator
) -> Lugs:
    """Set contact stiffness and lugs of the belts in a model.

    Args:
        belts: geom ids as (side, rear front nose flat approach wheels, and those of further sections).

    Raises:
        SettingsError: If the lugs are too large for the chair's pulleys, or the belts have further sections.
    """
    tracks, (height, pitch, tip, flank) = chair.tracks, settings.measures_m
    part_of = np.full(model.ngeom, lugs.SMOOTH)
    wheels = [lugs.REAR, *[lugs.FLAT] * (tracks.road_wheels - 2), lugs.FRONT]
    known = [*range(lugs.PARTS), *wheels]
    part_of[belts[:, : len(known)]] = [[side * lugs.PARTS + part for part in known] for side in range(2)]
    if settings.stiffness_s is not None:
        model.geom_solref[belts, 0] = settings.stiffness_s
    time_constant_s = float(model.geom_solref[belts[0, 0], 0])
    lug = (height, pitch, tip, flank, 2.0 * DMAX * time_constant_s)
    belt = (tracks.flat_run_m, tracks.approach_m, tracks.pulley_radius_m, 0.5 * tracks.belt_width_m, tracks.gauge_m)
    start_m = np.zeros(2)
    if height > 0.0:
        refusal = oversized_lugs(settings, chair)
        if refusal is not None:
            raise SettingsError(refusal)
        _shrink(model, belts, height)
        start_m = draws.uniform(0.0, pitch, 2)
    parameters = lugs.LugParameters(*lug, *belt, step_s=float(model.opt.timestep))
    return Lugs(parameters=parameters, start_m=start_m, travel_m=np.zeros(2), part_of=part_of)


def _shrink(model: mujoco.MjModel, belts: Int[np.ndarray, "2 g"], height: float) -> None:
    """Shrink the belt geoms by the lug height and start contacts at the lug tips, which limits the penetration of the cores."""
    model.geom_margin[belts] = height
    boxes = belts[:, [lugs.FLAT, lugs.APPROACH]]
    model.geom_size[np.setdiff1d(belts, boxes), 0] -= height  # pulleys and road wheels
    for geom in boxes.ravel():
        # The upper face of a box stays in place, because only the lower face is on the outside of the belt.
        model.geom_size[geom, 2] -= 0.5 * height
        up = np.zeros(3)
        mujoco.mju_rotVecQuat(up, np.array([0.0, 0.0, 0.5 * height]), model.geom_quat[geom])
        model.geom_pos[geom] += up
