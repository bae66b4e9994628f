"""Chair in MuJoCo behind the outputs and readings of a box.

``Outputs -> Readings``, in ticks of 10 ms.
"""

from pathlib import Path

from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import (
    TICK_S,
    FlipperCommand,
    FlipperReading,
    ImuSample,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
)
from treadline.hardware import _frame as frame
from treadline.hardware._frame import Present, counts
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import Outputs, Readings
from treadline.hardware.emulators.camera import FrameFile
from treadline.run.resolve import resolve


class EmulatedChair:
    """Simulated chair of a scenario, with faults of its wiring.

    Args:
        scenario: Name of a shipped scenario, or path of a scenario file.
        faults: Faults, of which those of camera, inertial sensor and belts apply here.
    """

    def __init__(self, scenario: str | Path, seed: int, faults: Faults, camera: FrameFile) -> None:
        setup = resolve(scenario, seed=seed)
        self.chair = setup.chair
        self._plant = setup.open_plant()
        self._plant.start()
        self._faults, self._camera, self._ticks = faults, camera, 0
        self._readings = Readings(voltage_mv=round(self._voltage_v() / frame.MILLI), present=Present.VOLTAGE)

    @property
    def t_s(self) -> float:
        """Time of the emulator [s]: the ticks so far."""
        return self._ticks * TICK_S

    def step(self, outputs: Outputs) -> Readings:
        """Drive for one tick and return what the box measures at its end."""
        t_s = self.t_s
        left, right = self._wired(*(speed * frame.SET_POINT_M_S for speed in outputs.belts_um_s))
        self._plant.write(
            TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right, brake=outputs.brake),
            SeatCommand(t_s=t_s, rate_m_s=outputs.seat * frame.SEAT_M),
            FlipperCommand(t_s=t_s, rate_rad_s=outputs.flipper * frame.FLIPPER_RAD_S),
        )
        self._ticks += 1
        self._plant.advance(self.t_s)
        for reading in self._plant.read():
            self._take(reading)
        return self._readings

    def _wired(self, left: float, right: float) -> tuple[float, float]:
        """Return the belts' speeds as wired: between the box's outputs and the belts, or back."""
        active = self._faults.active
        left, right = (right, left) if active("swapped_belts", self.t_s) else (left, right)
        return -left if active("left_reversed", self.t_s) else left, -right if active("right_reversed", self.t_s) else right

    def _take(self, reading: object) -> None:
        """Write a reading in the units of the frame."""
        to = self._readings
        match reading:
            case TrackReading():
                to.belts[:] = [counts(speed, frame.BELT_M_S) for speed in self._wired(reading.left_m_s, reading.right_m_s)]
            case ImuSample() if not self._faults.active("imu_frozen", self.t_s):
                to.present |= Present.IMU
                to.orientation[:] = [counts(part, frame.QUATERNION) for part in reading.orientation]
                to.rates[:] = [counts(rate, frame.RAD) for rate in reading.angular_velocity_rad_s]
                to.accelerations[:] = [counts(part, frame.MILLI) for part in reading.linear_acceleration_m_s2]
            case RgbdFrame() if not self._faults.active("camera_gone", self.t_s):
                self._camera.write(reading)
            case SeatReading():
                to.present |= Present.SEAT
                to.seat[:] = counts(reading.pitch_rad, frame.RAD), counts(reading.stroke_m, frame.SEAT_M)
            case FlipperReading():
                to.present |= Present.FLIPPER
                to.flipper[:] = counts(reading.angle_rad, frame.RAD), counts(reading.torque_n_m, frame.TORQUE_N_M)

    def _voltage_v(self) -> float:
        """Return the voltage of the full battery, 0 for a chair file without one."""
        battery = self.chair.battery
        return 0.0 if battery is None else battery.full_v
