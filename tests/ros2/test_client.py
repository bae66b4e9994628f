"""The client of the actions where something goes wrong: one line and an exit code; and a driver that fails during a goal."""

import contextlib
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
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from treadline_msgs.action import TraverseStair


class Client:
    """``ros2 run treadline_ros2 climb``."""

    def __init__(self, namespace: str) -> None:
        command = [sys.executable, "-u", "-m", "treadline_ros2.client", "--ros-args", "-r", f"__ns:={namespace}"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)

    def interrupt(self, number: int = signal.SIGINT) -> None:
        self.process.send_signal(number)

    def end(self) -> tuple[int, list[str]]:
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, (out + err).splitlines()


class Offered:
    """An action server of somebody else, whose goals end when the test says so."""

    def __init__(self, bystander: Any, answer: Callable[[Any], GoalResponse] = lambda _: GoalResponse.ACCEPT) -> None:
        self.goals: list[Any] = []
        self.cancelled = False
        self._ended: Future[None] = Future()
        self.server = ActionServer(
            bystander.node,
            TraverseStair,
            "traverse_stair",
            execute_callback=self._execute,
            goal_callback=answer,
            cancel_callback=self._cancel,
        )

    async def _execute(self, goal: Any) -> Any:
        self.goals.append(goal)
        await self._ended
        goal.canceled()
        return TraverseStair.Result(verdict=TraverseStair.Result.VERDICT_CANCELLED, cause="cancelled by the client")

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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_a_signal_to_end_cancels_the_goal_and_its_end_is_awaited(watching: Callable[..., Any], number: signal.Signals) -> None:
    name = f"/cancels_{number.name.lower()}"
    client, bystander = Client(name), watching(name)
    offered = Offered(bystander)
    bystander.until(lambda: offered.goals, "a goal")
    client.interrupt(number)
    bystander.until(lambda: offered.cancelled, "a cancel")
    offered.end()
    bystander.until(lambda: client.process.poll() is not None, "the end")
    assert client.end() == (1, ["cancelled: cancelled by the client"])


def test_a_client_whose_terminal_is_closed_cancels_all_the_same(watching: Callable[..., Any]) -> None:
    """Test: a client whose feedback nobody can read any more is hung up. Expected result: the goal is cancelled."""
    client, bystander = Client("/closed"), watching("/closed")
    offered = Offered(bystander)
    bystander.until(lambda: offered.goals, "a goal")
    assert client.process.stdout is not None
    client.process.stdout.close()
    for _ in range(3):
        offered.goals[0].publish_feedback(TraverseStair.Feedback())
        bystander.pause(0.3)
    client.interrupt(signal.SIGHUP)
    bystander.until(lambda: offered.cancelled, "a cancel")
    offered.end()
    bystander.until(lambda: client.process.poll() is not None, "the end")


def test_a_second_ctrl_c_ends_a_client_whose_goal_is_not_answered(watching: Callable[..., Any]) -> None:
    """Test: the driver stands still as a goal reaches it, and Ctrl-C is pressed until the client ends. Expected: one line."""
    client, bystander = Client("/silent"), watching("/silent")

    def stand_still(_: Any) -> GoalResponse:
        for _ in range(300):
            client.interrupt()
            with contextlib.suppress(subprocess.TimeoutExpired):
                client.process.wait(0.2)
                break
        return GoalResponse.REJECT

    offered = Offered(bystander, stand_still)
    bystander.until(lambda: client.process.poll() is not None, "the end")
    assert client.end() == (130, ["treadline: no answer to the goal; see whether the chair stands"])
    assert offered.goals == []


def test_a_driver_that_is_gone_ends_the_client(started: Callable[..., Any], watching: Callable[..., Any]) -> None:
    """Test: Ctrl-C ends the driver during a goal. Expected result: feedback until then, and one line."""
    driver = started("driver", given=("-r", "__ns:=/gone", "-p", "start:=goal"), sim=False)
    bystander = watching("/gone")
    bystander.until(lambda: bystander.state("driver") == "active", "an active driver")
    client = Client("/gone")
    assert client.process.stdout is not None
    assert ", heading " in client.process.stdout.readline()
    assert driver.end() == 0
    code, said = client.end()
    assert (code, said[-1]) == (1, "treadline: the driver has ended; the guard holds the chair")


@pytest.mark.parametrize("how", ["error", "deactivated"])
def test_a_goal_ends_with_its_driver(started: Callable[..., Any], watching: Callable[..., Any], broken: Path, how: str) -> None:
    """Test: a driver whose controller fails when a goal begins; one that a manager deactivates and cleans up. Expected result: the
    goal ends as held, with the cause; the node is unconfigured, without a traceback; a goal is refused until it is active again."""
    name = f"/goal_{how}"
    bystander = watching(name)
    given = ("-p", f"controller:={broken}:Broken") if how == "error" else ()
    process = started("driver", given=("-r", f"__ns:={name}", "-p", "start:=goal", *given), sim=False)
    client = ActionClient(bystander.node, TraverseStair, "traverse_stair")
    bystander.until(client.server_is_ready, "the action")
    bystander.until(lambda: bystander.state("driver") == "active", "an active driver")
    asked = client.send_goal_async(TraverseStair.Goal())
    bystander.until(asked.done, "an answer")
    assert asked.result().accepted
    ended = asked.result().get_result_async()
    if how == "deactivated":
        for transition in (Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP):
            assert bystander.change("driver", transition)
    bystander.until(ended.done, "a result")
    answer = ended.result()
    assert (answer.status, answer.result.verdict) == (GoalStatus.STATUS_ABORTED, TraverseStair.Result.VERDICT_HELD)
    assert answer.result.cause == "the node of the driver was stopped"
    assert bystander.state("driver") == "unconfigured"
    for transition, accepted in ((Transition.TRANSITION_CONFIGURE, False), (Transition.TRANSITION_ACTIVATE, True)):
        assert bystander.change("driver", transition)
        asked = client.send_goal_async(TraverseStair.Goal())
        bystander.until(asked.done, "an answer")
        assert asked.result().accepted is accepted
    assert not [line for line in process.said if "Traceback" in line or "InvalidHandle" in line]
