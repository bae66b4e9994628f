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
from treadline.hardware._frame import Present
from treadline.hardware.emulators._faults import Faults
from treadline.hardware.emulators._firmware import Inputs, Outputs, Readings
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
        self.inputs = Inputs(dead_man=True)
        """Inputs of a box without switches, at its next tick."""
        full_v = 0.0 if self.chair.battery is None else self.chair.battery.full_v
        self._readings = Readings(voltage_mv=frame.counts("voltage", [full_v])[0], present=Present.VOLTAGE)

    @property
    def t_s(self) -> float:
        """Time of the emulator [s]: the ticks so far."""
        return self._ticks * TICK_S

    def step(self, outputs: Outputs) -> Readings:
        """Drive for one tick and return what the box measures at its end."""
        t_s = self.t_s
        left, right = self._wired(*frame.physical("set_points", outputs.belts_um_s))
        _, _, seat_m_s, flipper_rad_s = frame.physical("drive", (0, 0, outputs.seat, outputs.flipper))
        self._plant.write(
            TrackCommand(t_s=t_s, left_m_s=left, right_m_s=right, brake=outputs.brake),
            SeatCommand(t_s=t_s, rate_m_s=seat_m_s),
            FlipperCommand(t_s=t_s, rate_rad_s=flipper_rad_s),
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
        to, counts = self._readings, frame.counts
        match reading:
            case TrackReading():
                self.inputs.belts[:] = counts("belts", self._wired(reading.left_m_s, reading.right_m_s))
            case ImuSample() if not self._faults.active("imu_frozen", self.t_s):
                to.present |= Present.IMU
                to.orientation[:] = counts("orientation", reading.orientation)
                to.rates[:] = counts("rates", reading.angular_velocity_rad_s)
                to.accelerations[:] = counts("accelerations", reading.linear_acceleration_m_s2)
            case RgbdFrame() if not self._faults.active("camera_gone", self.t_s):
                self._camera.write(reading)
            case SeatReading():
                to.present |= Present.SEAT
                to.seat[:] = counts("seat", (reading.pitch_rad, reading.stroke_m))
            case FlipperReading():
                to.present |= Present.FLIPPER
                to.flipper[:] = counts("flipper", (reading.angle_rad, reading.torque_n_m))
