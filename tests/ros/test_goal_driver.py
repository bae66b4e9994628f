"""The driver that stands until it has a goal: one graph drives over two floors by velocities and a goal between them."""

import math
from collections.abc import Callable
from typing import Any

import pytest

from treadline.core.errors import SettingsError
from treadline.core.ports import Truth
from treadline.core.signals import TICK_S, VelocityCommand
from treadline.plant.mujoco import open_plant
from treadline.ros import channels as on
from treadline.ros.assembly import DRIVING, node_of
from treadline.ros.goal_driver import GoalDriverNode, Outcome
from treadline.ros.lockstep import InProcess
from treadline.ros.stair_goal import StairGoal
from treadline.run.resolve import mission_config
from treadline.scenario.scenario import Scenario
from treadline.scenario.shipped_files import shipped_controller

SEED = 41_003


class Graph:
    """All nodes in one process, the driver without a goal, at the foot of a stair of three steps."""

    def __init__(self) -> None:
        values = {"stair": {"steps": 3, "landing_m": 4.0}, "sensors": {"camera": "statistical"}}
        scenario = Scenario.model_validate(values)
        config = mission_config(scenario, shipped_controller(scenario.chair.model))
        self.air, self.t_s = InProcess(), 0.0
        made = {name: node_of(name, config, plant=lambda: open_plant(scenario, SEED), goals=True) for name in DRIVING}
        made["guard"]._waits_for.clear()  # type: ignore[attr-defined]
        self._nodes = [made[name] for name in ("plant", "guard", "camera", "heading", "seat", "driver")]
        self.heard: dict[str, list[Any]] = {channel: [] for channel in (on.GUARD, on.TRUTH, on.PLAN)}
        for channel, heard in self.heard.items():
            self.air.subscribe(channel, heard.append)
        for node in self._nodes:
            node.listen(self.air)
        made["plant"].start()  # type: ignore[attr-defined]
        self.driver: GoalDriverNode = made["driver"]  # type: ignore[assignment]

    def run(self, seconds: float, done: Callable[[], bool] = lambda: False, speed_m_s: float | None = None) -> None:
        until_s = self.t_s + seconds
        while self.t_s < until_s and not done():
            for node in self._nodes[1:]:
                node.advance(self.t_s)
            self._nodes[0].tick(self.t_s)
            if speed_m_s is not None:
                self.air.publish(on.TWIST, VelocityCommand(t_s=self.t_s, speed_m_s=speed_m_s, turn_rad_s=0.0))
            for node in (*self._nodes[2:], self._nodes[1]):
                node.tick(self.t_s)
            self.t_s += TICK_S

    @property
    def truth(self) -> Truth:
        return self.heard[on.TRUTH][-1]


def test_one_graph_drives_over_two_floors() -> None:
    """Test: velocities towards a stair, a goal up, velocities on the landing, as ``two_floors.xml`` asks for them. Expected result:
    the chair drives, arrives and drives on; whose commands count is said; the distance to go falls to zero; nothing is held."""
    graph, ends, to_go_m = Graph(), list[Outcome](), list[float]()
    graph.run(1.0)
    began_m = graph.truth.x_m
    graph.run(2.0, speed_m_s=0.1)
    assert graph.truth.x_m - began_m == pytest.approx(0.19, abs=0.03)
    began = graph.truth
    graph.driver.begin(StairGoal(direction="up", stair_id="east", steps=3), ends.append)

    def ended() -> bool:
        to_go_m.append(graph.driver.progress.distance_to_go_m)
        return bool(ends)

    graph.run(60.0, ended)
    assert ends[0].verdict == "arrived"
    assert graph.driver.traversed.steps == 3
    assert graph.driver.traversed.rise_m == pytest.approx(graph.truth.chassis_z_m - began.chassis_z_m, abs=0.05)
    known = [distance_m for distance_m in to_go_m if not math.isnan(distance_m)]
    assert (max(known) > 1.0, known[-1]) == (True, 0.0)
    up_m = graph.truth.x_m
    graph.run(2.0, speed_m_s=0.1)
    assert graph.truth.x_m - up_m == pytest.approx(0.19, abs=0.03)
    assert [state.source for state in graph.heard[on.GUARD]] == ["velocity", "driver", "velocity"]
    assert [state.holding for state in graph.heard[on.GUARD]] == [None] * 3


