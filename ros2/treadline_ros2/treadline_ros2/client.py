"""
A client of climb_stairs and descend_stairs: an example, and a command.

``ros2 run treadline_ros2 climb [down]`` prints the progress. Ctrl-C, a request to end and a
terminal that is closed cancel: the chair holds.
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
from treadline_msgs.action import ClimbStairs, DescendStairs
from treadline_msgs.msg import MotionPlan

WAIT_S = 10.0
"""Time in which the action has to be offered [s]."""
SPIN_S = 0.1
"""Longest time without a look at Ctrl-C and at the driver [s]: the interval of the feedback."""
ENDINGS = [
    getattr(signal, name) for name in ('SIGINT', 'SIGTERM', 'SIGHUP') if hasattr(signal, name)
]
"""Signals after which nobody is there to see what the chair does."""
ENDED_BY = 128
"""Exit code after a signal less its number, as of a shell."""


def main(arguments: list[str] | None = None) -> int:
    """Ask for one traversal; return 0 where the chair arrives."""
    down = 'down' in remove_ros_args(arguments)
    name, kind = ('descend_stairs', DescendStairs) if down else ('climb_stairs', ClimbStairs)
    presses: list[int] = []
    for ending in ENDINGS:
        signal.signal(ending, lambda number, _: presses.append(number))
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('stairs_client')
    try:
        return _traverse(node, name, kind, presses)
    finally:
        for ending in ENDINGS:
            signal.signal(ending, signal.SIG_IGN)
        node.destroy_node()
        rclpy.try_shutdown()


def _traverse(node: Any, name: str, kind: Any, presses: list[int]) -> int:
    """Ask, wait for the end, and return the exit code; ``presses`` grows with each signal."""
    client = ActionClient(node, kind, name)
    until_s = time.monotonic() + WAIT_S
    _spin(node, lambda: client.server_is_ready() or presses or time.monotonic() > until_s)
    if presses:
        return _end(ENDED_BY + presses[0], 'interrupted; no goal was sent')
    if not client.server_is_ready():
        return _end(2, f'nobody offers {name}; start the graph with start:=goal')

    asked = client.send_goal_async(kind.Goal(), _report)
    # After Ctrl-C, too: a goal that is accepted later must not drive the chair with nobody there.
    _spin(node, lambda: asked.done() or len(presses) > 1 or not client.server_is_ready())
    if not asked.done() and len(presses) > 1:
        return _end(ENDED_BY + presses[0], 'no answer to the goal; see whether the chair stands')
    if not asked.done():
        return _end(1, 'the driver has ended without an answer')
    goal = asked.result()
    if not goal.accepted:
        return _end(2, f'{name} is refused; the log of the driver says why')

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
    result = ended.result().result
    verdict = _word(kind.Result, 'VERDICT_', result.verdict)
    sys.stdout.write(': '.join(filter(None, (verdict, result.cause))) + '\n')
    return 0 if result.verdict == kind.Result.VERDICT_ARRIVED else 1


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
    phase = _word(MotionPlan, 'PHASE_', feedback.phase)
    # A terminal that was closed must not keep the goal from its end.
    with contextlib.suppress(OSError):
        sys.stdout.write(
            f'{phase}, heading {degrees[0]:.1f}°, margin {degrees[1]:.0f}°, {to_go}\n'
        )


if __name__ == '__main__':
    sys.exit(main())
