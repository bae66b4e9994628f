"""A node of treadline with ROS 2's life cycle: configured it has its block, active it is turned.

``ros2 run treadline_ros2 node --ros-args -r __node:=guard -p scenario:=default``; its name says which node of the graph it is.
"""

import sys
from pathlib import Path
from threading import Event, Thread
from typing import Any

import rclpy
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.lifecycle.node import LifecycleState

from treadline.core.errors import TreadlineError
from treadline.ros.assembly import mount_of, node_of
from treadline.ros.node_process import NodeRunner, run_plant
from treadline.ros.plant_node import PlantNode
from treadline.run.resolve import resolve
from treadline_ros2.transport import RclpyTransport


class TreadlineNode(LifecycleNode):
    """One of plant, camera, heading, seat, driver, guard and recorder."""

    def __init__(self, name: str = "guard") -> None:
        super().__init__(name)
        for key, value in (
            ("scenario", "default"),
            ("controller", ""),
            ("plant", "mujoco"),
            ("seed", 0),
            ("pace", 1.0),
            ("out", ""),
        ):
            self.declare_parameter(key, value)
        self._stop = Event()
        self._thread: Thread | None = None
        self._made: Any = None
        self._wire: RclpyTransport | None = None

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the settings and make the block."""
        del state
        out = self._parameter("out")
        try:
            setup = resolve(
                self._parameter("scenario"),
                self._parameter("controller") or None,
                self._parameter("seed"),
                open_plant=self._parameter("plant"),
            )
            self._made = node_of(self.get_name(), setup.mission, plant=setup.open_plant, out=Path(out) if out else None)
        except TreadlineError as error:
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self._wire = RclpyTransport(self, mount_of(setup.mission))
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to turn."""
        self._stop.clear()
        self._thread = Thread(target=self._turn, name=self.get_name())
        self._thread.start()
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop turning: the guard holds, for one of its nodes is silent."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the block: what it remembers of the chair is old."""
        del state
        if hasattr(self._made, "close"):
            self._made.close()
        if self._wire is not None:
            self._wire.close()
        self._made = self._wire = None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End from whatever state."""
        self.on_deactivate(state)
        return self.on_cleanup(state)

    def _turn(self) -> None:
        try:
            if isinstance(self._made, PlantNode):
                run_plant(self._made, self._wire, stop=self._stop, pace=self._parameter("pace"))
            else:
                clock = "sim" if self.get_parameter("use_sim_time").value else "wall"
                NodeRunner(self._made, self._wire, clock=clock).run(self._stop)
        except TreadlineError as error:
            self.get_logger().error(str(error))

    def _parameter(self, key: str) -> Any:
        return self.get_parameter(key).value


def main(arguments: list[str] | None = None) -> None:
    """Turn until interrupted."""
    rclpy.init(args=sys.argv if arguments is None else arguments)
    node = TreadlineNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.on_shutdown(None)
        node.destroy_node()
        rclpy.try_shutdown()