def test_goals_that_cannot_be_and_one_that_is_cancelled() -> None:
    """Test: a goal down, one too fast, one while another is under way, a cancelled one, and one after it. Expected result: refused
    with what to do; the cancelled one ends so, and the guard holds until a person re-arms."""
    graph, ends = Graph(), list[Outcome]()
    graph.run(0.5)
    with pytest.raises(SettingsError, match=r"^this graph goes up; start one whose scenario has drive.direction = 'down'$"):
        graph.driver.begin(StairGoal(direction="down"), ends.append)
    with pytest.raises(SettingsError, match=r"^a speed of 2 m/s, a limit of 0 s; give 0 to 0.3 m/s, and a positive time$"):
        graph.driver.begin(StairGoal(speed_m_s=2.0), ends.append)
    graph.driver.begin(StairGoal(direction="up"), ends.append)
    with pytest.raises(SettingsError, match="cancel it first"):
        graph.driver.begin(StairGoal(direction="up"), ends.append)
    graph.run(1.0)
    graph.driver.cancel("cancelled by the client")
    graph.run(0.1)
    assert ends == [Outcome("cancelled", "cancelled by the client")]
    assert graph.heard[on.GUARD][-1].holding == "cancelled by the client"
    with pytest.raises(SettingsError, match=r"^the guard holds the chair: cancelled by the client; re-arm it first$"):
        graph.driver.begin(StairGoal(direction="up"), ends.append)


def test_a_goal_ends_with_its_time_or_with_its_node() -> None:
    """Test: a goal of one second; another, whose node is stopped. Expected result: time up, and the chair is held; held."""
    graph, ends = Graph(), list[Outcome]()
    graph.run(0.5)
    graph.driver.begin(StairGoal(limit_s=1.0), ends.append)
    graph.run(1.2)
    assert ends == [Outcome("time_up", "the time limit of the goal is over at 1.5 s")]
    assert graph.heard[on.GUARD][-1].holding == ends[0].cause
    other = Graph()
    other.driver.begin(StairGoal(direction="up"), ends.append)
    other.run(0.02)  # no stair has been seen
    assert other.driver.progress.stability_margin_rad == pytest.approx(math.radians(30.0), abs=0.3)
    other.driver.abandon("the node of the driver was stopped")
    assert ends[-1] == Outcome("held", "the node of the driver was stopped")


def test_a_client_that_falls_silent_stops_the_chair_within_a_second() -> None:
    """Test: a goal with a lease of 0.6 s, renewed for 1.5 s and then no more. Expected result: the belts stand within 1 s of the
    last sign of the client, and the guard holds with the cause."""
    graph, ends = Graph(), list[Outcome]()
    graph.run(0.5)
    graph.driver.begin(StairGoal(lease_s=0.6), ends.append)

    def renewed() -> bool:
        graph.driver.renew()
        return False

    graph.run(1.5, renewed)
    assert ends == []
    assert graph.truth.left_m_s > 0.05
    graph.run(1.0)
    assert ends == [Outcome("lease_over", "the client of the goal is silent for 0.6 s")]
    assert abs(graph.truth.left_m_s) < 0.01
    assert graph.heard[on.GUARD][-1].holding == ends[0].cause


@pytest.mark.parametrize(
    ("goal", "cause"),
    [
        (
            StairGoal(stair_id="west", step_rise_m=0.12),
            r"another stair: steps of stair 'west' rise 0.120 m, those in view 0.1\d\d m",
        ),
        (
            StairGoal(stair_id="west", foot=("base_link", (8.0, 0.0, 0.0))),
            r"another stair: the foot of stair 'west' is \d.\d\d m from the one in view",
        ),
        (
            StairGoal(stair_id="west", foot=("map", (0.0, 0.0, 0.0))),
            "the foot of stair 'west' is in frame 'map'; give it in odom or base_link",
        ),
    ],
    ids=["rise", "foot", "frame"],
)
def test_a_goal_for_another_stair_is_refused_and_nothing_is_driven(goal: StairGoal, cause: str) -> None:
    graph = Graph()
    graph.run(1.0)
    began_m = graph.truth.x_m
    with pytest.raises(SettingsError, match=f"^{cause}$"):
        graph.driver.begin(goal, print)
    graph.run(0.3)
    assert graph.truth.x_m == pytest.approx(began_m, abs=0.001)
