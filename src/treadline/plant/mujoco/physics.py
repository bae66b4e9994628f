"""Numerical settings of the contact physics: step size, contact stiffness, and accuracy of the contact forces."""

from dataclasses import dataclass

from treadline.core.errors import SettingsError
from treadline.core.signals import TICK_S
from treadline.plant.mujoco.coulomb_kernels import MAX_SOLVES, TOLERANCE_M_S2


@dataclass(frozen=True, slots=True, kw_only=True)
class Physics:
    """Numerical settings of a plant, separate from the scenario, because results must not depend on them."""

    timestep_s: float = 0.002
    """MuJoCo time step [s]; a tick of 10 ms is an integer number of steps."""
    contact_time_constant_s: float = 0.01
    """Time constant of the critically damped contact spring [s] (MuJoCo's ``solref[0]``); the stiffness is proportional to its
    inverse square."""
    tolerance_m_s2: float = TOLERANCE_M_S2
    """Accepted residual of the contact correction [m/s²]."""
    max_solves: int = MAX_SOLVES
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
