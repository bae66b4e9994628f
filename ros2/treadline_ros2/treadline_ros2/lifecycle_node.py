"""
A block of the graph as a lifecycle node.

Configured it has its block, active it runs, and an error of the block is an error of the node.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from treadline.cli.compile import compile_once
from treadline.core.errors import TreadlineError
from treadline.core.signals import TICK_S
from treadline.ros.assembly import driving_nodes, node_of, ROLES
from treadline.ros.goal_driver import GoalDriverNode
from treadline.ros.node_process import NodeRunner, PlantRunner, POLL_S
from treadline.ros.plant_node import PlantNode
from treadline.run.resolve import resolve
from treadline_ros2.actions import Actions
from treadline_ros2.transport import RclpyTransport

try:
    # Messages in the order of their arrival.
    from rclpy.experimental.events_executor import EventsExecutor as Executor
except ImportError:
    from rclpy.executors import SingleThreadedExecutor as Executor

__all__ = ['Executor', 'TreadlineNode']

PARAMETERS: dict[str, tuple[Any, str]] = {
    'role': ('', f'which node of the graph this is: {", ".join(ROLES)}'),
    'scenario': ('default', 'settings of the whole graph: a file, or a name of a shipped one'),
    'controller': ('shipped', 'a file of treadline tune, a plug-in, or shipped'),
    'plant': ('mujoco', 'simulator of the plant: mujoco or gazebo'),
    'seed': (0, 'random seed of the simulated plant'),
    'pace': (1.0, 'simulated seconds per second'),
    'cmd_vel': ('twist_stamped', 'guard: type of cmd_vel: twist_stamped or twist'),
    'start': ('now', 'driver: now, or goal: stand until traverse_stair is asked'),
    'out': ('', 'recorder: a run folder, or a file that ends in .mcap, .bag or .db3'),
    'patience': (60.0, 'time after which a silent topic is reported [s]'),
    'autostart': (False, 'whether the node configures and activates itself'),
}
CHOICES = {'cmd_vel': ('twist_stamped', 'twist'), 'start': ('now', 'goal')}


class TreadlineNode(LifecycleNode):
    """One of the roles of ``treadline.ros.assembly``, under whatever name the node has."""

    def __init__(self, role: str = '') -> None:
        super().__init__(role or 'treadline')
        for name, (value, description) in (
            PARAMETERS | {'role': (role, PARAMETERS['role'][1])}
        ).items():
            # A number may be given without a point, as pace:=2.
            descriptor = ParameterDescriptor(
                description=description, read_only=True, dynamic_typing=isinstance(value, float)
            )
            self.declare_parameter(name, value, descriptor)
        self._block: Any = None
        self._transport: RclpyTransport | None = None
        self._runner: NodeRunner | PlantRunner | None = None
        self._timer: Any = None
        self._actions: Actions | None = None
        self.is_active = False
        self._fault: str | None = None

    def configure(self) -> bool:
        """Configure the node where it starts by itself; return whether it may run."""
        return (
            not self._value('autostart')
            or self.trigger_configure() == TransitionCallbackReturn.SUCCESS
        )

    def activate(self) -> bool:
        """Activate the node where it starts by itself; return whether it may run."""
        return (
            not self._value('autostart')
            or self.trigger_activate() == TransitionCallbackReturn.SUCCESS
        )

    def end(self) -> None:
        """End from whatever state, with one line."""
        self._release()
        if self._actions is not None:
            self._actions.close()
        self.get_logger().info('ended')
        self.destroy_node()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the settings, make the block and its topics."""
        del state
        try:
            self._configure()
        except TreadlineError as error:
            self.get_logger().error(str(error))
            self._release()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to run."""
        del state
        self._fault = None
        self._runner.__enter__()
        self.is_active = True
        # The wall's time, whatever the clock of the mission does.
        period_s = min(POLL_S, TICK_S / self._value('pace'))
        self._timer = self.create_timer(
            period_s, lambda *_: self.attempt(), clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.get_logger().info('active')
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop running: the guard holds, for one of its nodes is silent."""
        del state
        self._stop()
        return (
            TransitionCallbackReturn.SUCCESS
            if self._fault is None
            else TransitionCallbackReturn.ERROR
        )

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the block: what it remembers of the chair is old."""
        del state
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End from whatever state."""
        return self.on_cleanup(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the block after an error of it; the node can be configured again."""
        return self.on_cleanup(state)

    def attempt(self, do: Callable[..., object] | None = None, *given: Any) -> None:
        """Do something while the node is active, then what is due."""
        if not self.is_active:
            return
        try:
            if do is not None:
                do(*given)
            self._runner.turn()
        except Exception as error:
            kind = '' if isinstance(error, TreadlineError) else f'{type(error).__name__}: '
            self._fault = f'{kind}{error}'
            self.get_logger().error(self._fault)
            self.trigger_deactivate()

    def _configure(self) -> None:
        role = self._value('role')
        self._check_parameters(role)
        setup = resolve(
            self._value('scenario'),
            self._value('controller'),
            self._value('seed'),
            open_plant=self._value('plant'),
        )
        setup.require_controller()
        if role in driving_nodes(setup.mission.chair):
            # A node that compiles while the graph runs is silent for seconds.
            compile_once()
        self._block = node_of(
            role,
            setup.mission,
            plant=setup.open_plant,
            out=Path(self._value('out')) if self._value('out') else None,
            goals=self._value('start') == 'goal',
        )
        stamped = self._value('cmd_vel') == 'twist_stamped'
        mount = setup.mission.camera
        self._transport = RclpyTransport(self, self.attempt, mount, stamped=stamped)
        if isinstance(self._block, GoalDriverNode):
            self._actions = self._actions or Actions(self, self._block)
            self._actions.driver = self._block
        self._runner = self._runner_of(self._block, self._transport)

    def _runner_of(self, block: Any, transport: RclpyTransport) -> NodeRunner | PlantRunner:
        patience_s = self._value('patience')
        if isinstance(block, PlantNode):
            return PlantRunner(block, transport, pace=self._value('pace'), patience_s=patience_s)
        clock = 'sim' if self._value('use_sim_time') else 'wall'
        return NodeRunner(block, transport, clock=clock, patience_s=patience_s)

    def _check_parameters(self, role: str) -> None:
        if role not in ROLES:
            raise TreadlineError(f"no role is called '{role}'; name one of {', '.join(ROLES)}")
        for name, choices in CHOICES.items():
            if self._value(name) not in choices:
                raise TreadlineError(
                    f"{name} is '{self._value(name)}'; give {' or '.join(choices)}"
                )
        if self._value('pace') <= 0.0:
            raise TreadlineError(f'pace is {self._value("pace"):g}; give a positive number')

    def _stop(self) -> None:
        self.is_active = False
        if isinstance(self._block, GoalDriverNode):
            self._block.abandon('the node of the driver was stopped')
        if self._timer is not None:
            self._timer.cancel()
            self.destroy_timer(self._timer)
            self._timer = None
            self._runner.__exit__()

    def _release(self) -> None:
        self._stop()
        if hasattr(self._block, 'close'):
            self._block.close()
        if self._transport is not None:
            self._transport.close()
        self._block = self._transport = self._runner = None

    def _value(self, name: str) -> Any:
        value = self.get_parameter(name).value
        is_number = isinstance(PARAMETERS.get(name, ('',))[0], float)
        return float(value) if is_number and type(value) is int else value
