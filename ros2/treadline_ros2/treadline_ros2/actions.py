"""The actions climb_stairs and descend_stairs of the driver's node."""

from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from treadline.core.errors import SettingsError
from treadline.ros.goal_driver import GoalDriverNode
from treadline_msgs.action import ClimbStairs, DescendStairs
from treadline_msgs.msg import MotionPlan

FEEDBACK_S = 0.1
"""Interval of the feedback [s]: that of the camera's frames."""
ACTIONS = {'climb_stairs': (ClimbStairs, 'up'), 'descend_stairs': (DescendStairs, 'down')}


class Actions:
    """
    One goal at a time; cancelling it holds the chair.

    They are offered until the node ends, whatever its state: the end of a goal is asked for after
    an error of the driver, too.
    """

    def __init__(self, node: Any, driver: GoalDriverNode) -> None:
        self._node = node
        self.driver = driver
        self._outcome: Future[Any] = Future()
        self._servers = [
            ActionServer(
                node,
                kind,
                name,
                execute_callback=partial(self._execute, kind),
                goal_callback=partial(self._begin, direction),
                cancel_callback=self._cancel,
            )
            for name, (kind, direction) in ACTIONS.items()
        ]

    def close(self) -> None:
        """Take the actions back."""
        for server in self._servers:
            server.destroy()

    def _begin(self, direction: Any, goal: Any) -> GoalResponse:
        outcome: Future[Any] = Future(executor=self._node.executor)
        if not self._node.is_active:
            self._node.get_logger().error('goal refused: activate this node first')
            return GoalResponse.REJECT
        try:
            self.driver.begin(direction, outcome.set_result, goal.speed_m_s, goal.time_limit_s)
        except SettingsError as error:
            self._node.get_logger().error(f'goal refused: {error}')
            return GoalResponse.REJECT
        self._outcome = outcome
        return GoalResponse.ACCEPT

    def _cancel(self, goal: Any) -> CancelResponse:
        del goal
        if not self._node.is_active:
            return CancelResponse.REJECT
        self.driver.cancel('cancelled by the client')
        return CancelResponse.ACCEPT

    async def _execute(self, kind: Any, goal: Any) -> Any:
        def report() -> None:
            progress = self.driver.progress._asdict()
            phase = getattr(MotionPlan, f'PHASE_{progress.pop("phase").upper()}')
            goal.publish_feedback(kind.Feedback(phase=phase, **progress))

        timer = self._node.create_timer(FEEDBACK_S, lambda: self._node.attempt(report))
        try:
            outcome = await self._outcome
        finally:
            self._node.destroy_timer(timer)
        end = {'arrived': goal.succeed, 'cancelled': goal.canceled}.get(
            outcome.verdict, goal.abort
        )
        end()
        verdict = getattr(kind.Result, f'VERDICT_{outcome.verdict.upper()}')
        return kind.Result(verdict=verdict, cause=outcome.cause)
