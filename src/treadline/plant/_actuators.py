"""Actuator models of the chair: commands in; belt speeds, seat angle and flipper angle for the simulator out."""

import math

import numpy as np
from jaxtyping import Float, Shaped

from treadline.core.angles import DEG
from treadline.core.errors import MechanicsError, SettingsError, SimulationDiverged
from treadline.core.rotations import Vector3
from treadline.core.signals import TICK_S, FlipperCommand, SeatCommand, TrackCommand
from treadline.plant import _actuator_lag_and_slew_kernels as kernels
from treadline.plant import _motors_and_battery_kernels as motor_kernels
from treadline.scenario.chair import GRAVITY_M_S2, ChairDescription, Flipper
from treadline.scenario.scenario import Scenario
from treadline.vehicle.linkage import SeatLinkage
from treadline.vehicle.loading import Loading
from treadline.vehicle.tracks import Section, sections

BRAKE_M_S2 = 10.0
"""Deceleration of a belt with engaged brake [m/s²]."""
FLIPPER_STIFFNESS_N_M_RAD = 6000.0
"""Stiffness of the flipper's gear and servo [N m/rad]: 200 N·m give a deflection of 2°."""
FLIPPER_LAG_S = 0.1
"""Ratio of damping to stiffness of the flipper servo [s]: prevents oscillation of a chair resting on its flipper."""
FLIPPER_FRICTION_N_M_S_RAD = 1.0
"""Viscous friction of the flipper joint [N m s/rad]."""
TABLE_SIZE = 257
"""Number of entries of the table of seat angle over stroke."""


class Actuators:
    """Parameters and state of the actuators as arrays for the compiled loop, which keeps references to these arrays."""

    def __init__(self, scenario: Scenario, chair: ChairDescription) -> None:
        drives, seat = chair.drives, chair.seat
        self._linkage = None if seat is None else SeatLinkage(seat)
        self.mismatch = np.array([0.0, scenario.chair.belt_mismatch])
        self.limits = np.array(
            [
                drives.max_speed_m_s,
                1.0 - math.exp(-TICK_S / drives.lag_s),
                drives.max_acceleration_m_s2 * TICK_S,
                BRAKE_M_S2 * TICK_S,
                0.0 if seat is None else 1.0 - math.exp(-TICK_S / seat.lag_s),
                0.0 if seat is None else seat.max_rate_m_s,
            ]
        )
        self.seat, self.angles = (np.array([]), np.array([])) if self._linkage is None else _seat_table(self._linkage)
        """Ends of the stroke with the table's spacing, and the seat angle over the stroke; both empty without a seat."""
        limited = scenario.realism.motor_limits
        turning = [_flipper_limits(part, part.motor, limited=limited) for part in sections(chair) if part.motor is not None]
        self.flipper = np.array(turning, kernels.FLIPPER)
        """Limits of each flipper, that which commands turn first; none without a flipper."""
        self.state = np.zeros((), kernels.STATE)
        self.command = np.zeros(5)
        self.motor = _motor_limits(scenario, chair)
        self.electric = np.zeros((), motor_kernels.ELECTRIC)
        self._charge = scenario.realism.battery_charge

    def rest(self, seat_rad: float, flipper_rad: float) -> None:
        """Reset to standstill, with the seat and the flipper at given angles.

        Raises:
            SettingsError: If the seat angle is out of reach.
        """
        self.state[...] = 0.0
        if self._linkage is not None:
            try:
                self.state["stroke"] = self._linkage.stroke(seat_rad)
            except MechanicsError as error:
                remedy = "give start.seat = 'chassis', a gentler stair, or a chair with a longer seat.stroke_m"
                raise SettingsError(f"start.seat = 'level' is impossible: {error}; {remedy}") from None
            self.state["seat_angle"] = seat_rad
        self.state["flipper_target"] = flipper_rad
        self.command[:] = 0.0
        self.electric[...] = 0.0
        self.electric["charge"] = self._charge
        for motor in self.motor:
            motor_kernels.draw(0.0, motor, self.electric[()])

    def take(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None) -> None:
        """Set the commands; they hold until the next call.

        Raises:
            SimulationDiverged: If a command is not finite.
        """
        rate = 0.0 if flipper is None else flipper.rate_rad_s
        command = (tracks.left_m_s, tracks.right_m_s, float(tracks.brake), seat.rate_m_s, rate)
        if not all(map(math.isfinite, command)):
            raise SimulationDiverged(f"a command is not finite at {tracks.t_s:.2f} s: {command}")
        self.command[:] = command

    def act(self, flipper_rad: float) -> None:
        """Advance all actuators by one tick; ``flipper_rad`` is the actual flipper angle."""
        kernels.act(self.command, self.limits, self.state[()], self.seat, self.angles, self.flipper, flipper_rad)

    @property
    def belts_m_s(self) -> Float[np.ndarray, " 2"]:
        """Actual belt speeds [m/s], mismatch included."""
        return np.asarray(self.state["belts"] * (1.0 + self.mismatch))


def _seat_table(linkage: SeatLinkage) -> tuple[Vector3, Float[np.ndarray, " n"]]:
    """Return the ends of the stroke with the table's spacing, and the table of the seat angle over the stroke."""
    low, high = linkage.stroke_range
    strokes = np.linspace(low, high, TABLE_SIZE)
    return np.array([low, high, strokes[1] - strokes[0]]), np.array([linkage.angle(float(stroke)) for stroke in strokes])


def _flipper_limits(section: Section, flipper: Flipper, *, limited: bool) -> tuple[float, ...]:
    """Return the limits of a flipper, a record ``FLIPPER`` of the compiled loop."""
    low, high = (angle * DEG for angle in flipper.range_deg)
    wind_up = flipper.torque_n_m / FLIPPER_STIFFNESS_N_M_RAD
    no_load = flipper.no_load_deg_s * DEG if limited and flipper.no_load_deg_s is not None else math.inf
    servo = (wind_up, FLIPPER_LAG_S, flipper.lost_damping_n_m_s_rad, FLIPPER_FRICTION_N_M_S_RAD)
    stays = (float(section.follows), section.stays_rad)
    return (low, high, flipper.max_rate_deg_s * DEG, *servo, flipper.torque_n_m, no_load, *stays)


def _motor_limits(scenario: Scenario, chair: ChairDescription) -> Shaped[np.ndarray, " n"]:
    """Return parameters of motors, brakes and battery for the compiled loop, one record; none without motor limits."""
    motor, battery = chair.motor, chair.battery
    if motor is None or battery is None or not scenario.realism.motor_limits:
        return np.zeros(0, motor_kernels.MOTOR)
    # Each belt carries half of the weight.
    carried_kg = 0.5 * Loading(chair=chair, payload_kg=scenario.chair.payload_kg).weight_n / GRAVITY_M_S2
    forces = (motor.peak_force_n, motor.no_load_speed_m_s, motor.continuous_force_n, motor.thermal_time_s)
    masses = (motor.moving_mass_kg, carried_kg)
    supply = (motor.nominal_v, battery.full_v, battery.empty_v, battery.resistance_ohm, 3600.0 * battery.capacity_wh)
    return np.array([(*forces, *masses, chair.drives.brake_hold_n, *supply)], motor_kernels.MOTOR)
