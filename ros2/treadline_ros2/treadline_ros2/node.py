"""
Nodes of treadline: blocks of the graph with ROS 2's life cycle, one or more in a process.

``ros2 run treadline_ros2 node guard --ros-args -r __node:=watchman -p autostart:=true``
"""

import os
import signal
import sys
from types import FrameType

SOURCE = 'source /opt/ros/DISTRO/setup.bash, and the workspace where treadline_msgs was built'
EXECUTED_S = 0.1
"""Longest time without a look at the request to end [s]."""


def main(arguments: list[str] | None = None) -> int:
    """Run nodes of the roles given as words until an interruption; return the exit code."""
    interruption = Interruption()
    try:
        return _run(arguments, interruption)
    except KeyboardInterrupt:
        interruption.ignore()
        return 0  # before the nodes ran


def _run(arguments: list[str] | None, interruption: 'Interruption') -> int:
    try:
        _check_middleware()
        import rclpy
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import remove_ros_args
        from treadline_ros2.lifecycle_node import Executor, TreadlineNode
    except ImportError as error:
        return _end(2, f'{_line(error)}; {SOURCE}')
    nodes: list[TreadlineNode] = []
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        nodes += [TreadlineNode(role) for role in remove_ros_args(arguments)[1:] or ['']]
        executor = Executor()
        for node in nodes:
            executor.add_node(node)
        if not all(node.configure() for node in nodes):
            return 2
        if not all(node.activate() for node in nodes):
            return 2
        interruption.is_waited_for = True
        while not interruption.is_asked:
            executor.spin_once(timeout_sec=EXECUTED_S)
        executor.shutdown()
    finally:
        interruption.ignore()
        for node in reversed(nodes):
            node.end()
        rclpy.try_shutdown()
    return 0


class Interruption:
    """A request to end: Ctrl-C, or the launch system's; a second one repeats the first."""

    def __init__(self) -> None:
        self.is_asked = False
        self.is_waited_for = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def ignore(self) -> None:
        """Ignore what still comes, the end of Python itself included."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        del number, frame
        again, self.is_asked = self.is_asked, True
        if not self.is_waited_for and not again:
            raise KeyboardInterrupt


def _end(code: int, line: str) -> int:
    sys.stderr.write(f'treadline: {line}\n')
    return code


def _line(error: Exception) -> str:
    return ' '.join(str(error).split())[:300]


def _check_middleware() -> None:
    """Look for the middleware that the environment asks for: rcl itself would end the process."""
    from ament_index_python import get_resources

    asked, there = (
        os.environ.get('RMW_IMPLEMENTATION'),
        sorted(set(get_resources('rmw_typesupport')) - {'rmw_implementation'}),
    )
    if asked and asked not in there:
        package = f'ros-{os.environ.get("ROS_DISTRO", "DISTRO")}-{asked.replace("_", "-")}'
        what = f'RMW_IMPLEMENTATION is {asked}, here is {" or ".join(there)}'
        sys.exit(_end(2, f'{what}: install {package}, or unset the variable'))


if __name__ == '__main__':
    sys.exit(main())
