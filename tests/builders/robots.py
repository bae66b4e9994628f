"""A robot file, and the files by which a test moves the hand on its handset, breaks its box and reads what the box did."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from treadline.hardware.robot_file import RobotFile, read_robot

TEXT = """
name = "chair of a test"
[limits]
belt_m_s = 0.3
acceleration_m_s2 = 1.0
battery_least_v = 22.0
[drives]
link = "box:FloorBox"
folder = "{folder}"
[imu]
link = "drives"
[joints]
link = "drives"
[handset]
link = "box:Hand"
folder = "{folder}"
[mission]
payload_kg = 50.0
"""


@dataclass(frozen=True)
class TestRobot:
    """Chair with the box of ``box.py``."""

    __test__ = False
    folder: Path

    def __post_init__(self) -> None:
        self.hold(dead_man=False)
        self.broken()
        (self.folder / "robot.toml").write_text(TEXT.format(folder=self.folder))

    @property
    def path(self) -> Path:
        return self.folder / "robot.toml"

    def file(self) -> RobotFile:
        return read_robot(self.path)

    def hold(self, **state: Any) -> None:
        self._write("hand.json", state)

    def broken(self, *faults: str) -> None:
        self._write("faults.json", faults)

    def done(self) -> list[dict[str, Any]]:
        """Return what the box did: one entry for each change of a command, by its own clock."""
        return [json.loads(line) for line in (self.folder / "box.jsonl").read_text().splitlines()]

    def obey(self, line: str) -> None:
        """Do what the arming list asks a person to do."""
        if "re-arm" in line:
            self.hold(dead_man=False)
            time.sleep(1.0)  # a release that is meant
            self.hold(dead_man=True, rearm=True)

    def _write(self, name: str, value: Any) -> None:
        draft = self.folder / (name + ".new")
        draft.write_text(json.dumps(value))
        draft.replace(self.folder / name)
