"""
A client of climb_stairs and descend_stairs: an example, and a command.

``ros2 run treadline_ros2 climb [down]`` prints the progress; Ctrl-C cancels: the chair holds.
"""

import math
import sys
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from treadline_msgs.action import ClimbStairs, DescendStairs

WAIT_S = 10.0
"""Time in which the action has to be offered [s]."""


def main(arguments: list[str] | None = None) -> int:
    """Ask for one traversal; return 0 where the chair arrives."""
    down = 'down' in remove_ros_args(arguments)
    name, kind = ('descend_stairs', DescendStairs) if down else ('climb_stairs', ClimbStairs)
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('stairs_client')
    client = ActionClient(node, kind, name)
    if not client.wait_for_server(WAIT_S):
        sys.stderr.write(f'treadline: nobody offers {name}; start the graph with start:=goal\n')
        return 2
    asked = client.send_goal_async(kind.Goal(), _report)
    rclpy.spin_until_future_complete(node, asked)
    goal = asked.result()
    if not goal.accepted:
        sys.stderr.write(f'treadline: {name} is refused; the log of the driver says why\n')
        return 2
    ended = goal.get_result_async()
    try:
        rclpy.spin_until_future_complete(node, ended)
    except KeyboardInterrupt:
        goal.cancel_goal_async()
        rclpy.spin_until_future_complete(node, ended)
    result = ended.result().result
    sys.stdout.write(f'verdict {result.verdict}: {result.cause or "arrived"}\n')
    rclpy.try_shutdown()
    return 0 if result.verdict == kind.Result.VERDICT_ARRIVED else 1


def _report(message: Any) -> None:
    feedback = message.feedback
    degrees = [math.degrees(a) for a in (feedback.heading_rad, feedback.stability_margin_rad)]
    sys.stdout.write(
        f'phase {feedback.phase}, heading {degrees[0]:.1f}°, margin {degrees[1]:.0f}°, '
        f'{feedback.distance_to_go_m:.2f} m to go\n'
    )


if __name__ == '__main__':
    sys.exit(main())
