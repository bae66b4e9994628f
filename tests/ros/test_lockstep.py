"""The graph in one process drives as the mission's loop does, bit for bit."""

import pytest

from treadline.core.ports import Plant
from treadline.core.signals import FlipperCommand, SeatCommand, TrackCommand
from treadline.mission.loop import Mission
from treadline.mission.mission_blocks import build_blocks, guard_config
from treadline.plant.faults import faulty
from treadline.plant.mujoco import open_plant
from treadline.ros.lockstep import LockStep
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

Written = tuple[TrackCommand, SeatCommand, float]


class Noting:
    """A plant that keeps what is written to it."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.written: list[Written] = []
        self.start, self.advance, self.read, self.close = plant.start, plant.advance, plant.read, plant.close

    def write(self, tracks: TrackCommand, seat: SeatCommand, flipper: FlipperCommand | None = None) -> None:
        self.written.append((tracks, seat, 0.0 if flipper is None else flipper.rate_rad_s))
        self._plant.write(tracks, seat, flipper)


def commands(scenario: Scenario, seconds: float, *, graph: bool) -> tuple[list[Written], str | None]:
    config = mission_config(scenario, shipped_controller(scenario.chair.model))
    blocks = build_blocks(config)
    plant = Noting(faulty(open_plant(scenario, 3), scenario, 3))
    turned = LockStep(plant, blocks, guard_config(config, blocks.driver.period_s)) if graph else Mission(plant, blocks)
    for _ in range(round(100 * seconds)):
        turned.tick()
    plant.close()
    holding = turned.guard._guard.holding if isinstance(turned, LockStep) else blocks.guard.holding
    return plant.written, holding


FLIGHT = {"stair": {"steps": 12}, "start": {"place": "flight", "step": 4, "heading_deg": 12}}
FLOOR = {"start": {"place": "floor"}, "sensors": {"camera": "statistical"}}


@pytest.mark.parametrize(
    ("values", "seconds", "held"),
    [
        pytest.param(FLIGHT, 1.5, False, id="images, on the flight"),
        pytest.param(FLOOR, 6.0, False, id="a camera that measures, from the floor, flipper and all"),
        pytest.param(FLOOR | {"fault": [{"kind": "imu_nan", "at_s": 1.0, "for_s": 5.0}]}, 2.5, True, id="IMU of NaN: held"),
        pytest.param(FLIGHT | {"fault": [{"kind": "camera_frozen", "at_s": 0.5, "for_s": 0.6}]}, 1.5, False, id="frozen camera"),
        pytest.param(FLOOR | {"fault": [{"kind": "operator_stop", "at_s": 0.8}]}, 1.2, True, id="operator stop"),
    ],
)
def test_commands_are_those_of_the_loop_bit_for_bit(values: dict[str, object], seconds: float, *, held: bool) -> None:
    scenario = Scenario.model_validate(values)
    loop, cause = commands(scenario, seconds, graph=False)
    graph, graph_cause = commands(scenario, seconds, graph=True)
    assert len(loop) == round(100 * seconds)
    assert loop == graph
    assert cause == graph_cause
    assert (cause is not None) == held
