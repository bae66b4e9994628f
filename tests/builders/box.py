"""A box at the drives, and a handset, inside the guard process: the rules of the firmware on belts with a first-order lag.

Test and box speak through files, because the test is another process: ``faults.json`` in (names of faults),
``box.jsonl`` out, one line at each change of what the belts are commanded, by the box's own clock.
"""

import json
import math
import time
from pathlib import Path
from typing import Any

from treadline.core.errors import LinkError
from treadline.core.signals import FlipperReading, ImuSample, OperatorInput, SeatReading
from treadline.hardware.ports import DriveLimits, DriveState, StickReading

PERIOD_S = 0.01
LAG_S = 0.15
GAUGE_M = 0.65


class FloorBox:
    """Link to drives, inertial sensor, seat and flipper."""

    def __init__(self, *, limits: DriveLimits, folder: str, volts: float = 25.0) -> None:
        self.limits, self.folder, self.volts = limits, Path(folder), volts
        self.latched, self.tripped = True, False
        self.asked = (0.0, 0.0)
        self.commanded = [0.0, 0.0]
        self.belts = [0.0, 0.0]
        self.yaw_rad, self.moving = 0.0, False
        self.t_s = self.heard_s = time.monotonic()
        self.faults: set[str] = set()
        self.rates_rad_s = (0.0, 0.0, 0.0)
        self.log("open")

    def poll(self) -> list[Any]:
        self.faults = set(json.loads((self.folder / "faults.json").read_text()))
        if "unplugged" in self.faults:
            self.log("unplugged")
            raise LinkError("the box does not answer: the line is unplugged; plug it in and start again")
        readings: list[Any] = [None] if "nonsense" in self.faults else []
        while self.t_s + PERIOD_S <= time.monotonic():
            self.t_s += PERIOD_S
            self.step()
            readings += self.readings()
        return readings

    def step(self) -> None:
        if self.t_s - self.heard_s > self.limits.watchdog_s and not self.latched:
            self.latched = self.tripped = True
            self.log("watchdog")
        if {"error", "restart"} & self.faults and not self.latched:
            self.latched = True
            self.log("latch")
        asked = (0.0, 0.0) if self.latched else self.asked
        if "swapped" in self.faults:
            asked = asked[::-1]
        step = self.limits.acceleration_m_s2 * PERIOD_S
        for side in (0, 1):
            change = min(max(asked[side] - self.commanded[side], -step), step)
            self.commanded[side] = 0.0 if self.latched else self.commanded[side] + change
            self.belts[side] += (1.0 - math.exp(-PERIOD_S / LAG_S)) * (self.commanded[side] - self.belts[side])
        if self.moving != (self.belts[0] > 0.09):
            self.moving = not self.moving
            self.log("moving" if self.moving else "slow")
        self.yaw_rad += PERIOD_S * self.turn_rad_s

    @property
    def turn_rad_s(self) -> float:
        return 0.79 * (self.belts[1] - self.belts[0]) / GAUGE_M

    def readings(self) -> list[Any]:
        left, right = self.belts[::-1] if "swapped" in self.faults else self.belts
        if "right_report_reversed" in self.faults:
            right = -right
        state = DriveState(
            t_s=self.t_s, box_s=self.t_s, left_m_s=left, right_m_s=right, watchdog_tripped=self.tripped, latched=self.latched,
            error="overcurrent of the left motor" if "error" in self.faults else None, voltage_v=self.volts,
        )  # fmt: skip
        joints = [
            SeatReading(t_s=self.t_s, pitch_rad=0.0, stroke_m=0.03),
            FlipperReading(t_s=self.t_s, angle_rad=0.7, torque_n_m=0.0),
        ]
        is_pressed = self.t_s % 0.5 < 0.25
        hand = [OperatorInput(t_s=self.t_s, dead_man=True, rearm=is_pressed)] if "rearm_pressed" in self.faults else []
        return [state, *joints, *self.inertial(), *hand]

    def inertial(self) -> list[ImuSample]:
        if "imu_silent" in self.faults:
            return []
        turned = 0.5 * self.yaw_rad
        up = -9.81 if "imu_upside_down" in self.faults else 9.81
        noise = 1e-4 * math.sin(1e3 * self.t_s)
        if "imu_frozen" not in self.faults:
            self.rates_rad_s = (noise, noise, self.turn_rad_s + noise)
        return [
            ImuSample(
                t_s=self.t_s,
                orientation=(math.cos(turned), 0.0, 0.0, math.sin(turned)),
                angular_velocity_rad_s=self.rates_rad_s,
                linear_acceleration_m_s2=(noise, noise, up),
            )
        ]

    def send(self, left_m_s: float, right_m_s: float) -> None:
        if not math.isfinite(left_m_s + right_m_s):
            return self.stop()
        self.heard_s, most_m_s = time.monotonic(), self.limits.speed_m_s
        asked = (max(-most_m_s, min(left_m_s, most_m_s)), max(-most_m_s, min(right_m_s, most_m_s)))
        if asked != self.asked:
            self.asked = asked
            self.log("send")
        return None

    def hold(self) -> None:
        self.send(0.0, 0.0)

    def stop(self) -> None:
        self.heard_s = time.monotonic()
        if not self.latched:
            self.latched = True
            self.log("stop")

    def rearm(self) -> None:
        self.heard_s = time.monotonic()
        self.latched = self.tripped = False
        self.asked = (0.0, 0.0)
        self.log("rearm")

    def move(self, seat_m_s: float, flipper_rad_s: float) -> None:
        del seat_m_s, flipper_rad_s

    def close(self) -> None:
        self.stop()
        self.log("close")

    def log(self, what: str) -> None:
        line = {"box_s": time.monotonic(), "what": what, "asked": self.asked, "latched": self.latched, "belts": self.belts}
        line["limit_m_s"] = self.limits.speed_m_s
        with (self.folder / "box.jsonl").open("a") as file:
            file.write(json.dumps(line) + "\n")


class Hand:
    """Handset that does what ``hand.json`` says: the fields of ``OperatorInput``, and ``speed`` of the stick."""

    def __init__(self, *, folder: str) -> None:
        self.path = Path(folder) / "hand.json"
        self.due_s = 0.0

    def poll(self) -> list[Any]:
        now_s = time.monotonic()
        if now_s < self.due_s:
            return []
        self.due_s = now_s + 0.1
        state = json.loads(self.path.read_text())
        stick = StickReading(t_s=now_s, speed=state.pop("speed", 0.0), turn=0.0)
        return [OperatorInput(t_s=now_s, **state), stick]

    def close(self) -> None:
        pass
