"""The action traverse_stair of the driver's node."""

import math
from typing import Any

from geometry_msgs.msg import Pose
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from treadline.core.errors import SettingsError
from treadline.mission.odometry import Odometry
from treadline.ros.goal_driver import GoalDriverNode
from treadline.ros.stair_goal import StairGoal
from treadline_msgs.action import TraverseStair
from treadline_msgs.msg import MotionPlan
from unique_identifier_msgs.msg import UUID

NAME = 'traverse_stair'
LEASE_TOPIC = f'{NAME}/lease'
"""Topic on which a client sends the id of its goal while it is there."""
FEEDBACK_S = 0.1
"""Interval of the feedback [s]: that of the camera's frames."""
DIRECTIONS = {
    TraverseStair.Goal.DIRECTION_OF_SCENARIO: None,
    TraverseStair.Goal.DIRECTION_UP: 'up',
    TraverseStair.Goal.DIRECTION_DOWN: 'down',
}


class Actions:
    """
    One goal at a time; cancelling it, and the end of its lease, hold the chair.

    They are offered until the node ends, whatever its state: the end of a goal is asked for after
    an error of the driver, too.
    """

    def __init__(self, node: Any, driver: GoalDriverNode) -> None:
        self._node = node
        self.driver = driver
        self._outcome: Future[Any] = Future()
        self._id: list[int] = []
        self._server = ActionServer(
            node,
            TraverseStair,
            NAME,
            execute_callback=self._execute,
            goal_callback=self._begin,
            cancel_callback=self._cancel,
        )
        self._lease = node.create_subscription(UUID, LEASE_TOPIC, self._renew, 10)

    def close(self) -> None:
        """Take the action back."""
        self._node.destroy_subscription(self._lease)
        self._server.destroy()

    def _begin(self, goal: Any) -> GoalResponse:
        outcome: Future[Any] = Future(executor=self._node.executor)
        if not self._node.is_active:
            self._node.get_logger().error('goal refused: activate this node first')
            return GoalResponse.REJECT
        try:
            self.driver.begin(_asked(goal), outcome.set_result)
        except SettingsError as error:
            self._node.get_logger().error(f'goal refused: {error}')
            return GoalResponse.REJECT
        self._outcome = outcome
        return GoalResponse.ACCEPT

    def _renew(self, goal_id: Any) -> None:
        if list(goal_id.uuid) == self._id:
            self.driver.renew()

    def _cancel(self, goal: Any) -> CancelResponse:
        del goal
        if not self._node.is_active:
            return CancelResponse.REJECT
        self.driver.cancel('cancelled by the client')
        return CancelResponse.ACCEPT

    async def _execute(self, goal: Any) -> Any:
        self._id = list(goal.goal_id.uuid)

        def report() -> None:
            progress = self.driver.progress._asdict()
            phase = getattr(MotionPlan, f'PHASE_{progress.pop("phase").upper()}')
            place = _pose(self.driver.odometry)
            goal.publish_feedback(TraverseStair.Feedback(phase=phase, place=place, **progress))

        timer = self._node.create_timer(FEEDBACK_S, lambda: self._node.attempt(report))
        try:
            outcome = await self._outcome
        finally:
            self._node.destroy_timer(timer)
        end = {'arrived': goal.succeed, 'cancelled': goal.canceled}.get(
            outcome.verdict, goal.abort
        )
        end()
        return self._result(outcome, goal.request.stair_id)

    def _result(self, outcome: Any, stair_id: str) -> Any:
        result = TraverseStair.Result(cause=outcome.cause, stair_id=stair_id)
        result.verdict = getattr(TraverseStair.Result, f'VERDICT_{outcome.verdict.upper()}')
        traversed, odometry = self.driver.traversed, self.driver.odometry
        result.rise_m, result.steps = traversed.rise_m, traversed.steps
        result.pose.header.frame_id = 'odom'
        if odometry is not None:
            seconds = math.floor(odometry.t_s)
            result.pose.header.stamp.sec = seconds
            result.pose.header.stamp.nanosec = round(1e9 * (odometry.t_s - seconds))
        result.pose.pose.pose = _pose(odometry)
        spread = [traversed.sigma_m**2] * 3 + [traversed.heading_sigma_rad**2] * 3
        for at, variance in enumerate(spread):
            result.pose.pose.covariance[7 * at] = variance
        return result


def _asked(goal: Any) -> StairGoal:
    """Return what a goal asks for; an unknown direction is a SettingsError."""
    if goal.direction not in DIRECTIONS:
        raise SettingsError(f'direction {goal.direction}; give one of {sorted(DIRECTIONS)}')
    place = goal.foot.pose.position
    frame = goal.foot.header.frame_id
    return StairGoal(
        direction=DIRECTIONS[goal.direction],
        stair_id=goal.stair_id,
        foot=(frame, (place.x, place.y, place.z)) if frame else None,
        steps=goal.steps,
        step_rise_m=goal.step_rise_m,
        speed_m_s=goal.speed_m_s,
        limit_s=goal.time_limit_s,
        lease_s=goal.lease_s,
    )


def _pose(odometry: Odometry | None) -> Pose:
    """Return the pose of the chair; the identity before the first odometry."""
    pose = Pose()
    if odometry is not None:
        pose.position.x, pose.position.y, pose.position.z = map(float, odometry.p_OB)
        turned = pose.orientation
        turned.w, turned.x, turned.y, turned.z = map(float, odometry.orientation)
    return pose
