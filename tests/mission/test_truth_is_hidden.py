"""The scenario's truth never reaches the mission: not by a call, not by an import, not by any other way."""

from collections.abc import Sequence

import pytest

from treadline.core.errors import SettingsError
from treadline.core.ports import Plant, Reading
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.experiments.plan import turn
from treadline.mission.loop import Mission
from treadline.mission.mission_blocks import build_blocks
from treadline.mission.mission_config import MissionConfig
from treadline.plant.mujoco import open_plant
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller


class Recording:
    """Passes a plant's samples on and keeps them."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.batches: list[Sequence[Reading]] = []
        self.written: list[tuple[TrackCommand, SeatCommand, FlipperCommand | None]] = []
        self.start, self.advance, self.close = plant.start, plant.advance, plant.close

    def read(self) -> Sequence[Reading]:
        self.batches.append(self._plant.read())
        return self.batches[-1]

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        self.written.append((tracks, seat, flipper))
        self._plant.write(tracks, seat, flipper)


class Replay:
    """Plays batches of samples: a plant that has no truth, no scenario, no physics."""

    def __init__(self, batches: Sequence[Sequence[Reading]]) -> None:
        self._batches = iter(batches)
        self.written: list[tuple[TrackCommand, SeatCommand, FlipperCommand | None]] = []

    def start(self) -> None: ...
    def advance(self, until_s: float) -> None: ...
    def close(self) -> None: ...

    def read(self) -> Sequence[Reading]:
        return next(self._batches)

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        self.written.append((tracks, seat, flipper))


def drive(plant: Plant, config: MissionConfig, ticks: int) -> None:
    mission = Mission(plant, build_blocks(config))
    for _ in range(ticks):
        mission.tick()


def test_the_same_samples_without_any_truth_give_the_same_commands_bit_for_bit() -> None:
    scenario = turn(28, 20, 4.0)
    config = mission_config(scenario, shipped_controller("wheelchair"))
    recording = Recording(open_plant(scenario, seed=7))
    drive(recording, config, 300)
    replay = Replay(recording.batches)
    drive(replay, config, 300)
    assert replay.written == recording.written
    assert len({round(tracks.left_m_s, 3) for tracks, *_ in replay.written}) > 3  # it did steer


def test_the_mission_configuration_does_not_depend_on_slope_friction_heading_or_where_the_payload_sits() -> None:
    design = shipped_controller("wheelchair")
    configured = mission_config(turn(25, 30, 80.0), design)
    other = turn(30, -12, 80.0)
    hidden = other.model_dump()
    hidden["stair"] |= {"friction": (0.9, 0.8), "rise_jitter_m": 0.002, "texture": "carpet"}
    hidden["chair"] |= {"payload_offset_m": (0.03, 0.02, 0.1), "belt_mismatch": 0.03}
    hidden["sensors"] |= {"gravity_error_deg": 1.0}
    hidden["stair"].pop("slope_deg", None)
    assert mission_config(Scenario.model_validate(hidden), design) == configured


def test_a_closed_loop_without_a_controller_is_refused() -> None:
    with pytest.raises(SettingsError, match="needs a controller"):
        build_blocks(mission_config(turn(28, 0, 1.0), None))
