"""The action traverse_stair: goal, feedback, result, and what cancelling does."""

import math
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from rclpy.action import ActionClient
from treadline_msgs.action import TraverseStair
from treadline_msgs.msg import MotionPlan

from treadline.ros import channels as on

TWO_FLOORS = """
[stair]
steps = 1
landing_m = 4.0
[sensors]
camera = "statistical"
"""
CLIMB_S = 400.0
"""Longest wait for the end of a traversal, which a busy machine slows [s]."""


class Asked:
    """One goal, and what came of it."""

    def __init__(self, bystander: Any, **goal: Any) -> None:
        self._bystander, self.feedback = bystander, []
        client = ActionClient(bystander.node, TraverseStair, "traverse_stair")
        bystander.until(client.server_is_ready, "traverse_stair")
        answer = client.send_goal_async(TraverseStair.Goal(**goal), lambda message: self.feedback.append(message.feedback))
        bystander.until(answer.done, "an answer")
        self.handle = answer.result()

    def result(self) -> Any:
        answer = self.handle.get_result_async()
        self._bystander.until(answer.done, "a result", CLIMB_S)
        return answer.result()

    def cancel(self) -> None:
        answer = self.handle.cancel_goal_async()
        self._bystander.until(answer.done, "an answer")


@pytest.fixture
def graph(started: Callable[..., Any], watching: Callable[..., Any], roles: tuple[str, ...], tmp_path: Path) -> Any:
    """A graph that waits for a goal."""
    (tmp_path / "two_floors.toml").write_text(TWO_FLOORS)
    bystander = watching()
    bystander.watch_clock()
    bystander.hear_signals(on.TRACKS)
    bystander.hear_signals(on.GUARD)
    started(*roles, given=("-p", "start:=goal", "-p", f"scenario:={tmp_path / 'two_floors.toml'}"))
    bystander.until(lambda: bystander.t_s > 1.0, "a second without a goal")
    assert all(abs(reading.left_m_s) < 0.01 for reading in bystander.heard[on.TRACKS])
    return bystander


def follow_path(graph: Any, publisher: Any, seconds: float) -> None:
    """Drive straight on at 0.1 m/s as Nav2's FollowPath does: stamped by the clock, 20 Hz."""

    def drive() -> None:
        message = TwistStamped()
        message.header.stamp = Time(sec=int(graph.t_s), nanosec=int(graph.t_s % 1.0 * 1e9))
        message.twist.linear.x = 0.1
        publisher.publish(message)

    until_s, timer = graph.t_s + seconds, graph.node.create_timer(0.05, drive)
    graph.until(lambda: graph.t_s > until_s, f"{seconds} seconds of driving")
    graph.until(lambda: math.isclose(graph.heard[on.TRACKS][-1].left_m_s, 0.1, abs_tol=0.01), "belts at 0.1 m/s")
    graph.node.destroy_timer(timer)


def test_a_behaviour_tree_over_two_floors(graph: Any) -> None:
    """Test: ``two_floors.xml`` as a client plays it: cmd_vel, a goal of traverse_stair, cmd_vel. Expected result: the belts run as
    asked; feedback of phase, heading, margin and a distance that falls; the goal succeeds, a second one meanwhile is refused;
    the guard says whose commands count, and never holds."""
    publisher = graph.node.create_publisher(TwistStamped, "cmd_vel", 10)
    follow_path(graph, publisher, 1.5)
    goal = Asked(graph, time_limit_s=90.0, stair_id="east")
    assert goal.handle.accepted
    assert not Asked(graph).handle.accepted
    answer = goal.result()
    assert answer.result.verdict == TraverseStair.Result.VERDICT_ARRIVED, answer.result.cause
    assert answer.status == GoalStatus.STATUS_SUCCEEDED
    assert (answer.result.stair_id, answer.result.steps, answer.result.pose.header.frame_id) == ("east", 1, "odom")
    assert answer.result.rise_m > 0.1
    assert answer.result.pose.pose.covariance[0] > 0.0
    follow_path(graph, publisher, 1.5)
    states = graph.heard[on.GUARD]
    sources = [source for source, _ in groupby(state.source for state in states)]
    after = ["velocity", "driver", "velocity"]
    assert sources in (after, ["driver", *after])  # a state of the guard was heard before the first command, or not
    assert [state.holding for state in states if state.holding] == []
    phases = [message.phase for message in goal.feedback]
    assert {MotionPlan.PHASE_MOUNT, MotionPlan.PHASE_CREST} <= set(phases)
    assert all(abs(message.heading_rad) < math.radians(10.0) for message in goal.feedback if not math.isnan(message.heading_rad))
    assert all(0.0 < message.stability_margin_rad < math.radians(60.0) for message in goal.feedback[1:])
    known = [message.distance_to_go_m for message in goal.feedback if not math.isnan(message.distance_to_go_m)]
    assert known[0] > known[-1] + 0.3


def test_a_cancelled_goal_holds_the_chair(graph: Any) -> None:
    """Test: a goal of the other direction; then a goal that is cancelled. Expected result: the first is refused; after the
    second the guard holds with the cause, and a third is refused until a person re-arms."""
    assert not Asked(graph, direction=TraverseStair.Goal.DIRECTION_DOWN).handle.accepted
    goal = Asked(graph, speed_m_s=0.1)
    graph.until(lambda: graph.heard[on.TRACKS][-1].left_m_s > 0.05, "motion")
    goal.cancel()
    answer = goal.result()
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_CANCELED, TraverseStair.Result.VERDICT_CANCELLED)
    graph.until(lambda: graph.heard[on.GUARD][-1].holding == "cancelled by the client", "a hold")
    graph.pause(1.0)
    assert abs(graph.heard[on.TRACKS][-1].left_m_s) < 0.01
    assert not Asked(graph).handle.accepted
