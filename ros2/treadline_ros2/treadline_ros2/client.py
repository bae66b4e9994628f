"""
A client of traverse_stair: an example, and a command.

``ros2 run treadline_ros2 climb [down]`` prints the progress. Ctrl-C, a request to end and a
terminal that is closed cancel: the chair holds. So it does where this process dies: its goal has
a lease, which it renews as long as it lives.
"""

from collections.abc import Callable
import contextlib
import math
import signal
import sys
import time
from typing import Any

import rclpy
from rclpy.action import ActionClient
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from treadline_msgs.action import TraverseStair
from treadline_msgs.msg import MotionPlan
from treadline_ros2.actions import LEASE_TOPIC, NAME
from unique_identifier_msgs.msg import UUID

WAIT_S = 10.0
"""Time in which the action has to be offered [s]."""
SPIN_S = 0.1
"""Longest time without a look at Ctrl-C and at the driver [s]: the interval of the feedback."""
LEASE_S = 0.6
"""Silence after which the chair is held [s]: six looks; with the ramp of the belts below 1 s."""
ENDINGS = [
    getattr(signal, name) for name in ('SIGINT', 'SIGTERM', 'SIGHUP') if hasattr(signal, name)
]
"""Signals after which nobody is there to see what the chair does."""
ENDED_BY = 128
"""Exit code after a signal less its number, as of a shell."""


def main(arguments: list[str] | None = None) -> int:
    """Ask for one traversal; return 0 where the chair arrives."""
    down = 'down' in remove_ros_args(arguments)
    asked = TraverseStair.Goal(lease_s=LEASE_S)
    asked.direction = asked.DIRECTION_DOWN if down else asked.DIRECTION_UP
    presses: list[int] = []
    for ending in ENDINGS:
        signal.signal(ending, lambda number, _: presses.append(number))
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('stairs_client')
    try:
        return _traverse(node, asked, presses)
    finally:
        for ending in ENDINGS:
            signal.signal(ending, signal.SIG_IGN)
        node.destroy_node()
        rclpy.try_shutdown()


def _traverse(node: Any, request: Any, presses: list[int]) -> int:
    """Ask, wait for the end, and return the exit code; ``presses`` grows with each signal."""
    client = ActionClient(node, TraverseStair, NAME)
    lease = node.create_publisher(UUID, LEASE_TOPIC, 1)
    until_s = time.monotonic() + WAIT_S
    _spin(node, lambda: client.server_is_ready() or presses or time.monotonic() > until_s)
    if presses:
        return _end(ENDED_BY + presses[0], 'interrupted; no goal was sent')
    if not client.server_is_ready():
        return _end(2, f'nobody offers {NAME}; start the graph with start:=goal')

    asked = client.send_goal_async(request, _report)
    # After Ctrl-C, too: a goal that is accepted later must not drive the chair with nobody there.
    _spin(node, lambda: asked.done() or len(presses) > 1 or not client.server_is_ready())
    if not asked.done() and len(presses) > 1:
        return _end(ENDED_BY + presses[0], 'no answer to the goal; see whether the chair stands')
    if not asked.done():
        return _end(1, 'the driver has ended without an answer')
    goal = asked.result()
    if not goal.accepted:
        return _end(2, f'{NAME} is refused; the log of the driver says why')

    timer = node.create_timer(SPIN_S, lambda: lease.publish(goal.goal_id))
    ended = goal.get_result_async()
    _spin(node, lambda: ended.done() or presses or not client.server_is_ready())
    if not ended.done() and presses:
        goal.cancel_goal_async()
        _spin(node, lambda: ended.done() or len(presses) > 1 or not client.server_is_ready())
    if not ended.done() and len(presses) > 1:
        return _end(
            ENDED_BY + presses[0], 'interrupted before the end; see whether the chair stands'
        )
    if not ended.done():
        return _end(1, 'the driver has ended; the guard holds the chair')
    node.destroy_timer(timer)
    result = ended.result().result
    verdict = _word(TraverseStair.Result, 'VERDICT_', result.verdict)
    rose = f'{result.steps} steps, {result.rise_m:+.2f} m' if result.steps else ''
    sys.stdout.write(': '.join(filter(None, (verdict, result.cause, rose))) + '\n')
    return 0 if result.verdict == TraverseStair.Result.VERDICT_ARRIVED else 1


def _spin(node: Any, done: Callable[[], object]) -> None:
    while not done():
        rclpy.spin_once(node, timeout_sec=SPIN_S)


def _end(code: int, line: str) -> int:
    sys.stderr.write(f'treadline: {line}\n')
    return code


def _word(kind: Any, prefix: str, number: int) -> str:
    """Return the word of a number by the constants of a message."""
    constants = [name for name in dir(type(kind)) if name.startswith(prefix)]
    named = (name for name in constants if getattr(kind, name) == number)
    return next(named, str(number)).removeprefix(prefix).lower().replace('_', ' ')


def _report(message: Any) -> None:
    feedback = message.feedback
    degrees = [math.degrees(a) for a in (feedback.heading_rad, feedback.stability_margin_rad)]
    to_go_m = feedback.distance_to_go_m
    to_go = 'distance not known yet' if math.isnan(to_go_m) else f'{to_go_m:.2f} m to go'
    to_go += '' if math.isnan(feedback.remaining_s) else f' in {feedback.remaining_s:.0f} s'
    phase = _word(MotionPlan, 'PHASE_', feedback.phase)
    # A terminal that was closed must not keep the goal from its end.
    with contextlib.suppress(OSError):
        sys.stdout.write(
            f'{phase}, heading {degrees[0]:.1f}°, margin {degrees[1]:.0f}°, {to_go}\n'
        )


if __name__ == '__main__':
    sys.exit(main())
