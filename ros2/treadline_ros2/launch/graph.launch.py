"""The graph of the paper's Fig. 7: each node in a process of its own, configured and activated."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, RegisterEventHandler
from launch.conditions import IfCondition
from launch.events import matches_action
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode, Node
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

NODES = ("guard", "camera", "heading", "seat", "driver", "plant")
PACKAGE = "treadline_ros2"


def generate_launch_description() -> LaunchDescription:
    """Return what is started: ``ros2 launch treadline_ros2 graph.launch.py scenario:=paper-28``."""
    share = Path(__file__).resolve().parents[1]
    scenario, plant, urdf = LaunchConfiguration("scenario"), LaunchConfiguration("plant"), LaunchConfiguration("urdf")
    actions = [
        DeclareLaunchArgument("scenario", default_value="default", description="a scenario file, or a shipped one's name"),
        DeclareLaunchArgument("plant", default_value="true", description="false where Gazebo or drivers take its place"),
        DeclareLaunchArgument("urdf", default_value="", description="what treadline model SCENARIO --to urdf wrote: for RViz"),
        Node(
            package="robot_state_publisher",
            executable="robot_state_publisher",
            arguments=[urdf],
            condition=IfCondition(_told(urdf)),
        ),
    ]
    for name in NODES:
        node = LifecycleNode(
            package=PACKAGE,
            executable="node",
            name=name,
            namespace="",
            parameters=[str(share / "config" / "params.yaml"), {"scenario": scenario}],
            output="screen",
            condition=IfCondition(plant) if name == "plant" else None,
        )
        actions += [node, *_woken(node)]
    return LaunchDescription(actions)


def _told(argument: LaunchConfiguration) -> list[object]:
    """Return a condition's text: true where the argument is not empty."""
    from launch.substitutions import PythonExpression

    return [PythonExpression(["'", argument, "' != ''"])]


def _woken(node: LifecycleNode) -> list[object]:
    """Configure a node when it starts, and activate it when it is configured."""

    def change(transition: int) -> EmitEvent:
        return EmitEvent(event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition))

    configured = OnStateTransition(
        target_lifecycle_node=node, goal_state="inactive", entities=[change(Transition.TRANSITION_ACTIVATE)]
    )
    return [RegisterEventHandler(configured), change(Transition.TRANSITION_CONFIGURE)]
