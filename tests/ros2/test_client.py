"""The client of the actions where something goes wrong: one line and an exit code; and a driver that fails during a goal."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import Transition
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.task import Future
from treadline_msgs.action import ClimbStairs


class Client:
    """``ros2 run treadline_ros2 climb``."""

    def __init__(self, namespace: str) -> None:
        command = [sys.executable, "-u", "-m", "treadline_ros2.client", "--ros-args", "-r", f"__ns:={namespace}"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)

    def interrupt(self) -> None:
        self.process.send_signal(signal.SIGINT)

    def end(self) -> tuple[int, list[str]]:
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, (out + err).splitlines()


class Offered:
    """An action server of somebody else, whose goals end when the test says so."""

    def __init__(self, bystander: Any) -> None:
        self.goals: list[Any] = []
        self.cancelled = False
        self._ended: Future[None] = Future()
        self.server = ActionServer(
            bystander.node, ClimbStairs, "climb_stairs", execute_callback=self._execute, cancel_callback=self._cancel
        )

    async def _execute(self, goal: Any) -> Any:
        self.goals.append(goal)
        await self._ended
        goal.canceled()
        return ClimbStairs.Result(verdict=ClimbStairs.Result.VERDICT_CANCELLED, cause="cancelled by the client")

    def _cancel(self, _: Any) -> CancelResponse:
        self.cancelled = True
        return CancelResponse.ACCEPT

    def end(self) -> None:
        self._ended.set_result(None)


def test_ctrl_c_before_anybody_offers_the_action(watching: Callable[..., Any]) -> None:
    client, bystander = Client("/early"), watching("/early")
    bystander.until(lambda: "stairs_client" in bystander.node.get_node_names(), "the client")
    client.interrupt()
    assert client.end() == (130, ["treadline: interrupted; no goal was sent"])


def test_ctrl_c_cancels_the_goal_and_its_end_is_awaited(watching: Callable[..., Any]) -> None:
    client, bystander = Client("/cancels"), watching("/cancels")
    offered = Offered(bystander)
    bystander.until(lambda: offered.goals, "a goal")
    client.interrupt()
    bystander.until(lambda: offered.cancelled, "a cancel")
    offered.end()
    bystander.until(lambda: client.process.poll() is not None, "the end")
    assert client.end() == (1, ["verdict 9: cancelled by the client"])


def test_a_driver_that_is_gone_ends_the_client(watching: Callable[..., Any]) -> None:
    client, bystander = Client("/gone"), watching("/gone")
    offered = Offered(bystander)
    bystander.until(lambda: offered.goals, "a goal")
    offered.server.destroy()
    bystander.until(lambda: client.process.poll() is not None, "the end")
    assert client.end() == (1, ["treadline: the driver has ended; the guard holds the chair"])


BREAKS = """
class Breaks:
    follows_plan, period_s = True, 0.25

    def __init__(self, config):
        pass

    def step(self, estimate, t_s, plan):
        if plan.phase != "arrived":
            raise RuntimeError("broken on purpose")
"""


@pytest.mark.parametrize("how", ["error", "deactivated"])
def test_a_goal_ends_with_its_driver(started: Callable[..., Any], watching: Callable[..., Any], tmp_path: Path, how: str) -> None:
    """Test: a driver whose controller fails when a goal begins; one that a manager deactivates and cleans up. Expected result: the
    goal ends as held, with the cause; the node is unconfigured, without a traceback; a goal is refused until it is active again."""
    (tmp_path / "breaks.py").write_text(BREAKS)
    name = f"/goal_{how}"
    bystander = watching(name)
    given = ("-p", f"controller:={tmp_path / 'breaks.py'}:Breaks") if how == "error" else ()
    process = started("driver", given=("-r", f"__ns:={name}", "-p", "start:=goal", *given), sim=False)
    client = ActionClient(bystander.node, ClimbStairs, "climb_stairs")
    bystander.until(client.server_is_ready, "the action")
    bystander.until(lambda: bystander.state("driver") == "active", "an active driver")
    asked = client.send_goal_async(ClimbStairs.Goal())
    bystander.until(asked.done, "an answer")
    assert asked.result().accepted
    ended = asked.result().get_result_async()
    if how == "deactivated":
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
            assert bystander.change("driver", transition)
    bystander.until(ended.done, "a result")
    answer = ended.result()
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_ABORTED, ClimbStairs.Result.VERDICT_HELD)
    assert answer.result.cause == "the node of the driver was stopped"
    assert bystander.state("driver") == "unconfigured"
    for transition, accepted in ((Transition.TRANSITION_CONFIGURE, False), (Transition.TRANSITION_ACTIVATE, True)):
        assert bystander.change("driver", transition)
        asked = client.send_goal_async(ClimbStairs.Goal())
        bystander.until(asked.done, "an answer")
        assert asked.result().accepted is accepted
    assert not [line for line in process.said if "Traceback" in line or "InvalidHandle" in line]
