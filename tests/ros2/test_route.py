"""A client in Python that follows a route over two floors: floors by cmd_vel, a stair by the action that names it."""

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from treadline_msgs.action import TraverseStair
from unique_identifier_msgs.msg import UUID

from treadline.ros import channels as on

GRAPH = Path(__file__).parents[2] / "ros2" / "treadline_nav2" / "graphs" / "two_floors.geojson"
STAIR = """
[stair]
steps = 3
landing_m = 4.0
[sensors]
camera = "statistical"
"""
ROUTE_S = 400.0
"""Longest wait for the end of a traversal, which a busy machine slows [s]."""


@pytest.fixture
def graph(started: Callable[..., Any], watching: Callable[..., Any], roles: tuple[str, ...], tmp_path: Path) -> Any:
    """A graph that waits for a goal at the foot of the stair of the route graph."""
    (tmp_path / "stair.toml").write_text(STAIR)
    bystander = watching()
    bystander.watch_clock()
    bystander.hear(Odometry, "odom")
    for channel in (on.TRACKS, on.GUARD):
        bystander.hear_signals(channel)
    started(*roles, given=("-p", "start:=goal", "-p", f"scenario:={tmp_path / 'stair.toml'}"))
    bystander.until(lambda: bystander.t_s > 1.0 and bystander.heard["odom"], "a second without a goal")
    return bystander


class Route:
    """Drives the edges of a route, each as its type asks for."""

    def __init__(self, graph: Any) -> None:
        self._graph = graph
        self._velocities = graph.node.create_publisher(TwistStamped, "cmd_vel", 10)
        self._lease = graph.node.create_publisher(UUID, "traverse_stair/lease", 1)
        self._stairs = ActionClient(graph.node, TraverseStair, "traverse_stair")
        self.ends: list[Any] = []

    def follow(self, edges: list[dict[str, Any]]) -> None:
        for edge in edges:
            if edge["metadata"]["type"] == "stair":
                self._over(edge["metadata"])
            else:
                self._along(edge["cost"])

    def _along(self, metres: float) -> None:
        """Drive straight on at 0.1 m/s by the odometry."""
        heard = self._graph.heard["odom"]
        begin = heard[-1].pose.pose.position.x

        def drive() -> None:
            message = TwistStamped()
            message.header.stamp = Time(sec=int(self._graph.t_s), nanosec=int(self._graph.t_s % 1.0 * 1e9))
            message.twist.linear.x = 0.1
            self._velocities.publish(message)

        timer = self._graph.node.create_timer(0.05, drive)
        self._graph.until(lambda: heard[-1].pose.pose.position.x - begin > metres, f"{metres} m")
        self._graph.node.destroy_timer(timer)

    def _over(self, stair: dict[str, Any]) -> None:
        self._graph.until(self._stairs.server_is_ready, "the action")
        goal = TraverseStair.Goal(stair_id=stair["stair_id"], steps=stair["steps"], step_rise_m=stair["step_rise_m"], lease_s=5.0)
        goal.direction = {"up": goal.DIRECTION_UP, "down": goal.DIRECTION_DOWN}[stair["direction"]]
        asked = self._stairs.send_goal_async(goal)
        self._graph.until(asked.done, "an answer")
        handle = asked.result()
        assert handle.accepted
        timer = self._graph.node.create_timer(0.1, lambda: self._lease.publish(handle.goal_id))
        ended = handle.get_result_async()
        self._graph.until(ended.done, "a result", ROUTE_S)
        self._graph.node.destroy_timer(timer)
        self.ends.append(ended.result().result)


def test_a_client_follows_a_route_over_two_floors(graph: Any) -> None:
    """Test: the route graph of the package: floor, stair, floor. Expected result: arrived on the stair that the edge names, with
    its steps; no hold."""
    edges = [item["properties"] for item in json.loads(GRAPH.read_text())["features"] if "startid" in item["properties"]]
    route = Route(graph)
    route.follow(edges)
    (end,) = route.ends
    assert end.verdict == end.VERDICT_ARRIVED, end.cause
    assert (end.stair_id, end.steps) == ("east", 3)
    assert end.rise_m == pytest.approx(3 * 0.16, abs=0.1)
    assert math.isfinite(end.pose.pose.covariance[35])
    assert [state.holding for state in graph.heard[on.GUARD] if state.holding] == []


def test_a_killed_client_stops_the_chair(graph: Any) -> None:
    """Test: the client of a goal is killed while the chair moves. Expected result: within a second the belts stand, held."""
    command = [sys.executable, "-m", "treadline_ros2.client"]
    client = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    graph.until(lambda: graph.heard[on.TRACKS][-1].left_m_s > 0.05, "motion")
    client.kill()
    client.wait()
    killed_s = graph.t_s
    graph.until(lambda: graph.heard[on.GUARD] and graph.heard[on.GUARD][-1].holding, "a hold")
    assert graph.heard[on.GUARD][-1].holding == "the client of the goal is silent for 0.6 s"
    graph.until(lambda: abs(graph.heard[on.TRACKS][-1].left_m_s) < 0.01, "belts that stand")
    standing = graph.heard[on.TRACKS][-1]
    assert standing.t_s - killed_s < 1.0
